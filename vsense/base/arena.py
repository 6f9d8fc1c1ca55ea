"""Arena states: one per timestep, as structured arrays, as a message, and as text.

The arena frame is right-handed with the floor at z = 0; yaw is counter-clockwise in (-pi, pi] and
zero along +x. Times are integer nanoseconds of the host's monotonic clock. As text a covariance is
six numbers of x, y and yaw: xx, xy, x yaw, yy, y yaw, yaw yaw.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Image = NDArray[np.uint8]
Point = tuple[float, float]
"""x and y."""

POSE = np.dtype(
    [
        ("tag", "u4"),
        ("x_m", "f8"),
        ("y_m", "f8"),
        ("yaw_rad", "f8"),
        ("speed_m_s", "f8"),
        ("capture_ns", "i8"),
        ("age_ns", "i8"),
        ("confidence", "f4"),
        ("cameras", "u4"),
        ("seen", "?"),
        ("covariance", "f8", (3, 3)),
    ]
)
"""One robot of an arena state.

`tag` is the number on the marker; `x_m`, `y_m` and `yaw_rad` are the robot's in the arena frame, at
the arena state's capture time: the middle of its axle where it is known how its marker sits on it
(`vsense/vision/tracking/arena_tracker.py`), otherwise the disc's centre; `capture_ns` the time of
the picture that last showed the robot; `age_ns` how much older that is than the arena state;
`confidence` in [0, 1], falling while the robot is not seen; `cameras` how many cameras contributed;
`seen` whether any did in this timestep; `covariance` that of the errors of x, y [m] and yaw [rad],
NaN where it is unknown, as with another tracker's states. A robot that is not seen is extrapolated
for a moment, then held, then left out.
"""

DETECTION = np.dtype(
    [
        ("tag", "i4"),
        ("x_px", "f8"),
        ("y_px", "f8"),
        ("yaw_rad", "f8"),
        ("covariance", "f8", (3, 3)),
        ("error", "f4"),
        ("margin", "f4"),
        ("read", "?"),
        ("legible", "?"),
    ]
)
"""One marker in one picture.

`tag` is the number, or -1 for a marker that could not be named; `x_px`, `y_px` the picture of the
disc's centre; `yaw_rad` the heading in the arena frame; `covariance` that of the errors of x, y [m]
and yaw [rad] in the arena frame, as far as the picture alone shows; `error` the decoder's distance
to the tag's code word; `margin` how much farther the next best code word is (a ratio); `read`
whether the tag is what its cells say in this picture alone, and does not follow from where it is;
`legible` whether its edges are sharp enough for that.
"""

SIGHTING = np.dtype([("tag", "u4"), ("x_m", "f8"), ("y_m", "f8"), ("yaw_rad", "f8")])
"""One place in the arena where a tag was read in this timestep, before tracking.

`tag` is the number read; `x_m`, `y_m` the disc's centre and `yaw_rad` the heading in the arena
frame, merged over the cameras that saw it there.
"""

IMAGE_POSE = np.dtype(
    [
        ("tag", "u4"),
        ("camera", "u2"),
        ("x_px", "f8"),
        ("y_px", "f8"),
        ("yaw_px_rad", "f8"),
        ("x_m", "f8"),
        ("y_m", "f8"),
        ("yaw_rad", "f8"),
    ]
)
"""One robot in one camera's picture (thesis, 2.2: ArenaElement).

`tag` is the number that was read; `camera` the camera's place in the arena state's `cameras`;
`x_px`, `y_px` the picture of the disc's centre; `yaw_px_rad` the heading in the picture,
counter-clockwise in (-pi, pi] and 0 to the right; `x_m`, `y_m`, `yaw_rad` the pose in the arena
frame by this camera alone.
"""

UNNAMED = -1
"""The tag of a detection whose number could not be read."""


UNLISTED = np.dtype([("tag", "<i4"), ("x_m", "<f8"), ("y_m", "<f8")])
"""A tag that is on no roster, and where in the arena a camera has read it."""


class Found(NamedTuple):
    """What was found in a picture on the computer that took it.

    Attributes:
        rows: DETECTION.
        full: Whether it held more than the detector's tables.
        unlisted: UNLISTED.
    """

    rows: NDArray[np.void]
    full: bool
    unlisted: NDArray[np.void]


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture of one camera.

    Attributes:
        image: (height, width) uint8, grey; of a camera on another computer a coarse one, or none:
            all black.
        timestep: The trigger that the picture belongs to.
        capture_ns: Middle of the exposure.
        ready_ns: When the last pixel was in memory.
        place: Which picture of its recording it is.
        found: What another computer has found in it; None: it is to be looked at.
    """

    camera: str
    image: NDArray[np.uint8]
    timestep: int
    capture_ns: int
    ready_ns: int
    place: int = 0
    found: Found | None = None


@dataclass(frozen=True, slots=True)
class ArenaState:
    """Every known robot at one timestep.

    Attributes:
        capture_ns: The newest capture time among the frames it was made from.
        robots: POSE array, sorted by tag, one entry per known robot.
        detected: Distinct tags named by raw detections in this timestep, without predictions.
        unnamed: Markers in this timestep whose number could not be read.
        duplicates: Tags that were read at two places at once, sorted. Such a tag is followed
            only where one place alone can be reached from where the robot was.
        sightings: SIGHTING array, the raw readings of this timestep.
        joined: Tags that were not on the roster and have joined it since, sorted.
        cameras: Ids of the cameras whose pictures it was made from, sorted.
        images: IMAGE_POSE array, where the cameras see robots in this timestep, sorted by camera
            and tag.
    """

    timestep: int
    capture_ns: int
    robots: NDArray[np.void]
    detected: int
    unnamed: int = 0
    duplicates: tuple[int, ...] = field(default=())
    sightings: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, SIGHTING))
    joined: tuple[int, ...] = field(default=())
    cameras: tuple[str, ...] = field(default=())
    images: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, IMAGE_POSE))

    def camera_state(self, camera: str) -> NDArray[np.void]:
        """What one camera sees (thesis, 2.2: GetCameraState), an IMAGE_POSE array.

        Raises:
            KeyError: No picture of that camera is in this timestep.
        """
        if camera not in self.cameras:
            raise KeyError(camera)
        return np.asarray(self.images[self.images["camera"] == self.cameras.index(camera)])

    def data(self) -> dict[str, Any]:
        """Gives its columns, unrounded.

        A covariance is nine numbers row by row, or null where it is unknown.
        """
        return {
            "timestep": self.timestep,
            "capture_ns": self.capture_ns,
            "robots": columns(self.robots),
            "detected": self.detected,
            "unnamed": self.unnamed,
            "duplicates": list(map(int, self.duplicates)),
            "joined": list(map(int, self.joined)),
            "sightings": columns(self.sightings),
            "cameras": list(self.cameras),
            "images": columns(self.images),
        }

    def to_json(self) -> str:
        """Gives one line without its end.

        `robots` hold the fields of POSE by their names, `covariance` as six numbers, or null where
        it is unknown; and in `images`, by the camera's id, where each camera sees the robot.
        `duplicate_sightings` are all places of the tags in `duplicates`.
        """
        images = _images(self)
        robots = [
            _fields(row)
            | {"covariance": _covariance(row), "images": images.get(int(row["tag"]), {})}
            for row in self.robots
        ]
        values = {
            "timestep": self.timestep,
            "capture_ns": self.capture_ns,
            "detected": self.detected,
            "unnamed": self.unnamed,
            "duplicates": [int(tag) for tag in self.duplicates],
            "duplicate_sightings": _twins(self),
            "joined": [int(tag) for tag in self.joined],
            "robots": robots,
        }
        return json.dumps(values, separators=(",", ":"), allow_nan=False)

    def to_csv(self) -> str:
        """Gives one line per robot, without the last end; unknown covariances are empty cells."""
        head = f"{self.timestep},{self.capture_ns},"
        return "\n".join(head + ",".join(_cells(row)) for row in self.robots)


def wrap_angle(angle_rad: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Returns the same angle in (-pi, pi] [rad], elementwise."""
    turn = np.asarray(angle_rad, dtype=np.float64)
    wrapped = np.pi - np.mod(np.pi - turn, 2.0 * np.pi)
    # Just above half a turn, the remainder rounds up to the whole turn.
    return np.where(wrapped > -np.pi, wrapped, np.pi)[()]


def turned(
    places: NDArray[np.float64], yaw_rad: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (k, 2 or more) in frames of (k,) headings, in the arena's directions: x and y [m]."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return cos * places[:, 0] - sin * places[:, 1], sin * places[:, 0] + cos * places[:, 1]


def columns(rows: NDArray[np.void]) -> dict[str, list[Any]]:
    """Gives a list per field of a structured array (n,)."""
    return {
        name: _covariances(rows[name]) if name == "covariance" else rows[name].tolist()
        for name in rows.dtype.names or ()
    }


def _covariances(covariances: NDArray[np.float64]) -> list[list[float] | None]:
    finite = np.asarray(np.isfinite(covariances).all(axis=(1, 2))).tolist()
    flat = covariances.reshape(len(covariances), 9).tolist()
    return [row if sure else None for row, sure in zip(flat, finite)]


def from_sides_m(corners: ArrayLike, points: ArrayLike) -> tuple[Floats, NDArray[np.bool_]]:
    """How far points (..., 2) are from the nearest side of a polygon (k, 2), and whether in it.

    The distance of what is no place is no number.
    """
    begins = np.asarray(corners, dtype=np.float64)
    sides = np.roll(begins, -1, axis=0) - begins
    away = np.asarray(points, dtype=np.float64)[..., np.newaxis, :] - begins
    with np.errstate(invalid="ignore"):
        lengths2 = np.maximum((sides**2).sum(axis=-1), 1e-300)
        share = np.clip((away * sides).sum(axis=-1) / lengths2, 0.0, 1.0)
        distance = np.linalg.norm(away - share[..., np.newaxis] * sides, axis=-1).min(axis=-1)
        # A side that a ray to +x crosses goes up and has the point on its left, or the reverse.
        up = away[..., 1] < sides[:, 1]
        left = sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0] > 0.0
        crossed = ((away[..., 1] < 0.0) != up) & (left == up)
    return np.asarray(distance), np.asarray(crossed.sum(axis=-1) % 2 == 1)


_UPPER = np.triu_indices(3)
_COVARIANCE = ("xx_m2", "xy_m2", "x_yaw_m_rad", "yy_m2", "y_yaw_m_rad", "yaw_yaw_rad2")
_PLAIN = tuple(name for name in POSE.names or () if name != "covariance")

CSV_HEADER = ",".join(
    ("timestep", "state_capture_ns", *_PLAIN, *(f"covariance_{name}" for name in _COVARIANCE))
)

_DECIMALS = {"x_m": 5, "y_m": 5, "yaw_rad": 5, "speed_m_s": 4, "confidence": 3}
_DIGITS = 3
"""Of a covariance."""


def _twins(state: ArenaState) -> list[dict[str, float]]:
    """Every place of a tag that was read at two places."""
    twins = state.sightings[np.isin(state.sightings["tag"], state.duplicates)]
    names = twins.dtype.names or ()
    return [{n: _plain(n, v) for n, v in zip(names, row)} for row in twins.tolist()]


def _fields(row: np.void) -> dict[str, Any]:
    return {name: _plain(name, row[name].item()) for name in _PLAIN}


def _plain(name: str, value: float | int | bool) -> float | int | bool:
    return round(value, _DECIMALS[name]) if name in _DECIMALS else value


def _covariance(row: np.void) -> list[float] | None:
    """The covariance's six numbers, None where they are not known."""
    numbers = row["covariance"][_UPPER].tolist()
    finite = all(math.isfinite(number) for number in numbers)
    return [float(f"{number:.{_DIGITS - 1}e}") for number in numbers] if finite else None


def _images(state: ArenaState) -> dict[int, dict[str, dict[str, float]]]:
    """Where the cameras see each tag, by tag and camera; without tags at two places."""
    poses: dict[int, dict[str, dict[str, float]]] = {}
    fields = ("tag", "camera", "x_px", "y_px", "yaw_px_rad")
    for tag, camera, x_px, y_px, yaw in zip(*(state.images[f].tolist() for f in fields)):
        if tag not in state.duplicates:
            pose = {"x_px": round(x_px, 2), "y_px": round(y_px, 2), "yaw_px_rad": round(yaw, 4)}
            poses.setdefault(tag, {})[state.cameras[camera]] = pose
    return poses


def _cells(row: np.void) -> list[str]:
    numbers = _covariance(row) or []
    cells = [_cell(name, row[name].item()) for name in _PLAIN]
    return cells + ([f"{v:g}" for v in numbers] or ["" for _ in _COVARIANCE])


def _cell(name: str, value: float | int | bool) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return f"{value:.{_DECIMALS[name]}f}" if name in _DECIMALS else str(value)
