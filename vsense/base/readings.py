"""What robots sense in a timestep, as arrays; each robot's readings as a mapping shows them.

A simulation hands the arrays to its controllers as they are. Who sends readings to robots, or shows
them, takes one robot at a time: `readings[tag]`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

TimedReadings = list[tuple[bytes, int]]
"""One robot's readings in the table's order: value as on the wire, and its capture time [ns]."""


class SensorReadings(Mapping[int, TimedReadings]):
    """Readings of the robots of one controller, by tag.

    Attributes:
        tags: the robots, n of them.
        block: (n, bytes) uint8, each robot's values in the table's order, as on the wire.
        captures_ns: (n, sensors) int64 capture time of each value, NEVER_NS: not measured yet.
    """

    def __init__(
        self,
        tags: Sequence[int],
        sizes: Sequence[int],
        block: NDArray[np.uint8],
        captures_ns: NDArray[np.int64],
    ) -> None:
        """`sizes` are the bytes of each sensor's value."""
        self.tags, self.block, self.captures_ns = tags, block, captures_ns
        self._sizes = sizes

    def __getitem__(self, tag: int) -> TimedReadings:
        if tag not in self.tags:
            raise KeyError(tag)
        row = self.tags.index(tag)
        block, times_ns = self.block[row].tobytes(), self.captures_ns[row].tolist()
        ends = list(accumulate(self._sizes))
        return [(block[e - size : e], t) for e, size, t in zip(ends, self._sizes, times_ns)]

    def __iter__(self) -> Iterator[int]:
        return iter(self.tags)

    def __len__(self) -> int:
        return len(self.tags)

    def of(self, tags: Sequence[int]) -> SensorReadings:
        """The readings of some of the robots, in the order of `tags`."""
        if list(tags) == list(self.tags):
            return self
        rows = [self.tags.index(tag) for tag in tags]
        return SensorReadings(tags, self._sizes, self.block[rows], self.captures_ns[rows])


class SwarmReadings(Mapping[int, TimedReadings]):
    """Readings of all robots, by tag; `parts` are those of each controller, by its id."""

    def __init__(self, parts: Mapping[str, SensorReadings]) -> None:
        self.parts = parts

    def __getitem__(self, tag: int) -> TimedReadings:
        for part in self.parts.values():
            if tag in part.tags:
                return part[tag]
        raise KeyError(tag)

    def __iter__(self) -> Iterator[int]:
        return (tag for part in self.parts.values() for tag in part.tags)

    def __len__(self) -> int:
        return sum(map(len, self.parts.values()))
