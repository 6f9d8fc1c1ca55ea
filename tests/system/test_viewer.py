"""The Viewer: `vsense camera track` with runs that orders begin, suspend and end, and record."""

from __future__ import annotations

import json
import os
import pwd
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.recording import make_recording
from tests.system.viewer import Viewer
from vsense.cli import main
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ui.control_client import TerminalError
from vsense.studies.report._findings import read_findings

pytestmark = pytest.mark.system

BY = f"{pwd.getpwuid(os.getuid()).pw_name} (terminal)"
"""Who gives orders: the system says it, not who asks."""

PICTURES = 80


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a resources file of one grabber and one camera; nobody wrote the other one."""
    folder = tmp_path_factory.mktemp("arena")
    make_recording(folder, PICTURES, 0.002)
    (folder / "experiment.xml").unlink()
    return folder


@pytest.fixture
def viewer(pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Viewer]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "sockets"))
    words = ["track", str(pictures), "--hold", "--record-images", "--web", "0"]
    made = Viewer([*words, "-o", "out"], tmp_path / "states.jsonl", tmp_path)
    yield made
    made.process.kill()
    made.process.wait()


def test_runs_are_begun_suspended_ended_recorded_and_tracked_again(
    viewer: Viewer, pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ready = viewer.until(lambda run: run["state"] == "ready" and run["rate_hz"] > 0.0)
    assert ready["name"] == pictures.name and sorted(ready["robots"]["tag"]) == [31, 1843]
    assert set(ready["run"]["can"]) == {"start", "record"} and not ready["run"]["recording"]["on"]
    with pytest.raises(TerminalError, match="moves no robot and can stop none"):
        viewer.order("emergency")
    assert not viewer.printed(), "what belongs to no run is only looked at"
    assert viewer.order("start") == "run 1 starts"
    first = tmp_path / "out" / "run-1" / f"{pictures.name}.mcap"
    running = viewer.until(lambda run: run["timestep"] >= 5)
    assert running["run"]["recording"]["on"] and running["run"]["recording"]["file"] == str(first)
    viewer.order("pause")
    paused = viewer.until(lambda run: run["state"] == "paused" and not run["recording"]["on"])
    stood = viewer.until(lambda run: run["timestep"] == paused["run"]["timestep"])
    count = len(viewer.printed())
    viewer.until(lambda run: run["by"] == BY and run["silent_s"] < 1.0)
    assert len(viewer.printed()) == count == stood["run"]["timestep"] + 1
    viewer.order("start")
    viewer.until(lambda run: run["timestep"] >= count + 4)
    assert viewer.order("stop") == "run 1 is stopped"
    viewer.until(lambda run: run["state"] == "ended")
    assert viewer.order("start") == "run 2 begins"
    again = viewer.until(lambda run: run["run"] == 2 and run["timestep"] >= 1)
    assert again["run"]["timestep"] < PICTURES / 2, "a run plays the recording from its beginning"
    said = viewer.end()
    assert f"recording to {first}" in said and f"\nrecording: {first}, " in said
    _look_at(viewer, tmp_path / "out", first)
    assert main(["replay", str(first), "--retrack", "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)
    assert compared["equal"] == compared["timesteps"] >= count + 4


def _look_at(viewer: Viewer, out: Path, first: Path) -> None:
    """What is left: figures of both runs, and a recording that says what it lacks."""
    runs = json.loads((out / "series.json").read_text())["runs"]
    assert [run["ended"] for run in runs] == [f"stopped by {BY}", "interrupted"]
    assert sum(run["timesteps"] for run in runs) == len(viewer.printed())
    assert json.loads((out / "run-1" / "summary.json").read_text()) == runs[0]
    assert runs[0]["recording"]["bytes"] == first.stat().st_size
    assert runs[0]["robots"] == {"31": 1.0, "1843": 1.0}
    recorded = open_recording(first)
    assert [gap.why for gap in recorded.gaps] == ["recording was switched off"]
    findings = read_findings(first)
    assert findings.gathered.ran and findings.gathered.flow.lived == runs[0]["timesteps"]
    assert findings.only_tracked.startswith("robots were only tracked (vsense camera track): no ")
    assert "no readings (/readings)" in findings.only_tracked


def test_what_does_not_go_together_is_refused(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", str(pictures), "--offline", "--record"]) == 2
    assert "--offline tracks as fast as it can" in capsys.readouterr().err
    (tmp_path / "full").write_text("")
    assert main(["track", str(pictures), "--record", "-o", str(tmp_path)]) == 2
    assert f"{tmp_path} is not empty" in capsys.readouterr().err


def test_figures_in_the_place_of_states(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["track", str(pictures), "--offline", "--frames", "6", "--json"]
    assert main([*words, "-o", str(tmp_path / "kept")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["timesteps"] == 6 and told["ended"] == "all timesteps are done"
    assert told["time_s"] == pytest.approx(0.25) and told["rate_hz"] == pytest.approx(20.0)
    assert told["detected_per_timestep"] == 2.0 and told["recording"]["file"] is None
    assert json.loads((tmp_path / "kept" / "summary.json").read_text()) == told
