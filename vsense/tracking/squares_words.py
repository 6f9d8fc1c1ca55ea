"""Reading square markers: which code word, turned how, makes the cells that the picture shows.

The cells are the mean grey values of a marker's frame, of its matrix and of the white around it.
They are compared with what a camera would see of every word of the dictionary, in all four turns
and under the blur that the marker's edges have; black, white and a slope of the light are fitted.
So neither a threshold per cell nor sharp cells are needed.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.markers.dictionary import Codes, Floats
from vsense.tracking.squares_edges import sample_grey

Values = NDArray[np.float32] | NDArray[np.float64]

_BLURS = np.array([0.05, 0.3, 0.5, 0.75, 1.05, 1.4])
"""Standard deviations of the point spread that words are prepared for, in cells."""
_BLUR_DOUBT = 2
_FINE = 8
_SPOTS = 4
_SHORTLIST = 12
_WHITE_CELLS = 3
_LEAST_START = 0.6
_CHANCE = (1e-7, 1e-5)
"""How likely mere chance may match a word, without and with the white around the marker."""
_LEAST_MATCH = 0.85
_LEAST_MARGIN = 1.2
_MOST_ERROR = 0.25


class Readings(NamedTuple):
    """What n quadrilaterals say.

    Attributes:
        tag: (n,) the nearest word.
        turn: (n,) by how many corners the marker's first one lies before the quadrilateral's.
        error: (n,) root mean square difference to the word, black to white being 1.
        margin: (n,) how many times larger that is for the next tag's best word.
        sure: (n,) whether the reading is to be believed.
    """

    tag: NDArray[np.int32]
    turn: NDArray[np.int32]
    error: Floats
    margin: Floats
    sure: NDArray[np.bool_]


class Words(NamedTuple):
    """A dictionary's words as they are seen under one blur.

    Attributes:
        seen: (words, cells) grey values without mean and slope, of unit length.
        size: (words,) the length before.
        least_match: How alike the matrix's cells must be, so that chance hardly is: the more the
            blur mixes the cells, the fewer of them are independent.
    """

    seen: NDArray[np.float32]
    size: Floats
    least_match: float


class WordReader:
    """Reads the markers of one dictionary.

    With `around` the white around the marker is compared, too; it shows the light best but may be
    covered or too narrow.
    """

    def __init__(self, codes: Codes, around: bool = True) -> None:
        """Prepares the dictionary's words in their four turns."""
        self.side = codes.cells + 2
        self._correction = codes.correction
        bits = codes.bits().astype(np.float64)
        edge = _WHITE_CELLS + 1
        whole = np.ones((len(bits), 4, *(2 * [self.side + 2 * _WHITE_CELLS])))
        whole[..., _WHITE_CELLS:-_WHITE_CELLS, _WHITE_CELLS:-_WHITE_CELLS] = 0.0
        for turn in range(4):
            whole[:, turn, edge:-edge, edge:-edge] = np.rot90(bits, turn, (1, 2))
        self._whole = whole.reshape(4 * len(bits), -1).astype(np.float32)
        span = self.side + 2
        place = np.abs(np.arange(span) - (span - 1) / 2.0)
        far = np.maximum.outer(place, place).ravel()
        corner = np.minimum.outer(place, place).ravel() == place[0]
        self._used = ~corner & (around | (far < place[0]))
        self._inner = (far < place[0] - 1.0)[self._used]
        steps = np.arange(span) - (span - 1) / 2.0
        x, y = (values.ravel()[self._used] for values in np.meshgrid(steps, steps))
        self._slopes = np.linalg.qr(np.stack((np.ones_like(x), x, y), axis=1))[0]
        self._lines = [_cell_blur(span, blur) for blur in _BLURS]
        self._words: dict[tuple[int, int], Words] = {}
        self._rare = NormalDist().inv_cdf(1.0 - _CHANCE[around] / len(self._whole))

    def cells(self, image: NDArray[np.uint8], quads: Floats) -> Floats:
        """Returns the (n, cells) mean grey values of n > 0 quadrilaterals' cells."""
        spots = (np.arange(_SPOTS) + 0.5) / _SPOTS * 0.5 + 0.25
        line = (np.arange(-1, self.side + 1)[:, np.newaxis] + spots).ravel() / self.side
        grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        grey = sample_grey(image, project_squares(quads, grid))
        span = self.side + 2
        mean = grey.reshape(-1, span, _SPOTS, span, _SPOTS).mean(axis=(2, 4))
        return np.asarray(mean.reshape(-1, span * span)[:, self._used], dtype=np.float64)

    def read(self, cells: Floats, blur: Floats) -> Readings:
        """Finds the word of each quadrilateral.

        Args:
            cells: (n, cells) grey values, see `cells`.
            blur: (n, 2) standard deviations of the point spread in cells, along the
                quadrilateral's first and second side.
        """
        count = len(cells)
        flat = cells - (cells @ self._slopes) @ self._slopes.T
        size = np.linalg.norm(flat, axis=1)
        seen = flat / np.maximum(size, 1e-6)[:, np.newaxis]
        level = np.abs(_BLURS - blur[..., np.newaxis]).argmin(axis=-1)
        names = np.zeros((count, 2), dtype=np.int32)
        error, margin = np.full(count, np.inf), np.ones(count)
        sure = np.zeros(count, dtype=bool)
        for pair in sorted({(int(u), int(v)) for u, v in level}):
            group = np.flatnonzero((level == pair).all(axis=1))
            likeness = _products(seen[group], self._prepared(*pair).seen)
            hopeful = likeness.max(axis=1) > _LEAST_START
            group, likeness = group[hopeful], likeness[hopeful]
            for row, scores in zip(group, likeness, strict=True):
                short = np.argpartition(-scores, _SHORTLIST)[:_SHORTLIST]
                word, kind, next_best = self._best(seen[row], np.sort(short), pair)
                names[row] = divmod(word, 4)
                error[row], margin[row], sure[row] = self._judge(seen[row], word, kind, next_best)
        return Readings(names[:, 0], names[:, 1], error, margin, sure)

    def _best(
        self, seen: Floats, short: NDArray[np.intp], pair: tuple[int, int]
    ) -> tuple[int, tuple[int, int], float]:
        """Tries the likeliest words under all blurs near `pair`.

        Returns the best word, its blur, and the likeness of the best word of another tag.
        """
        near = [range(max(0, k - _BLUR_DOUBT), min(len(_BLURS), k + _BLUR_DOUBT)) for k in pair]
        kinds = [(u, v) for u in near[0] for v in near[1]]
        likeness = np.stack([self._prepared(*kind).seen[short] @ seen for kind in kinds])
        best = likeness.max(axis=0)
        place = int(best.argmax())
        others = best[short // 4 != short[place] // 4]
        kind = kinds[int(likeness[:, place].argmax())]
        return int(short[place]), kind, float(others.max(initial=0.0))

    def _judge(
        self, seen: Floats, word: int, kind: tuple[int, int], next_best: float
    ) -> tuple[float, float, bool]:
        """Returns the error and the margin of a word, and whether to believe it."""
        words = self._prepared(*kind)
        ideal = words.seen[word]
        likeness = float(ideal @ seen)
        miss = (seen - likeness * ideal) * (words.size[word] / max(likeness, 1e-6))
        error = float(np.sqrt((miss**2).mean()))
        left = max(1.0 - likeness**2, 1e-9)
        margin = float(np.sqrt(max(1.0 - next_best**2, 1e-9) / left))
        inner = np.stack((seen[self._inner], ideal[self._inner])).astype(np.float64)
        inner -= inner.mean(axis=1, keepdims=True)
        match = float(inner[0] @ inner[1] / max(np.prod(np.linalg.norm(inner, axis=1)), 1e-9))
        wrong = int((np.abs(miss[self._inner]) > 0.5).sum())
        sure = match > words.least_match and margin > _LEAST_MARGIN and error < _MOST_ERROR
        return error, margin, sure and wrong <= self._correction

    def _prepared(self, u: int, v: int) -> Words:
        """Returns all words under the blurs u and v; they are made when first needed."""
        if (u, v) not in self._words:
            mix = np.kron(self._lines[v], self._lines[u])[self._used]
            mix -= self._slopes @ (self._slopes.T @ mix)
            seen = _products(self._whole, mix)
            size = np.linalg.norm(seen, axis=1)
            seen /= size[:, np.newaxis]
            self._words[u, v] = Words(seen, size, self._needed(seen[:, self._inner]))
        return self._words[u, v]

    def _needed(self, matrix: NDArray[np.float32]) -> float:
        """The least match by Fisher's transform, for as many cells as are independent.

        Source: R. A. Fisher, On the probable error of a coefficient of correlation (1921).
        """
        matrix = matrix - matrix.mean(axis=1, keepdims=True)
        matrix /= np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-6)
        columns = np.ascontiguousarray((matrix - matrix.mean(axis=0)).T)
        covariance = _products(columns, columns).astype(np.float64)
        independent = float(np.trace(covariance) ** 2 / (covariance**2).sum())
        return max(_LEAST_MATCH, float(np.tanh(self._rare / np.sqrt(max(independent - 3.0, 1.0)))))


def _products(some: Values, others: Values) -> NDArray[np.float32]:
    """Returns the (n, m) scalar products of (n, k) and (m, k) rows.

    OpenCV multiplies on the thread that asks; NumPy's threads would wait for each other here.
    """
    few, many = some.astype(np.float32), others.astype(np.float32)
    product = cv2.gemm(many, few, 1.0, np.zeros(0, np.float32), 0.0, flags=cv2.GEMM_2_T)
    return np.ascontiguousarray(np.transpose(product), dtype=np.float32)


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
    cells = span + 2 * (_WHITE_CELLS - 1)
    step = (np.arange(cells * _FINE) + 0.5) / _FINE
    weight = np.exp(-0.5 * (np.subtract.outer(step, step) / blur) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    inner = weight.reshape(cells, _FINE, -1)[:, _FINE // 4 : -_FINE // 4].mean(axis=1)
    line = inner.reshape(cells, cells, _FINE).sum(axis=2)
    return np.asarray(line[_WHITE_CELLS - 1 : cells - _WHITE_CELLS + 1])
