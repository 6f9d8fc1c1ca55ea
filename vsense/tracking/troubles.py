"""What cameras suffer from, told without wearying anybody."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from vsense.tracking.grabbers import CameraEvent

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
