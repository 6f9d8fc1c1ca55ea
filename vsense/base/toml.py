"""Reads TOML files that people write, rosters and plans; each error names file and line.

A file's schema is a mapping of names: to a `Reader` for a value, to another schema for a table, and
to a list of one schema for an array of tables.

Size and keys are bounded before the text is parsed: tomlkit's time grows faster than linearly with
the number of keys and their parts.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vsense.base.errors import ConfigError, UsageError, instead
from vsense.base.files import read_bytes

MAX_TOML_BYTES = 256 << 10
MAX_KEY_PARTS = 8
_TOO_LARGE = 1 << 63

Reader = Callable[[Any], Any]
"""Gives what a value means; ValueError with what was expected."""
Schema = Mapping[str, Any]
"""What each name of a table may be: a `Reader`, a schema, or a list of one schema."""
Position = tuple[str | int, ...]
"""Where a value stands: names, and numbers of tables: `("robot", 2, "marker", "x_mm")`."""


def integer(least: int, most: int) -> Reader:
    """Reads a whole number."""

    def read(value: Any) -> int:
        if type(value) is not int or not least <= value <= most:
            raise ValueError(f"a whole number from {least} to {most}")
        return value

    return read


def real(least: float, most: float, unit: str = "") -> Reader:
    """Reads a number; `unit` is said after the range, such as " mm"."""

    def read(value: Any) -> float:
        if type(value) not in (int, float) or not least <= value <= most:
            raise ValueError(f"a number from {least:g} to {most:g}{unit}")
        return float(value)

    return read


def boolean(value: Any) -> bool:
    """Reads true or false."""
    if type(value) is not bool:
        raise ValueError("true or false")
    return value


def matching(pattern: str, expected: str) -> Reader:
    """Reads a text that a regular expression matches as a whole."""
    form = re.compile(pattern)

    def read(value: Any) -> str:
        if type(value) is not str or not form.fullmatch(value):
            raise ValueError(expected)
        return value

    return read


def single_line(expected: str = "a text on one line") -> Reader:
    """Reads a text of one line, without blanks at its ends."""

    def read(value: Any) -> str:
        if type(value) is not str or not value.strip() or not value.isprintable():
            raise ValueError(expected)
        return value.strip()

    return read


def read_toml_text(path: Path) -> str:
    """Reads a file's text, with or without a byte order mark.

    Raises:
        UsageError: it cannot be read, or is no text.
    """
    try:
        return decode_toml(path, read_bytes(path))
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from None


def decode_toml(path: Path, data: bytes) -> str:
    """The text of a file's bytes; raises as `read_toml_text`."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UsageError(f"cannot read {path}: it is no text") from None


class TomlFile:
    """A file's values, and the lines in which they stand.

    Attributes:
        path: the file.
    """

    def __init__(self, path: Path, text: str) -> None:
        """Parses the text.

        Raises:
            ConfigError: it is too long, has a key of too many parts, or is no TOML.
        """
        self.path = path
        self._lines, repeated = _lines_of(_checked(path, text))
        self._values = _quickly_parsed(text)
        if self._values is not None:
            return
        import tomlkit
        from tomlkit.exceptions import ParseError, TOMLKitError

        try:
            self._values = tomlkit.parse(text).unwrap()
        except ParseError as error:
            words = str(error).rpartition(" at line ")[0] or str(error)
            raise ConfigError(str(path), error.line, f"{words}; expected TOML") from None
        except (TOMLKitError, ValueError, RecursionError) as error:
            words = f"{str(error)[:200]}; expected TOML"
            raise ConfigError(str(path), repeated or 1, words) from None

    def line(self, *position: str | int) -> int:
        """The line of a value, counted from 1; where it has none that of its table, or 1."""
        while position and position not in self._lines:
            position = position[:-1]
        return self._lines.get(position, 1)

    def error(self, words: str, *position: str | int) -> ConfigError:
        """The error that something at a position cannot be."""
        return ConfigError(str(self.path), self.line(*position), words)

    def read(self, schema: Schema) -> dict[str, Any]:
        """Reads all values; those that the file does not have are not in the result.

        Raises:
            ConfigError: a name is not known, or a value cannot be.
        """
        self._check_integers()
        return self._table(self._values, schema, ())

    def _check_integers(self) -> None:
        """Refuses those that TOML does not have: nothing can show one of a million bits."""
        waiting: list[tuple[Position, Any]] = [((), self._values)]
        while waiting:
            position, value = waiting.pop()
            if isinstance(value, dict):
                waiting += [((*position, name), below) for name, below in value.items()]
            elif isinstance(value, list):
                waiting += [((*position, n), below) for n, below in enumerate(value)]
            elif isinstance(value, int) and not -_TOO_LARGE <= value < _TOO_LARGE:
                words = f"a whole number of {value.bit_length()} bits, expected at most 64"
                raise self.error(words, *position)

    def _table(self, table: Any, schema: Schema, position: Position) -> dict[str, Any]:
        if not isinstance(table, dict):
            words = f"{position[-1]}: expected a table {_head(position)}; got {_shown(table)}"
            raise self.error(words, *position)
        values = {}
        for name, value in table.items():
            below = (*position, name)
            if name not in schema:
                inner = [n for n, s in schema.items() if isinstance(s, Mapping) and name in s]
                hint = instead(name, schema)
                if inner:
                    hint = f"it stands in {_head((*position, inner[0]))}"
                raise self.error(f"{name!r} is not known in {_head(position)}; {hint}", *below)
            values[name] = self._value(value, schema[name], below)
        return values

    def _value(self, value: Any, form: Any, position: Position) -> Any:
        name = position[-1]
        if isinstance(form, Mapping):
            return self._table(value, form, position)
        if isinstance(form, list):
            if not isinstance(value, list) or not all(isinstance(t, dict) for t in value):
                words = f"{name}: expected a table [[{name}]] for each {name}; got {_shown(value)}"
                raise self.error(words, *position)
            return [self._table(t, form[0], (*position, n)) for n, t in enumerate(value)]
        try:
            return form(value)
        except ValueError as error:
            words = f"{name}: expected {error}; got {_shown(value)}"
            raise self.error(words, *position) from None


def _quickly_parsed(text: str) -> Any:
    """What the standard library makes of a text; None: it has no parser, or finds a fault.

    tomlkit says where a fault is, and takes a tenth of a second to load.
    """
    try:
        parser = importlib.import_module("tomllib")
        return parser.loads(text)
    except (ImportError, ValueError, RecursionError):
        return None


def _head(position: Position) -> str:
    """A table's name as a file has it: "[robot.marker]"."""
    name = ".".join(part for part in position if isinstance(part, str))
    if not name:
        return "this file"
    return f"[[{name}]]" if isinstance(position[-1], int) else f"[{name}]"


def _shown(value: Any) -> str:
    return (repr(value) if isinstance(value, str) else str(value))[:60]


_PART = r"""(?:[\w-]+|"(?:[^"\\\n]|\\.)*"?|'[^'\n]*'?)"""
_KEY = rf"{_PART}(?:[ \t]*\.[ \t]*{_PART})*"
_TOKEN = re.compile(
    r'(?P<skipped>"""(?:\\[\s\S]|(?!""")[^\\])*(?:"""|\Z)|'
    + r"'''(?:(?!''')[\s\S])*(?:'''|\Z)|#.*)"
    rf"|(?P<key>{_KEY})"
)
"""Every alternative ends somewhere, so that a text is scanned in linear time."""
_PARTS = re.compile(_PART)
_TABLE_LINE = re.compile(rf"\s*(?P<open>\[\[?)\s*(?P<name>{_KEY})\s*\]\]?\s*")
_VALUE_LINE = re.compile(rf"\s*(?P<name>{_KEY})\s*=")


def _checked(path: Path, text: str) -> str:
    """Checks the bounds; gives the text without comments and texts of several lines."""
    data = text.encode()
    if len(data) > MAX_TOML_BYTES:
        line = data.count(b"\n", 0, MAX_TOML_BYTES) + 1
        most = f"expected at most {MAX_TOML_BYTES >> 10} kB"
        raise ConfigError(str(path), line, f"the file has {len(data) >> 10} kB: {most}")

    def blanked(match: re.Match[str]) -> str:
        if match["key"] is None:
            return "\n" * match[0].count("\n")
        count = len(_PARTS.findall(match["key"]))
        if count > MAX_KEY_PARTS:
            line = text.count("\n", 0, match.start()) + 1
            words = f"a key of {count} parts, {match[0][:40]}...: expected at most {MAX_KEY_PARTS}"
            raise ConfigError(str(path), line, words)
        return match[0]

    return _TOKEN.sub(blanked, text)


def _lines_of(text: str) -> tuple[dict[Position, int], int]:
    """The line of each table and value, and the first that repeats one before it; 0: none does."""
    lines: dict[Position, int] = {}
    seen: set[Position] = set()
    counts: dict[Position, int] = {}
    repeated = 0
    table: Position = ()

    def place(start: Position, names: list[str]) -> Position:
        for name in names:
            start = (*start, name)
            if start in counts:
                start = (*start, counts[start])
        return start

    for number, line in enumerate(text.split("\n"), 1):
        head = _TABLE_LINE.fullmatch(line)
        match = head or _VALUE_LINE.match(line)
        if match is None:
            continue
        names = [part.strip("\"'") for part in _PARTS.findall(match["name"])]
        if head is not None and head["open"] == "[[":
            array = (*place((), names[:-1]), names[-1])
            counts[array] = counts.get(array, -1) + 1
        position = place(() if head is not None else table, names)
        if head is not None:
            table = position
        if position in seen and not repeated:
            repeated = number
        seen.add(position)
        for length in range(1, len(position) + 1):
            lines.setdefault(position[:length], number)
    return lines, repeated
