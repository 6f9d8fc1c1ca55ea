"""Reads `<controllers>`: what drives the robots, their own devices, and their virtual ones.

Every module in `vsense/sensors/` and `vsense/actuators/` that names XML elements is a virtual
device: it holds `ELEMENTS`, the names, and `from_xml(element, scope)`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import vsense.actuators
import vsense.sensors
from vsense.actuators.base import ActuatorError, MountedActuator, VirtualActuator
from vsense.config import argos
from vsense.config.framework import collect
from vsense.config.robots import ArenaContents
from vsense.config.specs import ControllerSpec
from vsense.config.things import Media, by_id, check_medium
from vsense.errors import UsageError
from vsense.link.robots.table import Direction, Entry, Table
from vsense.native import WireError, lib
from vsense.robot.build import source_tree
from vsense.sensors import updating
from vsense.sensors.base import (
    MountedSensor,
    Scope,
    SensorError,
    VirtualSensor,
    layout_dtype,
    scale_of,
)
from vsense.sensors.quality import Quality
from vsense.xml.element import Element, shown

SENSORS = "sensors"
ACTUATORS = "actuators"

_KINDS = {SENSORS: (vsense.sensors, SensorError), ACTUATORS: (vsense.actuators, ActuatorError)}

Factory = Callable[[Element, Scope], Any]
"""Makes a `VirtualSensor` or a `VirtualActuator`."""


@cache
def factories(section: str) -> dict[str, Factory]:
    """Gives what makes a virtual device of a section, by the name of its XML element.

    Raises:
        SensorError, ActuatorError: two modules claim the same element.
    """
    package, error = _KINDS[section]
    found: dict[str, Factory] = {}
    for module_info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        for name in getattr(module, "ELEMENTS", ()):
            if name in found:
                raise error(f"{module.__name__}: <{name}> is another module's")
            found[name] = module.from_xml
    return found


def virtual_devices() -> dict[str, Collection[str]]:
    """Gives the elements of all virtual devices, by the element that holds them."""
    return {section: factories(section).keys() for section in _KINDS}


def mount_sensor(element: Element, scope: Scope) -> MountedSensor:
    """Makes the sensor that an element of `factories(SENSORS)` asks for."""
    element.choice("implementation", ("default",), "default")
    sensor = factories(SENSORS)[element.name](element, scope)
    try:
        layout_dtype(sensor.layout)
    except SensorError as error:
        raise element.error(str(error)) from None
    quality = Quality.from_xml(element, scale_of(sensor))
    condition, every = updating.from_xml(element, sensor, quality.update_every)
    return MountedSensor(sensor, element.line, replace(quality, update_every=every), condition)


def mount_actuator(element: Element, scope: Scope) -> MountedActuator:
    """Makes an actuator; the sensors have added their pollutant sources to `scope`."""
    element.choice("implementation", ("default",), "default")
    actuator = factories(ACTUATORS)[element.name](element, scope)
    return MountedActuator(actuator, element.line, Quality.from_xml(element, actuator.scale))


class Devices(NamedTuple):
    """The virtual sensors and actuators of a controller."""

    sensors: list[MountedSensor]
    actuators: list[MountedActuator]


def read_devices(controllers: Sequence[Element], scope: Scope, media: Media) -> list[Devices]:
    """Mounts the virtual sensors and actuators that each controller asks for.

    They may refer to `scope`, to which sensors add their sources, and to `media`. Those of one
    controller must have different names, and a datagram must hold them all.
    """
    mounting = [(controller, Devices([], []), _Entries()) for controller in controllers]
    for controller, devices, entries in mounting:
        for element in _virtual(controller, SENSORS, argos.ROBOT_SENSORS, argos.SENSORS, media):
            devices.sensors.append(mount_sensor(element, scope))
            _add_entry(entries, element, devices.sensors[-1].sensor, Direction.SENSOR)
    # They may act on what another controller's sensors have added to the world.
    real, unsupported = argos.ROBOT_ACTUATORS, argos.ACTUATORS
    for controller, devices, entries in mounting:
        for element in _virtual(controller, ACTUATORS, real, unsupported, media):
            devices.actuators.append(mount_actuator(element, scope))
            _add_entry(entries, element, devices.actuators[-1].actuator, Direction.ACTUATOR)
    return [devices for _, devices, _ in mounting]


_Entries = dict[str, tuple[Entry, int]]
"""Rows of a sensor table and their lines, by name."""


def _add_entry(
    entries: _Entries,
    element: Element,
    device: VirtualSensor | VirtualActuator,
    way: Direction,
) -> None:
    """Notes a device and its line in the robots' table, where it has a name and room."""
    name = device.name
    if name in entries:
        entry, line = entries[name]
        kind = entry.direction.name.lower()
        message = f"the {kind} {name!r} is there already, in line {line}; expected another name"
        raise element.error(message)
    entries[name] = (Entry(len(entries) + 1, name, device.layout, way), element.line)
    try:
        Table(entry for entry, _ in entries.values())
    except WireError as error:
        raise element.error(str(error)) from None


def _virtual(
    controller: Element,
    kind: str,
    real: Collection[str],
    unsupported: Mapping[str, str],
    media: Media,
) -> list[Element]:
    """Reads the devices of a kind that robots have anyway; gives the virtual ones."""
    section = controller.optional_child(kind)
    if section is None:
        return []
    virtual = factories(kind)
    found = section.children(*real, *virtual, *unsupported)
    for element in found:
        if element.name in virtual:
            argos.pass_over(element, argos.ORIGINAL_SETTINGS)
            check_medium(element, media)
        elif element.name in real:
            section.optional_child(element.name)
            check_medium(element, media)
            element.choice("implementation", argos.IMPLEMENTATIONS, "default")
            argos.pass_over(element, argos.SIMULATED_SETTINGS)
        else:
            element.leave_out(unsupported[element.name])
    return [element for element in found if element.name in virtual]


def used_controllers(section: Element, bodies: ArenaContents) -> list[Element]:
    """Finds the controllers that robots name; the others are left out."""
    known = by_id(section.children(), "controller")
    used = set[str]()
    for element in bodies.controllers.values():
        name = element.text("config")
        if name not in known:
            there = ", ".join(known) or "none"
            raise element.error(f"there is no controller {name!r}; there are: {there}", "config")
        used.add(name)
    for name, element in known.items():
        if name not in used:
            element.leave_out("no robot uses it")
    return [element for name, element in known.items() if name in used]


def read_controller(element: Element, folder: Path, devices: Devices) -> ControllerSpec:
    """Reads which program drives robots with these devices, and its parameters.

    A source with a relative path is looked for in `folder`.
    """
    library, source = _read_library(element, folder)
    params = element.optional_child("params")
    settings = {} if params is None else collect(params, {})
    if library == argos.STAND_STILL:
        settings = {}
    controller = ControllerSpec(
        id=element.text("id"),
        label=element.name,
        library=library,
        sources=(source,),
        includes=(),
        params=settings,
        sensors=tuple(devices.sensors),
        actuators=tuple(devices.actuators),
        line=element.line,
    )
    size = len(controller.params_text.encode())
    if params is not None and size > lib.VS_PARAMS_MAX:
        raise params.error(f"has {size} bytes, expected at most {lib.VS_PARAMS_MAX}")
    return controller


def _read_library(element: Element, folder: Path) -> tuple[str, Path]:
    """Reads which program it is, and finds its source."""
    library = _program(element, folder)
    try:
        return library, source_tree().controller(library, folder)
    except UsageError as error:
        raise element.error(str(error), "library") from None
    except OSError as error:
        raise element.error(f"{shown(library)}: {error.strerror}", "library") from None


def _program(element: Element, folder: Path) -> str:
    """The name or path of a controller's program; that of one for ARGoS is its port's."""
    if element.name == argos.LUA and not element.has("library"):
        element.warn(f"is Lua, which runs on no robot: they stand still; see {argos.PAGE}")
        return argos.STAND_STILL
    expected = "a shipped controller's name or the path of a .c or .cpp file"
    library = element.text("library", None, expected)
    if argos.is_built_for_argos(library):
        port = argos.ported_controller(library, folder)
        if port is None:
            instead = f"the robots stand still; port it, see {argos.PAGE}"
            element.warn(f"library: {shown(library)} is C++ for ARGoS, not for robots: {instead}")
            return argos.STAND_STILL
        element.warn(
            f"library: {shown(library)} is C++ for ARGoS: its port {port!r} is run instead"
        )
        return port
    return library
