"""Camera views: from one camera's detections to the arena, and from the arena to its picture.

Views of the same tag that lie together are one sighting; views that do not are several, and are
never merged.

Thesis, 2.2: an ArenaElement has a position and an orientation in the image, too. What the cameras
see is kept as it was seen; for clients that ask for one image pose of every robot, arena poses are
projected into the pictures.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.arena import DETECTION, IMAGE_POSE, UNNAMED, Frame
from vsense.cameras.camera import Camera

Floats = NDArray[np.float64]
Covariance = tuple[float, float, float, float, float, float]
"""Covariance of x, y and yaw: xx, xy, x yaw, yy, y yaw, yaw yaw."""

HEIGHT_DOUBT_M = 0.002
"""Standard deviation of the markers' heights, where nothing better is known."""

MERGE_M = 0.03
"""Views of one tag at most this far apart are the same marker: less than half a robot."""

_FADE = 0.15
_LEAST_FADE = 0.01
_UPPER = np.triu_indices(3)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A marker in the arena, seen by one or more cameras at about the same time.

    Attributes:
        x_m, y_m: The disc's centre in the arena frame.
        yaw_rad: Heading in (-pi, pi].
        capture_ns: When, the mean over the cameras with the weights.
        weight: What it counts when views are merged [1/m^2]: the inverse variance of the position,
            less near the picture's border, so that nothing jumps where a view begins.
        cameras: Ids of the cameras, sorted.
        covariance: Of what the pictures tell.
        height_sensitivity: How far x and y [m] are off where the marker is one standard deviation
            higher than it is taken to be; the same marker for all cameras.
    """

    tag: int
    x_m: float
    y_m: float
    yaw_rad: float
    capture_ns: int
    weight: float
    cameras: tuple[str, ...]
    covariance: Covariance
    height_sensitivity: tuple[float, float]


def covariances(sightings: Sequence[Sighting]) -> Floats:
    """Returns the covariance of x, y [m] and yaw [rad], (n, 3, 3), the heights' doubt in it."""
    whole = np.zeros((len(sightings), 3, 3))
    if len(sightings) == 0:
        return whole
    upper = np.array([sighting.covariance for sighting in sightings])
    whole[:, _UPPER[0], _UPPER[1]] = upper
    whole[:, _UPPER[1], _UPPER[0]] = upper
    sensitivity = np.array([sighting.height_sensitivity for sighting in sightings])
    whole[:, :2, :2] += sensitivity[:, :, np.newaxis] * sensitivity[:, np.newaxis]
    return whole


class Placed(NamedTuple):
    """One camera's named detections, sorted by tag.

    Attributes:
        rows: (n,) DETECTION.
        height_m: (n,) of their markers above the floor.
        ground_m: (n, 2) the discs' centres in the arena.
    """

    rows: NDArray[np.void]
    height_m: Floats
    ground_m: Floats


def place_markers(
    camera: Camera, found: NDArray[np.void], heights_m: Mapping[int, float]
) -> Placed:
    """Puts one camera's named (n,) DETECTION into the arena.

    Tags without a height in `heights_m`, that of their markers above the floor, are left out.
    """
    tags = found["tag"].tolist()
    order = sorted(
        (row for row, tag in enumerate(tags) if tag != UNNAMED and tag in heights_m),
        key=lambda row: tags[row],
    )
    rows = found[order]
    height_m = np.array([heights_m[tags[row]] for row in order])
    pixels = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
    ground_m = camera.to_plane(pixels, height_m) if order else np.zeros((0, 2))
    return Placed(rows, height_m, ground_m)


def make_views(
    frame: Frame, camera: Camera, placed: Placed, height_doubt_m: float = HEIGHT_DOUBT_M
) -> list[Sighting]:
    """Returns what `camera`, which took the frame, sees as sightings.

    A view far from the camera's foot point weighs less, because a wrong height shifts it more;
    `height_doubt_m` is the standard deviation of the markers' heights.
    """
    rows, height_m, ground_m = placed
    if len(rows) == 0:
        return []
    pixels = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
    away = (camera.position_m[:2] - ground_m) / (camera.position_m[2] - height_m)[:, np.newaxis]
    sensitivity = height_doubt_m * away
    covariance = rows["covariance"]
    own = 0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1])
    weight = _fade(camera, pixels) / (own + (sensitivity**2).sum(axis=1))
    facts = zip(
        rows["tag"].tolist(), ground_m.tolist(), rows["yaw_rad"].tolist(), weight.tolist(),
        covariance[:, _UPPER[0], _UPPER[1]].tolist(), sensitivity.tolist(), strict=True,
    )  # fmt: skip
    return [
        Sighting(tag, x, y, yaw, frame.capture_ns, w, (camera.id,), tuple(own), tuple(shift))
        for tag, (x, y), yaw, w, own, shift in facts
    ]


def _fade(camera: Camera, pixels: Floats) -> Floats:
    """Returns what views count near the picture's border, where they begin and end."""
    size = np.array((camera.width_px, camera.height_px))
    inside = 0.5 * size - np.abs(pixels + 0.5 - 0.5 * size)
    share = np.clip(inside.min(axis=1) / (_FADE * size.min()), 0.0, 1.0)
    return np.asarray(np.maximum(share**2 * (3.0 - 2.0 * share), _LEAST_FADE))


def merge_views(views: Iterable[Sighting]) -> dict[int, list[Sighting]]:
    """Returns the sightings of each tag; more than one means that the tag is duplicated.

    The result does not depend on the order of `views`. Two views of one camera are never merged:
    one marker is in a picture once.
    """
    groups: dict[int, list[list[Sighting]]] = {}
    for view in sorted(views, key=_order):
        clusters = groups.setdefault(view.tag, [])
        home = next((cluster for cluster in clusters if _belongs(view, cluster)), None)
        if home is None:
            clusters.append([view])
        else:
            home.append(view)
    return {tag: [_merge(cluster) for cluster in groups[tag]] for tag in sorted(groups)}


def _order(view: Sighting) -> tuple[object, ...]:
    """Sorts views by all that they are, so that only equal ones can change places."""
    place = (view.x_m, view.y_m, view.yaw_rad)
    doubt = (view.covariance, view.height_sensitivity)
    return view.tag, view.cameras, place, view.weight, view.capture_ns, *doubt


def _belongs(view: Sighting, cluster: list[Sighting]) -> bool:
    return all(
        view.cameras != other.cameras
        and math.hypot(view.x_m - other.x_m, view.y_m - other.y_m) <= MERGE_M
        for other in cluster
    )


def _merge(cluster: list[Sighting]) -> Sighting:
    """Returns the weighted mean; headings are averaged as vectors, so they may wrap."""
    if len(cluster) == 1:
        return cluster[0]
    weight = np.array([view.weight for view in cluster])
    share = weight / weight.sum()
    yaw = np.array([view.yaw_rad for view in cluster])
    first = cluster[0].capture_ns
    later = share @ np.array([view.capture_ns - first for view in cluster], dtype=np.float64)
    # The pictures' errors are independent; the marker has one height for all of them.
    covariance = share**2 @ np.array([view.covariance for view in cluster])
    sensitivity = share @ np.array([view.height_sensitivity for view in cluster])
    return Sighting(
        tag=cluster[0].tag,
        x_m=float(share @ np.array([view.x_m for view in cluster])),
        y_m=float(share @ np.array([view.y_m for view in cluster])),
        yaw_rad=float(np.arctan2(share @ np.sin(yaw), share @ np.cos(yaw))),
        capture_ns=first + round(float(later)),
        weight=float(weight.sum()),
        cameras=tuple(sorted(camera for view in cluster for camera in view.cameras)),
        covariance=tuple(covariance.tolist()),
        height_sensitivity=tuple(sensitivity.tolist()),
    )


def count_unnamed(found: Iterable[NDArray[np.void]]) -> int:
    """Returns how many markers in the DETECTION arrays could not be named."""
    empty = np.zeros(0, dtype=DETECTION)
    return int((np.concatenate([empty, *found])["tag"] == UNNAMED).sum())


_AHEAD_M = 0.01


def image_poses(place: int, camera: Camera, placed: Placed) -> NDArray[np.void]:
    """Returns one camera's named detections as IMAGE_POSE rows, sorted by tag.

    `place` is the camera's in the arena state's `cameras`.
    """
    rows, height_m, ground_m = placed
    poses = np.zeros(len(rows), dtype=IMAGE_POSE)
    if len(poses) == 0:
        return poses
    at_px = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
    points = np.column_stack((ground_m, height_m))
    poses["tag"], poses["camera"] = rows["tag"], place
    poses["x_px"], poses["y_px"] = at_px.T
    poses["yaw_px_rad"] = _heading_px_rad(camera, points, at_px, rows["yaw_rad"])
    poses["x_m"], poses["y_m"] = ground_m.T
    poses["yaw_rad"] = rows["yaw_rad"]
    return poses


class ImagePoses:
    """Finds for each robot the picture that shows it best."""

    def __init__(self, cameras: Sequence[Camera], heights_m: Mapping[int, float]) -> None:
        self._cameras = list(cameras)
        self._heights_m = dict(heights_m)

    def learn(self, heights_m: Mapping[int, float]) -> None:
        """Takes the heights of tags that have joined, too; any thread."""
        self._heights_m.update(heights_m)

    def __call__(self, robots: NDArray[np.void]) -> Floats:
        """Returns (n,) POSE robots' poses in the picture whose middle they are nearest to.

        Returns:
            (n, 3) column and row of the disc's centre [px], and the heading in the picture
            [degrees], counter-clockwise in (-180, 180] and 0 to the right.
        """
        height = [self._heights_m.get(int(tag), 0.0) for tag in robots["tag"]]
        place = np.stack((robots["x_m"], robots["y_m"], np.array(height, dtype=float)), axis=-1)
        best = np.zeros((len(robots), 3))
        nearest = np.full(len(robots), np.inf)
        for camera in self._cameras:
            at_px = camera.project(place)
            theta = np.degrees(_heading_px_rad(camera, place, at_px, robots["yaw_rad"]))
            size = np.array((camera.width_px, camera.height_px))
            off = np.abs((at_px + 0.5) / size - 0.5).max(axis=1)
            better = off < nearest
            nearest[better] = off[better]
            best[better] = np.column_stack((at_px, theta))[better]
        return best


def _heading_px_rad(camera: Camera, points_m: Floats, at_px: Floats, yaw_rad: Floats) -> Floats:
    """Returns (n,) headings in a picture, counter-clockwise in (-pi, pi] and 0 to the right.

    `points_m` (n, 3) are the discs' centres in the arena, `at_px` (n, 2) the same in the picture.
    """
    ahead = np.stack((np.cos(yaw_rad), np.sin(yaw_rad), np.zeros(len(points_m))), axis=-1)
    along = camera.project(points_m + _AHEAD_M * ahead) - at_px
    theta = -np.arctan2(along[:, 1], along[:, 0])
    return np.asarray(np.where(theta <= -np.pi, theta + 2.0 * np.pi, theta))
