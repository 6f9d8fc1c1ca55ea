"""Names along the tracks: what a marker's cells leave open follows from where it is.

A robot cannot jump, so a marker near where exactly one robot is expected is that robot, unless its
cells speak against it. A marker without a name collects evidence from picture to picture until its
cells are sure.

A cell's brightness is compared with what the picture's blur makes of each tag in the roster; how
blurred a marker is, along its heading and across it, is measured at its own edges. This is the seam
to `c_src/host/vs_codes.h`, which compares; the words under every blur are prepared here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import UNNAMED, Floats
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.vision.cameras._camera_array import Index
from vsense.vision.markers.families import (
    BLURS_U,
    MarkerFamily,
    cell_blur,
    normal_share,
    outer_light,
)
from vsense.vision.tracking._joining import Tags, unlisted_tag_reader
from vsense.vision.tracking._kernel import MARKER
from vsense.vision.tracking._outlines import EDGE_REACH_U, SHARPNESS, nearest_blur
from vsense.vision.tracking._prediction import Anonymous, Prediction
from vsense.vision.tracking._rows import Rows, are_near, gather, is_in, single_pairs

_MOST_UNEXPLAINED, _LEAST_VARIED = 0.6, 0.1
"""The error may be this share of how much the word's own cells differ: a word that explains less is
not what is there, however much worse the others are. Nearly blank words differ by the second."""


class DecodedTag(NamedTuple):
    """What n markers' cells say.

    Attributes:
        tags: (n,) the tag, or -1 where it is not sure.
        error: (n,) root mean square difference to the nearest tag's code word.
        margin: (n,) how many times farther the next tag is.
    """

    tags: Tags
    error: Floats
    margin: Floats


class Decoder:
    """Names markers from a roster of tags.

    Attributes:
        tags: The roster, ascending.
        struct: `struct vs_codes`, for the kernel; it lives as long as the decoder.
    """

    def __init__(self, family: MarkerFamily, roster: Sequence[int]) -> None:
        """Prepares the code words of `roster`, at all strengths of blur.

        Raises:
            FamilyError: The family does not have a tag of the roster.
        """
        self.tags = np.array(sorted(set(roster)), dtype=np.int32)
        bits = np.array([family.bits(int(tag)).ravel() for tag in self.tags], dtype=np.float64)
        bits = bits.reshape(-1, family.grid**2)
        sigmas = (family.unit_mm * BLURS_U).tolist()
        self._words = np.array(
            [
                [
                    cell_blur(family, a, b) @ bits.T + outer_light(family, a, b)[:, None]
                    for b in sigmas
                ]
                for a in sigmas
            ],
            dtype=np.float32,
        )
        varied = np.maximum(self._words.std(axis=-2), _LEAST_VARIED)
        self._most_error = np.asarray(_MOST_UNEXPLAINED * varied, dtype=np.float32)
        self._per_length = _per_length(self._words, family.grid)
        self._lost = normal_share(-EDGE_REACH_U / BLURS_U)
        self._unlisted = unlisted_tag_reader(family)
        self.struct = kernel_ffi.new("struct vs_codes *")
        self.struct.cells, self.struct.side = family.grid**2, family.grid
        self.struct.tags = len(self.tags)
        self.struct.tag = pointer("int32_t", self.tags)
        self.struct.word = pointer("float", self._words)
        self.struct.most_error = pointer("float", self._most_error)
        self.struct.per_length = pointer("float", self._per_length)
        self.struct.lost, self.struct.sharp = self._lost.tolist(), SHARPNESS.tolist()

    def brightness(self, cells: Floats, ahead: NDArray[np.intp], left: NDArray[np.intp]) -> Floats:
        """Returns (n, cells) brightness between true black and white.

        `cells` is between what was measured as black and white near to blurred edges, where black
        is not quite black; `ahead` and `left` are (n,) blurs along and across the heading, see
        `nearest_blur`.
        """
        lost = 0.5 * (self._lost[ahead] + self._lost[left])[:, np.newaxis]
        return np.asarray((1.0 - 2.0 * lost) * cells + lost)

    def read_unlisted(self, cells: Floats, sharp_ahead: Floats, sharp_left: Floats) -> Tags:
        """Reads markers whose tags are not on the roster; the arguments are those of `decode`.

        Returns (n,) tags; -1 where the cells are not sure, and where the tag is on the roster.
        """
        ahead, left = nearest_blur(sharp_ahead), nearest_blur(sharp_left)
        tags = self._unlisted.read(self.brightness(cells, ahead, left), ahead, left)
        return np.where(np.isin(tags, self.tags), np.int32(UNNAMED), tags)

    def decode(self, cells: Floats, sharp_ahead: Floats, sharp_left: Floats) -> DecodedTag:
        """Names markers.

        Args:
            cells: (n, cells) brightness, 0 the arrow's black, 1 the disc's white.
            sharp_ahead: (n,) share of its contrast that an edge across the heading gains within a
                quarter of a unit to both sides.
            sharp_left: (n,) the same for an edge along the heading.
        """
        markers = np.zeros(len(cells), dtype=MARKER)
        markers["cell"][:, : cells.shape[1]] = cells
        markers["sharp_ahead"], markers["sharp_left"] = sharp_ahead, sharp_left
        rows = pointer("struct vs_marker", markers)
        kernels.vs_codes_name(self.struct, rows, len(markers))
        return DecodedTag(markers["tag"].astype(np.int32), markers["error"], markers["margin"])


def _per_length(words: NDArray[np.float32], grid: int) -> NDArray[np.float32]:
    """Returns 1 over the lengths of (..., cells, n) words without mean and slopes, (..., n)."""
    along = np.arange(grid) - 0.5 * (grid - 1)
    slopes = [np.ones(grid**2), np.tile(along, grid), np.repeat(along, grid)]
    even = np.linalg.qr(np.stack(slopes, axis=1))[0].astype(np.float32)
    left = (words**2).sum(axis=-2) - ((even.T @ words) ** 2).sum(axis=-2)
    return np.asarray(1.0 / np.sqrt(np.maximum(left, 1e-6)), dtype=np.float32)


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


def _keys(picture: Index, tags: Tags) -> NDArray[np.int64]:
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
    groups = prediction.anonymous
    before = {camera: groups.pop(camera) for camera in cameras if camera in groups}
    rows = np.flatnonzero(nameless)
    picture = markers.picture[rows]
    for number in np.unique(picture).tolist():
        mine = rows[picture == number]
        once = np.ones(len(mine), dtype=np.int64)
        places = markers.where(mine).places()
        groups[cameras[number]] = Anonymous(mine, places, cells[mine], once, prediction.capture_ns)
    return before


def _name(named: Tags, gathered: Anonymous, markers: Rows, decoder: Decoder) -> None:
    """Gives markers of one picture the name that their cells have said often enough."""
    enough = gathered.pictures >= _LEAST_PICTURES
    if not enough.any():
        return
    rows = gathered.rows[enough]
    means = gathered.cells[enough] / gathered.pictures[enough, np.newaxis]
    read = decoder.decode(means, *_sharpness(markers, rows)).tags
    taken = named[(markers.picture == markers.picture[rows[0]]) & (named != UNNAMED)]
    named[rows] = np.where(np.isin(read, taken), np.int32(UNNAMED), read)


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


def _sharpness(markers: Rows, rows: Index) -> tuple[Floats, Floats]:
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
