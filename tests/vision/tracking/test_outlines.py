"""Outlines of families: their shape and what the kernel's tables get of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vsense.vision.markers._dictionary import FamilyError
from vsense.vision.markers.families import BLURS_U, load_family
from vsense.vision.tracking._kernel import Kernel
from vsense.vision.tracking._outlines import (
    edge_sharpness,
    make_outline,
    nearest_blur,
    sample_outline,
    shape_of,
)

ARROW = load_family("arrow4x4")
TAG36 = load_family("apriltag_36h11")
PASSES = ((1.0, 9, 2, 0.5, 0.3),)


def test_an_arrow_has_the_area_and_the_centroid_of_its_parts() -> None:
    shape = shape_of(ARROW)
    assert shape.area_mm2 == pytest.approx(45 * 5.3**2)
    assert shape.centroid_mm == pytest.approx((0.8 * 5.3, 0.0))
    assert shape.length_mm == pytest.approx(np.hypot(9.0, 3.0) * 5.3)
    assert np.hypot(*(shape.rim_mm - ARROW.disc_centre_mm).T) == pytest.approx(35.0)


def test_a_square_is_fitted_about_its_middle_and_must_be_whole() -> None:
    shape = shape_of(replace(TAG36, centre_mm=(2.0, -1.5)))
    assert shape.area_mm2 == pytest.approx(45.0**2)
    assert shape.centroid_mm == pytest.approx((0.0, 0.0)) == shape.origin_mm
    assert np.abs(shape.rim_mm) == pytest.approx(22.5) and len(shape.rim_mm) == 4
    assert shape.unit_mm == pytest.approx(45.0 / 8.0) and len(shape.cells_mm) == 0


@pytest.mark.parametrize("family", [ARROW, TAG36], ids=["arrow", "square"])
def test_samples_lie_on_the_outline_and_look_outwards(family: object) -> None:
    shape = shape_of(family)  # type: ignore[arg-type]
    points, normals = sample_outline(shape)
    assert np.hypot(*normals.T) == pytest.approx(1.0)
    corners = shape.polygon_mm
    sides = np.roll(corners, -1, axis=0) - corners
    outwards = np.stack((sides[:, 1], -sides[:, 0]), axis=1) / np.hypot(*sides.T)[:, np.newaxis]
    off = ((points[:, np.newaxis] - corners) * outwards).sum(axis=2)
    assert off.max(axis=1) == pytest.approx(0.0, abs=1e-9)
    assert (outwards[off.argmax(axis=1)] * normals).sum(axis=1) == pytest.approx(1.0)


def test_the_tables_of_c_are_in_metres_from_the_origin() -> None:
    outline = make_outline(shape_of(ARROW), PASSES, 0.12, 25.0)
    assert outline.unit_m == pytest.approx(0.0053) and outline.cells == 16
    assert outline.stage[0].reach_m == pytest.approx(0.0053)
    rim = np.array([(outline.rim_x_m[k], outline.rim_y_m[k]) for k in range(outline.rims)])
    assert np.hypot(*rim.T) == pytest.approx(0.035)


def test_an_outline_longer_than_the_kernels_tables_is_refused() -> None:
    polygon = tuple((20.0 * x, 20.0 * y) for x, y in ARROW.polygon_u)
    long = replace(ARROW, unit_mm=ARROW.unit_mm / 20.0, polygon_u=polygon)
    with pytest.raises(FamilyError, match=r"0\.4.*8 to 96"):
        Kernel(long)
    # Found by fuzzing: all the samples of such a side would be 56 GB.
    longest = (*ARROW.polygon_u[:3], (3.0, 3e9), ARROW.polygon_u[4])
    with pytest.raises(FamilyError, match=r"0\.4.*8 to 96"):
        Kernel(replace(ARROW, polygon_u=longest, disc_diameter_mm=1e11))


def test_the_blur_is_that_of_edges_as_sharp() -> None:
    sharp = edge_sharpness(BLURS_U)
    assert (np.diff(sharp) < 0.0).all() and sharp[0] < 1.0
    assert nearest_blur(sharp).tolist() == list(range(len(BLURS_U)))
    assert nearest_blur(np.array([1.2, 0.1])).tolist() == [0, len(BLURS_U) - 1]
