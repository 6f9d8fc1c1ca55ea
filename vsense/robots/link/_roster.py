"""The expected robots, their sessions, and the answer to every greeting; sans-I/O."""

from __future__ import annotations

import secrets
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from vsense.base.errors import VsenseError
from vsense.base.native import WireError, lib
from vsense.robots.link._peer import Greeting, Orders
from vsense.robots.link._session import Address, HostSession, PendingSession
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.status import LinkEvent, cut_text
from vsense.robots.link.table import BRING, ExpectedRobot, ToldProgram, robot_seed
from vsense.robots.link.wire import (
    PUBLISHED,
    GoodbyeCause,
    Header,
    Hello,
    Notice,
    PacketType,
    RefuseCode,
    Welcome,
    answer_key,
    believed,
    decode,
    encode,
    uid_of,
)

GREETINGS_MAX = 1024
"""Greetings of each robot that are remembered."""

ORIGINS_MAX = 2
"""Addresses from which one greeting is answered, once each, beside the robot's own."""

TAKEN_OVER = "the same robot opened a newer session"
DEPLOY_HINT = f"bring it one with {BRING}"
DEPLOY_IT = f"bring it that with {BRING}"
FORMER_KEY = f"start its vsensed again, or bring it the newest with {BRING}"
OLDER = f"runs an older vsensed: bring it this one with {BRING}"


@dataclass(frozen=True, slots=True)
class Answer:
    """What follows from a greeting.

    Attributes:
        pending: the session that is offered; None if the greeting is refused.
        packet: WELCOME or REFUSE; b"": nothing is answered.
        event: what to report; None: nothing has changed yet.
    """

    pending: PendingSession | None
    packet: bytes
    event: LinkEvent | None = None


@dataclass(frozen=True, slots=True)
class Proved:
    """What follows from the first valid packet of a session that was offered.

    Attributes:
        farewell: GOODBYE for the connection of the session that this one replaces; b"": none was.
        refusal: GOODBYE for this session: another robot has the tag by now; b"": it is open.
        events: what to report.
    """

    farewell: bytes
    refusal: bytes
    events: list[LinkEvent]


TAG_HINT = (
    "Its markers: vsense camera markers --for EXPERIMENT; the lab's: vsense camera markers --roster"
    " robots.toml, whose robots an experiment without tags takes"
)
"""What helps where robots wear other markers than an experiment's file has."""


class SessionTable:
    """The robots of the experiment.

    Args:
        expected: they, by tag.
        timestep_ns: length of a timestep; robots get it in whole microseconds.
        seed: of the run; every robot gets one of its own made from it.
        trust: which robots are believed.
        draw: source of session numbers: uniform 32-bit numbers.

    Attributes:
        robots: every expected robot by its tag; `recast` replaces it as a whole.

    Raises:
        WireError: params or timestep do not fit a WELCOME.
    """

    def __init__(
        self,
        expected: Mapping[int, ExpectedRobot],
        timestep_ns: int,
        seed: int,
        trust: LinkTrust,
        draw: Callable[[], int] = lambda: secrets.randbits(32),
    ) -> None:
        self.robots = {tag: HostSession(tag, r.name, r.table) for tag, r in expected.items()}
        self.orders = Orders()
        self._expected = dict(expected)
        self._timestep_us = timestep_ns // 1000
        self._seed = seed
        self._draw = draw
        self._trust = trust
        self._by_session: dict[int, HostSession] = {}
        self._pending: dict[int, PendingSession] = {}
        self._heard: defaultdict[int, dict[bytes, set[str] | None]] = defaultdict(dict)
        for tag, robot in expected.items():
            header = Header(PacketType.WELCOME, session=1, table_hash=robot.table.hash)
            encode(header, self._welcome(tag))

    def new_run(self, seed: int) -> None:
        """No reading of the new run is measured yet; sessions with another seed are over."""
        for robot in self.robots.values():
            robot.forget()
            robot.reseeded = robot.open and (robot.reseeded or seed != self._seed)
        self._seed = seed

    def recast(self, expected: Mapping[int, ExpectedRobot]) -> list[HostSession]:
        """Expects other robots from now on; those that stay keep their sessions.

        A part's table and params are those of before. Gives the robots that have left, whose
        sessions the caller ends.
        """
        before, self._expected = self.robots, dict(expected)
        self.robots = {
            tag: before.get(tag) or HostSession(tag, robot.name, robot.table)
            for tag, robot in expected.items()
        }
        gone = [robot for tag, robot in before.items() if tag not in expected]
        self._pending = {n: p for n, p in self._pending.items() if p.robot not in gone}
        self._by_session = {r.peer.session: r for r in self.robots.values() if r.open}
        return gone

    def of_session(self, session: int) -> HostSession | None:
        """The robot whose open session has this number."""
        robot = self._by_session.get(session)
        return robot if robot is not None and robot.peer.session == session else None

    def pending(self, session: int) -> PendingSession | None:
        """The session with this number, if it was offered and not yet proved."""
        return self._pending.get(session)

    def withdraw(self, pending: PendingSession) -> None:
        """Forgets a session that was offered: its connection has ended."""
        self._pending.pop(pending.peer.session, None)

    def greet(self, packet: bytes, origin: str, now_ns: int) -> Answer:
        """Answers a connection's first packet, which came from `origin` at `now_ns`, host's clock.

        Raises:
            WireError: it is no valid HELLO.
        """
        opened = self._open(packet, origin, now_ns)
        if isinstance(opened, Answer):
            return opened
        hello, refuse = opened.hello, partial(self._turn_away, opened, now_ns)
        robot = self.robots.get(hello.tag)
        if robot is None:
            tags = ", ".join(map(str, sorted(self.robots))) or "none"
            text = f"tag {hello.tag} is not in this experiment; expected: {tags}. {TAG_HINT}"
            return refuse(RefuseCode.TAG_UNKNOWN, text)
        if self._was_heard(hello, robot.origin, origin):
            text = f"{robot.label}: somebody at {origin} repeats a greeting of it: not answered"
            return Answer(None, b"", LinkEvent("refused", hello.tag, text, now_ns, origin))
        if robot.taken_from(hello.uid, opened.key is not None, now_ns):
            return refuse(RefuseCode.TAG_IN_USE, _taken(hello.tag))
        expected = self._expected[hello.tag]
        if lack := _lack(expected, hello):
            return refuse(RefuseCode.ROOM, lack)
        runs, wanted = ToldProgram(hello.controller, hello.hash), expected.program
        other = ""
        if wanted is not None and not runs.is_same(wanted):
            other = f"runs {runs}, the file says {wanted}"
            if self._is_refused(expected, runs, wanted):
                robot.refused = f"{other}: {DEPLOY_IT}"
                return refuse(RefuseCode.CONTROLLER, f"{robot.label} {robot.refused}")
        notes = self._key_note(opened.key), other and f"it {other}"
        greeting = replace(opened, note="; ".join(filter(None, notes)), other_program=other)
        run, welcome = self.orders.run, self._welcome(hello.tag)
        pending, answer = robot.offer(self._number(), greeting, welcome, run, now_ns)
        self._pending[pending.peer.session] = pending
        return Answer(pending, answer)

    def prove(
        self, pending: PendingSession, packet: bytes, source: Address | None, now_ns: int
    ) -> Proved | None:
        """Takes a packet of a session that was offered; None if it is no valid one.

        `source` is the datagram's, None for TCP. With the first valid packet the session opens.
        """
        heard = pending.peer.receive_telemetry(packet, source is not None, now_ns)
        if heard is None:
            return None
        if self._pending.get(pending.peer.session) is not pending:
            return None
        self.withdraw(pending)
        robot, hello, run = pending.robot, pending.greeting.hello, self.orders.run
        if robot.taken_from(hello.uid, pending.greeting.key is not None, now_ns):
            header = Header(PacketType.GOODBYE, run=run)
            notice = Notice(GoodbyeCause.END, _taken(hello.tag))
            refusal = pending.peer.encode(header, notice, now_ns)
            text = f"refused a robot from {pending.greeting.origin}: {notice.text}"
            origin = pending.greeting.origin
            event = LinkEvent("refused", hello.tag, text, now_ns, origin)
            return Proved(b"", refusal, [event])
        farewell = b""
        if robot.open:
            farewell = robot.goodbye(GoodbyeCause.TAKEN_OVER, TAKEN_OVER, run, now_ns)
        events = robot.adopt(pending, now_ns)
        self._heard[robot.tag] = dict.fromkeys(self._heard[robot.tag])
        robot.reseeded = pending.seed != robot_seed(self._seed, robot.tag)
        self._by_session = {r.peer.session: r for r in self.robots.values() if r.open}
        return Proved(farewell, b"", events + robot.take(*heard, source, now_ns))

    def _open(self, packet: bytes, origin: str, now_ns: int) -> Greeting | Answer:
        """Finds out what a HELLO was tagged with, and whether such a robot is taken."""
        uid = uid_of(packet)
        try:
            roots = tuple(self._trust.roots(uid))
        except VsenseError as error:  # of the process with the keys; the robot will ask again
            tag = believed(packet).tag
            event = LinkEvent("refused", tag, f"robot {tag}: {error}: not answered", now_ns, origin)
            return Answer(None, b"", event)
        for number, root in roots:
            try:
                header, hello = decode(packet, root)
            except WireError as error:
                if error.code != lib.VS_ERR_TAG:
                    raise
                continue
            assert isinstance(hello, Hello)
            if number is None and not self._trust.insecure:
                text = f"has no key, and this host takes no robot without one: {DEPLOY_HINT}"
                return self._doubted(packet, hello, text, origin, now_ns)
            if self._trust.is_former(hello.uid, number):
                text = f"has its former key {number}, but was brought a newer one: {FORMER_KEY}"
                return self._doubted(packet, hello, text, origin, now_ns)
            return Greeting(packet, header, hello, root, number, origin)
        hello = believed(packet)
        if hello.capabilities & lib.VS_CAPABLE_KEYED:
            text = f"has another key than this host's: {DEPLOY_HINT}"
            if self._trust.keys is None:
                text = "has a key, and this host has none: give it the swarm's with --key FILE"
            return self._doubted(packet, hello, text, origin, now_ns)
        raise WireError(lib.VS_ERR_TAG, "HELLO")

    def _was_heard(self, hello: Hello, home: str, origin: str) -> bool:
        """Whether a greeting that came from `origin` is a copy; else it is remembered.

        Whoever hears a greeting can send it again and again, also before the robot's own arrives:
        it counts once from each of `ORIGINS_MAX` addresses and from `home`, where the robot's
        last session came from. Each takes one of the few places of those who have greeted in the
        robot's name. When the robot opens a session, all that it said before is over.
        """
        heard = self._heard[hello.tag]
        origins = heard.setdefault(hello.nonce, set())
        if len(heard) > GREETINGS_MAX:
            del heard[next(iter(heard))]
        if origins is None or origin in origins:
            return True
        if len(origins - {home}) >= ORIGINS_MAX and origin != home:
            return True
        origins.add(origin)
        return False

    def refuse_older(self, tag: int, origin: str, now_ns: int) -> Answer:
        """Turns a robot away that speaks an older protocol, and says so for it."""
        robot = self.robots.get(tag)
        if robot is not None:
            robot.refused = OLDER
        return self.refuse(RefuseCode.HELLO, f"robot {tag} {OLDER}", origin, now_ns, tag)

    def _key_note(self, number: int | None) -> str:
        """What to say of a robot's key, if anything."""
        keys = self._trust.keys
        if number is None or keys is None or number == keys.newest:
            return ""
        return f"it has key {number}, the newest is {keys.newest}: {DEPLOY_HINT}"

    def _doubted(self, packet: bytes, hello: Hello, text: str, origin: str, now_ns: int) -> Answer:
        """Turns away who may be a robot without the right key, and says so for it."""
        robot = self.robots.get(hello.tag)
        if robot is not None:
            robot.refused = text
        text = f"robot {hello.tag} {text}"
        return self.refuse(RefuseCode.KEY, text, origin, now_ns, hello.tag, packet)

    def _turn_away(self, greeting: Greeting, now_ns: int, code: RefuseCode, text: str) -> Answer:
        tag, packet = greeting.hello.tag, greeting.packet
        return self.refuse(code, text, greeting.origin, now_ns, tag, packet, greeting.root)

    def _is_refused(self, expected: ExpectedRobot, runs: ToldProgram, wanted: ToldProgram) -> bool:
        """Whether a robot must not run what it does, which is not the file's."""
        live = {tag: ToldProgram(*robot.runs) for tag, robot in self.robots.items() if robot.open}
        if expected.exact:
            both = [live[t] for t, r in self._expected.items() if t in live and r.program == wanted]
            return not any(runs.is_same(program) for program in both)
        programs = {robot.program for robot in self._expected.values()} - {None, wanted}
        anothers = any(program is not None and runs.is_same(program) for program in programs)
        return anothers or not expected.any_program

    def refuse(
        self,
        code: RefuseCode,
        text: str,
        origin: str,
        now_ns: int,
        tag: int | None = None,
        hello: bytes = b"",
        root: bytes = PUBLISHED,
    ) -> Answer:
        """Turns a connection away, and says so at both ends.

        The answer to a whole `hello` is tagged for it alone, with what `root` gives.
        """
        message = f"refused a robot from {origin}: {text}"
        event = LinkEvent("refused", tag, message, now_ns, origin)
        header = Header(PacketType.REFUSE, send_ns=now_ns)
        key = answer_key(root, hello) if hello else root
        return Answer(None, encode(header, Notice(code, cut_text(text)), key), event)

    def _number(self) -> int:
        """A session number that no session had lately."""
        used = self._by_session.keys() | self._pending.keys()
        while (number := self._draw()) == 0 or number in used:
            pass
        return number

    def _welcome(self, tag: int) -> Welcome:
        seed, nonce = robot_seed(self._seed, tag), secrets.token_bytes(16)
        robot = self._expected[tag]
        return Welcome(robot.table, self._timestep_us, seed, robot.params, nonce)


def _lack(expected: ExpectedRobot, hello: Hello) -> str:
    """What a robot has no room for; "": it has for all that the experiment needs."""
    table = expected.table.cdata
    down = lib.VS_STATE_FIXED + 4 * table.sensors + table.sensor_bytes
    up = lib.VS_TELEMETRY_FIXED + table.actuator_bytes + 2
    needs = (
        ("bytes of params", len(expected.params.encode()), hello.params_room),
        ("sensors and actuators", table.count, hello.entries_room),
        ("bytes a packet", lib.VS_PACKET_MIN + max(down, up), hello.datagram_room),
    )
    lacks = [f"{size} {what}, of {room}" for what, size, room in needs if size > room]
    return f"the experiment needs more than the robot can hold: {'; '.join(lacks)}" * bool(lacks)


def _taken(tag: int) -> str:
    return f"tag {tag} is in use by another robot, which was heard within 1 s"
