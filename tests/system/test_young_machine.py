"""What reads a clock, on a machine that was started a minute ago: in a time namespace of its own.

There the clocks of emulated robots, off by up to an hour, are before their zero and wrap around
2^64. What a machine of long standing shows, `tests/` shows everywhere else.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import machine_up_for
from tests.system.rehearsal import VSENSE, emulated

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
UPTIME_S = 60
YOUNG_S = 600
"""Long enough for any machine that runs the tests, and far below the robots' hour."""

CLOCK_READERS = (
    *(f"tests/robots/link/test_{name}.py" for name in ("meter", "network", "server", "faults")),
    *("tests/vision/cameras/test_grabbers_live.py", "tests/modes/live/test_sources.py"),
)
"""Links, cameras and trackers."""


def run(*words: str) -> subprocess.CompletedProcess[str]:
    """Runs Python on the young machine; its tests are no part of this session's workers."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    command = [*machine_up_for(UPTIME_S), sys.executable, *words]
    return subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=300)


def test_the_hosts_clock_is_young_there() -> None:
    told = run("-c", "from vsense.base.clock import host_ns; print(host_ns())")
    assert 0 < int(told.stdout) < YOUNG_S * 10**9, told.stderr


def test_what_reads_a_clock_works_there(tmp_path: Path) -> None:
    places = ("-p", "no:cacheprovider", "--basetemp", str(tmp_path / "young"))
    done = run("-m", "pytest", *places, *CLOCK_READERS)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_run_is_rehearsed_there_and_its_recording_opens_everywhere(tmp_path: Path) -> None:
    with emulated(tmp_path, machine_up_for(UPTIME_S)) as stage:
        measured = stage.link(1.0)
        words = ("--duration", "2", "--json", "--record", "-o", str(tmp_path / "run"))
        done = stage.run(*words)
    robots = json.loads(measured.stdout)["robots"]
    assert all(one["packets"] > 5 and one["round_trip_p50_ms"] > 0.0 for one in robots)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["link"]["defects"], summary["link"]["reconnects"]) == (0, 0)
    assert [robot["connected_share"] for robot in summary["per_robot"]] == [1.0, 1.0]
    (recording,) = (tmp_path / "run").glob("*.mcap")
    report = (*VSENSE, "report", str(recording), "-o", str(tmp_path / "report"))
    opened = subprocess.run(report, capture_output=True, text=True)
    assert opened.returncode == 0, opened.stderr
    assert (tmp_path / "report").exists()
