"""Who may know whom: the import rules of the house, read from the sources themselves."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from vsense.native import kernels, lib

ROOT = Path(__file__).parent.parent
MODULES = sorted((ROOT / "vsense").rglob("*.py"))
C_FOLDERS = ("c_src", "robot", "firmware_bridge")
FUNCTION_MAX = 40
"""Lines of a function, from its first to its last."""

FORBIDDEN = {
    "tracking": {"world", "sensors", "link", "web", "lab", "run", "config"},
    "world": {"tracking", "link", "web", "lab", "run"},
    "sensors": {"tracking", "link", "web", "lab", "run"},
    "actuators": {"tracking", "link", "web", "lab", "run"},
    "config": {"link", "web", "lab", "run"},
    "sheets": {"world", "sensors", "link", "web", "lab", "run", "config"},
    "link": {"tracking", "world", "sensors", "lab", "run", "web", "config"},
    "run": {"lab", "sim", "web"},
    "web": {"lab", "run", "sim", "link", "sensors", "actuators", "world", "tracking", "config"},
    "recording": {"lab", "run", "sim", "link", "sensors", "world", "web"},
    "report": {"lab", "run", "sim", "link", "web", "room"},
    "cameras": {"lab", "run", "sim", "world", "sensors", "actuators", "link", "web"},
}
"""Folder of `vsense` -> folders whose modules it must not import."""

DOORS = {"config": ("vsense.link.robots.table",)}
"""Modules of forbidden folders that a folder may know all the same: sensors that no datagram
holds are refused where the experiment file is read."""

TIMELESS = ("tracking", "world", "sensors", "actuators", "config")
"""Folders that are told the time and never read a clock."""

LIBC = {
    "errno", "fcntl", "float", "math", "poll", "signal", "stdarg", "stdbool", "stddef", "stdint",
    "stdio", "stdlib", "string", "termios", "time", "unistd", "stdatomic", "limits", "inttypes",
    "arpa/inet", "netinet/in", "netinet/tcp", "sys/file", "sys/ioctl", "sys/socket", "sys/stat",
    "sys/types", "sys/wait", "sys/uio", "sys/un", "sys/sysmacros", "linux/i2c", "linux/i2c-dev",
}  # fmt: skip


def imports(path: Path) -> set[str]:
    """All modules that a Python file imports, with their full names."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {node.module or ""} | {f"{node.module}.{a.name}" for a in node.names}
    return found


def includes(path: Path) -> set[str]:
    """All headers that a C file includes, system ones without `.h`."""
    return set(re.findall(r'^\s*#\s*include\s+[<"]([^>"]+?)(?:\.h)?[>"]', path.read_text(), re.M))


@pytest.mark.parametrize("folder", sorted(FORBIDDEN))
def test_folder_imports_only_what_it_may_know(folder: str) -> None:
    for path in (ROOT / "vsense" / folder).rglob("*.py"):
        known = {name for name in imports(path) if name.startswith("vsense.")}
        doors = DOORS.get(folder, ())
        rooms = {name.split(".")[1] for name in known if not name.startswith(doors)}
        assert not rooms & FORBIDDEN[folder], path


def test_one_module_touches_the_compiled_libraries() -> None:
    compiled = ("vsense._native", "vsense._kernels")
    users = [p.name for p in MODULES if any(n.startswith(compiled) for n in imports(p))]
    assert users == ["native.py"]


def called_of_c(path: Path) -> list[str]:
    """Patterns of the names that a Python file takes from a compiled library.

    What an f-string puts in stands for any word.
    """
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        match node:
            case ast.Attribute(value=ast.Name(id="lib" | "kernels"), attr=name):
                found.append(name)
            case ast.Call(
                func=ast.Name(id="getattr"),
                args=[ast.Name(id="lib" | "kernels"), ast.JoinedStr(values=parts)],
            ):
                words = [p.value if isinstance(p, ast.Constant) else r"\w+" for p in parts]
                found.append("".join(map(str, words)))
    return found


def test_what_c_shows_to_python_is_called() -> None:
    """By the package, or by the properties and golden bytes of wire, session and base."""
    shown = {
        name
        for library in (lib, kernels)
        for name in dir(library)
        if not isinstance(getattr(library, name), int | float)
    }
    assert {"vs_packet_open", "fw_york_advance", "vs_rays_blocked"} <= shown
    folders = ("vsense", "tests/wire", "tests/firmware")
    sources = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    called = re.compile("|".join({name for path in sources for name in called_of_c(path)}))
    assert {name for name in shown if not called.fullmatch(name)} == set()


def test_nothing_imports_the_command_line() -> None:
    users = [p.name for p in MODULES if any(n.startswith("vsense.cli") for n in imports(p))]
    assert users == ["__main__.py"]


@pytest.mark.parametrize("folder", TIMELESS)
def test_folder_reads_no_clock(folder: str) -> None:
    for path in (ROOT / "vsense" / folder).rglob("*.py"):
        assert not {"time", "datetime"} & {n.split(".")[0] for n in imports(path)}, path


def test_robot_side_links_libc_only_and_knows_no_host() -> None:
    ours = {p.stem for folder in ("robot", "c_src") for p in (ROOT / folder).glob("*.h")}
    sources = [*(ROOT / "robot").rglob("*.[ch]"), *(ROOT / "c_src").glob("*.[ch]")]
    for path in sources:
        unknown = {name for name in includes(path) if Path(name).name not in ours} - LIBC
        assert not unknown, f"{path.name} includes {unknown}"


def test_kernels_need_a_compiler_only_and_know_no_robot() -> None:
    known = {p.stem for p in (ROOT / "c_src/host").glob("*.h")} | {"../vs_err"}
    known |= {"math", "stddef", "stdint", "string"}
    for path in (ROOT / "c_src/host").glob("*.[ch]"):
        assert includes(path) <= known, path.name


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
    limits = {".h": 150, ".c": 400, ".py": 400}
    folders = ("vsense", "c_src", "robot", "firmware_bridge")
    for path in (p for f in folders for p in (ROOT / f).rglob("*") if p.suffix in limits):
        if path.name in ("_native.c", "_kernels.c"):
            continue
        lines = len(path.read_text().splitlines())
        assert lines <= limits[path.suffix], f"{path.name}: {lines} lines"


def python_functions(path: Path) -> list[tuple[str, int]]:
    """All functions of a Python file with their length in lines."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, kinds)]
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
    functions = [(path, python_functions(path)) for path in MODULES]
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


def test_top_level_is_the_design_card() -> None:
    allowed = {"setup.py", "c_src", "vsense", "robot", "firmware_bridge", "tests", "scripts"}
    allowed |= {"README.md", "CHANGELOG.md", "LICENSE", "pyproject.toml", "MANIFEST.in"}
    made = {"build", "dist", "runs"}
    found = {p.name for p in ROOT.iterdir() if not p.name.startswith(".")}
    assert {n for n in found if not n.endswith(".egg-info")} - allowed - made == set()
