"""Reads `<controllers>`: what drives the robots. Their devices are read in `devices`."""

from __future__ import annotations

from pathlib import Path

from vsense.config import argos
from vsense.config.devices import Devices
from vsense.config.framework import collect
from vsense.config.robots import ArenaContents
from vsense.config.specs import ControllerSpec
from vsense.config.things import by_id
from vsense.errors import UsageError
from vsense.native import lib
from vsense.robot.build import source_tree
from vsense.xml.element import Element, shown


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
        devices=tuple(devices.declared),
        wheel_noise=devices.wheel_noise,
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
