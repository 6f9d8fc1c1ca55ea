"""A series in the lab, untouched from its start to its end, in which a robot is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.conftest import require_tool
from vsense.config.experiment import load
from vsense.run.directory import TIMESTEPS_CSV
from vsense.run.runs_csv import read_runs

PLAN = """
name = "walks"
mode = "lab"
experiment = "aggregation"
duration_s = 10
[[condition]]
name = "sighted"
[[condition]]
name = "blind"
blind = true
[[start]]
seed = 11
[void]
lost_s = 4.0
[robots]
count = 3
"""
SPARE = 61


def child_of(process: int, words: bytes) -> int:
    """A process that this one has started, with these words in its command."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == process and words in (path / "cmdline").read_bytes():
                return int(path.name)
        except (FileNotFoundError, ProcessLookupError):
            continue
    raise AssertionError(f"no process with {words!r}")


@pytest.mark.campaign
def test_a_killed_robot_costs_one_run_and_a_spare_plays_on(tmp_path: Path) -> None:
    require_tool("cc", "build-essential")
    (tmp_path / "plan.toml").write_text(PLAN)
    vsense = [sys.executable, "-m", "vsense"]
    tags = [robot.tag for robot in load("aggregation").robots[:3]]
    robots = "".join(f"[[robot]]\ntag = {tag}\n" for tag in tags)
    (tmp_path / "robots.toml").write_text(f"{robots}[[robot]]\ntag = {SPARE}\nspare = true\n")
    words = ["series", "plan.toml", "--port", "0", "--roster", "robots.toml", "--json"]
    first = tmp_path / "walks-lab" / "run-001" / TIMESTEPS_CSV
    with subprocess.Popen([*vsense, *words], cwd=tmp_path, stdout=subprocess.PIPE) as process:
        try:
            while not first.exists():
                assert process.poll() is None
                time.sleep(0.1)
            victim = child_of(process.pid, b"\0--tag\0%d\0" % tags[1])
            os.kill(victim, signal.SIGKILL)
            out, _ = process.communicate(timeout=300)
        finally:
            process.kill()
    assert process.returncode == 0
    stands = json.loads(out)
    assert (stands["valid"], stands["complete"]) == (2, True)
    rows = {row.run: row for row in read_runs(tmp_path / "walks-lab" / "runs.csv")}
    assert list(rows) == ["run-001", "run-002", "run-001-2"]
    assert "lost for" in rows["run-001"].why
    assert rows["run-001"].tags == tuple(tags)
    played = (tags[0], SPARE, tags[2])
    assert rows["run-002"].tags == rows["run-001-2"].tags == played
    assert {row.seed for row in rows.values()} == {rows["run-001"].seed}
