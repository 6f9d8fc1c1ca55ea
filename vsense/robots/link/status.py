"""What the virtual sensor server gives the rest of the host: events, status and reports."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Literal

from vsense.base.errors import VsenseError
from vsense.base.native import lib
from vsense.robots.link.strangers import StrangerLog
from vsense.robots.link.wire import NEVER_US, TEXT_MAX, Header, Hello, Telemetry, Wanted

LIFE_NS = 1_000_000_000
"""A report counts while its robot's controller acts: this long after the newest control step that
the host has heard of."""


@dataclass(frozen=True, slots=True)
class ActuatorReport:
    """The newest report of one robot.

    Attributes:
        uid: who reports: another robot with the same tag has counters of its own.
        payload: the actuators' block, in the sensor table's order.
        heard_ns: when it came, host's clock.
    """

    uid: bytes
    payload: bytes
    heard_ns: int = field(default=0, compare=False)


class Reporter:
    """One robot's reports in one session, of telemetry that the acceptance filter has passed."""

    def __init__(self) -> None:
        self._uid = b""
        self._newest: tuple[int, Telemetry, int] | None = None
        self._control_step: int | None = None
        self._acted_ns = 0

    def open(self, uid: bytes) -> None:
        """A session opens: reports of the one before are forgotten."""
        self._uid, self._newest, self._control_step = uid, None, None

    def close(self) -> None:
        """The session ends."""
        self._newest = None

    def receive(self, header: Header, telemetry: Telemetry, now_ns: int) -> None:
        """Takes accepted telemetry that came at now_ns, host's clock."""
        self._newest = header.run, telemetry, now_ns
        if telemetry.control_step != self._control_step:
            self._control_step, self._acted_ns = telemetry.control_step, now_ns

    def report(self, run: int, now_ns: int) -> ActuatorReport | None:
        """Gives the robot's report of a run; None if none still counts at `now_ns`."""
        if self._newest is None or now_ns - self._acted_ns >= LIFE_NS:
            return None
        of_run, telemetry, heard_ns = self._newest
        if of_run != run:
            return None
        return ActuatorReport(self._uid, telemetry.payload, heard_ns)


class LogLines:
    """The lines that one robot's controller logs: each once, whatever arrives twice or not.

    Attributes:
        heard: number of the newest line, 0 before the first; the robot is told.
    """

    def __init__(self) -> None:
        self.heard = 0
        self._source: tuple[bytes, int] | None = None

    def open(self, uid: bytes, started: int) -> None:
        """A session opens; lines are numbered from 1 since the daemon's start."""
        if self._source != (uid, started):
            self._source, self.heard = (uid, started), 0

    def heard_of(self, uid: bytes, started: int) -> int:
        """What `heard` would be in a session of this daemon."""
        return self.heard if self._source == (uid, started) else 0

    def add(self, number: int, text: str) -> list[str]:
        """Takes a line; gives what to say: how many before it were lost, and the line.

        Nothing if it was heard before; number 0 is none.
        """
        if number <= self.heard:
            return []
        lost, self.heard = number - self.heard - 1, number
        said = [f"logged: {text}"]
        return [f"{lost} of its log lines are lost", *said] if lost else said


@dataclass(frozen=True, slots=True)
class RadioStatus:
    """What a robot tells of its Wi-Fi, as of at most some seconds ago; None is unknown.

    Attributes:
        signal_dbm: strength of the access point's signal.
        bit_rate_mbit_s: that the radio sends with.
        retries: frames that it gave up after its last try, since its driver began to count.
        power_saving: whether the radio sleeps between beacons: what is sent to it waits meanwhile.
    """

    signal_dbm: int | None = None
    bit_rate_mbit_s: float | None = None
    retries: int | None = None
    power_saving: bool | None = None

    @classmethod
    def of(cls, telemetry: Telemetry) -> RadioStatus:
        """What a robot's telemetry tells."""
        return cls(
            telemetry.signal_dbm or None,
            telemetry.bit_rate / 10 or None,
            None if telemetry.retries == NEVER_US else telemetry.retries,
            None if telemetry.power_saving == lib.VS_UNKNOWN else bool(telemetry.power_saving),
        )


EventKind = Literal[
    "connected",
    "reconnected",
    "takeover",
    "refused",
    "lost",
    "back",
    "no_udp",
    "udp_back",
    "goodbye",
    "protocol_error",
    "log",
    "doubt",
    "defect",
]

RING_LEDS = 0xFF
"""Bits of `Telemetry.leds`: the red ring."""

EVENT_REPEAT_NS = 10_000_000_000
"""The same refusal or protocol error is reported again only after this long."""

LINES_OF_STRANGERS, LINES_OF_ROBOT = 8, 2
"""So many different ones are told in that time, of all strangers and of one expected robot."""


class LinkError(VsenseError):
    """The link to the robots cannot be opened, or has failed."""


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """Something that a person watching the link wants to know.

    Attributes:
        kind: what happened. `connected`: first session of the robot; `reconnected`: a session
            after an earlier one ended or fell silent; `takeover`: the same robot opened a new
            session while the old one still talked; `refused`: a greeting was turned down;
            `lost`: nothing heard for 1 s, or the connection broke; `back`: heard again in the
            same session; `no_udp`, `udp_back`: state goes over TCP, no longer does;
            `goodbye`: the robot ended its session; `protocol_error`: bytes that no robot sends;
            `log`: a line that its controller logged; `doubt`: somebody else may speak for it;
            `defect`: a bug in vsense has ended its session.
        tag: the robot's tag; None where it is not known.
        text: one line for a person.
        time_ns: host's monotonic clock.
        origin: address of a peer that has not shown who it is; "" for robots.
    """

    kind: EventKind
    tag: int | None
    text: str
    time_ns: int
    origin: str = ""


@dataclass(frozen=True, slots=True)
class RobotStatus:
    """One expected robot, as of one moment. Counters never go down over its sessions.

    Attributes:
        name: the robot's name in the experiment.
        connected: a session is open and was heard within 1 s.
        uid: 16 bytes, who the robot is; None before its first session.
        controller: name of the controller that runs on it.
        version: of its software; empty before its first session.
        hash: of the controller's source; empty where it is not known.
        since_ns: when the newest session opened, host's monotonic clock; None before the first.
        heard_ns: when its newest valid packet came, same clock.
        udp: state travels over UDP both ways; False in the TCP fallback or without a session.
        telemetry: newest accepted telemetry of the robot; None before the first.
        sessions: sessions opened so far; the robot reconnected one time less.
        sent: STATE packets sent.
        superseded: of these, replaced by a newer one while they waited for a slow TCP stream.
        unsent: of these, refused by the kernel on their only way.
        received, accepted: telemetry packets that arrived, good or bad, and that were taken.
        dropped: by reason, how many were not; `received` is `accepted` plus all of these.
        refused: why a robot with its tag was turned away since the newest session; "": none was,
            or it is connected.
        other_program: which it runs in place of the file's, in words; "": it runs the file's, or
            that is not known.
        starts: its daemon was started so often, as far as it was heard.
        key: number of the swarm key that its own is made of; None: what comes in its name may be
            anybody's.
        drives_home: it can drive home; an older daemon cannot.
        wanted: what the host wants of it.
        ordered_ns: since when it may move, or is to stand still, host's clock.
        held: why it alone pauses, in words; "": it does not.
        defects: how often a bug in vsense has ended its session.
    """

    tag: int
    name: str
    connected: bool
    uid: bytes | None
    controller: str
    version: str
    hash: str
    since_ns: int | None
    heard_ns: int | None
    udp: bool
    telemetry: Telemetry | None
    sessions: int
    sent: int
    superseded: int
    unsent: int
    received: int
    accepted: int
    dropped: Mapping[str, int]
    refused: str = ""
    other_program: str = ""
    starts: int = 0
    key: int | None = None
    drives_home: bool = False
    wanted: Wanted = Wanted.IDLE
    ordered_ns: int = 0
    held: str = ""
    defects: int = 0

    @property
    def holdable(self) -> bool:
        """Whether it alone can be paused: the original's client has no session, and cannot."""
        return not self.connected or self.sessions > 0

    @property
    def lit(self) -> bool:
        """Whether LEDs of its red ring are on, as far as it has reported."""
        return self.telemetry is not None and bool(self.telemetry.leds & RING_LEDS)


THROTTLED: dict[str, str] = {
    **{"refused": "refused", "protocol_error": "no robot", "doubt": "doubted"},
    "defect": "ended by a defect in vsense",
}
"""Kinds of events that anybody can cause, and how they are called where they are only counted."""


class EventThrottle:
    """Passes events on; only a few refusals, protocol errors, doubts, defects in `EVENT_REPEAT_NS`.

    A refused robot tries again every second, and anybody can send garbage: such events would hide
    the others. The same text is told once in that time. Of different ones each expected robot has
    few, and all strangers together; what strangers do beyond that is counted.

    Args:
        on_event: takes events; must not wait.
        expected: tags of the experiment's robots.
        port: what events are of, for people.
    """

    def __init__(
        self,
        on_event: Callable[[LinkEvent], None],
        expected: Collection[int] = (),
        port: str = "robots' port",
    ) -> None:
        self._on_event = on_event
        self._expected = frozenset(expected)
        self._sent: dict[tuple[int | None, EventKind, str], int] = {}
        self._now_ns = 0
        self._log = StrangerLog(port, self._report)

    def expect(self, tags: Collection[int]) -> None:
        """Other robots are the experiment's from now on."""
        self._expected = frozenset(tags)

    def notify(self, event: LinkEvent) -> None:
        """Calls `on_event`, unless the event is one of too many."""
        deed, now_ns = THROTTLED.get(event.kind), event.time_ns
        if deed is None:
            self._on_event(event)
            return
        self.tick(now_ns)
        of = event.tag if event.tag in self._expected else None
        key = (of, event.kind, event.text)
        most = LINES_OF_STRANGERS if of is None else LINES_OF_ROBOT
        if key not in self._sent and sum(other[0] == of for other in self._sent) < most:
            self._sent[key] = now_ns
            self._on_event(event)
        elif of is None:
            self._log.count(event.origin or "somebody", deed, now_ns)

    def tick(self, now_ns: int) -> None:
        """Forgets what was told long ago, and tells what was counted; to be called often."""
        self._now_ns = now_ns
        self._sent = {k: ns for k, ns in self._sent.items() if now_ns - ns < EVENT_REPEAT_NS}
        self._log.tick(now_ns)

    def _report(self, text: str) -> None:
        self._on_event(LinkEvent("protocol_error", None, text, self._now_ns))


def cut_text(text: str) -> str:
    """Shortens a line to what REFUSE and GOODBYE can carry."""
    data = text.encode()
    return text if len(data) <= TEXT_MAX else data[:TEXT_MAX].decode(errors="ignore")


UPTIME_SLACK_S, UPTIME_DRIFT = 3.0, 0.002
"""A board's uptime may lag behind the host's clock by so much and by this share, and is the same
start's: clocks that nobody slews drift by 250 ppm at most, and HELLO has whole seconds."""


def switched_on_again(before: Hello, now: Hello, span_s: float) -> str:
    """Whether a robot's board was switched on again between two greetings, for people; "": no.

    So it is when its battery is swapped. `span_s` is the time between them by the host's clock.
    """
    least_s = (before.uptime_s + span_s) * (1.0 - UPTIME_DRIFT) - UPTIME_SLACK_S
    if before.started == now.started or now.uptime_s >= least_s:
        return ""
    return f"was switched on again (battery swapped?), up for {now.uptime_s} s; "


@dataclass(frozen=True, slots=True)
class LinkFigures:
    """One robot's link over a time; None is unknown.

    Attributes:
        heard_s: of the time, how long after the first packet.
        packets: telemetry that came.
        loss_up, loss_down: share of packets from the robot (of which most leave twice), and to it,
            that were lost, 0..1.
        round_trip_p50_ms, round_trip_p99_ms: without the time that the robot held the echo.
        jitter_ms: mean difference of two successive packets' times on their way (RFC 3550, 6.4.1).
        gap_ms: longest time in which nothing was heard.
        stale: how often the robot said that its wheels are held: what it heard was too old.
        late: control steps that began late, as a share, 0..1.
        signal_dbm: the median signal; `weakest_dbm` the weakest one.
        bit_rate_mbit_s: the median bit rate.
        retries: frames that the radio gave up meanwhile.
        power_saving: whether it was on at some time.
        sessions: that were opened; more than one: the link broke.
    """

    heard_s: float = 0.0
    packets: int = 0
    loss_up: float | None = None
    loss_down: float | None = None
    round_trip_p50_ms: float | None = None
    round_trip_p99_ms: float | None = None
    jitter_ms: float | None = None
    gap_ms: float | None = None
    stale: int = 0
    overruns: int = 0
    late: float | None = None
    signal_dbm: float | None = None
    weakest_dbm: int | None = None
    bit_rate_mbit_s: float | None = None
    retries: int | None = None
    power_saving: bool | None = None
    sessions: int = 0
