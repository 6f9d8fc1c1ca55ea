"""What a calibration says of itself: one JSON object, and a few lines for the eye."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vsense.calibration.board import Board
from vsense.calibration.lens import lens_of
from vsense.calibration.precision import BoardCheck
from vsense.calibration.solution import Solution, ViewResult, rms

_LENS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")


def as_json(solution: Solution, board: Board | None, check: BoardCheck | None) -> dict[str, Any]:
    """Returns the report as one JSON object.

    Lengths are in m unless the key says mm, pixels in px.
    """
    report: dict[str, Any] = {
        "board": str(board) if board else None,
        "rms_px": round(solution.rms_px, 4),
        "cameras": {camera.id: _camera(solution, camera.id) for camera in solution.cameras},
        "views": [_view(view) for view in solution.views],
        "notes": list(solution.notes),
    }
    if check is not None:
        report["board_check"] = {
            "corners": check.corners,
            "reprojection_px": round(check.reprojection_px, 4),
            "distances": check.distances,
            "median_mm": round(check.median_mm, 4),
            "sd_mm": round(check.sd_mm, 4),
        }
    if solution.bodies:
        report["moments"] = {
            moment: {
                "rotation": [round(float(v), 9) for v in turn.ravel()],
                "position_m": [round(float(v), 6) for v in shift],
            }
            for moment, (turn, shift) in solution.bodies.items()
        }
    return report


def _camera(solution: Solution, name: str) -> dict[str, Any]:
    camera = next(camera for camera in solution.cameras if camera.id == name)
    views = solution.of(name)
    lens = dict(zip(_LENS, (round(float(v), 6) for v in lens_of(camera))))
    sigma = dict(zip(_LENS, (round(float(v), 6) for v in solution.lens_sigma[name])))
    floor = solution.floor_sigma_m.get(name, float("nan"))
    return {
        "rms_px": round(_rms(views), 4),
        "views": len(views),
        "rejected": sum(view.camera == name for view in solution.rejected),
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
    """Returns the report as lines: a table of the cameras, what was left out, what to know."""
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
    lines = _aligned(rows)
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


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths))
        ).rstrip()
        for row in rows
    ]
