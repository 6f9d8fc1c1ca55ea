"""Reads a recording once and keeps what a report needs: little, however long it is."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vsense.base.message_bus import Message
from vsense.monitor.recording.form import ORDERS, PARTS, RunMessage
from vsense.monitor.recording.reader import Recording
from vsense.studies.report.facts import MOST_ASPECT, MOST_M, Facts, clock_ns, number, read_facts
from vsense.studies.report.flow import FINE, UNSEEN, CameraCounts, Flow, SeenRobots, Strips
from vsense.studies.report.tracks import UNSEEN_NS, Tracks
from vsense.world.entities import Arena

MOST_EVENTS = 500
IN_CONE, LIT_IN_CONE = "robots_in_cone", "lit_in_cone"
"""Measures that the report counts itself, where there is a pollutant: figures of chapter 5."""

Cone = tuple[tuple[float, float], ...]
ODD = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)
"""What a damaged message raises."""


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """A message for people: when, how bad, by whom, and the words."""

    time_ns: int
    level: str
    by: str
    text: str


@dataclass(frozen=True, slots=True)
class PlayedPart:
    """Which robot plays a part from a time on: tags, the part's name, and the robot's uid."""

    time_ns: int
    part: int
    name: str
    tag: int
    uid: str


class Gatherer:
    """What was found in a recording so far.

    Where there is a run, ways, measures, robots, latencies and silences are those of the run;
    where there is none, those of everything recorded.

    Attributes:
        ran: whether there is a run.
        odd: messages that could not be understood.
        world: the newest `/world`, as it came.
        cones: the first and the newest polluted triangle of each source.
        late: timesteps whose readings left late, as the run counted them; None unknown.
        state: the run's state at the recording's end, "" unknown.
        events: messages for people, the first `MOST_EVENTS`.
        more_events: how many others there were.
        changes: of the world, by people, while the run went on.
        parts: who played which part, as far as uids were told, the first `MOST_EVENTS`.
        measures: by name, times since the run began [s] and values, (n,) each.
        latency_ns, latency_ms: capture times, and ages of pictures when the readings left, (n,).
    """

    def __init__(self, facts: Facts) -> None:
        self.facts = facts
        self.ran = False
        self.odd = 0
        self.world: Mapping[str, Any] = {}
        self.cones: dict[int, tuple[Cone, Cone]] = {}
        self.late: int | None = None
        self.state = ""
        self.events: list[RecordedEvent] = []
        self.more_events = self.changes = 0
        self.parts: list[PlayedPart] = []
        self._going = True
        self._begin()
        self._takers: dict[str, Callable[[Message], None]] = {
            "/arena": self._arena,
            "/signals": self._signals,
            "/readings": self._readings,
            "/robots": self._robots,
            "/cameras": lambda m: self.cameras.add(m.time_ns, m.data),
            "/run": self._run,
            "/world": self._world,
            "/event": self._event,
            PARTS: self._parts,
            ORDERS: self._order,
        }

    def _begin(self) -> None:
        """Begins the run: what was before it does not count."""
        self.tracks, self.links = Tracks(self.facts.is_robot), SeenRobots(self.facts.robots)
        self.flow, self.cameras = Flow(), CameraCounts()
        self.latency_ns, self.latency_ms = array("q"), array("d")
        self.measures: dict[str, tuple[array[float], array[float]]] = {}
        self.strips = Strips(round(self.facts.timestep_s * 1e9))

    @property
    def arena(self) -> Arena:
        """The recorded arena; where it is unknown, the area that the robots needed."""
        if self.facts.arena is not None:
            return self.facts.arena
        points = np.concatenate([*(t.points_m for t in self.tracks.of.values()), np.zeros((0, 2))])
        points = points[(np.abs(points) < MOST_M).all(axis=1)]
        if not len(points):
            return Arena((1.0, 1.0, 0.0), (0.0, 0.0, 0.0))
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.maximum(high - low + 0.2, 0.2)
        x_m, y_m = np.maximum(size, size.max() / MOST_ASPECT).tolist()
        middle = ((low + high) / 2.0).tolist()
        return Arena((x_m, y_m, 0.0), (middle[0], middle[1], 0.0))

    @property
    def topics(self) -> frozenset[str]:
        """The topics that it reads."""
        return frozenset(self._takers)

    def receive(self, message: Message) -> None:
        """Adds a message; one that is damaged is counted and left out."""
        try:
            self._takers[message.topic](message)
        except ODD:
            self.odd += 1

    def _arena(self, message: Message) -> None:
        data = message.data
        run_timestep = data.get("run_timestep")
        run_timestep = run_timestep if isinstance(run_timestep, int) else -1
        capture_ns = clock_ns(data["capture_ns"])
        if run_timestep >= 0 and not self.ran:
            connected, self.ran = self.links.connected, True
            self._begin()
            self.links.connected = connected
        self._going = run_timestep >= 0 or not self.ran
        if not self._going:
            self.flow.pass_over(capture_ns)
            self.tracks.lift()
            return
        self.tracks.add(capture_ns, data["robots"])
        seen = self.tracks.places_m.keys()
        self.flow.add(capture_ns, run_timestep, len(seen), self.links.connected)
        if not self.links.of:
            self.strips.add(capture_ns, dict.fromkeys(seen, FINE))
        self._miss(capture_ns)

    def _miss(self, capture_ns: int) -> None:
        """Notes which robots have not been seen for longer than a moment."""
        since = {}
        for tag in self.facts.robots or self.tracks.of:
            track = self.tracks.of.get(tag)
            seen_ns = track.last_ns if track is not None else self.flow.begin_ns
            if seen_ns is not None and capture_ns - seen_ns > UNSEEN_NS:
                since[tag] = seen_ns
        self.strips.add(capture_ns, dict.fromkeys(since, UNSEEN), since)

    def _signals(self, message: Message) -> None:
        if not self._going:
            return
        data = message.data
        time_s, begin_ns = number(data.get("time_s")), self.flow.begin_ns
        if not self.ran or time_s is None:
            time_s = (message.time_ns - (message.time_ns if begin_ns is None else begin_ns)) / 1e9
        measures = dict(data.get("measures") or {})
        cones = [read_cone(cone) for cone in data.get("cones") or []]
        for number_, cone in enumerate(cones):
            self.cones[number_] = (self.cones.get(number_, (cone, cone))[0], cone)
        if self.cones:
            places = self.tracks.places_m.items()
            inside = [tag for tag, at in places if any(_holds(cone, at) for cone in cones)]
            measures.setdefault(IN_CONE, len(inside))
            # The LEDs of one timestep ago: the robots report later than the world.
            measures.setdefault(LIT_IN_CONE, sum(tag in self.links.lit for tag in inside))
        for name, value in measures.items():
            known = number(value)
            if known is not None:
                times, values = self.measures.setdefault(str(name), (array("d"), array("d")))
                times.append(time_s)
                values.append(known)

    def _readings(self, message: Message) -> None:
        if self._going and not self.facts.simulated:
            capture_ns = clock_ns(message.data["capture_ns"])
            self.latency_ns.append(capture_ns)
            self.latency_ms.append((message.time_ns - capture_ns) / 1e6)

    def _robots(self, message: Message) -> None:
        if self._going:
            self.strips.add(message.time_ns, self.links.add(message.time_ns, message.data))

    def _run(self, message: Message) -> None:
        told = RunMessage.read(message.data)
        self.state = told.state
        self.late = self.late if told.late is None else told.late

    def _world(self, message: Message) -> None:
        self.world = message.data

    def _order(self, message: Message) -> None:
        self.changes += isinstance(message.data["change"], dict)

    def _parts(self, message: Message) -> None:
        newest = {row.part: (row.tag, row.uid) for row in self.parts}
        columns = (message.data[name] for name in ("part", "name", "tag", "uid"))
        for part, name, tag, uid in zip(*columns):
            row = PlayedPart(message.time_ns, int(part), str(name), int(tag), str(uid or ""))
            if row.uid and newest.get(row.part) != (row.tag, row.uid):
                self.parts += [row] * (len(self.parts) < MOST_EVENTS)

    def _event(self, message: Message) -> None:
        if len(self.events) >= MOST_EVENTS:
            self.more_events += 1
            return
        data = message.data
        level, by = str(data.get("level") or "info"), str(data.get("by") or "")
        self.events.append(RecordedEvent(message.time_ns, level, by, str(data["text"])))


def gather(recording: Recording, progress: Callable[[float], None]) -> Gatherer:
    """Reads a recording; `progress` takes now and then how many seconds of it were read."""
    found = Gatherer(read_facts(recording.experiment))
    for place, message in enumerate(recording.messages(found.topics)):
        found.receive(message)
        if place % 500 == 0:
            progress((message.time_ns - recording.begin_ns) / 1e9)
    return found


def read_cone(data: Mapping[str, Any]) -> Cone:
    """Reads a polluted triangle; KeyError, TypeError, ValueError if it is damaged."""
    corners = tuple((float(x), float(y)) for x, y in zip(data["x_m"], data["y_m"], strict=True))
    if len(corners) != 3 or not (np.abs(corners) < MOST_M).all():
        raise ValueError("expected a triangle")
    return corners


def _holds(cone: Cone, at: tuple[float, float]) -> bool:
    """Whether a point lies in a triangle, its border included."""
    turns = [
        (bx - ax) * (at[1] - ay) - (by - ay) * (at[0] - ax)
        for (ax, ay), (bx, by) in zip(cone, (*cone[1:], cone[0]), strict=True)
    ]
    return min(turns) >= 0.0 or max(turns) <= 0.0
