"""Makes the virtual actuators: every module in this folder that names XML elements is one."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import vsense.actuators
from vsense import devices
from vsense.actuators.base import ActuatorError, MountedActuator, VirtualActuator
from vsense.sensors.base import Scope
from vsense.sensors.quality import Quality
from vsense.xml.element import Element

Factory = Callable[[Element, Scope], VirtualActuator]


@cache
def factories() -> dict[str, Factory]:
    """Gives what makes an actuator, by the name of its XML element.

    Raises:
        ActuatorError: two modules claim the same element.
    """
    found: dict[str, Factory] = devices.factories(vsense.actuators, ActuatorError)
    return found


def mount(element: Element, scope: Scope) -> MountedActuator:
    """Makes the actuator that an element asks for.

    Args:
        element: an element whose name is one of `factories()`.
        scope: what it may refer to; the sensors have added their pollutant sources.

    Raises:
        ConfigError: an attribute is wrong.
    """
    element.choice("implementation", ("default",), "default")
    actuator = factories()[element.name](element, scope)
    return MountedActuator(actuator, element.line, Quality.from_xml(element, actuator.scale))
