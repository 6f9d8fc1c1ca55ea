"""Which detector reads which marker family."""

from __future__ import annotations

from collections.abc import Sequence

from vsense.tracking.detector import ArrowDetector, Detector
from vsense.tracking.dictionary import SquareFamily
from vsense.tracking.families import MarkerFamily
from vsense.tracking.squares import SquareDetector
from vsense.tracking.whereabouts import Whereabouts


def make_detector(
    family: MarkerFamily | SquareFamily,
    roster: Sequence[int],
    height_m: float,
    whereabouts: Whereabouts | None = None,
) -> Detector:
    """Returns a new detector; each thread needs one of its own.

    Args:
        family: The marker family, see `families.load_family`.
        roster: The tags in the arena; a marker with any other is reported without a name.
        height_m: Height of the markers above the floor, about.
        whereabouts: What the arena tracker expects, the same for all of its detectors.

    Raises:
        FamilyError: The family does not have a tag of the roster.
    """
    if isinstance(family, SquareFamily):
        return SquareDetector(family, roster, height_m)
    return ArrowDetector(family, roster, height_m, whereabouts)
