"""Pages name commands, options, scripts and files that there are."""

from __future__ import annotations

import argparse
import re
from functools import cache

import pytest

from scripts.site.blocks import blocks, calls, shown
from scripts.site.commands import options, page, parsers
from scripts.site.contents import ROOT, sources
from vsense.commands import COMMANDS, FAMILIES, FORMER_COMMANDS

OF_ALL = {"-h", "--help", "--version"}
NO_ACTION = re.compile(r"[A-Z.<…]|^$")
"""What stands for a word of the reader's own."""


@cache
def known(name: str) -> dict[str, argparse.ArgumentParser]:
    """The parsers of a command by what is typed to reach them."""
    return {parser.prog: parser for parser in parsers(name)}


@cache
def daemon_options() -> set[str]:
    text = (ROOT / "robot" / "options.c").read_text()
    return {f"--{name}" for name in re.findall(r'"(?:--)?([a-z][a-z-]+)"', text)}


def wrong(call: list[str]) -> str:
    """What is not known of a program's call, "" where all is."""
    if call[0] == "vsense":
        return wrong_of_vsense(call[1:])
    if call[0] == "vsensed":
        lacking = {word for word in call if word.startswith("--")} - daemon_options()
        return ", ".join(sorted(lacking))
    if call[0].startswith("scripts/") and "*" not in call[0]:
        return "" if (ROOT / call[0]).exists() else call[0]
    return ""


def wrong_of_vsense(words: list[str]) -> str:
    if not words or NO_ACTION.match(words[0]):
        return ""
    if words[0].startswith("-"):
        return "" if words[0] in OF_ALL else words[0]
    if words[0] == "help":
        return ""
    if words[0] in FAMILIES and (len(words) == 1 or NO_ACTION.match(words[1])):
        return ""
    name = " ".join(words[: 2 if words[0] in FAMILIES else 1])
    if name not in COMMANDS:
        return name
    every = known(name)
    called, rest = f"vsense {name}", words[len(name.split()) :]
    if rest and f"{called} {rest[0]}" in every:
        called, rest = f"{called} {rest[0]}", rest[1:]
    accepted = options(every[called]) | options(every[f"vsense {name}"]) | OF_ALL
    for word in rest:
        name = word.partition("=")[0]
        is_option = re.match(r"--?[a-zA-Z]", word) is not None
        if is_option and name not in accepted and word[:2] not in accepted - {"--"}:
            return f"{called} {name}"
    return ""


@pytest.mark.parametrize("page", [page for page in sources() if page != "CHANGELOG.md"])
def test_commands_and_options_are_known(page: str) -> None:
    text = (ROOT / page).read_text()
    found = [(line, wrong(call)) for line, words in shown(text) for call in calls(words)]
    assert [f"{page}:{line}: {words}" for line, words in found if words] == []


def test_the_page_of_commands_has_every_option() -> None:
    parts = re.split(r"^#+ (vsense .*)$", page(), flags=re.M)
    shown_there = dict(zip(parts[1::2], parts[2::2], strict=True))
    lacking = [
        f"{parser.prog} {action.option_strings[-1]}"
        for name in COMMANDS
        for parser in parsers(name)
        for action in parser._actions
        if action.option_strings and action.help is not argparse.SUPPRESS
        if action.option_strings[-1] not in shown_there[parser.prog]
    ]
    assert lacking == [] and len(shown_there) > 40


OURS = ("vsense", "robot", "c_src", "firmware_bridge", "scripts", ".github")
TYPED = re.compile(r"vsense (?:(control|camera) ([a-z]+)|([a-z]+))")
SEAM = re.compile(r'"\s*\n\s*f?"|\s+(?:[#*] |// )?')
"""What parts a sentence in a source: two strings, or two lines."""


def read_by_people() -> dict[str, str]:
    """Our sources, of which messages and helps are parts, each in one line."""
    suffixes = {".py", ".js", ".html", ".xml", ".xsd", ".argos", ".toml", ".md", ".c", ".h", ".yml"}
    files = [p for name in OURS for p in (ROOT / name).rglob("*") if p.suffix in suffixes]
    return {str(p.relative_to(ROOT)): SEAM.sub(seam, p.read_text()) for p in files}


def seam(match: re.Match[str]) -> str:
    return "" if match[0].startswith('"') else " "


def test_what_people_are_told_to_type_is_spelt_as_today() -> None:
    wrong_words, seen = [], set()
    for path, text in read_by_people().items():
        for family, action, word in TYPED.findall(text):
            seen.add(f"{family} {action}" if family else word)
            if word in FORMER_COMMANDS or (family and f"{family} {action}" not in COMMANDS):
                wrong_words.append(f"{path}: vsense {family} {action}{word}")
    assert wrong_words == []
    assert len(seen & COMMANDS.keys()) > 25


def test_what_is_not_known_is_found() -> None:
    assert wrong(["vsense", "simm"]) == "simm"
    assert wrong(["vsense", "control", "strat"]) == "control strat"
    assert wrong(["vsense", "track", "a", "b"]) == "track"
    assert wrong(["vsense", "camera", "calibrate", "rig", "--bord"]).endswith("rig --bord")
    assert wrong(["vsense", "sim", "x.argos", "--rnus", "3"]) == "vsense sim --rnus"
    assert wrong(["vsense", "robot", "build", "--targt=epuck"]) == "vsense robot build --targt"
    assert wrong(["vsensed", "--host", "a", "--tga", "3"]) == "--tga"
    assert wrong(["scripts/dem"]) == "scripts/dem"
    assert wrong(["vsense", "sim", "x", "-j2", "--set", "a.b=-1"]) == ""


def test_calls_of_a_line() -> None:
    line = "cd lab && vsense camera track a b > c.jsonl | nc HOST 4041  # so"
    assert list(calls(line)) == [
        ["cd", "lab"],
        ["vsense", "camera", "track", "a", "b"],
        ["nc", "HOST", "4041"],
    ]


def test_blocks_of_a_page() -> None:
    text = "`a.py`:\n\n```python\nx = 1\n```\n\n```sh\nvsense sim a \\\n  --json  # b\n\n# c\n```\n"
    text += "```\n$ vsense lab b\nsays this\n```\n"
    first, second, third = blocks(text)
    assert (first.file, first.language, first.line, first.commands()) == ("a.py", "python", 4, [])
    assert [" ".join(c.split()) for c in second.commands()] == ["vsense sim a --json # b"]
    assert third.commands() == ["vsense lab b"]


def test_pages_show_commands() -> None:
    texts = [(ROOT / page).read_text() for page in sources()]
    found = [call for text in texts for _, words in shown(text) for call in calls(words)]
    assert len([call for call in found if call[0] == "vsense"]) > 150
