"""The physics: spec, ticks that are never lost, motion from actuator frames, and the process."""

from __future__ import annotations

import json
import math
import os
import select
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.rigs.places import ROOT
from vsense.base.errors import UsageError
from vsense.base.shared import LabError, SharedBlock
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.modes.lab._physics_process import FLUSH_TICKS, TICK_NS, PhysicsProcess
from vsense.modes.lab._physics_spec import PhysicsSpec
from vsense.modes.lab.truth import TruthReader, make_ring
from vsense.world.robot_models import EPUCK

EPOCH_NS = 5_000_000_000
PATIENCE_S = 20.0
WAKE_AND_CONFIG = bytes([1, 0, 0, 0, 0])


def forward(steps_s: int, ring: int = 0) -> bytes:
    """An actuator frame that drives straight on."""
    return struct.pack("<hhHBBBBcx", steps_s, steps_s, 0, ring, 0, 0, 0, b"N")


def spec_of(directory: Path, truth: str) -> dict[str, Any]:
    return {
        "robots": [
            {"index": 1, "tag": 31, "x_m": 0.5, "y_m": 0.1, "yaw_rad": 1.0},
            {"index": 0, "tag": 30, "x_m": 0, "y_m": 0, "yaw_rad": 0},
        ],
        "bases": ["argos", "argos"],
        "objects": [{"tag": 22, "x_m": -0.5, "y_m": 0.2, "yaw_rad": -1.0}],
        "boxes": [{"x_m": 1, "y_m": 0, "yaw_rad": 0, "size_x_m": 0.01, "size_y_m": 2}],
        "cylinders": [{"x_m": -1, "y_m": 0, "radius_m": 0.1}],
        "truth": truth,
        "log": str(directory / "actuations.bin"),
        "directory": str(directory),
        "seed": 1,
    }


@pytest.fixture
def ring() -> Iterator[SharedBlock]:
    block = make_ring(3)
    yield block
    block.close()


@pytest.fixture
def spec(tmp_path: Path, ring: SharedBlock) -> dict[str, Any]:
    return spec_of(tmp_path, ring.name)


@pytest.fixture
def process(spec: dict[str, Any]) -> Iterator[PhysicsProcess]:
    parsed = PhysicsSpec.parse(json.dumps(spec).encode())
    one = PhysicsProcess(parsed, EPOCH_NS)
    yield one
    one.close()


def write(process: PhysicsProcess, fd: int, content: bytes, now_ns: int) -> None:
    """Has robot 0 hear some bytes now, all at once."""
    os.write(fd, content)
    assert select.select([process.controllers], [], [], PATIENCE_S)[0]
    process.step(process.controllers.readable(), now_ns)


def test_what_is_written_while_ticks_are_computed_does_not_count_as_earlier(
    process: PhysicsProcess, spec: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    fd = os.open(process.controllers.devices[0], os.O_RDWR | os.O_NOCTTY)
    write(process, fd, WAKE_AND_CONFIG, EPOCH_NS)
    process.step([], EPOCH_NS + 2 * TICK_NS)
    monkeypatch.setattr(process._physics, "tick", lambda _: os.write(fd, forward(500)))
    process.step(process.controllers.readable(), EPOCH_NS + 3 * TICK_NS)
    monkeypatch.undo()
    assert select.select([process.controllers], [], [], PATIENCE_S)[0]
    process.step(process.controllers.readable(), EPOCH_NS + 4 * TICK_NS - 1)
    for tick in range(4, 5 + FLUSH_TICKS):
        process.step([], EPOCH_NS + tick * TICK_NS)
    process._log.close()
    (applied,) = read_actuations(Path(spec["log"]))
    assert applied["time_ns"] > EPOCH_NS + 4 * TICK_NS


def test_bodies_are_the_robots_by_index_then_the_objects(
    process: PhysicsProcess, ring: SharedBlock
) -> None:
    poses, leds = TruthReader(ring.name).at(EPOCH_NS)
    np.testing.assert_array_equal(poses, [[0, 0, 0], [0.5, 0.1, 1.0], [-0.5, 0.2, -1.0]])
    np.testing.assert_array_equal(leds, [0, 0, 0])
    assert len(set(process.controllers.devices)) == 2


@pytest.mark.parametrize("late_ns", [0, 1, TICK_NS - 1])
def test_ticks_that_are_late_are_caught_up_with(
    process: PhysicsProcess, ring: SharedBlock, late_ns: int
) -> None:
    process.step([], EPOCH_NS + 100 * TICK_NS + late_ns)
    assert process.report()["ticks"] == 100
    assert process.report()["lateness_ms"]["max"] == (99 * TICK_NS + late_ns) / 1e6
    assert TruthReader(ring.name).newest_ns() == EPOCH_NS + 100 * TICK_NS
    assert process.wake_ns() == EPOCH_NS + 101 * TICK_NS


def test_an_actuator_frame_moves_the_truth_from_its_time_on(
    process: PhysicsProcess, ring: SharedBlock, spec: dict[str, Any]
) -> None:
    fd = os.open(process.controllers.devices[0], os.O_RDWR | os.O_NOCTTY)
    write(process, fd, WAKE_AND_CONFIG, EPOCH_NS + 3 * TICK_NS)
    process.step([], EPOCH_NS + 5 * TICK_NS)
    write(process, fd, forward(500, ring=0b101), EPOCH_NS + 5 * TICK_NS)
    for tick in range(6, 6 + FLUSH_TICKS):
        process.step([], EPOCH_NS + tick * TICK_NS)
    process._log.close()
    (applied,) = read_actuations(Path(spec["log"]))
    assert applied["robot"] == 0
    assert applied["leds"] == 0b101
    end_ns = EPOCH_NS + (5 + FLUSH_TICKS) * TICK_NS
    poses, leds = TruthReader(ring.name).at(end_ns)
    way_m = 500 * EPUCK.step_m * (end_ns - int(applied["time_ns"])) * 1e-9
    np.testing.assert_allclose(poses[0], [way_m, 0, 0], atol=1e-9)
    np.testing.assert_array_equal(poses[1:, 0], [0.5, -0.5])
    np.testing.assert_array_equal(leds, [0b101, 0, 0])
    os.close(fd)


def test_it_wakes_for_bytes_in_flight_and_else_for_ticks(process: PhysicsProcess) -> None:
    fd = os.open(process.controllers.devices[0], os.O_RDWR | os.O_NOCTTY)
    assert process.wake_ns() == EPOCH_NS + TICK_NS
    write(process, fd, WAKE_AND_CONFIG, EPOCH_NS + 1000)
    assert process.wake_ns() < EPOCH_NS + 1_000_000
    while process.controllers.due_ns is not None:
        process.step([], process.wake_ns())
    # It looks for its wake-up byte every 60 ms or so.
    assert EPOCH_NS < process.wake_ns() <= EPOCH_NS + 100_000_000
    assert process.wake_ns() % TICK_NS == EPOCH_NS % TICK_NS
    os.close(fd)


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        (("robots",), None, "spec: robots: expected a list of objects, not None"),
        (
            ("sensors",),
            [{}, {}],
            "spec: sensors: expected 8 gains, 8 biases, 3 black, 3 white of 2",
        ),
        (("black",), [[0, 0]], "spec: black: expected a list of x_m, y_m, radius_m"),
        (("black",), [[0, 0, "1"]], r"spec: black\[0\].radius_m: expected a finite number"),
        (
            ("robots", 0, "x_m"),
            "abc",
            r"spec: robots\[0\].x_m: expected a finite number, not 'abc'",
        ),
        (("robots", 1, "yaw_rad"), float("nan"), r"robots\[1\].yaw_rad: .* not nan"),
        (("robots", 0, "index"), 5, r"robots: expected indices 0..1, not \[5, 0\]"),
        (("objects", 0, "y_m"), True, r"objects\[0\].y_m: .* not True"),
        (("boxes", 0, "size_x_m"), 0, "boxes: expected sizes above 0"),
        (("boxes",), 7, "boxes: expected a list of objects, not 7"),
        (("cylinders", 0, "radius_m"), 0, "cylinders: expected radii above 0"),
        (("truth",), 3, "truth: expected a text, not 3"),
        (("log",), "", "log: expected a text, not ''"),
        (("seed",), None, "seed: expected a finite number, not None"),
    ],
)
def test_a_wrong_spec_says_what_and_where(
    tmp_path: Path, path: tuple[Any, ...], value: Any, text: str
) -> None:
    spec = spec_of(tmp_path, "truth")
    place: Any = spec
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(UsageError, match=text):
        PhysicsSpec.parse(json.dumps(spec).encode())


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["robots", "objects", "boxes", "index", "tag"]), inner)
    ),
    max_leaves=8,
)


@given(st.binary(max_size=20) | json_values.map(lambda value: json.dumps(value).encode()))
def test_any_spec_is_read_or_refused_with_one_line(line: bytes) -> None:
    with pytest.raises(UsageError) as caught:
        PhysicsSpec.parse(line)
    assert "\n" not in str(caught.value)


def test_sensors_read_what_they_are_and_where_they_stand(spec: dict[str, Any]) -> None:
    nominal = {"gains": [1.0] * 8, "biases": [0.0] * 8, "black": [200.0] * 3, "white": [700.0] * 3}
    mine = {**nominal, "gains": [0.8] * 8, "biases": [30.0] * 8, "black": [300.0, 310.0, 320.0]}
    # Robot 0 faces a wall whose face is 1 cm ahead of ps0's direction, and has its ground sensors,
    # 3 cm ahead, over a black disc.
    spec["boxes"] = [{"x_m": 0.2, "y_m": 0, "yaw_rad": 0, "size_x_m": 0.2, "size_y_m": 1}]
    spec["robots"][1] |= {"x_m": 0.1 - 0.01 - 0.0316147, "yaw_rad": math.radians(17.2)}
    parsed = PhysicsSpec.parse(
        json.dumps(
            {
                **spec,
                "bases": ["gctronic", "gctronic"],
                "sensors": [mine, nominal],
                "black": [[0.095, 0.009, 0.02]],
            }
        ).encode()
    )
    process = PhysicsProcess(parsed, EPOCH_NS)
    try:
        near, away = (link.program.proximity for link in process.controllers.links)
        # Webots' table: 67 of nothing, 1466 of a wall 1 cm ahead.
        assert near[0] == pytest.approx(67 + 30 + 0.8 * (1466 - 67), abs=45)
        assert near[3] == pytest.approx(67 + 30, abs=45)
        assert away == pytest.approx(np.full(8, 67), abs=45)
        black, white = (list(link.ground.ground) for link in process.controllers.links)
        assert black == pytest.approx([300, 310, 320], abs=20)
        assert white == pytest.approx([700] * 3, abs=20)
        assert [base[-7:] for base in process.controllers.bases] == [",ground"] * 2
    finally:
        process.close()


def test_a_log_that_cannot_be_written_is_one_clear_error(spec: dict[str, Any]) -> None:
    spec["log"] = "/nowhere/actuations.bin"
    with pytest.raises(LabError, match=r"/nowhere/actuations.bin: No such file"):
        PhysicsProcess(PhysicsSpec.parse(json.dumps(spec).encode()), EPOCH_NS)


def start(spec: Any) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-m", "vsense.modes.lab._physics_process"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
    )
    assert process.stdin is not None
    process.stdin.write(json.dumps(spec).encode() + b"\n")
    process.stdin.flush()
    return process


def burst(fd: int) -> bytes:
    """Takes one sensor frame."""
    frame = b""
    while len(frame) < 72:
        assert select.select([fd], [], [], PATIENCE_S)[0], f"{len(frame)} of 72 bytes"
        frame += os.read(fd, 72 - len(frame))
    return frame


@pytest.mark.system
def test_the_process_serves_robots_until_its_input_ends(
    spec: dict[str, Any], ring: SharedBlock, tmp_path: Path
) -> None:
    process = start(spec)
    assert process.stdout is not None
    answer = json.loads(process.stdout.readline())
    devices = [base.removeprefix("argos:") for base in answer["bases"]]
    fd = os.open(devices[1], os.O_RDWR | os.O_NOCTTY)
    os.write(fd, WAKE_AND_CONFIG)
    burst(fd)
    process.send_signal(signal.SIGINT)
    os.write(fd, forward(250))
    burst(fd)
    out, talk = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out, talk.decode()) == (0, b"", "")
    os.close(fd)
    (applied,) = read_actuations(Path(spec["log"]))
    assert applied.tolist()[1:] == (1, 250, 250, 0)
    assert applied["time_ns"] > answer["epoch_ns"]
    report = json.loads((tmp_path / "physics.json").read_text())
    assert report["frames"] == 1
    assert report["sent_bytes"] == 144
    newest_ns = TruthReader(ring.name).newest_ns()
    assert newest_ns == answer["epoch_ns"] + report["ticks"] * TICK_NS
    assert not any(os.path.exists(device) for device in devices)


@pytest.mark.system
def test_the_process_ends_on_sigterm(spec: dict[str, Any], tmp_path: Path) -> None:
    process = start(spec)
    assert process.stdout is not None
    assert process.stdout.readline()
    process.terminate()
    assert process.wait(PATIENCE_S) == 0
    assert (tmp_path / "physics.json").exists()
    process.communicate()


@pytest.mark.system
@pytest.mark.parametrize(("change", "code"), [({"seed": "x"}, 2), ({"truth": "/no/ring"}, 1)])
def test_the_process_refuses_with_one_line(
    spec: dict[str, Any], change: dict[str, Any], code: int
) -> None:
    process = start({**spec, **change})
    out, talk = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out) == (code, b"")
    assert talk.startswith(b"physics: ")
    assert talk.count(b"\n") == 1


@pytest.mark.parametrize("watchdog", [False, True])
def test_firmware_has_a_watchdog_where_it_is_wanted(spec: dict[str, Any], watchdog: bool) -> None:
    process = PhysicsProcess(
        PhysicsSpec.parse(json.dumps({**spec, "watchdog": watchdog}).encode()), EPOCH_NS
    )
    found = [link.program.state.body.watchdog_us for link in process.controllers.links]
    process.close()
    assert found == [400_000 * watchdog] * 2


def test_an_object_is_put_where_a_line_says(process: PhysicsProcess, ring: SharedBlock) -> None:
    process.put(b'{"put": 0, "x_m": 0.25, "y_m": -0.5, "yaw_rad": 1.5}')
    process.step([], EPOCH_NS + TICK_NS)
    reader = TruthReader(ring.name)
    poses, _ = reader.at(EPOCH_NS + TICK_NS)
    reader.close()
    assert poses[2].tolist() == [0.25, -0.5, 1.5] and poses[0].tolist() == [0.0, 0.0, 0.0]
    for line in (b"", b"{", b'{"put": 1, "x_m": 0, "y_m": 0, "yaw_rad": 0}', b'{"put": -1}',
                 b'{"put": 0, "x_m": NaN, "y_m": 0, "yaw_rad": 0}', b"[1]"):  # fmt: skip
        with pytest.raises(UsageError, match="put"):
            process.put(line)


def test_another_robot_stands_where_one_stood(process: PhysicsProcess) -> None:
    process.put(b'{"rebuild": 0, "built": [1.02, 0.97, 0.0535]}')
    for line in (b'{"rebuild": 9, "built": [1, 1, 1]}', b'{"rebuild": -1, "built": [1, 1, 0.05]}',
                 b'{"rebuild": 0, "built": [1, 0, 0.05]}', b'{"rebuild": 0, "built": [1, 1]}',
                 b'{"rebuild": 0, "built": [1, 1, NaN]}', b'{"rebuild": 0}'):  # fmt: skip
        with pytest.raises(UsageError, match="put"):
            process.put(line)
