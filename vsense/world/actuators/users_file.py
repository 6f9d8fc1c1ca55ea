"""An actuator of the user's own, from a Python file beside the experiment.

    <vs:actuator file="clicker.py" />

The file is written as those in this folder are (EXTENDING.md has one), but needs no `ELEMENTS`. Its
`from_xml` reads the other attributes; the quality settings are those of every actuator. An error in
it ends the run with the file's name and line.
"""

from __future__ import annotations

from vsense.base.xml.element import Element
from vsense.world.actuators.base import ActuatorError, VirtualActuator
from vsense.world.sensors.base import Scope, SensorError, layout_dtype
from vsense.world.sensors.quality import Scale
from vsense.world.sensors.users_file import device_of

ELEMENTS = ("vs:actuator",)

_MEMBERS = ("name", "layout", "scale", "apply")


def from_xml(element: Element, scope: Scope) -> VirtualActuator:
    """Makes the actuator from its element.

    Raises:
        ConfigError: there is no such file, a member is missing, or is of the wrong kind.
        ActuatorError: the user's code fails.
    """
    actuator = device_of(element, scope, ActuatorError, _MEMBERS, ("kernel",))
    if not isinstance(actuator.scale, Scale):
        given = f"{actuator.scale!r:.60}"
        raise element.error(f"scale is {given}, expected vsense.Scale(low=0.0, ...)", "file")
    try:
        layout_dtype(actuator.layout)
    except SensorError as error:
        raise element.error(str(error), "file") from None
    mounted: VirtualActuator = actuator
    return mounted
