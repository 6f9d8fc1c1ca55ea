"""Start poses: draws where distributed robots and things stand when a run begins.

The draws depend on the seed alone, and what is distributed is placed in the file's order. A body
takes up a part of the floor, its footprint; footprints keep a distance.

ARGoS accepts robots that stand in each other: files park all of them on one place, from where loop
functions move them. In the lab and in simulation such robots are placed anew, near by.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from vsense.base.arena import Point, wrap_angle
from vsense.base.errors import UsageError
from vsense.config._distribute import DistributedSpec, Distribution
from vsense.config.specs import Experiment, ObjectSpec, Pose, RobotSpec, Stage
from vsense.world.entities import Arena, Box, Cylinder, Entity, Light, Vector, VirtualRobot, moved
from vsense.world.robot_models import EPUCK, RobotModel


@dataclass(frozen=True, slots=True)
class Footprint:
    """A disc or a rectangle, and the heights between which it stands.

    Attributes:
        what: its name in messages.
        x_m, y_m: its middle.
        low_m, high_m: its lowest and its highest point.
        radius_m: of a disc; 0: it is a rectangle.
        half_m: half the extent of a rectangle along its own x and y.
        yaw_rad: the rectangle's turn.
    """

    what: str
    x_m: float
    y_m: float
    low_m: float
    high_m: float
    radius_m: float = 0.0
    half_m: Point = (0.0, 0.0)
    yaw_rad: float = 0.0

    def distance_m(self, other: Footprint) -> float:
        """How far two footprints are apart, negative where they overlap.

        Between two rectangles that face each other with corners it is less than the distance, by
        at most 30 %. Bodies above each other are infinitely far apart.
        """
        if self.high_m <= other.low_m or other.high_m <= self.low_m:
            return math.inf
        if self.radius_m and other.radius_m:
            apart_m = math.hypot(other.x_m - self.x_m, other.y_m - self.y_m)
            return apart_m - self.radius_m - other.radius_m
        if self.radius_m:
            return other.distance_to_point_m(self.x_m, self.y_m) - self.radius_m
        if other.radius_m:
            return self.distance_to_point_m(other.x_m, other.y_m) - other.radius_m
        return max(self._gap_m(other), other._gap_m(self))

    def distance_to_point_m(self, x_m: float, y_m: float) -> float:
        """How far a point is from the rectangle, 0 inside."""
        x, y = x_m - self.x_m, y_m - self.y_m
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        beyond_x = abs(x * cosine + y * sine) - self.half_m[0]
        beyond_y = abs(y * cosine - x * sine) - self.half_m[1]
        return math.hypot(max(beyond_x, 0.0), max(beyond_y, 0.0))

    def blocks(self, start: Point, end: Point) -> bool:
        """Whether it lies between two points, of which it holds none."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        ends = [(x - self.x_m, y - self.y_m) for x, y in (start, end)]
        (x, y), (to_x, to_y) = ((u * cosine + v * sine, v * cosine - u * sine) for u, v in ends)
        along_x, along_y = to_x - x, to_y - y
        if self.radius_m:
            length2 = along_x**2 + along_y**2
            share = -(x * along_x + y * along_y) / length2 if length2 else 0.0
            share = min(max(share, 0.0), 1.0)
            return math.hypot(x + share * along_x, y + share * along_y) < self.radius_m
        first, last = 0.0, 1.0
        for at, way, half_m in ((x, along_x, self.half_m[0]), (y, along_y, self.half_m[1])):
            if way == 0.0:
                if abs(at) >= half_m:
                    return False
                continue
            shares = sorted(((-half_m - at) / way, (half_m - at) / way))
            first, last = max(first, shares[0]), min(last, shares[1])
        return first < last

    def is_inside(self, arena: Arena, gap_m: float) -> bool:
        """Whether it lies in the arena, at least gap_m from its border."""
        if self.radius_m:
            return arena.contains(self.x_m, self.y_m, self.radius_m + gap_m)
        return all(arena.contains(x, y, gap_m) for x, y in self._corners())

    def _corners(self) -> list[Point]:
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        half_x, half_y = self.half_m
        return [
            (self.x_m + u * cosine - v * sine, self.y_m + u * sine + v * cosine)
            for u, v in (
                (half_x, half_y), (-half_x, half_y), (-half_x, -half_y), (half_x, -half_y),
            )
        ]  # fmt: skip

    def _gap_m(self, other: Footprint) -> float:
        """Gives the widest gap to another rectangle along this one's own axes."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        gaps = []
        for (x, y), half_m in (((cosine, sine), self.half_m[0]), ((-sine, cosine), self.half_m[1])):
            along = [(cx - self.x_m) * x + (cy - self.y_m) * y for cx, cy in other._corners()]
            gaps.append(max(min(along), -max(along)) - half_m)
        return max(gaps)


def of_robot(what: str, pose: Pose, model: RobotModel = EPUCK) -> Footprint:
    """Gives the footprint of a robot or a tagged object."""
    return Footprint(what, pose.x_m, pose.y_m, 0.0, model.height_m, model.radius_m)


def of_entity(entity: Entity) -> Footprint | None:
    """Gives the footprint of an entity, None of one without a body."""
    if isinstance(entity, Box):
        x_m, y_m, low_m = entity.position_m
        half_m = (entity.size_m[0] / 2.0, entity.size_m[1] / 2.0)
        high_m = low_m + entity.size_m[2]
        what = f"box {entity.id!r}"
        return Footprint(what, x_m, y_m, low_m, high_m, 0.0, half_m, entity.yaw_rad)
    if isinstance(entity, Cylinder):
        x_m, y_m, low_m = entity.position_m
        high_m = low_m + entity.height_m
        return Footprint(f"cylinder {entity.id!r}", x_m, y_m, low_m, high_m, entity.radius_m)
    if isinstance(entity, VirtualRobot):
        pose = Pose(entity.x_m, entity.y_m, entity.yaw_rad)
        return of_robot(f"virtual robot {entity.id!r}", pose, entity.model)
    return None


MIN_GAP_M = 0.005
"""Free space around a drawn body."""

_BORDER = "the arena's border"

_TOUCH_M = 1e-9
"""Bodies that the file places side by side may touch."""


def settle(experiment: Experiment, seed: int, real: bool = True) -> Experiment:
    """Gives everything that is distributed a place that `seed` decides; what has one keeps it.

    Without `real`, robots and objects stand where a tracker finds them: they are left as the file
    says, and block no place. With it, each gets its pose. No entity stays distributed.

    Raises:
        ConfigError: objects that the file places overlap, or robots where `overlapping` does not
            help, or a distributed body finds no room.
    """
    bodies = experiment if real else replace(experiment, robots=(), objects=())
    placed = _Placement(bodies, seed)
    poses = placed.poses
    robots = (replace(r, pose=poses[r.tag], distribution=None) for r in bodies.robots)
    objects = (replace(o, pose=poses[o.tag], distribution=None) for o in bodies.objects)
    return replace(
        experiment,
        robots=tuple(robots) or experiment.robots,
        objects=tuple(objects) or experiment.objects,
        entities=(*experiment.entities, *placed.entities),
        distributed=(),
    )


def overlapping(experiment: Experiment) -> list[tuple[RobotSpec, str]]:
    """Finds the robots that `settle` places anew, each with what is in its way in the file.

    There is none for `Stage.RUN`: real robots stand where they stand.
    """
    standing = _Standing(experiment)
    standing.place_fixed()
    return standing.displaced


Drawn = RobotSpec | ObjectSpec | DistributedSpec

_PARKED_M = 0.001
"""Robots that are nearer to each other share one place: it says nothing about their headings."""
_ROOM_EACH = 12.0
"""Robots that are placed anew fill at first one part in so many of the disc around their place."""
_MOST_TRIALS = 2000
_WIDER = 1.005
"""By how much that disc grows with each trial."""


class _Standing:
    """What stands where the file says.

    Attributes:
        poses: by tag, of robots and objects.
        displaced: robots that stand in something, and in what.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.poses: dict[int, Pose] = {}
        self.displaced: list[tuple[RobotSpec, str]] = []
        self._experiment = experiment
        self._footprints: list[Footprint] = []
        self._occupy(*experiment.solids)
        self._solid = tuple(self._footprints)

    def _occupy(self, *entities: Entity) -> None:
        self._footprints += [f for f in map(of_entity, entities) if f is not None]

    def place_fixed(self) -> None:
        """Places bodies whose pose the file says; they may touch, and stand in virtual things."""
        bodies: list[ObjectSpec | RobotSpec] = [*self._experiment.objects]
        bodies += self._experiment.robots
        for body in bodies:
            if body.pose is not None:
                footprint = of_robot(f"the body with tag {body.tag}", body.pose, body.model)
                in_the_way = self._obstacle(footprint, -_TOUCH_M)
                if in_the_way:
                    self._displace(body, in_the_way)
                    continue
                self.poses[body.tag] = body.pose
                self._footprints.append(footprint)

    def _displace(self, body: ObjectSpec | RobotSpec, in_the_way: str) -> None:
        if isinstance(body, ObjectSpec) or self._experiment.stage is Stage.RUN:
            message = f"{body.id!r} overlaps with {in_the_way}"
            raise self._experiment.error(body.line, message)
        self.displaced.append((body, in_the_way))

    def _obstacle(self, footprint: Footprint, gap_m: float) -> str:
        """Names what a body at this place would overlap with; "" if it stands free."""
        if not footprint.is_inside(self._experiment.arena, gap_m):
            return _BORDER
        near = (other for other in self._footprints if footprint.distance_m(other) < gap_m)
        return next((other.what for other in near), "")


class _Placement(_Standing):
    """Poses of robots and objects by tag, and the distributed entities in their places."""

    def __init__(self, experiment: Experiment, seed: int) -> None:
        super().__init__(experiment)
        self.entities: list[Entity] = []
        self._draws = random.Random(seed)
        self._drawn: Counter[int] = Counter()  # places, by `<distribute>`
        self.place_fixed()
        for robot, in_the_way in self.displaced:
            self._place_anew(robot, in_the_way)
        self._occupy(*(e for e in experiment.entities if not getattr(e, "physical", False)))
        waiting: list[Drawn] = [*experiment.robots, *experiment.objects]
        waiting += experiment.distributed
        drawn = [(spec.distribution, spec) for spec in waiting if spec.distribution is not None]
        self._counts = Counter(distribution.number for distribution, _ in drawn)
        for distribution, spec in sorted(drawn, key=lambda pair: pair[0].number):
            self._draw_free(spec, distribution)

    def _place_anew(self, robot: RobotSpec, in_the_way: str) -> None:
        """Draws a free place around the file's, in sight of it: on the same side of the walls."""
        pose = robot.pose
        assert pose is not None
        start, yaw_rad = (pose.x_m, pose.y_m), pose.yaw_rad
        poses = (other.pose for other in self._experiment.robots if other is not robot)
        if any(p and math.hypot(p.x_m - start[0], p.y_m - start[1]) < _PARKED_M for p in poses):
            yaw_rad = self._draws.uniform(-math.pi, math.pi)
        body, radius_m = of_robot("", pose, robot.model), robot.model.radius_m
        # A wall that the place itself lies in is in nobody's way, nor is one overhead.
        walls = [w for w in self._solid if -radius_m < body.distance_m(w) < math.inf]
        reach_m = radius_m * math.sqrt(_ROOM_EACH * (len(self.displaced) + 1))
        for _ in range(_MOST_TRIALS):
            away_m, towards = reach_m * math.sqrt(self._draws.random()), self._draws.random()
            x_m = start[0] + away_m * math.cos(2.0 * math.pi * towards)
            y_m = start[1] + away_m * math.sin(2.0 * math.pi * towards)
            reach_m *= _WIDER
            if any(wall.blocks(start, (x_m, y_m)) for wall in walls):
                continue
            if not self._try(robot, (x_m, y_m, 0.0), yaw_rad):
                return
        message = f"{robot.id!r} overlaps with {in_the_way}, and no room for it was found near by"
        raise self._experiment.error(robot.line, message)

    def _draw_free(self, spec: Drawn, distribution: Distribution) -> None:
        """Draws places until one is free; the error names the last obstacle."""
        index = self._drawn[distribution.number]
        self._drawn[distribution.number] += 1
        is_random = distribution.position_m.is_random or distribution.orientation_rad.is_random
        trials, obstacles = distribution.max_trials if is_random else 1, set[str]()
        for _ in range(trials):
            position_m = distribution.position_m.sample(index, self._draws)
            turn_rad = distribution.orientation_rad.sample(index, self._draws)[0]
            obstacle = self._try(spec, position_m, float(wrap_angle(turn_rad)))
            if not obstacle:
                return
            obstacles.add(obstacle)
        name = spec.entity.id if isinstance(spec, DistributedSpec) else spec.id
        error = partial(self._experiment.error, distribution.line)
        if obstacles == {_BORDER}:
            words = "outside of the arena or across its border: expected a <position> inside"
            raise error(f"<distribute>: all {trials} places drawn for {name!r} are {words}")
        raise error(
            f"<entity> max_trials: no room for {name!r} found in {trials} trials (the last one hit"
            f" {obstacle}): {index} of {self._counts[distribution.number]} have a place; expected"
            " fewer of them, more room or more trials"
        )

    def _try(self, spec: Drawn, position_m: Vector, yaw_rad: float) -> str:
        """Places a body if it stands free there; else names what is in the way."""
        footprint: Footprint | None
        if isinstance(spec, DistributedSpec):
            entity = _put(spec.entity, position_m, yaw_rad)
            footprint = of_entity(entity)
            keep = partial(self.entities.append, entity)
        else:
            pose = Pose(position_m[0], position_m[1], yaw_rad)
            footprint = of_robot(f"the body with tag {spec.tag}", pose, spec.model)
            keep = partial(self.poses.__setitem__, spec.tag, pose)
        obstacle = "" if footprint is None else self._obstacle(footprint, MIN_GAP_M)
        if not obstacle:
            keep()
            self._footprints += [] if footprint is None else [footprint]
        return obstacle


def _put(entity: Entity, position_m: Vector, yaw_rad: float) -> Entity:
    """Moves an entity to a drawn place; what stands in the real arena stays on the floor."""
    x_m, y_m, z_m = position_m
    turns = not isinstance(entity, (Cylinder, Light))
    entity = moved(entity, x_m, y_m, yaw_rad if turns else None)
    if isinstance(entity, Light) or (isinstance(entity, (Box, Cylinder)) and not entity.physical):
        return replace(entity, position_m=(x_m, y_m, z_m))
    return entity


@dataclass(frozen=True, slots=True)
class StartPlaces:
    """The places of everything that moves or is distributed when a run begins, whatever its seed.

    So runs of several conditions begin alike, and repetitions differ in all else that is drawn.

    Attributes:
        seed: decides the places of all that is distributed.
        poses: of the robots, in the file's order: x_m, y_m, yaw_rad; (): as the file says.
    """

    seed: int
    poses: tuple[tuple[float, float, float], ...] = ()

    def put(self, experiment: Experiment) -> Experiment:
        """Gives the robots their poses; what is distributed is not placed yet.

        Raises:
            UsageError: there are not as many poses as robots, or two bodies overlap.
        """
        if not self.poses:
            return experiment
        robots = experiment.robots
        if len(self.poses) != len(robots):
            raise UsageError(f"{len(self.poses)} poses: {experiment.file} has {len(robots)} robots")
        placed = tuple(
            replace(robot, pose=Pose(*pose), distribution=None)
            for robot, pose in zip(robots, self.poses)
        )
        started = replace(experiment, robots=placed)
        if displaced := overlapping(started):
            robot, what = displaced[0]
            raise UsageError(f"the pose of {robot.id!r} overlaps with {what}")
        return started

    def settled(self, experiment: Experiment, real: bool = True) -> Experiment:
        """Gives everything its place; for `real` see `settle`.

        Raises:
            UsageError: as `put`.
            ConfigError: as `settle`.
        """
        return settle(self.put(experiment), self.seed, real)

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> StartPlaces:
        """Reads what `dataclasses.asdict` made of one, also from JSON."""
        return cls(int(data["seed"]), tuple(tuple(pose) for pose in data.get("poses", ())))
