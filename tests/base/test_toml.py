"""TOML files: values by a schema, errors with their lines, and bounds before the text is parsed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from vsense.base.errors import ConfigError, UsageError
from vsense.base.toml import (
    MAX_KEY_PARTS,
    MAX_TOML_BYTES,
    TomlFile,
    boolean,
    integer,
    matching,
    read_toml_text,
    real,
    single_line,
)

ROBOT = {"tag": integer(0, 9), "at": {"x_m": real(-1.0, 1.0, " m")}, "spare": boolean}
SCHEMA = {
    "name": matching("[a-z]+", "small letters"),
    "why": single_line(),
    "robot": [ROBOT],
    "limits": {"least": integer(1, 5), "settings": dict},
}
TEXT = '''name = "lab"
why = """
[robot]
tag = 7"""  # [no table]
[limits]
least = 2
[limits.settings]
"a.b" = 1
c.d = 2

[[robot]]
tag = 1
[robot.at]
x_m = 1
[[robot]]  # the other one
tag = 2
at = { x_m = 0.5 }
'''


def file_of(text: str) -> TomlFile:
    return TomlFile(Path("lab.toml"), text)


def test_values_are_read() -> None:
    values = file_of(TEXT.replace('why = """\n[robot]\ntag = 7"""', 'why = " so "')).read(SCHEMA)
    assert values == {
        "name": "lab",
        "why": "so",
        "limits": {"least": 2, "settings": {"a.b": 1, "c": {"d": 2}}},
        "robot": [{"tag": 1, "at": {"x_m": 1.0}}, {"tag": 2, "at": {"x_m": 0.5}}],
    }
    assert type(values["robot"][0]["at"]["x_m"]) is float
    assert file_of("").read(SCHEMA) == {}


@pytest.mark.parametrize(
    ("position", "line"),
    [
        (("name",), 1),
        (("why",), 2),
        (("limits",), 5),
        (("limits", "settings", "a.b"), 8),
        (("limits", "settings", "c"), 9),
        (("limits", "settings", "c", "d"), 9),
        (("robot",), 11),
        (("robot", 0), 11),
        (("robot", 0, "at", "x_m"), 14),
        (("robot", 1), 15),
        (("robot", 1, "at", "x_m"), 17),
        (("robot", 1, "none"), 15),
        (("robot", 7), 11),
        (("none",), 1),
    ],
)
def test_lines(position: tuple[str | int, ...], line: int) -> None:
    assert file_of(TEXT).line(*position) == line


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("\nnaem = 1", 2, "'naem' is not known in this file; is 'name' meant?"),
        ("name = 'A'", 1, "name: expected small letters; got 'A'"),
        ("why = 'a\\u0007'\nwhy = 1", 2, "already exists"),
        ("why = 1", 1, "a text on one line; got 1"),
        ("limits = 3", 1, "limits: expected a table [limits]; got 3"),
        ("[limits]\n\nx_m = 3", 3, "'x_m' is not known in [limits]"),
        ("[limits]\nleast = 1.0", 2, "a whole number from 1 to 5; got 1.0"),
        ("\n[robot]\n", 2, "expected a table [[robot]] for each robot"),
        ("robot = [1]\n", 1, "expected a table [[robot]] for each robot; got [1]"),
        ("[[robot]]\n[[robot]]\nx_m = 0", 3, "'x_m' is not known in [[robot]]; it stands in [r"),
        ("[[robot]]\n[[robot]]\n[robot.at]\nx_m = inf", 4, "a number from -1 to 1 m; got inf"),
        ("[[robot]]\nspare = 1", 2, "spare: expected true or false; got 1"),
        ("[limits]\n[[robot]]\n[limits]\n", 3, "already exists"),
        ("\nname = ", 2, "expected TOML"),
    ],
)
def test_what_is_wrong_is_named_with_file_and_line(text: str, line: int, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        file_of(text).read(SCHEMA)
    assert (caught.value.file, caught.value.line) == ("lab.toml", line)
    assert words in caught.value.message


def refusal(text: str) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        file_of(text)
    assert caught.value.file == "lab.toml"
    return caught.value


LONG = " . ".join(["a"] * 30_000)


@pytest.mark.parametrize(
    "statement",
    [
        f"{LONG} = 1",
        f"[{LONG}]",
        f"[[ {LONG} ]]",
        f"b = {{ {LONG} = 1 }}",
        '"x".' * 30_000 + "'y' = 1",
        ".".join("a" * (MAX_KEY_PARTS + 1)) + " = 1",
    ],
)
def test_a_key_of_many_parts_is_refused_before_it_is_parsed(statement: str) -> None:
    error = refusal(f"# first\n\n{statement}\n")
    assert error.line == 3
    assert f"at most {MAX_KEY_PARTS}" in error.message and len(error.message) < 200


@pytest.mark.parametrize(
    "statement",
    [
        ".".join("a" * MAX_KEY_PARTS) + " = 1",
        f"a = '{LONG}'",
        f'a = "\\"{LONG}"',
        f'a = """\n{LONG}\n"""',
        f"a = '''\n{LONG}\n'''",
        f"# {LONG} = 1",
        f"a = 1 # {LONG}",
    ],
)
def test_texts_and_comments_are_no_keys(statement: str) -> None:
    assert file_of(f"{statement}\nlast = 1").line("last") == statement.count("\n") + 2


@pytest.mark.parametrize("number", ["0x" + "f" * 5000, "1" + "0" * 400, "0x8000000000000000"])
@pytest.mark.parametrize("form", ["{}", "[[1, {}]]", "{{b = {}}}"])
def test_a_whole_number_of_more_than_64_bits_is_refused(number: str, form: str) -> None:
    file = file_of(f"least = -9223372036854775808\n[[robot]]\na = {form.format(number)}")
    with pytest.raises(ConfigError, match="expected at most 64") as caught:
        file.read(SCHEMA)
    assert caught.value.line == 3


def test_a_large_file_is_refused_before_it_is_parsed() -> None:
    row = "# ä comment of 20 bytes"
    most = MAX_TOML_BYTES // len(f"{row}\n".encode())
    assert file_of(f"{row}\n" * most).line() == 1
    error = refusal(f"{row}\n" * (most + 10))
    assert error.line == most + 1 and "256 kB" in error.message


@pytest.mark.parametrize("text", ['"' + '\\"' * 20_000, '"""' + '\\"""' * 10_000, "'" * 20_001])
def test_texts_without_an_end_are_refused(text: str) -> None:
    assert "expected TOML" in refusal(text).message


def test_bytes_of_files(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(b"\xef\xbb\xbfname = 'a'")
    values: dict[str, Any] = TomlFile(path, read_toml_text(path)).read(SCHEMA)
    assert values == {"name": "a"}
    path.write_bytes(b"\xff")
    with pytest.raises(UsageError, match=r"x\.toml"):
        read_toml_text(path)
    with pytest.raises(UsageError, match=r"none\.toml"):
        read_toml_text(tmp_path / "none.toml")
