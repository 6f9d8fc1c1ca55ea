"""Figures that pages give are those that vsense computes, and their examples work."""

from __future__ import annotations

import re

import numpy as np
import pytest

from scripts.site.contents import ROOT
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.marker_detector import cell_width
from vsense.world.robot_models import EPUCK

DAY = (ROOT / "vsense" / "modes" / "live" / "LAB.md").read_text()
COLUMNS = ("arrow4x4", "apriltag_36h11", "aruco_4x4_50")


def widest_m(family: str, picture_px: int) -> float:
    """How much floor a picture may show across if all markers of a family are to be named."""
    return (
        picture_px
        / (1000.0 * cell_width(load_family(family), 1000.0).good_px)
        * (cell_width(load_family(family), 1000.0).cell_mm)
    )


def test_how_much_floor_a_camera_covers() -> None:
    rows = re.findall(r"^\| (\d+) px \|(.*)\|$", DAY, re.MULTILINE)
    assert len(rows) == 5
    for width, cells in rows:
        told = [float(cell) for cell in cells.split("|")]
        disc_px_per_m = 48 / 0.07
        expected = [widest_m(family, int(width)) for family in COLUMNS]
        assert told == pytest.approx([*expected, int(width) / disc_px_per_m], abs=0.06)
    thesis = cell_width(load_family("arrow4x4-thesis"), 1000.0)
    assert thesis.px / thesis.good_px == pytest.approx(5.3 / 2.0), "it shares a column"


def test_heights_above_the_floor() -> None:
    for angle_deg, text in ((60, "0.87 *w*"), (75, "0.65 *w*"), (90, "0.5 *w*")):
        share = 0.5 / np.tan(np.radians(angle_deg / 2))
        assert round(share, 2) == float(text.split()[0])
        assert re.search(rf"{angle_deg} degrees(?: across hangs)?\s+{re.escape(text)}", DAY), text


def test_blur_at_full_speed() -> None:
    speed_mm_s = 1000 * EPUCK.max_steps_s * EPUCK.step_m
    assert round(speed_mm_s / 1000, 3) == 0.129
    assert [round(speed_mm_s * s, 1) for s in (0.01, 0.02)] == [1.3, 2.6]
    assert load_family("arrow4x4").cell_mm / 2 == 2.65


def test_how_often_loss_stops_a_robot() -> None:
    """Eight packets in a row of 20 per second, lost at random."""
    hours = [1 / (p**8 * 20) / 3600 for p in (0.1, 0.2)]
    assert hours[0] > 2 * 30 * 24 * 0.9 and hours[1] == pytest.approx(5.5, abs=0.2)
