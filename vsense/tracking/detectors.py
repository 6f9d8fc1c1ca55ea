"""Which detector reads which marker family."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from vsense.tracking.detector import ArrowDetector, Detector
from vsense.tracking.dictionary import SquareFamily
from vsense.tracking.families import MarkerFamily
from vsense.tracking.square_detector import SquareDetector
from vsense.tracking.whereabouts import Whereabouts


def make_detector(
    family: MarkerFamily | SquareFamily,
    roster: Sequence[int],
    height_m: float,
    whereabouts: Whereabouts | None = None,
    heights_m: Iterable[float] = (),
    open_roster: bool = True,
) -> Detector:
    """Returns a new detector; each thread needs one of its own.

    Args:
        family: The marker family, see `families.load_family`.
        roster: The tags in the arena; a marker with any other is reported without a name.
        height_m: Height of most of the markers above the floor.
        whereabouts: What the arena tracker expects, the same for all of its detectors.
        heights_m: Other heights of markers.
        open_roster: Tell `whereabouts` of markers with other tags, so that they can join.

    Raises:
        FamilyError: The family does not have a tag of the roster.
    """
    how = (roster, height_m, whereabouts, heights_m, open_roster)
    if isinstance(family, SquareFamily):
        return SquareDetector(family, *how)
    return ArrowDetector(family, *how)
