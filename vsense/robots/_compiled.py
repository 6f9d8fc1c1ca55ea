"""What a compiler has made of a program: an object file, or an error in somebody's source.

Object files are read by the ELF format. Source: System V ABI, chapter 4: sections, symbol tables.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vsense.robots import _argos_code
from vsense.robots.sources import ProgramSources

_IDENT = b"\x7fELF"
_WIDE, _BIG = 2, 2
_SHT_SYMTAB = 2
_SHF_WRITE_ALLOC = 1 | 2
_UNDEFINED, _COMMON = 0, 0xFFF2
_VARIABLES = (1, 5, 6)
"""STT_OBJECT, STT_COMMON and STT_TLS: kinds of symbols that are data."""
_CONSTANT = (".data.rel.ro",)
"""Sections that the loader writes to once, to relocate them, and nobody afterwards."""
_NUMBERED = re.compile(r"\.[0-9]+$")
"""GCC calls a variable inside of a function NAME.NUMBER, Clang FUNCTION.NAME."""


@dataclass(frozen=True, slots=True)
class _Section:
    name: int
    kind: int
    flags: int
    at: int
    size: int
    link: int


@dataclass(frozen=True, slots=True)
class ObjectFile:
    """An object file.

    Attributes:
        defined: names of all symbols that it defines.
        variables: names of its data that may change: what is static in its functions, too.
    """

    defined: frozenset[str]
    variables: tuple[str, ...]

    @classmethod
    def of(cls, data: bytes) -> ObjectFile:
        """Reads one; struct.error or IndexError: it is cut short."""
        wide, order = data[4] == _WIDE, ">" if data[5] == _BIG else "<"
        sections = _sections(data, wide, order)
        names = sections[struct.unpack_from(f"{order}H", data, 62 if wide else 50)[0]]
        defined, variables = set[str](), []
        for table in (s for s in sections if s.kind == _SHT_SYMTAB):
            texts = sections[table.link]
            for at in range(table.at, table.at + table.size, 24 if wide else 16):
                # name, info, section; 32 bits have value and size before the others.
                form, fields = ("IBxH", 0) if wide else ("I8xBxH", 0)
                name, info, index = struct.unpack_from(order + form, data, at + fields)
                if index == _UNDEFINED:
                    continue
                text = _text(data, texts.at + name)
                defined.add(text)
                if info & 15 in _VARIABLES and _may_change(data, sections, names, index):
                    variables.append(_NUMBERED.sub("", text))
        return cls(frozenset(defined), tuple(dict.fromkeys(variables)))


def _sections(data: bytes, wide: bool, order: str) -> list[_Section]:
    start = struct.unpack_from(f"{order}{'Q' if wide else 'I'}", data, 40 if wide else 32)[0]
    size, count = struct.unpack_from(f"{order}HH", data, 58 if wide else 46)
    form = f"{order}{'IIQ8xQQI' if wide else 'III4xIII'}"
    return [_Section(*struct.unpack_from(form, data, start + n * size)) for n in range(count)]


def _may_change(data: bytes, sections: list[_Section], names: _Section, index: int) -> bool:
    """Whether a symbol in this section is data that a program may write to."""
    if index == _COMMON:
        return True
    if index >= len(sections):
        return False
    section = sections[index]
    name = _text(data, names.at + section.name)
    return section.flags & _SHF_WRITE_ALLOC == _SHF_WRITE_ALLOC and not name.startswith(_CONSTANT)


def _text(data: bytes, at: int) -> str:
    return data[at : data.index(b"\0", at)].decode(errors="replace")


_FOREIGN = re.compile(r"_ZStL|_ZGV|_ZTV|DW\.ref\.|.*vs_registered_")
"""C++ names of variables that no user has written: streams, guards of what is made once, vtables,
what exceptions need, and what REGISTER_CONTROLLER makes."""


def fault(path: Path, source: Path, is_cxx: bool = False) -> str | None:
    """What a controller must not be: why its object file is refused; None: it is not.

    Variables that its robots would share are in C only. None as well for what a compiler with -flto
    makes, which is read by its linker only.
    """
    made = _read(path)
    if made is None:
        return None
    if made.variables and not is_cxx:
        place = f"{source}{_line(source, made.variables[0])}"
        names = ", ".join(repr(name) for name in made.variables)
        return (
            f"{place}: {names} would be shared by all robots, since one process may run many:"
            " expected no static or global variables that change; what a robot remembers belongs"
            " into the controller's state (robot/controller.h), and constants are const"
        )
    if "vs_controller" not in made.defined:
        return (
            f"{source} defines no vs_controller: expected `const struct vs_controller"
            " vs_controller = {NAME, sizeof(struct STATE), init, step, end};` at its end"
            " (robot/controller.h)"
        )
    return None


def shared_variables(path: Path) -> list[str]:
    """Variables of C++ code that all robots of a process share; see `fault`."""
    made = _read(path)
    return [_unmangled(n) for n in made.variables if not _FOREIGN.match(n)] if made else []


def _unmangled(name: str) -> str:
    """The last part of a C++ name, before which its length stands; others as they are."""
    parts = re.finditer(r"(?<=\D)(?=(\d+)(\w+))", name)
    fitting = (part[2] for part in parts if int(part[1]) == len(part[2].removesuffix("E")))
    return next(fitting, name).removesuffix("E")


def _read(path: Path) -> ObjectFile | None:
    """An object file; None of what only the linker that belongs to the compiler can read.

    ValueError: it is cut short.
    """
    data = path.read_bytes()
    if not data.startswith(_IDENT):
        return None
    try:
        made = ObjectFile.of(data)
    except (struct.error, IndexError) as error:
        raise ValueError(f"{path}: {error}") from None
    return None if "__gnu_lto_slim" in made.defined else made


def _line(source: Path, name: str) -> str:
    """ ":LINE" of the declaration of a variable; "" where it is not seen."""
    word = re.escape(name.rpartition(".")[2])
    text = source.read_text(errors="replace")
    match = re.search(rf"^[^\n/(]*\b{word}\b\s*(?:\[[^\n]*)?[=;,]", text, re.M)
    return f":{text.count(chr(10), 0, match.end()) + 1}" if match else ""


SHOWN_LINES = 20
"""Of a compiler's or a linker's words so many are shown."""
_SHOWN_COLUMNS = 240

_OLDER = "ISO C++17 does not allow"
"""What GCC and Clang say of code that is older."""

_ERROR = re.compile(r"(?:^|: )(?:fatal )?error: |undefined reference to |multiple definition of ")
_REMARK = re.compile(r": (?:warning|note|remark): ")
_CONTEXT = re.compile(
    r"In file included from |\s+from \S+:\d|\S.*: In .*:$|\S.*:\s+required from |\S.*: in function "
)
"""What GCC, Clang and linkers say before what it belongs to."""
_MISSING = re.compile(r"^(?:\S*ld(?:\.\w+)?: )?(.*undefined reference to [`'](.*)')$")


def shortened(said: str) -> str:
    """What helps of a compiler's or a linker's words: errors first, each symbol that is missing
    once, then notes as far as there is room; warnings only where there is nothing else."""
    lines = said.strip().splitlines()
    if len(lines) > SHOWN_LINES:
        errors, remarks = _sorted(lines)
        kept = (errors + remarks if errors else lines)[:SHOWN_LINES]
        lines = [*kept, f"({len(lines) - len(kept)} more lines)"]
    return "\n".join(
        line if len(line) <= _SHOWN_COLUMNS else f"{line[:_SHOWN_COLUMNS]}..." for line in lines
    )


def _sorted(lines: Sequence[str]) -> tuple[list[str], list[str]]:
    """The lines of errors, and those of notes; what comes before and after one belongs to it."""
    errors, remarks, context = list[str](), list[str](), list[str]()
    missing, target = dict[str, list[int]](), list[str]()
    for line in lines:
        if match := _MISSING.match(line):
            missing.setdefault(match[2], [len(errors), 0])[1] += 1
            errors += [match[1]] * (missing[match[2]][1] == 1)
            context, target = [], []
        elif _ERROR.search(line):
            target = errors
            target += [*context, line]
            context = []
        elif match := _REMARK.search(line):
            target = [] if "warning" in match[0] else remarks
            target.append(line)
            context = []
        elif _CONTEXT.match(line):
            context.append(line)
        else:
            target.append(line)
    for place, count in missing.values():
        errors[place] += f" ({count} times)" * (count > 1)
    return errors, remarks


def explained(
    said: str, program: ProgramSources, ours: Sequence[Path], what: str, flags: Sequence[str]
) -> str:
    """Why a build has failed: who is to blame, and what the compiler says that helps.

    Args:
        said: the compiler's words.
        ours, what: see `blamed`.
        flags: of the user's own.
    """
    with_flags = f" with CXXFLAGS={' '.join(flags)}" if flags else ""
    older = "\nolder C++ is compiled with CXXFLAGS=-std=gnu++11" * (_OLDER in said)
    return f"{blamed(said, program, ours, what)}{with_flags}:\n{shortened(said)}{older}"


def blamed(said: str, program: ProgramSources, ours: Sequence[Path], what: str) -> str:
    """Says which source a compiler's words are about; a linker's words name no line.

    Args:
        ours: sources that come with vsense.
        what: what the program is, as messages call it.
    """

    def is_named(path: Path) -> bool:
        return re.search(rf"(?:^|from ){re.escape(str(path))}:\d", said, re.M) is not None

    does = f"{'do' if what.endswith('s') else 'does'} not build"
    explain = {
        "controller": _argos_code.explain_simulator,
        "loop functions": _argos_code.explain_controllers,
    }.get(what)
    is_missing = program.is_argos and re.search("undefined (reference|symbol)", said)
    if is_missing and explain and (why := explain(program)):
        return f"the {what} {program.sources[0]} {does}: {why}"
    named = [path for path in program.sources if is_named(path)]
    if named:
        return f"the {what} {named[0]} {does}"
    shipped = [str(path) for path in ours if is_named(path)]
    if shipped:
        return f"a source of vsensed itself does not build: {', '.join(shipped)}"
    if what != "controller":
        return f"the {what} {program.sources[0]} {does}"
    return f"vsensed with the controller {program.sources[0]} does not build"
