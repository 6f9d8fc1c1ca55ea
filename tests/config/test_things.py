"""Boxes, cylinders, lights and zones: what the file says is what stands in the world."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from vsense.base.arena import wrap_angle
from vsense.base.errors import ConfigError
from vsense.config._things import NAMED
from vsense.config.specs import Experiment
from vsense.world.entities import Box, Cylinder, Entity, Light, Zone
from vsense.world.sensors.range_and_bearing import RangeAndBearingSensor

Read = Callable[..., Experiment]

BODY = '<body position="0.3,-0.4,{}" orientation="30,0,0" />'
FLOOR = BODY.format(0)
TURN = float(wrap_angle(math.radians(30.0)))


def with_things(example: str, *things: str) -> str:
    return example.replace("</arena>", "".join(f"{thing}\n" for thing in things) + "</arena>")


def thing(experiment: Experiment, name: str) -> Entity:
    return next(entity for entity in experiment.entities if entity.id == name)


def box(name: str, more: str = "", z: float = 0.0) -> str:
    size = 'size="0.3,0.2,0.1" movable="false"'
    return f'<box id="{name}" {size} {more}>{BODY.format(z)}</box>'


def test_every_kind_of_thing(read_text: Read, example: str) -> None:
    experiment = read_text(
        with_things(
            example,
            box("crate_2", z=0.5),
            f'<cylinder id="c" radius="0.1" height="0.3" movable="false">{FLOOR}</cylinder>',
            '<light id="l" position="0,0,1.5" intensity="3" color="orange" />',
            '<vs:zone id="z" shape="circle" position="1,0,0" radius="0.2" value="7" />',
            '<vs:zone id="r" shape="rectangle" position="1,0,0" orientation="30,0,0"'
            ' size="0.4,0.2" color="1,2,3" />',
        )
    )
    assert thing(experiment, "crate_2") == Box("crate_2", (0.3, -0.4, 0.5), (0.3, 0.2, 0.1), TURN)
    assert thing(experiment, "c") == Cylinder("c", (0.3, -0.4, 0.0), 0.1, 0.3)
    assert thing(experiment, "l") == Light("l", (0.0, 0.0, 1.5), 3.0, NAMED["orange"])
    assert thing(experiment, "z") == Zone("z", "circle", 1.0, 0.0, 0.2, value=7.0)
    assert thing(experiment, "r") == Zone(
        "r", "rectangle", 1.0, 0.0, 0.0, (0.4, 0.2), TURN, (1, 2, 3)
    )
    assert [e.id for e in experiment.entities if isinstance(e, Light)] == ["l"]
    assert [e.id for e in experiment.entities if isinstance(e, Zone)] == ["z", "r"]


@pytest.mark.parametrize(
    ("name", "more", "physical"),
    [
        ("wall_7", "", True),
        ("wall_7", 'vs:physical="false"', False),
        ("maze", "", False),
        ("maze", 'vs:physical="true"', True),
        ("firewall", "", False),
    ],
)
def test_walls_stand_in_the_real_arena_unless_told_otherwise(
    read_text: Read, example: str, name: str, more: str, physical: bool
) -> None:
    experiment = read_text(with_things(example, box(name, more)))
    assert (name in [b.id for b in experiment.boxes]) == physical
    assert name in [entity.id for entity in experiment.entities]
    cylinder = f'<cylinder id="{name}" radius="0.1" height="0.3" movable="false" {more}>'
    experiment = read_text(with_things(example, f"{cylinder}{BODY.format(0)}</cylinder>"))
    assert (name in [c.id for c in experiment.cylinders]) == physical


def test_what_is_real_stands_on_the_floor(read_text: Read, example: str) -> None:
    with pytest.raises(ConfigError, match=r"'wall_7'.*0.*0.5"):
        read_text(with_things(example, box("wall_7", z=0.5)))


def test_virtual_things_without_a_virtual_sensor_are_pointed_out(
    read_text: Read, example: str
) -> None:
    text = with_things(example, box("maze"))
    assert not [w for w in read_text(text).warnings if "no virtual sensor" in w]
    start, end = text.index("<virtual_pollutant_sensor"), text.index("</sensors>")
    text = text[:start] + text[end:]
    text = text.replace('<e-puck id="epuck_22_1">', '<vs:object id="epuck_22_1">').replace(
        'orientation="0,0,0" /></e-puck>', 'orientation="0,0,0" /></vs:object>'
    )
    (warning,) = [w for w in read_text(text).warnings if "no virtual sensor" in w]
    assert "<box> is virtual, and no virtual sensor is there to feel it" in warning


@pytest.mark.parametrize(
    ("text", "color"), [("yellow", (255, 255, 0)), (" 1, 2 ,255", (1, 2, 255))]
)
def test_colours_by_name_or_numbers(
    read_text: Read, example: str, text: str, color: tuple[int, int, int]
) -> None:
    light = f'<light id="l" position="0,0,1" intensity="1" color="{text}" />'
    entities = read_text(with_things(example, light)).entities
    assert next(e.color for e in entities if isinstance(e, Light)) == color


def test_a_medium_decides_whether_bodies_are_in_the_way(read_full: Read, full: str) -> None:
    def reach(text: str) -> object:
        sensors = {m.sensor.name: m.sensor for m in read_full(text).controllers[0].sensors}
        hearing = sensors["range_and_bearing"]
        assert isinstance(hearing, RangeAndBearingSensor)
        return hearing.reach.height_m

    assert reach(full) is None
    assert reach(full.replace(' check_occlusions="false"', "")) is not None
    own = full.replace('medium="rab" range="0.8"', 'medium="rab" check_occlusions="true" range="1"')
    assert reach(own) is not None


def test_greys_are_grey_and_their_number_is_their_share_of_white() -> None:
    greys = {name: colour for name, colour in NAMED.items() if name.startswith("gray")}
    assert len(greys) == 9
    for name, (red, green, blue) in greys.items():
        assert red == green == blue == pytest.approx(2.55 * int(name[4:]), abs=0.6)
