"""What the host keeps of a run's pictures."""

from __future__ import annotations

import numpy as np

from vsense.base.arena import Frame
from vsense.monitor.pictures.run_figure import RunCameras
from vsense.vision.cameras.camera import Camera


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
