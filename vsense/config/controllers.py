"""Reads `<controllers>`: what drives the robots."""

from __future__ import annotations

from pathlib import Path

from vsense.build import source_tree
from vsense.config import porting
from vsense.config.bodies import Bodies
from vsense.config.element import Element
from vsense.config.loop import collect
from vsense.config.specs import ControllerSpec
from vsense.config.wording import shown
from vsense.errors import UsageError
from vsense.native import lib


def used_controller(section: Element, bodies: Bodies) -> Element:
    """Finds the one controller that the robots name.

    Raises:
        ConfigError: a robot names one that is not there, or they name several.
    """
    known: dict[str, Element] = {}
    for element in section.children():
        name = element.text("id")
        if name in known:
            line = known[name].line
            raise element.error(f"{name!r} is the id of another controller, in line {line}", "id")
        known[name] = element
    used: dict[str, Element] = {}
    for robot, element in bodies.controllers.items():
        name = element.text("config")
        if name not in known:
            there = ", ".join(known) or "none"
            raise element.error(f"there is no controller {name!r}; there are: {there}", "config")
        used.setdefault(name, element)
        if len(used) > 1:
            other = next(iter(used))
            raise element.error(
                f"{robot!r} has {name!r}, others have {other!r}; expected one for all robots:"
                " they share one sensor table and one program, which may tell them apart itself",
                "config",
            )
    chosen = known[next(iter(used))]
    for element in known.values():
        if element is not chosen:
            element.leave_out("no robot uses it")
    return chosen


def read_controller(element: Element, folder: Path) -> ControllerSpec:
    """Reads which program drives the robots, and what it is told.

    Args:
        element: the controller's element.
        folder: where a C source with a relative path is looked for.

    Raises:
        ConfigError: something in it is wrong.
    """
    library = _read_library(element, folder)
    params = element.optional_child("params")
    settings = {} if params is None else collect(params, {})
    if library == porting.STAND_STILL:
        settings = {}
    controller = ControllerSpec(element.text("id"), library, settings, element.line)
    size = len(controller.params_text.encode())
    if params is not None and size > lib.VS_PARAMS_MAX:
        raise params.error(f"has {size} bytes, expected at most {lib.VS_PARAMS_MAX}")
    return controller


def _read_library(element: Element, folder: Path) -> str:
    """Reads which program it is; what was written for ARGoS is replaced by its port."""
    if element.name == porting.LUA and not element.has("library"):
        element.warn(f"is Lua, which runs on no robot: they stand still; see {porting.PAGE}")
        return porting.STAND_STILL
    library = element.text("library", None, "a shipped controller's name or the path of a .c file")
    if porting.is_built_for_argos(library):
        port = porting.ported_controller(library, folder)
        if port is None:
            instead = f"the robots stand still; port it, see {porting.PAGE}"
            element.warn(f"library: {shown(library)} is C++ for ARGoS, not for robots: {instead}")
            return porting.STAND_STILL
        element.warn(
            f"library: {shown(library)} is C++ for ARGoS: its port {port!r} is run instead"
        )
        return port
    try:
        source_tree().controller(library, folder)
    except UsageError as error:
        raise element.error(str(error), "library") from None
    except OSError as error:
        raise element.error(f"{shown(library)}: {error.strerror}", "library") from None
    return library
