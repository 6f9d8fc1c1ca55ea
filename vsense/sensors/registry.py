"""Finds the virtual sensors: every module in this folder that names XML elements is one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import vsense.sensors
from vsense import devices
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

Factory = Callable[[Element, Scope], VirtualSensor]


@cache
def factories() -> dict[str, Factory]:
    """Gives what makes a sensor, by the name of its XML element.

    Raises:
        SensorError: two modules claim the same element.
    """
    found: dict[str, Factory] = devices.factories(vsense.sensors, SensorError)
    return found


def mount(element: Element, scope: Scope) -> MountedSensor:
    """Makes the sensor that an element asks for.

    Args:
        element: an element whose name is one of `factories()`.
        scope: what it may refer to.

    Raises:
        ConfigError: an attribute is wrong.
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
