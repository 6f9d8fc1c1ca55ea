"""Camera views: from one camera's detections to the arena, and from the arena to its picture.

Views of the same tag that lie together are one sighting; views that do not are several, and are
never merged.

Thesis, 2.2: an ArenaElement has a position and an orientation in the image, too. What the cameras
see is kept as it was seen; for clients that ask for one image pose of every robot, arena poses are
projected into the pictures.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import DETECTION, IMAGE_POSE, UNNAMED, Floats, turned, wrap_angle
from vsense.vision.cameras._camera_array import CameraArray, Index
from vsense.vision.tracking._rows import stack_rows
from vsense.vision.tracking.specs import PlacedMarker

VIEW = np.dtype(
    [
        ("tag", "i4"),
        ("x_m", "f8"),
        ("y_m", "f8"),
        ("yaw_rad", "f8"),
        ("capture_ns", "i8"),
        ("weight", "f8"),
        ("cameras", "i4"),
        ("covariance", "f8", (6,)),
        ("height_sensitivity", "f8", (2,)),
    ]
)
"""A marker in the arena, seen by one or more cameras at about the same time.

`tag` is the number on it; `x_m`, `y_m` the disc's centre in the arena frame; `yaw_rad` the heading
in (-pi, pi]; `capture_ns` when, the mean over the cameras with the weights; `weight` what it counts
when views are merged [1/m^2]: the inverse variance of the position, less near the picture's border,
so that nothing jumps where a view begins; `cameras` how many see it; `covariance` that of what the
pictures tell of x, y [m] and yaw [rad]: xx, xy, x yaw, yy, y yaw, yaw yaw; `height_sensitivity` how
far x and y [m] are off where the marker is one standard deviation higher than it is taken to be:
the same marker for all cameras.
"""

HEIGHT_DOUBT_M = 0.002
"""Standard deviation of the markers' heights, where nothing better is known."""

MERGE_M = 0.03
"""Views of one tag at most this far apart are the same marker: less than half a robot."""

_FADE = 0.15
_LEAST_FADE = 0.01
_UPPER = np.triu_indices(3)


def covariances(views: NDArray[np.void]) -> Floats:
    """Returns the covariance of x, y [m] and yaw [rad] of (n,) VIEW, (n, 3, 3).

    The heights' doubt is in it.
    """
    matrices = np.zeros((len(views), 3, 3))
    matrices[:, _UPPER[0], _UPPER[1]] = views["covariance"]
    matrices[:, _UPPER[1], _UPPER[0]] = views["covariance"]
    sensitivity = views["height_sensitivity"]
    matrices[:, :2, :2] += sensitivity[:, :, np.newaxis] * sensitivity[:, np.newaxis]
    return matrices


class Placed(NamedTuple):
    """The cameras' named detections, sorted by the picture and then by tag.

    Attributes:
        rows: (n,) DETECTION.
        picture: (n,) which of the pictures they are in.
        camera: (n,) the place of the picture's camera among all cameras.
        height_m: (n,) of their markers above the floor.
        ground_m: (n, 2) the discs' centres in the arena.
    """

    rows: NDArray[np.void]
    picture: Index
    camera: Index
    height_m: Floats
    ground_m: Floats


def place_markers(
    cameras: CameraArray,
    taken_by: Sequence[int],
    detections: Sequence[NDArray[np.void]],
    heights_m: Mapping[int, float],
) -> Placed:
    """Puts the pictures' named DETECTIONs into the arena.

    Args:
        cameras: The arena's.
        taken_by: The place of each picture's camera among them.
        detections: Each picture's.
        heights_m: Of the tags' markers above the floor; other tags are left out.
    """
    rows = stack_rows([np.zeros(0, dtype=DETECTION), *detections])
    picture = np.repeat(np.arange(len(detections)), [len(array) for array in detections])
    height_m = np.array([heights_m.get(tag, np.nan) for tag in rows["tag"].tolist()], dtype=float)
    named = (rows["tag"] != UNNAMED) & ~np.isnan(height_m)
    order = np.lexsort((rows["tag"], picture))
    order = order[named[order]]
    rows, picture, height_m = rows[order], picture[order], height_m[order]
    camera = np.array(taken_by, dtype=np.intp)[picture]
    pixels = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
    return Placed(rows, picture, camera, height_m, cameras.to_plane(pixels, height_m, camera))


def make_views(
    cameras: CameraArray,
    capture_ns: Sequence[int],
    placed: Placed,
    height_doubt_m: float = HEIGHT_DOUBT_M,
) -> NDArray[np.void]:
    """Returns what each camera sees, (n,) VIEW; `capture_ns` is each picture's.

    Each is as old as its row of the picture.

    A view far from the camera's foot point weighs less, because a wrong height shifts it more;
    `height_doubt_m` is the standard deviation of the markers' heights.
    """
    rows, picture, camera, height_m, ground_m = placed
    views = np.zeros(len(rows), dtype=VIEW)
    position_m = cameras.position_m[camera]
    away = (position_m[:, :2] - ground_m) / (position_m[:, 2] - height_m)[:, np.newaxis]
    sensitivity = height_doubt_m * away
    covariance = rows["covariance"]
    own = 0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1])
    pixels = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
    views["tag"], views["yaw_rad"], views["cameras"] = rows["tag"], rows["yaw_rad"], 1
    views["x_m"], views["y_m"] = ground_m.T
    below = rows["y_px"] - 0.5 * (cameras.size_px[camera, 1] - 1.0)
    later_ns = np.rint(cameras.row_time_ns[camera] * below).astype(np.int64)
    views["capture_ns"] = np.array(capture_ns, dtype=np.int64)[picture] + later_ns
    views["weight"] = _fade(cameras.size_px[camera], pixels) / (own + (sensitivity**2).sum(axis=1))
    views["covariance"] = covariance[:, _UPPER[0], _UPPER[1]]
    views["height_sensitivity"] = sensitivity
    return views


def _fade(size_px: Floats, pixels: Floats) -> Floats:
    """Returns what views count near their picture's border, where they begin and end."""
    inside = 0.5 * size_px - np.abs(pixels + 0.5 - 0.5 * size_px)
    share = np.clip(inside.min(axis=1) / (_FADE * size_px.min(axis=1)), 0.0, 1.0)
    return np.asarray(np.maximum(share**2 * (3.0 - 2.0 * share), _LEAST_FADE))


def merge_views(views: NDArray[np.void], picture: Index) -> NDArray[np.void]:
    """Merges (n,) VIEW of one timestep; `picture` is (n,) which picture each is in.

    Returns (k,) VIEW sorted by tag; a tag that is there more than once is duplicated. The result
    does not depend on the order of `views`. Two views of one picture are never merged: one marker
    is in a picture once.
    """
    if len(views) == 0:
        return views
    keys = ("capture_ns", "weight", "yaw_rad", "y_m", "x_m")
    doubts = views["height_sensitivity"].T
    order = np.lexsort((*doubts, *(views[key] for key in keys), picture, views["tag"]))
    views, picture = views[order], picture[order]
    cluster = _clusters(views, picture)
    order = np.argsort(cluster, kind="stable")
    return _merge(views[order], cluster[order])


def _clusters(views: NDArray[np.void], picture: Index) -> Index:
    """Returns which views, sorted by tag, are of one marker: (n,) a number for each marker."""
    tag, places = views["tag"], np.stack((views["x_m"], views["y_m"]), axis=-1)
    # Numbers that ascend with the tag, with room for as many markers of it as there are views.
    cluster = len(views) * np.searchsorted(tag, tag)
    apart = set()
    for step in range(1, len(views)):
        same = tag[step:] == tag[:-step]
        if not same.any():
            break
        far = np.hypot(*(places[step:] - places[:-step]).T) > MERGE_M
        apart.update(tag[step:][same & (far | (picture[step:] == picture[:-step]))].tolist())
    for contested in sorted(apart):
        rows = np.flatnonzero(tag == contested)
        markers: list[list[int]] = []
        for row in rows.tolist():
            home = next((m for m in markers if _belongs(row, m, places, picture)), None)
            if home is None:
                home = []
                markers.append(home)
            home.append(row)
        for number, marker in enumerate(markers):
            cluster[marker] += number
    return cluster


def _belongs(row: int, marker: list[int], places: Floats, picture: Index) -> bool:
    near = np.hypot(*(places[marker] - places[row]).T) <= MERGE_M
    return bool((near & (picture[marker] != picture[row])).all())


def _merge(views: NDArray[np.void], cluster: Index) -> NDArray[np.void]:
    """Returns each cluster's weighted mean; headings are averaged as vectors, so they may wrap."""
    starts = np.flatnonzero(np.concatenate(([True], cluster[1:] != cluster[:-1])))
    merged, counts = views[starts], np.diff(starts, append=len(views))
    several = counts > 1
    if not several.any():
        return merged
    total = np.add.reduceat(views["weight"], starts)
    share = views["weight"] / np.repeat(total, counts)

    def mean(values: Floats, weight: Floats = share) -> Floats:
        weight = weight.reshape(-1, *(1,) * (values.ndim - 1))
        return np.asarray(np.add.reduceat(weight * values, starts)[several])

    later = views["capture_ns"] - np.repeat(merged["capture_ns"], counts)
    yaw = views["yaw_rad"]
    merged["x_m"][several], merged["y_m"][several] = mean(views["x_m"]), mean(views["y_m"])
    merged["yaw_rad"][several] = np.arctan2(mean(np.sin(yaw)), mean(np.cos(yaw)))
    merged["capture_ns"][several] += np.rint(mean(later.astype(np.float64))).astype(np.int64)
    merged["weight"][several] = total[several]
    merged["cameras"] = np.add.reduceat(views["cameras"], starts)
    # The pictures' errors are independent; the marker has one height for all of them.
    merged["covariance"][several] = mean(views["covariance"], share**2)
    merged["height_sensitivity"][several] = mean(views["height_sensitivity"])
    return merged


def count_unnamed(detections: Iterable[NDArray[np.void]]) -> int:
    """Returns how many markers in the DETECTION arrays could not be named."""
    return int(sum((array["tag"] == UNNAMED).sum() for array in detections))


_AHEAD_M = 0.01


def image_poses(cameras: CameraArray, placed: Placed) -> NDArray[np.void]:
    """Returns named detections as IMAGE_POSE rows, in their order.

    Their `camera` is the picture's place among the pictures: that of its camera in the arena
    state's `cameras`.
    """
    rows, picture, camera, height_m, ground_m = placed
    poses = np.zeros(len(rows), dtype=IMAGE_POSE)
    at_px = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
    points = np.column_stack((ground_m, height_m))
    ahead_px = cameras.project(points + ahead_m(rows["yaw_rad"]), camera)
    poses["tag"], poses["camera"] = rows["tag"], picture
    poses["x_px"], poses["y_px"] = at_px.T
    poses["yaw_px_rad"] = heading_px_rad(ahead_px - at_px)
    poses["x_m"], poses["y_m"] = ground_m.T
    poses["yaw_rad"] = rows["yaw_rad"]
    return poses


def ahead_m(yaw_rad: Floats) -> Floats:
    """Returns (n, 3) short ways in the arena along (n,) headings."""
    along = (np.cos(yaw_rad), np.sin(yaw_rad), np.zeros(len(yaw_rad)))
    return _AHEAD_M * np.stack(along, axis=-1)


def heading_px_rad(along_px: Floats) -> Floats:
    """Returns headings in a picture, counter-clockwise in (-pi, pi] and 0 to the right.

    `along_px` is (n, 2) the picture of a short way ahead.
    """
    theta = -np.arctan2(along_px[:, 1], along_px[:, 0])
    return np.asarray(np.where(theta <= -np.pi, theta + 2.0 * np.pi, theta))


class MarkerOffsets:
    """The offsets of some tags' markers; those of all others are nothing.

    A marker that was put on by hand is off the middle of the wheels' axle, and turned. With (x, y,
    yaw) the marker's offset in the robot's frame and c, s the cosine and sine of the robot's
    heading, robot's yaw = marker's yaw - yaw, and (robot's x, y) = marker's (x, y) -
    (c x - s y, s x + c y). The covariance follows with the derivatives (first order).
    """

    def __init__(self, offsets: Mapping[int, PlacedMarker]) -> None:
        """`offsets` are by tag."""
        items = sorted(offsets.items())
        self._tags = np.array([tag for tag, _ in items], dtype=np.int64)
        rows = [(marker.x_m, marker.y_m, marker.yaw_rad) for _, marker in items]
        self._places = np.array(rows, dtype=np.float64).reshape(-1, 3)

    def to_robots(self, views: NDArray[np.void]) -> NDArray[np.void]:
        """Returns (n,) VIEW of robots from those of their markers."""
        rows, places = self._of(views["tag"])
        if len(rows) == 0:
            return views
        moved: NDArray[np.void] = views.copy()
        yaw_rad = wrap_angle(views["yaw_rad"][rows] - places[:, 2])
        arm_x, arm_y = turned(places, yaw_rad)
        moved["x_m"][rows] -= arm_x
        moved["y_m"][rows] -= arm_y
        moved["yaw_rad"][rows] = yaw_rad
        moved["covariance"][rows] = _carried(views["covariance"][rows], arm_y, -arm_x)
        return moved

    def to_markers(self, poses: NDArray[np.void]) -> NDArray[np.void]:
        """Returns (n,) rows with tag, x_m, y_m and yaw_rad of markers from those of robots."""
        rows, places = self._of(poses["tag"])
        if len(rows) == 0:
            return poses
        moved: NDArray[np.void] = poses.copy()
        arm_x, arm_y = turned(places, poses["yaw_rad"][rows])
        moved["x_m"][rows] += arm_x
        moved["y_m"][rows] += arm_y
        moved["yaw_rad"][rows] = wrap_angle(poses["yaw_rad"][rows] + places[:, 2])
        return moved

    def _of(self, tags: NDArray[np.integer]) -> tuple[NDArray[np.intp], Floats]:
        """The rows of `tags` whose offsets are known, and these (k, 3)."""
        if len(self._tags) == 0:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 3))
        wanted = tags.astype(np.int64)
        place = np.minimum(np.searchsorted(self._tags, wanted), len(self._tags) - 1)
        rows = np.flatnonzero(self._tags[place] == wanted)
        return rows, self._places[place[rows]]


def _carried(covariance: Floats, by_x: Floats, by_y: Floats) -> Floats:
    """Covariances (k, 6) of x, y, yaw where x and y [m] go with the yaw's error by so much."""
    xx, xy, xt, yy, yt, tt = covariance.T
    return np.stack(
        (
            xx + 2.0 * by_x * xt + by_x**2 * tt,
            xy + by_x * yt + by_y * xt + by_x * by_y * tt,
            xt + by_x * tt,
            yy + 2.0 * by_y * yt + by_y**2 * tt,
            yt + by_y * tt,
            tt,
        ),
        axis=-1,
    )
