"""The README of an experiment that somebody begins with: its files, explained line by line.

Of elements it says what `_sentences.py` has, of devices else the head of the file that makes
them, of calls the comment in the controllers' header.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse
from vsense.config.devices import ACTUATORS, SENSORS, factories
from vsense.robots.build import source_tree
from vsense.tools.shipped._sentences import explanations, places

_PARAGRAPH = "\n\n"

_WITHIN = {"body", "controller", "dynamics2d", "led"}
"""Elements that are explained with the one that holds them."""

_CALLED = {
    "__init__": "before the first run",
    "reset": "at the beginning of every run",
    "pre_step": "in every timestep, before robots sense",
    "post_step": "in every timestep, after robots sense; `world.results` are the measures",
    "end": "at the end of every run; gives measures of the whole run",
}

_PROTOTYPE = re.compile(r"/\*((?:(?!\*/).)*)\*/\n(?:[\w *]*?\b(vs_\w+)\([^;{]*\);\n)+", re.S)
_NAMES = re.compile(r"\b(vs_\w+)\(")


def write(name: str, source: str, texts: Mapping[str, str]) -> str:
    """Gives the README of an experiment.

    Args:
        name: the experiment's.
        source: what it was made from.
        texts: its files by their names, the `.argos` file first.
    """
    argos = next(iter(texts))
    root = parse(texts[argos].encode(), argos, of_argos=True)
    lines = [
        f"# {name}",
        "",
        f"Made by `vsense new {name} --from {source}{_options(root, texts)}`.",
        *_commands(root, texts),
    ]
    lines += ["", f"## {argos}", "", *_table("line", "element", "what it says")]
    lines += [f"| {at} | `{shown}` | {meaning} |" for at, shown, meaning in _rows(root)]
    for file, text in texts.items():
        if file.endswith(".c"):
            lines += ["", f"## {file}", "", *_of_controller(text)]
        elif file.endswith(".py"):
            lines += ["", f"## {file}", "", *_of_python(text)]
    return "\n".join([*lines, "", *_further()])


def _options(root: Element, texts: Mapping[str, str]) -> str:
    notebook = any(file.endswith(".ipynb") for file in texts)
    chosen = {"sensor": _has_sensor(root), "python": _is_python(texts), "notebook": notebook}
    chosen["ci"] = any(file.endswith(".yml") for file in texts)
    return "".join(f" --{name}" for name, is_chosen in chosen.items() if is_chosen)


def _is_python(texts: Mapping[str, str]) -> bool:
    """Whether no robot runs its controllers."""
    return not any(file.endswith(".c") for file in texts)


def _commands(root: Element, texts: Mapping[str, str]) -> list[str]:
    argos = next(iter(texts))
    lines = [
        (f"vsense sim {argos} --dry", "what the file holds, and what of it is not supported"),
        (f"vsense sim {argos}", "in the simulator: a picture and figures in runs/"),
        (f"vsense sim {argos} --blind", "the control: every virtual sensor held at 0"),
        *_sweep(root, argos),
    ]
    there = "in real time, the whole chain; --web 8080 shows it (extra web)"
    boards = f"vsense robot build --experiment {argos} --target epuck"
    lines += [(f"vsense lab {argos}", there), (boards, "for real robots (extra robot)")]
    shown = [f"{command:{len(lines[0][0])}}  # {meaning}" for command, meaning in lines]
    return ["", "## Run it", "", "In this folder:", "", "```sh", *shown, "```"]


def _sweep(root: Element, argos: str) -> Iterator[tuple[str, str]]:
    """A campaign over half a parameter and all of it, where there is one that is a number."""
    for kind in root.below("controllers")[0].below():
        for params in kind.below("params"):
            for key, value in params.free_attributes().items():
                if re.fullmatch(r"[0-9]*\.?[0-9]+", value) and float(value) > 0.0:
                    name, half = f"{kind.peek('id')}.{key}", float(value) / 2.0
                    command = f"vsense sim {argos} --runs 10 --set {name}={half:g},{value}"
                    yield command, "a campaign that compares two values"
                    return


def _has_sensor(root: Element) -> bool:
    return any(element.name == "vs:sensor" for element in root.walk())


def _table(*heads: str) -> list[str]:
    return [f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}"]


def _rows(root: Element) -> Iterator[tuple[str, str, str]]:
    """Line or lines, start tag in short and meaning of each element; several of a kind are one."""

    def walk(element: Element, parent: str) -> Iterator[tuple[Element, str]]:
        yield element, parent
        for child in element.below():
            if child.name not in _WITHIN:
                yield from walk(child, element.name)

    rows: list[tuple[list[int], Element, str]] = []
    for element, parent in walk(root, ""):
        if rows and rows[-1][1].name == element.name:
            rows[-1][0].append(element.line)
        else:
            rows.append(([element.line], element, parent))
    for at, element, parent in rows:
        named = element.peek("id") if len(at) == 1 else None
        shown = f'<{element.name} id="{named}">' if named else f"<{element.name}>"
        numbers = str(at[0]) if len(at) == 1 else f"{at[0]} to {at[-1]}"
        yield numbers, shown, _meaning(element, parent)


def _meaning(element: Element, parent: str) -> str:
    if parent == "controllers":
        return (
            f"One kind of robot: `library` is its program, `{element.peek('library')}`; robots name"
            " it by its `id`."
        )
    if parent == "loop_functions":
        return "Settings for the loop functions, too."
    if element.name == "vs:sensor":
        return f"A sensor of your own: `{element.peek('file')}`."
    if element.name == "vs:actuator":
        return f"An actuator of your own: `{element.peek('file')}`."
    said = (explanations().get((place, "")) for place in places(parent, element.name))
    if sentence := next(filter(None, said), ""):
        return _sentence(sentence)
    if parent in (SENSORS, ACTUATORS) and element.name in factories(parent):
        file = Path(inspect.getfile(factories(parent)[element.name]))
        head = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
        return f"{_sentence(head.split(_PARAGRAPH)[0])} `vsense docs {parent}/{file.name}`"
    return ""


def _sentence(text: str) -> str:
    """Text on one line, as a cell of a table."""
    line = " ".join(text.split()).replace("|", "\\|")
    return line[:1].upper() + line[1:]


@cache
def calls() -> dict[str, str]:
    """What `controller.h` and `walk.h` say of each function, by its name."""
    sentences = {}
    for header in ("controller.h", "walk.h"):
        text = (source_tree().root / "robot" / header).read_text(encoding="utf-8")
        for prototype in _PROTOTYPE.finditer(text):
            comment = re.sub(r"\n \*(?= |\n)", "\n", prototype[1])
            for name in _NAMES.findall(prototype[0][len(prototype[1]) :]):
                sentences[name] = _sentence(comment)
    return sentences


def _of_controller(text: str) -> list[str]:
    used = dict.fromkeys(name for name in _NAMES.findall(text) if name in calls())
    return [
        "The robots' program, in C99. `init` is called when a run begins, `step` in every timestep;"
        " what a robot remembers is in its `struct`. The last line names all three. It calls:",
        "",
        *_table("function", "what it does"),
        *(f"| `{name}` | {calls()[name]} |" for name in used),
    ]


_OF_ROBOT = (
    "`robot` has `sensor`, `actuator`, `walk`, `param`, `set_wheels`, `set_leds`, `random`, `show`"
    " and `log`: see `vsense docs extending`, 'A controller in Python'."
)


def _of_python(text: str) -> list[str]:
    """What a Python file is, and when its functions are called."""
    tree = ast.parse(text)
    head, *more = (ast.get_docstring(tree) or "").split(_PARAGRAPH)
    if "vsense_compare" in text:
        return [_sentence(head), "", *more]
    lines = [_sentence(head)]
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    for node in (node for c in classes if c.name == "Controller" for node in c.body):
        if isinstance(node, ast.FunctionDef):
            said = " ".join((ast.get_docstring(node) or "").split())
            lines.append(f"* line {node.lineno}, `{node.name}`: {said}")
    if len(lines) > 1:
        return [lines[0], "", *lines[1:], "", _OF_ROBOT]
    for node in (node for c in classes if c.name == "LoopFunctions" for node in c.body):
        if isinstance(node, ast.FunctionDef) and node.name in _CALLED:
            said = ast.get_docstring(node) or ""
            lines.append(
                f"* line {node.lineno}, `{node.name}`: called {_CALLED[node.name]}. {said}"
            )
    if len(lines) == 1:
        lines.append(
            "`read` gets the world and all robots that are due, and gives one row of numbers for"
            " each; `name` is what controllers ask for, `layout` what travels. `from_xml` reads the"
            " element's attributes. More: `vsense docs sensors`."
        )
    return [lines[0], "", *lines[1:]]


def _further() -> list[str]:
    return [
        "## Further",
        "",
        "* `vsense docs experiments`: the other experiments that a copy can be made of",
        "* `vsense docs sensors`: all virtual sensors, their noise, and how to write one",
        "* `vsense docs controller.h`: all that a controller sees and may do",
        "* `vsense docs pollutant.argos`: an experiment file with every line commented",
        "* `vsense docs robot`: onto real robots; `vsense docs` lists everything",
        "",
    ]
