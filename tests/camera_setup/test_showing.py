"""`vsense cameras show` that is interrupted before there is anything to show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.camera_setup.stage import Scripted
from vsense.camera_setup import showing
from vsense.camera_setup.opening import OpenCamera
from vsense.cameras.opencv_source import Controls
from vsense.terminal import Interruption
from vsense.tracking.specs import CAMERA, GrabberSpec


def test_ctrl_c_while_the_camera_opens_starts_no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    scripted, interrupted = Scripted(), Interruption()

    @contextmanager
    def interruption() -> Iterator[Interruption]:
        yield interrupted

    scripted.after_read = lambda reads: interrupted.set()
    spec = GrabberSpec("cam", CAMERA, "/dev/video0", None, None, 0.0, None, 0)
    monkeypatch.setattr(showing, "interruption", interruption)
    monkeypatch.setattr(showing, "choose", lambda id, wanted, resources: spec)
    monkeypatch.setattr(showing, "make", lambda spec: OpenCamera("cam", scripted, None))
    monkeypatch.delattr(showing, "TrackRoom")
    assert showing.run("cam", Controls(), None, "arrow4x4", None, None) == 130
    assert scripted.reads == 1 and not scripted.opened
