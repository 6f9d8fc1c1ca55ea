"""Where the robots are expected: what the arena tracker gives the detectors beforehand.

The tracker writes between timesteps, on its own thread; the detectors read meanwhile, on theirs.
What a detector keeps here of a camera's pictures is touched by that camera's thread alone, so the
order of the threads changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from statistics import median

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState, Floats, wrap_angle
from vsense.vision.cameras._camera_array import CameraArray, Index
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking._joining import UnlistedTags
from vsense.vision.tracking._rows import Rows, is_in
from vsense.vision.tracking.mask import Mask

EXPECTED = np.dtype(
    [
        ("tag", "i4"),
        ("x_m", "f8"),
        ("y_m", "f8"),
        ("yaw_rad", "f8"),
        ("sure", "?"),
        ("height_m", "f8"),
    ]
)
"""A robot where it should be now. `sure`: seen so lately that it can be nowhere else, and often
enough to believe its name; `height_m`: of its marker above the floor."""

_SURE_S = 0.25
_LOST_S = 1.0
_SURE_SIGHTINGS = 2


@dataclass(frozen=True, slots=True)
class SearchPlan:
    """How much of the pictures is searched (thesis, 2.2.1).

    Attributes:
        key_frame_period: Every so many timesteps whole pictures are searched (1: always).
        square_size_m: Side of the squares searched in between, where robots are expected (0.11).
        warm: Fit known robots directly where they are expected, and search only the squares of
            those that do not fit.
    """

    key_frame_period: int = 1
    square_size_m: float = 0.11
    warm: bool = False


KNOWN = np.dtype(
    [
        ("tag", "i4"),
        ("x_m", "f8"),
        ("y_m", "f8"),
        ("yaw_rad", "f8"),
        ("capture_ns", "i8"),
        ("velocity", "f8", (3,)),
        ("sightings", "i8"),
    ]
)
"""A robot where it was seen last; `velocity` in x, y [m/s] and yaw [rad/s]; `sightings` without a
long pause."""


@dataclass(slots=True)
class Anonymous:
    """Markers of one camera that have no name yet, with what their cells have said so far.

    Attributes:
        rows: (n,) which of the newest timestep's markers they are.
        places: (n, 2) where they were seen last [m], at `capture_ns`.
        cells: (n, cells) sum of their brightness over the pictures.
        pictures: (n,) how many pictures that were.
    """

    rows: NDArray[np.intp]
    places: Floats
    cells: Floats
    pictures: NDArray[np.int64]
    capture_ns: int


@dataclass(slots=True)
class Prediction:
    """The robots' expected poses, and each camera's nameless markers, by the camera's id.

    Attributes:
        heights_m: The height of each tag's marker above the floor; 0 for others.
        capture_ns: The timestep's capture time.
        is_key_frame: Whether whole pictures are searched in this timestep.
        expected: EXPECTED, sorted by tag.
        unlisted: By the camera's id, tags in the timestep's picture that are on no roster.
        joined: By the family's name, the tags that have joined the roster, in their order.
        turns: By the camera's id, how many of its pictures were key frames, and its place among
            the cameras. Each counts its own: a slower one would else miss its turn each time.
        known: KNOWN, sorted by tag: what the next timestep is expected from.
        gone: Whether a robot of the roster is nowhere to be expected, as another computer knows
            it; None: as `expected` says.
        learned: Called when a timestep has been learned, and who has joined is known.
    """

    plan: SearchPlan = field(default_factory=SearchPlan)
    heights_m: Mapping[int, float] = field(default_factory=dict)
    capture_ns: int = 0
    is_key_frame: bool = True
    expected: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, dtype=EXPECTED))
    anonymous: dict[str, Anonymous] = field(default_factory=dict)
    unlisted: dict[str, UnlistedTags] = field(default_factory=dict)
    joined: dict[str, tuple[int, ...]] = field(default_factory=dict)
    turns: dict[str, int] = field(default_factory=dict)
    known: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, dtype=KNOWN))
    gone: bool | None = None
    learned: Callable[[], None] = lambda: None
    _timesteps: int = 0

    def expect(self, capture_ns: int, cameras: Iterable[str] = ()) -> None:
        """Prepares a timestep with pictures of `cameras`."""
        self.is_key_frame = self.is_next_key_frame
        self._timesteps += 1
        for camera in cameras if self.is_key_frame else ():
            self.turns[camera] = self.turns.get(camera, len(self.turns)) + 1
        self.foresee(capture_ns)

    @property
    def is_next_key_frame(self) -> bool:
        """Whether whole pictures are searched in the next timestep."""
        return self._timesteps % self.plan.key_frame_period == 0

    def tell(self, learned: Callable[[], None]) -> None:
        """Has somebody called when a timestep has been learned, and who has joined is known."""
        self.learned = learned

    def adopt(
        self,
        known: NDArray[np.void],
        heights_m: Mapping[int, float],
        is_key_frame: bool,
        gone: bool | None,
        joined: dict[str, tuple[int, ...]],
    ) -> None:
        """Takes over what the tracker on another computer knows; see the attributes."""
        self.known, self.heights_m, self.joined = known, heights_m, joined
        self.is_key_frame, self.gone = is_key_frame, gone

    def foresee(self, capture_ns: int) -> None:
        """Has the robots go on as they moved."""
        self.capture_ns = capture_ns
        self.unlisted.clear()
        elapsed = np.maximum(1e-9 * (capture_ns - self.known["capture_ns"]), 0.0)
        recent, elapsed = self.known[elapsed < _LOST_S], elapsed[elapsed < _LOST_S]
        way = np.minimum(elapsed, _SURE_S)[:, np.newaxis] * recent["velocity"]
        self.expected = expected = np.zeros(len(recent), dtype=EXPECTED)
        expected["tag"] = recent["tag"]
        expected["x_m"], expected["y_m"] = recent["x_m"] + way[:, 0], recent["y_m"] + way[:, 1]
        expected["yaw_rad"] = wrap_angle(recent["yaw_rad"] + way[:, 2])
        expected["sure"] = (elapsed <= _SURE_S) & (recent["sightings"] >= _SURE_SIGHTINGS)
        expected["height_m"] = [self.heights_m.get(tag, 0.0) for tag in recent["tag"].tolist()]

    def learn(self, state: ArenaState) -> None:
        """Takes what the timestep has shown."""
        seen = state.robots[state.robots["seen"]]
        now = np.zeros(len(seen), dtype=KNOWN)
        for name in ("tag", "x_m", "y_m", "yaw_rad"):
            now[name] = seen[name]
        now["capture_ns"], now["sightings"] = state.capture_ns, 1
        again = is_in(now["tag"], self.known["tag"])
        new = np.flatnonzero(again)
        old = np.searchsorted(self.known["tag"], now["tag"][again])
        elapsed = 1e-9 * (state.capture_ns - self.known["capture_ns"][old])
        lately = (elapsed > 0.0) & (elapsed < _LOST_S)
        new, last, elapsed = new[lately], self.known[old[lately]], elapsed[lately]
        way = [now[name][new] - last[name] for name in ("x_m", "y_m", "yaw_rad")]
        way[2] = wrap_angle(way[2])
        now["velocity"][new] = np.stack(way, axis=-1) / elapsed[:, np.newaxis]
        now["sightings"][new] = last["sightings"] + 1
        unseen = self.known[~is_in(self.known["tag"], now["tag"])]
        rows = np.concatenate((unseen, now))
        self.known = rows[np.argsort(rows["tag"])]

    def in_view(self, cameras: CameraArray, height_m: float) -> Rows:
        """Returns those of `expected` whose middle is in a camera's picture, sorted by the picture.

        Their places are given as the camera sees them, on a plane `height_m` above the floor. A
        picture's number is its camera's place.
        """
        robots = self.expected
        foot, top_m = cameras.position_m[:, :2], cameras.position_m[:, 2:]
        share = (top_m - height_m) / (top_m - robots["height_m"])
        x_m = foot[:, :1] + share * (robots["x_m"] - foot[:, :1])
        y_m = foot[:, 1:] + share * (robots["y_m"] - foot[:, 1:])
        left, right, near, far = cameras.ground(height_m).T[..., np.newaxis]
        picture, robot = np.nonzero((x_m > left) & (x_m < right) & (y_m > near) & (y_m < far))
        seen = robots[robot]
        seen["x_m"], seen["y_m"] = x_m[picture, robot], y_m[picture, robot]
        rows = Rows(seen, picture)
        return rows.where(
            cameras.contain(cameras.project(at_height(rows, height_m), picture), picture)
        )

    def windows(
        self, cameras: CameraArray, height_m: float, places: Floats, picture: Index
    ) -> NDArray[np.int32]:
        """Returns the squares of the pictures around (n, 2) places of the arena [m].

        `height_m` is that of the markers, `picture` (n,) the places' cameras. The squares are
        (n, 4) left, top, right, bottom [px].
        """
        half = 0.5 * self.plan.square_size_m
        corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        points = np.full((len(places), 4, 3), height_m)
        points[..., :2] = places[:, np.newaxis] + corners
        pixels = cameras.project(points.reshape(-1, 3), np.repeat(picture, 4)).reshape(-1, 4, 2)
        low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1)) + 1.0
        return np.concatenate((low, high), axis=1).astype(np.int32)


def at_height(rows: Rows, height_m: float) -> Floats:
    """Returns (n, 3) points of the arena [m] from rows' places and a height above the floor."""
    return np.column_stack((rows.places(), np.full(len(rows.picture), height_m)))


@dataclass(frozen=True, slots=True)
class MarkerSearch:
    """What is looked for in a camera's pictures.

    Attributes:
        family: The marker family.
        heights_m: The roster: the height of each tag's marker above the floor. A marker with any
            other tag is reported without a name.
        open_roster: Whether robots with other tags of the family can join.
        at_m: Height of the plane on which detectors work; None: the usual height of the markers.
        mask: Where markers are; None: everywhere.
    """

    family: MarkerFamily | SquareFamily
    heights_m: Mapping[int, float]
    open_roster: bool = True
    at_m: float | None = None
    mask: Mask | None = None

    @property
    def height_m(self) -> float:
        """Height above the floor of the plane on which detectors work."""
        if self.at_m is not None:
            return self.at_m
        return median(self.heights_m.values()) if self.heights_m else 0.0
