"""A world with robots in places, for the tests of actuators."""

from __future__ import annotations

import pytest

from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse
from vsense.world.entities import Arena
from vsense.world.fields import Field
from vsense.world.pollution import PollutantSource
from vsense.world.sensors.base import Scope
from vsense.world.world import World

ARENA = Arena((2.0, 2.0, 1.0), (0.0, 0.0, 0.5))
STEP_NS = 100_000_000


@pytest.fixture
def scope() -> Scope:
    """What an actuator's element may refer to."""
    source = PollutantSource(22, 0.0, 1.5, 1.0, amount=2.0)
    endless = PollutantSource(23, 0.0, 1.5, 1.0)
    tags = {"polluter": 22, "endless": 23, "robot": 7}
    return Scope(tags, 100, fields=("trail", "alarm"), sources=[source, endless])


def element_of(text: str) -> Element:
    """The one element of an XML text."""
    root = parse(f'<r xmlns:vs="urn:vsense:1">{text}</r>'.encode(), "x.argos")
    return root.children()[0]


def world_of(tags: tuple[int, ...] = (7, 3), sources: tuple[PollutantSource, ...] = ()) -> World:
    """A world with two fields and nobody in it yet."""
    fields = [Field(name, ARENA, 0.1) for name in ("trail", "alarm")]
    return World(tags, sources, fields=fields, arena=ARENA)
