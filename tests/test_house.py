"""The house: rooms in order, files of a readable size, one name per class, who may touch what.

Everything is read from the sources themselves.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import pytest

import vsense
from vsense import _moved, api
from vsense.base.native import kernels, lib
from vsense.base.xml import parsing
from vsense.modes import origin
from vsense.modes.lab import truth
from vsense.monitor.recording import form
from vsense.studies.packages import _contents

ROOT = Path(__file__).parent.parent
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted((ROOT / "vsense").rglob("*.py"))
}
"""Every module of `vsense` by its full name."""
C_FOLDERS = ("c_src", "robot", "firmware_bridge")
FUNCTION_MAX = 40
"""Lines of a function, from its first to its last."""
PYTHON_MIN, PYTHON_MAX = 60, 400
"""Lines of a Python file."""

ROOMS = (
    *("commands", "tools", "studies", "modes", "monitor", "run"),
    *("config", "robots", "world", "vision", "base"),
)
"""The folders of `vsense/`, from the top: each imports only from those below it."""

LOOSE = {"__init__", "__main__", "_moved", "api", "cli"}
"""The only modules that lie beside the rooms."""

SHORT = {
    **{f"vsense.{name}": "a seam" for name in ("__main__", "base.clock", "studies._pytest_plugin")},
    **{
        f"vsense.commands.{name}": "one file per command"
        for name in ("docs", "doctor", "new", "render", "reproduce", "serve", "track")
    },
}
"""Modules below `PYTHON_MIN` lines, and why. Every `__init__` may be short, and so may the examples
in `vsense/config/experiments/` and every kind of virtual sensor or actuator: one file each."""

TIMELESS = ("vision/markers", "vision/tracking", "world", "config", "base/xml")
"""Folders that are told the time and never read a clock."""

LIBC = {
    "errno", "fcntl", "float", "math", "poll", "signal", "stdarg", "stdbool", "stddef", "stdint",
    "stdio", "stdlib", "string", "termios", "time", "unistd", "stdatomic", "limits", "inttypes",
    "arpa/inet", "netinet/in", "netinet/tcp", "sys/file", "sys/ioctl", "sys/socket", "sys/stat",
    "sys/syscall", "sys/time", "sys/types", "sys/wait", "sys/uio", "sys/un", "sys/sysmacros",
    "linux/capability", "linux/gpio", "linux/i2c", "linux/i2c-dev", "linux/watchdog", "link",
    "sched", "sys/mman", "sys/prctl", "execinfo",
}  # fmt: skip


@cache
def nodes(path: Path) -> Sequence[ast.AST]:
    """The syntax tree of a Python file, which many tests walk."""
    return list(ast.walk(ast.parse(path.read_text())))


@pytest.fixture(scope="module", autouse=True)
def forgotten() -> Iterator[None]:
    """A million nodes are not kept for the tests of other files."""
    yield
    nodes.cache_clear()


@cache
def imports(path: Path) -> frozenset[str]:
    """All modules that a Python file imports, with their full names."""
    found: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {node.module or ""} | {f"{node.module}.{a.name}" for a in node.names}
    return frozenset(found)


def includes(path: Path) -> set[str]:
    """All headers that a C file includes, system ones without `.h`."""
    return set(re.findall(r'^\s*#\s*include\s+[<"]([^>"]+?)(?:\.h)?[>"]', path.read_text(), re.M))


@cache
def links() -> dict[str, set[str]]:
    """Which modules of `vsense` each of them imports, wherever in the file that stands."""
    found = {}
    for name, path in MODULES.items():
        known = imports(path)
        # `from vsense.a import b` names `vsense.a` and `vsense.a.b`: the longest that is a module.
        exact = {k for k in known if k in MODULES}
        packages = {k for k in exact if any(other.startswith(f"{k}.") for other in exact)}
        found[name] = exact - packages - {name, "vsense"}
    return found


def room_of(module: str) -> str:
    """The room or loose module directly below `vsense/` that a module belongs to."""
    return module.split(".")[1] if "." in module else module


def folder_of(module: str) -> str:
    """The folder that a module lies in, at most two deep: `world/sensors`, or `world` itself."""
    parts = MODULES[module].relative_to(ROOT / "vsense").parent.parts
    return "/".join(parts[:2])


def knots(arrows: dict[str, set[str]]) -> list[list[str]]:
    """All groups of nodes that reach each other, each sorted."""

    def reached_from(start: str) -> set[str]:
        seen: set[str] = set()
        todo = [start]
        while todo:
            for other in arrows.get(todo.pop(), set()) - seen:
                seen.add(other)
                todo.append(other)
        return seen

    reached = {node: reached_from(node) for node in arrows}
    groups = {
        tuple(sorted(other for other in reached[node] if node in reached.get(other, ())))
        for node in arrows
        if node in reached[node]
    }
    return [list(group) for group in sorted(groups)]


def test_a_knot_is_found() -> None:
    assert knots({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]
    assert knots({"a": {"b"}, "b": {"c"}, "c": set()}) == []


def arrows(place_of: Callable[[str], str]) -> dict[str, set[str]]:
    """Which places import which others; a folder and those inside it are not told apart."""
    found: dict[str, set[str]] = defaultdict(set)
    for module, known in links().items():
        own = place_of(module)
        others = {place_of(other) for other in known} - {own}
        found[own] |= {o for o in others if not f"{o}/".startswith(f"{own}/")}
        found[own] -= {o for o in others if f"{own}/".startswith(f"{o}/")}
    return found


def test_the_rooms_are_these_eleven() -> None:
    folders = {path.parent.name for path in (ROOT / "vsense").glob("*/__init__.py")}
    assert folders == set(ROOMS)


def test_rooms_import_downward_only() -> None:
    between = {room: known & set(ROOMS) for room, known in arrows(room_of).items() if room in ROOMS}
    assert {"world", "base"} <= between["run"], "the graph has arrows"
    upward = {
        (room, other)
        for room, known in between.items()
        for other in known
        if ROOMS.index(other) < ROOMS.index(room)
    }
    assert upward == set()


def test_folders_inside_rooms_have_no_knots() -> None:
    between = arrows(folder_of)
    assert "base" in between["world/sensors"], "the graph has arrows"
    assert knots(between) == []


def test_design_md_shows_the_rooms_in_this_order() -> None:
    text = (ROOT / "vsense" / "DESIGN.md").read_text()
    table = text.partition("| room | what it holds |")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `(\w+)/` \|", table, re.M) == list(ROOMS)


def test_modules_import_in_one_direction() -> None:
    # An import inside a function, or for type checkers only, hides no circle.
    assert knots(links()) == []


def test_only_the_seams_lie_loose() -> None:
    assert {path.stem for path in (ROOT / "vsense").glob("*.py")} == LOOSE


def test_the_face_is_one_list() -> None:
    """Of `from vsense import ...`: the table, the list, what type checkers see, and the page."""
    tree = ast.parse((ROOT / "vsense" / "api.py").read_text())
    typed = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("vsense.")
        for alias in node.names
    }
    page = (ROOT / "vsense" / "EXTENDING.md").read_text()
    table = page.partition("| name | what it is |")[2].partition("\n\n")[0]
    shown = set(re.findall(r"`(\w+)`", re.sub(r"^\| (.*?) \|.*$", r"\1", table, flags=re.M)))
    assert set(api.PLACES) == set(api.__all__) == typed == shown
    assert not set(api.__all__) & (set(ROOMS) | {name.split(".")[-1] for name in _moved.TABLE})
    for name in api.__all__:
        assert callable(getattr(vsense, name)) or name == "Robots"


def test_nothing_of_ours_uses_the_face() -> None:
    users = {
        module
        for module, path in MODULES.items()
        if {n for n in imports(path) if n.removeprefix("vsense.") in api.PLACES}
    }
    assert users == {
        "vsense.config.experiments.start.start",
        "vsense.config.experiments.start.start_controller",
        "vsense.config.experiments.start.crowd",
    }


def test_no_public_class_or_type_name_twice() -> None:
    # Experiments are examples: each has its LoopFunctions, as ARGoS names them.
    defined: dict[str, list[str]] = defaultdict(list)
    for module, path in MODULES.items():
        if not module.startswith("vsense.config.experiments."):
            for node in nodes(path):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    defined[node.name].append(module)
                if isinstance(node, ast.Assign) and node.col_offset == 0:  # a type's short name
                    names = [t.id for t in node.targets if isinstance(t, ast.Name)]
                    for name in (n for n in names if re.match("[A-Z][A-Za-z0-9]*[a-z]", n)):
                        defined[name].append(module)
    assert "ArenaState" in defined
    assert {name: modules for name, modules in defined.items() if len(modules) > 1} == {}


PLUGINS = re.compile(r"vsense\.(world\.(sensors|actuators)|config\.experiments|commands)\.")
"""Where a file is a kind of sensor, an experiment, a command: found by its name."""


def test_the_layout_shows_what_may_be_touched() -> None:
    """An underscore begins what only its own room imports."""
    doors = {
        other
        for module, known in links().items()
        for other in known
        if room_of(other) != room_of(module)
    }
    for module, path in MODULES.items():
        if path.name != "__init__.py" and room_of(module) in ROOMS:
            private = path.name.startswith("_")
            assert not (private and module in doors), f"{module}: another room imports it"
            if not PLUGINS.match(module):
                assert private or module in doors, f"{module}: only its own room imports it"


def test_only_commands_know_argparse() -> None:
    users = {room_of(m) for m, path in MODULES.items() if "argparse" in imports(path)}
    assert users == {"commands"}


def test_one_module_touches_the_compiled_libraries() -> None:
    compiled = ("vsense._native", "vsense._kernels")
    users = [p.name for p in MODULES.values() if any(n.startswith(compiled) for n in imports(p))]
    assert users == ["native.py"]


def called_of_c(path: Path) -> list[str]:
    """Patterns of the names that a Python file takes from a compiled library.

    What an f-string puts in stands for any word.
    """
    found = []
    for node in nodes(path):
        match node:
            case ast.Attribute(value=ast.Name(id="lib" | "kernels"), attr=name):
                found.append(name)
            case (
                ast.Call(
                    func=ast.Name(id="ReadFunction" | "ApplyFunction"),
                    args=[ast.Name(id="kernels"), ast.Constant(value=name), *_],
                )
                | ast.Call(
                    func=ast.Attribute(attr="addressof"),
                    args=[ast.Name(id="kernels"), ast.Constant(value=name)],
                )
            ):
                found.append(name)
            case ast.Call(
                func=ast.Name(id="getattr"),
                args=[ast.Name(id="lib" | "kernels"), ast.JoinedStr(values=parts)],
            ):
                words = [p.value if isinstance(p, ast.Constant) else r"\w+" for p in parts]
                found.append("".join(map(str, words)))
    return found


def test_what_c_shows_to_python_is_called() -> None:
    """By the package, or by the properties of lines, and golden bytes of wire, session and base."""
    shown = {
        name
        for library in (lib, kernels)
        for name in dir(library)
        if not isinstance(getattr(library, name), int | float)
    }
    assert {"vs_packet_open", "fw_york_advance", "vs_rays_blocked"} <= shown
    folders = ("vsense", "tests/wire", "tests/firmware", "tests/rigs")
    sources = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    called = re.compile("|".join({name for path in sources for name in called_of_c(path)}))
    assert {name for name in shown if not called.fullmatch(name)} == set()


def test_nothing_imports_the_command_line() -> None:
    users = {room_of(m) for m, p in MODULES.items() if "vsense.cli" in imports(p)}
    assert users == {"__main__"}
    users = {room_of(m) for m, p in MODULES.items() if "vsense.commands" in imports(p)}
    assert users == {"cli", "commands"}


@pytest.mark.parametrize("folder", TIMELESS)
def test_folder_reads_no_clock(folder: str) -> None:
    for path in (ROOT / "vsense" / folder).rglob("*.py"):
        known = imports(path)
        assert not {"time", "datetime"} & {n.split(".")[0] for n in known}, path
        assert "vsense.base.clock" not in known, path


def test_robot_side_links_libc_only_and_knows_no_host() -> None:
    ours = {p.stem for folder in ("robot", "c_src") for p in (ROOT / folder).glob("*.h")}
    sources = [*(ROOT / "robot").rglob("*.[ch]"), *(ROOT / "c_src").glob("*.[ch]")]
    for path in sources:
        unknown = {name for name in includes(path) if Path(name).name not in ours} - LIBC
        assert not unknown, f"{path.name} includes {unknown}"


def test_kernels_need_a_compiler_only_and_know_no_robot() -> None:
    known = {p.stem for p in (ROOT / "c_src/host").glob("*.h")} | {"../vs_err"}
    known |= {"math", "stdatomic", "stddef", "stdint", "string"}
    known |= {"cpuid", "immintrin"}  # the compiler's own, where the processor is an x86
    for path in (ROOT / "c_src/host").glob("*.[ch]"):
        crash = {"signal", "dlfcn", "execinfo"} if path.name == "vs_crash.c" else set()
        assert includes(path) <= known | crash, path.name


NUMBERS_OF_ROBOTS = (
    "0.053", "128805", "0.076", "0.041", "0.0205", "45.9", "2133.0", "0.0337", "0.032", "0.122",
    "0.0765",
)  # fmt: skip
"""An e-puck's axle, step, height, wheel, places and readings of its ring, and where its virtual
infrared sensors, camera and LEDs are."""


def test_only_its_model_knows_a_robots_number() -> None:
    number = re.compile(rf"(?<![\w.])({'|'.join(map(re.escape, NUMBERS_OF_ROBOTS))})(?![\d])")
    assert number.findall("AXLE_M = 0.053") and not number.findall("0.0531, 10.053")
    text = (ROOT / "vsense/world/models/epuck.toml").read_text()
    assert {*NUMBERS_OF_ROBOTS} - {"128805", "0.0205"} == set(number.findall(text))
    scripts = (ROOT / "vsense").rglob("*.js")
    for path in (*MODULES.values(), *scripts, *(ROOT / "c_src/host").glob("*.[ch]")):
        code = re.sub(r'""".*?"""|/\*.*?\*/', "", path.read_text(), flags=re.DOTALL)
        assert not number.findall(code), path


def test_firmware_bridge_is_freestanding() -> None:
    known = {p.stem for p in (ROOT / "firmware_bridge").glob("*.h")}
    known |= {p.stem for p in (ROOT / "c_src").glob("epuck_*.h")} | {"stdint", "stddef"}
    for path in sorted((ROOT / "firmware_bridge").glob("*.[ch]")):
        assert includes(path) <= known, path.name


def test_controllers_see_one_header() -> None:
    for path in (ROOT / "robot" / "controllers").glob("*.c"):
        own = {name for name in includes(path) if name not in LIBC}
        assert {Path(name).name for name in own} == {"controller"}, path.name


def test_files_are_one_idea_each() -> None:
    limits = {".h": 150, ".c": 400}
    for path in (p for f in C_FOLDERS for p in (ROOT / f).rglob("*") if p.suffix in limits):
        lines = len(path.read_text().splitlines())
        assert lines <= limits[path.suffix], f"{path.name}: {lines} lines"
    for module, path in MODULES.items():
        lines = len(path.read_text().splitlines())
        assert lines <= PYTHON_MAX, f"{module}: {lines} lines"
        is_kind = (
            module.startswith("vsense.config.experiments.") or "\nELEMENTS = " in path.read_text()
        )
        is_short = module in SHORT or is_kind or path.name == "__init__.py"
        assert is_short or lines >= PYTHON_MIN, f"{module}: {lines} lines"
    assert {m for m in SHORT if len(MODULES[m].read_text().splitlines()) >= PYTHON_MIN} == set()


def python_functions(path: Path) -> list[tuple[str, int]]:
    """All functions of a Python file with their length in lines."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = [node for node in nodes(path) if isinstance(node, kinds)]
    return [(f.name, (f.end_lineno or 0) - f.lineno + 1) for f in found]


def c_functions(path: Path) -> list[tuple[str, int]]:
    """All functions of a C file with their length in lines: braces in column 1 hold the body."""
    found = []
    lines = path.read_text().splitlines()
    for opened in (n for n, line in enumerate(lines) if line == "{"):
        begin = opened
        while begin > 0 and lines[begin - 1] and not lines[begin - 1].endswith(("*/", "}", ";")):
            begin -= 1
        closed = lines.index("}", opened)
        found.append((re.sub(r"\(.*", "", lines[begin]).split()[-1], closed - begin + 1))
    return found


def test_functions_fit_a_screen() -> None:
    sources = [path for folder in C_FOLDERS for path in sorted((ROOT / folder).rglob("*.c"))]
    functions = [(path, python_functions(path)) for path in MODULES.values()]
    functions += [(path, c_functions(path)) for path in sources]
    mains = {path.suffix for path, found in functions if "main" in dict(found)}
    assert mains == {".py", ".c"}, "both scans find functions"
    too_long = [
        f"{path.relative_to(ROOT)}: {name}: {lines} lines"
        for path, found in functions
        for name, lines in found
        if lines > FUNCTION_MAX
    ]
    assert too_long == []


ASKS_A_PATH = re.compile(r"\.(is_file|is_dir|exists)\(\)")
HANDLES_THE_ERROR = {"robots/link/keys.py", "tools/camera_setup/photographs.py"}


def test_whether_a_file_is_there_is_asked_of_os_path() -> None:
    """A path's own methods raise where a name is too long, or its folder may not be looked into."""
    asking = {
        str(path.relative_to(ROOT / "vsense"))
        for path in (ROOT / "vsense").rglob("*.py")
        if ASKS_A_PATH.search(path.read_text())
    }
    assert asking == HANDLES_THE_ERROR


BUDGETS: dict[str, tuple[tuple[str, ...], tuple[str, ...], int, int, int]] = {
    # what: folders, suffixes, files, lines, longest file
    "vsense in Python": (("vsense",), (".py",), 531, 112680, 400),
    "the page": (("vsense",), (".js", ".css", ".html"), 46, 6000, 300),
    "C": (("c_src", "robot", "firmware_bridge"), (".c", ".h"), 297, 32700, 400),
    "C++": (("robot",), (".cpp", ".hpp"), 38, 7700, 512),
    "tests": (("tests",), (".py", ".c", ".h", ".cpp", ".argos"), 673, 118980, 651),
}
"""How much there may be. Who must raise a number does it here, with the reason in the commit."""

CODE_MAX, ARROWS_MAX, INNER_ARROWS_MAX = 77296, 49, 19
"""Lines of code in `vsense/`; imports between rooms, and between folders inside of rooms."""
DOORS_MAX, NAMES_MAX = 205, 782
"""Modules that another room imports, and names taken from them."""
SPLATS_MAX, OUTSIDE_MAX = 9, 233
"""Calls `f(*(a, b))`; attributes that are assigned from outside of their object."""


@pytest.mark.parametrize("what", BUDGETS)
def test_there_is_no_more_than_the_budget(what: str) -> None:
    folders, suffixes, files_max, lines_max, longest_max = BUDGETS[what]
    paths = [
        path
        for folder in folders
        for path in (ROOT / folder).rglob("*")
        if path.suffix in suffixes and not {"data", "_sources"} & set(path.relative_to(ROOT).parts)
    ]
    lengths = [path.read_text().count("\n") for path in paths if path.stem not in GENERATED]
    assert len(lengths) <= files_max and sum(lengths) <= lines_max and max(lengths) <= longest_max


GENERATED = {"_native", "_kernels"}
"""What the build writes into a checkout."""


def code_lines(path: Path) -> int:
    """Lines of a Python file that are neither blank nor comment nor docstring."""
    text = path.read_text()
    silent = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in (*silent, tokenize.ENDMARKER):
            held.update(range(token.start[0], token.end[0] + 1))
    for node in nodes(path):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                held.difference_update(range(first.lineno, (first.end_lineno or 0) + 1))
    return len(held)


def test_lines_of_code_are_few() -> None:
    assert sum(map(code_lines, MODULES.values())) <= CODE_MAX


def test_arrows_are_few() -> None:
    between = {room: known & set(ROOMS) for room, known in arrows(room_of).items() if room in ROOMS}
    assert sum(map(len, between.values())) <= ARROWS_MAX
    inner = {
        (folder, other)
        for folder, known in arrows(folder_of).items()
        for other in known
        if folder.split("/")[0] == other.split("/")[0]
    }
    assert len(inner) <= INNER_ARROWS_MAX


def test_few_modules_and_names_are_entered_from_another_room() -> None:
    doors: set[tuple[str, str]] = set()
    for module, path in MODULES.items():
        for node in nodes(path):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("vsense."):
                for alias in node.names:
                    inside = f"{node.module}.{alias.name}"
                    target = inside if inside in MODULES else str(node.module)
                    if room_of(module) in ROOMS and room_of(target) != room_of(module):
                        doors.add((target, alias.name))
    assert len({module for module, _ in doors}) <= DOORS_MAX
    assert len(doors) <= NAMES_MAX


def test_calls_and_assignments_are_plain() -> None:
    splats = outside = 0
    for path in MODULES.values():
        for node in nodes(path):
            if isinstance(node, ast.Call):
                splats += any(
                    isinstance(a, ast.Starred) and isinstance(a.value, ast.Tuple) for a in node.args
                )
            elif isinstance(node, ast.Assign):
                outside += sum(
                    isinstance(target, ast.Attribute)
                    and isinstance(target.value, ast.Attribute | ast.Name)
                    and not (isinstance(target.value, ast.Name) and target.value.id in OWN)
                    for target in node.targets
                )
    assert splats <= SPLATS_MAX
    assert outside <= OUTSIDE_MAX


OWN = ("self", "cls")


def test_no_test_imports_another_test() -> None:
    """What several of them need lies in `tests/rigs/` or in a helper module of their folder."""
    found = {
        (str(path.relative_to(ROOT)), name)
        for path in (ROOT / "tests").rglob("*.py")
        if "data" not in path.relative_to(ROOT).parts
        for name in imports(path)
        if re.match(r"tests\.(\w+\.)*test_", name)
    }
    assert found == set()


def test_every_file_that_design_md_names_is_there() -> None:
    text = (ROOT / "vsense" / "DESIGN.md").read_text()
    named = set(re.findall(r"`([\w./-]+\.(?:py|c|h|js|hpp|txt|md|toml|xsd))`", text))
    folders = ("vsense", "c_src", "robot", "firmware_bridge", "scripts", "tests")
    paths = [f"/{path.relative_to(ROOT)}" for f in folders for path in (ROOT / f).rglob("*.*")]
    paths += [f"/{path.name}" for path in ROOT.iterdir()]
    assert len(named) > 60
    lost = {n for n in named if not any(p.endswith(f"/{Path(n)}") for p in paths)}
    assert {n for n in lost if "NAME" not in n} == set()
    for name, file in re.findall(r"`(?:\w+\.)?(\w+)` \(`([\w./-]+\.(?:py|c|h|js))`", text):
        files = [ROOT / path[1:] for path in paths if path.endswith(f"/{file}")]
        assert any(re.search(rf"\b{name}\b", f.read_text()) for f in files), f"{name} in {file}"


def test_formats_are_those_that_design_md_tells() -> None:
    text = (ROOT / "vsense" / "DESIGN.md").read_text()
    table = text.partition("| format | number | older ones |")[2].partition("\n\n")[0]
    rows = dict(re.findall(r"^\| (\S+).*? \| ([\d.]+)", table, re.M))
    assert rows["wire"] == str(lib.VS_VERSION)
    assert rows["recording"] == ".".join(map(str, form.RECORDING_FORMAT))
    assert rows["package"] == str(_contents.PACKAGE_FORMAT)
    assert rows["`made.zip`,"] == str(origin.ORIGIN_FORMAT)
    assert rows["`.argos`"] == parsing.NAMESPACE.rpartition(":")[2]
    assert rows["truth"] == truth.LOG_MAGIC.decode()[-1]


def test_top_level_is_the_design_card() -> None:
    allowed = {"setup.py", "c_src", "vsense", "robot", "firmware_bridge", "tests", "scripts"}
    allowed |= {"README.md", "CHANGELOG.md", "LICENSE", "pyproject.toml", "MANIFEST.in"}
    made = {"build", "dist", "runs", "PKG-INFO", "setup.cfg"}  # the last two in an sdist
    found = {p.name for p in ROOT.iterdir() if not p.name.startswith(".")}
    assert {n for n in found if not n.endswith(".egg-info")} - allowed - made == set()


def test_one_module_starts_python() -> None:
    """Whoever starts it otherwise has modules of the current folder imported."""
    asks = re.compile(r"sys\.executable|(?<!\w)[\"']-m[\"']")
    found = {name for name, path in MODULES.items() if asks.search(path.read_text())}
    assert found == {"vsense.base.processes", "vsense.base.errors"}, (
        "errors names the pip of this Python"
    )


PRINTING = {
    "vsense.base.terminal": "the one place",
    "vsense.modes.live.track": "arena states: numbers",
    "vsense.modes.lab.board_studio": "a rig's, for those who develop it",
    "vsense.monitor.foxglove._layout": "a file that is shipped",
    "vsense.vision.calibration.session": "how many pictures, on a terminal",
    **{
        f"vsense.{name}": "to the process that started it"
        for name in ("modes.lab._canary", "modes.lab._physics_process", "robots.link.key_process")
    },
}
"""Modules that print by themselves, and what: nothing of it comes from a file."""


def test_texts_of_files_are_printed_in_one_place() -> None:
    """There control characters are replaced: nobody's file speaks to the terminal."""
    found = {
        module
        for module, path in MODULES.items()
        for node in nodes(path)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "print"
    }
    assert found == set(PRINTING)
