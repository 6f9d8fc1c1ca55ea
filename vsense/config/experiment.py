"""Loads an experiment: finds the file, reads and checks all of it, and only then gives it out."""

from __future__ import annotations

import os
from dataclasses import replace
from importlib import resources
from ipaddress import IPv4Address
from pathlib import Path

from vsense.config import argos
from vsense.config.bodies import Bodies, read_arena
from vsense.config.controllers import read_controller, read_sensors, used_controller
from vsense.config.element import Element
from vsense.config.specs import Experiment, MarkerSpec, ObjectSpec, RobotSpec
from vsense.config.xml import parse
from vsense.errors import ConfigError, UsageError
from vsense.sensors.base import Scope
from vsense.tracking.families import known_families, load_family

SUFFIX = ".argos"

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 4050
"""The original's port for the virtual sensor server."""

_MAX_LENGTH_S = 1e6
_MIN_TICKS_PER_SECOND = 6
"""A robot that gets no datagram makes its next control step after 1.25 timesteps, and one
exchange with its base takes up to 30 ms. Its guard stops the wheels where that step is not
complete 250 ms after the last one: so 1.25 / ticks_per_second + 0.03 s <= 0.25 s.
Source: robot/loop.h, robot/base.h, robot/guard.h."""

_WHY_MIN_TICKS = "a robot's guard stops wheels that get no control step for 250 ms"

_MAX_TICKS_PER_SECOND = 100
_MAX_SEED = 2**32 - 1


def shipped() -> tuple[str, ...]:
    """Gives the names of the experiments that come with vsense."""
    folder = resources.files("vsense") / "experiments"
    return tuple(
        sorted(f.name.removesuffix(SUFFIX) for f in folder.iterdir() if f.name.endswith(SUFFIX))
    )


def load(name_or_path: str | Path, length_s: float | None = None) -> Experiment:
    """Loads an experiment.

    Args:
        name_or_path: a shipped experiment's name, or the path of an `.argos` file.
        length_s: length of the run instead of the file's; shares of it follow.

    Raises:
        UsageError: there is no such experiment, or its file cannot be read.
        ConfigError: the file is wrong; the error names file, line, value and expectation.
    """
    path, file = _find(str(name_or_path))
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{file}: cannot be read: {error.strerror}") from None
    return read(data, file, path, length_s)


def read(data: bytes, file: str, path: Path, length_s: float | None = None) -> Experiment:
    """Reads an experiment from its bytes; see `load`.

    Args:
        data: the XML.
        file: what errors call the file.
        path: where the file lies.
        length_s: length of the run instead of the file's.

    Raises:
        ConfigError: the file is wrong.
    """
    root = parse(data, file)
    if root.name != "argos-configuration":
        raise root.error("is the outermost element, expected <argos-configuration>")
    experiment = _read_understood(root, path, length_s)
    _read_rest(root)
    root.check_all_read()
    return replace(experiment, warnings=root.document.warnings())


def _read_understood(root: Element, path: Path, length_s: float | None) -> Experiment:
    """Reads all that has a meaning here."""
    framework = root.child("framework")
    run = framework.child("experiment")
    file_length_s = run.number("length", 0.0, _MAX_LENGTH_S, "s")
    length_s = file_length_s if length_s is None else length_s
    ticks_per_second = run.integer(
        "ticks_per_second", _MIN_TICKS_PER_SECOND, _MAX_TICKS_PER_SECOND, why=_WHY_MIN_TICKS
    )
    host, port = _address(framework, run)
    bodies = read_arena(root.child("arena"))
    controller = used_controller(root.child("controllers"), bodies)
    scope = Scope(bodies.tags, round(length_s * ticks_per_second))
    sensors = read_sensors(controller, scope)
    _check_objects(bodies, scope)
    marker = _read_marker(root)
    _check_tags(bodies, marker, root.document.file)
    return Experiment(
        name=path.name.removesuffix(SUFFIX),
        file=root.document.file,
        path=path,
        length_s=length_s,
        ticks_per_second=ticks_per_second,
        seed=run.integer("random_seed", 0, _MAX_SEED, 0),
        host=host,
        port=port,
        arena=bodies.arena,
        boxes=tuple(bodies.boxes),
        robots=tuple(bodies.robots),
        objects=tuple(bodies.objects),
        marker=marker,
        controller=read_controller(controller, path.parent),
        sensors=tuple(sensors),
        sources=tuple(scope.sources),
        warnings=(),
    )


def _find(name: str) -> tuple[Path, str]:
    """Gives the file's place and what errors call it."""
    if name in shipped():
        file = f"{name}{SUFFIX}"
        return Path(str(resources.files("vsense") / "experiments" / file)), file
    path = Path(name)
    if path.suffix == SUFFIX or os.path.isfile(name):
        return path, name
    known = ", ".join(shipped())
    raise UsageError(
        f"no experiment {name!r}: expected a path ending in {SUFFIX} or one of: {known}"
    )


def _address(framework: Element, run: Element) -> tuple[str, int]:
    """Reads where the robots find the server: from <experiment>, else from <framework>."""
    host, port = DEFAULT_HOST, DEFAULT_PORT
    for element in (framework, run):
        host = _read_host(element, host)
        port = element.integer("vss_port", 1, 65_535, port)
    return host, port


def _read_host(element: Element, default: str) -> str:
    """Reads an IPv4 address in numbers; robots look no names up, but for this very machine's."""
    key, expected = "vss_host", "an IPv4 address such as '10.0.0.1', or 'localhost'"
    text = element.text(key, default, expected)
    try:
        return str(IPv4Address(DEFAULT_HOST if text == "localhost" else text))
    except ValueError:
        raise element.error(f"{text[:60]!r} is not {expected}", key) from None


def _read_marker(root: Element) -> MarkerSpec:
    rig = root.optional_child("vs:rig")
    element = rig.optional_child("vs:marker") if rig is not None else None
    element = element if element is not None else Element(root.document, "vs:marker", root.line, {})
    family = element.choice("family", known_families(), "arrow4x4")
    return MarkerSpec(family, element.number("height", 0.0, 1.0, "m", 0.06), element.line)


def _check_tags(bodies: Bodies, marker: MarkerSpec, file: str) -> None:
    """Refuses a tag that the marker family does not have."""
    tags = load_family(marker.family).tags
    tagged: list[RobotSpec | ObjectSpec] = [*bodies.robots, *bodies.objects]
    for body in tagged:
        if body.tag >= tags:
            known = f"the marker family {marker.family!r} has tags 0 to {tags - 1}"
            raise ConfigError(file, body.line, f"{body.id!r}: {known}")


def _check_objects(bodies: Bodies, scope: Scope) -> None:
    """Refuses an e-puck without a controller that is not the object of anything."""
    wanted = {source.tag for source in scope.sources}
    for name, element in bodies.without_controller.items():
        if bodies.tags[name] not in wanted:
            raise element.error(
                "<controller> is missing in it; a thing with a marker that is no robot"
                " is a <vs:object>"
            )


def _read_rest(root: Element) -> None:
    """Passes over the parts of ARGoS that have no meaning here, each with a word about it."""
    _read_framework(root.child("framework"))
    for name, instead in (
        ("loop_functions", "its functions are not called"),
        ("visualization", "vsense draws its own pictures"),
    ):
        section = root.optional_child(name)
        if section is not None and (section.free_attributes() or section.child_names()):
            section.leave_out(instead)
    engines = root.optional_child("physics_engines")
    for child in engines.children("dynamics2d", *argos.PHYSICS_ENGINES) if engines else ():
        child.text("id")
        if child.name != "dynamics2d" or child.child_names():
            child.leave_out("the lab has its own physics in the plane")
    media = root.optional_child("media")
    for child in media.children(*argos.MEDIA) if media else ():
        child.leave_out("nothing is sent through it")


def _read_framework(framework: Element) -> None:
    run = framework.child("experiment")
    if run.has("real_time"):
        run.boolean("real_time")
    for key in ("ats_host", "ats_port"):
        if framework.has(key):
            framework.warn(f"{key} is not used: vsense tracks the robots itself")
    system = framework.optional_child("system")
    if system is not None:
        system.integer("threads", 0, 1024, 0)
        if system.has("method"):
            system.text("method")
    for child in framework.children("profiling"):
        child.leave_out("nothing is profiled")
