"""Reading square markers: which code word, turned how, makes the cells that the picture shows.

This is the seam to `c_src/host/vs_words.h`, which compares cells with words; the words under every
blur, and what chance may make of them, are prepared here, once for a dictionary.
"""

from __future__ import annotations

from functools import cache
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.vision.markers._dictionary import Codes, FamilyError, SquareFamily
from vsense.vision.tracking._outlines import edge_sharpness
from vsense.vision.tracking._squares_edges import sample_grey

GreyCells = NDArray[np.float32] | NDArray[np.float64]

BLURS = np.array([0.05, 0.3, 0.5, 0.75, 1.05, 1.4])
"""Standard deviations of the point spread that words are prepared for, in cells."""
_FINE = 8
_SPOTS = 4
_BEYOND = 3
"""Cells of white around the black square that blur can bring in."""
_CHANCE = (1e-7, 1e-5)
"""How likely mere chance may match a word, without and with the white around the marker."""
_LEAST_MATCH = 0.85
_ENOUGH = 200
"""Tags that tell how many cells are independent."""


READING = np.dtype(
    [("error", "f8"), ("margin", "f8"), ("tag", "i4"), ("turn", "i4"), ("sure", "i4")], align=True
)
"""What a quadrilateral says: `struct vs_reading`. `turn` is by how many corners the marker's first
one lies before the quadrilateral's."""


class Words(NamedTuple):
    """`struct vs_words` of a dictionary, and the arrays that it points to."""

    struct: Any
    arrays: tuple[NDArray[np.uint64] | NDArray[np.float32], ...]


@cache
def prepare_words(codes: Codes) -> Words:
    """Prepares a dictionary's words in their four turns under every blur.

    Raises:
        FamilyError: The markers have more cells than the kernel's tables.
    """
    cells, most = codes.cells, kernels.VS_WORDS_CELLS
    if cells > most:
        raise FamilyError(
            f"{codes.name}: {cells} x {cells} cells, expected at most {most} x {most}"
        )
    turns = np.stack([np.rot90(codes.bits(), turn, (1, 2)) for turn in range(4)], axis=1)
    flat = turns.reshape(len(turns), 4, -1)
    values = np.uint64(1) << np.arange(cells**2, dtype=np.uint64)
    word = np.where(flat, values, np.uint64(0)).sum(axis=2, dtype=np.uint64)
    struct = kernel_ffi.new("struct vs_words *")
    struct.cells, struct.tags, struct.correction = cells, len(turns), codes.correction
    parts = -(-(cells**2) // kernels.VS_WORDS_PART)
    shifts = kernels.VS_WORDS_PART * np.arange(parts, dtype=np.uint64)
    mask = np.uint64((1 << kernels.VS_WORDS_PART) - 1)
    part = (word[..., np.newaxis] >> shifts & mask).astype(np.uint8)
    struct.word = pointer("uint64_t", word)
    struct.part = pointer("uint8_t", part)
    lines = [_cell_blur(cells + 4, blur)[:, _BEYOND:-_BEYOND] for blur in BLURS]
    for place, line in enumerate(lines):
        for row, shares in enumerate(line.tolist()):
            struct.seen[place][row][0 : len(shares)] = shares
    dark = np.pad(flat.reshape(-1, cells, cells), ((0, 0), (1, 1), (1, 1))) - 1.0
    arrays: list[Any] = [word, part]
    for around in range(2):
        per_length, least = _under_blur(dark.astype(np.float32), lines, around == 1)
        struct.per_length[around] = pointer("float", per_length)
        struct.least_match[around] = least
        arrays.append(per_length)
    return Words(struct, tuple(arrays))


def words_of(family: SquareFamily) -> Words:
    """Returns the words of the markers that robots carry."""
    general = prepare_words(family.codes)
    struct = kernel_ffi.new("struct vs_words *", general.struct[0])
    struct.sharp = edge_sharpness(BLURS).tolist()
    turn = np.radians(family.heading_deg)
    struct.cell_m = 1e-3 * family.cell_mm
    struct.turn_x, struct.turn_y = np.cos(turn), np.sin(turn)
    struct.centre_x_m, struct.centre_y_m = 1e-3 * family.disc_centre_mm
    return Words(struct, general.arrays)


class WordReader:
    """Reads the markers of one dictionary."""

    def __init__(self, codes: Codes) -> None:
        """Raises FamilyError, see `prepare_words`."""
        self.side = codes.cells + 2
        self._words = prepare_words(codes)

    def cells(self, image: NDArray[np.uint8], quads: Floats) -> NDArray[np.float32]:
        """Returns the (n, cells) mean grey values of n > 0 quadrilaterals' cells."""
        spots = (np.arange(_SPOTS) + 0.5) / _SPOTS * 0.5 + 0.25
        line = (np.arange(-1, self.side + 1)[:, np.newaxis] + spots).ravel() / self.side
        grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        grey = sample_grey(image, project_squares(quads, grid))
        span = self.side + 2
        mean = grey.reshape(-1, span, _SPOTS, span, _SPOTS).mean(axis=(2, 4))
        return np.asarray(mean.reshape(-1, span * span), dtype=np.float32)

    def read(self, cells: GreyCells, blur: Floats) -> NDArray[np.void]:
        """Finds the word of each quadrilateral; returns (n,) READING.

        Args:
            cells: (n, cells) grey values, see `cells`.
            blur: (n, 2) standard deviations of the point spread in cells, along the
                quadrilateral's first and second side.
        """
        grey = np.ascontiguousarray(cells, dtype=np.float32)
        level = np.abs(BLURS - blur[..., np.newaxis]).argmin(axis=-1).astype(np.int32)
        readings = np.zeros(len(grey), dtype=READING)
        kernels.vs_words_read(
            self._words.struct,
            pointer("float", grey),
            pointer("int32_t", level),
            len(grey),
            pointer("struct vs_reading", readings),
        )
        return readings


def _under_blur(
    dark: NDArray[np.float32], lines: list[Floats], around: bool
) -> tuple[NDArray[np.float32], list[float]]:
    """Returns 1 over the lengths of upright words as they are seen, (kinds, tags), and the least
    matches.

    `dark` are (4 * tags, side, side), -1 where black, each tag's turns one after the other;
    `lines` has each blur of a line of cells.
    """
    span = len(lines[0])
    place = np.abs(np.arange(span) - (span - 1) / 2.0)
    far = np.maximum.outer(place, place).ravel()
    corner = np.minimum.outer(place, place).ravel() == place[0]
    used = ~corner & (around | (far < place[0]))
    inner = (far < place[0] - 1.0)[used]
    steps = np.arange(span) - (span - 1) / 2.0
    x, y = (values.ravel()[used] for values in np.meshgrid(steps, steps))
    slopes = np.linalg.qr(np.stack((np.ones_like(x), x, y), axis=1))[0]
    rare = NormalDist().inv_cdf(1.0 - _CHANCE[around] / len(dark))
    number = len(lines)
    upright = dark[::4].reshape(len(dark) // 4, -1)
    part = dark.reshape(len(upright), -1)[:: len(upright) // _ENOUGH + 1].reshape(-1, dark[0].size)
    per_length = np.zeros((number, number, len(upright)), dtype=np.float32)
    least = np.zeros((number, number))
    for u in range(number):
        for v in range(number):
            mix = np.kron(lines[v], lines[u])[used]
            mix -= slopes @ (slopes.T @ mix)
            light = mix.T.astype(np.float32)
            per_length[u, v] = 1.0 / np.linalg.norm(upright @ light, axis=1)
            if u <= v:
                # A quarter turn of all words exchanges the two blurs.
                least[u, v] = least[v, u] = _needed(part @ light[:, inner], rare)
    return per_length.reshape(number**2, -1), least.ravel().tolist()


def _needed(matrix: NDArray[np.float32], rare: float) -> float:
    """The least match by Fisher's transform, for as many cells as are independent.

    The more the blur mixes the cells, the fewer of them are.

    Source: R. A. Fisher, On the probable error of a coefficient of correlation (1921).
    """
    matrix = matrix - matrix.mean(axis=1, keepdims=True)
    matrix /= np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-6)
    columns = (matrix - matrix.mean(axis=0)).T
    covariance = (columns @ columns.T).astype(np.float64)
    independent = float(np.trace(covariance) ** 2 / (covariance**2).sum())
    return max(_LEAST_MATCH, float(np.tanh(rare / np.sqrt(max(independent - 3.0, 1.0)))))


def project_squares(quads: Floats, points: Floats) -> Floats:
    """Maps (m, 2) points of the unit square into quadrilaterals by their homographies, (n, m, 2).

    `quads` are (n, 4, 2): the corners (0, 0), (1, 0), (1, 1), (0, 1).

    Source: P. Heckbert, Fundamentals of Texture Mapping and Image Warping (1989), 2.2.3.
    """
    a, b, c, d = np.moveaxis(quads, 1, 0)
    across, down, skew = b - c, d - c, a - b + c - d
    area = across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]
    area = np.where(np.abs(area) < 1e-9, np.inf, area)
    g = (skew[:, 0] * down[:, 1] - skew[:, 1] * down[:, 0]) / area
    h = (across[:, 0] * skew[:, 1] - across[:, 1] * skew[:, 0]) / area
    along = b - a + g[:, np.newaxis] * b
    below = d - a + h[:, np.newaxis] * d
    x, y = points[:, 0, np.newaxis], points[:, 1, np.newaxis]
    top = x * along[:, np.newaxis] + y * below[:, np.newaxis] + a[:, np.newaxis]
    depth = x * g[:, np.newaxis, np.newaxis] + y * h[:, np.newaxis, np.newaxis] + 1.0
    return np.asarray(top / depth)


def _cell_blur(span: int, blur: float) -> Floats:
    """How much of each cell of a row the middle half of each of `span` visible cells sees.

    Two more white cells lie on either side. `blur` is the standard deviation of the point spread,
    in cells.
    """
    cells = span + 2 * (_BEYOND - 1)
    step = (np.arange(cells * _FINE) + 0.5) / _FINE
    weight = np.exp(-0.5 * (np.subtract.outer(step, step) / blur) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    inner = weight.reshape(cells, _FINE, -1)[:, _FINE // 4 : -_FINE // 4].mean(axis=1)
    line = inner.reshape(cells, cells, _FINE).sum(axis=2)
    return np.asarray(line[_BEYOND - 1 : cells - _BEYOND + 1])
