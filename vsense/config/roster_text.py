"""The text of a roster: TOML, and in which line of it something stands."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from vsense.base.errors import ConfigError


def parse(path: Path, text: str) -> dict[str, Any]:
    """Reads TOML.

    Raises:
        ConfigError: it is none; the message has the line, and for a list of lines, as this file was
            once, how it is written now.
    """
    import tomlkit
    from tomlkit.exceptions import ParseError, TOMLKitError

    try:
        return tomlkit.parse(text).unwrap()
    except ParseError as error:
        _refuse_lines(path, text)
        words = str(error).rpartition(" at line ")[0] or str(error)
        raise ConfigError(str(path), error.line, f"{words}; expected TOML") from None
    except (TOMLKitError, ValueError, RecursionError) as error:
        _refuse_lines(path, text)
        line = Lines(text).twice or 1  # what else they refuse without a place is rare
        raise ConfigError(str(path), line, f"{str(error)[:200]}; expected TOML") from None


_OLD = re.compile(r"(?P<host>[^\s\[\]=#]+)(?=.*\stag=(?P<tag>\d+))(\s+[a-z-]+=\S+)+\s*(#.*)?")


def _refuse_lines(path: Path, text: str) -> None:
    """Tells whoever comes with a list of lines, as robots.txt was, what became of it."""
    for number, line in enumerate(text.splitlines(), 1):
        old = _OLD.fullmatch(line.strip())
        if old is not None:
            words = f'tag = {old["tag"]} and host = "{old["host"]}", in robots.toml'
            raise ConfigError(
                str(path), number, f"this robot is a table [[robot]] now, with {words}"
            )


class Lines:
    """Where things stand in the text of a roster: TOML's readers do not tell.

    Attributes:
        twice: the first line that says what one before it has said; 0: none does.
    """

    _HEAD = re.compile(r"\s*\[+\s*(?P<name>[\w.\s]+?)\s*\]+\s*(#.*)?")
    _KEY = re.compile(r"\s*(?P<name>[\w.-]+|\"[^\"]*\"|'[^']*')\s*=")

    def __init__(self, text: str) -> None:
        self._found: dict[tuple[int | None, str], int] = {}
        self.twice = 0
        robot: int | None = None
        table, robots = "", -1
        for line_number, line in enumerate(text.splitlines(), 1):
            head, key = self._HEAD.fullmatch(line), self._KEY.match(line)
            if head is not None:
                table = re.sub(r"\s", "", head["name"])
                robots += table == "robot"
                first, _, below = table.partition(".")
                robot, table = (robots, below) if first == "robot" else (None, table)
                self._note(robot, table, line_number)
            elif key is not None:
                name = f"{table}.{key['name']}".strip(".").replace('"', "").replace("'", "")
                self._note(robot, name, line_number)

    def _note(self, robot: int | None, name: str, line: int) -> None:
        if self._found.setdefault((robot, name), line) != line and not self.twice:
            self.twice = line

    def of(self, robot: int | None, name: str) -> int:
        """The line of a name, of its table, of its robot, or 1."""
        while (robot, name) not in self._found and name:
            name = name.rpartition(".")[0]
        return self._found.get((robot, name), 1)
