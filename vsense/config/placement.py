"""Start poses: draws where the distributed robots stand when a run begins.

The draws depend on the seed alone: Python's own generator gives the same numbers for a seed in
every version, and the bodies are placed in the file's order.
"""

from __future__ import annotations

import math
import random

from vsense.arena import wrap_angle
from vsense.config.specs import (
    BODY_RADIUS_M,
    Box,
    Distribution,
    Draw,
    Experiment,
    ObjectSpec,
    Pose,
    RobotSpec,
    Vector,
)

MIN_GAP_M = 0.005
"""Free space around a drawn body."""

_TOUCH_M = 1e-9
"""Bodies that the file places side by side may touch."""


def place(experiment: Experiment, seed: int) -> dict[int, Pose]:
    """Gives every robot and object its start pose.

    Args:
        experiment: the experiment.
        seed: decides the poses of distributed robots.

    Returns:
        By tag the pose; yaw in (-pi, pi].

    Raises:
        ConfigError: bodies that the file places overlap, or a distributed one finds no room.
    """
    draws = random.Random(seed)
    poses: dict[int, Pose] = {}
    bodies: list[ObjectSpec | RobotSpec] = [*experiment.objects, *experiment.robots]
    for body in bodies:
        if body.pose is not None:
            in_the_way = _obstacle(experiment, poses, body.pose, -_TOUCH_M)
            if in_the_way:
                raise experiment.error(body.line, f"{body.id!r} overlaps with {in_the_way}")
            poses[body.tag] = body.pose
    for robot in experiment.robots:
        if robot.distribution is not None:
            poses[robot.tag] = _draw_free(experiment, poses, robot.distribution, robot.id, draws)
    return poses


def _draw_free(
    experiment: Experiment,
    poses: dict[int, Pose],
    distribution: Distribution,
    body: str,
    draws: random.Random,
) -> Pose:
    """Draws poses until one is free; the last obstacle tells why none was."""
    obstacle = "nothing"
    for _ in range(distribution.max_trials):
        x_m, y_m, _z = _sample(distribution.position_m, draws)
        yaw_rad, _, _ = _sample(distribution.orientation_rad, draws)
        pose = Pose(x_m, y_m, float(wrap_angle(yaw_rad)))
        obstacle = _obstacle(experiment, poses, pose, MIN_GAP_M)
        if not obstacle:
            return pose
    raise experiment.error(
        distribution.line,
        f"<entity> max_trials: no room for {body!r} found in {distribution.max_trials} trials"
        f" (the last one hit {obstacle}); give more trials, more room or fewer robots",
    )


def _sample(draw: Draw, draws: random.Random) -> Vector:
    if draw.method == "constant":
        return draw.first
    sample = draws.uniform if draw.method == "uniform" else draws.gauss
    x, y, z = (sample(a, b) for a, b in zip(draw.first, draw.second, strict=True))
    return x, y, z


def _obstacle(experiment: Experiment, poses: dict[int, Pose], pose: Pose, gap_m: float) -> str:
    """Names what a body at this pose would overlap with; "" if it stands free."""
    if not experiment.arena.contains(pose.x_m, pose.y_m, BODY_RADIUS_M + gap_m):
        return "the arena's border"
    for box in experiment.boxes:
        if box_distance(box, pose) < BODY_RADIUS_M + gap_m:
            return f"box {box.id!r}"
    for tag, other in poses.items():
        if math.hypot(other.x_m - pose.x_m, other.y_m - pose.y_m) < 2.0 * BODY_RADIUS_M + gap_m:
            return f"the body with tag {tag}"
    return ""


def box_distance(box: Box, pose: Pose) -> float:
    """Measures how far a point is from a box's outline, 0 inside [m]."""
    x, y = pose.x_m - box.position_m[0], pose.y_m - box.position_m[1]
    cosine, sine = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
    beyond_x = abs(x * cosine + y * sine) - box.size_m[0] / 2.0
    beyond_y = abs(y * cosine - x * sine) - box.size_m[1] / 2.0
    return math.hypot(max(beyond_x, 0.0), max(beyond_y, 0.0))
