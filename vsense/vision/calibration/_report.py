"""Reports about a calibration: a picture, one JSON object, and a few lines for the terminal.

The picture shows per camera where corners were seen and how far off each is, and the rig from
above. An arrow starts at a corner and is its residual, enlarged; the colour behind grows darker
with the number of corners. In white places no corner was seen: the lens is extrapolated there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import cycle
from typing import Any

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.canvas import GRID, INK, MUTED, Canvas, Colour, round_number, width_of
from vsense.base.terminal import aligned
from vsense.vision.calibration._bundle import lens_of
from vsense.vision.calibration._solution import BoardCheck, Solution, ViewResult, rms
from vsense.vision.calibration.board import Board
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._legibility import Legibility

_COOL = np.array((250.0, 246.0, 240.0))
_WARM = np.array((196.0, 158.0, 96.0))
_GOOD = np.array((150.0, 70.0, 20.0))
_BAD = np.array((40.0, 40.0, 226.0))


def heat(share: Floats) -> Image:
    """Colours of (h, w) values from 0, nearly white, to 1, blue."""
    share = np.clip(share, 0.0, 1.0)[..., np.newaxis]
    return np.asarray(np.rint(_COOL + (_WARM - _COOL) * share), dtype=np.uint8)


def alarm(share: float) -> Colour:
    """The colour of a residual, from 0, dark blue, to 1, red."""
    mixed = _GOOD + (_BAD - _GOOD) * min(max(share, 0.0), 1.0)
    return int(mixed[0]), int(mixed[1]), int(mixed[2])


PANEL = 560
"""Width of a camera's picture in a report [px]."""
_SQUARE_M, _LINE = 0.5, 0.8
_UNREAD: Colour = (110, 110, 235)
_SELDOM: Colour = (150, 225, 250)
_MARGIN = 40
_HEAD = 126
_CAPTION = 64
_ARROW_PX = 22.0
"""Length of an arrow for the 95th percentile of the residuals."""
_CELL = 40
"""Cells of the coverage along the width."""
_CORNERS_FULL = 6.0
"""Corners per cell that are drawn in full colour."""
_EDGE_POINTS = 24
_TINTS: tuple[Colour, ...] = (
    (180, 110, 40), (60, 140, 245), (90, 160, 60), (170, 80, 160), (40, 170, 210), (90, 90, 90),
)  # fmt: skip


def draw(title: str, subtitle: str, solution: Solution, board: Board | None) -> Image:
    """Draws the report's picture, (h, w, 3) BGR."""
    cameras = solution.cameras
    rig = bool(solution.bodies)
    panels = len(cameras) + rig
    columns = min(math.ceil(math.sqrt(panels)), 4)
    rows = math.ceil(panels / columns)
    height = round(PANEL * max(c.height_px / c.width_px for c in cameras))
    step_x, step_y = PANEL + _MARGIN, height + _CAPTION + _MARGIN // 2
    canvas = Canvas(_MARGIN + columns * step_x, _HEAD + rows * step_y + 10)
    canvas.text(title, _MARGIN, 50, INK, 1.0)
    canvas.text(subtitle, _MARGIN, 80, MUTED, 0.52)
    longest = _usual_longest_px(solution)
    enlarged = _ARROW_PX * np.mean([c.width_px for c in cameras]) / (longest * PANEL)
    legend = f"arrows: seen minus model, {enlarged:.0f} x; blue: corners seen; pale: none"
    canvas.text(legend, _MARGIN, 104, MUTED, 0.46)
    places = [
        (_MARGIN + (k % columns) * step_x, _HEAD + (k // columns) * step_y) for k in range(panels)
    ]
    for camera, (x, y) in zip(cameras, places):
        _camera_panel(canvas, camera, solution.of(camera.id), x, y, longest)
    if rig:
        _map_panel(canvas, solution, board, *places[-1], height)
    return canvas.finished()


def draw_legibility(title: str, subtitle: str, seen: Sequence[Legibility]) -> Image:
    """Draws where markers can be read in each camera's picture, (h, w, 3) BGR.

    Each has `PANEL` columns. Lines are every half metre on the markers' plane.
    """
    columns = min(math.ceil(math.sqrt(len(seen))), 4)
    height = max(len(legible.widths_px) for legible in seen)
    step_x, step_y = PANEL + _MARGIN, height + _CAPTION + _MARGIN // 2
    rows = math.ceil(len(seen) / columns)
    canvas = Canvas(_MARGIN + columns * step_x, _HEAD + rows * step_y + 10)
    canvas.text(title, _MARGIN, 50, INK, 1.0)
    canvas.text(subtitle, _MARGIN, 80, MUTED, 0.52)
    legend = "red: hardly any is read; yellow: not in every picture; grey: no markers"
    canvas.text(f"{legend}; lines: every 0.5 m", _MARGIN, 104, MUTED, 0.46)
    for k, legible in enumerate(seen):
        x, y = _MARGIN + (k % columns) * step_x, _HEAD + (k // columns) * step_y
        picture = _legibility_picture(legible)
        canvas.paste(picture, x, y, PANEL, len(picture))
        canvas.lines(_frame(x, y, len(picture)), MUTED, 1.0, closed=True)
        unread, seldom = (f"{100.0 * share:.0f} %" for share in legible.shares)
        text = (
            f"{legible.cell.family}: hardly any read in {unread}, not in every picture in {seldom}"
        )
        _caption(canvas, x, y + len(picture), legible.camera.id, text)
    return canvas.finished()


def _legibility_picture(legible: Legibility) -> Image:
    picture = np.full((*legible.widths_px.shape, 3), 255, np.uint8)
    picture[~legible.can_be] = GRID
    picture[legible.seldom], picture[legible.unread] = _SELDOM, _UNREAD
    squares = np.floor(legible.places_m / _SQUARE_M)
    for axis in (0, 1):
        steps = np.abs(np.diff(squares, axis=axis)).max(axis=2)
        line = np.insert(steps > 0.0, 0, False, axis=axis)
        picture[line] = (_LINE * picture[line]).astype(np.uint8)
    return picture


def _usual_longest_px(solution: Solution) -> float:
    sizes = [np.linalg.norm(view.residuals, axis=1) for view in solution.views if view.used]
    return max(float(np.percentile(np.concatenate(sizes), 95.0)), 1e-3)


def _camera_panel(
    canvas: Canvas, camera: Camera, views: Sequence[ViewResult], x: int, y: int, longest: float
) -> None:
    zoom = PANEL / camera.width_px
    height = round(camera.height_px * zoom)
    pixels = np.concatenate([view.pixels for view in views]) if views else np.zeros((0, 2))
    off = np.concatenate([view.residuals for view in views]) if views else np.zeros((0, 2))
    canvas.paste(heat(_coverage(camera, pixels)), x, y, PANEL, height)
    enlarged = _ARROW_PX / longest
    order = np.argsort(np.linalg.norm(off, axis=1))
    for start, arrow in zip(pixels[order], off[order]):
        begin = np.array((x, y)) + (start + 0.5) * zoom
        size = max(float(np.linalg.norm(arrow)), 1e-9)
        colour = alarm(size / (1.5 * longest))
        end = begin + arrow * min(enlarged, 3.0 * _ARROW_PX / size)
        canvas.lines(np.array((begin, end)), colour, 1.0)
        canvas.dot(begin, 1.6, colour)
    canvas.lines(_frame(x, y, height), MUTED, 1.0, closed=True)
    text = f"{rms(off):.3f} px rms, {len(off)} corners in {len(views)} views"
    _caption(canvas, x, y + height, camera.id, text)
    unit = round_number(longest)
    _scale(canvas, x, y + height, unit * enlarged, f"{unit:g} px")


def _coverage(camera: Camera, pixels: Floats) -> Floats:
    """(rows, columns) how full of corners the parts of a picture are, 0 to 1."""
    cell = camera.width_px / _CELL
    shape = (math.ceil(camera.height_px / cell), _CELL)
    column = np.clip((pixels[:, 0] / cell).astype(int), 0, shape[1] - 1)
    row = np.clip((pixels[:, 1] / cell).astype(int), 0, shape[0] - 1)
    counts = np.zeros(shape)
    np.add.at(counts, (row, column), 1.0)
    # A corner also counts for two cells around it.
    spread = cv2.GaussianBlur(counts, (0, 0), 1.6) * (2.0 * np.pi * 1.6**2)
    return np.asarray(1.0 - np.exp(-spread / _CORNERS_FULL))


def _map_panel(
    canvas: Canvas, solution: Solution, board: Board | None, x: int, y: int, height: int
) -> None:
    """Draws the rig from above: what each camera sees of the floor, and where the board was."""
    outlines = [_footprint(camera) for camera in solution.cameras]
    centres = np.array([camera.position_m[:2] for camera in solution.cameras])
    shapes = [o for o in outlines if len(o)] + [centres, np.zeros((1, 2))]
    corners = [_board_outline(board, *pose) for pose in solution.bodies.values()]
    everything = np.concatenate(shapes + [c for c in corners if board])
    low, high = everything.min(axis=0), everything.max(axis=0)
    zoom = min((PANEL - 40) / (high[0] - low[0] + 1e-6), (height - 40) / (high[1] - low[1] + 1e-6))
    middle = (low + high) / 2.0

    def place(points: Floats) -> Floats:
        shifted = (points - middle) * (zoom, -zoom)
        return np.asarray(shifted + np.array((x + PANEL / 2.0, y + height / 2.0)))

    for outline, tint in zip(outlines, cycle(_TINTS)):
        if len(outline):
            canvas.fill(place(outline), tint, 0.13)
            canvas.lines(place(outline), tint, 1.2, closed=True)
    for moment, corner in zip(solution.bodies, corners):
        if board is None or moment.startswith("point "):
            canvas.dot(place(solution.bodies[moment][1][:2]), 2.5, INK)
        else:
            canvas.lines(place(corner), MUTED, 0.6, closed=True)
    for camera, centre, tint in zip(solution.cameras, place(centres), cycle(_TINTS)):
        canvas.dot(centre, 5.0, tint)
        canvas.text(camera.id, centre[0] + 9, centre[1] + 5, INK, 0.42)
    _axes(canvas, place, zoom)
    canvas.lines(_frame(x, y, height), GRID, 1.0, closed=True)
    text = f"what each camera sees of the floor, {len(solution.bodies)} places of the board"
    _caption(canvas, x, y + height, "the rig from above", text)
    unit = round_number(80.0 / zoom)
    _scale(canvas, x, y + height, unit * zoom, f"{unit:g} m")


def _caption(canvas: Canvas, x: float, foot: float, title: str, text: str) -> None:
    canvas.text(title, x, foot + 26, INK, 0.6)
    canvas.text(text, x, foot + 48, MUTED, 0.48)


def _scale(canvas: Canvas, x: float, foot: float, length: float, label: str) -> None:
    """A bar of a length at the right end of a panel's caption."""
    right = x + PANEL - width_of(label, 0.48)
    canvas.text(label, right, foot + 48, MUTED, 0.48)
    bar = np.array(((right - 10 - length, foot + 43), (right - 10, foot + 43)))
    canvas.lines(bar, INK, 1.5)


def _frame(x: float, y: float, height: float) -> Floats:
    right, bottom = x + PANEL, y + height
    return np.array(((x, y), (right, y), (right, bottom), (x, bottom)))


def _axes(canvas: Canvas, place: Callable[[Floats], Floats], zoom: float) -> None:
    length = 36.0 / zoom
    for direction, name in (((1.0, 0.0), "x"), ((0.0, 1.0), "y")):
        tip = np.array(direction) * length
        ends = place(np.array(((0.0, 0.0), tip)))
        canvas.lines(ends, INK, 2.0)
        canvas.text(name, ends[1, 0] + 4, ends[1, 1] - 4, INK, 0.45)


def _footprint(camera: Camera) -> Floats:
    """(n, 2) outline of what a camera sees of the floor; empty if it sees the horizon."""
    width, height = camera.width_px - 1.0, camera.height_px - 1.0
    corners = np.array(((0.0, 0.0), (width, 0.0), (width, height), (0.0, height)))
    along = np.linspace(0.0, 1.0, _EDGE_POINTS, endpoint=False)[:, np.newaxis]
    edge = np.concatenate(
        [a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
    )
    floor = camera.to_plane(edge, 0.0)
    back = camera.project(np.column_stack((floor, np.zeros(len(floor)))))
    far = np.linalg.norm(floor - camera.position_m[:2], axis=1) > 4.0 * abs(camera.position_m[2])
    return floor if np.allclose(back, edge, atol=1.0) and not far.any() else np.zeros((0, 2))


def _board_outline(board: Board | None, turn: Floats, shift: Floats) -> Floats:
    across, up = board.size_m if board else (0.0, 0.0)
    corners = np.array(((0.0, 0.0), (across, 0.0), (across, up), (0.0, up)))
    return np.asarray(corners @ turn[:2, :2].T + shift[:2])


_LENS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")


def as_json(solution: Solution, board: Board | None, check: BoardCheck | None) -> dict[str, Any]:
    """Returns the report as one JSON object.

    Lengths are in m unless the key says mm, pixels in px.
    """
    report: dict[str, Any] = {
        "board": str(board) if board else None,
        "rms_px": round(solution.rms_px, 4),
        "cameras": {camera.id: _camera(solution, camera) for camera in solution.cameras},
        "views": [_view(view) for view in solution.views],
        "notes": list(solution.notes),
    }
    if check is not None:
        report["board_check"] = {name: round(v, 4) for name, v in asdict(check).items()}
    if solution.bodies:
        report["moments"] = {
            moment: {
                "rotation": [round(float(v), 9) for v in turn.ravel()],
                "position_m": [round(float(v), 6) for v in shift],
            }
            for moment, (turn, shift) in solution.bodies.items()
        }
    return report


def _camera(solution: Solution, camera: Camera) -> dict[str, Any]:
    views = solution.of(camera.id)
    lens = dict(zip(_LENS, (round(float(v), 6) for v in lens_of(camera))))
    sigma = dict(zip(_LENS, (round(float(v), 6) for v in solution.lens_sigma[camera.id])))
    floor = solution.floor_sigma_m.get(camera.id, float("nan"))
    return {
        "rms_px": round(_rms(views), 4),
        "views": len(views),
        "rejected": sum(view.camera == camera.id for view in solution.rejected),
        "corners": sum(len(view.pixels) for view in views),
        "lens": lens,
        "lens_sigma": sigma,
        "floor_sigma_mm": round(1e3 * floor, 4) if np.isfinite(floor) else None,
    }


def _view(view: ViewResult) -> dict[str, Any]:
    error = view.rms_px
    return {
        "camera": view.camera,
        "moment": view.moment,
        "corners": len(view.pixels),
        "rms_px": round(error, 4) if np.isfinite(error) else None,
        "used": view.used,
    }


def as_text(solution: Solution, check: BoardCheck | None) -> list[str]:
    """Returns the report as lines: a table of the cameras, what was left out, and notes."""
    rows: list[tuple[str, ...]] = [
        ("camera", "rms px", "views", "corners", "fx px", "cx px", "cy px", "floor")
    ]
    for camera in solution.cameras:
        views, sigma = solution.of(camera.id), solution.lens_sigma[camera.id]
        floor = solution.floor_sigma_m.get(camera.id, float("nan"))
        numbers = zip((camera.fx_px, camera.cx_px, camera.cy_px), sigma[[0, 2, 3]])
        rows.append(
            (
                camera.id,
                f"{_rms(views):.3f}",
                str(len(views)),
                str(sum(len(view.pixels) for view in views)),
                *(f"{value:.1f}" + (f" ±{s:.1f}" if s > 0.0 else "") for value, s in numbers),
                f"±{1e3 * floor:.2f} mm" if np.isfinite(floor) else "-",
            )
        )
    lines = aligned(rows, left=1)
    lines.append(f"all together {solution.rms_px:.3f} px rms")
    if check is not None:
        lines.append(
            f"the board as several cameras see it: distances wrong by {check.median_mm:.2f} mm "
            f"(median), {check.sd_mm:.2f} mm (sd), {check.reprojection_px:.3f} px rms"
        )
    lines += [
        f"left out: {view.camera} {view.moment}, {view.rms_px:.2f} px: board bent, moved or misread"
        for view in solution.rejected
    ]
    return lines + [f"note: {note}" for note in solution.notes]


def _rms(views: Sequence[ViewResult]) -> float:
    return rms(np.concatenate([view.residuals for view in views])) if views else 0.0
