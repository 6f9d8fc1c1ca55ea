"""What a recording's messages say, as moments that can be drawn.

A message that is damaged is passed over: the one before it holds on.
"""

from __future__ import annotations

import base64
import math
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from dataclasses import fields as fields_of
from typing import Any

import cv2
import numpy as np

from vsense.base.arena import Floats
from vsense.base.message_bus import DAMAGED, Message
from vsense.config.arena import floor_picture
from vsense.monitor.pictures._scene import ArenaMoment, Senses
from vsense.monitor.pictures.run_samples import WorldSnapshot, floor_raster, grid, make_snapshot
from vsense.monitor.recording import IN_CONE, LIT_IN_CONE
from vsense.monitor.recording.form import ExperimentMessage
from vsense.monitor.recording.measures import count_swarm
from vsense.robots.link.status import RING_LEDS
from vsense.world.entities import (
    Arena,
    Box,
    Cylinder,
    Entity,
    Led,
    Light,
    VirtualRobot,
    WorldError,
    Zone,
)
from vsense.world.fields import Floor
from vsense.world.robot_models import EPUCK

_KINDS: dict[str, type[Entity]] = {
    "box": Box, "cylinder": Cylinder, "light": Light, "zone": Zone, "robot": VirtualRobot,
}  # fmt: skip
_STATES_MAX = 150
"""Arena states that a picture may belong to: pictures come later than their states."""
_TRAIL = 40
_LEAST_M, _MOST_M, _FARTHEST_M = 1e-2, 1e4, 1e6
_WORDS = 4


@dataclass(frozen=True, slots=True)
class _State:
    """One arena state with what was known when it came."""

    capture_ns: int
    moment: ArenaMoment


class RecordedScenes:
    """The newest state of everything that is drawn; `robot` is whose senses are.

    Attributes:
        arena: what is drawn.
        name: the experiment's.
        state, time_s: of the run: its state in one word, the time since its beginning or None.
        measures: by name, times since the run's beginning [s] and values.
    """

    def __init__(self, experiment: Mapping[str, Any], robot: int | None = None) -> None:
        """`experiment` is the data of `/experiment`; ValueError: it has no arena."""
        facts = ExperimentMessage.read(experiment)
        self.arena = _arena_of(facts.arena or {})
        self._grid = grid(self.arena)
        self.name = facts.name or facts.command
        self.state = ""
        self.time_s: float | None = None
        self.measures: dict[str, tuple[list[float], list[float]]] = {}
        self._facts, self._robot = facts, robot
        self._timestep_s = facts.timestep_s or 0.0
        self._before, self._newest = (-1, 0), -1
        self._heights = _lengths(facts.robots, "height_m")
        self._radii = _lengths(facts.robots, "radius_m")
        tags = (thing.get("tag") for thing in facts.objects)
        self._objects = {tag for tag in tags if isinstance(tag, int)}
        self._entities: list[Entity] = []
        self._floor: Any = None
        self._fields: list[Floats] = []
        self._signals: Mapping[str, Any] = {}
        self._leds: dict[int, int] = {}
        self._readings: Mapping[str, Any] = {}
        self._peaks: dict[str, float] = {}
        self._trails: deque[dict[int, tuple[float, float]]] = deque(maxlen=_TRAIL)
        self._states: deque[_State] = deque(maxlen=_STATES_MAX)
        self._takers = {
            "/world": self._world, "/fields": self._spread, "/signals": self._signal,
            "/readings": self._read, "/robots": self._status, "/run": self._run,
            "/arena": self._see,
        }  # fmt: skip

    @property
    def topics(self) -> Iterable[str]:
        """The messages that it wants."""
        return self._takers.keys()

    def take(self, message: Message) -> None:
        """Takes one message, in the order of the recording."""
        with suppress(*DAMAGED, WorldError, cv2.error):
            self._takers[message.topic](message.data)

    def moment(self) -> ArenaMoment | None:
        """The newest; None before the first arena state."""
        return self._states[-1].moment if self._states else None

    def moment_at(self, capture_ns: int) -> ArenaMoment | None:
        """The one that is nearest to a picture's capture."""
        near = min(self._states, key=lambda s: abs(s.capture_ns - capture_ns), default=None)
        return None if near is None else near.moment

    def _world(self, data: Mapping[str, Any]) -> None:
        self._entities = [e for e in map(_entity, data["entities"]) if e is not None]
        floor = _floor(data.get("floor"))
        zones = [e for e in self._entities if isinstance(e, Zone)]
        self._floor = floor_raster(floor.with_zones(zones), self.arena)

    def _spread(self, data: Mapping[str, Any]) -> None:
        self._fields = [_field(row, *self._grid) for row in data["fields"]]

    def _status(self, data: Mapping[str, Any]) -> None:
        self._leds = dict(zip(data["tag"], data["leds"], strict=True))

    def _read(self, data: Mapping[str, Any]) -> None:
        self._readings = data

    def _run(self, data: Mapping[str, Any]) -> None:
        self.state = str(data.get("state", ""))

    def _signal(self, data: Mapping[str, Any]) -> None:
        self._signals = data
        for name, value in dict(data.get("measures") or {}).items():
            self._measure(str(name), float(data["time_s"]), value)

    def _measure(self, name: str, time_s: float, value: Any) -> None:
        if isinstance(value, (int, float)) and math.isfinite(value):
            times, values = self.measures.setdefault(name, ([], []))
            if times and time_s < times[-1]:
                # Another run began.
                times.clear()
                values.clear()
            times.append(time_s)
            values.append(float(value))

    def _see(self, data: Mapping[str, Any]) -> None:
        """Makes the moment of an arena state."""
        columns = data["robots"]
        names = ("tag", "x_m", "y_m", "yaw_rad")
        rows = [row for row in zip(*(columns[n] for n in names), strict=True) if None not in row]
        robots = [row for row in rows if row[0] not in self._objects]
        things = [row[1:3] for row in rows if row[0] in self._objects]
        poses = np.array([row[1:] for row in robots], np.float64).reshape(-1, 3)
        tags = [row[0] for row in robots]
        lit = np.array([bool(self._leds.get(tag, 0) & RING_LEDS) for tag in tags], bool)
        snapshot = self._snapshot(tags)
        self._trails.append({tag: (x, y) for tag, (x, y, _) in zip(tags, poses.tolist())})
        middle = np.array([*self.arena.centre_m[:2], 0.0])
        capture_ns = int(data["capture_ns"])
        self.time_s = self._run_time_s(int(data.get("run_timestep", -1)), capture_ns)
        moment = ArenaMoment(
            title="",
            note="",
            view=None,
            snapshot=snapshot,
            poses=poses - middle,
            lit=lit,
            trails=self._ways(tags) - middle[:2],
            heights_m=np.array([self._heights.get(tag, EPUCK.height_m) for tag in tags]),
            radii_m=np.array([self._radii.get(tag, EPUCK.radius_m) for tag in tags]),
            names=[str(tag) for tag in tags],
            objects=np.array(things, np.float64).reshape(-1, 2) - middle[:2],
            senses=self._senses(tags),
        )
        self._count(moment)
        self._states.append(_State(capture_ns, moment))

    def _run_time_s(self, timestep: int, capture_ns: int) -> float | None:
        """The run's time at a state, -1 being outside of a run; None where it is not known.

        Without a timestep's length it is the time between captures, as in `vsense camera track`.
        """
        if self._timestep_s:
            return timestep * self._timestep_s if timestep >= 0 else None
        before, self._before = self._before, (timestep, capture_ns)
        if timestep < 0:
            return self.time_s
        if self.time_s is None or timestep < self._newest:
            self.time_s = 0.0
        self._newest = timestep
        since_ns = capture_ns - before[1] if 0 <= before[0] < timestep else 0
        return self.time_s + max(since_ns, 0) / 1e9

    def _ways(self, tags: list[int]) -> Floats:
        """The robots' earlier places, (t, n, 2); where one was not there, its next place."""
        ways, newest = [], dict.fromkeys(tags, (0.0, 0.0))
        for places in reversed(self._trails):
            newest |= {tag: places[tag] for tag in tags if tag in places}
            ways.append([newest[tag] for tag in tags])
        return np.array(ways[::-1], np.float64).reshape(len(ways), len(tags), 2)

    def _snapshot(self, tags: list[int]) -> WorldSnapshot:
        signals = self._signals
        cones = [np.stack((c["x_m"], c["y_m"]), axis=-1) for c in signals.get("cones") or []]
        leds = signals.get("leds") or {"tag": [], "color": []}
        colours = dict(zip(leds["tag"], leds["color"], strict=True))
        return make_snapshot(
            self.arena,
            self._entities,
            self._floor,
            self._fields,
            [cone for cone in cones if cone.shape == (3, 2)],
            np.array([colours.get(tag, (0, 0, 0)) for tag in tags], np.uint8).reshape(-1, 3),
        )

    def _count(self, moment: ArenaMoment) -> None:
        """Counts the robots in the cones, and those that are lit there."""
        measures = self._signals.get("measures") or {}
        cones = moment.snapshot.cones
        if self.time_s is None or not cones or IN_CONE in measures:
            return
        places = {int(name): (x, y) for name, (x, y, _) in zip(moment.names, moment.poses.tolist())}
        counts = count_swarm(places, self._leds, cones)
        for name in (IN_CONE, LIT_IN_CONE):
            self._measure(name, self.time_s, counts[name])

    def _senses(self, tags: list[int]) -> Senses | None:
        """What the chosen robot senses; None where it is not there, or no readings are."""
        tag, readings = self._robot, self._readings
        if tag not in tags:
            return None
        rays, words = [], []
        if tag in readings.get("tag", ()):
            given = readings["values"][readings["tag"].index(tag)]
            number = self._facts.controller_of().get(tag, 0)
            sensors = self._facts.controllers[number]["sensors"]
            for sensor, read in zip(sensors, given, strict=True):
                angles = sensor.get("angles_rad")
                if angles:
                    pairs = [pair for pair in zip(angles, read) if None not in pair]
                    ways, values = np.array(pairs, np.float64).reshape(-1, 2).T
                    rays.append((ways, np.abs(values / self._peak(sensor, read))))
                elif len(read) <= 3:
                    words.append(_words(sensor, read))
        return Senses(tags.index(tag), tuple(rays), tuple(words[:_WORDS]))

    def _peak(self, sensor: Mapping[str, Any], read: list[float | None]) -> float:
        """The sensor's greatest reading so far; None is a reading that is no number."""
        name = str(sensor["name"])
        sizes = (abs(float(value)) for value in read if value is not None)
        peak = max((self._peaks.get(name, 1e-9), *sizes))
        self._peaks[name] = peak
        return peak


def _words(sensor: Mapping[str, Any], read: list[float | None]) -> str:
    unit = f" {sensor['unit']}" if sensor.get("unit") else ""
    numbers = ", ".join("-" if value is None else f"{value:.3g}" for value in read)
    return f"{sensor['name']} {numbers}{unit}"


def _arena_of(data: Mapping[str, Any]) -> Arena:
    try:
        size_x, size_y, size_z = (float(value) for value in data["size_m"])
        x, y, z = (float(value) for value in data["centre_m"])
    except (*DAMAGED, WorldError):
        raise ValueError("it has no arena") from None
    fits = all(_LEAST_M <= size <= _MOST_M for size in (size_x, size_y))
    if not fits or not all(abs(value) <= _FARTHEST_M for value in (x, y, z, size_z)):
        where = f"{size_x:g} x {size_y:g} m around ({x:g}, {y:g}) m"
        raise ValueError(f"its arena of {where} cannot be drawn")
    return Arena((size_x, size_y, size_z), (x, y, z))


def _lengths(robots: Iterable[Mapping[str, Any]], name: str) -> dict[int, float]:
    """A length of robots by tag; of one that does not say it, or is damaged, there is none."""
    lengths: dict[int, float] = {}
    for robot in robots:
        with suppress(*DAMAGED):
            length_m = float(robot[name])
            if 0.0 <= length_m <= _MOST_M:
                lengths[robot["tag"]] = length_m
    return lengths


def _entity(data: Mapping[str, Any]) -> Entity | None:
    """A virtual thing; None for one of a kind that is not known, or damaged."""
    with suppress(*DAMAGED, WorldError):
        kind: Any = _KINDS[data["kind"]]
        names = {field.name for field in fields_of(kind)}
        values = {n: tuple(v) if isinstance(v, list) else v for n, v in data.items() if n in names}
        if "leds" in values:
            values["leds"] = tuple(Led(tuple(at), tuple(color)) for at, color in values["leds"])
        values.pop("model", None)
        entity: Entity = kind(**values)
        if isinstance(entity, VirtualRobot) and "radius_m" in data:
            radius_m, height_m = float(data["radius_m"]), float(data["height_m"])
            model = replace(EPUCK, radius_m=radius_m, height_m=height_m)
            entity = replace(entity, model=model)
        return entity
    return None


def _floor(floor: Mapping[str, Any] | None) -> Floor:
    """The floor; a plain white one where it is not told."""
    with suppress(*DAMAGED, WorldError):
        if floor is not None:
            image = None
            if floor.get("png"):
                image = floor_picture(base64.b64decode(floor["png"]))
            size, centre, color = (tuple(floor[n]) for n in ("size_m", "centre_m", "color"))
            return Floor(image, size, centre, color)
    return Floor()


def _field(data: Mapping[str, Any], points: Floats, size: tuple[int, int]) -> Floats:
    """A field at the points of a `grid`, as shares of its highest concentration."""
    shape = int(data["rows"]), int(data["columns"])
    levels = np.frombuffer(base64.b64decode(data["levels"]), np.uint8).reshape(shape)
    # Row 0 of the levels lies at the lowest y; a cell's value is that of its middle.
    cells = (points - np.array(data["corner_m"])) / float(data["cell_m"]) - 0.5
    across, down = (cells[:, k].reshape(size).astype(np.float32) for k in (0, 1))
    sampled = cv2.remap(levels, across, down, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    return np.asarray(sampled, np.float64) / 255.0
