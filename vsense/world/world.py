"""The world of one run: what the cameras saw last, and what is virtual.

It reads no clock and draws from its own seed; ages follow from the arena states' capture times. The
same arena states therefore give the same world, live and in a replay.
"""

from __future__ import annotations

import math
from collections import UserDict
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState
from vsense.base.native import kernels
from vsense.world._inventory import Inventory
from vsense.world.entities import (
    Arena,
    Box,
    Color,
    Cylinder,
    Entity,
    Light,
    VirtualRobot,
    WorldError,
    Zone,
)
from vsense.world.fields import Field, Floor, by_id
from vsense.world.pollution import DEFAULT_MEMORY_NS, Cone, PollutantSource, Stock
from vsense.world.rays import LightTable, MovingBodies, entity_rows
from vsense.world.robot_models import EPUCK, RobotModel
from vsense.world.sightings import NEVER_NS as NEVER_NS
from vsense.world.sightings import LastSightings, carried, read_only, standing, unseen


class Results(UserDict[str, float]):
    """Finite numbers by name; WorldError for anything else that is written."""

    def __setitem__(self, name: str, number: float) -> None:
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            raise WorldError(f"a result is called {name!r:.60}, expected a name")
        plain = isinstance(number, (int, float, np.integer, np.floating, np.bool_))
        if not plain or not math.isfinite(number):
            raise WorldError(f"result {name!r} is {number!r:.60}, expected a finite number")
        super().__setitem__(name, float(number))

    def __ior__(self, other: Any) -> Results:  # type: ignore[override,misc]
        # That of UserDict would write without a check.
        self.update(other)
        return self


BODY_MEMORY_NS = DEFAULT_MEMORY_NS
"""A tagged thing that is not seen stands in the way so long where it was seen last."""

MESSAGE_MAX: int = kernels.VS_MESSAGE_MAX
"""Bytes of the longest virtual message."""

MESSAGE = np.dtype(
    [("length", "u1"), ("data", "u1", (MESSAGE_MAX,)), ("range_m", "f8")], align=True
)
"""A robot's message to its neighbours, as `struct vs_message`: `length` bytes of `data`; length 0:
nothing. It is heard up to `range_m`; 0: as far as the receiver says."""


class World:
    """What virtual sensors read and virtual actuators change; one `update` per timestep.

    Attributes:
        robots: POSE array, read-only, one row per robot: the real ones in the order of `tags`,
            then the virtual ones in the order in which they were put. `seen` is whether the row is
            of this timestep; a robot that is not seen keeps its last sighting, of the time
            `capture_ns` (NEVER_NS before the first).
        objects: POSE array, read-only, of the tagged things that are no robots, likewise.
        real_robots: how many of the robots are real.
        leds: (n, 3) uint8 red, green, blue that each robot shows with its virtual LEDs; 0: off.
        led_colors: (n, k, 3) uint8 of each single one, in the order of its model's lamps, as
            ARGoS's cameras see them; k is the largest number of a robot.
        messages: MESSAGE array (n,), what each robot sends now.
        sources: what pollutes, in the experiment's order.
        fields: fields by id.
        random: all that happens by chance in the world is drawn from it.
        results: measures of the run by name.
        stock: what robots have left of the pollutant sources.
        params: the loop functions' own settings.
        sightings: `robots` and `objects` as C takes them; another one when an entity changes.
        arena: the arena, or None where it is not needed.
        controllers: id of the controller of each robot, by its tag.
        models: of robots and things that are no e-pucks, by tag.
        capture_ns: capture time of the newest arena state, 0 before the first.
        run_timestep: timestep of the run, from 0; negative before the run.
    """

    capture_ns = 0
    run_timestep = 0
    _settled = -1
    _floors = 0
    _is_standing = False
    _light_table: LightTable | None = None
    _painted_floor: Floor | None = None

    def __init__(
        self,
        tags: Iterable[int],
        sources: Sequence[PollutantSource] = (),
        *,
        entities: Iterable[Entity] = (),
        fields: Iterable[Field] = (),
        floor: Floor | None = None,
        objects: Iterable[int] = (),
        arena: Arena | None = None,
        timestep_s: float = 0.1,
        seed: int = 0,
        controllers: Mapping[int, str] = MappingProxyType({}),
        models: Mapping[int, RobotModel] = MappingProxyType({}),
    ) -> None:
        """Makes a world of which no camera has seen anything yet.

        Args:
            tags: markers of the robots of the run, without repetition.
            entities: what else is in it, virtual robots too.
            floor: the floor's colours; None: white.
            objects: markers of the things that are no robots; the sources' are added.
            models: of robots and things that are no e-pucks, by tag.

        Raises:
            WorldError: two things have the same id, or a field changes too fast for a timestep.
        """
        self._robots = unseen(list(tags))
        marked = {*objects, *(source.tag for source in sources)}
        self._objects = unseen(sorted(marked - {*self._robots["tag"].tolist()}))
        self.real_robots = len(self._robots)
        self.sources = tuple(sources)
        self.arena, self.timestep_s, self.controllers = arena, timestep_s, controllers
        self._given_models = self.models = models
        self._lamps = max(len(model.lamps_m) for model in (EPUCK, *models.values()))
        self.params: dict[str, str] = {}
        self.fields = by_id(fields, timestep_s)
        self._inventory, self._seed = Inventory(entities), seed
        self._first_floor = floor if floor is not None else Floor()
        self.reset()

    def reset(self) -> None:
        """Goes back to the start of the run but for what the cameras saw last."""
        self._inventory.reset()
        self.floor = self._first_floor
        for field in self.fields.values():
            field.reset()
        self.results = Results()
        self.stock = Stock()
        self.random = np.random.Generator(np.random.PCG64(self._seed))
        self._robots = self._robots[: self.real_robots]
        self._leds = np.zeros((self.real_robots, 3), dtype=np.uint8)
        self._led_colors = np.zeros((self.real_robots, self._lamps, 3), dtype=np.uint8)
        self._messages = np.zeros(self.real_robots, dtype=MESSAGE)
        self._settle()

    def update(self, state: ArenaState, run_timestep: int) -> None:
        """Takes over what the cameras saw in a timestep of the run; negative before the run."""
        self.capture_ns, self.run_timestep = state.capture_ns, run_timestep
        self._settle()
        self.sightings.update(state.robots, state.capture_ns)
        self._is_standing = False

    def advanced(self, capture_ns: int, run_timestep: int, is_standing: bool = False) -> None:
        """Takes over that C has updated `sightings`, and `bodies` too where it `is_standing`."""
        self.capture_ns, self.run_timestep = capture_ns, run_timestep
        self._is_standing = is_standing

    def step(self) -> None:
        """Steps what changes by itself, the fields."""
        for field in self.fields.values():
            field.step(self.timestep_s)

    @property
    def robots(self) -> NDArray[np.void]:
        self._settle()
        return read_only(self._robots)

    @property
    def leds(self) -> NDArray[np.uint8]:
        self._settle()
        return self._leds

    @property
    def led_colors(self) -> NDArray[np.uint8]:
        self._settle()
        return self._led_colors

    @property
    def messages(self) -> NDArray[np.void]:
        self._settle()
        return self._messages

    @property
    def objects(self) -> NDArray[np.void]:
        return read_only(self._objects)

    @property
    def time_s(self) -> float:
        """Time since the run's first timestep; 0 before it."""
        return max(self.run_timestep, 0) * self.timestep_s

    @property
    def version(self) -> tuple[int, int]:
        """Changes with every change of an entity or of the plain floor."""
        return self._inventory.version, self._floors

    @property
    def entities(self) -> Mapping[str, Entity]:
        """All that is in the world besides real robots and tagged things, by id; read-only."""
        return self._inventory.entities

    @property
    def free_tag(self) -> int:
        """A tag for one more virtual robot, which none of this run has had."""
        return self._inventory.free_tag

    def put(self, entity: Entity) -> None:
        """Adds an entity, or replaces the one of the same id.

        Raises:
            WorldError: it is none, another robot has its tag, or it stands in the real arena.
        """
        self._inventory.put(entity)

    def remove(self, name: str) -> None:
        """Takes an entity out of the world.

        Raises:
            WorldError: there is none of this name, or it stands in the real arena.
        """
        self._inventory.remove(name)

    def move(self, name: str, x_m: float, y_m: float, yaw_rad: float | None = None) -> None:
        """Puts an entity to another place; without yaw_rad it keeps its turn.

        Raises:
            WorldError: there is none of this name, it stands in the real arena, or there is no such
                place.
        """
        self._inventory.move(name, x_m, y_m, yaw_rad)

    def rebuild(self, entity: Entity) -> None:
        """As `put`, also of what stands in the arena: for simulations, whose arena can change.

        Raises:
            WorldError: another robot has its tag.
        """
        self._inventory.rebuild(entity)

    def tear_down(self, name: str) -> None:
        """As `remove`, likewise.

        Raises:
            WorldError: there is none of this name.
        """
        self._inventory.tear_down(name)

    def set_leds(self, name: str, colors: Sequence[Color]) -> None:
        """Gives the LEDs of a box or cylinder other colours; a physical one's, too.

        Raises:
            WorldError: there is none of this name, or it has not as many LEDs.
        """
        self._inventory.set_leds(name, colors)

    def boxes(self) -> tuple[Box, ...]:
        """All boxes, physical and virtual."""
        return self._inventory.of(Box)

    def cylinders(self) -> tuple[Cylinder, ...]:
        """All cylinders, physical and virtual."""
        return self._inventory.of(Cylinder)

    def lights(self) -> tuple[Light, ...]:
        """All lights."""
        return self._inventory.of(Light)

    def light_table(self) -> LightTable:
        """The lights that shine; the same object until an entity changes."""
        self._settle()
        if self._light_table is None:
            self._light_table = LightTable(self.lights())
        return self._light_table

    def zones(self) -> tuple[Zone, ...]:
        """All zones."""
        return self._inventory.of(Zone)

    @property
    def floor(self) -> Floor:
        """The floor with all coloured zones; what is set here lies under the zones."""
        self._settle()
        if self._painted_floor is None:
            self._painted_floor = self._plain_floor.with_zones(self.zones())
        return self._painted_floor

    @floor.setter
    def floor(self, floor: Floor) -> None:
        self._plain_floor = floor
        self._painted_floor = None
        self._floors += 1

    def bodies(self) -> MovingBodies:
        """All that stands in the way of light and sight, until the next update.

        The rows are those of `robots`, which `skip` takes, then those of `objects`, then cylinders
        and boxes. A tagged thing that no camera has seen for BODY_MEMORY_NS blocks no line.
        """
        crowd = self.crowd
        if not self._is_standing:
            crowd.stand(self.capture_ns)
            self._is_standing = True
        return crowd

    @property
    def crowd(self) -> MovingBodies:
        """What gives `bodies`, where it stood last; another one when a body comes or goes."""
        self._settle()
        return self._crowd

    def driven_by(self, controller: str) -> NDArray[np.bool_]:
        """Which of `robots` a controller drives, by its id, (n,)."""
        tags = self.robots["tag"].tolist()
        return np.array([self.controllers.get(tag) == controller for tag in tags], dtype=bool)

    def pose(self, tag: int) -> np.void | None:
        """The last sighting of a robot or tagged thing, or None if there is none yet."""
        self._settle()
        poses, row = self._places.get(tag, (None, 0))
        if poses is None or poses[row]["capture_ns"] == NEVER_NS:
            return None
        pose: np.void = poses[row]
        return pose

    def age_ns(self, source: PollutantSource) -> int | None:
        """Age of the source's last sighting; None: it was never seen."""
        pose = self.pose(source.tag)
        return None if pose is None else self.capture_ns - int(pose["capture_ns"])

    def cone(self, source: PollutantSource) -> Cone | None:
        """The polluted triangle of a source, or None while there is none.

        A source that is not seen pollutes on from where it was seen last, until that sighting is
        older than the source's `memory_ns`.
        """
        pose, age_ns = self.pose(source.tag), self.age_ns(source)
        share = self.stock.share(source)
        if pose is None or age_ns is None or age_ns > source.memory_ns or share <= 0.0:
            return None
        return source.cone_at(float(pose["x_m"]), float(pose["y_m"]), self.run_timestep, share)

    def _settle(self) -> None:
        """Renews what follows from the entities, if they have changed since the last time."""
        if self._settled == self._inventory.version:
            return
        changed = self._inventory.changed_since(self._settled)
        self._settled = self._inventory.version
        if Zone in changed:
            self._painted_floor = None
        if Light in changed:
            self._light_table = None
        if not changed.isdisjoint((Box, Cylinder, VirtualRobot)):
            self._settle_bodies()

    def _settle_bodies(self) -> None:
        before = self._robots["tag"].tolist()
        virtual = self._inventory.of(VirtualRobot)
        self.models = {**self._given_models, **{robot.tag: robot.model for robot in virtual}}
        rows = standing(virtual, self.capture_ns)
        self._robots = np.concatenate([self._robots[: self.real_robots], rows])
        self.sightings = LastSightings(self._robots, self.real_robots, self._objects)
        standing_rows = entity_rows([*self.cylinders(), *self.boxes()])
        tags = (*self._robots["tag"].tolist(), *self._objects["tag"].tolist())
        models = [self.models.get(tag, EPUCK) for tag in tags]
        self._crowd = MovingBodies(self.sightings, models, standing_rows, BODY_MEMORY_NS)
        self._is_standing = False
        after = self._robots["tag"].tolist()
        self._places = {
            tag: (poses, row)
            for poses in (self._objects, self._robots)
            for row, tag in enumerate(poses["tag"].tolist())
        }
        if after != before:
            # Virtual robots that stay keep LEDs and message.
            self._leds = carried(self._leds, before, after)
            self._led_colors = carried(self._led_colors, before, after)
            self._messages = carried(self._messages, before, after)
