"""Camera views: what one camera's detections say about the arena, and how several agree.

A detection is a point of a picture; with the height of the tag's marker it is a place in the
arena. Views of the same tag that lie together are one sighting; views that do not are several,
and are never merged.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.arena import DETECTION, UNNAMED, Frame
from vsense.tracking.camera import Camera

_HEIGHT_DOUBT_M = 0.002
MERGE_M = 0.03
"""Views of one tag at most this far apart are the same marker: less than half a robot."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A marker in the arena, seen by one or more cameras at about the same time.

    Attributes:
        tag: The marker's number.
        x_m: The disc's centre, x in the arena frame.
        y_m: The disc's centre, y in the arena frame.
        yaw_rad: Heading in (-pi, pi].
        capture_ns: When, the mean over the cameras with the position's weights.
        weight: Inverse variance of the position [1/m^2].
        cameras: Ids of the cameras, sorted.
    """

    tag: int
    x_m: float
    y_m: float
    yaw_rad: float
    capture_ns: int
    weight: float
    cameras: tuple[str, ...]


def place_views(
    frame: Frame, camera: Camera, found: NDArray[np.void], heights_m: Mapping[int, float]
) -> list[Sighting]:
    """Returns one frame's named detections as places in the arena, sorted.

    A view far from the camera's foot point weighs less, because a wrong height shifts it more.

    Args:
        frame: The picture.
        camera: The camera that took it.
        found: (n,) DETECTION.
        heights_m: Height of each tag's marker above the floor; other tags are left out.
    """
    named = found[found["tag"] != UNNAMED]
    named = named[[int(tag) in heights_m for tag in named["tag"]]] if len(named) else named
    height = np.array([heights_m[int(tag)] for tag in named["tag"]])
    pixels = np.stack((named["x_px"], named["y_px"]), axis=-1)
    ground = camera.to_plane(pixels, height)
    reach = np.hypot(*(ground - camera.position_m[:2]).T) / (camera.position_m[2] - height)
    weight = 1.0 / (1.0 / named["weight"] + (_HEIGHT_DOUBT_M * reach) ** 2)
    views = [
        Sighting(int(tag), float(x), float(y), float(yaw), frame.capture_ns, float(w), (camera.id,))
        for tag, (x, y), yaw, w in zip(named["tag"], ground, named["yaw_rad"], weight, strict=True)
    ]
    return sorted(views, key=_order)


def merge_views(views: Iterable[Sighting]) -> dict[int, list[Sighting]]:
    """Returns the sightings of each tag; more than one means that the tag is duplicated.

    The result does not depend on the order of `views`. Two views of one camera are never
    merged: one marker is in a picture once.
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
    return view.tag, view.cameras, place, view.weight, view.capture_ns


def _belongs(view: Sighting, cluster: list[Sighting]) -> bool:
    return all(
        view.cameras != other.cameras
        and np.hypot(view.x_m - other.x_m, view.y_m - other.y_m) <= MERGE_M
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
    return Sighting(
        tag=cluster[0].tag,
        x_m=float(share @ np.array([view.x_m for view in cluster])),
        y_m=float(share @ np.array([view.y_m for view in cluster])),
        yaw_rad=float(np.arctan2(share @ np.sin(yaw), share @ np.cos(yaw))),
        capture_ns=first + round(float(later)),
        weight=float(weight.sum()),
        cameras=tuple(sorted(camera for view in cluster for camera in view.cameras)),
    )


def count_unnamed(found: Iterable[NDArray[np.void]]) -> int:
    """Returns how many markers in the DETECTION arrays could not be named."""
    empty = np.zeros(0, dtype=DETECTION)
    return int((np.concatenate([empty, *found])["tag"] == UNNAMED).sum())
