"""The runs of `vsense track`: what Record switches, and what a disk that fails costs."""

from __future__ import annotations

import io
import threading
from pathlib import Path
from typing import cast

import numpy as np

from vsense.arena import Frame
from vsense.cameras.camera import Camera
from vsense.live.runs import RunPictures, Runs
from vsense.message_bus import MessageBus
from vsense.recording.pictures import BackgroundRecorder, PictureRecorder
from vsense.run.control import Control
from vsense.run.orders import Order, OrderKind
from vsense.terminal import Console
from vsense.tracking.camera_tracking import CameraTracking
from vsense.ui.recorders import Recorders

FRAME = Frame("top", np.zeros((2, 2), np.uint8), 0, 0, 0)
CAMERA = Camera.looking_down("top", 0.0, 0.0, 2.0, 100.0, (2, 2))


class Tracking:
    """Stands in for cameras."""

    def figures(self) -> dict[str, int]:
        return {}


TRACKING = cast(CameraTracking, Tracking())


class Desk:
    """Runs that are begun and ended by hand; `record`: as with --record."""

    def __init__(self, folder: Path, record: bool, stays: bool = True) -> None:
        self.folder, self.said = folder, io.StringIO()
        console = Console(self.said)
        self.pictures = RunPictures(self._begin, True, console.say)
        self.control = Control(lambda wanted: None, console.say)
        tell = (console.say, console.say)
        self.runs = Runs(
            "lab",
            self.control,
            Recorders(MessageBus(), record, False, *tell),
            self.pictures,
            console,
            threading.Event(),
            stays=stays,
            folders=True,
        )
        self.begun = 0
        if record:
            self.runs.keep_in(folder / "out")

    def _begin(self) -> BackgroundRecorder:
        self.begun += 1
        place = self.folder / "recordings" / str(self.begun)
        return BackgroundRecorder(PictureRecorder(place, [CAMERA]))

    def begin(self) -> None:
        assert self.control.begin(lambda: None)
        self.runs.begin(TRACKING)

    def end(self) -> None:
        self.control.end("stopped")
        self.runs.end(TRACKING)
        self.runs.next_run()

    def record(self, on: bool) -> str:
        return self.runs.give(Order(OrderKind.RECORD, "me", float(on)))

    def see(self) -> None:
        self.pictures.timestep(True, [FRAME])


def test_record_switches_all_that_was_recorded_from_the_beginning(tmp_path: Path) -> None:
    """A file that wants pictures and --record: Record could not be switched on again."""
    desk = Desk(tmp_path, record=True)
    desk.begin()
    file = str(tmp_path / "out" / "run-1" / "lab.mcap")
    desk.see()
    off = desk.record(False)
    assert off == f"pictures are not kept any more; recording is off: {file}"
    assert not desk.runs.recording()["on"] and not desk.pictures.state()["on"]
    desk.see()
    assert desk.record(True) == f"pictures are kept; recording goes on in {file}"
    desk.see()
    made = desk.runs.recording()
    assert (made["on"], made["file"]) == (True, file) and desk.pictures.state()["on"]
    desk.end()
    assert "recordings/1, 2 pictures" in desk.said.getvalue()


def test_without_record_it_switches_pictures_only(tmp_path: Path) -> None:
    desk = Desk(tmp_path, record=False)
    desk.begin()
    assert desk.record(False) == "pictures are not kept any more"
    assert desk.record(True) == "pictures are kept" and desk.runs.recording()["on"]
    desk.end()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recordings"]
