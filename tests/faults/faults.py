"""What can befall a lab: each fault begins and ends, and promises what follows.

`FAULTS` has a function for each kind that draws one. Times in s; a place is a robot's.
"""

from __future__ import annotations

import os
import random
import re
import signal
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from tests.faults.relay import CALM, HOST, TCP, UDP, Weather
from tests.faults.stage import Stage
from vsense.robots.link.wire import Wanted

Draw = random.Random
SILENCE_S = 1.3
"""The host says by then that it hears nothing of a robot."""
SILENT = "nothing heard for 1 s"
QUARREL = r"reconnected|new session|lost|heard|obey|renewed|broke|connection|doubt"
"""What the host says where somebody has changed anything."""


@dataclass
class Fault:
    """Something that befalls a lab, and what is promised.

    Attributes:
        name: for the table.
        lasts_s: from its beginning to its end.
        stops: places of robots whose wheels stand within 450 ms and until its end.
        spared: places of robots that notice nothing.
        round_trip_s: of the network when the robots come back.
        says: what the host must say of it, a regular expression; "": anything or nothing.
        silent: what the host must not say from its beginning on, likewise.
        aftermath_s: for so long after its end the lab is watched; the wheels' log is written ten
            times per second.
        ends_late: it ends with what its end waits for.
    """

    name: str
    lasts_s: float
    stops: list[int] = field(default_factory=list)
    spared: list[int] = field(default_factory=list)
    round_trip_s: float = 0.0
    says: str = ""
    silent: str = ""
    aftermath_s: float = 0.25
    ends_late: bool = False

    def begin(self, stage: Stage) -> None:
        """Makes it happen."""

    def go_on(self, stage: Stage) -> None:
        """Is called again and again while it lasts."""
        time.sleep(0.02)

    def end(self, stage: Stage) -> None:
        """Undoes it."""


# --- the network


@dataclass
class Storm(Fault):
    """Weather between the host and the robots of some places."""

    up: Weather = CALM
    down: Weather = CALM
    places: list[int] = field(default_factory=list)

    def begin(self, stage: Stage) -> None:
        stage.relay.set(self.up, self.down, self.places)

    def end(self, stage: Stage) -> None:
        stage.relay.calm()


def _some(draw: Draw, stage: Stage) -> tuple[list[int], list[int]]:
    """All places or some, and the others."""
    all_ = list(stage.places)
    count = draw.choice([1, max(1, len(all_) // 2), len(all_)])
    some = sorted(draw.sample(all_, count))
    return some, [place for place in all_ if place not in some]


def partition(draw: Draw, stage: Stage) -> Fault:
    """Nothing gets through: both ways, or down alone."""
    some, others = _some(draw, stage)
    up = draw.choice([Weather(loss=1.0), CALM])
    name = "partition" if up.loss else "partition, down only"
    lasts_s = draw.uniform(0.6, 3.0)
    says = SILENT if up.loss and lasts_s > SILENCE_S else ""
    down = Weather(loss=1.0)
    return Storm(name, lasts_s, some, others, says=says, up=up, down=down, places=some)


def deaf_host(draw: Draw, stage: Stage) -> Fault:
    """Nothing gets up: robots hear the host, and go on as long as that is fresh."""
    some, others = _some(draw, stage)
    lasts_s = draw.uniform(0.6, 1.5)
    says, up = SILENT if lasts_s > SILENCE_S else "", Weather(loss=1.0)
    return Storm("partition, up only", lasts_s, [], others, says=says, up=up, places=some)


def blink(draw: Draw, stage: Stage) -> Fault:
    """Nothing gets through for so short that nobody minds."""
    all_ = list(stage.places)
    nothing = Weather(loss=1.0)
    lasts_s = draw.uniform(0.05, 0.15)
    return Storm("blink", lasts_s, [], all_, silent=QUARREL, up=nothing, down=nothing, places=all_)


def drizzle(draw: Draw, stage: Stage) -> Fault:
    """As bad as Wi-Fi mostly is: no wheel may notice."""
    all_ = list(stage.places)
    weather = Weather(
        loss=draw.uniform(0.0, 0.1),
        doubled=draw.uniform(0.0, 0.3),
        altered=draw.uniform(0.0, 0.05),
        delay_s=draw.uniform(0.0, 0.03),
        jitter_s=draw.uniform(0.0, 0.03),
    )
    lasts_s = draw.uniform(1.0, 2.0)
    return Storm(
        "drizzle", lasts_s, [], all_, silent=QUARREL, up=weather, down=weather, places=all_
    )


def storm(draw: Draw, stage: Stage) -> Fault:
    """Worse than Wi-Fi ever is."""
    some, others = _some(draw, stage)
    weather = [
        Weather(
            loss=draw.uniform(0.1, 0.5),
            doubled=draw.uniform(0.0, 0.5),
            altered=draw.uniform(0.0, 0.3),
            delay_s=draw.uniform(0.0, 0.1),
            jitter_s=draw.uniform(0.0, 0.1),
        )
        for _ in range(2)
    ]
    lasts_s = draw.uniform(1.0, 3.0)
    return Storm("storm", lasts_s, [], others, up=weather[0], down=weather[1], places=some)


def no_udp(draw: Draw, stage: Stage) -> Fault:
    """Datagrams are blocked: TCP carries on, and the robots drive again while it lasts."""
    some, others = _some(draw, stage)
    no = Weather(loss=1.0, only=UDP)
    return NoUdp("no UDP", 3.5, [], others, says="state goes over TCP", up=no, down=no, places=some)


@dataclass
class NoUdp(Storm):
    """The robots stand, and come back before its end."""

    def end(self, stage: Stage) -> None:
        stage.wait(lambda: stage.moving(self.places), "motion over TCP", 0.5)
        super().end(stage)


def no_tcp(draw: Draw, stage: Stage) -> Fault:
    """TCP is blocked, and nobody needs it."""
    all_ = list(stage.places)
    no = Weather(loss=1.0, only=TCP)
    lasts_s = draw.uniform(1.0, 2.5)
    return Storm("no TCP", lasts_s, [], all_, silent=QUARREL, up=no, down=no, places=all_)


def delay(draw: Draw, stage: Stage) -> Fault:
    """A longer way: robots stay connected, and stand where what they hear is too old."""
    all_ = list(stage.places)
    late = draw.choice([draw.uniform(0.1, 0.22), draw.uniform(0.44, 0.5)])
    stops, spared = (all_, []) if late > 0.3 else ([], all_)
    way = Weather(delay_s=late)
    return Storm(
        f"delay, {'stands' if stops else 'drives'}",
        draw.uniform(2.0, 3.5),
        *(stops, spared, 2.0 * late),
        silent=r"reconnected|new session|lost|nothing heard|renewed",
        **{"up": way, "down": way, "places": all_},
    )


# --- the robots' processes, and the host's


@dataclass
class Frozen(Fault):
    """A process is stopped, and goes on."""

    victim: Callable[[Stage], int] = lambda stage: 0
    _pid: int = 0

    def begin(self, stage: Stage) -> None:
        self._pid = self.victim(stage)
        os.kill(self._pid, signal.SIGSTOP)

    def end(self, stage: Stage) -> None:
        with suppress(ProcessLookupError):  # a stopped guard was replaced, and has ended
            os.kill(self._pid, signal.SIGCONT)


def _one(draw: Draw, stage: Stage) -> tuple[int, list[int], list[int]]:
    place = draw.choice(stage.places)
    return place, [place], [other for other in stage.places if other != place]


def frozen_worker(draw: Draw, stage: Stage) -> Fault:
    """A robot's worker hangs."""
    place, one, others = _one(draw, stage)
    lasts_s = draw.uniform(0.6, 2.5)
    says, victim = SILENT if lasts_s > SILENCE_S else "", lambda s: s.worker(place)
    return Frozen("SIGSTOP worker", lasts_s, one, others, says=says, victim=victim)


def frozen_guard(draw: Draw, stage: Stage) -> Fault:
    """A robot's guard hangs: it is replaced, and the robot drives on."""
    place, _, others = _one(draw, stage)
    lasts_s = draw.uniform(0.6, 2.0)
    return Frozen("SIGSTOP guard", lasts_s, [], others, victim=lambda s: s.guard(place))


def frozen_host(draw: Draw, stage: Stage) -> Fault:
    """The host hangs."""
    all_ = list(stage.places)
    return Frozen("SIGSTOP host", draw.uniform(0.6, 3.0), all_, victim=lambda s: s.lab.process.pid)


def frozen_cameras(draw: Draw, stage: Stage) -> Fault:
    """No picture comes; after 2 s the lab would end, as a lab without cameras does."""
    all_ = list(stage.places)
    lasts_s = draw.uniform(0.6, 1.5)
    return Frozen("SIGSTOP cameras", lasts_s, all_, victim=lambda s: s.helper("cameras"))


@dataclass
class Killed(Fault):
    """A robot's worker is killed, and started again; perhaps on a board with another clock."""

    place: int = 0
    clock: str = ""

    def begin(self, stage: Stage) -> None:
        os.kill(stage.worker(self.place), signal.SIGKILL)

    def end(self, stage: Stage) -> None:
        script = stage.script(self.place)
        if self.clock:
            options = r"--clock-offset-ns \S+ --clock-drift-ppm \S+"
            changed = re.sub(options, self.clock, script.read_text())
            script = script.with_suffix(".clock.sh")
            script.write_text(changed)
            script.chmod(0o755)
        stage.start_again(self.place, script)


def killed_worker(draw: Draw, stage: Stage) -> Fault:
    """A daemon dies, and somebody starts it again."""
    place, one, others = _one(draw, stage)
    lasts_s = draw.uniform(0.6, 1.2)
    says = "killed by SIGKILL|its connection"
    return Killed("SIGKILL worker", lasts_s, one, others, says=says, place=place)


def other_clock(draw: Draw, stage: Stage) -> Fault:
    """A board starts again, and its clock has jumped, and runs fast or slow."""
    place, one, others = _one(draw, stage)
    offset_ns = draw.randrange(-86_400 * 10**9, 86_400 * 10**9)
    clock = f"--clock-offset-ns {offset_ns} --clock-drift-ppm {draw.uniform(-500, 500):.1f}"
    return Killed("clock stepped", draw.uniform(0.6, 1.0), one, others, place=place, clock=clock)


@dataclass
class KilledGuard(Fault):
    """A guard is killed: its worker stops the wheels, replaces it, and drives on."""

    place: int = 0

    def begin(self, stage: Stage) -> None:
        os.kill(stage.guard(self.place), signal.SIGKILL)


def killed_guard(draw: Draw, stage: Stage) -> Fault:
    """A robot's guard dies."""
    place, _, others = _one(draw, stage)
    return KilledGuard("SIGKILL guard", 0.8, [], others, place=place)


@dataclass
class Anew(Killed):
    """A daemon starts again where the network is slow: it has to connect while that lasts."""

    late_s: float = 0.0
    ends_late: bool = True

    def begin(self, stage: Stage) -> None:
        way = Weather(delay_s=self.late_s)
        stage.relay.set(way, way, stage.places)
        super().begin(stage)

    def end(self, stage: Stage) -> None:
        said = len(stage.lab.said)
        super().end(stage)
        back = re.compile(rf"robot {stage.tags[self.place]}: .*reconnected")
        stage.wait(
            lambda: any(map(back.search, stage.lab.said[said:])),
            f"reconnection at a round trip of {2 * self.late_s:.2f} s",
            2.0 + 4.0 * 2.0 * self.late_s,
        )
        stage.relay.calm()


def slow_start(draw: Draw, stage: Stage) -> Fault:
    """A daemon starts at a round trip of up to 1 s."""
    place, one, _ = _one(draw, stage)
    late_s = draw.uniform(0.1, 0.5)
    return Anew("connects at a long delay", 0.8, one, [], 2.0 * late_s, place=place, late_s=late_s)


# --- attackers


@dataclass
class Attack(Fault):
    """Somebody who hears everything sends what he likes, and lies to both ends.

    The operator has paused the robots where `paused`: then nothing may set them going. Otherwise
    they run, and nothing may stop them. Who was made to believe in a sequence that is far ahead is
    deaf when nobody forges any more, and renews its session after a second.
    """

    aftermath_s: float = 2.0
    paused: bool = False
    flood: int = 0
    greets: bool = False
    _socks: list[socket.socket] = field(default_factory=list)

    def begin(self, stage: Stage) -> None:
        if self.paused:
            stage.order("pause")
        if self.greets:
            self._socks = stage.attacker.greet_again(HOST) + stage.attacker.squat(stage.tags, HOST)

    def go_on(self, stage: Stage) -> None:
        attacker, wanted = stage.attacker, Wanted.RUN if self.paused else Wanted.STOP
        for one in [one for one in list(attacker.sessions.values()) if one.state]:
            for ahead in (1, 500, 10**6):
                attacker.drive(one, ahead, wanted)
                attacker.deafen(one, ahead)
            for _ in range(self.flood):
                attacker.spoof(one.up, one.robot, one.host, os.urandom(100))
                attacker.spoof(one.down, one.host, one.robot, os.urandom(100))
        attacker.replay(50)
        time.sleep(0.03)

    def end(self, stage: Stage) -> None:
        for sock in self._socks:
            sock.close()
        if self.paused:
            stage.order("start")


def forger(draw: Draw, stage: Stage) -> Fault:
    """Forged orders and telemetry, and all that was heard once more."""
    all_ = list(stage.places)
    return Attack("forge, replay", draw.uniform(1.0, 2.0), [], all_, silent=QUARREL)


def thief(draw: Draw, stage: Stage) -> Fault:
    """Every robot's greeting once more, and greetings in its name, while all is forged."""
    all_ = list(stage.places)
    silent = r"reconnected|new session|lost|obey|renewed|broke"
    return Attack("steal sessions", draw.uniform(1.0, 2.5), [], all_, silent=silent, greets=True)


def flooder(draw: Draw, stage: Stage) -> Fault:
    """Thousands of datagrams of rubbish per second, to both ends."""
    all_ = list(stage.places)
    return Attack("flood", draw.uniform(1.0, 2.0), [], all_, silent=QUARREL, flood=4)


def rider(draw: Draw, stage: Stage) -> Fault:
    """Robots that were told to stand are told to run, by somebody else."""
    all_ = list(stage.places)
    silent = r"reconnected|new session|lost|obey|renewed|broke"
    return Attack("forge while paused", draw.uniform(1.0, 2.0), all_, silent=silent, paused=True)


FAULTS: dict[Callable[[Draw, Stage], Fault], int] = {
    partition: 4, deaf_host: 1, blink: 1, drizzle: 2, storm: 3, no_udp: 1, no_tcp: 1, delay: 3,
    frozen_worker: 2, frozen_guard: 1, frozen_host: 2, frozen_cameras: 1,
    killed_worker: 2, other_clock: 1, killed_guard: 2, slow_start: 2,
    forger: 1, thief: 1, flooder: 1, rider: 2,
}  # fmt: skip
"""The kinds, and how often each is drawn."""
