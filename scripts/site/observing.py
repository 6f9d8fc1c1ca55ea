"""What the reader of experiment files asks for: every element, attribute, type, unit and default.

It watches the reader while it reads files that use everything: those of the tests, and the shipped
experiments. So what is written of it can name nothing that is not read, and leave out nothing.
"""

from __future__ import annotations

import inspect
import math
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, wraps
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from scripts.site.contents import ROOT
from tests.config.tables import (
    OWN_ACTUATOR,
    OWN_SENSOR,
    at_the_original,
    by_motion_capture,
    with_the_rest,
)
from vsense.base.errors import ConfigError
from vsense.base.xml.element import Element
from vsense.config import argos
from vsense.config.devices import ACTUATORS, SENSORS, of_argos
from vsense.config.experiment import load, read, shipped
from vsense.config.specs import Stage

READERS = (
    "text", "number", "integer", "share", "angle", "vector", "numbers", "boolean", "choice",
    "integers", "points", "has",
)  # fmt: skip
"""The methods of `Element` that ask for an attribute."""

CONTROLLER = "CONTROLLER"
"""Stands for the element of a controller, whose name is the user's own."""

FREE = ("params", "loop_functions")
"""Elements in which names are the user's own."""

_OWN_OF_LOOP = ("library", "label", "vs:sources", "vs:include")


@dataclass
class AskedAttribute:
    """What is known of an attribute.

    Attributes:
        kind: type, unit and bounds in words; "" where nobody asks for more than its presence.
        defaults: as they would stand in the file; several where it depends.
        asked: of how many elements it was asked.
        required: a file is refused in which it is left out; `tried`: that was asked.
    """

    kind: str = ""
    defaults: set[str] = field(default_factory=set)
    asked: int = 0
    required: bool = False
    tried: bool = False


@dataclass
class AskedElement:
    """What is known of an element.

    Attributes:
        read: how many there were in the files.
        children: names that it may hold.
        examples: its start tags, as files have them.
    """

    read: int = 0
    attributes: dict[str, AskedAttribute] = field(default_factory=dict)
    children: set[str] = field(default_factory=set)
    examples: list[str] = field(default_factory=list)


Asked = dict[tuple[str, str], AskedElement]
"""By the names of an element's parent and of itself; the outermost element has the parent ""."""


@cache
def observed() -> Asked:
    """What the reader asks for, over all files that are read here."""
    found: Asked = {}
    files: list[tuple[Element, Callable[[], object]]] = []
    with _watched() as calls:
        for read_one in _samples():
            calls.clear()
            roots: list[Element] = []
            with _roots(roots), suppress(ConfigError):
                read_one()
            for root in roots:
                _collect(root, "", calls, found)
                files.append((root, read_one))
    for root, read_one in files:
        _ask_for_required(root, read_one, found)
    return found


def _ask_for_required(root: Element, read_one: Callable[[], object], found: Asked) -> None:
    """Leaves out, one after the other, attributes of a file of which nothing is known yet."""
    for element in root.walk():
        places = [p for p in found if p[1] in (element.name, CONTROLLER)]
        for key in element._attributes:
            known = [found[place].attributes.get(key) for place in places]
            untried = [a for a in known if a and a.kind and not a.defaults and not a.tried]
            refused = bool(untried) and _refused_without(element.name, key, read_one)
            for attribute in untried:
                attribute.tried, attribute.required = True, refused


def _refused_without(name: str, key: str, read_one: Callable[[], object]) -> bool:
    """Whether a file is refused because all its elements of a name are without an attribute."""
    make = Element.__init__

    def without(
        element: Element, document: Any, own: str, line: int, given: dict[str, str]
    ) -> None:
        kept = {k: v for k, v in given.items() if own != name or k != key}
        make(element, document, own, line, kept)

    Element.__init__ = without  # type: ignore[method-assign]
    try:
        read_one()
    except ConfigError as error:
        return f"<{name}> {key}: is missing" in str(error)
    finally:
        Element.__init__ = make  # type: ignore[method-assign]
    return False


def _samples() -> Iterator[Callable[[], object]]:
    """Reads of files that together use all that is known, in every stage."""
    folder = Path(tempfile.mkdtemp())
    for name in ("mine.c", "foo.cpp"):
        (folder / name).touch()
    (folder / "doors.py").write_text("class Doors:\n    def reset(self, world): ...\n")
    (folder / "own.py").write_text(OWN_SENSOR)
    (folder / "act.py").write_text(OWN_ACTUATOR)
    cv2.imwrite(str(folder / "floor.png"), np.zeros((4, 6, 3), dtype=np.uint8))
    tests = ROOT / "tests" / "config"
    full = (tests / "full.argos").read_text()
    cpp = full.replace('library="doors.py"', 'library="libfoo.so" vs:sources="foo.cpp"')
    devices = (tests / "every_device.argos").read_text()
    drawn = full.replace(_UNIFORM, _GAUSSIAN)
    places = full.replace('vs:black="nest"', _BLACK_RECTANGLE)
    named = full.replace("white_min_x=", 'vs:white="food" white_min_x=')
    ghost = full.replace('vs:virtual="true">', 'vs:virtual="true"><battery /><dynamics2d />')
    passed_over = ghost.replace("</framework>", _PASSED_OVER)
    mocap = by_motion_capture(full)
    others = (drawn, places, named, passed_over, mocap, *_each_device())
    original = at_the_original(full).replace("ats_port=", 'vs:latency="0.04" ats_port=')
    for text in (full, with_the_rest(full), original, cpp, devices, *others):
        for stage in (Stage.SIM, Stage.RUN):
            yield lambda text=text, stage=stage: read(  # type: ignore[misc]
                text.encode(), "x.argos", folder / "x.argos", None, None, stage, True
            )
    for name in shipped():
        yield lambda name=name: load(name)  # type: ignore[misc]


_UNIFORM = 'method="uniform" min="-1.4,-1.1,0" max="1.4,1.1,0"'
_GAUSSIAN = 'method="gaussian" mean="0,0,0" std_dev="0.5,0.5,0"'
_PASSED_OVER = "<profiling /></framework><visualization><a /></visualization>"
_BLACK_RECTANGLE = 'black_min_x="0" black_min_y="0" black_max_x="1" black_max_y="1"'
_ONE_DEVICE = """<argos-configuration xmlns:vs="urn:vsense:1">
<framework><experiment length="1" ticks_per_second="10" /></framework>
<controllers><c id="c" library="mine.c"><{section}><{device} /></{section}></c></controllers>
<arena size="2,2,1"><e-puck id="a_1_1" vs:model="{model}">
<body position="0,0,0" orientation="0,0,0" />
<controller config="c" /></e-puck></arena></argos-configuration>"""


def _each_device() -> Iterator[str]:
    """An experiment for each device of ARGoS's that is known."""
    for section in (SENSORS, ACTUATORS):
        for device in sorted({*of_argos(section), *argos.OWN_DEVICES[section]}):
            model = "kheperaiv" if device.startswith("kheperaiv") else "epuck"
            yield _ONE_DEVICE.format(section=section, device=device, model=model)


_Calls = dict[int, list[tuple[str, str, dict[str, Any]]]]
"""Of each element, by its identity: method, attribute, and the method's other arguments."""


@contextmanager
def _watched() -> Iterator[_Calls]:
    """Notes every outermost call of a method of READERS."""
    calls: _Calls = {}
    inside = False

    def watching(name: str, method: Callable[..., Any]) -> Callable[..., Any]:
        signature = inspect.signature(method)

        @wraps(method)
        def call(element: Element, *given: Any, **named: Any) -> Any:
            nonlocal inside
            if inside:
                return method(element, *given, **named)
            bound = signature.bind(element, *given, **named)
            bound.apply_defaults()
            arguments = dict(list(bound.arguments.items())[1:])
            calls.setdefault(id(element), []).append((name, arguments.pop("key"), arguments))
            inside = True
            try:
                return method(element, *given, **named)
            finally:
                inside = False

        return call

    methods = {name: getattr(Element, name) for name in READERS}
    for name, method in methods.items():
        setattr(Element, name, watching(name, method))
    try:
        yield calls
    finally:
        for name, method in methods.items():
            setattr(Element, name, method)


@contextmanager
def _roots(found: list[Element]) -> Iterator[None]:
    """Notes the outermost element of each file that is read to its end."""
    check = Element.check_all_read

    def note(element: Element) -> None:
        if element.name == "argos-configuration":
            found.append(element)
        check(element)

    Element.check_all_read = note  # type: ignore[method-assign]
    try:
        yield
    finally:
        Element.check_all_read = check  # type: ignore[method-assign]


def _collect(element: Element, parent: str, calls: _Calls, found: Asked) -> None:
    name = CONTROLLER if parent == "controllers" else element.name
    # What is distributed is what may stand in the arena.
    parent = "arena" if parent == "entity" else parent
    known = found.setdefault((parent, name), AskedElement())
    known.read += 1
    if name not in FREE:
        known.children |= element._asked_children
    for key in element._asked_attributes:
        if name not in FREE or (key in _OWN_OF_LOOP and name == "loop_functions"):
            attribute = known.attributes.setdefault(key, AskedAttribute())
            attribute.asked += 1
    for method, key, arguments in calls.get(id(element), ()):
        if key in known.attributes:
            _note(known.attributes[key], method, arguments)
    written = [f'{key}="{" ".join(text.split())}"' for key, text in element._attributes.items()]
    known.examples.append(" ".join([f"<{element.name}", *written, "/>"]))
    if name not in FREE and not element._left_out:
        for child in element._children:
            _collect(child, name, calls, found)


def _note(attribute: AskedAttribute, method: str, arguments: dict[str, Any]) -> None:
    if method == "has":
        return
    attribute.kind = attribute.kind or _kind(method, arguments)
    default = arguments.get("default", arguments.get("default_deg"))
    if default not in (None, ""):
        attribute.defaults.add(_plain(default))


def _kind(method: str, arguments: dict[str, Any]) -> str:
    """Type, bounds and unit of an attribute in words."""
    low, high, unit = (arguments.get(key) for key in ("low", "high", "unit"))
    bounds = "" if low is None else f", {_plain(low)} to {_plain(high)}"
    match method:
        case "choice":
            return "one of " + ", ".join(f"`{word}`" for word in arguments["choices"])
        case "boolean":
            return "`true` or `false`"
        case "share":
            return "percentage, such as `50%`"
        case "angle":
            degrees = f"{_plain(arguments['low_deg'])} to {_plain(arguments['high_deg'])}"
            return f"number [deg], {degrees}"
        case "integer":
            return f"whole number{bounds}"
        case "integers":
            return f"whole numbers{bounds}"
        case "points":
            return f"`x,y x,y x,y` [{unit}], {arguments['least']} to {arguments['most']} points"
        case "text":
            return str(arguments["expected"]).removeprefix("a ").removeprefix("an ")
    form = {"number": "number", "vector": "`x,y,z`"}.get(method) or (
        "`x,y`" if arguments["count"] == 2 else "`x,y,z`"
    )
    return f"{form}{f' [{unit}]' if unit else ''}{bounds}"


def _plain(value: object) -> str:
    """A number as one writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:.10g}"
    return str(value)
