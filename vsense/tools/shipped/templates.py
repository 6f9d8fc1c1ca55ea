"""Makes the files of a new experiment: copies of a shipped one, renamed.

The copy of an experiment has its `.argos` file, its controllers and its loop functions. What
was called as the experiment is called as the new one; several controllers keep their names.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vsense.base.errors import UsageError, failing_as, instead
from vsense.config.experiment import ARGOS_SUFFIX, SHIPPED_FOLDER, shipped
from vsense.robots.build import source_tree
from vsense.robots.compiling import BuildError
from vsense.robots.sources import MAX_NAME_BYTES
from vsense.tools.shipped import _guide

TEMPLATE = "start"
"""The template that is made to begin with: the smallest experiment that has everything."""

_PYTHON = f"{TEMPLATE}_controller.py"
"""Its controller in Python; its loop functions have the shorter name."""
_NOTEBOOK = f"{TEMPLATE}.ipynb"
_CI = {
    f"{TEMPLATE}_test.py": "test_{name}.py",
    "github.yml": ".github/workflows/behaviour.yml",
    "gitlab.yml": ".gitlab-ci.yml",
}
"""Its behaviour test, and where two services want to have their files."""

_NAME = re.compile(rf"[A-Za-z][A-Za-z0-9_-]{{0,{MAX_NAME_BYTES - 1}}}")

_SENSOR = """
        <!-- A sensor of your own, {file}: how many others are within reach [m]. -->
        <vs:sensor file="{file}" reach="0.3" />
"""

_INIT = re.compile(r"^static void init\([^)]*\)\s*\{\s*struct (\w+) \*(\w+) = state;\n\n", re.M)
_INIT_PYTHON = re.compile(r'^    def __init__\(self, robot.*?"""\n', re.M | re.S)
_STEP_PYTHON = re.compile(r'^    def step\(self, robot.*?"""\n', re.M | re.S)
_STEP = re.compile(r"^static void step\(.*?\n\n", re.M | re.S)


def templates() -> tuple[str, ...]:
    """The names of what an experiment can be made from."""
    return (TEMPLATE, *shipped())


@dataclass(frozen=True, slots=True)
class _Template:
    """An experiment's files as they are shipped.

    Attributes:
        argos: text of the experiment file.
        folder: where it is, and its loop functions.
        controllers: paths of the controllers by the library that the file names.
        notebook: None: there is none, or nobody wants it.
    """

    argos: str
    folder: Path
    controllers: Mapping[str, Path]
    notebook: Path | None


def make(
    folder: Path,
    source: str = TEMPLATE,
    sensor: bool = False,
    python: bool = False,
    notebook: bool = False,
    ci: bool = False,
) -> tuple[Path, ...]:
    """Makes a folder with an experiment's files and a README that explains them line by line.

    Args:
        folder: where they go: it is new, or empty. Its name is the experiment's.
        source: what is copied, one of `templates()`.
        sensor: a virtual sensor of one's own is added, which the controllers read and show.
        python: the controller is in Python; only `TEMPLATE` has one.
        notebook: the first hour as a notebook for Jupyter; only of `TEMPLATE`.
        ci: a test of its behaviour, and what has GitHub and GitLab run it; only of `TEMPLATE`.

    Returns:
        The files, the one to run first.

    Raises:
        UsageError: the name cannot be an experiment's, there is no such template, it has no
            controller in Python, no notebook or no test, or the folder holds something or cannot
            be written.
        BuildError: vsense's own files are incomplete.
    """
    name = _checked(folder)
    _check_source(source, python, notebook, ci)
    texts = _renamed(_read(source, python, notebook), source, name)
    if sensor:
        texts = _with_sensor(texts, name)
    if ci:
        texts |= _behaviour_test(name)
    texts["README.md"] = _guide.write(name, source, texts)
    _write(folder, texts)
    return tuple(folder / file for file in texts)


def _checked(folder: Path) -> str:
    """The name of a new experiment; UsageError where it can be none."""
    name = folder.name
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"{name or str(folder)!r}: expected a name of letters, digits, - and _, at most"
            f" {MAX_NAME_BYTES}, a letter first"
        )
    if name in shipped() or name in source_tree().controllers():
        raise UsageError(f"{name!r} is the name of what comes with vsense: choose another one")
    if name in (*sys.stdlib_module_names, "numpy", "cv2", "vsense"):
        words = "is the name of a module, which Python would not find any more: choose another one"
        raise UsageError(f"{name!r} {words}")
    if folder.is_symlink() or os.path.exists(folder):
        with failing_as(UsageError, f"cannot make {folder}"):
            if any(folder.iterdir()):
                raise UsageError(f"{folder} is not empty: choose another name")
    return name


def _check_source(source: str, python: bool, notebook: bool, ci: bool) -> None:
    """UsageError: it is no template, or has not all that is wanted."""
    if source not in templates():
        raise UsageError(
            f"there is no experiment {source!r} to begin with; {instead(source, templates())}"
        )
    if python and source != TEMPLATE:
        raise UsageError(f"--python: the controllers of {source!r} are in C; leave out --from")
    for option, is_wanted in (("--notebook", notebook), ("--ci", ci)):
        if is_wanted and source != TEMPLATE:
            raise UsageError(f"{option}: there is none about {source!r}; leave out --from")


def _behaviour_test(name: str) -> dict[str, str]:
    """The texts of the test and of what runs it, by the places of the files."""
    texts = {}
    for file, place in _CI.items():
        text = (SHIPPED_FOLDER / TEMPLATE / file).read_text(encoding="utf-8")
        argos = f"{name}{ARGOS_SUFFIX}"
        texts[place.format(name=name)] = text.replace(f"{TEMPLATE}{ARGOS_SUFFIX}", argos)
    return texts


def _read(source: str, python: bool, notebook: bool) -> _Template:
    folder = SHIPPED_FOLDER
    folder = folder / TEMPLATE if source == TEMPLATE else folder
    argos = (folder / f"{source}{ARGOS_SUFFIX}").read_text(encoding="utf-8")
    own = f"{TEMPLATE}.c"
    controllers = source_tree().controllers() | {own: folder / own}
    if python:
        controllers[_PYTHON] = folder / _PYTHON
        argos = argos.replace(f'library="{own}"', f'library="{_PYTHON}"')
    named = re.findall(r'<\w+_controller [^>]*?library="([^"]+)"', argos)
    own_files = {library: controllers[library] for library in named}
    return _Template(argos, folder, own_files, folder / _NOTEBOOK if notebook else None)


def _renamed(template: _Template, source: str, name: str) -> dict[str, str]:
    """The texts of the new files by their names, the experiment's first."""
    argos = template.argos
    single = len(template.controllers) == 1
    files = {f"{source}{ARGOS_SUFFIX}": f"{name}{ARGOS_SUFFIX}"}
    texts = {}
    for library, path in template.controllers.items():
        stem = path.stem
        if single:
            stem = name + path.stem.removeprefix(source) if path.name == _PYTHON else name
        file = files[path.name] = f"{stem}{path.suffix}"
        argos = argos.replace(f' library="{library}"', f' library="{file}"')
        text = path.read_text(encoding="utf-8")
        texts[file] = text.replace(
            f'vs_controller = {{"{path.stem}"', f'vs_controller = {{"{stem}"'
        )
    for python in re.findall(r'<loop_functions library="([^"]+)"', argos):
        files[python] = f"{name}.py"
        texts[f"{name}.py"] = (template.folder / python).read_text(encoding="utf-8")
    if template.notebook is not None:
        text = template.notebook.read_text(encoding="utf-8")
        texts[f"{name}{template.notebook.suffix}"] = text.replace(f"# {source}:", f"# {name}:")
    texts = {f"{name}{ARGOS_SUFFIX}": argos, **texts}
    return {file: _reworded(text, files, source, name) for file, text in texts.items()}


def _reworded(text: str, files: Mapping[str, str], source: str, name: str) -> str:
    """A file's text in which the copies are called as they are now."""
    called = re.compile(
        rf"(?<![\w./-])(?:robot/controllers/)?({'|'.join(map(re.escape, files))})(?![\w-])"
    )
    text = called.sub(lambda match: files[match[1]], text)
    command = re.compile(rf"\b(vsense (?:sim|lab|run)) {re.escape(source)}(?![\w.-])")
    return command.sub(rf"\1 {name}{ARGOS_SUFFIX}", text)


def _with_sensor(texts: Mapping[str, str], name: str) -> dict[str, str]:
    """The files with a sensor: mounted on all robots, read and shown by all controllers."""
    file = f"{name}_sensor.py"
    sensor = SHIPPED_FOLDER / TEMPLATE / "crowd.py"
    mounted = _SENSOR.format(file=file)
    files = {
        key: re.sub(r"(\n)( *</sensors>)", lambda end: f"{mounted}{end[2]}", text)
        if key.endswith(ARGOS_SUFFIX)
        else _reading(text)
        if key.endswith((".c", _PYTHON.removeprefix(TEMPLATE)))
        else text
        for key, text in texts.items()
    }
    return files | {file: sensor.read_text(encoding="utf-8").replace("crowd.py", file)}


def _reading(controller: str) -> str:
    """A controller that reads the sensor, and shows what it reads."""
    if _INIT_PYTHON.search(controller):
        bind = '        self.crowd = robot.sensor("crowd")  # how many others are near\n'
        show = '        robot.show("crowd", self.crowd.value)\n'
        text = _INIT_PYTHON.sub(lambda match: f"{match[0]}{bind}", controller)
        return _STEP_PYTHON.sub(lambda match: f"{match[0]}{show}", text)
    begun = _INIT.search(controller)
    if begun is None:
        raise BuildError("a shipped controller has no init: install vsense again")
    state, pointer = f"struct {begun[1]} {{\n", begun[2]
    bind = f'    {pointer}->crowd = vs_robot_sensor(robot, "crowd");\n'
    show = f'    vs_robot_show(robot, "crowd", vs_robot_read(robot, {pointer}->crowd).value);\n'
    text = _INIT.sub(lambda match: f"{match[0]}{bind}", controller)
    text = _STEP.sub(lambda match: f"{match[0]}{show}", text)
    return text.replace(state, f"{state}    int crowd; /* how many others are near */\n", 1)


def _write(folder: Path, texts: Mapping[str, str]) -> None:
    """Makes the folder with all files in it, or nothing."""
    with failing_as(UsageError, f"cannot make {folder}"):
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as staging:
            new = Path(staging) / folder.name
            new.mkdir()
            for file, text in texts.items():
                (new / file).parent.mkdir(parents=True, exist_ok=True)
                (new / file).write_text(text, encoding="utf-8")
            os.replace(new, folder)
