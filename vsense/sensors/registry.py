"""Finds the virtual sensors: every module in this folder that names XML elements is one."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from functools import cache

import vsense.sensors
from vsense.config.element import Element
from vsense.sensors.base import MountedSensor, Scope, SensorError, VirtualSensor

Factory = Callable[[Element, Scope], VirtualSensor]

_MAX_UPDATE_EVERY = 100_000


@cache
def factories() -> dict[str, Factory]:
    """Gives what makes a sensor, by the name of its XML element.

    Raises:
        SensorError: two modules claim the same element.
    """
    found: dict[str, Factory] = {}
    for module_info in pkgutil.iter_modules(vsense.sensors.__path__):
        module = importlib.import_module(f"vsense.sensors.{module_info.name}")
        for element_name in getattr(module, "ELEMENTS", ()):
            if element_name in found:
                raise SensorError(f"{module.__name__}: <{element_name}> has a sensor already")
            found[element_name] = module.from_xml
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
    update_every = element.integer("vs:update_every", 1, _MAX_UPDATE_EVERY, 1)
    return MountedSensor(factories()[element.name](element, scope), update_every, element.line)
