"""Names along the tracks: what a marker's cells leave open follows from where it is.

A robot cannot jump, so a marker near where exactly one robot is expected is that robot, unless its
cells speak against it. A marker without a name collects evidence from picture to picture until its
cells are sure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import UNNAMED
from vsense.vision.cameras.camera_array import Places
from vsense.vision.tracking.decoder import Decoder, Tags
from vsense.vision.tracking.prediction import Anonymous, Prediction
from vsense.vision.tracking.rows import Rows, are_near, gather, is_in, single_pairs

Floats = NDArray[np.float64]

_ALIKE = 0.22
"""Root mean square difference of cells to a tag's word at which they may still be it."""
_EVIDENCE_S = 0.3
_LEAST_PICTURES = 3


def carry_names(tags: Tags, markers: Rows, expected: Rows) -> Tags:
    """Gives names of expected robots to markers whose cells do not say enough.

    A robot that is sure to be somewhere names the one marker that is there, if its tag is what the
    cells suggest, though not surely, and is not read elsewhere in the picture. Cells that suggest
    another robot, or nothing, name nobody: markers may have been exchanged. A marker that is read
    as another robot than the one that must be there stays without a name.

    Args:
        tags: (n,) what was read, -1 where the cells are not sure; the names are returned.
        markers: (n,) MARKER.
        expected: (k,) EXPECTED.
    """
    sure = expected.where(expected.values["sure"])
    robot, marker = single_pairs(sure, markers)
    read, expects = tags[marker], sure.values["tag"][robot]
    named = np.array(tags)
    named[marker[(read != UNNAMED) & (read != expects)]] = UNNAMED
    seen = markers.values[marker]
    alike = (seen["guess"] == expects) & (seen["error"] < _ALIKE) & (read == UNNAMED)
    marker, expects = marker[alike], expects[alike]
    free = ~is_in(_keys(markers.picture[marker], expects), _keys(markers.picture, tags))
    named[marker[free]] = expects[free]
    return named


def _keys(picture: Places, tags: Tags) -> NDArray[np.int64]:
    """Returns a number for each tag in each picture."""
    return np.asarray((picture.astype(np.int64) << 32) + tags)


def gather_evidence(
    tags: Tags,
    markers: Rows,
    cells: Floats,
    cameras: Sequence[str],
    prediction: Prediction,
    decoder: Decoder,
) -> Tags:
    """Names markers by the mean of their cells over the pictures since they appeared.

    Args:
        tags: (n,) names so far; the new ones are returned.
        markers: (n,) MARKER.
        cells: (n, cells) brightness in this timestep.
        cameras: Of the pictures, the ids.
        prediction: Keeps what has been gathered, by the camera.
    """
    named = np.array(tags)
    before = note_nameless(named == UNNAMED, markers, cells, cameras, prediction)
    for camera in cameras:
        now = prediction.anonymous.get(camera)
        if now is None or camera not in before:
            continue
        if now.capture_ns - before[camera].capture_ns < 1e9 * _EVIDENCE_S:
            _add_up(now, before[camera])
            _name(named, now, markers, decoder)
    return named


def were_nameless(
    markers: Rows, cameras: Sequence[str], prediction: Prediction
) -> NDArray[np.bool_]:
    """Tells which of (n,) MARKER are where a marker without a name was just now."""
    were = np.zeros(len(markers.picture), dtype=bool)
    for number, camera in enumerate(cameras):
        before = prediction.anonymous.get(camera)
        if before and prediction.capture_ns - before.capture_ns < 1e9 * _EVIDENCE_S:
            mine = np.flatnonzero(markers.picture == number)
            were[mine] = are_near(gather([markers.values[mine]]), _at(before.places))
    return were


def note_nameless(
    nameless: NDArray[np.bool_],
    markers: Rows,
    cells: Floats,
    cameras: Sequence[str],
    prediction: Prediction,
) -> dict[str, Anonymous]:
    """Keeps in the prediction what each camera sees without a name; returns what it kept before.

    `nameless` tells which of (n,) MARKER have none; the other arguments are those of
    `gather_evidence`.
    """
    kept = prediction.anonymous
    before = {camera: kept.pop(camera) for camera in cameras if camera in kept}
    rows = np.flatnonzero(nameless)
    picture = markers.picture[rows]
    for number in np.unique(picture).tolist():
        mine = rows[picture == number]
        once = np.ones(len(mine), dtype=np.int64)
        places = markers.where(mine).places()
        kept[cameras[number]] = Anonymous(mine, places, cells[mine], once, prediction.capture_ns)
    return before


def _name(named: Tags, gathered: Anonymous, markers: Rows, decoder: Decoder) -> None:
    """Gives markers of one picture the name that their cells have said often enough."""
    enough = gathered.pictures >= _LEAST_PICTURES
    if not enough.any():
        return
    rows = gathered.rows[enough]
    means = gathered.cells[enough] / gathered.pictures[enough, np.newaxis]
    read = decoder.decode(means, *_sharpness(markers, rows)).tags
    others = named[(markers.picture == markers.picture[rows[0]]) & (named != UNNAMED)]
    named[rows] = np.where(np.isin(read, others), np.int32(UNNAMED), read)


def find_unlisted_tags(
    tags: Tags, markers: Rows, gathered: Anonymous, decoder: Decoder
) -> tuple[Tags, Floats]:
    """Reads markers without a name as tags that are not on the roster.

    `tags` and `markers` are those of `gather_evidence`, `gathered` is what it has just kept of one
    camera. Returns (k,) the tags of those that are sure, and (k, 2) their places.
    """
    rows = gathered.rows
    means = gathered.cells / gathered.pictures[:, np.newaxis]
    read = decoder.read_unlisted(means, *_sharpness(markers, rows))
    sure = (read != UNNAMED) & (tags[rows] == UNNAMED)
    return read[sure], gathered.places[sure]


def _sharpness(markers: Rows, rows: Places) -> tuple[Floats, Floats]:
    return markers.values["sharp_ahead"][rows], markers.values["sharp_left"][rows]


def _add_up(now: Anonymous, before: Anonymous) -> None:
    here, there = single_pairs(_at(now.places), _at(before.places))
    now.cells[here] += before.cells[there]
    now.pictures[here] += before.pictures[there]


def _at(places: Floats) -> Rows:
    """Returns (n, 2) places as rows of one picture."""
    rows = np.zeros(len(places), dtype=[("x_m", "f8"), ("y_m", "f8")])
    rows["x_m"], rows["y_m"] = places.T
    return gather([rows])
