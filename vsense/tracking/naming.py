"""Names along the tracks: what a marker's cells leave open follows from where it is.

A robot cannot jump, so a marker near where exactly one robot is expected is that robot, unless its
cells speak against it. A marker without a name collects evidence from picture to picture until its
cells are sure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from vsense.arena import UNNAMED
from vsense.tracking.decoder import DecodedTag, Decoder, Tags
from vsense.tracking.prediction import NEAR_M, Anonymous, Prediction

Floats = NDArray[np.float64]

_PLAUSIBLE = 0.30
_EVIDENCE_S = 0.3
_LEAST_PICTURES = 3


def carry_names(
    tags: Tags, reading: DecodedTag, roster: Tags, places: Floats, expected: NDArray[np.void]
) -> Tags:
    """As `carry_read_names`, for markers whose cells alone do not say enough.

    `reading` is what the cells say of the tags in `roster`.
    """

    def plausible(tag: int, marker: int) -> bool:
        column = int(np.searchsorted(roster, tag))
        if column == len(roster) or roster[column] != tag:
            return False
        return bool(reading.distance[marker, column] < _PLAUSIBLE)

    return carry_read_names(tags, places, expected, plausible)


def carry_read_names(
    tags: Tags,
    places: Floats,
    expected: NDArray[np.void],
    plausible: Callable[[int, int], bool] = lambda tag, marker: True,
) -> Tags:
    """Gives names of expected robots to markers that cannot be read, such as square ones.

    Their words differ in so many cells that a word that is read is believed; but a marker that is
    read as another robot than the one that must be there stays without a name.

    Args:
        tags: (n,) what was read, -1 where the cells are not sure; the names are returned.
        places: (n, 2) the markers' places in the arena [m].
        expected: (k,) EXPECTED in the camera's view.
        plausible: Whether a marker, by its row, may have an expected tag.
    """
    named = np.array(tags)
    for tag, marker in _alone(places, expected):
        if named[marker] not in (tag, UNNAMED):
            named[marker] = UNNAMED
        elif tag not in tags and plausible(tag, marker):
            named[marker] = tag
    return named


def _alone(places: Floats, expected: NDArray[np.void]) -> Iterator[tuple[int, int]]:
    """Yields robots that are sure to be somewhere, with the one marker that is there."""
    sure = expected[expected["sure"]]
    for robot, marker in _pairs(np.stack((sure["x_m"], sure["y_m"]), axis=1), places):
        yield int(sure["tag"][robot]), int(marker)


def _pairs(some: Floats, others: Floats) -> NDArray[np.intp]:
    """Returns the rows (k, 2) of (n, 2) and (m, 2) places where one of each is near the other."""
    offset = some[:, np.newaxis] - others
    near = np.hypot(offset[..., 0], offset[..., 1]) < NEAR_M
    single = near & (near.sum(axis=0) == 1) & (near.sum(axis=1) == 1)[:, np.newaxis]
    return np.argwhere(single)


def gather_evidence(
    tags: Tags,
    cells: Floats,
    sharpness: tuple[Floats, Floats],
    places: Floats,
    camera: str,
    prediction: Prediction,
    decoder: Decoder,
) -> Tags:
    """Names markers by the mean of their cells over the pictures since they appeared.

    Args:
        tags: (n,) names so far; the new ones are returned.
        cells: (n, cells) brightness in this picture.
        sharpness: (n,) of the edges along and across the heading, see `Decoder.decode`.
        places: (n, 2) the markers' places in the arena [m].
        prediction: Keeps what has been gathered, by `camera`, an id.
    """
    open_ = np.flatnonzero(tags == UNNAMED)
    once = np.ones(len(open_), dtype=np.int64)
    now = Anonymous(open_, places[open_], cells[open_], once, prediction.capture_ns)
    before = prediction.anonymous.get(camera)
    if before is not None and now.capture_ns - before.capture_ns < 1e9 * _EVIDENCE_S:
        _add_up(now, before)
    prediction.anonymous[camera] = now
    named = np.array(tags)
    enough = now.pictures >= _LEAST_PICTURES
    if enough.any():
        rows = open_[enough]
        means = now.cells[enough] / now.pictures[enough, np.newaxis]
        read = decoder.decode(means, sharpness[0][rows], sharpness[1][rows]).tags
        taken = np.isin(read, tags[tags != UNNAMED])
        named[rows] = np.where(taken, np.int32(UNNAMED), read)
    return named


def find_unlisted_tags(
    tags: Tags, sharpness: tuple[Floats, Floats], gathered: Anonymous, decoder: Decoder
) -> tuple[Tags, Floats]:
    """Reads markers without a name as tags that are not on the roster.

    `tags` and `sharpness` are those of `gather_evidence`, `gathered` is what it has just kept of
    them. Returns (k,) the tags of those that are sure, and (k, 2) their places.
    """
    rows = gathered.rows
    if len(rows) == 0:
        return np.zeros(0, dtype=np.int32), np.zeros((0, 2))
    means = gathered.cells / gathered.pictures[:, np.newaxis]
    read = decoder.read_unlisted(means, sharpness[0][rows], sharpness[1][rows])
    sure = (read != UNNAMED) & (tags[rows] == UNNAMED)
    return read[sure], gathered.places[sure]


def _add_up(now: Anonymous, before: Anonymous) -> None:
    for here, there in _pairs(now.places, before.places):
        now.cells[here] += before.cells[there]
        now.pictures[here] += before.pictures[there]
