"""Which pictures of those that came are a timestep: the newest, one of each camera, in order."""

from __future__ import annotations

from collections.abc import Sequence

from vsense.arena import Frame
from vsense.errors import VsenseError
from vsense.tracking.camera import Camera


class TrackingError(VsenseError):
    """Cameras and pictures that do not belong together."""


class FrameGate:
    """Lets one timestep's pictures pass, whatever the order they came in.

    Attributes:
        cameras: The arena's cameras by their ids, sorted.
        old: Frames dropped because they were not newer than the newest timestep already done, or
            beaten by a newer one in the same call.
        repeated: Second and further frames of one camera in one timestep, dropped.
    """

    def __init__(self, cameras: Sequence[Camera]) -> None:
        """Takes the arena's cameras.

        Raises:
            TrackingError: There is no camera, or two have the same id.
        """
        self.cameras = {camera.id: camera for camera in sorted(cameras, key=lambda c: c.id)}
        if not cameras or len(self.cameras) != len(cameras):
            raise TrackingError("the arena needs cameras, each with an id of its own")
        self.old = 0
        self.repeated = 0
        self._newest = -1

    def choose(self, frames: Sequence[Frame]) -> list[Frame]:
        """Returns one frame per camera of the newest timestep, in the order of the cameras.

        Nothing is returned where no frame is newer than those of earlier calls.

        Raises:
            TrackingError: A frame is of an unknown camera, or not of that camera's size.
        """
        for frame in frames:
            self._check(frame)
        newest = max((frame.timestep for frame in frames), default=-1)
        if newest <= self._newest:
            self.old += len(frames)
            return []
        self._newest = newest
        now = [frame for frame in frames if frame.timestep == newest]
        self.old += len(frames) - len(now)
        now.sort(key=lambda frame: (frame.capture_ns, frame.ready_ns))
        single = {frame.camera: frame for frame in now}
        self.repeated += len(now) - len(single)
        return [single[camera] for camera in sorted(single)]

    def _check(self, frame: Frame) -> None:
        camera = self.cameras.get(frame.camera)
        if camera is None:
            known = ", ".join(self.cameras)
            raise TrackingError(f"a frame of camera {frame.camera!r}; known are {known}")
        if frame.image.shape != (camera.height_px, camera.width_px):
            height, width = frame.image.shape[:2]
            raise TrackingError(
                f"a frame of camera {camera.id} is {width} x {height} px, "
                f"not {camera.width_px} x {camera.height_px}"
            )
