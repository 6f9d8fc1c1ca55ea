"""Grabbers: where the pictures come from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from vsense.arena import Frame
from vsense.errors import VsenseError


class GrabberError(VsenseError):
    """No pictures: none came in time, or there will be no more."""


class NoMorePictures(GrabberError):
    """A recording has come to its end."""


@dataclass(frozen=True, slots=True)
class CameraEvent:
    """Something that happened to a camera, for the user's eyes.

    Attributes:
        camera: Its id.
        kind: One word: what begins and what ends it are in `vsense.tracking.troubles.ENDS`;
            "clock" and "control" are over as soon as they are told.
        text: What happened, without the camera's name.
    """

    camera: str
    kind: str
    text: str

    def __str__(self) -> str:
        return f"camera {self.camera}: {self.text}"


class Grabber(Protocol):
    """A set of cameras that are triggered together, once per timestep."""

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits for the newest timestep's pictures, one per camera that delivered.

        The pictures' memory may be used again after two more calls.

        Raises:
            GrabberError: No picture came in `timeout_s`, or there will be no more.
        """

    def close(self) -> None:
        """Lets the cameras go; can be called again."""


class MemoryGrabber:
    """Hands out pictures that are in memory already, one timestep per call."""

    def __init__(self, frames: Iterable[Frame]) -> None:
        """Groups `frames` by their timestep; they may come in any order."""
        sets: dict[int, list[Frame]] = {}
        for frame in frames:
            sets.setdefault(frame.timestep, []).append(frame)
        self._sets = [sets[timestep] for timestep in sorted(sets, reverse=True)]

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Returns the next timestep's pictures at once.

        Raises:
            GrabberError: All have been handed out.
        """
        if not self._sets:
            raise NoMorePictures("no more pictures: all of those in memory have been handed out")
        return self._sets.pop()

    def close(self) -> None:
        """Drops the pictures that are left."""
        self._sets.clear()
