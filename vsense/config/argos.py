"""Names that users of ARGoS write in experiment files and that are passed over with a warning.

A name that is neither here nor understood is taken for a misspelling and refused. Source: the
entities, devices, engines and media of ARGoS 3 and its e-puck plug-in, and IRIDIA's virtual
sensors.

C++ libraries and Lua scripts run on no robot here. The port of a library has its name:
`libforaging.so` becomes `foraging.c` or `foraging.cpp`, a shipped controller or a file beside the
experiment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from vsense.robot.build import source_tree
from vsense.robot.compiling import SUFFIXES
from vsense.xml.element import Element

_OTHER_ROBOT = "only e-pucks are driven here"
_VIRTUAL_CAMERA = "the robots have none; <virtual_led_sensor> sees virtual LEDs"
_VIRTUAL_GROUND = "the robots have none; <virtual_ground_sensor> gives them one"
_VIRTUAL_MESSAGES = "the robots have none; <virtual_range_and_bearing_{}> gives them one"
_MISSING = "the robots have none: a controller that asks for it finds nothing"

ENTITIES = {
    **dict.fromkeys(
        ("eye-bot", "foot-bot", "kheperaiv", "kilobot", "pipuck", "spiri"), _OTHER_ROBOT
    ),
    "camera_wall": "the cameras are those of the tracker",
    "gripper": "nothing is gripped here",
    "prototype": "only boxes and cylinders stand here",
}
"""Children of <arena> and <entity>, and why they are not in the arena."""

EPUCK_SETTINGS = {
    "battery": ("text", "the real battery counts"),
    "omnidirectional_camera_aperture": ("number", "these robots have no such camera"),
    "rab_data_size": ("number", "sensor and actuator say how long the virtual messages are"),
    "rab_range": ("number", "their sensor says how far virtual messages reach"),
    "vss_host": ("text", "all robots are told the address of <experiment>"),
    "vss_port": ("number", "all robots are told the address of <experiment>"),
}
"""Attributes of <e-puck> that only a simulated one obeys: their type, and what holds instead."""

EPUCK_PARTS = {
    "battery": "the real battery counts",
    "dynamics2d": "robots move in one plane, as the lab's own physics says",
}
"""Children of <e-puck> that only a simulated one has, and what holds instead."""

ROBOT_SENSORS = ("epuck_light", "epuck_proximity", "light", "proximity")
"""Sensors that every e-puck has: the real ones are read, so their simulation is not set up."""

ROBOT_ACTUATORS = (
    "differential_steering", "epuck_base_leds", "epuck_rgb_leds", "epuck_wheels", "leds",
)  # fmt: skip
"""Actuators that every e-puck has."""

IMPLEMENTATIONS = ("default", "medium", "real_robot", "rot_z_only")
"""How ARGoS may do what a device does; here the robot's own device does it."""

SENSORS = {
    **dict.fromkeys(("base_ground", "epuck_base_ground", "epuck_ground", "ground"),
                    _VIRTUAL_GROUND),
    **dict.fromkeys(("footbot_base_ground", "footbot_motor_ground"), _VIRTUAL_GROUND),
    **dict.fromkeys(("epuck_range_and_bearing", "range_and_bearing"),
                    _VIRTUAL_MESSAGES.format("sensor")),
    **dict.fromkeys(("virtual_range_and_bearing", "epuck_ircom"),
                    _VIRTUAL_MESSAGES.format("sensor")),
    **dict.fromkeys(("colored_blob_omnidirectional_camera", "colored_blob_perspective_camera",
                     "epuck_camera", "epuck_omnidirectional_camera", "epuck_virtual_camera"),
                    _VIRTUAL_CAMERA),
    **dict.fromkeys(("epuck_battery", "battery"),
                    "controllers ask for 'battery_low'"),
    "epuck_encoder": "controllers ask for 'wheels', the way since the start in cm",
    "epuck_accelerometer": "controllers ask for 'accelerometer', raw",
    "positioning": "the robots have none; <gps_virtual_sensor> gives them one",
    **dict.fromkeys(
        ("differential_steering", "eyebot_light",
         "eyebot_proximity", "footbot_distance_scanner", "footbot_gripper", "footbot_light",
         "footbot_proximity", "footbot_turret_encoder", "footbot_wheel_speed", "radios"),
        _MISSING,
    ),
}  # fmt: skip
"""Children of <sensors> that are not on the robots, and what there is instead."""

ACTUATORS = {
    **dict.fromkeys(("epuck_range_and_bearing", "range_and_bearing", "epuck_ircom"),
                    _VIRTUAL_MESSAGES.format("actuator")),
    **dict.fromkeys(
        ("footbot_beacon", "footbot_gripper", "footbot_turret", "gripper", "magnets",
         "quadrotor_position", "quadrotor_speed", "radios"),
        _MISSING,
    ),
}  # fmt: skip
"""Children of <actuators> that are not on the robots, and what there is instead."""

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

ORIGINAL_SETTINGS = {
    "real_experiment": ("boolean", "`vsense run` is the real experiment, `vsense sim` is not"),
    "sensor_model_file": ("text", "the element itself holds the model's settings"),
    "show_rays": ("boolean", ""),
}
"""Attributes of IRIDIA's virtual sensors: their type, and what takes their place; "": nothing."""

HEARING = "virtual_range_and_bearing_sensor"
"""The virtual sensor for which a medium decides whether bodies are in the way."""

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


PAGE = "robot/README.md, 'Porting an ARGoS controller'"
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


def ported_controller(library: str, folder: Path) -> str | None:
    """Finds a controller's port: a shipped one, a source beside the experiment file, or None.

    A C++ file of that name may be what ARGoS's library was built from: a port names the variable
    `vs_controller`.
    """
    stem = _stem(library)
    if stem in source_tree().controllers():
        return stem
    for name in (f"{stem}{suffix}" for suffix in SUFFIXES):
        path = folder / name
        if path.is_file() and (path.suffix == ".c" or b"vs_controller" in path.read_bytes()):
            return name
    return None


def ported_loop_functions(library: str, folder: Path) -> Path | None:
    """Finds the port of loop functions: a Python file beside the experiment file."""
    path = folder / f"{_stem(library)}.py"
    return path if path.is_file() else None


def _stem(library: str) -> str:
    match = _LIBRARY.fullmatch(library)
    assert match is not None
    return match[1] or match[2]
