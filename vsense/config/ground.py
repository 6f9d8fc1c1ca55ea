"""Reads what lies on the floor: the floor's own picture, and fields such as pheromones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from vsense.config.specs import Experiment, FieldSpec, FloorSpec
from vsense.errors import ConfigError
from vsense.world.entities import Arena, WorldError
from vsense.world.fields import MAX_CONCENTRATION, Field
from vsense.world.floor import Floor, Image
from vsense.xml.element import Element

_MAX_PIXELS_PER_M = 1000.0
_MAX_IMAGE_BYTES = 1 << 26
_MIN_CELL_M = 0.001
_MAX_CELL_M = 10.0


def read_floor(element: Element, folder: Path) -> FloorSpec:
    """Reads a `<floor>`; its picture must be there and be one.

    Args:
        folder: where a picture with a relative path is looked for.

    Raises:
        ConfigError: an attribute is wrong, or the picture cannot be read.
    """
    name = element.text("id")
    source = element.choice("source", ("image", "loop_functions"))
    if source == "loop_functions":
        pixels_per_m = element.number("pixels_per_meter", 0.1, _MAX_PIXELS_PER_M, "pixels/m")
        return FloorSpec(name, source, None, pixels_per_m, element.line)
    path = folder / element.text("path", None, "the path of a picture")
    try:
        read_image(path)
    except (OSError, ValueError) as error:
        expected = "expected a picture, PNG or JPEG"
        raise element.error(f"{str(path)[-60:]!r}: {_reason(error)}, {expected}", "path") from None
    return FloorSpec(name, source, path, 0.0, element.line)


def read_image(path: Path) -> Image:
    """Reads a picture as the floor takes it.

    Returns:
        (h, w, 3 or 4) red, green, blue, and alpha where the picture has one.

    Raises:
        OSError: the file cannot be read.
        ValueError: it holds no picture.
    """
    if path.stat().st_size > _MAX_IMAGE_BYTES:
        raise ValueError(f"has more than {_MAX_IMAGE_BYTES >> 20} MB")
    data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if image is None:
        raise ValueError("is no picture that can be read")
    if image.dtype != np.uint8:
        raise ValueError(f"has colours of {8 * image.itemsize} bits instead of 8")
    codes = {1: cv2.COLOR_GRAY2RGB, 3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGBA}
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels not in codes:
        raise ValueError(f"has {channels} colours per pixel instead of 1, 3 or 4")
    return np.asarray(cv2.cvtColor(image, codes[channels]), dtype=np.uint8)


def floor_of(experiment: Experiment) -> Floor:
    """Makes the floor of an experiment: its picture, or plain.

    A picture covers the arena's size around the origin, whatever the arena's centre: so does
    ARGoS.

    Raises:
        ConfigError: the picture is no longer there.
    """
    spec = experiment.floor
    if spec is None or spec.path is None:
        return Floor()
    try:
        image = read_image(spec.path)
    except (OSError, ValueError) as error:
        raise ConfigError(
            experiment.file, spec.line, f"<floor> path: {str(spec.path)[-60:]!r}: {_reason(error)}"
        ) from None
    return Floor(image, experiment.arena.size_m[:2])


def read_field(element: Element, name: str, arena: Arena, timestep_s: float) -> FieldSpec:
    """Reads a `<vs:field>`.

    Args:
        arena: where it lies.
        timestep_s: how far it is to be stepped at once.

    Raises:
        ConfigError: an attribute is wrong, or it has too many cells or spreads too fast for them.
    """
    spec = FieldSpec(
        name,
        element.number("cell", _MIN_CELL_M, _MAX_CELL_M, "m", 0.02),
        element.number("evaporation", 0.0, 1e3, "1/s", 0.0),
        element.number("diffusion", 0.0, 1e3, "m^2/s", 0.0),
        element.number("initial", 0.0, MAX_CONCENTRATION, "1/m^2", 0.0),
        element.line,
    )
    try:
        make_field(spec, arena).check(timestep_s)
    except WorldError as error:
        raise element.error(str(error).partition(": ")[2]) from None
    return spec


def make_field(spec: FieldSpec, arena: Arena) -> Field:
    """Makes a field as it is at the start.

    Raises:
        WorldError: it has too many cells.
    """
    return Field(
        spec.id, arena, spec.cell_m, spec.evaporation_per_s, spec.diffusion_m2_s, spec.initial
    )


def _reason(error: OSError | ValueError) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
