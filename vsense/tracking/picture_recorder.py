"""Keeps cameras' pictures: a folder per camera with numbered pictures and their timestamps."""

from __future__ import annotations

import queue
import re
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TextIO

import cv2

from vsense.arena import Frame
from vsense.errors import VsenseError
from vsense.tracking.camera import Camera

TIMESTAMPS = "timestamps.csv"

_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,60}")


class RecordingError(VsenseError):
    """A recording that cannot be written."""


def folder_names(cameras: Iterable[Camera]) -> dict[str, str]:
    """Gives each camera's folder: its id where that is a plain name."""
    return {
        camera.id: camera.id if _PLAIN.fullmatch(camera.id) else f"camera-{number}"
        for number, camera in enumerate(cameras)
    }


class PictureRecorder:
    """Writes pictures at once, in the caller's thread.

    The recording is `pictures/CAMERA/000012.png` with `timestamps.csv` beside them, and
    `cameras/CAMERA.json`, the camera files.

    Attributes:
        written: Pictures that are on the disk.
    """

    def __init__(self, directory: Path, cameras: Sequence[Camera], suffix: str = "png") -> None:
        """Begins a recording.

        Args:
            directory: Made where it does not exist; must not hold a recording.
            cameras: Whose pictures come.
            suffix: Format of the pictures: "png", "jpg" or "pgm".

        Raises:
            RecordingError: It cannot be written, or holds a recording already.
        """
        self._suffix = suffix
        self._folders: dict[str, Path] = {}
        self._tables: dict[str, TextIO] = {}
        self.written = 0
        if (directory / "pictures").exists():
            raise RecordingError(f"{directory}: holds a recording already; expected another place")
        try:
            (directory / "cameras").mkdir(parents=True, exist_ok=True)
            for camera in cameras:
                name = folder_names(cameras)[camera.id]
                text = camera.to_json() + "\n"
                (directory / "cameras" / f"{name}.json").write_text(text, encoding="utf-8")
                self._begin(camera.id, directory / "pictures" / name)
        except OSError as error:
            raise RecordingError(f"{directory}: cannot be written: {error.strerror}") from None

    def write(self, frames: Sequence[Frame]) -> None:
        """Keeps the pictures of a timestep.

        Raises:
            RecordingError: The disk is full, or gone.
        """
        for frame in frames:
            name = f"{frame.timestep:06d}.{self._suffix}"
            path = self._folders[frame.camera] / name
            data = cv2.imencode(f".{self._suffix}", frame.image)[1]
            try:
                path.write_bytes(data.tobytes())
                self._tables[frame.camera].write(f"{name},{frame.timestep},{frame.capture_ns}\n")
            except OSError as error:
                raise RecordingError(f"{path}: cannot be written: {error.strerror}") from None
            self.written += 1

    def close(self) -> None:
        """Ends the tables of timestamps; can be called again."""
        for table in self._tables.values():
            table.close()

    def _begin(self, camera: str, folder: Path) -> None:
        folder.mkdir(parents=True)
        self._folders[camera] = folder
        # Line by line, so that a recording that was cut off is still one.
        table = (folder / TIMESTAMPS).open("w", encoding="utf-8", buffering=1)
        table.write("picture,timestep,capture_ns\n")
        self._tables[camera] = table


class BackgroundRecorder:
    """Writes pictures on a thread of its own; what it cannot keep up with is left out.

    Attributes:
        dropped: Timesteps that were left out.
    """

    def __init__(self, recorder: PictureRecorder, most: int = 8) -> None:
        """Starts the thread; at most `most` timesteps wait for it."""
        self._recorder = recorder
        self._waiting: queue.Queue[Sequence[Frame] | None] = queue.Queue(most)
        self._failure: RecordingError | None = None
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    def write(self, frames: Sequence[Frame]) -> None:
        """Hands over the pictures of a timestep, whose memory must not be used again.

        Raises:
            RecordingError: An earlier one could not be written.
        """
        if self._failure is not None:
            raise self._failure
        try:
            self._waiting.put_nowait(frames)
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Writes what waits, and ends.

        Raises:
            RecordingError: Something could not be written.
        """
        self._waiting.put(None)
        self._thread.join()
        self._recorder.close()
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        while (frames := self._waiting.get()) is not None:
            try:
                if self._failure is None:
                    self._recorder.write(frames)
            except RecordingError as failure:
                self._failure = failure
