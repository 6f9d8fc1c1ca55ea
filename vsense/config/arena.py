"""Reads `<arena>`: what stands in it, where or how that is drawn, and what lies on its floor."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from vsense.base.arena import Image
from vsense.base.errors import ConfigError
from vsense.base.files import read_bytes
from vsense.base.xml.element import Element, shown
from vsense.config import argos
from vsense.config._distribute import (
    OBJECT_ELEMENT,
    DistributedCrowd,
    DistributedSpec,
    read_distribute,
    warn_of_height,
)
from vsense.config._robots import ArenaContents, add_crowd, add_object, add_robot
from vsense.config._things import (
    MAX_SIZE_M,
    MIN_SIZE_M,
    THINGS,
    Media,
    check_medium,
    read_thing,
)
from vsense.config.specs import Experiment, FieldSpec, FloorSpec, Stage
from vsense.world.entities import Arena, Box, Cylinder, Entity, WorldError
from vsense.world.fields import MAX_CONCENTRATION, Field, Floor

FIELD_ELEMENT = "vs:field"
LIGHT_ELEMENT = "light"

_MAX_PIXELS_PER_M = 1000.0
_MAX_IMAGE_BYTES = 1 << 26
_MOST_PIXELS = 4096 * 4096
"""Of a floor's picture: unpacked and turned they take 128 MB."""
_LEVELS_UP = 3
_MIN_CELL_M = 0.001
_MAX_CELL_M = 10.0


def read_arena(
    element: Element, folder: Path, media: Media, timestep_s: float, stage: Stage
) -> ArenaContents:
    """Reads the arena and everything in it; tags that the file does not give are missing yet.

    Files with relative paths are looked for in `folder`; lights may refer to `media`.
    """
    low, high = MIN_SIZE_M, MAX_SIZE_M
    size_m = element.vector("size", low, high, "m")
    centre_m = element.vector("center", -high, high, "m", "0,0,0")
    if element.has("positional_grid_size"):
        element.numbers("positional_grid_size", 3, 1.0, 1e6)
    bodies = ArenaContents(Arena(size_m, centre_m), folder, media, timestep_s, stage)
    if (floor := element.optional_child("floor")) is not None:
        bodies.floor = read_floor(floor, folder)
        bodies.claim_id(floor, bodies.floor.id)
    kinds = (*argos.ROBOTS, OBJECT_ELEMENT, argos.DISTRIBUTE, FIELD_ELEMENT, *THINGS)
    others = argos.others_in(element)
    for child in element.children(*kinds, *others):
        if child.name in others:
            child.leave_out(others[child.name])
        else:
            _read_child(child, bodies)
    return bodies


def _read_child(element: Element, bodies: ArenaContents) -> None:
    if element.name in argos.ROBOTS:
        add_robot(element, bodies)
    elif element.name == OBJECT_ELEMENT:
        add_object(element, bodies)
    elif element.name == FIELD_ELEMENT:
        name = element.text("id")
        bodies.claim_id(element, name)
        bodies.fields.append(read_field(element, name, bodies.arena, bodies.timestep_s))
    elif element.name == argos.DISTRIBUTE:
        _read_crowd(element, bodies)
    else:
        name = element.text("id")
        bodies.claim_id(element, name)
        bodies.entities.append(_read_thing(element, name, bodies, True))


def _read_thing(element: Element, name: str, bodies: ArenaContents, placed: bool) -> Entity:
    if element.name == LIGHT_ELEMENT:
        check_medium(element, bodies.media)
    thing = read_thing(element, name, bodies.arena, placed)
    if not isinstance(thing, (Box, Cylinder)) or thing.physical:
        return thing
    if element.document.lenient and bodies.stage is not Stage.RUN:
        # Nothing is virtual in a file of ARGoS, and here no arena contradicts it.
        return replace(thing, physical=True)
    bodies.unseen.append(element)
    return thing


def _read_crowd(element: Element, bodies: ArenaContents) -> None:
    crowd = read_distribute(element, bodies.crowds)
    if crowd is None:
        return
    bodies.crowds += 1
    if crowd.element.name in (*argos.ROBOTS, OBJECT_ELEMENT):
        warn_of_height(element, crowd.distribution.position_m)
        add_crowd(crowd, bodies)
    else:
        _add_things(element, crowd, bodies)


def _add_things(element: Element, crowd: DistributedCrowd, bodies: ArenaContents) -> None:
    """Adds the things of an `<entity>`, called NAME and a number from base_num."""
    prefix = crowd.element.text("id")
    names = [f"{prefix}{number}" for number in crowd.numbers]
    for name in names:
        bodies.claim_id(crowd.element, name)
    thing = _read_thing(crowd.element, names[0], bodies, False)
    on_floor = not isinstance(thing, (Box, Cylinder)) or thing.physical
    if on_floor and crowd.element.name != LIGHT_ELEMENT:
        warn_of_height(element, crowd.distribution.position_m)
    for name in names:
        spec = DistributedSpec(replace(thing, id=name), crowd.distribution, crowd.element.line)
        bodies.distributed.append(spec)


def read_floor(element: Element, folder: Path) -> FloorSpec:
    """Reads a `<floor>`; its picture, looked for in `folder`, must be there and be one."""
    name = element.text("id")
    source = element.choice("source", ("image", "loop_functions"))
    if source == "loop_functions":
        pixels_per_m = element.number("pixels_per_meter", 0.1, _MAX_PIXELS_PER_M, "pixels/m")
        return FloorSpec(name, source, None, pixels_per_m, element.line)
    path = _find(element, folder, element.text("path", None, "the path of a picture"))
    try:
        read_image(path)
    except (OSError, ValueError) as error:
        expected = "expected a picture, PNG or JPEG"
        raise element.error(f"{str(path)[-60:]!r}: {_reason(error)}, {expected}", "path") from None
    return FloorSpec(name, source, path, 0.0, element.line)


def _find(element: Element, folder: Path, name: str) -> Path:
    """Finds a file in `folder`; in a file of ARGoS also where other people have it.

    ARGoS looks where it is started, which may be above. A path from another machine's root ends
    as one here does.
    """
    path = folder / name
    if os.path.isfile(path) or not element.document.lenient:
        return path
    ends = Path(name).parts
    for place in (folder, *folder.resolve().parents[:_LEVELS_UP]):
        for first in range(1 if path.is_absolute() else 0, len(ends)):
            candidate = place.joinpath(*ends[first:])
            if os.path.isfile(candidate):
                element.warn(f"path: {shown(name)} is not there, {str(candidate)!r} is taken")
                return candidate
    return path


def read_image(path: Path) -> Image:
    """Reads a picture as the floor takes it.

    Returns:
        (h, w, 3 or 4) red, green, blue, and alpha where the picture has one.

    Raises:
        OSError: the file cannot be read.
        ValueError: it holds no picture.
    """
    return floor_picture(read_bytes(path, _MAX_IMAGE_BYTES))


def floor_picture(data: bytes) -> Image:
    """The same of a picture's bytes; ValueError: they are none, or a larger one than a floor's."""
    import cv2  # few floors have a picture

    from vsense.vision.cameras.picture import decode

    image = decode(data, "it", _MOST_PIXELS, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint8:
        raise ValueError(f"has colours of {8 * image.itemsize} bits instead of 8")
    codes = {1: cv2.COLOR_GRAY2RGB, 3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGBA}
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels not in codes:
        raise ValueError(f"has {channels} colours per pixel instead of 1, 3 or 4")
    return np.asarray(cv2.cvtColor(image, codes[channels]), dtype=np.uint8)


def floor_of(experiment: Experiment) -> Floor:
    """Makes the floor of an experiment: its picture, or plain.

    As in ARGoS, a picture covers the arena's size around the origin, whatever the arena's centre.
    Raises ConfigError where the picture is no longer there.
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
    """Reads a `<vs:field>`; ConfigError if it has too many cells, or they are too small."""
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
    """Makes a field as it is at the start; raises WorldError where it has too many cells."""
    return Field(
        spec.id, arena, spec.cell_m, spec.evaporation_per_s, spec.diffusion_m2_s, spec.initial
    )


def _reason(error: OSError | ValueError) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
