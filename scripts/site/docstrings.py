"""Docstrings as Markdown: what sensors, actuators, world and loop functions say of themselves."""

from __future__ import annotations

import inspect
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import vsense.world.actuators
import vsense.world.sensors
from scripts.site.contents import ROOT
from vsense.world import entities, fields, loop_functions, world
from vsense.world.sensors import quality

_LABEL = re.compile(r"^(Args|Attributes|Raises|Returns|Source|Yields):\s*", re.MULTILINE)


def markdown(text: str) -> str:
    """A docstring as Markdown: indented parts are blocks, sections become lists."""
    parts = []
    for block in re.split(r"\n\s*\n", inspect.cleandoc(text)):
        lines = block.splitlines()
        if label := _LABEL.match(block):
            parts.append(_labelled(label[1], lines))
        elif lines[0].startswith("    "):
            parts.append(_code(textwrap.dedent(block)))
        elif indented := [i for i, line in enumerate(lines) if line.startswith("    ")]:
            parts += ["\n".join(map(_escaped, lines[: indented[0]]))]
            parts += [_code(textwrap.dedent("\n".join(lines[indented[0] :])))]
        else:
            parts.append("\n".join(map(_escaped, lines)))
    return _joined("\n\n".join(parts))


def _joined(text: str) -> str:
    """Blocks of code that follow each other are one."""
    return re.sub(r"\n```\n\n```(?:xml|text)\n", "\n\n", text)


def _code(text: str) -> str:
    language = "xml" if text.startswith("<") else "text"
    return f"```{language}\n{text}\n```"


def _labelled(label: str, lines: list[str]) -> str:
    """A section of a docstring: a sentence, or a list of its items."""
    rest = lines[0].partition(":")[2].strip()
    if rest:
        return f"*{label}:* " + _escaped(" ".join([rest, *(x.strip() for x in lines[1:])]))
    items = re.split(r"\n(?=\S)", textwrap.dedent("\n".join(lines[1:])))
    told = []
    for item in items:
        name, colon, what = " ".join(item.split()).partition(": ")
        told.append(f"- `{name}`: {_escaped(what)}" if colon else f"- {_escaped(name)}")
    return f"{label}:\n\n" + "\n".join(told)


def _escaped(line: str) -> str:
    """Prose in which `<element>`, `*` and `_` are no Markdown; what stands in backticks stays."""
    parts = re.split(r"(`[^`]*`)", line)
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"([\\*_\[\]<|^])", r"\\\1", parts[i])
        parts[i] = re.sub(r"(vs:\w+(?:\\_\w+)*(?:=\"[^\"]*\")?)", _as_code, parts[i])
    return "".join(parts)


def _as_code(name: re.Match[str]) -> str:
    return "`" + name[1].replace("\\", "") + "`"


def _modules(package: ModuleType) -> Iterator[ModuleType]:
    """The modules of a package that hold a device."""
    for info in pkgutil.iter_modules(package.__path__):
        module = import_module(f"{package.__name__}.{info.name}")
        is_device = hasattr(module, "ELEMENTS") or hasattr(module, "ARGOS_ELEMENTS")
        if is_device or module.__name__.endswith("users_file"):
            yield module


def _source(module: ModuleType) -> str:
    path = Path(str(module.__file__)).relative_to(ROOT)
    return f"[`{path}`](../{path})"


def devices() -> str:
    """The page of all sensors and actuators, from the top of each file."""
    parts = [
        "# Sensors and actuators\n",
        "Each is one file, and what follows is the top of these files: the element with its",
        "attributes, what the numbers mean, in which unit noise counts, and where the formula is",
        "from. How to [write one](../vsense/world/sensors/README.md); all",
        "[attributes with types and defaults](experiment.md#devices).\n",
        f"## Quality settings\n\n{markdown(str(quality.__doc__))}\n",
        f"## When a value is sent\n\n{markdown(str(quality.__doc__))}\n",
    ]
    for kind, package in (("sensor", vsense.world.sensors), ("actuator", vsense.world.actuators)):
        parts.append(f"## Virtual {kind}s\n")
        for module in _modules(package):
            name = module.__name__.rsplit(".", 1)[1].replace("_", "-")
            elements = [*getattr(module, "ELEMENTS", ()), *getattr(module, "ARGOS_ELEMENTS", ())]
            known = ", ".join(f"`<{element}>`" for element in elements) or "`<vs:sensor>`"
            parts.append(f"### {kind.capitalize()} {name}\n\n{known} · {_source(module)}\n")
            parts.append(markdown(str(module.__doc__)) + "\n")
    return "\n".join(parts)


def _members(kind: type, module: ModuleType) -> Iterator[str]:
    """The public members of a class that have a docstring, in the file's order."""
    for name, member in vars(kind).items():
        told = member.fget if isinstance(member, property) else member
        told = getattr(told, "__func__", told)
        text = getattr(told, "__doc__", None)
        if name.startswith("_") or not inspect.isfunction(told) or not text:
            continue
        signature = "" if isinstance(member, property) else _signature(told)
        yield f"### `{kind.__name__}.{name}{signature}`\n\n{markdown(text)}\n"


def _signature(function: object) -> str:
    """A function's arguments without `self`, as its source has them."""
    text = str(inspect.signature(function))  # type: ignore[arg-type]
    return re.sub(r"\(self(, )?", "(", text).replace("'", "")


THINGS = ("Box", "Cylinder", "Light", "Zone", "VirtualRobot", "Arena")
"""Classes of `entities.py` that loop functions put into a world."""


def world_page() -> str:
    """The page of loop functions and the world that they see."""
    parts = [
        "# Loop functions and the world\n",
        "Your own Python around every timestep, from the docstrings of the code. A whole one:",
        "[`foraging.py`](../vsense/config/experiments/foraging.py). Loop functions in C++ for",
        "ARGoS are called [as they are](../vsense/config/ARGOS.md#loop-functions).\n",
        f"## Loop functions\n\n{_source(loop_functions)}\n",
        markdown(str(loop_functions.__doc__)) + "\n",
        f"## World\n\n{_source(world)}\n\n{markdown(str(world.__doc__))}\n",
        markdown(str(world.World.__doc__)) + "\n",
        *_members(world.World, world),
        f"## Things in it\n\n{_source(entities)}\n",
    ]
    for name in THINGS:
        kind = getattr(entities, name)
        parts.append(f"### `{name}{_signature(kind)}`\n\n{markdown(str(kind.__doc__))}\n")
        parts += _members(kind, entities)
    for module, kind in ((fields, fields.Field), (fields, fields.Floor)):
        parts.append(f"## {kind.__name__}\n\n{_source(module)}\n\n{markdown(str(kind.__doc__))}\n")
        parts += _members(kind, module)
    return "\n".join(parts)
