"""What results depend on: a campaign's files and programs, and the machine that runs it.

Two machines give the same bits where they have the same vsense, NumPy, OpenCV and Python (from 3.12
on it sums floats otherwise), and where their processors and C libraries agree in the last digit of
sines and exponentials: NumPy computes them with the instructions that the processor has.
"""

from __future__ import annotations

import ast
import hashlib
import json
import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense import __version__
from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import PACKAGE_FOLDER, open_bytes
from vsense.modes.sim.outcome import Task
from vsense.robots import build
from vsense.robots.compiling import native
from vsense.robots.sources import HOSTED, LUA, commit
from vsense.world.robot_models import MODEL_SUFFIX, models_in

MAX_NAME = 256
"""[byte] Longer texts are no file names, and the system refuses to look for them."""

_DIGITS = 12


NAME_DIGITS = 10
"""Of a campaign's name. Those of vsense 0.1 have 8; see `campaign._name_before`."""


def of_campaign(task: Task) -> str:
    """What all runs of a campaign have in common, as `NAME_DIGITS` hexadecimal digits.

    That is the experiment's file with the files it names, the programs with their headers, the
    length, the robots, whether they are blind, vsense's version, and which settings vary; not their
    values and the seeds, of which more may come.

    Raises:
        VsenseError: a file cannot be read.
    """
    setup = task.job.setup
    digest = hashlib.sha256()
    programs = [controller.program for controller in task.experiment.controllers]
    sources = [path for program in programs for path in program.sources]
    for file in (*named_files(task.experiment.path), *sources):
        digest.update(bytes.fromhex(of_file(file)))
    words = [os.environ.get("CXXFLAGS"), setup.duration_s, setup.robots, setup.blind]
    words += [*sorted(of_files(task).values()), *setup.settings]
    digest.update(json.dumps([__version__, *words]).encode())
    return digest.hexdigest()[:NAME_DIGITS]


def of_file(path: Path) -> str:
    """The SHA-256 of a file.

    Raises:
        VsenseError: it cannot be read.
    """
    with failing_as(VsenseError, f"{path}: cannot be read"):
        digest = hashlib.sha256()
        with open_bytes(path) as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    return digest.hexdigest()


def of_files(task: Task) -> dict[str, str]:
    """The digests of all files of a user that a run reads, by their absolute paths.

    What the Python files among them open themselves is not known.

    Raises:
        VsenseError: a file cannot be read, or a controller's headers not be found.
    """
    experiment = task.experiment
    programs = [controller.program for controller in experiment.controllers]
    files = dict.fromkeys(named_files(experiment.path))
    if experiment.loop_functions is not None:
        files[experiment.loop_functions.path] = None
        programs += [p for p in [experiment.loop_functions.program] if p is not None]
    for program in programs:
        if program.is_hosted:  # it may be another than the one that the experiment names
            files.update(dict.fromkeys(_with_imports(program.sources, experiment.path.parent)))
            continue
        sources = build.source_tree().runtime(program).dependencies(native())
        files.update(dict.fromkeys(sources))
    ours = [PACKAGE_FOLDER, *build.source_tree().resolved()]
    users = [p for p in files if not any(p.resolve().is_relative_to(root) for root in ours)]
    return {os.path.abspath(path): of_file(path) for path in users}


_QUOTED = re.compile(r"\"([^\"<]*)\"|'([^'<]*)'")
_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)
_REQUIRED = re.compile(r"\brequire\s*\(?\s*[\"']([\w./-]+)[\"']")


def named_files(path: Path) -> list[Path]:
    """An experiment's file, every file that an attribute in it names, models of robots, and
    what Python and Lua among them import from beside them.

    The file is not parsed: ARGoS's files need not be well-formed. What its comments name does not
    count.
    """
    import html  # a single run waits for no table of entities

    quoted = _QUOTED.findall(_COMMENT.sub(" ", _text(path)))
    values = {html.unescape(double or single) for double, single in quoted}
    # Of models all: a setting may choose any.
    values |= {f"{name}{MODEL_SUFFIX}" for name in models_in(path.parent)}
    named = (path.parent / value for value in sorted(values) if value and len(value) < MAX_NAME)
    return _with_imports([path, *(file for file in named if os.path.isfile(file))], path.parent)


def _with_imports(paths: Sequence[Path], folder: Path) -> list[Path]:
    """These files, and all that Python and Lua among them import; `folder`: the experiment's."""
    files = dict.fromkeys(paths)
    waiting = [file for file in files if file.suffix in HOSTED]
    while waiting:
        file = waiting.pop()
        imported = _required(file) if file.suffix == LUA else _imported(file, folder)
        more = [other for other in imported if other not in files]
        waiting += more
        files.update(dict.fromkeys(more))
    return list(files)


def _required(file: Path) -> list[Path]:
    """What a script in Lua may require from beside it: NAME.lua or NAME/init.lua, as in ARGoS."""
    names = (name.replace(".", "/").lstrip("/") for name in _REQUIRED.findall(_text(file)))
    places = (file.parent / f"{name}{end}" for name in names for end in (".lua", "/init.lua"))
    return [place for place in places if os.path.isfile(place)]


def _imported(file: Path, folder: Path) -> list[Path]:
    """What a Python file may import from beside it, or from the experiment's folder: modules, and
    all of packages. Python's own modules and vsense come first, whatever lies there.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(_text(file))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return []  # nothing runs that imports it
    names: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names.append(node.module or "")
    own = {name.partition(".")[0] for name in names if name} - sys.stdlib_module_names - {"vsense"}
    found = []
    for place in dict.fromkeys((file.parent, folder)):
        for name in sorted(own):
            found += [place / f"{name}.py", *sorted((place / name).rglob("*.py"))]
    return [path for path in found if os.path.isfile(path)]


def _text(path: Path) -> str:
    with failing_as(VsenseError, f"{path}: cannot be read"):
        return path.read_text(encoding="utf-8", errors="replace")


Machine = Mapping[str, str]
"""What of a machine changes results, by the names of `of_machine`."""

VERSIONS = ("vsense", "Python", "NumPy", "OpenCV")
_OWN = "sources"


@lru_cache(maxsize=1)
def of_machine() -> Machine:
    """This machine: versions, vsense's own sources, and the last digits of functions.

    Raises:
        VsenseError: vsense's own C sources are missing.
    """
    import cv2  # only a cluster asks

    python = ".".join(map(str, sys.version_info[:2]))
    versions = zip(VERSIONS, (__version__, python, np.__version__, cv2.__version__))
    return {**dict(versions), _OWN: build.own_sources(), **_last_digits()}


def difference(expected: Machine) -> str:
    """Says in words why this machine would give other results; "": it would not.

    `expected`: `of_machine` where the campaign was begun.
    """
    machine = of_machine()
    for name in VERSIONS:
        if machine[name] != expected.get(name):
            return f"has {name} {machine[name]}, expected {expected.get(name)}"
    if machine[_OWN] != expected[_OWN]:
        return (
            f"has other sources of vsense {__version__} ({machine[_OWN]}, expected"
            f" {expected[_OWN]}): install the same there, and start the worker again"
        )
    differing = [name for name in machine if machine[name] != expected.get(name)]
    if differing:
        return (
            f"computes other last digits ({', '.join(differing)}): its processor or C library is of"
            " another kind, and its results would not be those of this machine"
        )
    return ""


def software() -> dict[str, str]:
    """Which vsense this is: version, digest of its sources, and its commit, "" where not known."""
    return {"vsense": __version__, "sources": build.own_sources(), "commit": commit()}


Function = Callable[[NDArray[np.float64]], Any]


def _map(function: Callable[[float], float], numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([function(number) for number in numbers])


def _last_digits() -> dict[str, str]:
    """Digests of what functions give for some thousand numbers."""
    numbers = np.linspace(-20.0, 20.0, 4096)
    other = numbers[::-1]
    functions: dict[str, Function] = {
        "sin": np.sin,
        "cos": np.cos,
        "tan": np.tan,
        "exp": np.exp,
        "log": lambda x: np.log(np.abs(x) + 0.1),
        "arctan2": lambda x: np.arctan2(x, other),
        "hypot": lambda x: np.hypot(x, other),
        "norm": lambda x: np.linalg.norm(x.reshape(-1, 4), axis=-1),
        "einsum": lambda x: np.einsum("ni,ni->n", x.reshape(-1, 4), other.reshape(-1, 4)),
        "matmul": lambda x: x.reshape(-1, 4) @ other[:4],
        "standard_normal": lambda x: np.random.default_rng(1).standard_normal(len(x)),
    }
    for c_function in (math.sin, math.cos, math.exp, math.atan):
        functions[f"C's {c_function.__name__}"] = partial(_map, c_function)
    return {
        name: hashlib.sha256(np.ascontiguousarray(function(numbers)).tobytes()).hexdigest()[
            :_DIGITS
        ]
        for name, function in functions.items()
    }
