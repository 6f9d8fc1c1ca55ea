"""`vsense camera show`: interrupted before it shows anything, and small markers told."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from tests.tools.camera_setup.stage import Scripted
from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.base.interruption import Interruption
from vsense.tools.camera_setup import showing
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.source import Controls, Shot
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.single_camera import OpenCamera
from vsense.vision.tracking.specs import CAMERA, GrabberSpec


def test_ctrl_c_while_the_camera_opens_starts_no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    scripted, interrupted = Scripted(), Interruption()

    @contextmanager
    def interruption() -> Iterator[Interruption]:
        yield interrupted

    scripted.after_read = lambda reads: interrupted.set()
    spec = GrabberSpec("cam", CAMERA, "/dev/video0", None, None, 0.0, None, 0)
    monkeypatch.setattr(showing, "interruption", interruption)
    monkeypatch.setattr(showing, "choose", lambda id, wanted, resources: spec)
    monkeypatch.setattr(showing, "make", lambda spec, clock: OpenCamera("cam", scripted, None))
    monkeypatch.delattr(showing, "TrackRoom")
    assert showing.run(showing.ShowOptions("cam", Controls(), None, "arrow4x4", None, None)) == 130
    assert scripted.reads == 1 and not scripted.opened


def test_small_cells_are_said_when_the_markers_have_told_the_scale(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = Camera.looking_down("c", 0.0, 0.0, 2.06, 660.0, (640, 480))
    places = [(-0.3, 0.1), (0.0, 0.1), (0.3, -0.1), (0.0, -0.15)]
    robots = [Robot(tag, x, y, 0.4) for tag, (x, y) in zip((31, 700, 1843, 18425), places)]
    image = render(camera, load_family("arrow4x4"), robots, Look(noise=1.0, litter=0), 1)
    scripted = Scripted()
    monkeypatch.setattr(scripted, "read", lambda: Shot(image, None, 0))
    spec = GrabberSpec("cam", CAMERA, "/dev/video0", None, None, 0.0, None, 0)
    monkeypatch.setattr(showing, "choose", lambda id, wanted, resources: spec)
    monkeypatch.setattr(showing, "make", lambda spec, clock: OpenCamera("cam", scripted, None))
    monkeypatch.setattr(showing, "TrackRoom", lambda *of: SimpleNamespace(open=lambda: None))
    monkeypatch.setattr(showing.ShowSession, "run", lambda self, interrupted: None)
    assert showing.run(showing.ShowOptions("cam", Controls(), None, "arrow4x4", None, None)) == 0
    said = capsys.readouterr().err
    assert re.search(r"cam: the cells of arrow4x4, 5.3 mm, are 1\.[6-9] px wide: expected", said)
