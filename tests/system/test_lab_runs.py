"""Several runs of a whole lab: what is there of those that are over when it is killed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.rigs.processes import PATIENCE_S, Lab

pytestmark = pytest.mark.system


def test_a_killed_lab_has_lost_the_run_that_went_on_and_no_other(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    words = ("--port", "0", "--robots", "2", "--runs", "2", "--duration", "3")
    lab = Lab(folder, "pollutant", *words)
    lab.wait_for("logs in .*run-2")
    lab.process.kill()
    lab.process.wait(PATIENCE_S)
    summary = json.loads((folder / "run-1" / "summary.json").read_text())
    assert summary["timesteps"] > 0 and (folder / "run-1" / "pollutant.png").is_file()
    assert json.loads((folder / "series.json").read_text())["runs"] == [summary]
    (row,) = (folder / "runs.csv").read_text().splitlines()[1:]
    assert row.startswith("run-1,")
