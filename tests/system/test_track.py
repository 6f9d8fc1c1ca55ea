"""`vsense camera track` on cameras: pictures over the network, a camera that dies, Ctrl-C."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.cameras import NetworkCameras
from tests.system.viewer import Viewer
from tests.vision.tracking.synthetic import Robot
from vsense.cli import main

ROBOTS = [Robot(700, -0.1, 0.1, 0.5), Robot(52447, 0.1, -0.1, -2.0), Robot(31, 0.4, 0.2, 1.0)]


@pytest.fixture
def network() -> Iterator[NetworkCameras]:
    cameras = NetworkCameras(ROBOTS)
    yield cameras
    cameras.close()


@pytest.fixture
def files(network: NetworkCameras, tmp_path: Path) -> list[str]:
    """The two files of a session with both cameras."""
    return [*network.files(tmp_path)]


@pytest.mark.system
def test_a_camera_that_dies_is_told_and_the_rest_goes_on_until_ctrl_c(
    network: NetworkCameras, files: list[str]
) -> None:
    command = [sys.executable, "-m", "vsense", "track", *files]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        both = next(s for s in map(json.loads, process.stdout) if len(s["robots"]) == 3)
        where = {robot["tag"]: (robot["x_m"], robot["y_m"]) for robot in both["robots"]}
        for robot in ROBOTS:
            assert where[robot.tag] == pytest.approx((robot.x_m, robot.y_m), abs=0.003)
        network.off.add("b")
        alone = next(
            s for s in map(json.loads, process.stdout)
            if {r["tag"]: r["seen"] for r in s["robots"]}.get(31) is False
        )  # fmt: skip
        assert {r["tag"] for r in alone["robots"] if r["seen"]} == {700, 52447}
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        talk = process.stderr.read()
    assert process.returncode == 130
    assert re.search("vsense: camera b: is gone: .*; trying again every", talk)
    assert "robots detected per timestep" in talk


@pytest.mark.quick
def test_cameras_cannot_be_tracked_offline(
    files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", *files, "--offline"]) == 2
    assert "uses cameras, expected recordings" in capsys.readouterr().err


@pytest.mark.quick
def test_a_snapshot_of_nothing_and_one_that_cannot_be_written_are_told(
    files: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["track", *files, "--frames", "0", "--snapshot", str(tmp_path / "s.png")]) == 1
    assert "not drawn, because there was no picture" in capsys.readouterr().err
    place = str(tmp_path / "nowhere" / "s.png")
    assert main(["track", *files, "--frames", "1", "--snapshot", place]) == 1
    assert "s.png: cannot be written: No such file" in capsys.readouterr().err


@pytest.mark.system
def test_cameras_stay_for_the_next_run_and_are_recorded_where_somebody_asks(
    files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "sockets"))
    text = Path(files[1]).read_text().replace('record_image="false"', 'record_image="true"')
    Path(files[1]).write_text(text)
    viewer = Viewer(["track", *files, "--web", "0"], tmp_path / "states.jsonl", tmp_path)
    begun = viewer.until(lambda run: run["state"] == "running" and run["timestep"] >= 3)
    made = begun["run"]["recording"]
    assert made["on"] and Path(made["file"]).parent == tmp_path / "recordings", "the file's wish"
    assert viewer.order("record") == "pictures are not kept any more"
    viewer.until(lambda run: not run["recording"]["on"])
    viewer.order("stop")
    ended = viewer.until(lambda run: run["state"] == "ended" and run["timestep"] >= 3)
    assert sorted(ended["robots"]["tag"]) == [31, 700, 52447], "cameras are looked through on"
    count = len(viewer.printed())
    assert viewer.order("start") == "run 2 begins"
    viewer.until(lambda run: run["run"] == 2 and run["timestep"] >= 3)
    said = viewer.end()
    assert len(viewer.printed()) > count
    assert f"vsense: recording into {made['file']}" in said and f"recording: {made['file']}" in said
    assert not (tmp_path / "runs").exists(), "nobody asked for an MCAP file"
