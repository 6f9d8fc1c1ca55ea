"""Pages as grey pictures, and pictures as PNG files that know their resolution."""

from __future__ import annotations

import struct
import zlib
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.sheets.page import Fill, Floats, Page, Stroke, Text

Image = NDArray[np.uint8]

MM_PER_INCH = 25.4

_FINE = 4
"""Samples per pixel and axis: an edge is true to an eighth of a pixel."""
_SHIFT = 8
_CAP_HEIGHT = 0.72
"""Of Helvetica, as a share of the font's size."""
_HERSHEY_CAP_PX = 21.0


def draw(page: Page, dpi: float) -> Image:
    """Returns the page as a (height, width) picture at `dpi` pixels per inch."""
    px_per_mm = dpi / MM_PER_INCH
    shape = (round(page.height_mm * px_per_mm), round(page.width_mm * px_per_mm))
    image = np.full(shape, 255, dtype=np.uint8)
    # Pixel centres are whole numbers; the paper's upper edge is at row -0.5.
    corner = np.array((-0.5, page.height_mm * px_per_mm - 0.5))
    axes = np.array((px_per_mm, -px_per_mm))
    for item in page.items:
        if isinstance(item, Fill):
            _fill(image, [corner + axes * polygon for polygon in item.polygons], item.grey)
        elif isinstance(item, Stroke):
            half = item.width_mm * px_per_mm / 2.0
            _fill(image, _bars(corner + axes * item.points, half), item.grey)
        else:
            _write(image, item, corner + axes * (item.x_mm, item.y_mm), px_per_mm)
    return image


def _fill(image: Image, polygons_px: list[Floats], grey: float) -> None:
    """Covers the union of convex polygons with a grey, with smooth edges."""
    every = np.concatenate(polygons_px)
    size = np.array(image.shape[::-1])
    low = np.clip(np.floor(every.min(axis=0)).astype(int), 0, size)
    high = np.clip(np.ceil(every.max(axis=0)).astype(int) + 2, low, size)
    (x0, y0), (x1, y1) = low, high
    if x0 == x1 or y0 == y1:
        return
    fine = np.zeros(((y1 - y0) * _FINE, (x1 - x0) * _FINE), dtype=np.uint8)
    for polygon in polygons_px:
        # OpenCV also covers pixels whose centre lies up to half a pixel outside.
        inner = _shrunk((polygon - low + 0.5) * _FINE - 0.5, 0.5)
        cv2.fillConvexPoly(fine, np.rint(inner * (1 << _SHIFT)).astype(np.int32), 255, shift=_SHIFT)
    cover = cv2.resize(fine, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA) / 255.0
    part = image[y0:y1, x0:x1]
    part[:] = np.rint(part + cover * (255.0 * grey - part))


def _shrunk(corners: Floats, distance: float) -> Floats:
    """Moves the sides of a convex polygon inwards."""
    ahead = np.roll(corners, -1, axis=0) - corners
    ahead /= np.hypot(*ahead.T)[:, np.newaxis]
    behind = np.roll(ahead, 1, axis=0)
    turn = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    return np.asarray(corners + distance * (ahead - behind) / np.abs(turn)[:, np.newaxis])


def _bars(points_px: Floats, half_px: float) -> list[Floats]:
    """Returns a rectangle around each piece of a line."""
    bars = []
    for start, end in pairwise(points_px):
        along = (end - start) / np.hypot(*(end - start))
        side = half_px * np.array((-along[1], along[0]))
        bars.append(np.array((start - side, end - side, end + side, start + side)))
    return bars


def _write(image: Image, item: Text, place_px: Floats, px_per_mm: float) -> None:
    scale = item.size_mm * px_per_mm * _CAP_HEIGHT / _HERSHEY_CAP_PX
    x, y = (round(float(value)) for value in place_px)
    weight = max(1, round(2.0 * scale))
    font = cv2.FONT_HERSHEY_SIMPLEX
    text = item.text.encode("ascii", "replace").decode()
    cv2.putText(image, text, (x, y), font, scale, (0.0,), weight, cv2.LINE_AA)


def png(image: Image, dpi: float) -> bytes:
    """Returns a (height, width) picture as a PNG that prints at its true size."""
    height, width = image.shape
    per_metre = round(dpi / MM_PER_INCH * 1000.0)
    rows = np.zeros((height, width + 1), dtype=np.uint8)
    rows[:, 1:] = image
    return b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
            _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
            _chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)),
            _chunk(b"IEND", b""),
        )
    )


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
