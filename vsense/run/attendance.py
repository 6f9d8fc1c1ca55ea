"""Who is there before a run: which robots are connected, and whose markers are seen."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

MOST_NAMES = 6
"""So many names are told, then only how many more there are."""


@dataclass(frozen=True, slots=True)
class Attendance:
    """Who is there and who is missing, by name, in the experiment's order.

    Attributes:
        robots: how many robots there should be.
        markers: how many markers there should be: those of the robots and of tagged objects.
        absent: robots that are not connected.
        unseen: robots and objects whose marker is not seen.
    """

    robots: int
    markers: int
    absent: tuple[str, ...]
    unseen: tuple[str, ...]

    @classmethod
    def take(
        cls,
        robots: Mapping[int, str],
        objects: Mapping[int, str],
        connected: Collection[int],
        seen: Collection[int],
    ) -> Attendance:
        """Calls the roll.

        Args:
            robots: names of the robots by tag.
            objects: names of the tagged objects by tag.
            connected: tags of the robots that are connected.
            seen: tags that are seen.
        """
        return cls(
            robots=len(robots),
            markers=len(robots) + len(objects),
            absent=tuple(name for tag, name in robots.items() if tag not in connected),
            unseen=tuple(n for tag, n in (*robots.items(), *objects.items()) if tag not in seen),
        )

    @property
    def complete(self) -> bool:
        """Whether nobody is missing."""
        return not self.absent and not self.unseen

    @property
    def missing(self) -> tuple[str, ...]:
        """Everybody who is not connected or not seen, each once."""
        return tuple(dict.fromkeys((*self.absent, *self.unseen)))

    def progress(self, watched: bool = True) -> str:
        """Says in one line who is there, and who is not.

        Args:
            watched: False: there was no arena state yet in which anybody could be seen.
        """
        connected = (
            f"{self.robots - len(self.absent)} of {self.robots} robots connected"
            f"{_without(self.absent)}"
        )
        if not watched:
            return f"{connected}, no arena state yet"
        return (
            f"{connected}, {self.markers - len(self.unseen)} of {self.markers} markers seen"
            f"{_without(self.unseen)}"
        )

    def complaint(self) -> str:
        """Says who is missing in which way; "" where nobody is."""
        parts = []
        if self.absent:
            parts.append(f"not connected: {', '.join(self.absent)}")
        if self.unseen:
            parts.append(f"not seen: {', '.join(self.unseen)}")
        return "; ".join(parts)


def _without(names: tuple[str, ...]) -> str:
    return f" (not {shorten(names)})" if names else ""


def shorten(names: Iterable[str]) -> str:
    """Names in one line, the first few of many."""
    told = list(names)
    more = len(told) - MOST_NAMES
    return ", ".join(told[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
