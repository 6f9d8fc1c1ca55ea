"""What the cameras saw at a few timesteps of a run, for its picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vsense.base.arena import Frame
from vsense.base.canvas import SCALE, Colour, Image
from vsense.monitor.pictures.camera_view import CameraGrid
from vsense.monitor.pictures.scene import ArenaMoment
from vsense.monitor.pictures.stitch import Shade, TopView
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena

_PAPER: Colour = (255, 255, 255)


class RunCameras:
    """The pictures of a run's cameras at chosen timesteps, and how to show them.

    Args:
        cameras: may be none.
        top_m: height of the markers above the floor.
        shade: see `TopView`.

    Attributes:
        pictures: by the run's timestep and the camera's id.
    """

    def __init__(self, cameras: Sequence[Camera], top_m: float, shade: Shade | None = None) -> None:
        self.pictures: dict[int, Mapping[str, Image]] = {}
        self._cameras, self._top_m, self._shade = cameras, top_m, shade

    def keep(self, timestep: int, frames: Sequence[Frame]) -> None:
        """Copies pictures, so that their memory returns to the cameras."""
        known = {camera.id for camera in self._cameras}
        copied = {f.camera: f.image.copy() for f in frames if f.camera in known}
        if copied:
            self.pictures[timestep] = copied

    def drop(self, timestep: int) -> None:
        """Forgets the pictures of a timestep, if there are any."""
        self.pictures.pop(timestep, None)

    def newest(self, timestep: int, reach: int) -> int | None:
        """The newest timestep with pictures up to this one, at most `reach` before it."""
        found = [t for t in self.pictures if timestep - reach <= t <= timestep]
        return max(found, default=None)

    def top_view(self, timestep: int, part: Arena, width_px: int) -> Image | None:
        """The cameras' view of a part of the arena from above; None: there is none."""
        pictures = self.pictures.get(timestep)
        if not pictures:
            return None
        zoom = width_px / part.size_m[0]
        return TopView(self._cameras, part, zoom, self._top_m, self._shade).draw(pictures)

    def grid(self, timestep: int, moment: ArenaMoment, width_px: int) -> Image | None:
        """All pictures with the moment drawn in, `SCALE` times as large; None: there are none."""
        pictures = self.pictures.get(timestep)
        if not pictures:
            return None
        middle = np.array(moment.snapshot.arena.centre_m[:2])
        shown = CameraGrid(self._cameras, width_px, middle, SCALE)
        return shown.draw({c.id: moment for c in self._cameras}, pictures, _PAPER)
