"""`vsense camera track` with four GigE Vision cameras at once: our pictures, and Debian's own."""

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
from tests.gige.faults import VICTIM, hold
from tests.gige.network import CAMERAS, MIDDLE, MIDDLES, RATE_HZ, SIZE, SIZE_PX, GigeCameras

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


def heard(process: subprocess.Popen[str], parts: Sequence[str]) -> str:
    """What it says, until it has said all of these."""
    assert process.stderr is not None
    said = ""
    while not all(part in said for part in parts):
        line = process.stderr.readline()
        assert line, said
        said += line
    return said


def full(process: subprocess.Popen[str]) -> Iterator[dict[str, Any]]:
    """The states in which every robot is seen."""
    return (s for s in states(process) if sum(robot["seen"] for robot in s["robots"]) == 4)


def test_what_a_camera_makes_of_its_settings_is_told_and_any_user_gets_whole_pictures(
    rig: GigeCameras, tmp_path: Path
) -> None:
    """Without rights on the network, the packets wait in the little memory that a socket has."""
    rig.start()
    setpriv = require_tool("setpriv", "util-linux")
    user = [setpriv, "--bounding-set", "-net_raw", "--inh-caps", "-net_raw"]
    features = {"BlackLevelRaw": "3", "GainAuto": "Continuous", "BinningHorizontal": "2"}
    settings = MIDDLE | {"exposure_time_abs": 8000.4, "gain_raw": 99}
    with tracked(rig.files(tmp_path, settings, features, MIDDLES), *user) as process:
        found = [state for state, _ in zip(full(process), range(2 * RATE_HZ))]
        registers = [rig.registers(n) for n in range(len(CAMERAS))]
        process.send_signal(signal.SIGINT)
        said = talk(process)
    assert len(found) == 2 * RATE_HZ and "lacks packets" not in said
    where = {robot["tag"]: (robot["x_m"], robot["y_m"]) for robot in found[0]["robots"]}
    for robot in ROBOTS:
        assert where[robot.tag] == pytest.approx((robot.x_m, robot.y_m), abs=0.003)
    for camera, values in zip(CAMERAS, registers):
        assert values["exposure_us"] == 8000 and values["gain_raw"] == 0
        assert values["gain_auto"] == 2 and values["binning_horizontal"] == 2
        assert {name: values[name] for name in MIDDLE} == MIDDLE
        assert values["period_us"] == 1_000_000 // RATE_HZ
        name = f"vsense: camera {camera.id}:"
        assert f"{name} takes 8000 for exposure_time_abs 8000.4\n" in said
        assert f"{name} does not take gain_raw 99 (0 to 10): keeps 0\n" in said
        assert f"{name} has no BlackLevelRaw\n" in said
    assert process.returncode == 130
    assert [rig.registers(n)["controlled"] for n in range(len(CAMERAS))] == [0, 0, 0, 0]


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


def test_cameras_that_others_hold_come_when_released_and_those_of_a_dead_program_by_themselves(
    rig: GigeCameras, tmp_path: Path
) -> None:
    """One program dies; another one holds a camera all the time and goes on living."""
    rig.start()
    other = hold(rig)
    files = rig.files(tmp_path, SETTINGS)
    theirs = {robot.tag for robot in ROBOTS} - {ROBOTS[VICTIM].tag}
    with tracked(files) as first:
        for state in states(first):
            seen = {robot["tag"] for robot in state["robots"]}
            assert seen <= theirs, "nobody gets pictures of a camera that others hold"
            if seen == theirs:
                break
        with tracked(files) as second:
            # A camera forgets a dead program after 3 s: all are looked at while it still lives.
            said = heard(second, [f"{camera.id}: is gone: another program" for camera in CAMERAS])
            first.kill()
            other.release()
            other.close()
            next(full(second))
            second.send_signal(signal.SIGINT)
            said += talk(second)
        assert f"camera {CAMERAS[VICTIM].id}: is gone: another program controls it" in talk(first)
    assert all(f"camera {camera.id}: is back" in said for camera in CAMERAS)
