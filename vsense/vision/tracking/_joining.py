"""Unlisted tags: how markers whose tag is not on the roster are read, and how they join it.

Without a roster each cell has to be sure by itself: the blur is taken back, and the marker is read
only where no cell is near to the middle between black and white, for what the picture's errors
become when the blur is taken back.

A tag joins when it was read for long enough at one place that moves no faster than robots do,
without a reading to the contrary; and only if it cannot be a robot of the roster that is missing
and has something lying on its marker.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import UNNAMED, Floats
from vsense.vision.markers.families import (
    BLURS_U,
    MarkerFamily,
    SquareFamily,
    cell_blur,
    outer_light,
    usable,
)
from vsense.vision.tracking._views import MERGE_M

Tags = NDArray[np.int32]

_LEAST_ERROR = 0.015
"""Root mean square error of a cell's brightness in the best picture."""
_DEVIATIONS = 4.0
"""So many standard deviations each cell must be away from the middle."""
_ALIKE = 2


class UnlistedTagReader:
    """Reads one family's markers, whatever their tags are."""

    def __init__(self, family: MarkerFamily) -> None:
        sigmas = (family.unit_mm * BLURS_U).tolist()
        count = len(sigmas)
        cells = family.grid**2
        self._values = 1 << np.arange(cells, dtype=np.int64)
        blurs = np.array([[cell_blur(family, a, b) for b in sigmas] for a in sigmas])
        self._blurs = blurs.reshape(count, count, cells, cells)
        self._inverse = np.linalg.inv(self._blurs)
        self._gain = np.sqrt((self._inverse**2).sum(axis=3))
        self._outer = np.array([[outer_light(family, a, b) for b in sigmas] for a in sigmas])

    def read(self, cells: Floats, ahead: NDArray[np.intp], left: NDArray[np.intp]) -> Tags:
        """Reads markers.

        Args:
            cells: (n, cells) brightness, 0 true black, 1 true white.
            ahead, left: (n,) the blur along and across the heading, an index of `codes.BLURS_U`.

        Returns:
            (n,) tags; -1 where one cell is not sure, or where nearly all are black or white.
        """
        seen = cells - self._outer[ahead, left]
        sharp = np.einsum("nij,nj->ni", self._inverse[ahead, left], seen)
        bits = sharp > 0.5
        again = np.einsum("nij,nj->ni", self._blurs[ahead, left], bits.astype(np.float64))
        error = np.sqrt(((seen - again) ** 2).mean(axis=1, keepdims=True))
        doubt = np.maximum(error, _LEAST_ERROR) * self._gain[ahead, left]
        sure = (np.abs(sharp - 0.5) > _DEVIATIONS * doubt).all(axis=1)
        sure &= usable(bits.sum(axis=1), bits.shape[1])
        return np.where(sure, bits @ self._values, UNNAMED).astype(np.int32)


@cache
def unlisted_tag_reader(family: MarkerFamily) -> UnlistedTagReader:
    """Returns a family's reader, which all its decoders share."""
    return UnlistedTagReader(family)


def could_be(family: MarkerFamily, tag: int, read: int) -> bool:
    """Whether a marker that was read as `read` may be `tag` with something lying on it.

    What lies on a marker blackens cells or whitens them; a few cells may be anything.
    """
    true, seen = family.bits(tag), family.bits(read)
    darkened, lightened = (true & ~seen).sum(), (seen & ~true).sum()
    return bool(min(darkened, lightened) == 0 or darkened + lightened <= _ALIKE)


_Place = tuple[float, float]
_Key = tuple[str, int]


@dataclass(frozen=True, slots=True)
class UnlistedTags:
    """What one camera's picture shows of tags that are not on its detector's roster.

    Attributes:
        height_m: Height of the markers above the floor, taken for unlisted tags, too.
        tags: (n,) what was read.
        places: (n, 2) where in the arena [m].
    """

    family: MarkerFamily | SquareFamily
    roster: Collection[int]
    height_m: float
    tags: NDArray[np.int32]
    places: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class JoinLimits:
    """What it takes to join.

    Attributes:
        timesteps: So many readings without one to the contrary (10).
        last_s: Over at least this time (1.0).
        gap_s: The longest time without a reading (0.5).
        max_speed_m_s: Greatest speed of a robot (0.25).
        slack_m: Added to how far it can have come (0.02).
    """

    timesteps: int = 10
    last_s: float = 1.0
    gap_s: float = 0.5
    max_speed_m_s: float = 0.25
    slack_m: float = 0.02


@dataclass(frozen=True, slots=True)
class Newcomer:
    """A tag that joins the roster of its family, and the height of its marker [m]."""

    family: str
    tag: int
    height_m: float


@dataclass(slots=True)
class _Candidate:
    first_ns: int
    last_ns: int
    place: _Place
    readings: int = 1


class Joining:
    """Gathers evidence for tags that are on no roster; to be called from one thread."""

    def __init__(self, limits: JoinLimits | None = None) -> None:
        self._limits = limits or JoinLimits()
        self._candidates: dict[_Key, _Candidate] = {}

    def update(
        self,
        now_ns: int,
        seen: Mapping[str, UnlistedTags],
        sightings: NDArray[np.void],
        listed: Collection[int],
    ) -> list[Newcomer]:
        """Takes one timestep; returns who joins now, sorted.

        Args:
            now_ns: Its capture time.
            seen: By the camera's id, what its picture shows.
            sightings: (n,) VIEW of the tags on the roster.
            listed: All tags on any roster; none of them can join.
        """
        oldest_ns = now_ns - round(1e9 * self._limits.gap_s)
        self._candidates = {k: c for k, c in self._candidates.items() if c.last_ns >= oldest_ns}
        cameras = [seen[camera] for camera in sorted(seen)]
        places = _gather(cameras, listed)
        if not places:
            return []
        alone = _alone(places, np.stack((sightings["x_m"], sightings["y_m"]), axis=-1))
        for key, mine in places.items():
            if key in alone and all(math.dist(mine[0], place) <= MERGE_M for place in mine[1:]):
                self._read(key, mine[0], now_ns)
            else:
                self._candidates.pop(key, None)
        return [
            Newcomer(*key, height_m)
            for key, height_m in self._ready(now_ns, cameras, set(sightings["tag"].tolist()))
            if key in places
        ]

    def _read(self, key: _Key, place: _Place, now_ns: int) -> None:
        """Counts a reading; one from where the candidate cannot have come starts again."""
        candidate = self._candidates.get(key)
        if candidate is not None:
            elapsed_s = 1e-9 * (now_ns - candidate.last_ns)
            reach_m = self._limits.slack_m + self._limits.max_speed_m_s * elapsed_s
            if math.dist(candidate.place, place) <= reach_m:
                candidate.readings += 1
                candidate.last_ns, candidate.place = now_ns, place
                return
        self._candidates[key] = _Candidate(now_ns, now_ns, place)

    def _ready(
        self,
        now_ns: int,
        cameras: Iterable[UnlistedTags],
        named: Collection[int],
    ) -> list[tuple[_Key, float]]:
        """Returns the tags that were read often enough, and can be none of the roster's.

        `named` are those of the roster that some camera sees.
        """
        ready = {
            key
            for key, candidate in self._candidates.items()
            if candidate.readings >= self._limits.timesteps
            and now_ns - candidate.first_ns >= 1e9 * self._limits.last_s
        }
        heights_m: dict[_Key, float] = {}
        for unlisted in cameras if ready else ():
            missing = [tag for tag in unlisted.roster if tag not in named]
            for tag in unlisted.tags.tolist():
                key = unlisted.family.name, tag
                if key in ready and _may_be_missing(unlisted.family, tag, missing):
                    ready.discard(key)
                heights_m[key] = unlisted.height_m
        return sorted((key, heights_m[key]) for key in ready & heights_m.keys())


def _gather(cameras: Iterable[UnlistedTags], listed: Collection[int]) -> dict[_Key, list[_Place]]:
    """Returns where each tag was read that may join."""
    places: dict[_Key, list[_Place]] = {}
    for unlisted in cameras:
        for tag, (x_m, y_m) in zip(unlisted.tags.tolist(), unlisted.places.tolist(), strict=True):
            if tag not in listed:
                places.setdefault((unlisted.family.name, tag), []).append((x_m, y_m))
    return places


def _alone(places: Mapping[_Key, list[_Place]], named: Floats) -> set[_Key]:
    """Returns the tags beside which nothing else was seen; `named` (n, 2) are the roster's."""
    everywhere = [place for theirs in places.values() for place in theirs]
    points = np.concatenate((np.array(everywhere).reshape(-1, 2), named))
    begin, alone = 0, set[_Key]()
    for key, mine in places.items():
        near = np.hypot(*(points - mine[0]).T) <= MERGE_M
        near[begin : begin + len(mine)] = False
        begin += len(mine)
        if not near.any():
            alone.add(key)
    return alone


def _may_be_missing(family: MarkerFamily | SquareFamily, read: int, missing: Iterable[int]) -> bool:
    """Whether a robot of the roster that no camera sees may look like this.

    No word of a square family becomes another: they differ in too many cells.
    """
    if isinstance(family, SquareFamily):
        return False
    return any(could_be(family, tag, read) for tag in missing)
