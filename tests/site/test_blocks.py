"""Every block of shell on the site's pages is run, page by page, from top to bottom.

What needs robots, cameras, other machines or hours is in `ELSEWHERE`, with the reason; runs are
made shorter by `shorter`. Files that a page names are given, or are those that it shows.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.site.blocks import blocks
from scripts.site.contents import ROOT, sources
from tests.rigs.processes import free_ports

ELSEWHERE = {
    r"sudo |pip install|python3 -m venv|dask |deactivate": "changes the machine",
    r"(source|\.) \.venv/bin/activate": "the test's own environment is active",
    r"scripts/(demo|test|docs|bench)\b": "has tests of its own, and takes minutes",
    r"vsense run (?!--help|.*--tracker lines)": "needs robots: tests/modes/live, tests/system",
    r"vsense robot (deploy|status|keys --roster|keys --new-key --roster)": "needs robots",
    r"vsense robot init --add": "needs a robot: tests/robots/test_robot_init.py",
    r"vsense robot build": "cross-compiles: tests/robots/test_building.py",
    r"vsense robot keys --forget": "needs two keys: tests/robots",
    r"vsensed |iw |ping ": "runs on a robot",
    r"vsense camera (list|show|tune|init|shoot)|cd lab\b|arv-fake|mkdir cameras": "needs cameras",
    r"python3 -c \"from vsense import Camera": "tests/tools/camera_setup/test_fake_camera.py",
    r"vsense camera calibrate rig": "needs pictures of a board: tests/vision/calibration",
    r"vsense camera arena align": "needs cameras: tests/tools/camera_setup/test_aligning.py",
    r"vsense camera calibrate check": "needs cameras: tests/vision/calibration",
    r"vsense camera calibrate import left": "tests/vision/calibration/test_foreign.py",
    r"vsense camera track lab --ros2": "needs cameras: tests/monitor/ui/test_ros2_publisher.py",
    r"vsense camera track (resources|lab --web)": "needs cameras",
    r"vsense camera node ": "needs a tracker: tests/vision/tracking/test_nodes.py",
    r"vsense replay (?!.*--retrack)": "serves a page until Ctrl-C: tests/monitor/ui",
    r".*--on tcp": "needs a cluster: tests/modes/sim/test_cluster.py",
    r".*(\.\./ARGoS3|--sources \.\.\.|controllers/foo)": "needs another repository",
}
"""Commands that are not run here, by a pattern of their beginning, and why."""


PROGRAMS = Path(os.environ.get("VSENSE_PROGRAMS", Path(sys.executable).parent))
"""Where `vsense` is; the tests of a release have that of an environment with the wheel."""

END = ('[ -z "$emulated" ] || kill -INT "$emulated"', "wait")


def runs_here(command: str) -> bool:
    return not any(re.match(pattern, command) for pattern in ELSEWHERE)


def shorter(command: str, port: int = 4050, lines: int = 4041) -> str:
    """The same command in seconds; `port` is for robots, `lines` for their emulated tracker."""
    command = re.sub(r"--runs \d+", "--runs 1", command)
    command = re.sub(r"--seeds 1-\d+", "--seeds 1-1", command)
    command = re.sub(r"--(?:duration|frames) \d+", "", command.partition(" # ")[0])
    if re.match(r"vsense (sim|lab|run .*--tracker lines) ", command) and "--dry" not in command:
        command += " --duration 2"
    if command.startswith("vsense lab "):
        command += " --port 0"
    if command.startswith("vsense series ") and "--mode lab" in command:
        command += " --dry"
    if "--tracker lines" in command:
        command = command.replace("--tracker lines", f"--tracker lines:{lines} --port {port}")
    if command.startswith("vsense robot emulate "):  # the reader has another terminal for it
        command += f" --port {port} --tracker-port {lines} >/dev/null 2>&1 & emulated=$!"
    if command.startswith("vsense camera render "):
        command += " --frames 5"
    return command


PAGES = [page for page in sources() if page != "CHANGELOG.md"]


def commands(page: str) -> list[str]:
    found = [c for block in blocks((ROOT / page).read_text()) for c in block.commands()]
    return [" ".join(command.split()) for command in found]


RUNNABLE = [page for page in PAGES if any(runs_here(command) for command in commands(page))]


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with pictures, as readers of the pages have one."""
    folder = tmp_path_factory.mktemp("recording") / "run"
    lab = "lab pollutant --robots 3 --duration 3 --pace 0.2 --port 0 --record --record-images"
    command = [PROGRAMS / "vsense", *lab.split(), "--output", folder]
    subprocess.run(command, cwd=folder.parent, check=True, capture_output=True, timeout=300)
    return folder / "pollutant.mcap"


def give(folder: Path, page: str, recording: Path) -> None:
    """Puts what a page takes for granted into a folder."""
    for name in ("run.mcap", "run-1/run.mcap", "run-2/run.mcap", "sighted/a.mcap", "blind/b.mcap"):
        (folder / name).parent.mkdir(exist_ok=True)
        if page in ("vsense/monitor/recording/README.md", "vsense/studies/report/README.md"):
            os.link(recording, folder / name)
    (folder / "ieee.mplstyle").write_text("font.size: 8\n")
    shipped = ROOT / "vsense" / "config" / "experiments" / "phototaxis.argos"
    for name in ("mine", "my_experiment"):
        shutil.copy(shipped, folder / f"{name}.argos")
    shutil.copy(shipped.with_suffix(".py"), folder / "phototaxis.py")
    shutil.copy(ROOT / "tests" / "data" / "four-cameras" / "camera_array.toml", folder)
    photos = ROOT / "tests" / "data" / "wall-tags" / "photos"
    photo = min(photos.glob("*.jp*g"))
    (folder / "more_photos").mkdir()
    for copy in (folder / "photo.jpg", folder / "more_photos" / "other.jpg"):
        shutil.copy(photo, copy)
    own = folder / ("given" if "vsense new" in (ROOT / page).read_text() else "mine")
    own.mkdir()
    sensor = blocks((ROOT / "vsense" / "world" / "sensors" / "README.md").read_text())
    for block in (block for block in sensor if block.file):
        (folder / block.file).write_text(block.text)
        (own / block.file).write_text(block.text)


@pytest.mark.campaign
@pytest.mark.parametrize("page", RUNNABLE)
def test_commands_of_a_page_run(page: str, tmp_path: Path, recording: Path) -> None:
    give(tmp_path, page, recording)
    ports = free_ports(2)
    lines = [shorter(command, *ports) for command in commands(page) if runs_here(command)]
    script = tmp_path / "page.sh"
    trap = "trap 'echo \"failed: $BASH_COMMAND\" >&2' ERR"
    script.write_text("\n".join(["set -eEu", trap, 'emulated=""', *lines, *END]) + "\n")
    path = f"{PROGRAMS}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "HOME": str(tmp_path), "XDG_CONFIG_HOME": ""}
    done = subprocess.run(
        ["bash", str(script)], cwd=tmp_path, env=environment, capture_output=True, timeout=900
    )
    assert done.returncode == 0, done.stderr.decode()[-2000:]


def test_every_reason_is_needed() -> None:
    every = [command for page in PAGES for command in commands(page)]
    assert len([command for command in every if runs_here(command)]) > 20
    unused = [p for p in ELSEWHERE if not any(re.match(p, command) for command in every)]
    assert unused == []
