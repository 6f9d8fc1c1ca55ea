"""Emulated microcontrollers over real pseudo-terminals, in virtual time.

A pseudo-terminal hands bytes on a moment after they were written, so the tests wait for the bytes
themselves; the clock that the microcontrollers see is a number in the tests.
"""

from __future__ import annotations

import fcntl
import os
import select
import struct
import termios
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vsense.base.native import lib
from vsense.base.shared import LabError
from vsense.modes.lab._microcontrollers import (
    ACTUATION,
    Actuation,
    ActuationLog,
    Microcontrollers,
    read_actuations,
)
from vsense.robots.inprocess import AMBIENT_RAW

BYTE_NS = 86_806
ACTUATOR_BYTES, SENSOR_BYTES = 12, 72
WAKE_AND_CONFIG = bytes([1, 0, 0, 0, 0])
STEP_NS = 1_000_000
PATIENCE_S = 20.0


def actuators(left: int, right: int, ring: int = 0, other: int = 0, reset: str = "N") -> bytes:
    """An actuator frame, by the map in epuck.md section 4."""
    return struct.pack("<hhHBBBBcx", left, right, 0, ring, other, 0, 0, reset.encode())


class Daemon:
    """The other end of a terminal, and a clock that only moves when told to."""

    def __init__(self, controllers: Microcontrollers, robot: int = 0) -> None:
        self.controllers = controllers
        self.now_ns = 1_000_000_000
        self.applied: list[Actuation] = []
        self.robot = robot
        self.open()

    def open(self) -> None:
        self.fd = os.open(self.controllers.devices[self.robot], os.O_RDWR | os.O_NOCTTY)

    def close(self) -> None:
        os.close(self.fd)

    def write(self, content: bytes) -> None:
        """Puts bytes on the line now."""
        os.write(self.fd, content)
        master = self.controllers.links[self.robot].readable()
        assert master is not None
        while _available(master) < len(content):
            select.select([master], [], [], PATIENCE_S)
        self.controllers.receive(self.controllers.readable(), self.now_ns)

    def live(self, duration_ns: int) -> None:
        """Lets time pass in small steps."""
        end_ns = self.now_ns + duration_ns
        while self.now_ns < end_ns:
            self.now_ns = min(self.now_ns + STEP_NS, end_ns)
            self.applied += self.controllers.advance(self.now_ns)

    def read(self, count: int) -> bytes:
        """Takes so many bytes, which must have been sent."""
        got = b""
        while len(got) < count:
            assert select.select([self.fd], [], [], PATIENCE_S)[0], f"{len(got)} of {count} bytes"
            got += os.read(self.fd, count - len(got))
        return got

    def exchange(self, frame: bytes) -> bytes:
        """Writes a frame and takes the answer."""
        self.write(frame)
        self.live((ACTUATOR_BYTES + SENSOR_BYTES + 1) * BYTE_NS)
        return self.read(SENSOR_BYTES)

    def wake(self) -> bytes:
        """Wakes the microcontroller up, which looks for that now and then, and takes its frame."""
        self.write(WAKE_AND_CONFIG)
        self.live(lib.FW_ARGOS_BLINK_US * 1000 + (SENSOR_BYTES + 2) * BYTE_NS)
        return self.read(SENSOR_BYTES)


def _available(fd: int) -> int:
    """How many bytes can be read at once."""
    return int(struct.unpack("i", fcntl.ioctl(fd, termios.FIONREAD, bytes(4)))[0])


@pytest.fixture
def controllers() -> Iterator[Microcontrollers]:
    two = Microcontrollers(["argos"] * 2)
    yield two
    two.close()


@pytest.fixture
def daemon(controllers: Microcontrollers) -> Iterator[Daemon]:
    one = Daemon(controllers)
    yield one
    one.close()


def test_the_first_frame_comes_after_wake_up_and_configuration(daemon: Daemon) -> None:
    prox = np.array([[100, 200, 300, 400, 500, 600, 700, 800], [0] * 8], dtype=np.int16)
    daemon.controllers.sense(prox)
    frame = daemon.wake()
    assert struct.unpack_from("<8h", frame, 8) == tuple(prox[0])
    assert struct.unpack_from("<8h", frame, 40) == (AMBIENT_RAW,) * 8
    battery_good, rest, gravity = 1, lib.EPUCK_ARGOS_REST_RAW, lib.EPUCK_ARGOS_GRAVITY_RAW
    at_rest = (rest, rest, rest + gravity, rest, rest, rest, 0)
    assert frame[24:40] == struct.pack("<H7h", battery_good, *at_rest)
    assert daemon.applied == []


def test_a_frame_is_applied_when_its_last_byte_is_through(daemon: Daemon) -> None:
    daemon.wake()
    written_ns = daemon.now_ns
    daemon.exchange(actuators(300, -400, ring=0b1, other=0b10))
    (applied,) = daemon.applied
    assert applied[1:] == (0, 300, -400, 0b1_0000_0001)
    assert abs(applied.time_ns - (written_ns + ACTUATOR_BYTES * BYTE_NS)) <= 2000


def test_a_frame_says_what_was_measured_when_it_was_composed(daemon: Daemon) -> None:
    daemon.wake()
    daemon.write(actuators(0, 0))
    daemon.live((ACTUATOR_BYTES - 1) * BYTE_NS)
    daemon.controllers.sense(np.full((2, 8), 11, dtype=np.int16))
    daemon.live(2 * BYTE_NS)
    daemon.controllers.sense(np.full((2, 8), 22, dtype=np.int16))
    daemon.live((SENSOR_BYTES + 1) * BYTE_NS)
    assert struct.unpack_from("<8h", daemon.read(SENSOR_BYTES), 8) == (11,) * 8


def test_bytes_come_no_faster_than_the_line_carries_them(daemon: Daemon) -> None:
    daemon.wake()
    daemon.write(actuators(0, 0))
    daemon.live(ACTUATOR_BYTES * BYTE_NS)
    daemon.live(40 * BYTE_NS + BYTE_NS // 2)
    first = daemon.read(16)
    assert _available(daemon.fd) <= 24
    daemon.live(40 * BYTE_NS)
    assert len(first + daemon.read(56)) == SENSOR_BYTES
    assert daemon.controllers.due_ns is None


def test_an_answer_wakes_its_daemon_when_it_begins_and_when_it_is_whole(daemon: Daemon) -> None:
    daemon.wake()
    link, sent = daemon.controllers.links[0], {SENSOR_BYTES: daemon.now_ns}
    daemon.write(actuators(0, 0))
    while (due_ns := daemon.controllers.due_ns) is not None:
        daemon.controllers.advance_due(due_ns)
        sent.setdefault(link.sent_bytes, due_ns)
    assert list(sent) == [72, pytest.approx(72 + 16, abs=1), 72 + 72]
    bytes_on_the_line = [(at_ns - daemon.now_ns) / BYTE_NS for at_ns in sent.values()]
    assert bytes_on_the_line == pytest.approx([0, 12 + 16, 12 + 72], abs=0.1)


def test_an_idle_line_needs_no_service(daemon: Daemon) -> None:
    daemon.wake()
    assert daemon.controllers.due_ns is None
    daemon.write(b"\x01")
    due_ns = daemon.controllers.due_ns
    assert due_ns is not None
    assert daemon.now_ns < due_ns <= daemon.now_ns + 2 * BYTE_NS
    daemon.live(2 * BYTE_NS)
    assert daemon.controllers.due_ns is None


def test_a_restarted_daemon_finds_the_middle_of_a_frame(daemon: Daemon) -> None:
    """Only the daemon is new: terminal, half a frame and lit LEDs are as they were."""
    daemon.wake()
    daemon.exchange(actuators(500, 500, ring=0xFF))
    frame = actuators(-200, 100, ring=0xFF)
    daemon.write(frame[:7])
    daemon.live(20 * BYTE_NS)
    daemon.close()
    daemon.live(100_000_000)
    daemon.open()
    assert daemon.exchange(frame[7:])
    assert daemon.applied[-1][1:] == (0, -200, 100, 0xFF)
    assert len(daemon.applied) == 2


def test_reset_leads_back_to_the_wake_up(daemon: Daemon) -> None:
    daemon.wake()
    daemon.write(actuators(0, 0, reset="R"))
    daemon.live(30 * BYTE_NS)
    assert daemon.applied[-1][2:] == (0, 0, 0)
    assert len(daemon.wake()) == SENSOR_BYTES


@settings(max_examples=25)
@example(bytes(11) + bytes.fromhex("5a5f0101616e797b7d858d92969ca1aaabb3b6b9c9cfd30000e1e8eff4fd"))
@given(st.binary(max_size=60))
def test_from_any_garbage_zeros_lead_to_a_whole_frame(garbage: bytes) -> None:
    """One 0x00 at a time, each with time for the slowest answer, until a burst comes."""
    controllers = Microcontrollers(["argos"])
    daemon = Daemon(controllers)
    if garbage:
        daemon.write(garbage)
    stale = -1
    while stale != controllers.counters()["sent_bytes"]:  # garbage may hold several requests
        stale = controllers.counters()["sent_bytes"]
        daemon.live(200_000_000)
    daemon.read(stale)
    tries = 0
    while controllers.counters()["sent_bytes"] == stale:
        daemon.write(b"\x00")
        daemon.live(100_000_000)
        tries += 1
        assert tries <= ACTUATOR_BYTES
    assert len(daemon.read(SENSOR_BYTES)) == SENSOR_BYTES
    daemon.exchange(actuators(12, 34))
    assert daemon.applied[-1][2:4] == (12, 34)
    daemon.close()
    controllers.close()


def test_robots_do_not_hear_each_other(controllers: Microcontrollers) -> None:
    one, other = Daemon(controllers, 0), Daemon(controllers, 1)
    controllers.sense(np.array([[1] * 8, [2] * 8], dtype=np.int16))
    assert struct.unpack_from("<8h", one.wake(), 8) == (1,) * 8
    other.now_ns = one.now_ns
    assert struct.unpack_from("<8h", other.wake(), 8) == (2,) * 8
    other.exchange(actuators(7, 8))
    assert [applied[1:4] for applied in other.applied] == [(1, 7, 8)]
    for daemon in (one, other):
        assert _available(daemon.fd) == 0
        daemon.close()


def test_a_terminal_that_nobody_reads_blocks_nobody(daemon: Daemon) -> None:
    daemon.wake()
    count = 0
    while not daemon.controllers.counters()["lost_bytes"] and count < 5000:
        daemon.write(actuators(count % 1000, 0))
        daemon.live((ACTUATOR_BYTES + SENSOR_BYTES + 1) * BYTE_NS)
        count += 1
    assert len(daemon.applied) == count
    daemon.read(daemon.controllers.counters()["sent_bytes"] - SENSOR_BYTES)
    assert daemon.exchange(actuators(1, 2))


def test_more_than_the_line_holds_waits_its_turn(daemon: Daemon) -> None:
    """A flood arrives byte for byte as if it had been written at the line's pace."""
    flood = b"".join(actuators(number, -number) for number in range(26))
    calm = Microcontrollers(["argos"])
    reference = Daemon(calm)
    reference.wake()
    for at in range(0, len(flood), 12):
        reference.write(flood[at : at + 12])
        reference.live(12 * BYTE_NS)
    reference.live(100_000_000)

    daemon.wake()
    link = daemon.controllers.links[0]
    daemon.write(flood[:252])
    assert link.readable() is not None
    daemon.write(flood[252:])
    assert link.readable() is None
    daemon.live(len(flood) * BYTE_NS + 100_000_000)
    assert link.readable() is not None
    assert daemon.controllers.counters() == calm.counters()
    assert calm.counters()["overlapped_bytes"] > 0
    reference.close()
    calm.close()


@pytest.mark.parametrize("byte", [0x00, 0x03, 0x04, 0x0A, 0x0D, 0x11, 0x13, 0x1A, 0x1C, 0x7F, 0xFF])
def test_the_terminal_changes_no_byte(daemon: Daemon, byte: int) -> None:
    """Those that a terminal for people would act upon."""
    daemon.wake()
    daemon.controllers.sense(np.full((2, 8), byte, dtype=np.int16))
    frame = daemon.exchange(actuators(byte, 2 * byte, ring=byte))
    assert daemon.applied[-1][2:] == (byte, 2 * byte, byte)
    assert frame[8:24] == bytes([byte, 0]) * 8


def test_too_few_terminals_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    real, left = os.openpty, [2]

    def openpty() -> tuple[int, int]:
        if not left[0]:
            raise OSError(28, "No space left on device")
        left[0] -= 1
        return real()

    monkeypatch.setattr(os, "openpty", openpty)
    with pytest.raises(LabError, match="2 of 3, then: No space left"):
        Microcontrollers(["argos"] * 3)


actuations = st.builds(
    Actuation,
    st.integers(0, 2**62),
    st.integers(0, 65535),
    st.integers(-1000, 1000),
    st.integers(-1000, 1000),
    st.integers(0, 1023),
)


@settings(max_examples=25)
@given(st.lists(actuations), st.lists(actuations))
def test_the_log_gives_back_what_was_applied(tmp_path_factory, before, after) -> None:
    path = tmp_path_factory.mktemp("log") / "actuations.bin"
    path.write_bytes(b"of an earlier run")
    log = ActuationLog(path)
    for part in (before, after):
        for actuation in part:
            log.append(actuation)
        log.flush()
    log.close()
    assert [tuple(row) for row in read_actuations(path).tolist()] == before + after


def test_a_log_cut_short_loses_its_last_record_only(tmp_path: Path) -> None:
    log = ActuationLog(tmp_path / "log")
    for robot in range(3):
        log.append(Actuation(robot, robot, 1, 2, 3))
    log.close()
    whole = (tmp_path / "log").read_bytes()
    (tmp_path / "log").write_bytes(whole[:-1])
    assert read_actuations(tmp_path / "log")["robot"].tolist() == [0, 1]
    assert read_actuations(tmp_path / "log", ACTUATION.itemsize)["robot"].tolist() == [1]


def test_a_log_that_cannot_be_written_or_read_says_so(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="No such file"):
        ActuationLog(tmp_path / "nowhere" / "log")
    with pytest.raises(LabError, match="No such file"):
        read_actuations(tmp_path / "none")
