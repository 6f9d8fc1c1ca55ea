"""`vsense camera markers find`: square markers in pictures of any camera, calibrated or not."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.canvas import FONT, INK, Colour
from vsense.base.errors import GrabberError, UsageError, failing_as
from vsense.base.terminal import Console, print_data, printable
from vsense.tools.camera_setup.showing import save_picture
from vsense.vision.cameras.picture import ENDINGS, Image, PictureError, pictures_in, read_picture
from vsense.vision.tracking.squares import SquareFinder, codes_of

TAG_ROW = ("picture", "tag", "x1_px", "y1_px", "x2_px", "y2_px", "x3_px", "y3_px", "x4_px", "y4_px")
"""Of the table: the corners as in SQUARE, the upper left one first, clockwise in the picture."""

_DRAWN: Colour = (110, 150, 0)
_WHITE: Colour = (255, 255, 255)
_FRACTION = 4
"""Bits after the point in the coordinates of what is drawn."""
_LINE, _LETTERS = 1 / 60, 1 / 100
"""Width of a line, and size of letters, as a share of a marker's side."""


@dataclass(frozen=True, slots=True)
class FindOptions:
    """What `vsense camera markers find` is asked for.

    Attributes:
        pictures: picture files, and folders with such.
        family: the markers to look for: a square family, or a dictionary.
        format: of what is printed: "jsonl" or "csv".
        draw: folder for the pictures with what was found drawn in; None: none are drawn.
        least_side: shortest side of a marker [px].
    """

    pictures: Sequence[Path]
    family: str
    format: str
    draw: Path | None
    least_side: float


def run(options: FindOptions) -> int:
    """Finds the markers of all pictures and prints them; a damaged picture does not end it.

    Returns:
        0, or 1 where a picture could not be used.

    Raises:
        UsageError: there is nothing to look at, or no dictionary to look for.
        VsenseError: a drawn picture cannot be written.
    """
    paths = list(_listed(options.pictures))
    drawn = _targets(paths, options.draw)
    codes = codes_of(options.family)
    finder = SquareFinder(codes)
    table = csv.writer(sys.stdout, lineterminator="\n")
    if options.format == "csv":
        table.writerow(TAG_ROW)
    count = damaged = 0
    for path in paths:
        try:
            image = read_picture(path, str(path))
        except PictureError as error:
            Console().say(f"vsense: {printable(str(error))}")
            damaged += 1
            continue
        markers = finder.find(image, options.least_side, local_corners=True)
        count += len(markers)
        if options.format == "csv":
            table.writerows(_rows(path, markers))
        else:
            print_data(_line(path, image, markers))
        sys.stdout.flush()
        if path in drawn:
            save_picture(draw(image, markers), drawn[path])
    Console().say(f"vsense: {_summary(len(paths), damaged, count, codes.name)}")
    return 1 if damaged else 0


def _listed(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        with failing_as(UsageError, f"{path}: cannot be read"):
            is_folder, is_there = path.is_dir(), path.exists()
        if not is_there:
            raise UsageError(f"{path}: there is no such picture or folder")
        if not is_folder:
            yield path
            continue
        try:
            names = pictures_in(path)
        except GrabberError as error:
            raise UsageError(str(error)) from None
        if not names:
            raise UsageError(f"{path}: holds no pictures, expected {', '.join(ENDINGS)}")
        yield from (path / name for name in names)


def _targets(paths: Sequence[Path], folder: Path | None) -> dict[Path, Path]:
    """Returns the file that each picture is drawn into; no two, and no picture itself."""
    if folder is None:
        return {}
    with failing_as(UsageError, f"--draw: {folder}: cannot be made"):
        folder.mkdir(parents=True, exist_ok=True)
    taken = {path.resolve() for path in paths}
    targets: dict[Path, Path] = {}
    for path in dict.fromkeys(paths):
        names = (f"{path.stem}{f'-{n}' if n else ''}.png" for n in range(len(paths) * 2))
        targets[path] = next(folder / n for n in names if (folder / n).resolve() not in taken)
        taken.add(targets[path].resolve())
    return targets


def _rows(path: Path, rows: NDArray[np.void]) -> list[list[str]]:
    return [
        [printable(str(path)), str(row["tag"]), *(f"{v:.3f}" for v in row["corners_px"].ravel())]
        for row in rows
    ]


def _line(path: Path, image: Image, rows: NDArray[np.void]) -> str:
    height, width = image.shape
    markers = [
        {
            "tag": int(row["tag"]),
            "corners_px": np.round(row["corners_px"], 3).tolist(),
            "margin": round(float(row["margin"]), 3),
            "residual_px": round(float(row["residual_px"]), 3),
            "blur_px": round(float(row["blur_px"]), 3),
        }
        for row in rows
    ]
    head = {"picture": printable(str(path)), "width_px": width, "height_px": height}
    return json.dumps({**head, "markers": markers}, separators=(",", ":"))


def _summary(pictures: int, damaged: int, markers: int, name: str) -> str:
    text = f"{_counted(pictures - damaged, 'picture')}, {_counted(markers, 'marker')} of {name}"
    return f"{text}; {_counted(damaged, 'picture')} could not be used" if damaged else text


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def draw(image: Image, rows: NDArray[np.void]) -> Image:
    """Draws SQUARE rows into an (h, w) uint8 picture; returns it as (h, w, 3) BGR.

    Each marker has its outline, its tag, and a dot on its first corner.
    """
    canvas = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    for row in rows:
        corners = row["corners_px"]
        side = float(np.hypot(*(np.roll(corners, -1, axis=0) - corners).T).mean())
        width = max(2, round(_LINE * side))
        fixed = np.rint(corners * (1 << _FRACTION)).astype(np.int32)
        cv2.polylines(canvas, [fixed], True, _DRAWN, width, cv2.LINE_AA, _FRACTION)
        radius = 2 * width << _FRACTION
        cv2.circle(canvas, fixed[0].tolist(), radius, _DRAWN, cv2.FILLED, cv2.LINE_AA, _FRACTION)
        _write(canvas, str(row["tag"]), corners, 2 * width, max(0.5, _LETTERS * side))
    return canvas


def _write(canvas: Image, text: str, corners: NDArray[np.float64], apart: int, size: float) -> None:
    """Writes a text on a white plate above a marker, or below where the picture ends."""
    weight = max(1, round(1.5 * size))
    (wide, high), _ = cv2.getTextSize(text, FONT, size, weight)
    pad = 2 + weight
    x, top, bottom = corners[:, 0].mean(), corners[:, 1].min(), corners[:, 1].max()
    left, base = round(x - wide / 2), round(top) - apart - pad
    if base < high + pad:
        base = round(bottom) + apart + pad + high
    corner = (left + wide + pad, base + pad)
    cv2.rectangle(canvas, (left - pad, base - high - pad), corner, _WHITE, cv2.FILLED)
    cv2.putText(canvas, text, (left, base), FONT, size, INK, weight, cv2.LINE_AA)
