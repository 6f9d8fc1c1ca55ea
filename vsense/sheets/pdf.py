"""Pages as a PDF: vector graphics only, one standard font, the same bytes for the same pages.

Source: ISO 32000-1, 7.5 (file structure), 8.5 (paths), 9.6.2.2 (standard fonts).
"""

from __future__ import annotations

from collections.abc import Sequence

from vsense.sheets.page import Fill, Floats, Page, Stroke, Text

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
    """Puts numbered objects, their table and the trailer together."""
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
    """The page's drawing operators, in millimetres."""
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
    return "\n".join(parts).encode("latin-1")


def _path(points: Floats) -> str:
    pairs = [f"{x:.4f} {y:.4f}" for x, y in points]
    return f"{pairs[0]} m " + " ".join(f"{pair} l" for pair in pairs[1:])


def _text(item: Text) -> str:
    text = item.text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    place = f"{item.x_mm:.4f} {item.y_mm:.4f} Td"
    return f"0 g BT /F {item.size_mm:g} Tf {place} ({text}) Tj ET"
