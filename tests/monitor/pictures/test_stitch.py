"""The top view puts everything at its place, evenly lit, with seams that nobody notices."""

from __future__ import annotations

import numpy as np
import pytest

from vsense.base.arena import Frame
from vsense.modes.lab._camera_spec import rig
from vsense.modes.lab._optics import RayMap, vignetting
from vsense.monitor.pictures._stitch import TopView
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena

ARENA = Arena((3.0, 2.4, 1.0), (0.2, -0.1, 0.5))
CAMERAS = rig(ARENA)


def frames(paint) -> list[Frame]:
    """Pictures of a floor that `paint` gives the grey of, from arena x and y."""
    found = []
    for camera in CAMERAS:
        rays = RayMap(camera)
        grey = paint(rays.x_m, rays.y_m) * vignetting(camera)
        found.append(Frame(camera.id, np.rint(grey).astype(np.uint8), 0, 0, 0))
    return found


def top_view(pictures: list[Frame], arena: Arena, px_per_m: float) -> np.ndarray:
    """As the lab's report draws it."""
    view = TopView(CAMERAS, arena, px_per_m, shade=vignetting)
    return view.draw({frame.camera: frame.image for frame in pictures})


def test_a_smooth_floor_comes_out_as_it_is() -> None:
    def paint(x, y):
        return 120.0 + 25.0 * x - 20.0 * y

    view = top_view(frames(paint), ARENA, 100)
    assert view.shape == (240, 300)
    x = 0.2 + (np.arange(300) - 149.5) / 100
    y = -0.1 - (np.arange(240) - 119.5) / 100
    error = view - paint(*np.meshgrid(x, y))
    assert np.abs(error).max() < 2.5


@pytest.mark.parametrize("place", [(0.2, -0.1), (0.9, 0.7), (0.2, 0.5), (-1.2, -1.2)])
def test_a_spot_is_where_it_is_also_on_a_seam(place: tuple[float, float]) -> None:
    def paint(x, y):
        return 60.0 + 150.0 * (np.hypot(x - place[0], y - place[1]) < 0.03)

    view = top_view(frames(paint), ARENA, 200).astype(float)
    rows, columns = np.nonzero(view > 110)
    x = 0.2 + (columns.mean() - 299.5) / 200
    y = -0.1 - (rows.mean() - 239.5) / 200
    assert np.hypot(x - place[0], y - place[1]) < 0.0015
    assert len(rows) == pytest.approx(np.pi * 6**2, rel=0.15)


def test_what_no_camera_sees_is_black() -> None:
    wide = Arena((9.0, 9.0, 1.0), (0.2, -0.1, 0.5))
    view = top_view(frames(lambda x, y: 100.0 + 0 * x), wide, 20)
    assert view[0, 0] == 0 and view[90, 90] == 100


def test_what_lies_behind_a_camera_is_black() -> None:
    """Through its centre the projection mirrors it into the picture."""
    tilt = np.deg2rad(70.0)
    forward = (np.sin(tilt), 0.0, -np.cos(tilt))
    down = (-np.cos(tilt), 0.0, -np.sin(tilt))
    turn = (0.0, -1.0, 0.0, *down, *forward)
    camera = Camera("c", 320, 240, 150.0, 150.0, 159.5, 119.5, (0.0,) * 5, turn, (0.0, 0.0, 1.0))
    view = TopView([camera], Arena((20.0, 8.0, 1.0), (0.0, 0.0, 0.5)), 10)
    drawn = view.draw({"c": np.full((240, 320), 100, np.uint8)})
    x = (np.arange(200) - 99.5) / 10
    # Its lower border lies atan(120 / 150) = 38.7 degrees below its middle: 31.3 from the plumb.
    assert drawn[40, x < np.tan(np.deg2rad(31.3)) - 0.1].max() == 0
    assert drawn[40, x > np.tan(np.deg2rad(31.3)) + 0.1].min() == 100


def test_what_lies_beyond_where_a_lens_folds_back_is_black() -> None:
    lens = (-0.3, 0.0, 0.0, 0.0, 0.0)
    camera = Camera.looking_down("c", 0.0, 0.0, 1.0, 300.0, (320, 240), lens)
    drawn = TopView([camera], Arena((8.0, 8.0, 1.0), (0.0, 0.0, 0.5)), 25).draw(
        {"c": np.full((240, 320), 100, np.uint8)}
    )
    corner = camera.to_plane(np.array([-0.5, -0.5]), 0.0)
    places = (np.arange(200) - 99.5) / 25
    far = np.hypot(*np.meshgrid(places, places))
    assert np.hypot(*corner) < (3 * 0.3) ** -0.5 - 0.1, "the picture ends before it folds back"
    assert drawn[far > np.hypot(*corner) + 0.1].max() == 0 and drawn[far < 0.3].min() == 100
