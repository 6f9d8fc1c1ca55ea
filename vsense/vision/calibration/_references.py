"""Reference pictures beside camera files: kept with a calibration, and compared with later ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import cv2

from vsense.base.arena import Image
from vsense.base.errors import UsageError
from vsense.vision.calibration._pictures import PictureFile, inspect
from vsense.vision.cameras._reference import (
    BACKGROUND_PICTURES,
    Displacement,
    IncomparableError,
    background,
    compare,
    read_reference,
    reference_path,
)


def backgrounds(pictures: Sequence[PictureFile]) -> dict[str, Image]:
    """Returns what stands still in each camera's pictures, by the cameras' names.

    Raises:
        UsageError, GrabberError: a picture cannot be read, or is not as large as the others.
    """
    found = {}
    for camera in sorted({picture.camera for picture in pictures}):
        mine = [picture for picture in pictures if picture.camera == camera]
        step = max(1.0, len(mine) / BACKGROUND_PICTURES)
        few = [mine[int(k * step)] for k in range(min(len(mine), BACKGROUND_PICTURES))]
        images: list[Image] = []
        for file, size, image in inspect(few, lambda: _whole, lambda done, total: None):
            if images and image.shape != images[0].shape:
                height, width = images[0].shape
                raise UsageError(
                    f"{file.path}: {size[0]} x {size[1]} px, expected {width} x {height} as in the"
                    f" other pictures of {camera}"
                )
            images.append(image)
        found[camera] = background(images)
    return found


def _whole(image: Image) -> Image:
    return image


def keep(folder: Path, cameras: Iterable[str], pictures: Mapping[str, Image]) -> list[Path]:
    """Writes the reference pictures of cameras into the folder of their files.

    A camera without a picture has none from then on: an older one is of another calibration.
    Returns the files; raises UsageError where one cannot be written.
    """
    paths = []
    for camera in cameras:
        path = reference_path(folder / f"{camera}.json")
        try:
            if camera not in pictures:
                path.unlink(missing_ok=True)
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(cv2.imencode(".png", pictures[camera])[1].tobytes())
        except OSError as error:
            raise UsageError(f"{path}: cannot be written: {error.strerror}") from None
        paths.append(path)
    return paths


def compared(folder: Path, pictures: Mapping[str, Image]) -> dict[str, Displacement | str]:
    """How far each camera's picture lies beside its reference, or why that is not known."""
    found: dict[str, Displacement | str] = {}
    for camera, image in pictures.items():
        try:
            reference = read_reference(folder / f"{camera}.json")
            if reference is None:
                found[camera] = "it has no reference picture; --keep makes this one its reference"
            else:
                found[camera] = compare(reference, image)
        except IncomparableError as error:
            found[camera] = str(error)
    return found
