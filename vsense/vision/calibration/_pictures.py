"""Pictures on the disk: which camera took them, at which moment, and what is seen in them.

A picture's camera is the name of its folder, a video's is its own name. Pictures of several
cameras show the same moment if their names are equal, or if tables of timestamps (see
`vsense.vision.cameras._recordings`) say so: `timestamps.csv` in the camera's folder, or NAME.csv
beside the video NAME.mp4.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from threading import local
from typing import TypeVar

import cv2

from vsense.base.arena import Image
from vsense.base.errors import UsageError
from vsense.vision.cameras._recordings import CaptureTime, read_timestamps
from vsense.vision.cameras.picture import ENDINGS, PictureError, read_picture, to_grey

T = TypeVar("T")

STILL_SUFFIXES = frozenset(ENDINGS)
VIDEOS = frozenset((".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".mjpeg"))
TIMES_FILE = "timestamps.csv"
SAME_MOMENT_NS = 20_000_000
"""Pictures taken this close together are of the same moment."""

_WORKERS = 2


@dataclass(frozen=True, slots=True)
class PictureFile:
    """One picture that has not been read yet; `frame` is its number in a video, else None."""

    camera: str
    moment: str
    path: Path
    frame: int | None = None


def gather(paths: Sequence[Path], every: int = 1) -> list[PictureFile]:
    """Finds pictures in order of camera and moment, in a video every so many.

    The paths are picture files, videos, folders with pictures, or folders with a folder or a video
    per camera.

    Raises:
        UsageError: There are none, or two of one camera have the same name.
        ConfigError: A table of timestamps is wrong.
    """
    pictures: list[PictureFile] = []
    times: dict[tuple[str, str], CaptureTime] = {}
    for path in _expanded(paths):
        table = _table_of(path)
        still = [PictureFile(path.resolve().parent.name, path.stem, path)]
        for picture in _video(path, every) if path.suffix.lower() in VIDEOS else still:
            pictures.append(picture)
            taken = table.get(path.name if picture.frame is None else picture.frame)
            if taken is not None:
                times[picture.camera, picture.moment] = taken
    if not pictures:
        raise UsageError(f"{paths[0]}: no pictures; expected e.g. .png, .jpg or .mp4 files")
    if times:
        pictures = _same_moments(pictures, times)
    by_moment: dict[tuple[str, str], PictureFile] = {}
    for p in pictures:
        other = by_moment.setdefault((p.camera, p.moment), p)
        if other is not p:
            raise UsageError(
                f"{p.path}: camera {p.camera} has a picture {p.moment} already: {other.path}"
            )
    return sorted(pictures, key=lambda picture: (picture.camera, picture.moment))


def inspect(
    pictures: Sequence[PictureFile],
    make: Callable[[], Callable[[Image], T]],
    progress: Callable[[int, int], None],
) -> Iterator[tuple[PictureFile, tuple[int, int], T]]:
    """Reads all pictures and looks at each, on two threads.

    `make` makes what looks at a picture, once per thread; `progress` is called with how many of
    how many are done. Yields the picture, its width and height, and what was seen in it.

    Raises:
        UsageError, GrabberError: A picture cannot be read.
    """
    own = local()

    def work(group: Sequence[PictureFile]) -> list[tuple[PictureFile, tuple[int, int], T]]:
        if not hasattr(own, "looks"):
            own.looks = make()
        return [(p, (i.shape[1], i.shape[0]), own.looks(i)) for p, i in _read(group)]

    cv2.setNumThreads(1)
    groups = _groups(pictures)
    done = 0
    with ThreadPoolExecutor(_WORKERS) as workers:
        for result in workers.map(work, groups):
            done += len(result)
            progress(done, len(pictures))
            yield from result


def _groups(pictures: Sequence[PictureFile]) -> list[list[PictureFile]]:
    """Pictures that are read together: those of a video, and each file by itself."""
    groups: dict[Path, list[PictureFile]] = {}
    for picture in pictures:
        groups.setdefault(picture.path, []).append(picture)
    return [sorted(group, key=lambda p: p.frame or 0) for group in groups.values()]


def _read(group: Sequence[PictureFile]) -> Iterator[tuple[PictureFile, Image]]:
    if group[0].frame is None:
        yield group[0], read_picture(group[0].path)
        return
    wanted = {picture.frame: picture for picture in group}
    video = cv2.VideoCapture(str(group[0].path))
    for number in range(max(n for n in wanted if n is not None) + 1):
        if not video.grab():
            break
        if number in wanted:
            good, image = video.retrieve()
            if good:
                yield wanted[number], _grey(group[0].path, image)


def _grey(video: Path, image: cv2.typing.MatLike) -> Image:
    try:
        return to_grey(image)
    except PictureError as error:
        raise PictureError(f"{video.name}: {error}") from None


def _expanded(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        if os.path.isdir(path):
            inside = sorted(child for child in path.iterdir() if not child.name.startswith("."))
            folders = [child for child in inside if os.path.isdir(child)]
            files = [c for c in inside if c.suffix.lower() in STILL_SUFFIXES | VIDEOS]
            for folder in folders:
                files += [c for c in sorted(folder.iterdir()) if c.suffix.lower() in STILL_SUFFIXES]
            if not files:
                raise UsageError(f"{path}: no pictures in this folder or in its folders")
            yield from files
        elif not os.path.exists(path):
            raise UsageError(f"{path}: no such file or folder")
        elif path.suffix.lower() in STILL_SUFFIXES | VIDEOS:
            yield path
        else:
            raise UsageError(f"{path}: expected a picture, a video or a folder")


def _video(path: Path, every: int) -> list[PictureFile]:
    video = cv2.VideoCapture(str(path))
    frames = 0
    while video.grab():
        frames += 1
    if frames == 0:
        raise UsageError(f"{path}: no video that can be read")
    return [PictureFile(path.stem, f"{n:06d}", path, n) for n in range(0, frames, every)]


def _table_of(path: Path) -> dict[str | int, CaptureTime]:
    """The table beside a file: name of the picture, or number in the video -> when."""
    video = path.suffix.lower() in VIDEOS
    table = path.with_suffix(".csv") if video else path.parent / TIMES_FILE
    if not os.path.isfile(table):
        return {}
    rows = read_timestamps(table, named=not video)
    return {(n if video else row.picture): row for n, row in enumerate(rows)}


def _same_moments(
    pictures: Sequence[PictureFile], times: dict[tuple[str, str], CaptureTime]
) -> list[PictureFile]:
    """Names moments after the trigger's number, or after the capture times."""
    stamped = [p for p in pictures if (p.camera, p.moment) in times]
    taken = [times[p.camera, p.moment] for p in stamped]
    if all(row.timestep is not None for row in taken):
        return [replace(p, moment=f"{row.timestep:06d}") for p, row in zip(stamped, taken)]
    named: list[PictureFile] = []
    first_ns, cameras, number = 0, set[str](), -1
    for row, picture in sorted(zip(taken, stamped), key=lambda pair: pair[0].capture_ns):
        late = row.capture_ns - first_ns > SAME_MOMENT_NS
        if number < 0 or late or picture.camera in cameras:
            number, first_ns, cameras = number + 1, row.capture_ns, set()
        cameras.add(picture.camera)
        named.append(replace(picture, moment=f"{number:06d}"))
    return named
