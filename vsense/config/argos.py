"""Names that users of ARGoS write in experiment files and that are passed over with a warning.

A name that is neither here nor understood is taken for a misspelling and refused. Source: the
entities, devices, engines and media of ARGoS 3 and its e-puck plug-in, and IRIDIA's virtual
sensors.

A C++ library is built from its sources where they are found (`vsense.robots.finding`), or a port of
its name runs instead: `libforaging.so` becomes `foraging.c` or `foraging.cpp`, a file beside the
experiment or a shipped controller. Lua scripts run on the host.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from vsense.base.errors import ConfigError
from vsense.base.native import lib
from vsense.base.xml.element import Element
from vsense.robots.build import source_tree
from vsense.robots.sources import PROGRAM_SUFFIXES, ProgramSources
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.base import Scope
from vsense.world.sensors.quality import NOISES

ROBOTS = {
    "e-puck": "epuck", "foot-bot": "footbot", "kheperaiv": "kheperaiv", "pi-puck": "pipuck",
    "pipuck": "pipuck",
}  # fmt: skip
"""Elements that are robots here, and their models unless `vs:model` says another one."""
DISTRIBUTE = "distribute"

_OTHER_ROBOT = "driven here are e-pucks, foot-bots, Khepera IVs and Pi-Pucks"
_VIRTUAL_CAMERA = "the robots have none; <epuck_omnidirectional_camera> sees LEDs"
_VIRTUAL_MESSAGES = "the robots have none; <virtual_range_and_bearing_{}> gives them one"
_MISSING = "the robots have none: a controller that asks for it finds nothing"

ENTITIES = {
    **dict.fromkeys(("eye-bot", "kilobot", "spiri"), _OTHER_ROBOT),
    "camera_wall": "the cameras are those of the tracker",
    "gripper": "nothing is gripped here",
    "prototype": "only boxes and cylinders stand here",
}
"""Children of <arena> and <entity>, and why they are not in the arena."""


def others_in(section: Element) -> dict[str, str]:
    """Names of an arena's or an entity's children that are left out, and why: of `ENTITIES`, and
    robots of any other kind, which are those with a controller."""
    names = {child.name for child in section.below() if child.below("controller")}
    return {**ENTITIES, **dict.fromkeys(names - ROBOTS.keys(), _OTHER_ROBOT)}


def refuse_other_robots(arena: Element) -> None:
    """Raises ConfigError where an arena holds robots, and none of `ROBOTS`."""
    crowds = [crowd for place in arena.below(DISTRIBUTE) for crowd in place.below("entity")]
    robots: dict[str, list[tuple[Element, str]]] = {}
    for section in (arena, *crowds):
        others = others_in(section)
        for child in section.below():
            if child.name in ROBOTS:
                return
            if others.get(child.name) == _OTHER_ROBOT:
                many = "1" if section is arena else section.peek("quantity") or ""
                robots.setdefault(child.name, []).append((child, many))
    if robots:
        kinds = [_counted(name, [many for _, many in each]) for name, each in robots.items()]
        first, file = next(iter(robots.values()))[0][0], arena.document.file
        words = f"this file has {' and '.join(kinds)}: {_OTHER_ROBOT}"
        raise ConfigError(file, first.line, words)


def _counted(name: str, quantities: Sequence[str]) -> str:
    """How many robots of a kind there are; without the number where a quantity is no number."""
    if all(many.isdecimal() for many in quantities):
        return f"{sum(map(int, quantities))} <{name}>"
    return f"<{name}> robots"


EPUCK_SETTINGS = {
    "battery": ("text", "the real battery counts"),
    "vss_host": ("text", "all robots get the address of <experiment>"),
    "vss_port": ("number", "all robots get the address of <experiment>"),
}
"""Attributes of <e-puck> that only a simulated one obeys: their type, and what holds instead."""

EPUCK_PARTS = {
    "battery": "the real battery counts",
    "dynamics2d": "robots move in one plane, as the lab's own physics says",
}
"""Children of <e-puck> that only a simulated one has, and what holds instead."""


class OwnDevice(NamedTuple):
    """A robot's own device: its name for controllers, and whether only a board of it has it."""

    name: str
    board: bool = False


WHEELS = ("differential_steering", "epuck_wheels", "pipuck_differential_drive")
WHEEL_SENSORS = ("differential_steering", "epuck_encoder", "footbot_encoder",
                 "pipuck_differential_drive")  # fmt: skip
LAMPS = ("epuck_base_leds", "epuck_rgb_leds", "leds")
"""LEDs of the robot that others see with one of CAMERA_SENSORS."""

_LEDS = OwnDevice("LEDs")
_WHEELS = OwnDevice("wheels")

OWN_DEVICES: dict[str, dict[str, OwnDevice]] = {
    "sensors": {
        **dict.fromkeys(("battery", "epuck_battery"), OwnDevice("battery")),
        **dict.fromkeys(WHEEL_SENSORS, _WHEELS),
        "pipuck_system": OwnDevice("clock"),
        "epuck_accelerometer": OwnDevice("accelerometer"),
        **dict.fromkeys(
            (
                "epuck_ground",
                "footbot_base_ground",
                "footbot_motor_ground",
                "ground",
                "pipuck_ground",
            ),
            OwnDevice("ground", board=True),
        ),
        **dict.fromkeys(("epuck_light", "footbot_light", "light"), OwnDevice("light")),
        **dict.fromkeys(
            ("epuck_proximity", "footbot_proximity", "kheperaiv_proximity", "proximity"),
            OwnDevice("proximity"),
        ),
        **dict.fromkeys(
            ("epuck_range_and_bearing", "range_and_bearing"),
            OwnDevice("range_and_bearing", board=True),
        ),
    },
    "actuators": {
        **dict.fromkeys(WHEELS, _WHEELS),
        **dict.fromkeys((*LAMPS, "pipuck_leds"), _LEDS),
        **dict.fromkeys(
            ("epuck_range_and_bearing", "range_and_bearing"), OwnDevice("message", board=True)
        ),
    },
}
"""By section what robots have of their own for a device of ARGoS. Those that are read are real, so
their simulation is not set up."""

_INSTEAD = "vs:virtual='true' or --virtual-devices"
BOARD_HINT = f"is the robot's own, where it has that board; {_INSTEAD} makes it virtual"
VIRTUAL_ONLY = f"the robots have none; {_INSTEAD} gives them one"
"""Said of devices of ARGoS that are not mounted as virtual ones."""

PROXIMITY_SENSORS = ("epuck_proximity", "footbot_proximity", "proximity")
"""Devices for which the robots' own ring is as good, except where it is simulated with noise."""

STEERING_NOISE = {
    "bias_m_s": "bias_avg",
    "bias_dev_m_s": "bias_stddev",
    "factor": "factor_avg",
    "factor_dev": "factor_stddev",
}
"""Fields of `WheelNoise` and the attributes of <differential_steering>."""

BATTERIES = ("battery", "epuck_battery")
"""Devices that robots in the lab have, too."""

CAMERA_SENSORS = ("colored_blob_omnidirectional_camera", "epuck_omnidirectional_camera")

USING_SETTINGS = frozenset((*CAMERA_SENSORS, "range_and_bearing"))
"""Devices for which a robot's element has settings."""

IMPLEMENTATIONS = ("default", "medium", "real_robot", "rot_z_only")
"""How ARGoS may do what a device does."""

MISSING: dict[str, dict[str, str]] = {
    "sensors": {
        **dict.fromkeys(
            ("virtual_range_and_bearing", "epuck_ircom"), _VIRTUAL_MESSAGES.format("sensor")
        ),
        **dict.fromkeys(
            ("colored_blob_perspective_camera", "epuck_camera", "epuck_virtual_camera",
             "pipuck_front_camera"),
            _VIRTUAL_CAMERA,
        ),
        **dict.fromkeys(
            ("eyebot_light", "eyebot_proximity", "footbot_distance_scanner", "footbot_gripper",
             "footbot_turret_encoder", "footbot_wheel_speed", "kheperaiv_camera",
             "kheperaiv_encoder", "kheperaiv_ground", "kheperaiv_lidar", "kheperaiv_light",
             "kheperaiv_ultrasound", "pipuck_imu", "radios", "simple_radios"),
            _MISSING,
        ),
    },
    "actuators": {
        "epuck_ircom": _VIRTUAL_MESSAGES.format("actuator"),
        **dict.fromkeys(
            ("footbot_beacon", "footbot_distance_scanner", "footbot_gripper", "footbot_turret",
             "gripper", "kheperaiv_gripper", "magnets", "quadrotor_position", "quadrotor_speed",
             "radios", "simple_radios"),
            _MISSING,
        ),
    },
}  # fmt: skip
"""By section the devices that nobody serves, and what there is instead."""

SIMULATED_SETTINGS = {
    "calibrated": ("boolean", "the robot's own readings are raw"),
    "check_occlusions": ("boolean", ""),
    "data_size": ("number", ""),
    "loss_probability": ("number", ""),
    "low_level_config": ("text", "the robot's own readings are raw"),
    "noise_level": ("number", "the real one's own noise takes its place"),
    "noise_std_dev": ("number", "the real one's own noise takes its place"),
    "range": ("number", ""),
    "show_rays": ("boolean", ""),
}
"""Attributes of the robots' own devices that only a simulated one obeys: their type, and what
holds instead; "" where nothing that a user could miss is lost."""

SIMULATED_WHEELS = {
    f"{key}{wheel}": ("any", "the real one's own noise takes its place")
    for key in STEERING_NOISE.values()
    for wheel in ("", "_left", "_right")
}
"""Attributes of the wheels, likewise."""

ORIGINAL_SETTINGS = {
    "real_experiment": ("boolean", "`vsense run` is the real experiment, `vsense sim` is not"),
    "sensor_model_file": ("text", "the element itself holds the model's settings"),
    "show_rays": ("boolean", ""),
}
"""Attributes of IRIDIA's virtual sensors: their type, and what takes their place; "": nothing."""

HEARING = "virtual_range_and_bearing_sensor"
ARGOS_HEARING = ("epuck_range_and_bearing", "range_and_bearing")
"""Virtual sensors for which a medium decides whether bodies are in the way."""

NOISE = (
    *NOISES, "loss_probability", "packet_drop_prob", "real_range_noise", *STEERING_NOISE.values(),
)  # fmt: skip
"""Attributes that make a device worse."""

PHYSICS_ENGINES = ("dynamics3d", "pointmass3d", "static")
"""Children of <physics_engines> beside <dynamics2d> and the tracking system."""

MEDIA = ("led", "range_and_bearing")
"""Children of <media> whose ids lights and devices may name."""

OTHER_MEDIA = ("directional_led", "radio", "simple_radio", "tag")
"""Children of <media> that carry nothing here."""

_MAX_NUMBER = 1e6


def pass_over(element: Element, settings: Mapping[str, tuple[str, str]]) -> None:
    """Checks attributes that are not used here, and says what holds instead.

    `settings` has by attribute its type ("boolean", "number" or "text") and the words; "" says
    nothing.
    """
    for key, (kind, instead) in settings.items():
        if not element.has(key):
            continue
        if kind == "boolean":
            element.boolean(key)
        elif kind == "number":
            element.number(key, 0.0, _MAX_NUMBER)
        if instead:
            element.warn(f"{key} is not used: {instead}")


_RINGS = ("footbot_light", "kheperaiv_proximity", "light", *PROXIMITY_SENSORS)
_NUMBER_BYTES, _OTHER_BYTES, _STAMP_BYTES, _BLOB = 4, 64, 8, 5
_OWN_BYTES = 304
"""Of a number, of a device that is no ring, and of what belongs to each on the wire, at most;
numbers of an LED; of all own devices of a robot, see `vsense.run.remote`."""


def share_room(names: Sequence[str], scope: Scope, is_sim: bool) -> None:
    """Gives lists of neighbours what other devices leave of a datagram, each at least a half if it
    needs it; `names` are the elements. An e-puck's have as much room as ever. Where controllers on
    the host drive robots, these have devices of their own, too."""
    model = scope.robots.model
    scope.heard_bytes = scope.seen_bytes = 0
    lists = ARGOS_HEARING, CAMERA_SENSORS
    hears, sees = (any(name in kind for name in names) for kind in lists)
    if model == EPUCK or not (hears or sees):
        return
    ring = _NUMBER_BYTES * max(len(model.infrared.angles_rad), len(model.infrared.lines_m))
    others = [name for name in names if name not in (*lists[0], *lists[1])]
    taken = sum(ring if name in _RINGS else _OTHER_BYTES for name in others)
    room: int = lib.VS_SENSOR_BYTES - taken - len(names) * _STAMP_BYTES
    room -= 0 if is_sim else _OWN_BYTES
    heard = _NUMBER_BYTES * (2 + scope.robots.message_bytes) * scope.most if hears else 0
    seen = _NUMBER_BYTES * _BLOB * (scope.leds + 1) if sees else 0
    scope.heard_bytes = max(min(heard, max(room // 2, room - seen)), _OTHER_BYTES)
    scope.seen_bytes = max(room - scope.heard_bytes if hears else room, _OTHER_BYTES)


PORTING_PAGE = "robot/README.md, 'Porting an ARGoS controller'"
"""Where porting is explained."""

STAND_STILL = "stand_still"
"""The shipped controller that drives robots whose own program cannot run here."""

LUA = "lua_controller"
"""Element of a controller that is a Lua script."""

_LIBRARY = re.compile(r"(?:.*/)?(?:lib([^/]+?)(?:\.so|\.dylib)?|([^/]+)(?:\.so|\.dylib))")


def is_built_for_argos(library: str) -> bool:
    """Whether a name is that of a compiled C++ library, as ARGoS takes it.

    ARGoS adds the suffix where it is missing, so `build/libforaging` is one, too.
    """
    return _LIBRARY.fullmatch(library) is not None


def is_for_argos(controller: Element, named: tuple[str, ProgramSources]) -> bool:
    """Whether a controller is C++ or Lua for ARGoS, without a port in its place.

    What it declares is meant as ARGoS means it, also where its sources are not found and robots
    stand still.
    """
    library, program = named
    written = controller.peek("library") or ""
    stands = library == STAND_STILL and is_built_for_argos(written)
    return program.is_argos or program.is_lua or stands


def ported_controller(library: str, folder: Path) -> str | None:
    """Finds a controller's port, a source beside the experiment file.

    A C++ file of that name may be what ARGoS's library was built from: a port names the variable
    `vs_controller`.
    """
    stem = _stem(library)
    for name in (f"{stem}{suffix}" for suffix in PROGRAM_SUFFIXES):
        path = folder / name
        if os.path.isfile(path) and (path.suffix == ".c" or b"vs_controller" in path.read_bytes()):
            return name
    return None


def shipped_controller(library: str) -> str | None:
    """Finds a controller's port among the shipped ones."""
    stem = _stem(library)
    return stem if stem in source_tree().controllers() else None


def ported_loop_functions(library: str, folder: Path) -> Path | None:
    """Finds the port of loop functions: a Python file beside the experiment file."""
    path = folder / f"{_stem(library)}.py"
    return path if os.path.isfile(path) else None


def _stem(library: str) -> str:
    match = _LIBRARY.fullmatch(library)
    assert match is not None
    return match[1] or match[2]
