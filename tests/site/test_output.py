"""Every file that a run leaves is on the page, with its members, and the page's code reads it."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.site.blocks import blocks
from scripts.site.contents import ROOT
from tests.rigs.processes import free_ports
from vsense.cli import main
from vsense.run.runs_csv import COLUMNS

TEXT = (ROOT / "vsense" / "run" / "OUTPUT.md").read_text()
ROW = re.compile(r"^\| (`[^|]+) \|", re.MULTILINE)
FILES = {name for cell in ROW.findall(TEXT) for name in re.findall(r"`([^`]+)`", cell)}
"""All that stands in the first column of a table."""


def told(path: str, experiment: str) -> str:
    """A file's name as the page writes it."""
    name = re.sub(rf"^(run-\d+/)?{experiment}\.", r"\1EXPERIMENT.", path)
    name = re.sub(r"^(run-\d+/)?robots/\d+\.", r"\1robots/TAG.", name)
    return re.sub(r"^run-\d+/", "", name)


def lacking(folder: Path, experiment: str) -> set[str]:
    """The files below a folder that the page does not have."""
    files = [str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()]
    assert len(files) >= 4
    return {name for name in (told(file, experiment) for file in files) if name not in FILES}


def undescribed(summary: Path) -> set[str]:
    """Members of a run's figures that the page does not have."""
    return json.loads(summary.read_text()).keys() - FILES


def vsense(folder: Path, words: str) -> None:
    """Runs a command in a folder."""
    command = [sys.executable, "-m", "vsense", *words.split()]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=120)


def test_files_and_figures_of_a_simulation(tmp_path: Path) -> None:
    assert main(["sim", "foraging", "--duration", "1", "-o", str(tmp_path / "first")]) == 0
    assert lacking(tmp_path / "first", "foraging") == set()
    assert undescribed(tmp_path / "first" / "summary.json") == set()


@pytest.mark.campaign
def test_a_campaigns_table_and_the_pages_python(tmp_path: Path) -> None:
    vsense(tmp_path, "sim foraging --duration 1 -o first")
    sweep = "--runs 1 --set foraging.release=0,1 --duration 1 -o release.csv"
    vsense(tmp_path, f"sim foraging {sweep}")
    assert {p.name for p in tmp_path.iterdir()} == {
        *("first", "release.csv", "release.png", "release-made.zip")
    }
    columns = (tmp_path / "release.csv").read_text().partition("\n")[0].split(",")
    assert columns == [*COLUMNS, "items_home", "robots_carrying"]
    assert {*COLUMNS} <= FILES
    parts = [b.text for b in blocks(TEXT) if b.language == "python" and "recorded/" not in b.text]
    assert len(parts) == 3
    code = [sys.executable, "-c", "\n".join(parts)]
    done = subprocess.run(code, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "items_home" in done.stdout and "31: " in done.stdout


def test_what_is_not_described_is_found(tmp_path: Path) -> None:
    for name in ("summary.json", "x.png", "new.bin", "robots/7.log", "robots/7.dump"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("{}")
    assert lacking(tmp_path, "x") == {"new.bin", "robots/TAG.dump"}


@pytest.mark.campaign
def test_files_and_figures_of_a_run(tmp_path: Path) -> None:
    """Of a rehearsed one, and of who stands in for its robots."""
    port, lines = free_ports(2)
    robots = f"robot emulate 2 --insecure --port {port} --tracker-port {lines} -o robots"
    words = f"run foraging --tracker lines:{lines} --port {port} --robots 2 --insecure --record"
    with subprocess.Popen(
        [sys.executable, "-m", "vsense", *robots.split()],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as emulated:
        try:
            vsense(tmp_path, f"{words} --duration 2 -o one")
            vsense(tmp_path, f"{words} --duration 1 --runs 2 -o series")
        finally:
            emulated.send_signal(signal.SIGINT)
    for folder in ("robots", "one", "series"):
        assert lacking(tmp_path / folder, "foraging") == set()
    assert undescribed(tmp_path / "one" / "summary.json") == set()
    assert (tmp_path / "series" / "run-2" / "timesteps.csv").exists()


@pytest.mark.campaign
def test_files_and_figures_of_a_lab(tmp_path: Path) -> None:
    lab = "lab foraging --robots 2 --port 0 --duration 2 --record"
    vsense(tmp_path, f"{lab} --runs 2 -o series")
    assert lacking(tmp_path / "series", "foraging") == set()
    assert (tmp_path / "series" / "series.json").exists()
    vsense(tmp_path, f"{lab} -o recorded")
    assert lacking(tmp_path / "recorded", "foraging") == set()
    assert undescribed(tmp_path / "recorded" / "summary.json") == set()
    (code,) = (b.text for b in blocks(TEXT) if "recorded/" in b.text and b.language == "python")
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, timeout=60)
