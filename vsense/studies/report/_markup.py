"""Pieces of the page: its style, safe text, numbers, tables, figures with running numbers."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from vsense import __version__
from vsense.base.terminal import printable_lines

DASH = "–"
"""An unknown value."""


@dataclass(frozen=True, slots=True)
class PageFigure:
    """A picture of the page; `width_px` is as shown, `wide` takes the page's whole width."""

    title: str
    caption: str
    png: bytes
    width_px: int
    wide: bool


class Counter:
    """Numbers figures and tables through the whole page, from 1."""

    def __init__(self) -> None:
        self._figures = self._tables = 0

    def figures(self, shown: Iterable[PageFigure]) -> str:
        """Pictures with their captions, embedded in the page."""
        return f'<div class="figures">{"".join(map(self._figure, shown))}</div>\n'

    def _figure(self, shown: PageFigure) -> str:
        self._figures += 1
        title, data = escape(shown.title), base64.b64encode(shown.png).decode()
        return (
            f"<figure{' class=wide' if shown.wide else ''}>"
            f'<img width="{shown.width_px}" alt="{title}" src="data:image/png;base64,{data}">'
            f"<figcaption><b>Figure {self._figures}. {title}.</b>"
            f" {escape(shown.caption)}</figcaption></figure>\n"
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
        """A table with heads of its columns; all arguments are plain text.

        `texts` are the places of columns that are words, all others are numbers, at the right;
        `over` are heads over several columns and how many each spans.
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
            f'<div class="scroll"><table><caption><span><b>Table {self._tables}.'
            f" {escape(title)}.</b> {escape(caption)}</span></caption>\n"
            f"<thead>{f'<tr>{tops}</tr>' if over else ''}"
            f"<tr>{names}</tr></thead>\n<tbody>{body}</tbody></table></div>\n"
        )


def document(title: str, lead: str, body: str, command: str) -> str:
    """A whole page; `body` is HTML, `lead` and `title` are text, `command` made it."""
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}'
        f' – vsense {escape(command)}</title>\n<meta name="viewport"'
        ' content="width=device-width, initial-scale=1">\n'
        f"<style>{CSS}</style></head><body>\n<header><h1>{escape(title)}</h1>"
        f'<p class="soft">{escape(lead)}</p></header>\n{body}'
        f'<footer class="soft">Made by vsense {escape(__version__)},'
        f" <code>vsense {escape(command)}</code>.</footer></body></html>\n"
    )
    return printable_lines(page)  # what a table or recording of somebody says is in it


def tiles(values: Iterable[tuple[str, str]]) -> str:
    """The most important numbers, large."""
    inside = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in values
    )
    return f'<dl class="tiles">{inside}</dl>\n'


def note(words: str, level: str) -> str:
    """A note to the reader; level is "warning" or "trouble"."""
    return f'<p class="note {level}">{escape(words)}</p>\n'


def warn(words: str) -> str:
    """A message, without its capital and full stop, as a note."""
    return note(f"{words[0].upper()}{words[1:]}.", "warning")


def figure_of(value: float | None) -> str:
    """A number with three significant digits; never as a power of ten below 1e6."""
    if value is None:
        return DASH
    text = f"{value:.3g}"
    return f"{value:.0f}" if "e" in text and 1.0 <= abs(value) < 1e6 else text


def share_of(value: float | None) -> str:
    """A share in percent; 100 % and 0 % only if they are exact."""
    if value is None:
        return DASH
    percent = 100.0 * value
    if 99.95 <= percent < 100.0:
        return "> 99.9"
    return "< 0.1" if 0.0 < percent < 0.05 else f"{percent:.1f}"


CSS = """
:root {
  color-scheme: light dark;
  --paper: #ffffff; --ink: #1d2329; --soft: #5a6570; --line: #d9dee3; --tint: #f4f6f8;
  --warn: #7a4b00; --warn-tint: #fff4dc; --bad: #9b2c00; --bad-tint: #fdebe3; --link: #005c94;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #14181c; --ink: #e6eaee; --soft: #a3aeb8; --line: #323a42; --tint: #1d2328;
    --warn: #ffd48a; --warn-tint: #362a12; --bad: #ffb595; --bad-tint: #3b1f14; --link: #7cc4f5;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0 auto; padding: 2rem 1.5rem 4rem; max-width: 61rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, "Helvetica Neue", Arial, sans-serif;
}
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .25rem; }
h2 {
  font-size: 1.4rem; margin: 3rem 0 .25rem; padding-top: 1rem; border-top: 2px solid var(--ink);
}
h3 { font-size: 1.08rem; margin: 2rem 0 .5rem; }
p { margin: .4rem 0; max-width: 46rem; }
a { color: var(--link); }
.soft { color: var(--soft); }
nav ul { margin: .5rem 0 0; padding-left: 1.2rem; }
.tiles {
  display: grid; grid-template-columns: repeat(auto-fill, minmax(9.2rem, 1fr)); gap: .6rem;
  margin: 1rem 0; padding: 0;
}
.tiles div { background: var(--tint); border-radius: .5rem; padding: .55rem .75rem; }
.tiles dt { color: var(--soft); font-size: .82rem; }
.tiles dd { margin: 0; font-size: 1.2rem; font-weight: 600; font-variant-numeric: tabular-nums; }
.note { border-left: 4px solid; border-radius: .25rem; padding: .5rem .8rem; margin: .6rem 0; }
.note.warning { color: var(--warn); background: var(--warn-tint); }
.note.trouble { color: var(--bad); background: var(--bad-tint); }
.figures { display: grid; grid-template-columns: 1fr 1fr; gap: 1.2rem 1.4rem; align-items: start; }
figure { margin: 0; min-width: 0; break-inside: avoid; }
figure.wide { grid-column: 1 / -1; }
figure img {
  display: block; max-width: 100%; height: auto; background: #fff; border-radius: .35rem;
  margin: 0 auto;
}
figcaption { font-size: .88rem; line-height: 1.42; color: var(--soft); margin-top: .4rem; }
figcaption b { color: var(--ink); }
caption span {
  display: inline-block; position: sticky; left: 0; max-width: min(100%, calc(100vw - 3rem));
}
.scroll { overflow-x: auto; }
table {
  border-collapse: collapse; font-size: .88rem; margin: .4rem 0; width: 100%;
  font-variant-numeric: tabular-nums;
}
caption { text-align: left; color: var(--soft); font-size: .88rem; padding-bottom: .4rem; }
caption b { color: var(--ink); }
thead th { border-bottom: 1.5px solid var(--ink); vertical-align: bottom; }
thead th.of { text-align: center; border-bottom: 1px solid var(--line); }
th, td { padding: .26rem .55rem; text-align: left; border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
td.n, th.n { text-align: right; }
td.n { white-space: nowrap; }
tbody th { font-weight: 400; }
details { margin-top: 1rem; }
summary { cursor: pointer; font-weight: 600; }
h4 { font-size: 1rem; margin: 1.2rem 0 .2rem; }
.said { margin: .2rem 0; padding-left: 1.2rem; max-width: 46rem; }
.said li { margin: .3rem 0; overflow-wrap: anywhere; }
.methods {
  background: var(--tint); border-radius: .5rem; padding: .8rem 1rem; user-select: all;
  -webkit-user-select: all; max-width: 46rem;
}
pre {
  background: var(--tint); border-radius: .5rem; padding: .8rem; font-size: .78rem;
  white-space: pre-wrap; overflow-x: auto;
}
footer { margin-top: 3rem; padding-top: .8rem; border-top: 1px solid var(--line); }
@media (max-width: 44rem) { .figures { grid-template-columns: 1fr; } }
@media print {
  :root {
    color-scheme: light;
    --paper: #fff; --ink: #000; --soft: #444; --line: #bbb; --tint: #f2f2f2; --link: #000;
    --warn: #5c3900; --warn-tint: #fff; --bad: #7a2300; --bad-tint: #fff;
  }
  body { max-width: none; padding: 0; font-size: 10.5pt; }
  h2 { break-before: page; }
  h2.first { break-before: auto; }
  h2, h3 { break-after: avoid; }
  .figures { display: block; }
  figure { display: inline-block; width: 48.5%; vertical-align: top; margin: 0 1% 5mm 0; }
  figure.wide { display: block; width: 100%; }
  .tiles { grid-template-columns: repeat(4, 1fr); }
  .scroll { overflow: visible; }
  table { font-size: 7.5pt; }
  th, td { padding: 1pt 3pt; }
  figcaption, caption { font-size: 8.5pt; }
  tr, .tiles { break-inside: avoid; }
  details, nav { display: none; }
}
@page { margin: 16mm; }
"""
