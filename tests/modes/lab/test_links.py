"""What the lab's daemons open: every kind of base, and the bus on a socket, in virtual time."""

from __future__ import annotations

import os
import select
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.firmware import tables
from vsense.base.errors import UsageError
from vsense.base.native import lib
from vsense.base.shared import LabError
from vsense.config.casting import Casting
from vsense.config.roster import Roster, RosterRobot
from vsense.modes.lab._links import GROUND_RAW, PROGRAMS, Bus
from vsense.modes.lab._microcontrollers import Actuation, Microcontrollers
from vsense.modes.lab.hardware import BASE_KINDS, BASES, MIXED, bases_of

PATIENCE_S = 20.0
BYTE_NS = 90_000
EXCHANGE_NS = 71 * BYTE_NS
"""A whole one on the bus: 20 bytes out, 47 in, two addresses, the edges."""
DARK = [3000] * 8


def connect(path: str) -> socket.socket:
    """Connects in another process, which is then the peer for good, and takes the socket over."""
    ours, theirs = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        one = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        one.connect(path)
        socket.send_fds(theirs, [b"!"], [one.fileno()])
        os._exit(0)
    _, (fd,), _, _ = socket.recv_fds(ours, 1, 1)
    os.waitpid(pid, 0)
    ours.close()
    theirs.close()
    return socket.socket(fileno=fd)


class Client:
    """A daemon's end of a bus, and a clock that only moves when told to."""

    def __init__(self, chips: Microcontrollers, robot: int = 0) -> None:
        self.chips = chips
        self.robot = robot
        self.now_ns = 1_000_000_000
        self.applied: list[Actuation] = []
        self.number = 0
        self.socket = connect(chips.devices[robot].removeprefix("unix:"))

    def serve(self) -> None:
        """Has the bus take what waits for it."""
        select.select([self.chips], [], [], PATIENCE_S)
        self.chips.receive(self.chips.readable(), self.now_ns)

    def live(self, duration_ns: int) -> None:
        self.now_ns += duration_ns
        self.applied += self.chips.advance(self.now_ns)

    def greeted(self) -> bool:
        return bool(select.select([self.socket], [], [], 0)[0]) and bool(self.socket.recv(16))

    def ask(self, address: int, out: bytes, count: int = 0) -> None:
        self.number += 1
        self.socket.send(struct.pack("<IBB", self.number, address, count) + out)
        self.serve()

    def answer(self) -> bytes | None:
        """The reply that is there now; None while there is none."""
        if not select.select([self.socket], [], [], 0)[0]:
            return None
        return self.socket.recv(256)

    def exchange(self, left: int, right: int) -> bytes | None:
        self.ask(0x1F, tables.gctronic_actuators(left, right, 0), 47)
        self.live(EXCHANGE_NS)
        return self.answer()


@pytest.fixture
def chips() -> Iterator[Microcontrollers]:
    two = Microcontrollers(["gctronic", "gctronic"])
    yield two
    two.close()


@pytest.fixture
def client(chips: Microcontrollers) -> Iterator[Client]:
    one = Client(chips)
    one.serve()
    assert one.greeted()
    yield one
    one.socket.close()


def test_every_kind_is_emulated_and_mixed_is_all_of_them() -> None:
    assert tuple(PROGRAMS) == (*BASE_KINDS, "thymio", "ros2")
    assert (*BASE_KINDS, MIXED) == BASES
    assert bases_of("york", ["", "argos"]) == ["york", "york"]
    assert bases_of(MIXED, [""] * 8) == [*BASE_KINDS, *BASE_KINDS[:2]]
    with pytest.raises(UsageError, match="no base 'lego' in the lab: expected one of argos,"):
        bases_of("lego", [""])


def test_a_base_is_what_the_roster_says() -> None:
    """A driver of one's own has no robot in the lab, which takes the first kind."""
    bases = {
        "": "argos", "york:/dev/i2c-12": "york", "wifi:192.168.1.40,floor=yes": "wifi",
        "exec:epuck /dev/ttyS1": "exec", "exec:thymio /dev/ttyACM0": "thymio",
        "exec:ros2.py --namespace robot_23": "ros2", "exec:mine.py /dev/ttyUSB0": "argos",
    }  # fmt: skip
    robots = [RosterRobot(tag, base=base) for tag, base in enumerate(bases)]
    types = dict(Casting.of(Roster(Path("robots.toml"), tuple(robots))).types)
    asked = [types.get(robot.tag, "") for robot in robots]
    assert bases_of(None, asked) == list(bases.values())


def test_bases_are_what_the_daemons_are_told() -> None:
    chips = Microcontrollers(BASE_KINDS)
    serial, wires, (driver, air) = chips.bases[:2], chips.bases[2:4], chips.bases[4:]
    assert [base.partition(":/dev/pts/")[0] for base in serial] == ["argos", "asercom"]
    assert [base.partition(":unix:/")[0] for base in wires] == ["gctronic", "york"]
    assert driver.startswith("exec:") and "/epuck.py /dev/pts/" in driver
    assert air.startswith("wifi:127.0.0.1:")
    paths = [device.removeprefix("unix:") for device in chips.devices[:-1]]
    assert all(os.path.exists(path) for path in paths)
    chips.close()
    assert not any(os.path.exists(path) for path in paths)
    with pytest.raises(LabError, match="no base 'lego' in the lab"):
        Microcontrollers(["argos", "lego"])


def test_all_kinds_measure_what_the_lab_says() -> None:
    chips = Microcontrollers(BASE_KINDS)
    prox = np.arange(48, dtype=np.int16).reshape(6, 8)
    chips.sense(prox)
    for link, row in zip(chips.links, prox.tolist()):
        inputs = link.program.state.body.inputs
        assert list(inputs.prox) == row
        assert list(inputs.light) == DARK and list(inputs.ground) == [GROUND_RAW] * 3
    chips.close()


def test_an_answer_comes_when_its_transaction_is_over(client: Client) -> None:
    client.ask(0x1F, tables.gctronic_actuators(300, -300, 0), 47)
    due_ns = client.chips.due_ns
    assert due_ns is not None and due_ns <= client.now_ns + EXCHANGE_NS
    client.live(EXCHANGE_NS - 2 * BYTE_NS)
    assert client.answer() is None
    client.live(2 * BYTE_NS)
    reply = client.answer()
    quiet = [lib.EPUCK_ARGOS_REST_RAW] * 4
    sensors = tables.gctronic_sensors([0] * 8, DARK, (0, 0), quiet)
    assert reply == struct.pack("<IB", 1, 0) + sensors
    assert [applied[1:] for applied in client.applied] == [(0, 300, -300, 0)]
    assert client.chips.due_ns is None, "an idle bus needs no service"


def test_a_command_counts_when_it_was_written(client: Client) -> None:
    began_ns = client.now_ns
    client.exchange(100, 100)
    (applied,) = client.applied
    assert 0 <= applied.time_ns - (began_ns + 21 * BYTE_NS) <= 30_000


def test_who_is_not_there_does_not_acknowledge(client: Client) -> None:
    client.ask(0x55, b"x", 3)
    client.live(EXCHANGE_NS)
    assert client.answer() == struct.pack("<IB", 1, 1)
    assert client.chips.counters()["failed_transactions"] == 1


def test_a_stuck_bus_says_nothing(client: Client) -> None:
    link = client.chips.links[0]
    assert isinstance(link, Bus)
    link.wires.stuck = 1
    client.ask(0x1F, tables.gctronic_actuators(1, 1, 0), 47)
    client.live(1_000_000_000)
    assert client.answer() is None and client.applied == []
    link.wires.stuck = 0
    assert client.exchange(1, 1)


def test_one_daemon_at_a_time_and_the_bus_stays(client: Client) -> None:
    client.exchange(200, 200)
    second = Client(client.chips)  # of another process: another daemon
    client.exchange(200, 200)
    assert not second.greeted(), "it waits"
    client.socket.close()
    second.now_ns = client.now_ns
    second.serve()
    if not second.greeted():  # one turn for the end of the first, one for the second
        second.serve()
        assert second.greeted()
    second.exchange(0, 200)
    assert [applied[2:4] for applied in second.applied] == [(0, 200)]
    second.socket.close()


def test_a_packet_that_is_none_ends_the_conversation(client: Client) -> None:
    client.socket.send(b"abc")
    client.serve()
    assert client.socket.recv(16) == b""


def test_robots_do_not_hear_each_other(chips: Microcontrollers) -> None:
    chips.sense(np.array([[1] * 8, [2] * 8], dtype=np.int16))
    for robot in range(2):
        one = Client(chips, robot)
        one.serve()
        assert one.greeted()
        one.now_ns = 2_000_000_000 + robot * 100_000_000
        reply = one.exchange(10 + robot, 0)
        assert reply is not None and reply[5] == 1 + robot
        assert [applied[1:3] for applied in one.applied] == [(robot, 10 + robot)]
        one.socket.close()


def test_counters_tell_lines_and_buses_apart() -> None:
    chips = Microcontrollers(["asercom", "gctronic"])
    client = Client(chips, 1)
    client.serve()
    client.greeted()
    client.exchange(5, 5)
    counters = chips.counters()
    assert (counters["frames"], counters["transactions"]) == (1, 1)
    assert counters["overlapped_bytes"] == counters["failed_transactions"] == 0
    assert counters["sent_bytes"] == 1 + 5 + 47
    client.socket.close()
    chips.close()
