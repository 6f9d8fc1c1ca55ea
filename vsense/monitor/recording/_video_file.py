"""Files of moving pictures: WebM and what else OpenCV writes on this machine.

A file is written beside its place under another name, and gets its own name when it is whole: what
is there under that name can be played.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2

from vsense.base.arena import Image
from vsense.base.errors import failing_as
from vsense.monitor.recording.form import RecordingError

VIDEO_SUFFIXES = (".webm", ".webp", ".mp4")
_CODECS = {".webm": ("VP80", "VP90"), ".mp4": ("avc1",)}
"""VP8 is written three times as fast as VP9, and every browser plays both."""
_LEAST_FREE_BYTES = 4 << 20
_LOOK_EVERY = 10
MOST_FRAME_BYTES = 1 << 30
"""Of an animated picture's frames, which wait in memory."""


class VideoFile(ABC):
    """A file in the making; a context that leaves nothing behind unless `finish` was called.

    RecordingError where it is there already, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.frames = 0
        self._part = path.with_name(f".{path.stem}.part{path.suffix}")
        if os.path.exists(path):
            raise RecordingError(f"{path}: is there already; expected another name")
        with failing_as(RecordingError, f"{path}: cannot be written"):
            self._part.open("wb").close()

    def __enter__(self) -> VideoFile:
        return self

    def __exit__(self, *exception: object) -> None:
        self._close()
        with suppress(OSError):
            self._part.unlink(missing_ok=True)

    def add(self, frame: Image) -> None:
        """Adds a frame (h, w, 3) BGR; RecordingError if the disk is full."""
        if self.frames % _LOOK_EVERY == 0:
            self._check_disk()
        self._write(frame)
        self.frames += 1

    def finish(self) -> None:
        """Ends the file and gives it its name; RecordingError if not all of it was written."""
        self._close()
        self._check()
        with failing_as(RecordingError, f"{self.path}: cannot be written"):
            self._part.rename(self.path)

    def _check_disk(self) -> None:
        """OpenCV does not say when a disk is full."""
        with failing_as(RecordingError, f"{self.path}: cannot be written"):
            disk = os.statvfs(self._part.parent)
        if disk.f_bavail * disk.f_frsize < _LEAST_FREE_BYTES:
            raise RecordingError(f"{self.path}: cannot be written: the disk is full")

    @abstractmethod
    def _write(self, frame: Image) -> None: ...

    @abstractmethod
    def _close(self) -> None:
        """Writes what waits; can be called again."""

    @abstractmethod
    def _check(self) -> None:
        """RecordingError unless the file holds every frame."""


class _Film(VideoFile):
    """A video."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        super().__init__(path)
        with _quietly():
            tries = (
                cv2.VideoWriter(str(self._part), cv2.VideoWriter.fourcc(*code), fps, size)
                for code in _CODECS[path.suffix.lower()]
            )
            self._writer = next((writer for writer in tries if writer.isOpened()), None)
        if self._writer is None:
            self._part.unlink(missing_ok=True)
            kind = "H.264" if path.suffix.lower() == ".mp4" else "VP8 and VP9"
            raise RecordingError(
                f"{path}: OpenCV {cv2.__version__} on this machine does not write {kind};"
                " expected a name that ends in"
                f" {'.webm' if kind == 'H.264' else '.webp (an animated picture)'}"
            )

    def _write(self, frame: Image) -> None:
        if self._writer is not None:
            with _quietly():
                self._writer.write(frame)

    def _close(self) -> None:
        if self._writer is not None:
            with _quietly():
                self._writer.release()

    def _check(self) -> None:
        with _quietly():
            film = cv2.VideoCapture(str(self._part))
            count = 0
            while film.isOpened() and film.grab():
                count += 1
            film.release()
        if count < self.frames:
            raise RecordingError(
                f"{self.path}: cannot be written: only {count} of {self.frames} frames are on the"
                " disk; is it full?"
            )


class _Moving(VideoFile):
    """An animated picture in WebP, which pages and READMEs show without a player."""

    _QUALITY = 70

    def __init__(self, path: Path, fps: float) -> None:
        super().__init__(path)
        self._frame_ms = round(1000.0 / fps)
        self._waiting: list[Image] = []
        self._size = 0

    def _write(self, frame: Image) -> None:
        self._size += frame.nbytes
        if self._size > MOST_FRAME_BYTES:
            raise RecordingError(
                f"{self.path}: an animated picture of more than {self.frames} frames of this size"
                " is more than memory should hold; expected a smaller --size, a shorter time, or"
                " a name that ends in .webm"
            )
        self._waiting.append(frame.copy())

    def _close(self) -> None:
        pass

    def _check(self) -> None:
        moving = cv2.Animation()
        moving.frames = self._waiting
        moving.durations = [self._frame_ms] * len(self._waiting)
        # OpenCV before 4.12 has no animations in memory.
        with _quietly():
            done = cv2.imwriteanimation(
                str(self._part), moving, [cv2.IMWRITE_WEBP_QUALITY, self._QUALITY]
            )
        with failing_as(RecordingError, f"{self.path}: cannot be written"):
            complete = done and _is_whole_webp(self._part)
        if not complete:
            raise RecordingError(
                f"{self.path}: cannot be written: OpenCV made only a part of it; is the disk full?"
            )


def _is_whole_webp(path: Path) -> bool:
    """Whether a file is as long as its head says: RIFF, and how many bytes follow."""
    with path.open("rb") as file:
        head = file.read(8)
    return head[:4] == b"RIFF" and int.from_bytes(head[4:], "little") + 8 == path.stat().st_size


def open_video(path: Path, fps: float, size: tuple[int, int]) -> VideoFile:
    """Begins a file for frames of `size` (width, height), both even; its kind is in its name."""
    suffix = path.suffix.lower()
    if suffix not in VIDEO_SUFFIXES:
        raise RecordingError(f"{path}: expected a name that ends in {', '.join(VIDEO_SUFFIXES)}")
    return _Moving(path, fps) if suffix == ".webp" else _Film(path, fps, size)


@contextmanager
def _quietly() -> Iterator[None]:
    """Drops what OpenCV's FFmpeg says on standard error: what does not work is said by us."""
    try:
        saved = os.dup(2)
    except OSError:
        yield
        return
    drop = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(drop, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(drop)
