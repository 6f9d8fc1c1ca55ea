"""Grabbers give the pictures of each timestep, and the events of their cameras."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from vsense.base.arena import Frame


@dataclass(frozen=True, slots=True)
class CameraEvent:
    """Something that happened to a camera, in words for the user.

    `kind` is one word: see `ENDS` for those that last; the others are over at once. `text` does
    not name the camera.
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
        """The number of timesteps; None: unknown."""

    @property
    def missed(self) -> int:
        """Timesteps that were left out because later ones were due or there already."""

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits for the newest timestep's pictures, one per camera that delivered.

        A picture stays valid and unchanged while anything refers to it or to a view of it, so no
        copy is needed, and no camera waits for its readers.

        Pictures that were decoded (files, videos, streams, V4L2) have memory of their own. Those
        of GenICam cameras and of the lab are lent: a driver's buffer, or a slot of the memory that
        is shared with the lab's camera process. The memory goes back with the last reference;
        where so much is lent that the camera might run out, a copy is given instead.

        Raises:
            NoMorePictures: There will be no more.
            GrabberError: No picture came in `timeout_s`.
        """

    def events(self) -> list[CameraEvent]:
        """Returns what happened to the cameras since the last call; any thread."""

    def close(self) -> None:
        """Closes the cameras; can be called again."""


REPEATS = 3
"""Events of one kind of one camera that are printed; later ones are only counted."""

ENDS = {
    "back": ("gone",),
    "light": ("dark",),
    "exposed": ("saturated",),
    "whole": ("damaged",),
    "fits": ("size",),
    "prompt": ("slow",),
    "running": ("frozen",),
    "steady": ("moved", "apart"),
    "placed": ("displaced",),
    "clear": ("crowded",),
    "timely": ("late",),
    "dated": ("untimely",),
    "punctual": ("overdue",),
}
"""The events that end lasting kinds of trouble; all other kinds are over at once."""

_EACH_ITS_OWN = ("control",)
"""Kinds whose events are all printed: each is about another setting."""
_LASTING = frozenset(kind for kinds in ENDS.values() for kind in kinds)


class Troubles:
    """Counts events, of which the first few of each kind become lines; for one thread.

    Attributes:
        counts: How often each kind of event came, by camera and kind.
        present: What lasts, by camera and kind; replaced whole, for any thread to read.
    """

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, str]] = Counter()
        self.present: Mapping[tuple[str, str], CameraEvent] = {}

    def lines(self, events: Iterable[CameraEvent]) -> list[str]:
        """Counts events; returns a line for each that is to be printed."""
        lines = []
        for event in events:
            key = event.camera, event.kind
            self.counts[key] += 1
            self._keep(event)
            if event.kind in _EACH_ITS_OWN:
                lines.append(str(event))
            elif self.counts[key] <= REPEATS:
                last = self.counts[key] == REPEATS
                lines.append(f"{event}{' (more of this is only counted)' if last else ''}")
        return lines

    def _keep(self, event: CameraEvent) -> None:
        over = ENDS.get(event.kind, ())
        if event.kind in _LASTING or over:
            ended = {(event.camera, kind) for kind in over}
            present = {key: value for key, value in self.present.items() if key not in ended}
            if event.kind in _LASTING:
                present[event.camera, event.kind] = event
            self.present = present

    def summary(self) -> list[str]:
        """Returns a line for each kind of which not all were printed."""
        return [
            f"camera {camera}: {count} times {kind}"
            for (camera, kind), count in sorted(self.counts.items())
            if count > REPEATS and kind not in _EACH_ITS_OWN
        ]
