"""Where robots may be and how fast: `<vs:geofence>` in `<arena>`, and polygons on the floor."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from vsense.base.arena import Floats, from_sides_m
from vsense.base.xml.element import MAX_SHOWN, Element
from vsense.config._things import MAX_SIZE_M
from vsense.world.entities import Arena
from vsense.world.robot_models import EPUCK

Corner = tuple[float, float]

MAX_SPEED_M_S = EPUCK.max_steps_s * EPUCK.step_m
"""What an e-puck's motors can do."""
_MIN_SPEED_M_S = 0.01
"""A robot on its way home that is slower counts as stuck."""
_MAX_CORNERS, _MAX_ZONES, _MAX_TAG = 100, 50, 65_535
_MIN_SIDE_M = 0.001
_MIN_DISTANCE_M, _MAX_DISTANCE_M = 0.01, 10.0


@dataclass(frozen=True, slots=True)
class Polygon:
    """A region of the floor; its sides meet at the `corners` only: x_m, y_m, arena frame."""

    corners: tuple[Corner, ...]

    def depth_m(self, points: Floats) -> Floats:
        """How far points (..., 2) are inside: (...) from the nearest side, negative outside."""
        distance, is_inside = from_sides_m(self.corners, points)
        return np.asarray(np.where(is_inside, distance, -distance))


@dataclass(frozen=True, slots=True)
class Geofence:
    """Where robots may be: a robot elsewhere stands.

    Attributes:
        boundary: the middle of every robot is inside.
        forbidden: and outside of these.
        keep_off: by id of a robot or object, how far the middles of all others are from its [m].
        v_max_m_s: how fast wheels may be; None: as fast as they can.
    """

    boundary: Polygon
    forbidden: tuple[Polygon, ...] = ()
    keep_off: Mapping[str, float] = field(default_factory=dict)
    v_max_m_s: float | None = None

    def depth_m(self, points: Floats) -> Floats:
        """How far points (..., 2) are from where no robot may be: (...), negative there."""
        depths = [self.boundary.depth_m(points), *(-p.depth_m(points) for p in self.forbidden)]
        return np.asarray(np.minimum.reduce(depths))


def arena_fence(arena: Arena) -> Geofence:
    """The fence of an experiment that names none."""
    return Geofence(Polygon(arena.corners_m))


def read_geofence(
    element: Element,
    arena: Arena,
    tags: Mapping[str, int],
    simulated: bool,
    replaced: Iterable[tuple[int, int]] = (),
    fastest_m_s: float = MAX_SPEED_M_S,
) -> Geofence | None:
    """Reads the fence in `<arena>`, None: there is none.

    Args:
        tags: of all that wears a marker, by id.
        simulated: it is read for a simulation, where it holds nobody.
        replaced: a tag of the file, and that of the robot which plays in its place.
        fastest_m_s: what the motors of the fastest robot can do.

    Raises:
        ConfigError: it is wrong.
    """
    fence = element.optional_child("vs:geofence")
    if fence is None:
        return None
    boundary = _read_polygon(fence) if fence.has("polygon") else Polygon(arena.corners_m)
    forbidden = list[Polygon]()
    for child in fence.children("vs:forbidden"):
        if len(forbidden) == _MAX_ZONES:
            raise child.error(f"is zone {_MAX_ZONES + 1}, expected at most {_MAX_ZONES}")
        forbidden.append(_read_polygon(child))
        if forbidden[-1] in forbidden[:-1]:
            raise child.error("there is another one with the same corners", "polygon")
    names = {tag: name for name, tag in tags.items()}
    names |= {tag: names[other] for tag, other in replaced if other in names}
    keep_off = _read_keep_off(fence, names)
    v_max_m_s = None
    if fence.has("v_max"):
        v_max_m_s = fence.number("v_max", _MIN_SPEED_M_S, fastest_m_s, "m/s")
    if simulated:
        fence.warn("has nobody stand in a simulation: only its v_max counts")
    return Geofence(boundary, tuple(forbidden), keep_off, v_max_m_s)


def _read_keep_off(fence: Element, names: Mapping[int, str]) -> dict[str, float]:
    keep_off = dict[str, float]()
    for child in fence.children("vs:keep_off"):
        tag = child.integer("tag", 0, _MAX_TAG)
        if tag not in names:
            words = ", ".join(map(str, sorted(names)))[:MAX_SHOWN]
            raise child.error(f"nothing has the tag {tag}; expected one of {words}", "tag")
        if names[tag] in keep_off:
            raise child.error(f"{tag} is the tag of another one", "tag")
        keep_off[names[tag]] = child.number("distance", _MIN_DISTANCE_M, _MAX_DISTANCE_M, "m")
    return keep_off


def _read_polygon(element: Element) -> Polygon:
    corners = element.points("polygon", 3, _MAX_CORNERS, MAX_SIZE_M, "m")
    crossing = _first_crossing(corners)
    if crossing is not None:
        first, second = (f"{n + 1} ({corners[n][0]:g},{corners[n][1]:g})" for n in crossing)
        raise element.error(
            f"the sides from corner {first} and from corner {second} meet; expected sides that meet"
            " at the corner that they share, and nowhere else",
            "polygon",
        )
    for number, (here, there) in enumerate(zip(corners, [*corners[1:], corners[0]]), 1):
        if math.dist(here, there) < _MIN_SIDE_M:
            raise element.error(
                f"the side from corner {number} ({here[0]:g},{here[1]:g}) is shorter than"
                f" {_MIN_SIDE_M:g} m",
                "polygon",
            )
    return Polygon(tuple(corners))


def _first_crossing(corners: list[Corner]) -> tuple[int, int] | None:
    """The numbers of two sides that meet elsewhere than at their common corner; None: none do."""
    count = len(corners)
    for i, j in combinations(range(count), 2):
        a, b, c, d = (corners[n % count] for n in (i, i + 1, j, j + 1))
        if j - i == 1:
            meet = _folds(a, b, d)
        elif j - i == count - 1:
            meet = _folds(b, a, c)
        else:
            meet = _cross(a, b, c, d)
        if meet:
            return i, j
    return None


def _folds(a: Corner, b: Corner, c: Corner) -> bool:
    """Whether the way from a over b to c goes back on itself, or has no length."""
    ahead = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return _turn(a, b, c) == 0.0 and (ahead < 0.0 or b in (a, c))


def _cross(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    """Whether the sides from a to b and from c to d have a point in common."""
    apart = any(
        max(min(a[k], b[k]), min(c[k], d[k])) > min(max(a[k], b[k]), max(c[k], d[k]))
        for k in (0, 1)
    )
    ends = _turn(a, b, c) * _turn(a, b, d) <= 0.0 and _turn(c, d, a) * _turn(c, d, b) <= 0.0
    return ends and not apart


def _turn(a: Corner, b: Corner, c: Corner) -> float:
    """Positive where the way from a over b to c turns left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
