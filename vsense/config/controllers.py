"""Reads `<controllers>`: what drives the robots, and which virtual sensors they carry."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from vsense.build import source_tree
from vsense.config import argos
from vsense.config.bodies import Bodies
from vsense.config.element import Element
from vsense.config.specs import ControllerSpec
from vsense.errors import UsageError
from vsense.link.table import Entry, Table
from vsense.native import WireError, lib
from vsense.sensors import registry
from vsense.sensors.base import MountedSensor, Scope


def used_controller(section: Element, bodies: Bodies) -> Element:
    """Finds the one controller that the robots name.

    Raises:
        ConfigError: a robot names one that is not there, or they name several.
    """
    known: dict[str, Element] = {}
    for element in section.children():
        name = element.text("id")
        if name in known:
            line = known[name].line
            raise element.error(f"{name!r} is the id of another controller, in line {line}", "id")
        known[name] = element
    used: dict[str, Element] = {}
    for robot, element in bodies.controllers.items():
        name = element.text("config")
        if name not in known:
            there = ", ".join(known) or "none"
            raise element.error(f"there is no controller {name!r}; there are: {there}", "config")
        used.setdefault(name, element)
        if len(used) > 1:
            other = next(iter(used))
            message = f"{robot!r} has {name!r}, others have {other!r}; expected one for all robots"
            raise element.error(message, "config")
    chosen = known[next(iter(used))]
    for element in known.values():
        if element is not chosen:
            element.leave_out("no robot uses it")
    return chosen


def read_controller(element: Element, folder: Path) -> ControllerSpec:
    """Reads what drives the robots.

    Args:
        element: the controller's element.
        folder: where a C source with a relative path is looked for.

    Raises:
        ConfigError: something in it is wrong.
    """
    library = _read_library(element, folder)
    _read_devices(element.optional_child("actuators"), argos.ROBOT_ACTUATORS, argos.ACTUATORS, ())
    params = element.optional_child("params")
    settings: dict[str, str] = {}
    if params is not None:
        _collect(params, "", settings)
    controller = ControllerSpec(element.text("id"), library, settings, element.line)
    size = len(controller.params_text.encode())
    if params is not None and size > lib.VS_PARAMS_MAX:
        raise params.error(f"has {size} bytes, expected at most {lib.VS_PARAMS_MAX}")
    return controller


def read_sensors(element: Element, scope: Scope) -> list[MountedSensor]:
    """Mounts the virtual sensors that a controller asks for.

    Raises:
        ConfigError: one of them is wrong, two have the same name, or a datagram does not hold
            them all.
    """
    section = element.optional_child("sensors")
    virtual = registry.factories()
    mounted: list[MountedSensor] = []
    for child in _read_devices(section, argos.ROBOT_SENSORS, argos.SENSORS, virtual):
        sensor = registry.mount(child, scope)
        for other in mounted:
            if other.sensor.name == sensor.sensor.name:
                name, line = sensor.sensor.name, other.line
                raise child.error(f"the sensor {name!r} is there already, in line {line}")
        mounted.append(sensor)
        _check_table(child, mounted)
    return mounted


def _check_table(element: Element, mounted: Collection[MountedSensor]) -> None:
    """Refuses the newest sensor where the robots' table has no room for it."""
    try:
        Table(Entry(i, m.sensor.name, m.sensor.layout) for i, m in enumerate(mounted, 1))
    except WireError as error:
        raise element.error(str(error)) from None


def _read_library(element: Element, folder: Path) -> str:
    """Reads which program it is; a library that was built for ARGoS runs on no robot."""
    library = element.text("library", None, "a shipped controller's name or the path of a .c file")
    try:
        source_tree().controller(library, folder)
    except UsageError as error:
        raise element.error(str(error), "library") from None
    except OSError as error:
        raise element.error(f"{library[:60]!r}: {error.strerror}", "library") from None
    return library


def _read_devices(
    section: Element | None,
    real: Collection[str],
    unsupported: Collection[str],
    virtual: Collection[str],
) -> list[Element]:
    """Reads the devices that robots have anyway; gives the virtual ones."""
    if section is None:
        return []
    found = section.children(*real, *virtual, *unsupported)
    for element in found:
        section.optional_child(element.name)
        if element.name in virtual:
            continue
        if element.name in real:
            _read_real_device(element)
        else:
            element.leave_out("the controller does not have it")
    return [element for element in found if element.name in virtual]


def _read_real_device(element: Element) -> None:
    element.text("implementation", "default")
    for key in argos.SIMULATED_SETTINGS:
        if element.has(key) and key.startswith("noise"):
            element.warn(f"{key}: the real one's own noise takes its place")


def _collect(element: Element, prefix: str, settings: dict[str, str]) -> None:
    """Flattens the user's own settings: an attribute of a child is called `child.key`.

    Raises:
        ConfigError: two settings have one name, or a value cannot stand in one line.
    """
    for key, value in element.free_attributes().items():
        if any(not character.isprintable() for character in value):
            raise element.error("holds a character that is not printable", key)
        if prefix + key in settings:
            raise element.error("is there twice", key)
        settings[prefix + key] = value
    for child in element.children():
        _collect(child, f"{prefix}{child.name}.", settings)
