"""Rosters for tests, from a line for each robot: "root@left tag=23 base=overo"."""

from __future__ import annotations

from pathlib import Path

FILE = "robots.toml"


def write(folder: Path, lines: str) -> Path:
    """Writes a roster; the first word of a line is the host, numbers and true are no texts."""
    tables = []
    for host, *words in (line.split() for line in lines.splitlines() if line.strip()):
        values = [word.partition("=") for word in words]
        own = [f"{name} = {_value(name, value)}" for name, _, value in values]
        tables.append("\n".join(["[[robot]]", f'host = "{host}"', *own, ""]))
    path = folder / FILE
    path.write_text("\n".join(tables))
    return path


def _value(name: str, value: str) -> str:
    plain = value == "true" or (value.isdecimal() and name != "uid")
    return value if plain else f'"{value.replace("~", " ")}"'
