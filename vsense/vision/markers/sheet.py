"""A sheet of markers: as many as fit on the paper, their numbers, and a bar to check the print.

Numbers are also written in words: a 6 looks like a 9 from the other side, "six" does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, failing_as
from vsense.vision.markers._dictionary import SquareFamily
from vsense.vision.markers._paper import Fill, Page, Text, dashed_circle, document, draw, line, png
from vsense.vision.markers.families import MarkerFamily, load_family, parse_tags

AnyFamily = MarkerFamily | SquareFamily


def shapes(family: AnyFamily, tag: int) -> list[Fill]:
    """Returns a marker's black and white parts, seen from above; raises FamilyError.

    The corners are in mm in the family frame moved to the disc's centre: +x is the driving
    direction, +y the left.
    """
    if isinstance(family, MarkerFamily):
        black = family.polygon_mm
        turn = 0.0
    else:
        half = family.size_mm / 2.0
        black = np.array(((-half, -half), (half, -half), (half, half), (-half, half)))
        turn = -math.radians(family.heading_deg)
    cells = list(_white_cells(family.bits(tag), family.cell_mm))
    fills = [Fill([black], 0.0), *([Fill(cells, 1.0)] if cells else [])]
    return [_moved(fill, turn, -family.disc_centre_mm) for fill in fills]


def _white_cells(bits: NDArray[np.bool_], cell_mm: float) -> Iterator[Floats]:
    """Yields rectangles around the runs of white cells of each row."""
    half = len(bits) / 2.0
    for row, cells in enumerate(bits):
        steps = np.diff(np.concatenate(((0,), cells.astype(np.int8), (0,))))
        front, back = (half - row) * cell_mm, (half - row - 1) * cell_mm
        for first, end in zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)):
            left, right = (half - first) * cell_mm, (half - end) * cell_mm
            yield np.array(((back, right), (front, right), (front, left), (back, left)))


def _moved(fill: Fill, turn_rad: float, shift_mm: Floats) -> Fill:
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    rotation = np.array(((c, s), (-s, c)))
    return Fill([polygon @ rotation + shift_mm for polygon in fill.polygons], fill.grey)


_SMALL = [
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
    "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen",
    "nineteen",
]  # fmt: skip
_TENS = ["twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"]


def in_words(number: int) -> str:
    """Returns a number from 0 to 999,999 in English words."""
    if number < 20:
        return _SMALL[number]
    if number < 100:
        tens = _TENS[number // 10 - 2]
        return f"{tens}-{_SMALL[number % 10]}" if number % 10 else tens
    if number < 1000:
        tail = f" and {in_words(number % 100)}" if number % 100 else ""
        return f"{_SMALL[number // 100]} hundred{tail}"
    rest = number % 1000
    link = " and " if rest < 100 else " "
    return f"{in_words(number // 1000)} thousand" + (link + in_words(rest) if rest else "")


PAPERS_MM = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}

SMALLEST_MM = 10.0

_MARGIN_MM = 9.0
"""Home printers leave up to 6 mm of each edge white."""
_HEAD_MM = 6.0
_FOOT_MM = 12.0
_LABEL_MM = 6.0
_GAP_MM = 5.0
_BAR_MM = 100.0
_OVERHANG_MM = 0.5
_LARGER_MM = 10.0
"""A body's edge is drawn where it is so much larger than the disc."""
_CAPTION_MM = 3.2
_NUMBER_SHARE, _NUMBER_PLACE, _NUMBER_GREY = 0.035, 0.93, 0.45
"""Of the number on the disc: size as a share of the diameter, place of its base line as a share of
the radius, and grey."""


def largest_mm(paper: str) -> float:
    """Returns the diameter of the largest disc that fits on a paper."""
    width, height = PAPERS_MM[paper]
    high = height - 2.0 * _MARGIN_MM - _HEAD_MM - _FOOT_MM - _LABEL_MM - _GAP_MM
    return math.floor(min(width - 2.0 * _MARGIN_MM - _GAP_MM, high))


def pages(
    family: AnyFamily,
    tags: Sequence[int],
    size_mm: float,
    paper: str,
    names: Mapping[int, str] | None = None,
    bodies_mm: Mapping[int, float] | None = None,
) -> list[Page]:
    """Lays out the markers of some tags, with discs of `size_mm`, on a paper of `PAPERS_MM`.

    `names` are of those who will wear them, by tag, and `bodies_mm` their diameters: around a disc
    on a larger body there is a second cut line, the body's edge, if the paper has room for it.

    Raises:
        UsageError: A marker of that size does not fit on the paper, or cannot be cut.
        FamilyError: The family has no such tag.
    """
    if not SMALLEST_MM <= size_mm <= largest_mm(paper):
        raise UsageError(
            f"a marker of {size_mm:g} mm: expected {SMALLEST_MM:g} to {largest_mm(paper):g} mm"
            f" on {paper} paper"
        )
    cells: dict[float, list[int]] = {}
    for tag in tags:
        body_mm = (bodies_mm or {}).get(tag, 0.0)
        is_shown = size_mm + _LARGER_MM <= body_mm <= largest_mm(paper)
        cells.setdefault(body_mm if is_shown else size_mm, []).append(tag)
    sheets = [(mm, each) for mm, worn in cells.items() for each in _shared_out(worn, mm, paper)]
    drawn = []
    for number, (cell_mm, places) in enumerate(sheets, 1):
        page = Page(*PAPERS_MM[paper])
        body = "" if cell_mm == size_mm else f" (outer line: the body, {cell_mm:.0f} mm)"
        _frame(page, f"{family.name}, disc {size_mm:g} mm{body}, page {number} of {len(sheets)}")
        for tag, x, y in places:
            _marker(page, family, tag, size_mm, x, y)
            if cell_mm != size_mm:
                page.items.extend(dashed_circle(x, y, cell_mm / 2.0, 0.1))
            page.items.extend(_caption(tag, (names or {}).get(tag, ""), cell_mm, x, y))
        drawn.append(page)
    return drawn


def _shared_out(
    tags: Sequence[int], cell_mm: float, paper: str
) -> Iterator[list[tuple[int, float, float]]]:
    """Yields for each page its tags, and the middles of their circles."""
    width, height = PAPERS_MM[paper]
    wide, high = cell_mm + _GAP_MM, cell_mm + _GAP_MM + _LABEL_MM
    columns = int((width - 2.0 * _MARGIN_MM) // wide)
    rows = int((height - 2.0 * _MARGIN_MM - _HEAD_MM - _FOOT_MM) // high)
    left = (width - columns * wide) / 2.0
    top = height - _MARGIN_MM - _HEAD_MM
    for first in range(0, len(tags), columns * rows):
        places = (divmod(place, columns) for place in range(columns * rows))
        yield [
            (tag, left + (column + 0.5) * wide, top - row * high - wide / 2.0)
            for tag, (row, column) in zip(tags[first:], places)
        ]


def _marker(
    page: Page, family: AnyFamily, tag: int, size_mm: float, x_mm: float, y_mm: float
) -> None:
    """Draws a marker that drives up the page, with its cut line, marks and label."""
    radius = size_mm / 2.0
    scale = size_mm / family.disc_diameter_mm
    for fill in shapes(family, tag):
        # The driving direction (+x) goes up the page, the robot's left (+y) to the left.
        turned = [
            np.stack((x_mm - scale * p[:, 1], y_mm + scale * p[:, 0]), axis=-1)
            for p in fill.polygons
        ]
        page.items.append(Fill(turned, fill.grey))
    page.items.extend(dashed_circle(x_mm, y_mm, radius, 0.1))
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        ends = [value for r in (radius + 0.5, radius + 2.2) for value in (dx * r, dy * r)]
        page.items.append(line(x_mm + ends[0], y_mm + ends[1], x_mm + ends[2], y_mm + ends[3], 0.2))
    page.items.append(_own_number(tag, size_mm, x_mm, y_mm))


def _own_number(tag: int, size_mm: float, x_mm: float, y_mm: float) -> Text:
    """A tag's number on the disc itself, in grey, at the rear: cut out, it still tells.

    It stands where every family is white, more than a cell away from what is black.
    """
    radius, high = size_mm / 2.0, size_mm * _NUMBER_SHARE
    number = Text(0.0, 0.0, high, str(tag), _NUMBER_GREY)
    return replace(number, x_mm=x_mm - number.width_mm / 2.0, y_mm=y_mm - radius * _NUMBER_PLACE)


def _caption(tag: int, name: str, size_mm: float, x_mm: float, y_mm: float) -> list[Text]:
    """What stands below a marker, no wider than it is: its number and name, and it in words."""
    head = f"{tag}   {name}".rstrip()
    cap = Text(0.0, 0.0, min(_CAPTION_MM, size_mm / 16.0), f"{head}   {in_words(tag)}")
    lines = (
        [cap]
        if cap.width_mm <= size_mm
        else [replace(cap, size_mm=0.8 * cap.size_mm, text=text) for text in (head, in_words(tag))]
    )
    fitted = [replace(text, size_mm=_fitting(text, size_mm)) for text in lines]
    below = y_mm - size_mm / 2.0 - _GAP_MM / 2.0
    return [
        replace(text, x_mm=x_mm - size_mm / 2.0, y_mm=below - (1.0 + 1.25 * row) * lines[0].size_mm)
        for row, text in enumerate(fitted)
    ]


def _fitting(text: Text, width_mm: float) -> float:
    """The size at which a text is no wider than a length."""
    return text.size_mm * min(1.0, width_mm / text.width_mm)


def _frame(page: Page, title: str) -> None:
    """Draws the page's title and the bar that shows whether the printer kept the scale."""
    top = page.height_mm - _MARGIN_MM - 3.0
    page.items.append(Text(_MARGIN_MM, top, 3.2, f"vsense camera markers: {title}"))
    left, base = _MARGIN_MM, _MARGIN_MM + 1.5
    page.items.append(line(left, base, left + _BAR_MM, base, 0.3))
    for step in range(11):
        high = 3.0 if step % 5 == 0 else 1.8
        x = left + step * _BAR_MM / 10.0
        page.items.append(line(x, base - 0.15, x, base + high, 0.3))
    advice = "This bar must measure 100 mm:"
    page.items.append(Text(left + _BAR_MM + 4.0, base + 2.6, 3.2, advice))
    page.items.append(
        Text(left + _BAR_MM + 4.0, base - 1.6, 3.2, "print at 100 %, not fit to page")
    )


@dataclass(frozen=True, slots=True)
class SheetOptions:
    """Which markers are drawn into which file; see `vsense camera markers -h`.

    Attributes:
        output: NAME.pdf, or NAME.png; several pages become NAME-1.png, NAME-2.png, ...
        family: a shipped family's name, or a definition file.
        ids: their numbers, as `parse_tags` reads them; where there are `names` they count.
        names: who wears them, by number.
        bodies_mm: diameters of their bodies, by number, where they are known.
        size_mm: diameter of the disc; None: the family's.
        paper: "a4" or "letter".
        dpi: of PNGs.
    """

    output: Path
    family: str = "arrow4x4"
    ids: str = ""
    names: Mapping[int, str] = field(default_factory=dict)
    bodies_mm: Mapping[int, float] = field(default_factory=dict)
    size_mm: float | None = None
    paper: str = "a4"
    dpi: int = 300


@dataclass(frozen=True, slots=True)
class Sheets:
    """Sheets that were written.

    Attributes:
        files: they.
        tags: the markers' numbers.
        scale: how discs that do not have the family's size are tracked; None: they have.
        too_large: which bodies are smaller than their discs; None: none is.
    """

    files: tuple[Path, ...]
    tags: tuple[int, ...]
    scale: str | None
    too_large: str | None


def write(options: SheetOptions) -> Sheets:
    """Writes sheets of markers, true to scale.

    Raises:
        UsageError: a number, the size or the file's name cannot be used, or it cannot be written.
        FamilyError: there is no such family.
    """
    output, dpi = options.output, options.dpi
    suffix = output.suffix.lower()
    if suffix not in (".pdf", ".png"):
        raise UsageError(f"{output}: expected a name that ends in .pdf or .png")
    family = load_family(options.family)
    tags = list(options.names) if options.names else parse_tags(options.ids, family)
    size_mm = options.size_mm or family.disc_diameter_mm
    drawn = pages(family, tags, size_mm, options.paper, options.names, options.bodies_mm)
    if suffix == ".pdf":
        files = {output: document(drawn)}
    else:
        names = _file_names(output, len(drawn))
        files = {name: png(draw(page, dpi), dpi) for name, page in zip(names, drawn)}
    for name, data in files.items():
        with failing_as(UsageError, f"{name}: cannot be written"):
            name.write_bytes(data)
    too_large = _too_large(options, size_mm)
    return Sheets(tuple(files), tuple(tags), _scale_hint(family, size_mm), too_large)


def _too_large(options: SheetOptions, size_mm: float) -> str | None:
    """Names who is smaller than a disc of this size."""
    small = {tag: body for tag, body in options.bodies_mm.items() if body < size_mm - _OVERHANG_MM}
    if not small:
        return None
    names = ", ".join(
        f"{options.names.get(tag) or tag} ({body:.0f} mm)" for tag, body in small.items()
    )
    fitting_mm = math.floor(min(small.values()))
    fits = f"--size {fitting_mm}mm fits" if fitting_mm >= SMALLEST_MM else "no size fits"
    return (
        f"discs of {size_mm:g} mm are larger than the bodies of {names}: those of neighbours may"
        f" cover each other; {fits}, and one experiment's markers all have one size"
    )


def _scale_hint(family: AnyFamily, size_mm: float) -> str | None:
    if abs(size_mm - family.disc_diameter_mm) <= 1e-6:
        return None
    scale = size_mm / family.disc_diameter_mm
    return (
        f"the family {family.name} is defined for discs of {family.disc_diameter_mm:g} mm: track"
        f" these with a definition whose lengths are {scale:.6g} times as large"
    )


def _file_names(output: Path, count: int) -> list[Path]:
    if count == 1:
        return [output]
    width = len(str(count))
    return [output.with_stem(f"{output.stem}-{n:0{width}}") for n in range(1, count + 1)]
