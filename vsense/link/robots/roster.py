"""The expected robots, their sessions, and the answer to every greeting; sans-I/O."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from vsense.link.robots.peer import Orders
from vsense.link.robots.session import HostSession
from vsense.link.robots.status import LinkEvent, cut_text
from vsense.link.robots.table import Table
from vsense.link.robots.wire import (
    GoodbyeCause,
    Header,
    Hello,
    Notice,
    PacketType,
    RefuseCode,
    Welcome,
    decode,
    encode,
)
from vsense.native import WireError, lib

TAKEN_OVER = "the same robot opened a newer session"


@dataclass(frozen=True, slots=True)
class Answer:
    """What follows from a greeting.

    Attributes:
        robot: whose session is open now; None if the greeting is refused.
        packet: WELCOME or REFUSE.
        farewell: GOODBYE for the connection of the session that this one replaces.
        event: what to report.
    """

    robot: HostSession | None
    packet: bytes
    farewell: bytes | None
    event: LinkEvent


@dataclass(frozen=True, slots=True)
class ToldProgram:
    """A controller as robots tell it in their greeting.

    Attributes:
        name: what it calls itself, "": not known.
        hash: of its source, "": not known.
    """

    name: str
    hash: str = ""

    def __str__(self) -> str:
        return f"'{self.name or 'unnamed'}'{f' ({self.hash})' if self.hash else ''}"

    def is_same(self, other: ToldProgram) -> bool:
        """Whether both are made of the same source, as far as is known."""
        return self.hash == other.hash if self.hash and other.hash else self.name == other.name


@dataclass(frozen=True, slots=True)
class ExpectedRobot:
    """A robot of the experiment.

    Attributes:
        name: its own in the experiment.
        table: its sensor table.
        params: lines "key=value\\n" for its controller.
        program: its controller, None: not known.
    """

    name: str
    table: Table
    params: str = ""
    program: ToldProgram | None = None


class Roster:
    """The robots of the experiment.

    Args:
        expected: they, by tag.
        timestep_ns: length of a timestep; robots get it in whole microseconds.
        seed: of the run; every robot gets one of its own made from it.
        draw: source of session numbers: uniform 32-bit numbers.

    Attributes:
        robots: every expected robot by its tag; never changes.

    Raises:
        WireError: params or timestep do not fit a WELCOME.
    """

    def __init__(
        self,
        expected: Mapping[int, ExpectedRobot],
        timestep_ns: int,
        seed: int,
        draw: Callable[[], int] = lambda: secrets.randbits(32),
    ) -> None:
        self.robots = {tag: HostSession(tag, r.name, r.table) for tag, r in expected.items()}
        self.orders = Orders()
        self._expected = dict(expected)
        self._timestep_us = timestep_ns // 1000
        self._seed = seed
        self._draw = draw
        self._by_session: dict[int, HostSession] = {}
        for tag, robot in expected.items():
            header = Header(PacketType.WELCOME, session=1, table_hash=robot.table.hash)
            encode(header, self._welcome(tag))

    def of_session(self, session: int) -> HostSession | None:
        """The robot whose open session has this number."""
        robot = self._by_session.get(session)
        return robot if robot is not None and robot.peer.session == session else None

    def greet(self, packet: bytes, origin: str, now_ns: int) -> Answer:
        """Answers a connection's first packet, which came from `origin` at `now_ns`, host's clock.

        Raises:
            WireError: it is no valid HELLO.
        """
        header, hello = decode(packet)
        if not isinstance(hello, Hello):
            raise WireError(lib.VS_ERR_TYPE, "first packet of a connection")
        robot = self.robots.get(hello.tag)
        if robot is None:
            known = ", ".join(map(str, sorted(self.robots))) or "none"
            text = f"tag {hello.tag} is not in this experiment; expected: {known}"
            return self.refuse(RefuseCode.TAG_UNKNOWN, text, origin, now_ns, hello.tag)
        if robot.taken_from(hello.uid, now_ns):
            text = f"tag {hello.tag} is in use by another robot, which was heard within 1 s"
            return self.refuse(RefuseCode.TAG_IN_USE, text, origin, now_ns, hello.tag)
        size = len(self._expected[hello.tag].params.encode())
        if hello.params_room < size:
            text = f"the experiment's params have {size} bytes, the robot has {hello.params_room}"
            return self.refuse(RefuseCode.ROOM, text, origin, now_ns, hello.tag)
        runs, wanted = ToldProgram(hello.controller, hello.hash), self._expected[hello.tag].program
        if wanted is not None and self._is_anothers(runs, wanted):
            robot.refused = f"runs {runs}, expected {wanted}"
            text = f"{robot.name} {robot.refused}: see vsense robot deploy"
            return self.refuse(RefuseCode.CONTROLLER, text, origin, now_ns, hello.tag)
        farewell = None
        if robot.open:
            run = self.orders.run
            farewell = robot.goodbye(GoodbyeCause.TAKEN_OVER, TAKEN_OVER, run, now_ns)
        event = robot.greet(self._number(), hello, header, origin, now_ns)
        if wanted is not None and not runs.is_same(wanted):
            event = replace(event, text=f"{event.text}: {runs}; the file's is {wanted}")
        self._by_session = {r.peer.session: r for r in self.robots.values() if r.open}
        answer = robot.welcome(self._welcome(hello.tag), self.orders, now_ns)
        return Answer(robot, answer, farewell, event)

    def _is_anothers(self, runs: ToldProgram, wanted: ToldProgram) -> bool:
        """Whether a robot runs a program that its sensor table is not for.

        Where all robots have one controller, it may be an older or a newer one, or the user's own
        under another name: its table is for whatever runs there.
        """
        known = {robot.program for robot in self._expected.values() if robot.program is not None}
        if len(known) < 2 or runs.is_same(wanted):
            return False
        other = any(runs.is_same(program) for program in known)
        return other or bool(wanted.name and runs.name != wanted.name)

    def refuse(
        self, code: RefuseCode, text: str, origin: str, now_ns: int, tag: int | None = None
    ) -> Answer:
        """Turns a connection away, and says so at both ends."""
        event = LinkEvent("refused", tag, f"refused a robot from {origin}: {text}", now_ns)
        header = Header(PacketType.REFUSE, send_ns=now_ns)
        return Answer(None, encode(header, Notice(code, cut_text(text))), None, event)

    def _number(self) -> int:
        """A session number that no session had lately."""
        while (number := self._draw()) == 0 or number in self._by_session:
            pass
        return number

    def _welcome(self, tag: int) -> Welcome:
        seed, nonce = robot_seed(self._seed, tag), secrets.token_bytes(16)
        robot = self._expected[tag]
        return Welcome(robot.table, self._timestep_us, seed, robot.params, nonce)


def robot_seed(seed: int, tag: int) -> int:
    """Seed of one robot's controller, made from that of the run: 32 bits."""
    digest = hashlib.blake2b(f"{seed}/{tag}".encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little")
