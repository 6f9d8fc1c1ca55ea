"""`vsense track` with four GigE Vision cameras at once: with our pictures, and Debian's own."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import require_tool
from tests.gige.conftest import ROBOTS
from tests.gige.network import CAMERAS, RATE_HZ, SIZE, SIZE_PX, GigeCameras

pytestmark = pytest.mark.system

MOST = "300"
"""Timesteps after which the program ends by itself: what has not come by then does not come."""
SETTINGS: dict[str, Any] = {**SIZE, "exposure_time_abs": 8000}


@contextmanager
def tracked(files: Sequence[str], *before: str) -> Iterator[subprocess.Popen[str]]:
    """Has the program at work, as the words before it will; ends it with Ctrl-C."""
    command = [*before, sys.executable, "-m", "vsense", "track", *files, "--frames", MOST]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)


def states(process: subprocess.Popen[str]) -> Iterator[dict[str, Any]]:
    """The arena states that it prints."""
    assert process.stdout is not None
    return map(json.loads, process.stdout)


def talk(process: subprocess.Popen[str]) -> str:
    """What it has said, once it is over."""
    assert process.stdout is not None and process.stderr is not None
    process.stdout.read()
    said = process.stderr.read()
    process.wait()
    return said


def test_all_robots_are_found_and_what_a_camera_makes_of_its_settings_is_told(
    rig: GigeCameras, tmp_path: Path
) -> None:
    rig.start()
    features = {"BlackLevelRaw": "3", "GainAuto": "Continuous", "BinningHorizontal": "2"}
    settings = SETTINGS | {"exposure_time_abs": 8000.4, "gain_raw": 99}
    with tracked(rig.files(tmp_path, settings, features)) as process:
        all_seen = (s for s in states(process) if sum(r["seen"] for r in s["robots"]) == 4)
        where = {r["tag"]: (r["x_m"], r["y_m"]) for r in next(all_seen)["robots"]}
        registers = [rig.registers(n) for n in range(len(CAMERAS))]
        process.send_signal(signal.SIGINT)
        said = talk(process)
    for robot in ROBOTS:
        assert where[robot.tag] == pytest.approx((robot.x_m, robot.y_m), abs=0.003)
    for camera, values in zip(CAMERAS, registers):
        assert values["exposure_us"] == 8000 and values["gain_raw"] == 0
        assert values["gain_auto"] == 2 and values["binning_horizontal"] == 2
        assert (values["width"], values["height"]) == SIZE_PX
        assert values["period_us"] == 1_000_000 // RATE_HZ
        name = f"vsense: camera {camera.id}:"
        assert f"{name} takes 8000 for exposure_time_abs 8000.4\n" in said
        assert f"{name} does not take gain_raw 99 (0 to 10): keeps 0\n" in said
        assert f"{name} has no BlackLevelRaw\n" in said
    assert process.returncode == 130
    assert [rig.registers(n)["controlled"] for n in range(len(CAMERAS))] == [0, 0, 0, 0]


def test_a_user_without_rights_on_the_network_gets_whole_pictures_too(
    rig: GigeCameras, tmp_path: Path
) -> None:
    """The packets of a picture wait in the system's memory, which usually holds less than one."""
    most_bytes = int(Path("/proc/sys/net/core/rmem_max").read_text())
    if most_bytes < 2 * SIZE_PX[0] * SIZE_PX[1]:
        pytest.skip(f"needs two pictures of memory, net.core.rmem_max is {most_bytes}")
    rig.start()
    setpriv = require_tool("setpriv", "util-linux")
    user = [setpriv, "--bounding-set", "-net_raw", "--inh-caps", "-net_raw"]
    with tracked(rig.files(tmp_path, SETTINGS), *user) as process:
        full = (s for s in states(process) if sum(r["seen"] for r in s["robots"]) == 4)
        assert len([state for state, _ in zip(full, range(2 * RATE_HZ))]) == 2 * RATE_HZ
        process.send_signal(signal.SIGINT)
        said = talk(process)
    assert "lacks packets" not in said


def test_the_simulator_as_debian_has_it_shows_its_ramp(rig: GigeCameras, tmp_path: Path) -> None:
    rig.start_plain()
    files = rig.files(tmp_path, SETTINGS | {"gain_raw": 7})
    with tracked(files) as process:
        found = [state for state, _ in zip(states(process), range(2 * RATE_HZ))]
        registers = [rig.registers(n) for n in range(len(CAMERAS))]
        process.send_signal(signal.SIGINT)
        said = talk(process)
    assert all(state["robots"] == [] for state in found)
    for values in registers:
        assert (values["exposure_us"], values["gain_raw"]) == (8000, 7)
        assert (values["width"], values["height"]) == SIZE_PX
    assert process.returncode == 130
    assert "is gone" not in said and "damaged" not in said


def test_a_program_that_died_gets_its_cameras_back_when_it_is_started_again(
    rig: GigeCameras, tmp_path: Path
) -> None:
    rig.start()
    files = rig.files(tmp_path, SETTINGS)
    with tracked(files) as first:
        next(state for state in states(first) if len(state["robots"]) == len(CAMERAS))
        first.kill()
    with tracked(files) as second:
        next(state for state in states(second) if len(state["robots"]) == len(CAMERAS))
        second.send_signal(signal.SIGINT)
        said = talk(second)
    for camera in CAMERAS:
        assert f"camera {camera.id}: is gone: another program controls it" in said
        assert f"camera {camera.id}: is back" in said
