"""Reads `<arena>`: what stands in it and where, or how that is drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from vsense.config import argos
from vsense.config.distribute import (
    OBJECT,
    ROBOT,
    Crowd,
    DistributedSpec,
    read_distribute,
    warn_of_height,
)
from vsense.config.ground import read_field, read_floor
from vsense.config.robots import ArenaContents, add_crowd, add_epuck, add_object
from vsense.config.things import MAX_LENGTH_M, MIN_LENGTH_M, THINGS, Media, check_medium, read_thing
from vsense.world.entities import Arena, Box, Cylinder, Entity
from vsense.xml.element import Element

DISTRIBUTE = "distribute"
FIELD = "vs:field"
LIGHT = "light"


def read_arena(element: Element, folder: Path, media: Media, timestep_s: float) -> ArenaContents:
    """Reads the arena and everything in it; tags that the file does not give are missing yet.

    Args:
        folder: where files with relative paths are looked for.
        media: what lights may refer to.
        timestep_s: length of a timestep.
    """
    low, high = MIN_LENGTH_M, MAX_LENGTH_M
    size_m = element.vector("size", low, high, "m")
    centre_m = element.vector("center", -high, high, "m", "0,0,0")
    if element.has("positional_grid_size"):
        element.numbers("positional_grid_size", 3, 1.0, 1e6)
    bodies = ArenaContents(Arena(size_m, centre_m), folder, media, timestep_s)
    if (floor := element.optional_child("floor")) is not None:
        bodies.floor = read_floor(floor, folder)
        bodies.claim_id(floor, bodies.floor.id)
    known = (ROBOT, OBJECT, DISTRIBUTE, FIELD, *THINGS, *argos.ENTITIES)
    for child in element.children(*known):
        _read_child(child, bodies)
    return bodies


def _read_child(element: Element, bodies: ArenaContents) -> None:
    if element.name in argos.ENTITIES:
        element.leave_out(argos.ENTITIES[element.name])
    elif element.name == ROBOT:
        add_epuck(element, bodies)
    elif element.name == OBJECT:
        add_object(element, bodies)
    elif element.name == FIELD:
        name = element.text("id")
        bodies.claim_id(element, name)
        bodies.fields.append(read_field(element, name, bodies.arena, bodies.timestep_s))
    elif element.name == DISTRIBUTE:
        _read_crowd(element, bodies)
    else:
        name = element.text("id")
        bodies.claim_id(element, name)
        _check_medium(element, bodies)
        thing = read_thing(element, name, bodies.arena, True)
        bodies.entities.append(thing)
        _note_unseen(element, thing, bodies)


def _read_crowd(element: Element, bodies: ArenaContents) -> None:
    crowd = read_distribute(element, bodies.crowds)
    if crowd is None:
        return
    bodies.crowds += 1
    if crowd.element.name in (ROBOT, OBJECT):
        warn_of_height(element, crowd.distribution.position_m)
        add_crowd(crowd, bodies)
    else:
        _add_things(element, crowd, bodies)


def _add_things(element: Element, crowd: Crowd, bodies: ArenaContents) -> None:
    """Adds the things of an `<entity>`, called NAME and a number from base_num."""
    prefix = crowd.element.text("id")
    _check_medium(crowd.element, bodies)
    names = [f"{prefix}{number}" for number in crowd.numbers]
    for name in names:
        bodies.claim_id(crowd.element, name)
    thing = read_thing(crowd.element, names[0], bodies.arena, False)
    on_floor = not isinstance(thing, (Box, Cylinder)) or thing.physical
    if on_floor and crowd.element.name != LIGHT:
        warn_of_height(element, crowd.distribution.position_m)
    _note_unseen(crowd.element, thing, bodies)
    for name in names:
        spec = DistributedSpec(replace(thing, id=name), crowd.distribution, crowd.element.line)
        bodies.distributed.append(spec)


def _check_medium(element: Element, bodies: ArenaContents) -> None:
    if element.name == LIGHT:
        check_medium(element, bodies.media)


def _note_unseen(element: Element, thing: Entity, bodies: ArenaContents) -> None:
    if isinstance(thing, (Box, Cylinder)) and not thing.physical:
        bodies.unseen.append(element)
