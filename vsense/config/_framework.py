"""Reads what an experiment file says about the run as a whole, and the parts of ARGoS beside it.

The thesis puts a tracker's `ats_host` and `ats_port` on `<framework>`, the original's code
`its_host`, `its_port`, `translate_x` and `translate_y` on the physics engine
`<iridia_tracking_system>`; both are understood. Source: iridia.md section 1c; argos3-tycho
subtracts the translation from the tracker's places. Ours is `vs:latency` beside the host: the
protocol does not say how old a state is when it comes. Any other tracker is a
`<vs:tracker format="lines">` in `<framework>`, a motion capture system `format="mocap"`.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from ipaddress import IPv4Address
from pathlib import Path

from vsense.base.errors import likely
from vsense.base.files import read_bytes
from vsense.base.xml.element import Element, shown
from vsense.config import _programs, argos
from vsense.config._things import by_id
from vsense.config.specs import (
    DEFAULT_UNSEEN_S,
    LINES_PORT,
    AnyTracker,
    JsonLinesTracker,
    LoopSpec,
    MocapTracker,
    Stage,
    TrackerAddress,
)
from vsense.robots.link.trackers.mocap import MOCAP_TYPES, MocapSystem
from vsense.robots.sources import ARGOS_PAGE, LOOP_FUNCTIONS, CodeOptions, stem_of

_ENGINE = "iridia_tracking_system"
_TRACKER = "vs:tracker"
_PREFIXES = ("ats", "its")
_FAR_M = 1000.0
_MAX_LATENCY_S = 0.3
"""Robots stop 400 ms after the capture of what they heard last: an older one moves nothing."""

_KNOWN = ("library", "label")


def read_loop_functions(root: Element, folder: Path, code: CodeOptions) -> LoopSpec | None:
    """Reads the loop functions, looked for in `folder`; None where there are none to be called.

    `code`: what the command line says of sources and headers.
    """
    element = root.optional_child("loop_functions")
    if element is None or not (element.free_attributes() or element.child_names()):
        return None
    library = element.text("library", None, "the path of a Python file")
    label = element.text("label", "") if element.has("label") else ""
    if argos.is_built_for_argos(library):
        port = argos.ported_loop_functions(library, folder)
        if port is None:
            return _cxx_loop_functions(element, library, label, folder, code)
        element.warn(f"library: {shown(library)} is C++: its port {port.name!r} is called instead")
    else:
        port = folder / library
        if port.suffix != ".py" or not os.path.isfile(port):
            files = likely(library, (other.name for other in folder.glob("*.py")))
            missing = f"there is no such file{files}" if port.suffix == ".py" else ""
            message = missing or "expected the path of a .py file"
            raise element.error(f"{shown(library)}: {message}", "library")
    _check_syntax(element, port)
    params = collect(element, {})
    return LoopSpec(port, label, {k: v for k, v in params.items() if k not in _KNOWN}, element.line)


def _cxx_loop_functions(
    element: Element, library: str, label: str, folder: Path, code: CodeOptions
) -> LoopSpec | None:
    """Finds what a C++ library of loop functions is built of; None, and a warning: nothing here."""
    program = _programs.find_loop_functions(element, label, folder, code)
    if program is None:
        element.leave_out(
            f"the sources of {shown(library)}, in which {LOOP_FUNCTIONS} names"
            f" {shown(label)}, are not found: no loop functions are called; name them with"
            f" --sources {stem_of(library)}=FILES, see {ARGOS_PAGE}"
        )
        return None
    settings = "".join(f"{line}\n" for line in _programs.tree(element))
    return LoopSpec(program.sources[0], label, {}, element.line, program, settings)


def _check_syntax(element: Element, path: Path) -> None:
    """Refuses a file that is no Python, before anything of it is run."""
    try:
        compile(read_bytes(path), str(path), "exec")
    except SyntaxError as error:
        place = f"{path}:{error.lineno or 1}"
        raise element.error(f"{place}: {error.msg}, expected Python", "library") from None
    except (OSError, ValueError) as error:
        raise element.error(f"{path}: {error}, expected Python", "library") from None


def collect(element: Element, settings: dict[str, str], prefix: str = "") -> dict[str, str]:
    """Flattens the user's own settings: an attribute of a child is called `child.key`.

    No two may have one name, and each value must fit one line.
    """
    for key, value in element.free_attributes().items():
        if any(not character.isprintable() for character in value):
            raise element.error("holds a character that is not printable", key)
        if prefix + key in settings:
            raise element.error("is there twice", key)
        settings[prefix + key] = value
    for child in element.children():
        collect(child, settings, f"{prefix}{child.name}.")
    return settings


DEFAULT_HOST = "127.0.0.1"
ROBOTS_PORT = 4050
"""The original's port for the virtual sensor server."""

_MAX_LENGTH_S = 1e6
_MIN_TICKS_PER_SECOND = 6
"""A robot that gets no datagram makes its next control step after 1.25 timesteps, and one
exchange with its base takes up to 30 ms. Its guard stops the wheels where that step is not
complete 250 ms after the last one: so 1.25 / ticks_per_second + 0.03 s <= 0.25 s.
Source: robot/loop.h, robot/base.h, robot/guard.h."""

_WHY_MIN_TICKS = (
    "a robot's guard stops wheels that get no control step for 250 ms; 'vsense sim' takes 1 to 5,"
    " too"
)

_MAX_TICKS_PER_SECOND = 100
_MAX_SEED = 2**32 - 1
_MIN_UNSEEN_S = 0.2
_MAX_THREADS = 1024


@dataclass(frozen=True, slots=True)
class RunSettings:
    """How an experiment is run; the fields are those of `Experiment`."""

    length_s: float
    ticks_per_second: int
    seed: int
    host: str
    port: int
    unseen_s: float | None


def read_run(root: Element, length_s: float | None, stage: Stage) -> RunSettings:
    """Reads `<framework>`; `length_s` is the length of the run instead of the file's."""
    framework = root.child("framework")
    run = framework.child("experiment")
    file_length_s = run.number("length", 0.0, _MAX_LENGTH_S, "s")
    # No guard watches simulated wheels.
    low, why = (1, "") if stage is Stage.SIM else (_MIN_TICKS_PER_SECOND, _WHY_MIN_TICKS)
    ticks_per_second = run.integer("ticks_per_second", low, _MAX_TICKS_PER_SECOND, why=why)
    if run.has("real_time"):
        run.boolean("real_time")
    host, port = _read_address(root)
    return RunSettings(
        file_length_s if length_s is None else length_s,
        ticks_per_second,
        run.integer("random_seed", 0, _MAX_SEED, 0),
        host,
        port,
        _read_unseen_s(run),
    )


def _read_unseen_s(run: Element) -> float | None:
    """How long a robot goes on that no camera sees [s]; None: for ever."""
    stands = run.choice("vs:unseen", ("stand", "drive"), "stand") == "stand"
    limit_s = run.number("vs:unseen_s", _MIN_UNSEEN_S, _MAX_LENGTH_S, "s", DEFAULT_UNSEEN_S)
    return limit_s if stands else None


def read_rest(root: Element) -> None:
    """Passes over the parts of ARGoS that have no meaning here, each with a warning."""
    framework = root.child("framework")
    system = framework.optional_child("system")
    if system is not None:
        system.integer("threads", 0, _MAX_THREADS, 0)
        if system.has("method"):
            system.text("method")
    for child in framework.children("profiling"):
        child.leave_out("nothing is profiled")
    section = root.optional_child("visualization")
    if section is not None and (section.free_attributes() or section.child_names()):
        section.leave_out("vsense draws its own pictures")
    _read_engines(root)


def _read_engines(root: Element) -> None:
    """Reads the physics engines; the tracking system's address was read by `read_tracker`."""
    section = root.optional_child("physics_engines")
    kinds = ("dynamics2d", _ENGINE, *argos.PHYSICS_ENGINES)
    for child in by_id(section.children(*kinds) if section else (), "engine").values():
        extras = set(child.free_attributes()) - {"id"} if child.name == "dynamics2d" else set()
        if child.child_names() or extras or child.name in argos.PHYSICS_ENGINES:
            child.leave_out("robots move in one plane, as the lab's own physics says")


def _read_address(root: Element) -> tuple[str, int]:
    """Reads where the robots find the server: from <experiment>, else from <framework>."""
    framework = root.child("framework")
    engine = _tracking_engine(root)
    host, port = DEFAULT_HOST, ROBOTS_PORT
    for element in (engine, framework, framework.child("experiment")):
        if element is not None:
            host = _read_host(element, host)
            port = element.integer("vss_port", 1, 65_535, port)
    return host, port


def _read_host(element: Element, default: str) -> str:
    """Reads an IPv4 address in numbers: robots look up no names, `localhost` is replaced here."""
    key, expected = "vss_host", "an IPv4 address such as '10.0.0.1', or 'localhost'"
    text = element.text(key, default, expected)
    try:
        return str(IPv4Address(DEFAULT_HOST if text == "localhost" else text))
    except ValueError:
        raise element.error(f"{shown(text)} is not {expected}", key) from None


def _tracking_engine(root: Element) -> Element | None:
    engines = root.optional_child("physics_engines")
    return None if engines is None else engines.optional_child(_ENGINE)


def read_tracker(root: Element) -> AnyTracker | None:
    """Reads where the arena state comes from, None where an experiment names no tracker."""
    framework = root.child("framework")
    engine = _tracking_engine(root)
    lines = framework.optional_child(_TRACKER)
    origin_m = (0.0, 0.0)
    if engine is not None:
        shift = [engine.number(f"translate_{axis}", -_FAR_M, _FAR_M, "m", 0.0) for axis in "xy"]
        origin_m = (shift[0], shift[1])
    address: AnyTracker | None = None
    for element in (framework, engine, lines):
        if element is None:
            continue
        tracker = _read_other(element) if element is lines else _read_original(element, origin_m)
        if tracker is not None and address is not None:
            raise element.error(f"a tracker stands in line {address.line} already")
        address = address or tracker
    return address


def _read_original(element: Element, origin_m: tuple[float, float]) -> TrackerAddress | None:
    named = [prefix for prefix in _PREFIXES if element.has(f"{prefix}_host")]
    if len(named) > 1:
        raise element.error("stands beside ats_host, expected one of them", "its_host")
    for prefix in _PREFIXES:
        if element.has(f"{prefix}_port") and prefix not in named:
            raise element.error(f"is without {prefix}_host", f"{prefix}_port")
    if not named:
        if element.has("vs:latency"):
            raise element.error("is without ats_host", "vs:latency")
        return None
    from vsense.robots.link.trackers.protocol import TRACKER_PORT  # few files name a tracker

    host = element.text(f"{named[0]}_host", None, "a host's name or address")
    port = element.integer(f"{named[0]}_port", 1, 65_535, TRACKER_PORT)
    latency_s = element.number("vs:latency", 0.0, _MAX_LATENCY_S, "s", 0.0)
    return TrackerAddress(host, port, origin_m, latency_s, element.line)


def _read_other(element: Element) -> JsonLinesTracker | MocapTracker:
    if element.choice("format", ("lines", "mocap")) == "mocap":
        return _read_mocap(element)
    host = element.text("host", "127.0.0.1", "a name or address of this machine")
    port = element.integer("port", 0, 65_535, LINES_PORT)
    return JsonLinesTracker(host, port, element.line)


def _read_mocap(element: Element) -> MocapTracker:
    host = element.text("host", "127.0.0.1", "the name or address of its server")
    others = _read_pairs(element, "settings", None, "names and values: 'interface_ip=10.0.0.2'")
    kind, up = element.choice("type", MOCAP_TYPES), element.choice("up", ("y", "z"), "z")
    settings = {"hostname": host, **others}
    return MocapTracker(MocapSystem(kind, settings, _read_bodies(element), up), element.line)


def _read_bodies(element: Element) -> dict[str, int]:
    """Reads which rigid body is which robot: "cf1=23, cf2=24"."""
    bodies: dict[str, int] = {}
    pairs = _read_pairs(element, "bodies", ",", "rigid bodies and tags: 'cf1=23, cf2=24'")
    for name, tag in pairs.items():
        if not tag.isdecimal() or len(tag) > 9:
            raise element.error(f"{shown(tag)} is not a tag", "bodies")
        if int(tag) in bodies.values():
            raise element.error(f"tag {tag} is there twice", "bodies")
        bodies[name] = int(tag)
    return bodies


def _read_pairs(element: Element, key: str, separator: str | None, expected: str) -> dict[str, str]:
    """Reads names and values; `separator` None: blanks."""
    pairs: dict[str, str] = {}
    text = element.text(key, None, expected) if element.has(key) else ""
    for part in text.split(separator) if text else ():
        name, sign, value = (word.strip() for word in part.partition("="))
        if not (name and sign and value):
            raise element.error(f"{shown(part.strip())}: expected {expected}", key)
        if name in pairs:
            raise element.error(f"{shown(name)} is there twice", key)
        pairs[name] = value
    return pairs
