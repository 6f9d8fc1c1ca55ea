"""A sensor of the user's own, from a Python file beside the experiment.

    <vs:sensor file="crowd.py" reach="0.3" noise_level="1" />

The file is written as those in this folder are (README.md shows how), but needs no `ELEMENTS`. Its
`from_xml` reads the other attributes; the quality settings and the updating condition are those of
every sensor. An error in it ends the run with the file's name and line.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from vsense.base.errors import ConfigError
from vsense.base.users_code import UsersCode, line_of
from vsense.base.xml.element import Element
from vsense.world.sensors.base import Scope, SensorError, VirtualSensor

ELEMENTS = ("vs:sensor",)

_MEMBERS = ("name", "layout", "read")


class UsersSensor:
    """A user's sensor; what goes wrong in its functions becomes an error that names the file.

    `place` is where its function `read` stands, for what is said of its values.
    """

    def __init__(self, sensor: Any, code: UsersCode) -> None:
        self._sensor = sensor
        self._code = code
        self.place = f"{code.file}:{line_of(sensor.read)}: "

    def __getattr__(self, key: str) -> Any:
        # Private names are never the user's; asking for them while this object is copied must end.
        if key.startswith("_"):
            raise AttributeError(key)
        value = getattr(self._sensor, key)
        return _guarded(value, self._code) if callable(value) else value


def from_xml(element: Element, scope: Scope) -> VirtualSensor:
    """Makes the sensor from its element.

    Raises:
        ConfigError: there is no such file, it has no `from_xml`, or a member is missing.
        SensorError: the user's code fails.
    """
    path = scope.folder / element.text("file", None, "a Python file")
    if not os.path.isfile(path):
        raise element.error(f"there is no file {str(path)!r}", "file")
    code = UsersCode(path, _error)
    make = getattr(code.load(f"vsense_users_{path.stem}"), "from_xml", None)
    if not callable(make):
        raise element.error(f"{path} has no function 'from_xml(element, scope)'", "file")
    # What `element` says of an attribute has its place in the experiment file already.
    with code.watch(through=(ConfigError,)):
        sensor = make(element, scope)
    missing = [member for member in _MEMBERS if not hasattr(sensor, member)]
    if missing:
        raise element.error(f"what from_xml of {path} gave has no {', '.join(missing)}", "file")
    return UsersSensor(sensor, code)


def _error(file: str, line: int, message: str) -> SensorError:
    return SensorError(f"{file}:{line}: {message}")


def _guarded(function: Callable[..., Any], code: UsersCode) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        with code.watch():
            return function(*arguments)

    return call
