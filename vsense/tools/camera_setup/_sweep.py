"""`vsense camera tune --sweep`: tries exposures and gains, and reports the best."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vsense.base.errors import GrabberError, VsenseError
from vsense.base.terminal import Console, LiveBlock, aligned, print_data
from vsense.tools.camera_setup import _panel
from vsense.tools.camera_setup._advice import (
    GOOD_BLUR_CELLS,
    GOOD_LIGHT,
    LEAST_LIGHT,
    MOST_BLUR_CELLS,
    MOST_NOISE,
    MOST_SATURATED,
    advise,
    rounded,
)
from vsense.tools.camera_setup._panel import PanelView, Tuner
from vsense.vision.cameras.source import EXPOSURE, GAIN, Bounds
from vsense.vision.tracking.single_camera import CameraControls

SHORTEST_US = 200.0
"""With shorter exposures a robot moves by less than a twentieth of a pixel."""
GAIN_STEPS = 4
"""Number of gains to try, from the least to the greatest."""
SETTLING = 4
"""Pictures to skip after a change, which may still have the earlier values."""
PERIOD_SHARE = 0.9
"""Longest exposure that does not slow a camera down, as a share of its period."""

SWEEP_HEAD = ("exposure", "gain", "mean", "lightest 1 %", "saturated", "noise", "blur", "markers")


def worth(view: PanelView) -> tuple[int, int, float]:
    """Sort key of rows: markers read, good properties, a clear picture.

    Robots at rest look sharp with any exposure, so light, noise and blur count with the limits of
    `vsense.tools.camera_setup._advice`.
    """
    reading, light = view.reading, view.reading.light
    noise = (reading.noise or 0.0) / MOST_NOISE
    blur = 0.0
    if reading.exposure_us is not None and reading.speed_m_s > 0.0:
        moved_m = 1e-6 * reading.exposure_us * reading.speed_m_s
        blur = moved_m / (MOST_BLUR_CELLS * reading.cell_m)
    good = (
        light.light >= LEAST_LIGHT,
        light.saturated <= MOST_SATURATED,
        noise <= 1.0,
        blur <= 1.0,
    )
    dim = max(GOOD_LIGHT - light.light, 0.0) / GOOD_LIGHT
    # Less blur than this has no benefit, but needs more gain.
    smear = max(blur - GOOD_BLUR_CELLS / MOST_BLUR_CELLS, 0.0)
    return len(view.markers.tags), sum(good), -(noise + smear + dim)


def run(tuner: Tuner, interrupted: threading.Event, as_json: bool) -> bool:
    """Tries exposures and gains, prints a row for each, and restores the camera's own values.

    Returns:
        Whether the camera has its own values again.

    Raises:
        VsenseError: The camera has no such controls, is gone, or refuses; nothing is concluded.
    """
    camera = tuner.camera
    controls = camera.controls
    if controls is None or controls.value(EXPOSURE) is None:
        raise VsenseError(f"{camera.id}: does not report its exposure: there is nothing to try")
    own = {name: controls.value(name) for name in (EXPOSURE, GAIN)}
    put_back = controls.remember()
    rows: list[PanelView] = []
    block = LiveBlock(sys.stdout)
    live = sys.stdout.isatty() and not as_json
    try:
        for row in tried(tuner, controls, interrupted):
            rows.append(row)
            if live:
                block.draw(table(rows, None))
        if not interrupted.is_set():
            _print(scaled(rows), block, as_json)
    except GrabberError as error:
        raise camera.named(error) from None
    finally:
        # The camera must not keep the values of the last row.
        is_back, end = _put_back(put_back, own)
        Console().say(f"vsense: {camera.id}: {end}")
    return is_back


def _print(rows: Sequence[PanelView], block: LiveBlock, as_json: bool) -> None:
    best = max(rows, key=worth, default=None)
    if as_json:
        print_data(json.dumps(facts(rows, best), indent=2))
    elif rows:
        block.draw([*table(rows, best), *conclusion(best)])


def tried(
    tuner: Tuner, controls: CameraControls, interrupted: threading.Event
) -> Iterator[PanelView]:
    """Measures exposures in turn, with more gain where it is too dark; raises GrabberError."""
    rate_hz = tuner.camera.rate_hz
    period_us = None if rate_hz is None else PERIOD_SHARE * 1e6 / rate_hz
    left = gains(controls.bounds(GAIN))
    for exposure_us in exposures(
        controls.bounds(EXPOSURE), tuner.cell_m, tuner.speed_m_s, period_us
    ):
        for gain in list(left):
            if interrupted.is_set():
                return
            controls.set(EXPOSURE, exposure_us)
            if gain is not None:
                controls.set(GAIN, gain)
            for _ in range(SETTLING):
                tuner.camera.picture()
            first, second = tuner.camera.picture().image.copy(), tuner.camera.picture().image
            row = tuner.view(first, second, None)
            yield row
            if row.reading.light.light >= GOOD_LIGHT:
                # A gain that saturates now would also do so with a longer exposure.
                glares = row.reading.light.saturated > MOST_SATURATED
                left = left[: max(left.index(gain) + (not glares), 1)]
                break


def scaled(rows: Sequence[PanelView]) -> list[PanelView]:
    """Gives all rows the scale of the row with the most markers."""
    measured = [row for row in rows if row.reading.scale is not None]
    if not measured:
        return list(rows)
    scale = max(measured, key=lambda row: len(row.markers.tags)).reading.scale
    return [replace(row, reading=replace(row.reading, scale=scale)) for row in rows]


def exposures(
    bounds: Bounds | None, cell_m: float, speed_m_s: float, longest_us: float | None
) -> list[float]:
    """Returns the exposures to try [us], rising: 1, 2, 5, 10 and so on.

    `bounds` are the camera's, `longest_us` is the limit that the rate sets; None: unknown.
    """
    blurred_us = 1e6 * MOST_BLUR_CELLS * cell_m / max(speed_m_s, 0.01)
    low, high = bounds or (SHORTEST_US, blurred_us)
    high = min(high, blurred_us, longest_us or high)
    low = min(max(low, SHORTEST_US), high)
    steps = [digit * 10.0**power for power in range(7) for digit in (1, 2, 5)]
    within = [step for step in steps if low <= step <= 0.8 * high]
    return [*within, max(rounded(high), 1.0)]


def gains(bounds: Bounds | None) -> Sequence[float | None]:
    """Returns the gains to try, rising; None leaves the camera's own."""
    if bounds is None or bounds[0] >= bounds[1]:
        return [None]
    low, high = bounds
    steps = np.linspace(low, high, GAIN_STEPS)
    is_integer = low.is_integer() and high - low >= GAIN_STEPS - 1
    return sorted({float(round(step)) if is_integer else float(step) for step in steps})


def table(rows: Sequence[PanelView], best: PanelView | None) -> list[str]:
    """Returns a line for each row, the best with a mark."""
    lines = aligned([SWEEP_HEAD, *(_cells(row) for row in rows)], left=0)
    marks = [" ", *("*" if row is best else " " for row in rows)]
    return [f"{mark} {line}" for mark, line in zip(marks, lines)]


def conclusion(best: PanelView | None) -> list[str]:
    """Returns the lines for the resources file."""
    if best is None:
        return []
    reading = best.reading
    attributes = f'exposure_time_abs="{reading.exposure_us:g}"'
    if reading.gain is not None:
        attributes += f' gain_raw="{reading.gain:g}"'
    advice = advise(reading)
    return [
        "",
        f"* is best. For the resources file:  {attributes}",
        *([] if advice.startswith("good") else [f"Even so: {advice}"]),
    ]


def facts(rows: Sequence[PanelView], best: PanelView | None) -> dict[str, Any]:
    """Returns the same as JSON values."""
    return {
        "rows": [_panel.facts(row) for row in rows],
        "best": None if best is None else _panel.facts(best),
    }


def _cells(row: PanelView) -> tuple[str, ...]:
    reading, light, marks = row.reading, row.reading.light, row.markers
    return (
        f"{reading.exposure_us:.0f} us",
        "-" if reading.gain is None else f"{reading.gain:.4g}",
        f"{light.mean:.0f}",
        f"{light.light:.0f}",
        f"{100.0 * light.saturated:.1f} %",
        "-" if reading.noise is None else f"{reading.noise:.1f}",
        "-" if reading.blur_px is None else f"{reading.blur_px:.2f} px",
        f"{marks.count}" if marks.count == len(marks.tags) else f"{len(marks.tags)}/{marks.count}",
    )


def _put_back(put_back: Callable[[], None], own: Mapping[str, float | None]) -> tuple[bool, str]:
    """Restores the camera; returns whether that worked, and a message."""
    try:
        put_back()
    except GrabberError as error:
        return False, f"not put back: {error}"
    values = ", ".join(f"{name} {value:g}" for name, value in own.items() if value is not None)
    return True, f"has its own values again: {values}"
