"""Runs in the lab and with robots, from Python: the commands, held by whoever has started them."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import vsense
from tests.rigs.processes import is_alive
from tests.system.rehearsal import emulated
from vsense import cli
from vsense.base.clock import host_ns
from vsense.base.errors import CutShort
from vsense.modes.lab import _report
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.run.runs_csv import RUNS, read_runs

OWNER = """
import sys, time, vsense
lab = vsense.load("foraging", robots=3).lab(seed=1, output=sys.argv[1], duration=60)
while lab.status["run"]["time_s"] < 1.0:
    time.sleep(0.05)
print(lab.status["process"], flush=True)
time.sleep(60)
"""


def test_the_lab_is_held_by_a_block(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    phototaxis = vsense.load("phototaxis", {"light.intensity": 3}, robots=3, duration_s=3)
    with phototaxis.lab(seed=5, output=tmp_path / "run", web="127.0.0.1:0", hold=True) as lab:
        assert lab.page is not None and lab.page.startswith("http://127.0.0.1:")
        while lab.status["run"]["state"] != "ready":
            time.sleep(0.05)
        assert "starts" in lab.order("start")
        with pytest.raises(vsense.VsenseError, match=r"it goes on after 0\.2 s"):
            lab.wait(0.2)
        while lab.status["run"]["state"] != "ended":
            time.sleep(0.05)
        with pytest.raises(vsense.VsenseError, match="pause"):
            lab.order("pause")
    assert not lab.goes_on
    with pytest.raises(vsense.VsenseError, match="vsense lab phototaxis has ended"):
        lab.order("stop")
    run = lab.wait()
    assert run.valid and run.poses.shape == (30, 3, 3) and run.summary["seed"] == 5
    assert tuple(run.tags.tolist()) == lab.table.rows[0].tags
    assert np.isfinite(run.poses).all() and run.time_s[-1] == pytest.approx(2.9)
    moved_m = np.hypot(*(run.poses[-1] - run.poses[0])[:, :2].T)
    assert (moved_m > 0.05).any() and run.measured["light_distance_m"].shape == (30,)
    assert ("".join(text for _, text in run.events)).startswith("completing the recording")
    # A lab that is ended while it completes a run has no time for the picture, and says so.
    drawn = any("picture: " in line for line in lab.said)
    assert ("image/png;base64,iVBOR" in run._repr_html_()) == drawn and capsys.readouterr() == (
        "",
        "",
    )


def test_a_lab_that_has_no_time_to_draw_has_written_its_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(*arguments: object) -> None:
        raise CutShort(143)

    monkeypatch.setattr(_report, "draw", draw)
    words = ["lab", "phototaxis", "--robots", "2", "--duration", "1", "--pace", "0.5"]
    assert cli.main([*words, "--port", "0", "-o", str(tmp_path / "run")]) == 143
    assert [row.robots for row in read_runs(tmp_path / "run" / RUNS)] == [2]


def test_robots_are_driven_and_what_goes_wrong_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    foraging = vsense.load("foraging", robots=2, duration_s=2)
    with emulated(tmp_path) as stage:
        options = {"tracker": f"lines:{stage.lines}", "port": stage.port, "insecure": True}
        with foraging.run(1, tmp_path / "run", progress=True, **options) as robots:
            run = robots.wait()
    assert run.valid and run.poses.shape == (20, 2, 3) and list(run.measures)
    assert "verdict   valid" in capsys.readouterr().err
    with pytest.raises(vsense.VsenseError, match=r"--durations 3 \(is '--duration' meant\?\)"):
        foraging.lab(durations=3)
    with pytest.raises(vsense.VsenseError, match="run is not empty"):
        foraging.lab(output=tmp_path / "run")


def test_a_lab_ends_in_order_when_its_owner_is_killed(tmp_path: Path) -> None:
    owner = [sys.executable, "-c", OWNER, str(tmp_path / "run")]
    with subprocess.Popen(owner, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lab = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
        killed_ns = host_ns()
    while is_alive(lab):
        time.sleep(0.05)
    rows = read_actuations(tmp_path / "run" / "actuations.bin")
    turns = (rows["left_steps_s"] != 0) | (rows["right_steps_s"] != 0)
    for robot in range(3):
        own = rows["robot"] == robot
        assert turns[own].any() and not turns[own][-1]
        assert rows["time_ns"][own & turns].max() < killed_ns + 1_000_000_000
    (row,) = read_runs(tmp_path / "run" / RUNS)
    assert row.verdict == "void" and "interrupted" in row.why
    with vsense.open_recording(tmp_path / "run" / "foraging.mcap") as recording:
        assert recording.complete
