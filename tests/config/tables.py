"""What an experiment file's attributes may not be: tables, and every mutant of a file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

OWN_ACTUATOR = """
from vsense import Scale


class Horn:
    name, layout, scale = "horn", "u1", Scale()

    def apply(self, world, rows, values, increments): ...


def from_xml(element, scope):
    return Horn()
"""

OWN_SENSOR = """
import numpy as np
class Own:
    name, layout = "own", "f4"
    def read(self, world, robots):
        return np.zeros((len(robots), 1))
def from_xml(element, scope):
    return Own()
"""
"""A sensor of the user's own."""

NUMBER = ("", "abc", "nan", "inf", "-inf", "1e308", "-1e308", "1,2", "0x10", "1_000", "1 2", "--1")
VECTOR = ("", "abc", "1", "1,2", "1,2,3,4", "1 2 3", "nan,0,0", "0,inf,0", "0,0,-1e308", "1,,2")
WORD = ("", "abc", "nan", "1e308", "True", "1,2")
FREE = ("",)
"""What no kind of value may be; an id, a name or a path of the user's own may be any other text."""

KINDS: dict[str, tuple[str, ...]] = {
    "share": ("", "abc", "nan", "inf", "-1", "1e308", "101%", "-1%", "nan%", "1,2", "1.5"),
    "number": NUMBER,
    "vector": VECTOR,
    "pair": ("", "abc", "1", "1,2,3", "1 2", "nan,1", "1,1e308", "0,1"),
    "counts": ("", "abc", "1", "1,2", "1,2,3,4", "nan,1,1", "1,1,1e308", "0,1,1", "1.5,1,1"),
    "boolean": WORD,
    "choice": WORD,
    "color": ("", "abc", "nan", "1,2", "1,2,3,4", "256,0,0", "-1,0,0", "1e308,0,0", "1.5,0,0"),
    "address": ("", "abc", "nan", "1e308", "10.0.0.256", "10.0.0", "::1", "10.0.0.1/8"),
    "reference": ("", "nobody", "nan", "1e308"),
    "id": FREE,
    "free": FREE,
    "any": (),
    "polygon": ("", "abc", "1,1", "0,0 1,0", "0,0 1,0 1,nan", "0,0 1,0 1,1e308", "0,0 1,1 1,0 0,1"),
    "tags": ("", "abc", "5 6", "5 6 7 8", "5 6 x", "5 6 nan", "5 6 1e308", "5 6 65536", "5 6 -1"),
}

_KEYS: dict[str, str] = {
    "number": """length ticks_per_second random_seed vss_port threads max_rate noise_level rate
        data_size direction_angle wide_angle max_distance rotation_angle vs:memory vs:amount mass
        radius vs:update_every noise_std_dev vs:bias vs:drift vs:low vs:high vs:bits vs:latency
        height vs:drop_out vs:range vs:field_of_view vs:strength white_min_x white_min_y
        white_max_x white_max_y range loss_probability vs:max_messages vs:max_blobs intensity cell
        value evaporation diffusion initial quantity max_trials base_num its_port translate_x
        translate_y vs:tag port pixels_per_meter ats_port rab_range v_max tag distance""",
    "polygon": "polygon",
    "vector": """size center position orientation min max mean std_dev distances values grid_size
        positional_grid_size""",
    "boolean": """real_time show_rays movable vs:physical vs:virtual vs:angles vs:occlusions
        vs:fuse check_occlusions calibrated real_experiment""",
    "choice": """implementation formula vs:ring vs:update vs:obstacles vs:hear shape source method
        family format""",
    "reference": """field pollutant_entity radiation_entity vs:target vs:black medium config
        library path file""",
    "id": "id name",
    "free": "label its_host ats_host host",
    "color": "color",
    "counts": "layout",
    "share": "rotation_timestep",
    "address": "vss_host",
    "tags": "vs:tags",
}
KIND_OF: dict[str, str] = {
    **{key: kind for kind, keys in _KEYS.items() for key in keys.split()},
    "vs:zone size": "pair",
    "system method": "free",
    "params alpha": "any",
    "wheels speed": "any",
    "loop_functions door": "any",
    "open after": "any",
}
"""Kind of an attribute, by its key or by "element key"."""

_WITH_DEFAULT = """threads random_seed vss_host vss_port real_time implementation noise_level
    noise_std_dev rate max_rate name pollutant_entity direction_angle wide_angle max_distance
    rotation_angle label show_rays formula medium range data_size loss_probability
    check_occlusions center color value evaporation diffusion initial cell mass base_num family
    its_port translate_x grid_size translate_y positional_grid_size host port calibrated
    real_experiment rab_range ats_port"""
OPTIONAL = {
    *_WITH_DEFAULT.split(),
    *("system method", "params alpha", "wheels speed", "loop_functions door", "open after"),
    *("vs:marker height", "vs:zone orientation", "light orientation"),
    *("vs:geofence polygon", "vs:geofence v_max"),
}
"""Keys with a default, and "element key"; all of our own namespace have one, too."""

REQUIRED = ("position center", "virtual_black_white_location_sensor vs:black")
"""Attributes without a default all the same."""

DUPLICATES = {
    "my_controller id": None, "floor id": "trail", "vs:field id": "nest", "vs:zone id": "sun",
    "light id": "gate", "box id": "pillar", "cylinder id": "floor", "vs:object id": "lamp_23_0",
    "e-puck id": "sun", "dynamics2d id": "its", "iridia_tracking_system id": "dyn2d",
    "led id": "rab", "range_and_bearing id": "leds",
    "virtual_pheromone_actuator name": "led_color", "virtual_field_sensor name": "gps",
    "e-puck vs:tag": "23", "entity vs:tags": "5 6 23",
}  # fmt: skip
"""For every key that must be unique what another one has; None: there is only one of the kind."""

EXPECTATION = re.compile(
    r"expected|is not |there (is|are) |is the id of|is worn by|is no |known are|needs |is without"
)


class Attribute(NamedTuple):
    """One attribute of the file: where it stands and what it says."""

    element: str
    key: str
    value: str
    line: int
    start: int
    end: int

    @property
    def name(self) -> str:
        return f"{self.element} {self.key}"

    @property
    def kind(self) -> str:
        return KIND_OF[self.name] if self.name in KIND_OF else KIND_OF[self.key]

    def changed(self, text: str, value: str) -> str:
        return f'{text[: self.start]}{self.key}="{value}"{text[self.end :]}'


def attributes(text: str) -> list[Attribute]:
    """All attributes of a file but the declarations of namespaces."""
    found = []
    for tag in re.finditer(r"<([\w:-]+)((?:\s+[\w:]+=\"[^\"]*\")+)\s*/?>", text):
        for match in re.finditer(r"([\w:]+)=\"([^\"]*)\"", tag[2]):
            if not match[1].startswith("xmlns"):
                line = text.count("\n", 0, tag.start()) + 1
                at = tag.start(2)
                span = (at + match.start(), at + match.end())
                found.append(Attribute(tag[1], match[1], match[2], line, *span))
    return found


def mutants(text: str) -> Iterator[tuple[Attribute, str, str]]:
    """Every attribute with every broken value: the attribute, the value, the broken file."""
    for attribute in attributes(text):
        values = list(KINDS[attribute.kind])
        # What is distributed gets a number after its name: that is no duplicate.
        if DUPLICATES.get(attribute.name) and attribute.value not in ("swarm", "brick"):
            values.append(str(DUPLICATES[attribute.name]))
        for value in values:
            yield attribute, value, attribute.changed(text, value)


def elements(text: str) -> list[tuple[str, int, int]]:
    """All elements but the root: name, start and end in the text."""
    found, open_tags = [], []
    for tag in re.finditer(r"<(/?)([\w:-]+)[^>]*?(/?)>", text):
        if tag[1]:
            name, start = open_tags.pop()
            found.append((name, start, tag.end()))
        elif tag[3]:
            found.append((tag[2], tag.start(), tag.end()))
        else:
            open_tags.append((tag[2], tag.start()))
    return found[:-1]


def with_the_rest(full: str) -> str:
    """The file that uses everything, with what cannot stand beside some of it."""
    for old, new in (
        ('its_host="10.0.0.2" its_port="4040"', ""),
        ('vs:latency="0.05"', ""),
        ("</framework>", '<vs:tracker format="lines" host="0.0.0.0" port="4041" /></framework>'),
        ("</sensors>", '<vs:sensor file="own.py" /></sensors>'),
        ("</actuators>", '<vs:actuator file="act.py" /></actuators>'),
        ('source="image" path="floor.png"', 'source="loop_functions" pixels_per_meter="50"'),
        ("<virtual_rgb_ground_sensor", '<virtual_rgb_ground_sensor real_experiment="true"'),
        ("<epuck_proximity", '<epuck_proximity calibrated="true" noise_level="0.1"'),
        ('<e-puck id="leader"', '<e-puck id="leader" rab_range="0.8"'),
    ):
        assert old in full
        full = full.replace(old, new)
    return full


def by_motion_capture(full: str) -> str:
    """The same with a motion capture system, and a table of its bodies."""
    lines = '<vs:tracker format="lines" host="0.0.0.0" port="4041" />'
    mocap = '<vs:tracker format="mocap" type="vicon" bodies="a=1" up="y" settings="b=2" />'
    return with_the_rest(full).replace(lines, mocap)


def at_the_original(full: str) -> str:
    """The same with a tracker as the thesis names it."""
    text = full.replace('its_host="10.0.0.2" its_port="4040"', "").replace('vs:latency="0.05"', "")
    return text.replace("<framework>", '<framework ats_host="tracker" ats_port="4040">')
