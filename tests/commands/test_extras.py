"""What needs an extra says so, with how to install it, before a process or a file is made."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rigs.places import DATA
from vsense.base.errors import EXTRAS
from vsense.base.xml.parsing import NAMESPACE

MADE = DATA / "made-by-0.1"
CAMERAS = "resources.xml experiment.xml"
RECORDING, RUN = f"{MADE}/tracked/small.mcap", f"{MADE}/lab-run"
REAL = "run foraging --tracker lines --port 0"
LAB = "series plan.toml --mode lab --port 0"
CHECK = "robot check foraging --lab"
WATCHED = (f"{LAB}", "benchmark --quick --mode lab", "lab foraging", REAL, f"track {CAMERAS}")
"""Commands that people look at in a browser or in Foxglove."""

NEEDS = {
    "aiohttp": (
        *(f"{words} --web 0" for words in (*WATCHED, CHECK, "robot calibrate foraging --lab")),
        *("sim foraging --web 0", f"replay {RECORDING} --web 0", "cameras show nothing --web 0"),
    ),
    "cryptography": tuple(
        f"{words} --web 0.0.0.0:0" for words in (*WATCHED, CHECK, "sim foraging")
    ),
    "cyclonedds": (
        *("lab foraging --ros2", f"{REAL} --ros2 7", f"track {CAMERAS} --ros2"),
        f"replay {RECORDING} --web 0 --ros2",
    ),
    "foxglove": (
        *(f"{words} --foxglove 0" for words in WATCHED),
        *(f"{words} --web 0 --foxglove 0" for words in ("sim foraging", f"replay {RECORDING}")),
    ),
    "mcap": (
        *("lab foraging --record", "lab foraging --record-images", f"{REAL} --record"),
        *("sim foraging --record", "sim foraging --runs 2 --record", f"track {CAMERAS} --record"),
        *("series plan.toml --record", f"{LAB} --record-images", "benchmark --quick"),
        *(f"replay {RECORDING}", f"export {RECORDING}", f"report {RECORDING}", f"pack {RUN}"),
        *("reproduce run.zip -o again", f"benchmark check {MADE}/benchmark"),
    ),
    "zstandard": (f"replay {RECORDING}", "sim foraging --record"),
    "matplotlib": (
        *("sim foraging --runs 2 --style ggplot", "sim foraging --runs 2 --format svg"),
        *(f"report {RUN} --style ggplot", f"report {RUN} --format pdf"),
    ),
    "scipy": (f"report {RUN} --same x=1", f"pack {RUN} --same x=1 -o new.zip"),
    "distributed": (
        *(
            "sim foraging --runs 2 --on tcp://127.0.0.1:9",
            "series plan.toml --on tcp://127.0.0.1:9",
            "compare foraging foraging --maximize items_home --on tcp://127.0.0.1:9",
        ),
    ),
    "argcomplete": ("completion bash",),
    "lupa": ("sim lua.argos", "lab lua.argos --port 0", "run lua.argos --tracker lines --port 0"),
    "motioncapture": ("run mocap.argos --port 0",),
    "optuna": ("optimize foraging --vary foraging.release=0..1 --maximize items_home",),
    "zenoh": ("camera node resources.xml --connect tcp/127.0.0.1:7447",),
    "pyarrow": (f"export {RECORDING} --parquet",),
    "rosbags": (f"export {RECORDING} --rosbag bag",),
    "ziglang": (
        *(
            "robot build --controller foraging --target epuck",
            "robot build --experiment foraging --target pi-puck",
        ),
        *("robot deploy --tags 31 --controller foraging",),
        "series two.toml --tracker lines --insecure --port 0 --roster robots.toml",
    ),
}
"""By package: commands that need it."""

WITHOUT = """
import contextlib, importlib.machinery, io, json, os, sys
package, lines = json.loads(sys.argv[1])
find = importlib.machinery.PathFinder.find_spec
def find_spec(name, path=None, target=None):
    return None if name.partition(".")[0] == package else find(name, path, target)
importlib.machinery.PathFinder.find_spec = find_spec
started = []
def note(event, arguments):
    if event in ("subprocess.Popen", "os.fork", "os.posix_spawn", "os.exec"):
        started.append(str(arguments[:2]))
sys.addaudithook(note)
os.environ["PATH"] = ""  # no cross compiler of Debian's
from vsense import cli
def files():
    return {os.path.join(root, name) for root, _, names in os.walk("..") for name in names}
for line in lines:
    before, said = files(), io.StringIO()
    del started[:]
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        code = cli.main(line.split())
    answer = [line, code, said.getvalue(), started[:], sorted(files() - before)]
    print(json.dumps(answer), flush=True)
"""

PLAN = """
experiment = "foraging"
duration_s = 1
robots.count = 2
[[condition]]
name = "sighted"
[[start]]
name = "drawn"
seed = 7
"""


CONTROLLERS = """
[[condition]]
name = "other"
controller = "pollutant"
"""

SCRIPT = """<argos-configuration>
<framework><experiment length="1" ticks_per_second="10" random_seed="7" /></framework>
<controllers><lua_controller id="a"><actuators /><sensors /><params script="a.lua" />
</lua_controller></controllers>
<arena size="3, 3, 1"><e-puck id="e1"><body position="0,0,0" orientation="0,0,0" />
<controller config="a" /></e-puck></arena></argos-configuration>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty home, and in it the folder where commands are called."""
    here = tmp_path / "here"
    here.mkdir()
    (here / "plan.toml").write_text(f'mode = "sim"\n{PLAN}')
    (here / "lua.argos").write_text(SCRIPT)
    (here / "a.lua").write_text("function init() end function step() end")
    (here / "two.toml").write_text(f'mode = "run"\n{PLAN}{CONTROLLERS}')
    mocap = '<vs:tracker format="mocap" type="mock" /></framework>'
    script = SCRIPT.replace("</framework>", mocap)
    script = script.replace("configuration>", f'configuration xmlns:vs="{NAMESPACE}">', 1)
    (here / "mocap.argos").write_text(script)
    (here / "run.zip").symlink_to(MADE / "kept.zip")
    (here / "robots.toml").symlink_to(MADE / "robots.toml")
    return here


def answers_of(package: str, folder: Path) -> list[tuple[str, int, str, list[str], list[str]]]:
    """Each command's line, exit code and words, and what it has started and written."""
    place = dict.fromkeys(("HOME", *(f"XDG_{n}_HOME" for n in ("CACHE", "CONFIG"))), folder.parent)
    environment = {**os.environ, **place, "XDG_RUNTIME_DIR": folder.parent, "VSENSE_LAB": ""}
    command = [sys.executable, "-c", WITHOUT, json.dumps([package, NEEDS[package]])]
    ran = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=100
    )
    answers = [json.loads(line) for line in ran.stdout.splitlines()]
    assert [line for line, *_ in answers] == list(NEEDS[package]), ran.stderr
    return answers


@pytest.mark.parametrize("package", NEEDS)
def test_what_needs_an_extra_says_so_before_anything_starts(package: str, folder: Path) -> None:
    wanted = re.compile(rf"vsense: .*: .*pip install .*{package}")
    wrong = [
        answer
        for answer in answers_of(package, folder)
        if answer[1] != 2 or not wanted.search(answer[2]) or answer[3:] != [[], []]
    ]
    assert wrong == []


def test_every_extra_is_tried() -> None:
    # see tests/studies, and what robot/drivers/thymio.py says
    from_python = {"anywidget", "pandas", "pettingzoo"}
    from_python |= {"serial", "thymiodirect"}
    assert set(NEEDS) == set(EXTRAS) - from_python
