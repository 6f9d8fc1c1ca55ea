"""The virtual world over the cameras' pictures: where OpenCV projects it, and only while wanted."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
import pytest

from tests.monitor.ui.conftest import Open, Serve
from tests.monitor.ui.puppet_world import floor_png
from vsense.vision.cameras.camera import Camera

RANDOM = np.random.default_rng(4)
CONE = [245, 140, 60]


def cameras(count: int) -> list[Camera]:
    """Cameras that look down askew, with strong lenses."""
    found = []
    for _ in range(count):
        turn = cv2.Rodrigues(np.array([np.pi, 0.0, 0.0]) + RANDOM.normal(0.0, 0.15, 3))[0]
        lens = (
            RANDOM.uniform(-0.35, 0.1),
            RANDOM.uniform(-0.05, 0.12),
            *RANDOM.normal(0.0, 2e-3, 2),
            RANDOM.uniform(-0.02, 0.02),
        )
        place = (*RANDOM.normal(0.0, 0.2, 2), 2.3)
        made = Camera("c", 1280, 960, 880.0, 910.0, 652.0, 471.0, lens, tuple(turn.ravel()), place)
        found.append(made)
    return found


def by_opencv(camera: Camera, points: np.ndarray) -> np.ndarray:
    turn = np.reshape(camera.rotation, (3, 3))
    middle = (camera.fx_px, 0, camera.cx_px), (0, camera.fy_px, camera.cy_px), (0, 0, 1)
    move = -turn @ np.array(camera.position_m)
    lens = np.array(camera.distortion)
    return cv2.projectPoints(points, cv2.Rodrigues(turn)[0], move, np.array(middle, float), lens)[
        0
    ][:, 0]


def test_the_page_projects_as_opencv_does(served: Serve, opened: Open) -> None:
    _, _, url = served(paced=False)
    page = opened(url, "window.vsense")
    for camera in cameras(6):
        points = RANDOM.uniform([-1.0, -0.8, 0.0], [1.0, 0.8, 0.3], (40, 3))
        wanted = by_opencv(camera, points)
        behind = [[*camera.position_m[:2], camera.position_m[2] + 1.0], [0.0, 0.0, 50.0]]
        told: dict[str, Any] = page.value(
            "(async () => { const { Lens } = await import('/lens.js');"
            f" const lens = new Lens({camera.to_json()});"
            f" const points = {json.dumps(points.tolist())};"
            " return { spots: points.map((point) => lens.spot(point)), radius: lens.radius,"
            f" behind: {json.dumps(behind)}.map((point) => lens.spot(point)),"
            " floors: points.map(([x, y]) => { const at = lens.spot([x, y, 0]);"
            " return at && lens.floor(at[0], at[1]); }),"
            " line: lens.line([[-0.9, 0.5, 0], [0.9, 0.5, 0]]),"
            " all: lens.area([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]) }; })()"
        )
        shown = [(s, w) for s, w in zip(told["spots"], wanted) if s is not None]
        assert len(shown) > 30
        assert np.abs(np.array([s[:2] for s, _ in shown]) - [w for _, w in shown]).max() < 1e-6
        floors = [(f, p[:2]) for f, p in zip(told["floors"], points) if f is not None]
        assert np.abs(np.array([f for f, _ in floors]) - [p for _, p in floors]).max() < 1e-6
        assert told["behind"] == [None, None]
        assert told["radius"] == pytest.approx(camera.window_radius(), abs=0.011)
        straight = np.linspace([-0.9, 0.5, 0.0], [0.9, 0.5, 0.0], 2000)
        curve = by_opencv(camera, straight)
        (piece,) = told["line"]
        far = [np.hypot(*(curve - point).T).min() for point in np.array(piece)]
        steps = np.hypot(*np.diff(piece, axis=0).T)
        assert max(far) < 0.7, "every point of it lies on the bent line"
        assert steps.max() < 13.0, "and they are near to each other"
        reach = np.abs(np.array(told["all"]) - (640, 480)).max()
        assert len(told["all"]) > 40 and reach < 2000, "what is all around ends with the lens"


def test_a_lens_that_folds_back_shows_nothing_beyond() -> None:
    folding = Camera.looking_down("c", 0.0, 0.0, 1.0, 500.0, (2000, 2000), (-0.4, 0, 0, 0, 0))
    # r (1 - 0.4 r^2) rises up to r = sqrt(1 / 1.2).
    assert folding.window_radius() == pytest.approx((1.0 / 1.2) ** 0.5, abs=0.01)


def test_one_key_and_one_button_switch_it(served: Serve, opened: Open) -> None:
    _, _, url = served()
    page = opened(url)
    page.until("vsense.store.pictures.size === 4 && vsense.store.signals")
    cell = "vsense.cameras.cells.get('cam0')"
    page.until(f"Boolean({cell}.bitmap)")
    orange = (
        f"(() => {{ const {{ canvas, pen }} = {cell};"
        " const { data } = pen.getImageData(0, 0, canvas.width, canvas.height); let count = 0;"
        " for (let at = 0; at < data.length; at += 4) {"
        f" if (Math.abs(data[at] - {CONE[0]}) < 25 && Math.abs(data[at + 2] - {CONE[2]}) < 40)"
        " count += 1; } return count; })()"
    )
    page.until(f"{orange} > 20")
    page.key("v")
    page.until(f"!vsense.cameras.overlay && {orange} < 10")
    assert page.value("document.querySelector('#overlay').ariaPressed") == "false"
    page.click("#overlay")
    page.until(f"vsense.cameras.overlay && {orange} > 20")
    page.key("?")
    assert "virtual world over the cameras" in page.text("#keys_list")


def test_all_cameras_show_a_painted_floor_and_paint_it_once(served: Serve, opened: Open) -> None:
    _, _, url = served(paced=False)
    page = opened(url, "window.vsense")
    camera = Camera.looking_down("c", 0.0, 0.0, 2.0, 220.0, (320, 240), (0.0,) * 5)
    floor = {"color": [255] * 3, "size_m": [3, 2.4], "centre_m": [0, 0], "png": floor_png()}
    told: dict[str, Any] = page.value(
        "(async () => { const { Lens } = await import('/lens.js');"
        " const { Ground } = await import('/ground.js');"
        f" const lens = new Lens({camera.to_json()}), floor = {json.dumps(floor)};"
        " let ready = 0, painted = 0;"
        # A replay that stands still draws again only when it is called.
        " const grounds = [0, 1, 2].map(() => new Ground(lens, () => { ready += 1; }));"
        " grounds.forEach((ground) => ground.floor({ ...floor }));"
        " const late = performance.now() + 20000;"
        " while (ready < 3 && performance.now() < late)"
        "   await new Promise((on) => setTimeout(on, 5));"
        " const [first] = grounds; const canvas = first.floor({ ...floor });"
        " const put = first.floorRaster.pen.putImageData;"
        " first.floorRaster.pen.putImageData = function (...all) { painted += 1;"
        " put.apply(this, all); };"
        " first.floor({ ...floor }); const same = painted;"
        " first.floor({ ...floor, centre_m: [0.5, 0] });"
        " const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);"
        " return { ready, same, moved: painted, some: data.some((part) => part) }; })()"
    )
    assert told == {"ready": 3, "same": 0, "moved": 1, "some": True}
