"""Measures robots' links under an experiment's packets, while all wheels stand still.

`vsense robot link` loads them as a run does; before a run, `RunLinkCheck` measures the run's own.

Every robot gets packets of the experiment's sizes at its rate, with readings that nobody looks at,
and answers with its actuators. It is to drive home (`c_src/PROTOCOL.md`, section 11) to where it
stands: so it makes its control steps, asks its base and tells the host as in a run, and neither a
controller nor a wheel moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from threading import Event
from typing import Any

from vsense.base.clock import host_ns
from vsense.base.terminal import aligned, figure
from vsense.config.specs import ControllerSpec
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import LinkError, LinkEvent, LinkFigures, RobotStatus
from vsense.robots.link.table import Direction, Entry, ExpectedRobot, Table
from vsense.robots.link.wire import GoodbyeCause, ReadingValues, Wanted

STILL_S = 0.1
"""After STOP: its three packets leave."""


def traffic_of(controller: ControllerSpec) -> Table:
    """The sensor table of the robots of a controller, as a run has it."""
    sensors = [(m.sensor.name, m.sensor.layout, Direction.SENSOR) for m in controller.sensors]
    actuators = [
        (m.actuator.name, m.actuator.layout, Direction.ACTUATOR) for m in controller.actuators
    ]
    return Table(Entry(number, *row) for number, row in enumerate(sensors + actuators, 1))


class LinkLoad:
    """A host of robots that stand; a context that says goodbye to them.

    Args:
        robots: by tag, with the table of their traffic.
        timestep_ns: how often readings leave.
        address: interface and port; 0 takes a free one.
        trust: which robots are believed.
        say: takes what happens to links.

    Attributes:
        port: that robots connect to.

    Raises:
        LinkError: another server has the port, or the host is not this machine's.
    """

    def __init__(
        self,
        robots: Mapping[int, ExpectedRobot],
        timestep_ns: int,
        address: tuple[str, int],
        trust: LinkTrust,
        say: Callable[[str], None],
    ) -> None:
        self._say, self._over = say, False
        self._dt_ns = timestep_ns
        self._server = VirtualSensorServer(
            host=address[0],
            port=address[1],
            timestep_ns=timestep_ns,
            seed=1,
            expected=robots,
            trust=trust,
            on_event=self._on_event,
        )
        self._payloads = {
            tag: [bytes(size) for _, _, size in robot.table.of_direction(Direction.SENSOR)]
            for tag, robot in robots.items()
        }
        self._timestep = 0
        self.port = self._server.start()

    def __enter__(self) -> LinkLoad:
        return self

    def __exit__(self, *exception: object) -> None:
        self._over = True
        with suppress(LinkError):
            self._server.command(Wanted.STOP)
            Event().wait(STILL_S)
        self._server.close(GoodbyeCause.END, "the link was measured")

    def wait(self, limit_s: float, interrupted: Event, progress: Callable[[str], None]) -> int:
        """Waits until all robots are connected, for so long at most; gives how many are."""
        end_ns, there = host_ns() + round(1e9 * limit_s), 0
        while host_ns() < end_ns and there < len(self._payloads) and not interrupted.wait(0.1):
            there = sum(status.connected for status in self.robots().values())
            progress(f"{there} of {len(self._payloads)} robots connected")
        return there

    def load(self, duration_s: float, interrupted: Event, progress: Callable[[str], None]) -> float:
        """Sends readings every timestep, for so long or until it is interrupted.

        Returns:
            How long it did [s].

        Raises:
            LinkError: the server's thread has failed.
        """
        self._server.command(Wanted.HOME)
        self._server.measure()
        began_ns = host_ns()
        due_ns, end_ns = began_ns, began_ns + round(1e9 * duration_s)
        while due_ns < end_ns and not interrupted.wait(max(0, due_ns - host_ns()) / 1e9):
            now_ns = host_ns()
            self._send(now_ns)
            there = sum(status.connected for status in self.robots().values())
            progress(
                f"{(now_ns - began_ns) / 1e9:.0f} of {duration_s:g} s,"
                f" {there} of {len(self._payloads)} robots connected, wheels stand still"
            )
            due_ns += self._dt_ns * max(1, 1 + (host_ns() - due_ns) // self._dt_ns)
        return min(host_ns() - began_ns, end_ns - began_ns) / 1e9

    def robots(self) -> dict[int, RobotStatus]:
        """The robots now, by tag."""
        return self._server.robots()

    def measured(self) -> dict[int, LinkFigures]:
        """What the links were since `load` began, by tag."""
        return self._server.measured()

    def _send(self, now_ns: int) -> None:
        """A timestep's readings; that nobody has a goal says to stand."""
        self._timestep += 1
        values: dict[int, ReadingValues] = {
            tag: [(payload, now_ns) for payload in payloads]
            for tag, payloads in self._payloads.items()
        }
        self._server.publish(self._timestep, now_ns, values)

    def _on_event(self, event: LinkEvent) -> None:
        if not self._over and event.kind != "connected":
            self._say(event.text)


SILENCE_MS = 400.0
"""Wheels stop after this long without fresh readings (`c_src/PROTOCOL.md`, section 5)."""

LATE_SHARE = 0.01
"""So many control steps may begin late."""

LONG_GAP_MS = 250.0
"""A longer silence has come near the one that stops wheels."""

WEAK_DBM = -75.0
"""Below it radios fall back to their slowest rates, and lose frames at these."""

LOSS_SHARE = 0.1
"""More loss than this is worth a word, also where packets come often enough."""

DEPLOY_COMMAND = "vsense robot deploy"


@dataclass(frozen=True, slots=True)
class LinkVerdict:
    """One robot's link.

    Attributes:
        holds: it would hold the experiment's timestep.
        verdict: why not, or that it does.
        advice: what helps; "": nothing is to be done.
        uid: 32 hexadecimal digits; "": not known.
        udp: readings go by UDP.
    """

    tag: int
    name: str
    holds: bool
    verdict: str
    advice: str
    uid: str
    udp: bool
    figures: LinkFigures

    @property
    def badness(self) -> tuple[float, ...]:
        """What sorts the worst link last."""
        f = self.figures
        numbers = (f.stale, f.gap_ms, f.round_trip_p99_ms, f.late, f.loss_down)
        return (
            *(not self.holds, bool(self.advice), not f.packets),
            *(value or 0.0 for value in numbers),
        )

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        names = ("tag", "name", "uid", "holds", "verdict", "advice", "udp")
        return {name: getattr(self, name) for name in names} | asdict(self.figures)


def judge(status: RobotStatus, figures: LinkFigures, timestep_s: float) -> LinkVerdict:
    """Judges one robot's link.

    Args:
        status: how it is at the end.
        figures: what was measured.
        timestep_s: of the experiment.
    """
    period_ms = 1e3 * timestep_s
    wrong = _wrong(status, figures, period_ms)
    uid = "" if status.uid is None else status.uid.hex()
    return LinkVerdict(
        tag=status.tag,
        name=status.name,
        holds=not wrong,
        verdict=wrong or f"holds {period_ms:g} ms{_gap_words(figures)}",
        advice=_advice(status, figures, bool(wrong)),
        uid=uid,
        udp=status.udp,
        figures=figures,
    )


def _gap_words(f: LinkFigures) -> str:
    gap_ms = f.gap_ms or 0.0
    return f", but nothing was heard for {gap_ms / 1e3:.2f} s" if gap_ms > LONG_GAP_MS else ""


def _wrong(status: RobotStatus, f: LinkFigures, period_ms: float) -> str:
    """Why it would not hold a timestep; "": it would."""
    if not f.packets:
        return "turned away" if status.refused else "not connected"
    if (f.gap_ms or 0.0) >= SILENCE_MS:
        return f"nothing heard for {(f.gap_ms or 0.0) / 1e3:.1f} s: its wheels would have stopped"
    if f.stale:
        times = "once" if f.stale == 1 else f"{f.stale} times"
        return f"readings came too late: its wheels would have stopped {times}"
    if (f.round_trip_p99_ms or 0.0) > period_ms:
        return f"1 of 100 round trips takes longer than the timestep of {period_ms:g} ms"
    if (f.late or 0.0) > LATE_SHARE:
        return f"{100 * (f.late or 0.0):.1f} % of its control steps began late"
    return ""


def _advice(status: RobotStatus, f: LinkFigures, fails: bool) -> str:
    """What helps first."""
    if not f.packets:
        near = "is it on, in this network, and told this address and port?"
        return status.refused or f"{near} {DEPLOY_COMMAND} --check"
    if f.power_saving:
        return f"power saving is on: {DEPLOY_COMMAND} turns it off"
    if f.signal_dbm is not None and f.signal_dbm < WEAK_DBM:
        return f"{f.signal_dbm:.0f} dBm is weak: bring the access point nearer, or above the arena"
    if not status.udp and status.connected:
        return "no UDP gets through: let UDP of the same port in, at firewall and access point"
    lossy = max(f.loss_up or 0.0, f.loss_down or 0.0) > LOSS_SHARE
    if lossy or (f.gap_ms or 0.0) > LONG_GAP_MS or (fails and f.stale):
        return "the air is busy, or something is in the way: another channel, 5 GHz, fewer users"
    if fails and (f.late or 0.0) > LATE_SHARE:
        return "the board is late: end what else runs on it (top), or take a longer timestep"
    if fails:
        return "packets wait somewhere: nothing else on this access point, no repeater, no VPN"
    return ""


class RunLinkCheck:
    """Measures the links before a run, under its own packets; robots are to stand meanwhile.

    Args:
        server: of the run.
        span_s: for so long; 0: not at all.
        timestep_s: of the experiment.
        say: takes the result.

    Attributes:
        verdicts: of all robots, when it is over.
    """

    def __init__(
        self,
        server: VirtualSensorServer,
        span_s: float,
        timestep_s: float,
        say: Callable[[str], None],
    ) -> None:
        self.verdicts: list[LinkVerdict] = []
        self._server, self._span_s, self._timestep_s = server, span_s, timestep_s
        self._say, self._began_ns = say, 0

    def __call__(self) -> str:
        """How far it is, for people; "": it is over. It begins when it is asked first."""
        if not self._span_s:
            return ""
        now_ns = host_ns()
        if not self._began_ns:
            self._server.measure()
            self._began_ns = now_ns
        spent_s = (now_ns - self._began_ns) / 1e9
        if spent_s < self._span_s:
            return f"links are measured: {spent_s:.0f} of {self._span_s:g} s, wheels stand still"
        if not self.verdicts:
            figures, robots = self._server.measured(), self._server.robots()
            # The original's client has no session, and nothing of it is measured.
            there = [tag for tag in figures if robots[tag].holdable]
            self.verdicts = [judge(robots[tag], figures[tag], self._timestep_s) for tag in there]
            self._say(f"links over {self._span_s:g} s:\n{table(self.verdicts)}")
            self._say("late control steps are not in it: robots make none yet (vsense robot link)")
        return ""

    @property
    def cut_short(self) -> bool:
        """Whether it has begun and has not come to its end."""
        return bool(self._began_ns) and not self.verdicts

    @property
    def words(self) -> str:
        """What is wrong with links, for a run's note; "": nothing, or they were not measured."""
        bad = [verdict for verdict in self.verdicts if verdict.advice and verdict.figures.packets]
        return "; ".join(f"robot {v.tag} before the run: {v.verdict}, {v.advice}" for v in bad)


def worst(verdicts: Sequence[LinkVerdict]) -> LinkVerdict | None:
    """The worst link; None where there is none."""
    return max(verdicts, key=lambda verdict: verdict.badness, default=None)


HEADS = (
    *("robot", "loss to/from", "round trip", "p99", "jitter", "gap", "signal", "Mbit/s"),
    *("given up", "sleeps", "late", "verdict"),
)


def table(verdicts: Sequence[LinkVerdict]) -> str:
    """A line for each robot, below them what helps, and the worst one's name."""
    lines = aligned([HEADS, *(_cells(verdict) for verdict in verdicts)])
    for verdict in verdicts:
        if verdict.advice:
            lines.append(f"{verdict.tag} {verdict.name}: {verdict.advice}")
    last = worst(verdicts)
    if last is not None and len(verdicts) > 1:
        lines.append(f"the worst link: {last.tag} {last.name}: {last.verdict}")
    bad = sum(not verdict.holds for verdict in verdicts)
    lines.append(f"{len(verdicts) - bad} of {len(verdicts)} robots would hold the experiment")
    return "\n".join(lines)


def _cells(verdict: LinkVerdict) -> tuple[str, ...]:
    f = verdict.figures
    loss = f"{figure(f.loss_down, ' / ', 1, 100.0)}{figure(f.loss_up, ' %', 1, 100.0)}"
    return (
        f"{verdict.tag} {verdict.name}",
        loss if f.packets else "-",
        figure(f.round_trip_p50_ms, " ms", 1),
        figure(f.round_trip_p99_ms, " ms", 1),
        figure(f.jitter_ms, " ms", 1),
        figure(f.gap_ms, " ms", 0),
        figure(f.signal_dbm, " dBm", 0),
        figure(f.bit_rate_mbit_s, "", 1),
        figure(f.retries, "", 0),
        {True: "YES", False: "no", None: "-"}[f.power_saving],
        figure(f.late, " %", 1, 100.0),
        f"{'' if verdict.holds else 'FAILS: '}{verdict.verdict}",
    )


def as_json(verdicts: Sequence[LinkVerdict], facts: Mapping[str, Any]) -> dict[str, Any]:
    """The whole report for programs; `facts` say what was measured how."""
    last = worst(verdicts)
    return {
        **facts,
        "holds": all(verdict.holds for verdict in verdicts),
        "worst": None if last is None else last.tag,
        "robots": [verdict.as_json() for verdict in verdicts],
    }
