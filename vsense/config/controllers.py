"""Reads `<controllers>`: what drives the robots. Their devices are read in `devices`."""

from __future__ import annotations

from vsense.base.errors import instead
from vsense.base.native import lib
from vsense.base.xml.element import Element
from vsense.config import argos, programs
from vsense.config.devices import Devices
from vsense.config.framework import collect
from vsense.config.robots import ArenaContents
from vsense.config.specs import ControllerSpec
from vsense.config.things import by_id
from vsense.robots.sources import ProgramSources


def used_controllers(section: Element, bodies: ArenaContents) -> list[Element]:
    """Finds the controllers that robots name; the others are left out."""
    known = by_id(section.children(), "controller")
    used = set[str]()
    for element in bodies.controllers.values():
        name = element.text("config")
        if name not in known:
            raise element.error(
                f"there is no controller {name!r}; {instead(name, known)}", "config"
            )
        used.add(name)
    for name, element in known.items():
        if name not in used:
            element.leave_out("no robot uses it")
    return [element for name, element in known.items() if name in used]


def read_controller(
    element: Element, named: tuple[str, ProgramSources], devices: Devices
) -> ControllerSpec:
    """Reads the parameters of a program that drives robots with these devices.

    `named` is what `programs.read` has given.
    """
    library, program = named
    params = element.optional_child("params")
    settings: dict[str, str] = {}
    told = ""
    if program.is_argos:
        programs.check_added(params, program)
        settings = programs.settings(params)
        told = programs.told(element, params, devices.sensors, devices.actuators)
    elif params is not None:
        settings = collect(params, {})
    if library == argos.STAND_STILL:
        settings = {}
    controller = ControllerSpec(
        id=element.text("id"),
        label=element.name,
        library=library,
        sources=program.sources,
        includes=program.includes,
        params=settings,
        sensors=tuple(devices.sensors),
        actuators=tuple(devices.actuators),
        line=element.line,
        told=told,
        devices=tuple(devices.declared),
        wheel_noise=devices.wheel_noise,
    )
    size = len(controller.params_for("").encode())
    if params is not None and size > lib.VS_PARAMS_MAX:
        raise params.error(f"has {size} bytes, expected at most {lib.VS_PARAMS_MAX}")
    return controller
