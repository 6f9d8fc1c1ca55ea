"""Reads which program a `<controller>` names, finds its sources, and what it is told.

A program for ARGoS is told its `<params>` as a tree, and which devices the file declares: in lines
as robot/argos/controller.cpp reads them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from vsense.base.errors import UsageError, instead
from vsense.base.xml.element import Element, shown
from vsense.config import argos
from vsense.config.devices import Devices
from vsense.robots import finding
from vsense.robots.build import cache_directory, source_tree
from vsense.robots.compiling import BuildError
from vsense.robots.sources import (
    ARGOS_PAGE,
    CONTROLLER,
    LOOP_FUNCTIONS,
    LUA,
    CodeOptions,
    ProgramSources,
    content,
    folders,
    stem_of,
)
from vsense.world.actuators.messages import MessagesActuator
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.range_and_bearing import RangeAndBearingSensor

_SOURCES, _INCLUDE = "vs:sources", "vs:include"
_MAX_UP = 4
"""Folders above the experiment's from which a script may be named."""


def read(element: Element, folder: Path, code: CodeOptions) -> tuple[str, ProgramSources]:
    """Reads a controller's program.

    Args:
        element: the controller's.
        folder: the experiment file's, from which relative paths are taken.
        code: what the command line says of sources and headers.

    Returns:
        The library as the file names it, or the port that runs instead; and its program.
    """
    try:
        library, program = _read(element, folder, code)
    except UsageError as error:
        raise element.error(str(error), "library" if element.has("library") else None) from None
    except OSError as error:
        missing = shown(element.text("library", ""))
        raise element.error(f"{missing}: {error.strerror}", "library") from None
    if wrong := program.label_error(element.name):
        raise element.error(wrong)
    return library, program


def _read(element: Element, folder: Path, code: CodeOptions) -> tuple[str, ProgramSources]:
    named = _named(element, folder, code)
    if named is not None:
        return element.text("library", element.name), named
    if element.name == argos.LUA and not element.has("library"):
        return _of_script(element, folder)
    if not element.has("library"):
        program = finding.find("", element.name, folder, _headers(element, folder, code))
        if program is not None:
            return element.name, program
    expected = "a shipped controller's name or the path of a .c, .cpp, .py or .onnx file"
    library = element.text("library", None, expected)
    if argos.is_built_for_argos(library):
        return _of_library(element, library, folder, code)
    program = source_tree().program(library, folder)
    if program.is_cxx and program.is_argos:
        extra = _headers(element, folder, code)
        program = finding.complete(program.sources, element.name, None, extra)
    return library, program


def check_sources(root: Element, code: CodeOptions) -> None:
    """Checks that whatever the command line names sources of is in the file.

    Raises:
        UsageError: it is not.
    """
    users = [e for section in root.below("controllers") for e in section.below()]
    names = {name for e in users for name in (e.name, e.peek("id"))}
    for element in (*users, *root.below("loop_functions")):
        names |= {stem_of(element.peek("library") or ""), element.peek("label")}
    for name in code.sources:
        if name not in names:
            hint = instead(name, (text for text in names if text))
            raise UsageError(f"--sources {name}=...: nothing is called so; {hint}")


def find_loop_functions(
    element: Element, label: str, folder: Path, code: CodeOptions
) -> ProgramSources | None:
    """Finds what a library of loop functions in C++ is built of; arguments as those of `read`."""
    library = element.text("library")
    try:
        named = _named(element, folder, code, label, LOOP_FUNCTIONS)
        if named is not None:
            return named
        extra = _headers(element, folder, code)
        return finding.find(library, label, folder, extra, LOOP_FUNCTIONS)
    except (UsageError, OSError) as error:
        raise element.error(str(error), "library") from None


def _named(
    element: Element, folder: Path, code: CodeOptions, label: str = "", macro: str = CONTROLLER
) -> ProgramSources | None:
    """The program whose sources, or whose repository, the element or the command line names.

    `label`: of the class that is wanted, by default the element's name.
    """
    library = element.text("library") if element.has("library") else element.name
    label = label or element.name
    element.has(_INCLUDE)
    if element.has(_SOURCES):
        patterns: Sequence[str] = _parts(element.text(_SOURCES), folder)
    else:
        names = [element.text("id")] if element.has("id") else []
        patterns = code.patterns(stem_of(library), label, *names)
        patterns = [str(Path.cwd() / os.path.expanduser(pattern)) for pattern in patterns]
    extra = _headers(element, folder, code)
    return finding.named(patterns, folder, library, label, extra, macro)


def _parts(text: str, folder: Path) -> list[str]:
    """Paths or patterns with commas or blanks between them; a path may have blanks in it."""

    def is_whole(part: str) -> bool:
        return os.path.exists(folder / os.path.expanduser(part.rpartition("=")[2]))

    parts = filter(None, (part.strip() for part in text.split(",")))
    return [word for part in parts for word in ([part] if is_whole(part) else part.split())]


def _headers(element: Element, folder: Path, code: CodeOptions) -> list[Path]:
    """The folders of headers that the element and the command line name."""
    own = _parts(element.text(_INCLUDE), folder) if element.has(_INCLUDE) else []
    if not own and not code.includes:
        return []
    try:
        cache = cache_directory()
    except BuildError as error:
        raise UsageError(str(error)) from None
    return [*folders(own, folder, cache), *folders(code.includes, Path.cwd(), cache)]


def _of_library(
    element: Element, library: str, folder: Path, code: CodeOptions
) -> tuple[str, ProgramSources]:
    """The program of a library that was built for ARGoS: its port beside the file, its sources, a
    port that is shipped."""
    port = argos.ported_controller(library, folder)
    if port is None:
        program = finding.find(library, element.name, folder, _headers(element, folder, code))
        if program is not None:
            return library, program
        port = argos.shipped_controller(library)
    if port is None:
        instead = f"the robots stand still; --sources {stem_of(library)}=FILES names them"
        element.warn(
            f"library: {shown(library)} is C++ for ARGoS, and its sources are not found: {instead},"
            f" see {ARGOS_PAGE}"
        )
        return argos.STAND_STILL, source_tree().program(argos.STAND_STILL)
    element.warn(f"library: {shown(library)} is C++ for ARGoS: its port {port!r} is run instead")
    return port, source_tree().program(port, folder)


def _of_script(element: Element, folder: Path) -> tuple[str, ProgramSources]:
    """The program of a script in Lua, whose path ARGoS takes from where it is started: it is looked
    for from the experiment's folder, from the current one, and from those above the first."""
    params = element.optional_child("params")
    script = "" if params is None else params.peek("script") or ""
    if params is None or not script:
        element.warn("has no <params script=...>: the robots stand still, as in ARGoS")
        return argos.STAND_STILL, source_tree().program(argos.STAND_STILL)
    given = os.path.expanduser(os.path.expandvars(script))
    for place in (folder, Path.cwd(), *folder.resolve().parents[:_MAX_UP]):
        path = place / given
        if os.path.isfile(path):
            if path.suffix != LUA:
                raise params.error(f"{shown(script)} is no .lua file", "script")
            return script, ProgramSources((path.resolve(),))
    raise params.error(f"there is no file {shown(script)}", "script")


def argos_lines(element: Element, params: Element | None, devices: Devices) -> str:
    """The lines that a controller for ARGoS is sent, without its robot's name; with what those have
    that are no e-pucks."""
    lines = [
        f"vs:{section}={' '.join(below.child_names())}"
        for section in ("sensors", "actuators")
        for below in element.below(section)
    ]
    for sensor in devices.sensors:
        if isinstance(sensor.sensor, RangeAndBearingSensor):
            lines.append(f"vs:heard_bytes={sensor.sensor.data_size}")
    for actuator in devices.actuators:
        if isinstance(actuator.actuator, MessagesActuator):
            lines.append(f"vs:said_bytes={actuator.actuator.size}")
    model = devices.robots.model
    if model != EPUCK:
        sensors_around, bases = len(model.infrared.angles_rad), len(model.base_ground_m)
        lines += [f"vs:axle_cm={100 * model.axle_m!r}", f"vs:lamps={len(model.lamps_m)}"]
        lines += [f"vs:two_radii_cm={200 * model.radius_m!r}", f"vs:ring={sensors_around}"]
        lines += [f"vs:below={len(model.ground_m) + bases}", f"vs:bases={bases}"]
    # A parameter has a name and a value: the marks that have none are given an empty one.
    nodes = ["<params", ">"] if params is None else tree(params)
    lines += [node if node[0] == "@" else f"{node[0]}={node[1:]}" for node in nodes]
    return "".join(f"{line}\n" for line in lines)


def tree(element: Element) -> list[str]:
    """An element with everything in it, in the lines of `VsReadConfiguration`."""
    lines = [f"<{element.name}"]
    for key, value in element.free_attributes().items():
        lines.append(f"@{key}={_one_line(value)}")
    if text := element.take_text():
        lines.append(f"#{_one_line(text)}")
    for child in element.children():
        lines += tree(child)
    return [*lines, ">"]


def _one_line(text: str) -> str:
    plain = text.replace("\\", "\\\\").replace("\n", "\\n").replace("\t", "\\t")
    return "".join(c if c.isprintable() else " " for c in plain)


_TEXT = re.compile(rb'"([A-Za-z_][\w.:-]*)"')
_WORD = re.compile(rb"([A-Za-z_]\w*)")


def check_added(params: Element | None, program: ProgramSources) -> None:
    """Raises ConfigError where a setting from outside adds what no source of a C++ program names.

    What stands in the file is the user's: ARGoS passes over attributes that nobody reads.
    """
    if params is None:
        return
    pattern = _WORD if program.is_lua else _TEXT
    files = program.sources if program.is_lua else program.own_files()
    texts = {text.decode() for path in files for text in pattern.findall(content(path))}
    for element in params.walk():
        for key in element.added - texts:
            raise element.error(f"no source of its program reads it; {instead(key, texts)}", key)


def check_names(params: Element) -> None:
    """Raises ConfigError where a setting's name is one of vsense's: nothing would read it."""
    for element in params.walk():
        if element.name.startswith("vs:"):
            raise element.error("is no setting of a controller, and nothing reads it here")
        for key in element.free_attributes():
            if key.startswith("vs:"):
                raise element.error("is no setting of a controller, and nothing reads it here", key)


def settings(params: Element | None) -> dict[str, str]:
    """The settings as people are shown them: an attribute of a child is called `child.key`, one of
    the second child of this name `child:2.key`."""
    values: dict[str, str] = {}

    def walk(element: Element, prefix: str) -> None:
        values.update({prefix + key: value for key, value in element.free_attributes().items()})
        seen: dict[str, int] = {}
        for child in element.children():
            seen[child.name] = number = seen.get(child.name, 0) + 1
            walk(child, f"{prefix}{child.name}{f':{number}' if number > 1 else ''}.")

    if params is not None:
        walk(params, "")
    return values
