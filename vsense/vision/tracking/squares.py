"""Finding square markers of unknown size and place, ArUco's and AprilTag's: corners and tags.

A local threshold at several scales separates dark from light; every contour's hull is reduced to
the smallest quadrilateral around it. Where white cells break through a blurred marker's black
frame, the hull stays as it is. Markers of a known size that robots carry are found much faster, by
`detector`.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, instead
from vsense.vision.markers._dictionary import Codes, FamilyError, dictionary_name, load_codes
from vsense.vision.markers.families import SquareFamily, known_families, load_family
from vsense.vision.tracking._squares_edges import Sides, fit_local_corners, fit_sides, glance
from vsense.vision.tracking._squares_words import WordReader

_WINDOW = 0.9
_NEXT_WINDOW = 2.4
_GREATEST_WINDOW_PX = 51
_ENOUGH_PX = 10.0
_NOISY = 5.0
_NOISE_ROWS = 32

_DARKNESS, _LEAST_STEP_GREY, _NOISE_STEP = 0.96, 3.0, 2.0
"""Dark is below this share of the local mean, less so many grey values, or less so many times the
picture's noise where that is more."""
_TOGETHER_GREY = 84
"""Mean of the 3 x 3 pixels around one that has two dark neighbours, less one."""
_FULLNESS = 0.8
"""Least share of a quadrilateral that the hull fills."""
_SLIMNESS = 0.4
"""Least width of a thing, as a share of the least side."""


def find_quads(
    image: NDArray[np.uint8], least_px: float, most_px: float, noise: float | None = None
) -> Floats:
    """Finds quadrilaterals that are darker than what is around them in a (height, width) picture.

    Large ones are looked for in the picture at half its resolution. The shortest and the longest
    side of a marker are given as seen face to face; `noise` is the picture's, where it is known.

    Returns:
        (n, 4, 2) pixels: the corners, clockwise in the picture.
    """
    if least_px >= 2.0 * _ENOUGH_PX:
        half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        small = find_quads(np.asarray(half, dtype=np.uint8), 0.5 * least_px, 0.5 * most_px)
        return 2.0 * small + 0.5
    noise = noise_level(image) if noise is None else noise
    if noise > _NOISY:
        image = np.asarray(cv2.GaussianBlur(image, (5, 5), 0.9), dtype=np.uint8)
        noise *= 0.4
    step = round(max(_LEAST_STEP_GREY, _NOISE_STEP * noise))
    candidates = [
        quad
        for window in _windows(least_px, most_px)
        for quad in _quads(_dark(image, window, step), least_px, most_px)
    ]
    quads = np.array(candidates, dtype=np.float64).reshape(-1, 4, 2)
    turned = area(quads) < 0.0
    quads[turned] = quads[turned, ::-1]
    return quads


def _dark(image: NDArray[np.uint8], window: int, step: int) -> NDArray[np.uint8]:
    # In one picture's memory: fresh memory costs more than what is done with it.
    dark = cv2.boxFilter(image, -1, (window, window))
    cv2.addWeighted(dark, _DARKNESS, dark, 0.0, -float(step), dst=dark)
    cv2.compare(image, dark, cv2.CMP_LT, dst=dark)
    # Pixels that stand alone or in twos are noise, and contours of their own.
    near = cv2.boxFilter(dark, -1, (3, 3), borderType=cv2.BORDER_REPLICATE)
    cv2.threshold(near, _TOGETHER_GREY, 255, cv2.THRESH_BINARY, dst=near)
    cv2.bitwise_and(dark, near, dst=dark)
    return np.asarray(dark, dtype=np.uint8)


def _quads(dark: NDArray[np.uint8], least_px: float, most_px: float) -> list[NDArray[np.float32]]:
    contours, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    contours = [contour for contour in contours if len(contour) > 3]
    if not contours:
        return []
    points = np.concatenate(contours)[:, 0]
    starts = np.cumsum([0, *(len(contour) for contour in contours[:-1])])
    size = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts) + 1
    is_large = (size.max(axis=1) >= least_px) & (size.min(axis=1) >= _SLIMNESS * least_px)
    least, most = least_px**2 / 4.0, 2.0 * most_px**2
    quads = []
    for place in np.flatnonzero(is_large).tolist():
        hull = cv2.convexHull(contours[place])
        filled = cv2.contourArea(hull)
        if len(hull) < 4 or not least < filled < most:
            continue
        quad = np.asarray(cv2.approxPolyN(hull, 4, ensure_convex=True), dtype=np.float32)
        quad = quad.reshape(-1, 2)
        if len(quad) == 4 and filled > _FULLNESS * cv2.contourArea(quad):
            quads.append(quad)
    return quads


def area(quads: Floats) -> Floats:
    """Returns the area of (n, 4, 2) quadrilaterals, positive where clockwise in the picture."""
    x, y = quads[..., 0], quads[..., 1]
    cross = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
    return np.asarray(0.5 * cross.sum(axis=1))


def lengths(quads: Floats) -> Floats:
    """Returns the (n, 4) lengths of the sides of (n, 4, 2) quadrilaterals."""
    side = np.roll(quads, -1, axis=1) - quads
    return np.asarray(np.hypot(side[..., 0], side[..., 1]))


def noise_level(image: NDArray[np.uint8]) -> float:
    """Returns the standard deviation of the noise, from neighbours on a part of the rows."""
    rows = image[:: max(len(image) // _NOISE_ROWS, 1)].astype(np.int16)
    second = np.abs(rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2])
    if second.size == 0:
        return 0.0
    below = np.cumsum(np.bincount(second.ravel()))
    middle = np.searchsorted(below, [(second.size + 1) // 2, second.size // 2 + 1]).mean()
    return float(1.4826 * middle / np.sqrt(6.0))


def _windows(least_px: float, most_px: float) -> list[int]:
    """Returns the widths of the local means: each is right for markers about its own size."""
    windows: list[int] = []
    width = _WINDOW * least_px
    while not windows or (width < most_px and windows[-1] < _GREATEST_WINDOW_PX):
        windows.append(min(2 * round(width / 2.0) + 1, _GREATEST_WINDOW_PX))
        width *= _NEXT_WINDOW
    return windows


SQUARE = np.dtype(
    [
        ("tag", "i4"),
        ("corners_px", "f8", (4, 2)),
        ("error", "f4"),
        ("margin", "f4"),
        ("residual_px", "f8"),
        ("blur_px", "f8"),
    ]
)
"""One square marker in one picture.

`tag` is the number; `corners_px` the corners of the black
square as seen upright: upper left, upper right, lower right, lower left; `error` and `margin` as
in DETECTION; `residual_px` the root mean square distance of the edges found to the fitted sides;
`blur_px` the standard deviation of the point spread across them.
"""

_PASSES = ((0.12, 1.6, 6.0, 8, 11), (0.08, 1.6, 4.0, 20, 13))
"""Each pass of the fit: how far to look [sides], its limits [px], normals and grey values."""

LEAST_SIDE_PX = 10.0
"""Side of the smallest marker that is looked for where the size is not known."""

_LEAST_RISE = -16.0
"""[grey] A candidate of which a side is so much darker outside than inside is not fitted."""
_LEAST_CONTRAST = 6.0
_NOISE_CONTRAST = 0.7
_LEAST_COVERAGE = 0.5
_LEAST_STEP = 0.15
_LEAST_CELL_PX = 0.9
_SLIMMEST = 0.15
_SHORT, _CLEARER, _CROOKED = 4, 3.2, 0.008
"""Words of so many cells a side are few, and other things may look like one: the letter P, whose
hole is a word's only white cells. What is nearer to its word than to the next by less than so many
times its error, and has sides as crooked as that, as a share of their length, is no marker. Markers
that read as badly lie in a glare, and have straight sides."""
_SAME = 0.05
_ALIKE_PX = 0.5
"""Candidates that differ less are fitted once."""
_BORDER_PX = 1.0
_TOGETHER = 4096
"""Candidates that are fitted or read together, in some 300 MB: a textured picture of 50 megapixels
has hundreds of thousands."""


class SquareFinder:
    """Finds the square markers of one dictionary, whatever their tags and sizes."""

    def __init__(self, codes: Codes) -> None:
        """Raises FamilyError, see `prepare_words`."""
        self._reader = WordReader(codes)
        self._span = codes.cells + 2

    def find(
        self,
        image: NDArray[np.uint8],
        least_px: float = LEAST_SIDE_PX,
        most_px: float | None = None,
        local_corners: bool = False,
    ) -> NDArray[np.void]:
        """Returns the markers of a (height, width) uint8 picture, as SQUARE rows.

        Markers with the same tag are separate rows; one marker is one row.

        Args:
            least_px: Shortest side to look for, seen face to face.
            most_px: Longest side; None: as long as the picture.
            local_corners: Follow sides that a lens or the paper bends, see
                `squares_edges.fit_local_corners`; lines through whole sides are more precise.
        """
        longest = float(max(image.shape)) if most_px is None else most_px
        noise = noise_level(image)
        quads = _once(find_quads(image, least_px, longest, noise))
        if len(quads) == 0:
            return np.zeros(0, dtype=SQUARE)
        fitted = [self._fit(image, quads[part], noise) for part in _parts(len(quads))]
        sides = Sides(*map(np.concatenate, zip(*fitted)))
        sides = sides.keep(_distinct(sides))
        if len(sides.corners_px) == 0:
            return np.zeros(0, dtype=SQUARE)
        read = [self._read(image, sides.keep(part)) for part in _parts(len(sides.corners_px))]
        markers = _single(np.concatenate(read))
        if local_corners and len(markers):
            markers["corners_px"] = fit_local_corners(image, markers["corners_px"])
        return markers

    def _fit(self, image: NDArray[np.uint8], quads: Floats, noise: float) -> Sides:
        """Fits (n, 4, 2) candidates and keeps those that may be markers."""
        sides = _refine(image, quads)
        return sides.keep(self._plausible(image, sides, noise))

    def _read(self, image: NDArray[np.uint8], sides: Sides) -> NDArray[np.void]:
        """Reads fitted quadrilaterals, n > 0; returns those that are markers, as SQUARE."""
        read = self._reader.read(self._reader.cells(image, sides.corners_px), self._blur(sides))
        markers = _rows(sides, read)
        side_px = lengths(markers["corners_px"]).mean(axis=1)
        doubtful = markers["residual_px"] > _CROOKED * side_px
        doubtful &= markers["margin"] < 1.0 + _CLEARER * markers["error"]
        doubtful &= self._span - 2 <= _SHORT
        return np.asarray(markers[(read["sure"] != 0) & ~doubtful])

    def _plausible(self, image: NDArray[np.uint8], sides: Sides, noise: float) -> NDArray[np.bool_]:
        """Which fitted quadrilaterals are black on white, large enough and whole."""
        corners = sides.corners_px
        length = lengths(corners)
        contrast = max(_LEAST_CONTRAST, _NOISE_CONTRAST * noise)
        high, wide = image.shape
        inside = (corners > _BORDER_PX) & (corners < np.array([wide, high]) - 1 - _BORDER_PX)
        return np.asarray(
            (sides.contrast.min(axis=1) > contrast)
            & (sides.step > _LEAST_STEP * sides.contrast).all(axis=1)
            & (sides.coverage.min(axis=1) > _LEAST_COVERAGE)
            & (length.min(axis=1) > _LEAST_CELL_PX * self._span)
            & (length.min(axis=1) > _SLIMMEST * length.max(axis=1))
            & (area(corners) > 0.0)
            & inside.all(axis=(1, 2))
        )

    def _blur(self, sides: Sides) -> Floats:
        """Returns (n, 2) point spreads along the first and the second side, in cells."""
        corners = sides.corners_px
        length = lengths(corners)
        cell = (length + np.roll(length, -2, axis=1))[:, :2] / (2.0 * self._span)
        across = (sides.blur_px + np.roll(sides.blur_px, -2, axis=1))[:, :2] / 2.0
        return np.asarray(across[:, ::-1] / cell)


def _rows(sides: Sides, read: NDArray[np.void]) -> NDArray[np.void]:
    rows = np.zeros(len(read), dtype=SQUARE)
    for name in ("tag", "error", "margin"):
        rows[name] = read[name]
    turned = (np.arange(4) - read["turn"][:, np.newaxis]) % 4
    rows["corners_px"] = sides.corners_px[np.arange(len(rows))[:, np.newaxis], turned]
    rows["residual_px"] = np.sqrt((sides.residual_px**2).mean(axis=1))
    rows["blur_px"] = sides.blur_px.mean(axis=1)
    return rows


def _refine(image: NDArray[np.uint8], quads: Floats) -> Sides:
    """Fits the sides of (n, 4, 2) candidates; those that run away are dropped."""
    share, least, most, *_ = _PASSES[0]
    rises = glance(image, quads, _reach(quads, share, least, most))
    quads = quads[(rises > _LEAST_RISE).all(axis=1)]
    none = np.zeros((len(quads), 4))
    sides = Sides(quads, none, none, none, none, none)
    for share, least, most, samples, steps in _PASSES:
        start = sides.corners_px
        if len(start) == 0:
            break
        reach = _reach(start, share, least, most)
        sides = fit_sides(image, start, reach, samples, steps)
        moved = np.hypot(*np.moveaxis(sides.corners_px - start, -1, 0)).max(axis=1)
        steady = np.isfinite(moved) & (moved < 3.0 * reach.max(axis=1))
        sides = sides.keep(steady & (sides.contrast.min(axis=1) > _LEAST_CONTRAST))
    return sides


def _reach(quads: Floats, share: float, least_px: float, most_px: float) -> Floats:
    """Returns how far to look across each side, (n, 4): a share of the width there."""
    across = np.abs(area(quads))[:, np.newaxis] / np.maximum(lengths(quads), 1.0)
    return np.clip(share * across, least_px, most_px)


def _once(quads: Floats) -> Floats:
    """Leaves out (n, 4, 2) candidates at the place and of the size of an earlier one."""
    size = np.sqrt(np.abs(area(quads)))[:, np.newaxis]
    places = np.rint(np.concatenate((quads.mean(axis=1), size), axis=1) / _ALIKE_PX)
    return quads[np.sort(np.unique(places, axis=0, return_index=True)[1])]


def _distinct(sides: Sides) -> NDArray[np.intp]:
    """Returns the best of those fits that are nearly the same."""
    centre, size = sides.corners_px.mean(axis=1), np.sqrt(np.abs(area(sides.corners_px)))
    by_x = np.argsort(centre[:, 0], kind="stable")
    x = centre[by_x, 0]
    reach = _SAME * size
    # Only what lies in the same columns is compared: thousands of candidates have few neighbours.
    first = np.searchsorted(x, centre[:, 0] - reach)
    last = np.searchsorted(x, centre[:, 0] + reach, side="right")
    best = np.zeros(len(size), dtype=bool)
    for row in np.argsort(sides.residual_px.sum(axis=1), kind="stable"):
        near = by_x[first[row] : last[row]]
        near = near[best[near]]
        gap = np.hypot(*(centre[near] - centre[row]).T)
        alike = np.abs(size[near] / size[row] - 1.0) < _SAME
        best[row] = not (alike & (gap < reach[row])).any()
    return np.flatnonzero(best)


def _parts(count: int) -> list[slice]:
    """Divides so many candidates into parts that fit the memory."""
    return [slice(first, first + _TOGETHER) for first in range(0, count, _TOGETHER)]


def _single(markers: NDArray[np.void]) -> NDArray[np.void]:
    """Keeps the clearest reading of each place; the same tag elsewhere is another marker."""
    markers = markers[np.argsort(-markers["margin"], kind="stable")]
    centre, size = markers["corners_px"].mean(axis=1), np.sqrt(np.abs(area(markers["corners_px"])))
    best: list[int] = []
    for row in range(len(markers)):
        gap = np.hypot(*(centre[best] - centre[row]).T)
        if not (gap < 0.5 * np.minimum(size[best], size[row])).any():
            best.append(row)
    markers = markers[best]
    return markers[np.lexsort((*markers["corners_px"][:, 0].T, markers["tag"]))]


def codes_of(name: str, option: str = "--family") -> Codes:
    """Returns the words of a square family, or of a dictionary by its name or file.

    Args:
        option: What messages call the name.

    Raises:
        UsageError: there are none of this name, or its markers cannot be found in any picture.
    """
    try:
        if name.endswith((".yml", ".yaml", ".xml")):
            return load_codes(name)
        if not name.endswith(".json") and name not in known_families():
            return load_codes(_dictionary(name, option))
        family = load_family(name)
    except FamilyError as error:
        raise UsageError(f"{option}: {error}") from None
    if isinstance(family, SquareFamily):
        return family.codes
    raise UsageError(
        f"{option}: {name} are arrows, which are recognized among dark things by their size, and"
        " that takes a calibrated camera: expected ArUco or AprilTag markers; arrows are found by"
        " `vsense camera track`, in folders of pictures, too, and by `vsense camera show`"
    )


def _dictionary(name: str, option: str) -> str:
    try:
        return f"DICT_{dictionary_name(name)}"
    except UsageError:
        square = [n for n in known_families() if isinstance(load_family(n), SquareFamily)]
        names = [*square, *(word for word in dir(cv2.aruco) if word.startswith("DICT_"))]
        raise UsageError(
            f"{option}: {name!r} is neither the path of a definition (.json) or of a dictionary"
            f" (.yml) nor a known family; {instead(name, names)}"
        ) from None
