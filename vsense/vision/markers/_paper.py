"""Pages of paper: polygons, strokes and text in millimetres, drawn as a PNG or written as a PDF.

The origin is the lower left corner of the paper, x to the right, y up. Grey is 0 black to 1 white.
A PNG stores its resolution. A PDF has vector graphics only, one standard font, and the same bytes
for the same pages. Source: ISO 32000-1, 7.5 (file structure), 8.5 (paths), 9.6.2.2 (fonts).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np

from vsense.base.arena import Floats, Image


@dataclass(frozen=True, slots=True)
class Fill:
    """Convex polygons of (n, 2) corners [mm], filled together so that neighbours show no seam."""

    polygons: Sequence[Floats]
    grey: float


@dataclass(frozen=True, slots=True)
class Stroke:
    """A line through (n, 2) points [mm]."""

    points: Floats
    width_mm: float
    grey: float = 0.0


@dataclass(frozen=True, slots=True)
class Text:
    """One line of Latin-1 text, from the left end of its base line."""

    x_mm: float
    y_mm: float
    size_mm: float
    text: str
    grey: float = 0.0

    @property
    def width_mm(self) -> float:
        """Its width as `draw` draws it, which is wider than in a PDF."""
        (width_px, _), _ = cv2.getTextSize(_ascii(self.text), _HERSHEY, 1.0, 1)
        return float(width_px) * self.size_mm * _CAP_HEIGHT / _HERSHEY_CAP_PX


@dataclass(frozen=True, slots=True)
class Page:
    """Items on one sheet of paper; later ones cover earlier ones."""

    width_mm: float
    height_mm: float
    items: list[Fill | Stroke | Text] = field(default_factory=list)


def line(x0_mm: float, y0_mm: float, x1_mm: float, y1_mm: float, width_mm: float) -> Stroke:
    """Returns a black line."""
    return Stroke(np.array(((x0_mm, y0_mm), (x1_mm, y1_mm))), width_mm)


def dashed_circle(x_mm: float, y_mm: float, radius_mm: float, width_mm: float) -> list[Stroke]:
    """Returns a thin grey circle of dashes about 2 mm long."""
    dashes = max(8, round(np.pi * radius_mm / 2.0))
    strokes = []
    for first in np.arange(dashes) * (2.0 * np.pi / dashes):
        turn = first + np.linspace(0.0, np.pi / dashes, 5)
        points = np.stack((x_mm + radius_mm * np.cos(turn), y_mm + radius_mm * np.sin(turn)), -1)
        strokes.append(Stroke(points, width_mm, 0.55))
    return strokes


MM_PER_INCH = 25.4

_FINE = 4
"""Samples per pixel and axis: an edge is true to an eighth of a pixel."""
_SHIFT = 8
_CAP_HEIGHT = 0.72
"""Of Helvetica, as a share of the font's size."""
_HERSHEY_CAP_PX = 21.0
_HERSHEY = cv2.FONT_HERSHEY_SIMPLEX


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
    grey = (255.0 * item.grey,)
    cv2.putText(image, _ascii(item.text), (x, y), _HERSHEY, scale, grey, weight, cv2.LINE_AA)


def _ascii(text: str) -> str:
    """What OpenCV's font can write of a text."""
    return text.encode("ascii", "replace").decode()


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


POINTS_PER_MM = 72.0 / 25.4

_FONT = b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>"
_CATALOG, _PAGES, _HELVETICA, _FIRST = 1, 2, 3, 4


def document(pages: Sequence[Page]) -> bytes:
    """Returns a PDF 1.4 document of the pages."""
    kids = " ".join(f"{_FIRST + 2 * place} 0 R" for place in range(len(pages)))
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode(),
        _FONT,
    ]
    for page in pages:
        box = f"{page.width_mm * POINTS_PER_MM:.3f} {page.height_mm * POINTS_PER_MM:.3f}"
        contents = len(objects) + 2
        objects.append(
            f"<< /Type /Page /Parent {_PAGES} 0 R /MediaBox [0 0 {box}] /Contents {contents} 0 R"
            f" /Resources << /Font << /F {_HELVETICA} 0 R >> >> >>".encode()
        )
        stream = _content(page)
        objects.append(b"<< /Length %d >>\nstream\n%b\nendstream" % (len(stream), stream))
    return _file(objects)


def _file(objects: Sequence[bytes]) -> bytes:
    """Combines numbered objects, their table and the trailer."""
    data = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")
    table = [b"0000000000 65535 f \n"]
    for number, body in enumerate(objects, 1):
        table.append(b"%010d 00000 n \n" % len(data))
        data += b"%d 0 obj\n%b\nendobj\n" % (number, body)
    start = len(data)
    data += b"xref\n0 %d\n%b" % (len(table), b"".join(table))
    data += b"trailer\n<< /Size %d /Root %d 0 R >>\n" % (len(table), _CATALOG)
    data += b"startxref\n%d\n%%%%EOF\n" % start
    return bytes(data)


def _content(page: Page) -> bytes:
    scale = f"{POINTS_PER_MM:.9f}"
    parts = [f"{scale} 0 0 {scale} 0 0 cm"]
    for item in page.items:
        if isinstance(item, Fill):
            path = " h ".join(_path(polygon) for polygon in item.polygons)
            parts.append(f"{item.grey:g} g {path} h f")
        elif isinstance(item, Stroke):
            parts.append(f"{item.grey:g} G {item.width_mm:g} w {_path(item.points)} S")
        else:
            parts.append(_text(item))
    # The font of every PDF reader has no more; "?" stands for what is missing.
    return "\n".join(parts).encode("latin-1", "replace")


def _path(points: Floats) -> str:
    pairs = [f"{x:.4f} {y:.4f}" for x, y in points]
    return f"{pairs[0]} m " + " ".join(f"{pair} l" for pair in pairs[1:])


def _text(item: Text) -> str:
    text = item.text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    place = f"{item.x_mm:.4f} {item.y_mm:.4f} Td"
    return f"{item.grey:g} g BT /F {item.size_mm:g} Tf {place} ({text}) Tj ET"
