"""What the host keeps of a run's pictures."""

from __future__ import annotations

import cv2
import numpy as np

from vsense.base.arena import Frame
from vsense.monitor.pictures.run_figure import RunCameras
from vsense.vision.cameras.camera import Camera


def test_pictures_of_runs_that_others_follow_take_little() -> None:
    size = (800, 600)
    names = ("left", "right")
    cameras = [Camera.looking_down(name, 0.0, 0.0, 2.0, 500.0, size) for name in names]
    seen = RunCameras(cameras, 0.06, 9)
    noise = np.random.default_rng(1).integers(0, 12, (600, 800), dtype=np.uint8)
    image = cv2.circle(noise + np.uint8(80), (300, 200), 50, 230, -1)
    frames = [Frame(name, image, 7, 0, 0) for name in (*names, "another's")]
    seen.keep(7, frames)
    image[:] = 0  # as the camera's next picture
    seen.pack()
    seen.keep(9, frames[:1])
    assert [*seen.pictures] == [9]
    assert sum(coded.nbytes for coded in seen._packed[7].values()) < 0.5 * 2 * image.nbytes
    seen.unpack()
    shown = seen.pictures
    assert {*shown} == {7, 9} and {*shown[7]} == {"left", "right"} and {*shown[9]} == {"left"}
    assert shown[7]["left"].shape == (600, 800)
    assert abs(int(shown[7]["left"][200, 300]) - 230) < 10 and shown[7]["left"][500, 700] < 110
    assert not shown[9]["left"].any()


def test_of_each_view_the_newest_pictures_are_kept_in_the_memory_of_the_former() -> None:
    seen = RunCameras([Camera.looking_down("it", 0.0, 0.0, 2.0, 500.0, (80, 60))], 0.06, 9)

    def keep(timestep: int, side: int = 60) -> np.ndarray:
        seen.keep(timestep, [Frame("it", np.full((side, 80), timestep, np.uint8), timestep, 0, 0)])
        return seen.pictures[timestep]["it"]

    first, second = keep(3), keep(8)
    assert second is first and [*seen.pictures] == [8] and (second == 8).all()
    keep(9), keep(20)
    assert [*seen.pictures] == [8, 20] and (first == 8).all()
    assert (keep(21, side=30) == 21).all()  # a camera that gives others now
    seen.keep(22, [])
    assert [*seen.pictures] == [8, 21]
