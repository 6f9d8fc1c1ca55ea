"""Reads a recording once and keeps what a report needs: little, however long it is."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor import recording
from vsense.monitor.recording.form import ORDERS_TOPIC, PARTS, RunMessage
from vsense.monitor.recording.measures import count_swarm
from vsense.monitor.recording.reader import Recording
from vsense.studies.report._facts import MOST_ASPECT, MOST_M, Facts, clock_ns, number, read_facts
from vsense.studies.report._flow import FINE, UNSEEN, CameraCounts, Flow, SeenRobots, Strips
from vsense.world.entities import Arena

MAP_CELL_M = 0.05
"""Occupancy is counted in squares of this side."""
STILL_M = 0.005
"""Shorter moves count once they add up to this: a standing robot's pose has noise."""
WAY_BREAK_NS = 1_000_000_000
"""A way that was not seen for longer is neither drawn nor counted."""
MOST_POINTS = 4_000
"""A robot's way with so many points is thinned to half of them."""


class RobotTrack:
    """One robot's way, from one sighting to the next.

    Attributes:
        seen: timesteps in which it was seen.
        distance_m: driven, along sightings at least `STILL_M` apart.
        followed_s: time between sightings that `distance_m` was driven in.
        longest_unseen_s: the longest time without a sighting, pauses left out.
        last_ns: when it was seen last.
    """

    def __init__(self) -> None:
        self.seen = 0
        self.distance_m = self.followed_s = self.longest_unseen_s = 0.0
        # x and y in turns: a tuple for each point would take seven times the memory.
        self._points = array("d")
        self._spacing_m = STILL_M
        self._most = MOST_POINTS
        self._anchor: tuple[float, float] | None = None
        self._stored: tuple[float, float] | None = None
        self._last: tuple[float, float] | None = None
        self.last_ns = 0

    @property
    def points_m(self) -> Floats:
        """The way, (n, 2) arena frame; a row of NaN is where it was not seen for a while."""
        return np.array([*self._points, *(self._last or ())], np.float64).reshape(-1, 2)

    def add(self, time_ns: int, x_m: float, y_m: float) -> None:
        """Adds a sighting."""
        self.seen += 1
        here = (x_m, y_m)
        if self._anchor is not None:
            unseen_ns = time_ns - self.last_ns
            self.longest_unseen_s = max(self.longest_unseen_s, unseen_ns / 1e9)
            if unseen_ns > WAY_BREAK_NS:
                self.lift()
            else:
                self.followed_s += unseen_ns / 1e9
        if self._anchor is None:
            self._anchor = here
            self._keep(here)
        else:
            step_m = math.dist(self._anchor, here)
            if step_m >= STILL_M:
                self.distance_m += step_m
                self._anchor = here
        if self._stored is None or math.dist(self._stored, here) >= self._spacing_m:
            self._keep(here)
        self._last, self.last_ns = here, time_ns

    def lift(self) -> None:
        """Ends the present piece of the way: the next is not joined to it."""
        if self._last is not None:
            self._points.extend((*self._last, math.nan, math.nan))
        self._anchor = self._stored = self._last = None

    def _keep(self, here: tuple[float, float]) -> None:
        self._stored = here
        self._points.extend(here)
        if len(self._points) >= 2 * self._most:
            self._spacing_m *= 2.0
            points = np.array(self._points).reshape(-1, 2)
            thinned = points[(np.arange(len(points)) % 2 == 0) | np.isnan(points[:, 0])]
            self._points = array("d", thinned.ravel())
            self._most = max(MOST_POINTS, 2 * len(thinned))


class Tracks:
    """All robots' ways; `is_robot` distinguishes robots from objects by their tags.

    Attributes:
        of: the ways by tag.
        objects_m: where tagged objects were last, by tag.
        states: number of arena states.
        cells: robots' timesteps by square (column, row) of `MAP_CELL_M`; (0, 0) is at the origin.
        places_m: where the robots of the newest state were seen, by tag.
    """

    def __init__(self, is_robot: Callable[[int], bool]) -> None:
        self.of: dict[int, RobotTrack] = {}
        self.objects_m: dict[int, tuple[float, float]] = {}
        self.states = 0
        self.cells: Counter[tuple[int, int]] = Counter()
        self.places_m: dict[int, tuple[float, float]] = {}
        self._is_robot = is_robot

    def add(self, capture_ns: int, robots: Mapping[str, Any]) -> None:
        """Adds the robots of an arena state, in columns.

        KeyError, TypeError, ValueError if it is damaged; then nothing of it was added.
        """
        columns = (robots["tag"], robots["x_m"], robots["y_m"], robots["seen"])
        rows = [
            (int(tag), float(x), float(y))
            for tag, x, y, seen in zip(*columns, strict=True)
            if seen and _is_place(x) and _is_place(y)
        ]
        self.states += 1
        self.places_m = {}
        for tag, x_m, y_m in rows:
            if not self._is_robot(tag):
                self.objects_m[tag] = (x_m, y_m)
                continue
            self.places_m[tag] = (x_m, y_m)
            track = self.of.get(tag) or self.of.setdefault(tag, RobotTrack())
            track.add(capture_ns, x_m, y_m)
            self.cells[math.floor(x_m / MAP_CELL_M), math.floor(y_m / MAP_CELL_M)] += 1

    def lift(self) -> None:
        """Ends all pieces: during a pause the robots' moves do not count."""
        for track in self.of.values():
            track.lift()


def _is_place(value: Any) -> bool:
    parsed = number(value)
    return parsed is not None and abs(parsed) < MOST_M


MOST_TEXTS = 500

ConePoints = tuple[tuple[float, float], ...]


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
        events: messages for people, the first `MOST_TEXTS`.
        more_events: how many others there were.
        changes: of the world, by people, while the run went on.
        parts: who played which part, as far as uids were told, the first `MOST_TEXTS`.
        measures: by name, times since the run began [s] and values, (n,) each.
        latency_ns, latency_ms: capture times, and ages of pictures when the readings left, (n,).
    """

    def __init__(self, facts: Facts) -> None:
        self.facts = facts
        self.ran = False
        self.odd = 0
        self.world: Mapping[str, Any] = {}
        self.cones: dict[int, tuple[ConePoints, ConePoints]] = {}
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
            ORDERS_TOPIC: self._order,
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
        except DAMAGED:
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
            if seen_ns is not None and capture_ns - seen_ns > WAY_BREAK_NS:
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
            # The LEDs of one timestep ago: the robots report later than the world.
            counts = count_swarm(self.tracks.places_m, self.links.leds, cones)
            measures.setdefault(recording.IN_CONE, counts[recording.IN_CONE])
            measures.setdefault(recording.LIT_IN_CONE, counts[recording.LIT_IN_CONE])
        for name, value in measures.items():
            parsed = number(value)
            if parsed is not None:
                times, values = self.measures.setdefault(str(name), (array("d"), array("d")))
                times.append(time_s)
                values.append(parsed)

    def _readings(self, message: Message) -> None:
        if self._going and not self.facts.simulated:
            capture_ns = clock_ns(message.data["capture_ns"])
            self.latency_ns.append(capture_ns)
            self.latency_ms.append((message.time_ns - capture_ns) / 1e6)

    def _robots(self, message: Message) -> None:
        if self._going:
            self.strips.add(message.time_ns, self.links.add(message.time_ns, message.data))

    def _run(self, message: Message) -> None:
        run = RunMessage.read(message.data)
        self.state = run.state
        self.late = self.late if run.late is None else run.late

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
                self.parts += [row] * (len(self.parts) < MOST_TEXTS)

    def _event(self, message: Message) -> None:
        if len(self.events) >= MOST_TEXTS:
            self.more_events += 1
            return
        data = message.data
        level, by = str(data.get("level") or "info"), str(data.get("by") or "")
        self.events.append(RecordedEvent(message.time_ns, level, by, str(data["text"])))


def gather(recording: Recording, progress: Callable[[float], None]) -> Gatherer:
    """Reads a recording; `progress` takes now and then how many seconds of it were read."""
    gatherer = Gatherer(read_facts(recording.experiment))
    for place, message in enumerate(recording.messages(gatherer.topics)):
        gatherer.receive(message)
        if place % 500 == 0:
            progress((message.time_ns - recording.begin_ns) / 1e9)
    return gatherer


def read_cone(data: Mapping[str, Any]) -> ConePoints:
    """Reads a polluted triangle; KeyError, TypeError, ValueError if it is damaged."""
    corners = tuple((float(x), float(y)) for x, y in zip(data["x_m"], data["y_m"], strict=True))
    if len(corners) != 3 or not (np.abs(corners) < MOST_M).all():
        raise ValueError("expected a triangle")
    return corners
