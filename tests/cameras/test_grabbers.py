"""Pictures from memory come timestep by timestep."""

from __future__ import annotations

import numpy as np
import pytest

from vsense.arena import Frame
from vsense.cameras.grabber import Grabber, GrabberError, MemoryGrabber


def frame(camera: str, timestep: int) -> Frame:
    return Frame(camera, np.zeros((2, 2), np.uint8), timestep, timestep, timestep)


def test_frames_come_by_timestep_whatever_their_order() -> None:
    grabber: Grabber = MemoryGrabber([frame("a", 2), frame("a", 1), frame("b", 2)])
    assert [(f.camera, f.timestep) for f in grabber.next(0.0)] == [("a", 1)]
    assert {(f.camera, f.timestep) for f in grabber.next(0.0)} == {("a", 2), ("b", 2)}
    with pytest.raises(GrabberError, match="no more pictures"):
        grabber.next(0.0)


def test_a_closed_grabber_has_no_more_pictures() -> None:
    grabber = MemoryGrabber([frame("a", 1)])
    grabber.close()
    grabber.close()
    with pytest.raises(GrabberError):
        grabber.next(0.0)
