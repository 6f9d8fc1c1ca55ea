"""Grabbers: where the pictures come from, and what happens to the cameras behind them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
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
        kind: One word: what begins and what ends it are in `vsense.cameras.grabber.ENDS`;
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

    @property
    def timesteps(self) -> int | None:
        """How many there are, where that is known."""

    @property
    def missed(self) -> int:
        """Timesteps that were left out because later ones were due or there already."""

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits for the newest timestep's pictures, one per camera that delivered.

        A picture is valid and does not change as long as anybody refers to it or to a view of it:
        whoever holds one needs no copy, and a camera never waits for whoever holds one.

        Pictures that were decoded (files, videos, streams, V4L2) have memory of their own. Those
        of GenICam cameras and of the lab are lent: a driver's buffer, or a slot of the memory
        that is shared with the lab's camera process. It goes back when the last reference is
        gone. Where so much is lent that the camera might find no room, a copy is given instead.

        Raises:
            NoMorePictures: There will be no more.
            GrabberError: No picture came in `timeout_s`.
        """

    def events(self) -> list[CameraEvent]:
        """Gives what happened to the cameras since the last call; any thread."""

    def close(self) -> None:
        """Lets the cameras go; can be called again."""


REPEATS = 3
"""One kind of trouble of one camera is told this often, then only counted."""


ENDS = {
    "back": ("gone",),
    "light": ("dark",),
    "exposed": ("saturated",),
    "whole": ("damaged",),
    "fits": ("size",),
    "prompt": ("slow",),
    "running": ("frozen",),
    "steady": ("moved", "apart"),
    "clear": ("crowded",),
}
"""Which kinds of trouble lasts until when; all others are over as soon as they are told."""

_EACH_ITS_OWN = ("control",)
"""Kinds whose events are not the same trouble again: each is about another setting."""
_LASTING = frozenset(kind for kinds in ENDS.values() for kind in kinds)


class Troubles:
    """Counts events and lets the first few of each kind pass; to be called from one thread.

    Attributes:
        counts: How often each kind of event came, by camera and kind.
        present: What lasts, by camera and kind; replaced whole, for any thread to read.
    """

    def __init__(self) -> None:
        """Begins with nothing told."""
        self.counts: Counter[tuple[str, str]] = Counter()
        self.present: Mapping[tuple[str, str], CameraEvent] = {}

    def lines(self, events: Iterable[CameraEvent]) -> list[str]:
        """Takes events in; gives a line for each that is worth telling."""
        told = []
        for event in events:
            key = event.camera, event.kind
            self.counts[key] += 1
            self._keep(event)
            if event.kind in _EACH_ITS_OWN:
                told.append(str(event))
            elif self.counts[key] <= REPEATS:
                last = self.counts[key] == REPEATS
                told.append(f"{event}{' (more of this is only counted)' if last else ''}")
        return told

    def _keep(self, event: CameraEvent) -> None:
        over = ENDS.get(event.kind, ())
        if event.kind in _LASTING or over:
            ended = {(event.camera, kind) for kind in over}
            kept = {key: each for key, each in self.present.items() if key not in ended}
            if event.kind in _LASTING:
                kept[event.camera, event.kind] = event
            self.present = kept

    def summary(self) -> list[str]:
        """Gives a line for each kind of which not all were told."""
        return [
            f"camera {camera}: {count} times {kind}"
            for (camera, kind), count in sorted(self.counts.items())
            if count > REPEATS and kind not in _EACH_ITS_OWN
        ]
