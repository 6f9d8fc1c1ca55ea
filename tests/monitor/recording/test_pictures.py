"""Recordings that we write are recordings that we read."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from vsense.base.arena import Frame
from vsense.monitor.recording.pictures import (
    TIMESTAMPS,
    BackgroundRecorder,
    PictureRecorder,
    PictureRecordingError,
    folder_names,
)
from vsense.vision.cameras._recordings import DirectoryRecording
from vsense.vision.cameras.camera import Camera

CAMERAS = [Camera.looking_down(n, 0.0, 0.0, 2.0, 60.0, (64, 48)) for n in ("left", "../right")]


def frames(timestep: int) -> list[Frame]:
    rng = np.random.default_rng(timestep)
    images = rng.integers(0, 256, (2, 48, 64), dtype=np.uint8)
    at = 1000 + timestep
    return [Frame(c.id, image, timestep, at, at) for c, image in zip(CAMERAS, images)]


@pytest.mark.parametrize("suffix", ["png", "pgm"])
def test_what_was_written_is_read_again(tmp_path: Path, suffix: str) -> None:
    recorder = PictureRecorder(tmp_path / "new" / "place", CAMERAS, suffix)
    for timestep in (0, 7):
        recorder.write(frames(timestep))
    recorder.close()
    assert recorder.written == 4
    for number, camera in enumerate(CAMERAS):
        name = folder_names(CAMERAS)[camera.id]
        folder = tmp_path / "new" / "place" / "pictures" / name
        recording = DirectoryRecording(folder, folder / TIMESTAMPS)
        assert [(t.timestep, t.capture_ns) for t in recording.taken] == [(0, 1000), (7, 1007)]
        assert np.array_equal(recording.read(1), frames(7)[number].image)
        text = (tmp_path / "new" / "place" / "cameras" / f"{name}.json").read_text()
        assert Camera.from_json(text) == camera


def test_ids_that_are_no_names_stay_inside_the_folder() -> None:
    assert folder_names(CAMERAS) == {"left": "left", "../right": "camera-1"}


def test_a_recording_is_never_written_over(tmp_path: Path) -> None:
    PictureRecorder(tmp_path, CAMERAS).close()
    with pytest.raises(PictureRecordingError, match="holds a recording already"):
        PictureRecorder(tmp_path, CAMERAS)
    (tmp_path / "file").touch()
    with pytest.raises(PictureRecordingError, match="cannot be written: Not a directory"):
        PictureRecorder(tmp_path / "file", CAMERAS)


def test_in_the_background_what_the_disk_cannot_take_is_left_out_and_counted(
    tmp_path: Path,
) -> None:
    recorder = PictureRecorder(tmp_path, CAMERAS)
    gate, begun = threading.Event(), threading.Event()
    write = recorder.write
    recorder.write = lambda f: (begun.set(), gate.wait(), write(f))[2]  # type: ignore
    background = BackgroundRecorder(recorder, most=2)
    background.write(frames(0))
    assert begun.wait(10.0)
    for timestep in (1, 2, 3, 4):
        background.write(frames(timestep))
    assert background.dropped == 2
    gate.set()
    background.close()
    assert recorder.written == 6


def test_a_full_disk_is_told(tmp_path: Path) -> None:
    recorder = PictureRecorder(tmp_path, CAMERAS)
    for folder in (tmp_path / "pictures").iterdir():
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()
    background = BackgroundRecorder(recorder)
    background.write(frames(0))
    with pytest.raises(PictureRecordingError, match="cannot be written: No such file"):
        background.close()
