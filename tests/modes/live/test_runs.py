"""The runs of `vsense camera track`: what Record switches, and what a disk that fails costs."""

from __future__ import annotations

import io
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from vsense.base.arena import Frame
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Console
from vsense.modes.live._runs import RunPictures, Runs, begin_recording
from vsense.modes.live._talk import Talk
from vsense.monitor.recording.pictures import (
    BackgroundRecorder,
    PictureRecorder,
    PictureRecordingError,
    one_tracker,
)
from vsense.monitor.ui.recorders import Recorders
from vsense.run.orders import Order, OrderKind
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.specs import TrackingSession

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
        tell = (console.say, console.say)
        self.runs = Runs(
            "lab",
            Recorders(MessageBus(), record, False, *tell),
            self.pictures,
            console,
            threading.Event(),
            stays=stays,
            folders=True,
        )
        self.control = self.runs.control
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
        return self.control.give(Order(OrderKind.RECORD, "me", float(on)))

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


def test_a_disk_that_is_gone_at_a_later_start_is_told_and_ends_nothing(tmp_path: Path) -> None:
    desk = Desk(tmp_path, record=True)
    desk.begin()
    desk.see()
    desk.end()
    assert desk.runs.failure is None
    for name in ("out", "recordings"):
        (tmp_path / name).rename(tmp_path / f"{name}-taken-away")
        (tmp_path / name).write_text("")
    desk.begin()
    desk.see()
    assert f"cannot make {tmp_path / 'out' / 'run-2'}: Not a directory; " in desk.said.getvalue()
    folder = tmp_path / "recordings" / "2"
    assert f"vsense: {folder}: cannot be written: Not a directory; " in desk.said.getvalue()
    assert "recordings/2: cannot" in desk.runs.recording()["trouble"]
    assert desk.begun == 2, "it is not tried with every picture"
    desk.end()
    for name in ("out", "recordings"):
        (tmp_path / name).unlink()
        (tmp_path / f"{name}-taken-away").rename(tmp_path / name)
    desk.begin()
    made = desk.runs.recording()
    assert made["on"] and made["trouble"] is None and "run-3" in made["file"]
    desk.end()
    assert "cannot make" in str(desk.runs.failure), "the command's exit code tells it"


def test_a_process_of_one_run_does_not_begin_what_cannot_be_kept(tmp_path: Path) -> None:
    (tmp_path / "recordings").write_text("")
    with pytest.raises(PictureRecordingError, match="cannot be written: Not a directory"):
        Desk(tmp_path, record=False, stays=False).begin()


def test_runs_that_begin_in_the_same_second_have_folders_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.strftime", lambda form: "noon")
    record = SimpleNamespace(
        record_image=True,
        change_root_directory_on_start=True,
        root_directory=tmp_path / "recordings",
        image_format="png",
    )
    tracker = one_tracker([CAMERA], "arrow4x4", {31: 0.1})["top"]
    session = SimpleNamespace(
        record=record, views=[SimpleNamespace(camera=CAMERA, tracker=tracker)], mask=None
    )
    talk = Talk(Console(io.StringIO()), lambda: 0, None)
    for _ in range(2):
        made = begin_recording(cast(TrackingSession, session), talk)
        assert made is not None
        made.close()
    found = sorted(path.name for path in record.root_directory.iterdir())
    assert found == ["noon", "noon-2"]
    assert (record.root_directory / "noon-2" / "experiment.xml").exists()
