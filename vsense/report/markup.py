"""Pieces of the page: text that is safe, numbers, tables, figures with running numbers."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

import cv2

from vsense.pictures.canvas import SCALE
from vsense.recording.form import RecordingError
from vsense.report.picture import Figure

DASH = "–"
"""Where nobody told a value."""


class Counter:
    """Numbers figures and tables through the whole page."""

    def __init__(self) -> None:
        """Begins with 1."""
        self._figures = self._tables = 0

    def figure(self, picture: Figure, png: bytes) -> str:
        """A picture with its caption; the picture is part of the page."""
        self._figures += 1
        height, width = (side // SCALE for side in picture.image.shape[:2])
        data = base64.b64encode(png).decode()
        return (
            f"<figure{' class=wide' if picture.wide else ''}>"
            f'<img width="{width}" height="{height}" alt="{escape(picture.title)}"'
            f' src="data:image/png;base64,{data}">'
            f"<figcaption><b>Figure {self._figures}. {escape(picture.title)}.</b>"
            f" {escape(picture.caption)}</figcaption></figure>\n"
        )

    def table(
        self,
        title: str,
        caption: str,
        heads: Sequence[str],
        rows: Iterable[Sequence[str]],
        texts: Sequence[int] = (0,),
        over: Sequence[tuple[str, int]] = (),
    ) -> str:
        """A table.

        Args:
            title: what it is.
            caption: what its columns are; text.
            heads: names of the columns; text.
            rows: cells; text.
            texts: places of the columns that are words; all others are numbers, at the right.
            over: heads over several columns and how many each spans.
        """
        self._tables += 1
        kinds = ["" if place in texts else ' class="n"' for place in range(len(heads))]
        tops = "".join(f'<th colspan="{n}" class="of">{escape(words)}</th>' for words, n in over)
        names = "".join(f"<th{kind}>{escape(words)}</th>" for kind, words in zip(kinds, heads))
        body = "".join(
            "<tr>"
            + "".join(f"<td{kind}>{escape(cell)}</td>" for kind, cell in zip(kinds, row))
            + "</tr>\n"
            for row in rows
        )
        return (
            f'<div class="scroll"><table><caption><b>Table {self._tables}. {escape(title)}.</b>'
            f" {escape(caption)}</caption>\n<thead>{f'<tr>{tops}</tr>' if over else ''}"
            f"<tr>{names}</tr></thead>\n<tbody>{body}</tbody></table></div>\n"
        )


def encode(picture: Figure) -> bytes:
    """A picture as PNG.

    Raises:
        RecordingError: it cannot be made.
    """
    done, data = cv2.imencode(".png", picture.image, [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not done:
        raise RecordingError(f"{picture.name}.png: cannot be made")
    return data.tobytes()


def tiles(values: Iterable[tuple[str, str]]) -> str:
    """The most important numbers, large."""
    inside = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in values
    )
    return f'<dl class="tiles">{inside}</dl>\n'


def note(words: str, level: str) -> str:
    """Something that a reader must know; level is "warning" or "trouble"."""
    return f'<p class="note {level}">{escape(words)}</p>\n'


def figure_of(value: float | None, digits: int = 3) -> str:
    """A number with so many digits that say something; never as a power of ten below 1e6."""
    if value is None:
        return DASH
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e" in text and 1.0 <= abs(value) < 1e6 else text


def share_of(value: float | None) -> str:
    """A share in percent; 100 % and 0 % are said only where they are so."""
    if value is None:
        return DASH
    percent = 100.0 * value
    if 99.95 <= percent < 100.0:
        return "> 99.9"
    return "< 0.1" if 0.0 < percent < 0.05 else f"{percent:.1f}"
