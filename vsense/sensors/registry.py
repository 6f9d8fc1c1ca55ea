"""Finds virtual devices: every module of a folder that names XML elements is one.

This folder holds the sensors, `vsense.actuators` the actuators. A new device is one new file.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import ModuleType
from typing import Any

import vsense.sensors
from vsense.errors import VsenseError
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
from vsense.xml.element import Element


def device_factories(package: ModuleType, error: type[VsenseError]) -> dict[str, Any]:
    """Gives what makes a device, by the name of its XML element.

    Args:
        package: the folder; a device's module holds `ELEMENTS`, the names of its XML elements,
            and `from_xml(element, scope)`.
        error: what to raise.

    Raises:
        error: two modules claim the same element.
    """
    found: dict[str, Any] = {}
    for module_info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        for element_name in getattr(module, "ELEMENTS", ()):
            if element_name in found:
                raise error(f"{module.__name__}: <{element_name}> is another module's")
            found[element_name] = module.from_xml
    return found


@cache
def factories() -> dict[str, Callable[[Element, Scope], VirtualSensor]]:
    """Gives what makes a sensor, by the name of its XML element; errors of `device_factories`."""
    return device_factories(vsense.sensors, SensorError)


def mount(element: Element, scope: Scope) -> MountedSensor:
    """Makes the sensor that an element asks for.

    Args:
        element: an element whose name is one of `factories()`.
        scope: what it may refer to.
    """
    element.choice("implementation", ("default",), "default")
    sensor = factories()[element.name](element, scope)
    try:
        layout_dtype(sensor.layout)
    except SensorError as error:
        raise element.error(str(error)) from None
    quality = Quality.from_xml(element, scale_of(sensor))
    condition, every = updating.from_xml(element, sensor, quality.update_every)
    return MountedSensor(sensor, element.line, replace(quality, update_every=every), condition)
