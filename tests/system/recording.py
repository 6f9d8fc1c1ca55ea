"""A drawn recording of two robots before one camera, with the two files of a tracking session."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tests.vision.tracking.synthetic import HEIGHT_M, Robot, render
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family

TAGS = (1843, 31)

RESOURCES = """<arena_tracking_system>
  <grabbers><grabber id="pictures" type="directory" path="pictures" frame_rate="20" /></grabbers>
  <trackers>
    <tracker id="robots" family="arrow4x4" robot_height="{height}" tags="31 1843" />
  </trackers>
  <cameras><camera id="top" calibration="top.json" /></cameras>
</arena_tracking_system>
"""
EXPERIMENT = """<arena_tracking>
  <arena_state_tracker server_port="4040">
    <camera_state_tracker grabber="pictures" camera="top" tracker="robots" />
  </arena_state_tracker>
</arena_tracking>
"""


def make_recording(folder: Path, timesteps: int, step_m: float = 0.01) -> Camera:
    """Draws the pictures: robot 31 drives along +x, robot 1843 stands.

    Args:
        folder: where to, exists.
        timesteps: how many pictures, 50 ms apart.
        step_m: how far robot 31 gets from one to the next.
    """
    camera = Camera.looking_down("top", 0.0, 0.0, 2.4, 1600.0, (480, 360), (0.0,) * 5)
    (folder / "top.json").write_text(camera.to_json())
    (folder / "resources.xml").write_text(RESOURCES.format(height=HEIGHT_M))
    (folder / "experiment.xml").write_text(EXPERIMENT)
    (folder / "pictures").mkdir()
    for step in range(timesteps):
        robots = [Robot(31, step_m * step, 0.1, 0.0), Robot(1843, -0.1, -0.1, np.pi / 2)]
        picture = render(camera, load_family("arrow4x4"), robots, seed=step)
        assert cv2.imwrite(str(folder / "pictures" / f"{step:03}.png"), picture)
    return camera
