"""What cameras suffer from, told without wearying anybody."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from vsense.tracking.grabbers import CameraEvent

REPEATS = 3
"""One kind of trouble of one camera is told this often, then only counted."""


class Troubles:
    """Counts events and lets the first few of each kind pass; to be called from one thread.

    Attributes:
        counts: How often each kind of event came, by camera and kind.
    """

    def __init__(self) -> None:
        """Begins with nothing told."""
        self.counts: Counter[tuple[str, str]] = Counter()

    def lines(self, events: Iterable[CameraEvent]) -> list[str]:
        """Takes events in; gives a line for each that is worth telling."""
        told = []
        for event in events:
            key = event.camera, event.kind
            self.counts[key] += 1
            if self.counts[key] <= REPEATS:
                last = self.counts[key] == REPEATS
                told.append(f"{event}{' (more of this is only counted)' if last else ''}")
        return told

    def summary(self) -> list[str]:
        """Gives a line for each kind of which not all were told."""
        return [
            f"camera {camera}: {count} times {kind}"
            for (camera, kind), count in sorted(self.counts.items())
            if count > REPEATS
        ]
