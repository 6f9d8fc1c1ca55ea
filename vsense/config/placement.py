"""Start poses: draws where distributed robots and things stand when a run begins.

The draws depend on the seed alone, and what is distributed is placed in the file's order.
"""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import dataclass, field, replace

from vsense.arena import wrap_angle
from vsense.config.draws import DistributedSpec, Distribution
from vsense.config.footprints import Footprint, of_entity, of_robot
from vsense.config.specs import Experiment, ObjectSpec, Pose, RobotSpec, Vector
from vsense.world.entities import Box, Cylinder, Entity, Light, moved

MIN_GAP_M = 0.005
"""Free space around a drawn body."""

_TOUCH_M = 1e-9
"""Bodies that the file places side by side may touch."""


def place(experiment: Experiment, seed: int) -> dict[int, Pose]:
    """Gives every robot and object its start pose.

    Args:
        experiment: the experiment.
        seed: decides the poses of what is distributed.

    Returns:
        By tag the pose; yaw in (-pi, pi].

    Raises:
        ConfigError: bodies that the file places overlap, or a distributed one finds no room.
    """
    return _place_all(experiment, seed).poses


def settle(experiment: Experiment, seed: int, real: bool = True) -> Experiment:
    """Gives everything that is distributed its place; what has one keeps it.

    Args:
        experiment: the experiment.
        seed: decides the places.
        real: False: robots and objects stand where a tracker finds them; the file's word about
            that is left as it is, and they are in nobody's way.

    Returns:
        The experiment without distributed entities: its `entities` are complete. With `real`,
        every robot and object has its pose.

    Raises:
        ConfigError: see `place`.
    """
    bodies = experiment if real else replace(experiment, robots=(), objects=())
    placed = _place_all(bodies, seed)
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


@dataclass(slots=True)
class _Placement:
    """What stands where so far.

    Attributes:
        poses: of robots and objects, by tag.
        entities: those that were distributed.
        footprints: of everything with a body, virtual things included.
        drawn: by `<distribute>` how many places were drawn.
    """

    poses: dict[int, Pose] = field(default_factory=dict)
    entities: list[Entity] = field(default_factory=list)
    footprints: list[Footprint] = field(default_factory=list)
    drawn: Counter[int] = field(default_factory=Counter)


def _place_all(experiment: Experiment, seed: int) -> _Placement:
    placed = _Placement()
    _place_fixed(experiment, placed)
    virtual = (e for e in experiment.entities if not getattr(e, "physical", False))
    placed.footprints += [f for f in map(of_entity, virtual) if f is not None]
    draws = random.Random(seed)
    waiting: list[RobotSpec | ObjectSpec | DistributedSpec] = [
        *experiment.robots, *experiment.objects, *experiment.distributed,
    ]  # fmt: skip
    for spec in sorted(waiting, key=_order):
        if spec.distribution is not None:
            _draw_free(experiment, placed, spec, spec.distribution, draws)
    return placed


def _order(spec: RobotSpec | ObjectSpec | DistributedSpec) -> int:
    return -1 if spec.distribution is None else spec.distribution.number


def _place_fixed(experiment: Experiment, placed: _Placement) -> None:
    """Places the bodies whose pose the file says; they may touch, and stand in virtual things."""
    things: list[Entity] = [*experiment.boxes, *experiment.cylinders]
    for thing in things:
        footprint = of_entity(thing)
        assert footprint is not None
        placed.footprints.append(footprint)
    bodies: list[ObjectSpec | RobotSpec] = [*experiment.objects, *experiment.robots]
    for body in bodies:
        if body.pose is not None:
            footprint = of_robot(f"the body with tag {body.tag}", body.pose)
            in_the_way = _obstacle(experiment, placed, footprint, -_TOUCH_M)
            if in_the_way:
                raise experiment.error(body.line, f"{body.id!r} overlaps with {in_the_way}")
            placed.poses[body.tag] = body.pose
            placed.footprints.append(footprint)


def _draw_free(
    experiment: Experiment,
    placed: _Placement,
    spec: RobotSpec | ObjectSpec | DistributedSpec,
    distribution: Distribution,
    draws: random.Random,
) -> None:
    """Draws places until one is free; the last obstacle tells why none was."""
    index = placed.drawn[distribution.number]
    placed.drawn[distribution.number] += 1
    is_random = distribution.position_m.is_random or distribution.orientation_rad.is_random
    trials = distribution.max_trials if is_random else 1
    obstacle = "nothing"
    for _ in range(trials):
        position_m = distribution.position_m.sample(index, draws)
        turn_rad = distribution.orientation_rad.sample(index, draws)[0]
        yaw_rad = float(wrap_angle(turn_rad))
        obstacle = _try(experiment, placed, spec, position_m, yaw_rad)
        if not obstacle:
            return
    name = spec.entity.id if isinstance(spec, DistributedSpec) else spec.id
    raise experiment.error(
        distribution.line,
        f"<entity> max_trials: no room for {name!r} found in {trials} trials"
        f" (the last one hit {obstacle}); give more trials, more room or fewer of them",
    )


def _try(
    experiment: Experiment,
    placed: _Placement,
    spec: RobotSpec | ObjectSpec | DistributedSpec,
    position_m: Vector,
    yaw_rad: float,
) -> str:
    """Places a body if it stands free there; else names what is in the way."""
    if isinstance(spec, DistributedSpec):
        entity = _put(spec.entity, position_m, yaw_rad)
        footprint = of_entity(entity)
        if footprint is None:
            placed.entities.append(entity)
            return ""
        obstacle = _obstacle(experiment, placed, footprint, MIN_GAP_M)
        if not obstacle:
            placed.entities.append(entity)
            placed.footprints.append(footprint)
        return obstacle
    pose = Pose(position_m[0], position_m[1], yaw_rad)
    footprint = of_robot(f"the body with tag {spec.tag}", pose)
    obstacle = _obstacle(experiment, placed, footprint, MIN_GAP_M)
    if not obstacle:
        placed.poses[spec.tag] = pose
        placed.footprints.append(footprint)
    return obstacle


def _put(entity: Entity, position_m: Vector, yaw_rad: float) -> Entity:
    """Moves an entity to a drawn place; what stands in the real arena stays on the floor."""
    x_m, y_m, z_m = position_m
    turns = not isinstance(entity, (Cylinder, Light))
    entity = moved(entity, x_m, y_m, yaw_rad if turns else None)
    if isinstance(entity, Light) or (isinstance(entity, (Box, Cylinder)) and not entity.physical):
        return replace(entity, position_m=(x_m, y_m, z_m))
    return entity


def _obstacle(
    experiment: Experiment, placed: _Placement, footprint: Footprint, gap_m: float
) -> str:
    """Names what a body at this place would overlap with; "" if it stands free."""
    if not footprint.is_inside(experiment.arena, gap_m):
        return "the arena's border"
    for other in placed.footprints:
        if footprint.distance_m(other) < gap_m:
            return other.what
    return ""
