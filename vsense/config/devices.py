"""Reads a controller's `<sensors>` and `<actuators>`: the robots' own devices, and virtual ones."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from vsense.actuators import registry as actuator_registry
from vsense.actuators.base import MountedActuator
from vsense.config import argos
from vsense.config.element import Element
from vsense.config.media import Media, check_medium
from vsense.link.table import Direction, Entry, Table
from vsense.native import WireError
from vsense.sensors import registry as sensor_registry
from vsense.sensors.base import MountedSensor, Scope

SENSORS = "sensors"
ACTUATORS = "actuators"


def virtual_devices() -> dict[str, Collection[str]]:
    """Gives the elements of all virtual devices, by the element that holds them."""
    return {
        SENSORS: sensor_registry.factories().keys(),
        ACTUATORS: actuator_registry.factories().keys(),
    }


def read_devices(
    controller: Element, scope: Scope, media: Media
) -> tuple[list[MountedSensor], list[MountedActuator]]:
    """Mounts the virtual sensors and actuators that a controller asks for.

    Args:
        controller: its element.
        scope: what they may refer to; sensors add their sources to it.
        media: what they may refer to, too.

    Raises:
        ConfigError: one of them is wrong, two have the same name, or a datagram does not hold
            them all.
    """
    virtual = virtual_devices()
    sensors: list[MountedSensor] = []
    actuators: list[MountedActuator] = []
    entries: dict[str, tuple[Entry, int]] = {}
    section = controller.optional_child(SENSORS)
    for element in _virtual(section, argos.ROBOT_SENSORS, argos.SENSORS, virtual[SENSORS], media):
        sensor = sensor_registry.mount(element, scope)
        _add_entry(entries, element, sensor.sensor.name, sensor.sensor.layout, Direction.SENSOR)
        sensors.append(sensor)
    section = controller.optional_child(ACTUATORS)
    for element in _virtual(
        section, argos.ROBOT_ACTUATORS, argos.ACTUATORS, virtual[ACTUATORS], media
    ):
        actuator = actuator_registry.mount(element, scope)
        name, layout = actuator.actuator.name, actuator.actuator.layout
        _add_entry(entries, element, name, layout, Direction.ACTUATOR)
        actuators.append(actuator)
    return sensors, actuators


def _add_entry(
    entries: dict[str, tuple[Entry, int]],
    element: Element,
    name: str,
    layout: str,
    way: Direction,
) -> None:
    """Notes a device and its line in the robots' table.

    Raises:
        ConfigError: its name is there already, or the table has no room for it.
    """
    if name in entries:
        entry, line = entries[name]
        kind = entry.direction.name.lower()
        message = f"the {kind} {name!r} is there already, in line {line}; expected another name"
        raise element.error(message)
    entries[name] = (Entry(len(entries) + 1, name, layout, way), element.line)
    try:
        Table(entry for entry, _ in entries.values())
    except WireError as error:
        raise element.error(str(error)) from None


def _virtual(
    section: Element | None,
    real: Collection[str],
    unsupported: Mapping[str, str],
    virtual: Collection[str],
    media: Media,
) -> list[Element]:
    """Reads the devices that robots have anyway; gives the virtual ones."""
    if section is None:
        return []
    found = section.children(*real, *virtual, *unsupported)
    for element in found:
        if element.name in virtual:
            argos.pass_over(element, argos.ORIGINAL_SETTINGS)
            check_medium(element, media)
        elif element.name in real:
            section.optional_child(element.name)
            check_medium(element, media)
            _read_real_device(element)
        else:
            element.leave_out(unsupported[element.name])
    return [element for element in found if element.name in virtual]


def _read_real_device(element: Element) -> None:
    element.choice("implementation", argos.IMPLEMENTATIONS, "default")
    argos.pass_over(element, argos.SIMULATED_SETTINGS)
