"""`vsense camera markers find`: square markers in pictures of any camera, calibrated or not."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Image
from vsense.base.canvas import FONT, INK, Colour
from vsense.base.errors import GrabberError, UsageError, failing_as
from vsense.base.terminal import Console, counted, print_data, printable
from vsense.tools.camera_setup.showing import save_picture
from vsense.vision.cameras.picture import ENDINGS, PictureError, pictures_in, read_picture, to_grey
from vsense.vision.tracking.squares import LEAST_SIDE_PX, SquareFinder, codes_of

TAG_ROW = ("picture", "tag", "x1_px", "y1_px", "x2_px", "y2_px", "x3_px", "y3_px", "x4_px", "y4_px")
"""Of the table: the corners as in SQUARE, the upper left one first, clockwise in the picture."""

_DRAWN: Colour = (110, 150, 0)
_WHITE: Colour = (255, 255, 255)
_FRACTION = 4
"""Bits after the point in the coordinates of what is drawn."""
_LINE, _LETTERS = 1 / 60, 1 / 100
"""Width of a line, and size of letters, as a share of a marker's side."""


def detect(
    picture: NDArray[Any] | str | Path, family: str, least_side_px: float = LEAST_SIDE_PX
) -> NDArray[np.void]:
    """Finds the ArUco or AprilTag markers of a picture, taken by any camera.

    Args:
        picture: (h, w) grey or (h, w, 3) BGR, uint8 or uint16, as OpenCV reads it; or its file.
        family: one of OpenCV's dictionaries, such as "DICT_4X4_50", the path of one (.yml), or a
            family of vsense that is no arrow, such as "apriltag_36h11".
        least_side_px: shortest side of a marker, seen face to face; 20 and more is faster.

    Returns:
        A row for each marker, sorted by "tag"; "corners_px" (4, 2) are its corners [px] from the
        upright marker's upper left one, clockwise, with (0, 0) in the middle of the upper left
        pixel; the other columns are those of `SQUARE`.

    Raises:
        UsageError: there are no such markers, or the side is not positive.
        PictureError: the picture cannot be used.
    """
    if not least_side_px > 0:
        raise UsageError(f"least_side_px: {least_side_px!r}, expected a number of pixels above 0")
    if isinstance(picture, (str, Path)):
        image = read_picture(Path(picture), str(picture))
    else:
        image = to_grey(np.asarray(picture))
    changed_ns = Path(family).stat().st_mtime_ns if Path(family).is_file() else 0
    return _finder(family, changed_ns).find(image, least_side_px, local_corners=True)


@lru_cache(maxsize=4)
def _finder(family: str, _changed_ns: int) -> SquareFinder:
    # To prepare the words of a dictionary takes as long as to find its markers in a picture.
    return SquareFinder(codes_of(family, "family"))


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
    name = codes_of(options.family).name
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
        markers = detect(image, options.family, options.least_side)
        count += len(markers)
        if options.format == "csv":
            table.writerows(_rows(path, markers))
        else:
            print_data(_line(path, image, markers))
        sys.stdout.flush()
        if path in drawn:
            save_picture(draw(image, markers), drawn[path])
    Console().say(f"vsense: {_summary(len(paths), damaged, count, name)}")
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
    text = f"{counted(pictures - damaged, 'picture')}, {counted(markers, 'marker')} of {name}"
    return f"{text}; {counted(damaged, 'picture')} could not be used" if damaged else text


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
