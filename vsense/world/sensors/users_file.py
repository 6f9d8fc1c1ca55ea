"""A sensor of the user's own, from a Python file beside the experiment.

    <vs:sensor file="crowd.py" reach="0.3" noise_level="1" />

The file is written as those in this folder are (README.md shows how), but needs no `ELEMENTS`. Its
`from_xml` reads the other attributes; the quality settings and the updating condition are those of
every sensor. An error in it ends the run with the file's name and line.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Sequence
from typing import Any

from vsense.base.errors import ConfigError, VsenseError, likely
from vsense.base.users_code import UsersCode, line_of
from vsense.base.xml.element import Element
from vsense.world.sensors.base import Scope, SensorError, VirtualSensor

ELEMENTS = ("vs:sensor",)

_MEMBERS = ("name", "layout", "read")
_FURTHER = ("changed", "tidy", "kernel")


class UsersDevice:
    """A user's device; what goes wrong in its functions becomes an error that names the file.

    `place` is where the function `main` stands, for what is said of its values.
    """

    def __init__(self, device: Any, code: UsersCode, main: str) -> None:
        self._device = device
        self._code = code
        self.place = f"{code.file}:{line_of(getattr(device, main))}: "

    def __getattr__(self, key: str) -> Any:
        # Private names are never the user's; asking for them while this object is copied must end.
        if key.startswith("_"):
            raise AttributeError(key)
        value = getattr(self._device, key)
        return _guarded(value, self._code) if callable(value) else value


def from_xml(element: Element, scope: Scope) -> VirtualSensor:
    """Makes the sensor from its element; raises as `device_of`, here SensorError."""
    sensor: VirtualSensor = device_of(element, scope, SensorError, _MEMBERS, _FURTHER)
    return sensor


def device_of(
    element: Element,
    scope: Scope,
    kind: type[VsenseError],
    members: Sequence[str],
    further: Sequence[str],
) -> Any:
    """Makes a device of the file that an element names.

    Args:
        kind: of the errors of the user's code.
        members: what it must have, its main function last.
        further: functions that it may have.

    Raises:
        ConfigError: there is no such file, it has no `from_xml`, or a member is missing.
        VsenseError: of this kind: the user's code fails, or a function's name is misspelt.
    """
    path = scope.folder / element.text("file", None, "a Python file")
    if not os.path.isfile(path):
        raise element.error(f"there is no file {str(path)!r}", "file")
    code = UsersCode(path, lambda file, line, message: kind(f"{file}:{line}: {message}"))
    module = code.load(f"vsense_users_{path.stem}")
    make = getattr(module, "from_xml", None)
    if not callable(make):
        words = f"has no function 'from_xml(element, scope)'{likely('from_xml', vars(module))}"
        raise element.error(f"{path} {words}", "file")
    # What `element` says of an attribute has its place in the experiment file already.
    with code.watch(through=(ConfigError,)):
        device = make(element, scope)
    own = dict(inspect.getmembers(type(device), inspect.isroutine))
    missing = [member for member in members if not hasattr(device, member)]
    if missing:
        words = f"gave has no {', '.join(missing)}{likely(missing[0], own)}"
        raise element.error(f"what from_xml of {path} {words}", "file")
    code.refuse_misspelt(type(device), further, "is called by nobody")
    return UsersDevice(device, code, members[-1])


def _guarded(function: Callable[..., Any], code: UsersCode) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        with code.watch():
            return function(*arguments)

    return call
