"""Loads an experiment: finds the file, reads and checks all of it, and only then gives it out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

from vsense.base.errors import UsageError, instead, likely
from vsense.base.files import PACKAGE_FOLDER, read_bytes
from vsense.base.native import lib
from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse
from vsense.config import _programs, argos, policies
from vsense.config._framework import collect, read_loop_functions, read_rest, read_run, read_tracker
from vsense.config._population import cast, populate
from vsense.config._robots import ArenaContents, check_bodies, check_models
from vsense.config._settings import apply, check_used
from vsense.config._things import Media, by_id, read_media
from vsense.config.arena import read_arena
from vsense.config.argos import USING_SETTINGS
from vsense.config.casting import Casting
from vsense.config.devices import Devices, read_devices
from vsense.config.devices import virtual_devices as names_of_virtual
from vsense.config.geofence import Geofence
from vsense.config.placement import overlapping
from vsense.config.specs import (
    ControllerSpec,
    Experiment,
    LoopSpec,
    MarkerSpec,
    Stage,
)
from vsense.robots.sources import PROGRAM_SUFFIXES, CodeOptions, ProgramSources
from vsense.vision.markers.families import known_families
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.base import RobotSettings, Scope


def first_robots(experiment: Experiment, count: int | None) -> Experiment:
    """Keeps only the first `count` robots of an experiment; None: all.

    Raises:
        UsageError: there are not so many, or what pollutes would be left out.
    """
    if count is None:
        return experiment
    if count > len(experiment.robots):
        raise UsageError(f"--robots {count}: {experiment.file} has {len(experiment.robots)}")
    left_out = {robot.tag for robot in experiment.robots[count:]}
    if left_out & {source.tag for source in experiment.sources}:
        raise UsageError(f"--robots {count}: would leave out what pollutes")
    fewer = replace(experiment, robots=experiment.robots[:count])
    return replace(fewer, controllers=tuple(c for c in fewer.controllers if fewer.driven_by(c)))


ARGOS_SUFFIX = ".argos"
SHIPPED_FOLDER = PACKAGE_FOLDER / "config" / "experiments"
"""Of the experiments that come with vsense."""


def shipped() -> tuple[str, ...]:
    """Gives the names of the experiments that come with vsense."""
    return tuple(sorted(file.stem for file in SHIPPED_FOLDER.glob(f"*{ARGOS_SUFFIX}")))


def load(
    name_or_path: str | Path,
    length_s: float | None = None,
    settings: Mapping[str, str] | None = None,
    stage: Stage = Stage.RUN,
    virtual_devices: bool = False,
    code: CodeOptions | None = None,
    casting: Casting | None = None,
) -> Experiment:
    """Loads a shipped experiment by its name, or the `.argos` file at a path.

    Args:
        length_s: length of the run instead of the file's; shares of it follow.
        settings: values by "ELEMENT.attribute" instead of the file's; see
            `vsense.config._settings`.
        stage: what it is loaded for.
        virtual_devices: the devices of ARGoS's elements are virtual ones also where they may be
            the robots' own; in the lab and in simulation they are.
        code: where the sources of its controllers and loop functions are, besides where they are
            found.
        casting: which robots play; None: those of its tags, or any.

    Raises:
        UsageError: there is no such experiment, its file cannot be read, or a setting fits nothing
            in it.
        ConfigError: the file is wrong; the error names file, line, value and expectation.
    """
    path, file = _find(str(name_or_path))
    try:
        data = read_bytes(path)
    except FileNotFoundError:
        asked = likely(path.name, (other.name for other in path.parent.glob(f"*{ARGOS_SUFFIX}")))
        raise UsageError(f"{file}: there is no such file{asked}") from None
    except OSError as error:
        raise UsageError(f"{file}: cannot be read: {error.strerror}") from None
    return read(data, file, path, length_s, settings, stage, virtual_devices, code, casting)


def read(
    data: bytes,
    file: str,
    path: Path,
    length_s: float | None = None,
    settings: Mapping[str, str] | None = None,
    stage: Stage = Stage.RUN,
    virtual_devices: bool = False,
    code: CodeOptions | None = None,
    casting: Casting | None = None,
) -> Experiment:
    """Reads an experiment from the bytes of the file at `path`; see `load`."""
    root = parse(data, file, of_argos=True)
    if root.name != "argos-configuration":
        raise root.error("is the outermost element, expected <argos-configuration>")
    argos.refuse_other_robots(root.child("arena"))
    applied = apply(root, settings or {}, names_of_virtual(), (casting or Casting()).limit)
    serves = _Serves(stage, virtual_devices or stage is not Stage.RUN, code or CodeOptions())
    experiment = _read_understood(root, path, length_s, serves, casting or Casting())
    read_rest(root)
    root.check_all_read()
    check_used(root, applied)
    _warn_of_overlaps(root, experiment)
    return replace(experiment, warnings=root.document.warnings())


class _Serves(NamedTuple):
    """What it is loaded for, whether devices of ARGoS's elements are virtual ones, and where the
    controllers' sources are."""

    stage: Stage
    virtual: bool
    code: CodeOptions

    @property
    def is_sim(self) -> bool:
        """Whether it is loaded for a simulation."""
        return self.stage is Stage.SIM


def _read_understood(
    root: Element, path: Path, length_s: float | None, serves: _Serves, casting: Casting
) -> Experiment:
    run = read_run(root, length_s, serves.stage)
    marker, media = _read_marker(root), read_media(root)
    arena = root.child("arena")
    bodies = read_arena(arena, path.parent, media, 1.0 / run.ticks_per_second, serves.stage)
    _programs.check_sources(root, serves.code)
    loop_functions = read_loop_functions(root, path.parent, serves.code)
    populate(root.document, loop_functions, bodies, run.seed)
    if not bodies.robots:
        raise arena.error(_no_robot(root, arena))
    cast(bodies, marker.family, casting, root.document.file)
    geofence = bodies.read_geofence(arena, serves.is_sim, casting.replaced)
    scope = _scope(bodies, round(run.length_s * run.ticks_per_second), loop_functions)
    controllers = _read_controllers(root, bodies, scope, media, serves, geofence)
    _check_objects(bodies, scope)
    check_bodies(arena, bodies, marker)
    return Experiment(
        name=path.name.removesuffix(ARGOS_SUFFIX),
        file=root.document.file,
        path=path,
        **asdict(run),
        arena=bodies.arena,
        robots=tuple(bodies.robots),
        objects=tuple(bodies.objects),
        marker=marker,
        controllers=controllers,
        sources=tuple(scope.sources),
        entities=tuple(bodies.entities),
        distributed=tuple(bodies.distributed),
        floor=bodies.floor,
        fields=tuple(bodies.fields),
        loop_functions=loop_functions,
        tracker=read_tracker(root),
        stage=serves.stage,
        casting=casting,
        taken=tuple(bodies.taken),
        geofence=geofence,
    )


def _read_controllers(
    root: Element,
    bodies: ArenaContents,
    scope: Scope,
    media: Media,
    serves: _Serves,
    geofence: Geofence | None,
) -> tuple[ControllerSpec, ...]:
    controllers = _used_controllers(root.child("controllers"), bodies)
    read = [_programs.read(element, scope.folder, serves.code) for element in controllers]
    cpp = [argos.is_for_argos(element, program) for element, program in zip(controllers, read)]
    settings = [_settings(controller, bodies) for controller in controllers]
    stage, virtual, _ = serves
    devices = read_devices(controllers, scope, media, settings, stage, virtual, cpp)
    v_max_m_s = None if geofence is None else geofence.v_max_m_s
    specs = tuple(
        _read_controller(element, program, offered, v_max_m_s)
        for element, program, offered in zip(controllers, read, devices)
    )
    _warn_of_unsensed(bodies, specs)
    return specs


def _used_controllers(section: Element, bodies: ArenaContents) -> list[Element]:
    """Finds the controllers that robots name; the others are left out."""
    by_name = by_id(section.children(), "controller")
    used = set[str]()
    for element in bodies.controllers.values():
        name = element.text("config")
        if name not in by_name:
            raise element.error(
                f"there is no controller {name!r}; {instead(name, by_name)}", "config"
            )
        used.add(name)
    for name, element in by_name.items():
        if name not in used:
            element.leave_out("no robot uses it")
    return [element for name, element in by_name.items() if name in used]


def _read_controller(
    element: Element, named: tuple[str, ProgramSources], devices: Devices, limit: float | None
) -> ControllerSpec:
    """Reads the parameters of a program that drives robots with these devices.

    `named` is what `programs.read` has given, `limit` the robots' highest speed [m/s].
    """
    library, program = named
    params = element.optional_child("params")
    settings: dict[str, str] = {}
    argos_lines = ""
    if params is not None:
        _programs.check_names(params)
    if program.is_argos or program.is_lua:
        _programs.check_added(params, program)
        settings = _programs.settings(params)
        argos_lines = _programs.argos_lines(element, params, devices)
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
        argos_lines=argos_lines,
        devices=tuple(devices.declared),
        wheel_noise=devices.wheel_noise,
        v_max_m_s=limit,
    )
    size = len(controller.params_for("").encode())
    if params is not None and size > lib.VS_PARAMS_MAX:
        raise params.error(f"has {size} bytes, expected at most {lib.VS_PARAMS_MAX}")
    return policies.checked(element, controller)


def _scope(bodies: ArenaContents, timesteps: int, loop: LoopSpec | None) -> Scope:
    """Makes what devices may refer to."""
    fields = [field.id for field in bodies.fields]
    scope = Scope(
        bodies.tags,
        timesteps,
        bodies.timestep_s,
        bodies.everything,
        fields,
        bodies.folder,
        most=len(bodies.controllers),
    )
    scope.watched = loop is not None and loop.looks_at_leds
    return scope


def _settings(controller: Element, bodies: ArenaContents) -> RobotSettings:
    """What the robots of a controller say of their simulated devices; that of the first counts."""
    name = controller.text("id")
    users = {robot: (e.peek("config") or "").strip() for robot, e in bodies.controllers.items()}
    robots = [robot for robot, config in users.items() if config == name]
    settings = [bodies.settings[robot] for robot in robots]
    sensors = [e.name for section in controller.below("sensors") for e in section.below()]
    check_models(controller, robots, bodies)
    if any(other != settings[0] for other in settings) and not USING_SETTINGS.isdisjoint(sensors):
        controller.warn(
            f"drives robots with several settings of devices: those of {robots[0]!r} count"
        )
    return settings[0]


def _warn_of_overlaps(root: Element, experiment: Experiment) -> None:
    """Tells which robots will not stand where the file says."""
    displaced = overlapping(experiment) if experiment.stage is not Stage.RUN else []
    if not displaced:
        return
    robot, in_the_way = displaced[0]
    more = f", and {len(displaced) - 1} more like it" if len(displaced) > 1 else ""
    words = f"{robot.id!r} overlaps with {in_the_way}{more}: the seed says where near by they stand"
    root.document.passed_over.append((robot.line, f"<e-puck> {words}"))


def _warn_of_unsensed(bodies: ArenaContents, controllers: Sequence[ControllerSpec]) -> None:
    for element in () if any(controller.sensors for controller in controllers) else bodies.unseen:
        element.warn(
            "is virtual, and no virtual sensor is there to feel it;"
            " vs:physical='true' says that it stands in the real arena"
        )


def _find(name: str) -> tuple[Path, str]:
    """Gives the file's place and what errors call it."""
    if name in shipped():
        file = f"{name}{ARGOS_SUFFIX}"
        return SHIPPED_FOLDER / file, file
    path = Path(name)
    is_program = path.suffix in PROGRAM_SUFFIXES
    if path.suffix == ARGOS_SUFFIX or (os.path.isfile(name) and not is_program):
        return path, name
    if os.path.isdir(name):
        return _find(of_folder(name))
    here = [str(file) for file in path.parent.glob(f"*{ARGOS_SUFFIX}")]
    here += [str(file.parent) for file in path.parent.glob(f"*/*{ARGOS_SUFFIX}")]
    words = "there is no such file, and none of that name comes with vsense"
    if os.path.isfile(name):
        words = f"that is a program: expected the {ARGOS_SUFFIX} file that names it"
    wanted = str(path.with_suffix(ARGOS_SUFFIX)) if is_program else name
    raise UsageError(f"no experiment {name!r}: {words}; {instead(wanted, [*here, *shipped()])}")


def of_folder(name: str) -> str:
    """What a name means that may be a folder's: the one `.argos` file in it, or the name itself.

    UsageError: the folder has none, or several.
    """
    if name in shipped() or not os.path.isdir(name):
        return name
    files = sorted(Path(name).glob(f"*{ARGOS_SUFFIX}"))
    if len(files) == 1:
        return str(files[0])
    words = ", ".join(file.name for file in files) or "none"
    raise UsageError(f"{name}: is a folder: expected one {ARGOS_SUFFIX} file in it, got {words}")


def _read_marker(root: Element) -> MarkerSpec:
    rig = root.optional_child("vs:rig")
    element = rig.optional_child("vs:marker") if rig is not None else None
    element = element if element is not None else Element(root.document, "vs:marker", root.line, {})
    family = element.choice("family", known_families(), "arrow4x4")
    height_m = element.number("height", 0.0, 1.0, "m", EPUCK.marker_height_m)
    return MarkerSpec(family, height_m, element.line, element.has("height"))


def _no_robot(root: Element, arena: Element) -> str:
    """Says what an arena without robots has instead."""
    lines: dict[str, int] = {}
    for element in arena.below():
        inner = [e for entity in element.below("entity") for e in entity.below()]
        for thing in inner if element.name == argos.DISTRIBUTE else [element]:
            lines.setdefault(thing.name, thing.line)
    there = ", ".join(f"<{name}> (line {line})" for name, line in lines.items()) or "nothing"
    message = f"holds no real robot, expected <e-puck>; it has {there}"
    loop = root.below("loop_functions")
    if loop and loop[0].peek("library"):
        message += (
            f"; the <loop_functions> in line {loop[0].line} add none: write them in <arena> or a"
            " <distribute> there, or add them in Python: space.add_robot(...) in populate(space)"
        )
    return message


def _check_objects(bodies: ArenaContents, scope: Scope) -> None:
    """Refuses an e-puck without a controller that is not the object of anything."""
    for name, element in bodies.without_controller.items():
        if bodies.tags[name] not in scope.named:
            raise element.error(
                "<controller> is missing in it; a thing with a marker that is no robot"
                " is a <vs:object>"
            )
