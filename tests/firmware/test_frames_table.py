"""`firmware_bridge/FRAMES.md`: what it names is there."""

from __future__ import annotations

import re

from tests.rigs.places import ROOT

ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "firmware_bridge" / "FRAMES.md").read_text().splitlines()
    if line.startswith("| ") and not line.startswith("| ---")
]


def test_every_test_that_the_table_names_exists() -> None:
    files = [*(ROOT / "tests").rglob("*.py"), *(ROOT / "tests" / "c").glob("*.c")]
    there = {name for path in files for name in re.findall(r"\b(test_\w+)\(", path.read_text())}
    named = {name for row in ROWS for name in re.findall(r"`(test_\w+)`", row[-1])}
    assert len(named) > 40
    assert named <= there


def test_every_function_of_ours_that_the_table_names_exists() -> None:
    ours = {p.name: p.read_text() for f in ("robot", "c_src") for p in (ROOT / f).glob("*.[ch]")}
    text = "".join(ours.values())
    for row in ROWS:
        for file, function in re.findall(r"`(base\w*\.[ch])` `(\w+)`", " ".join(row)):
            assert re.search(rf"\b{function}\(", ours[file]), f"{file} {function}"
        for name in re.findall(r"`(epuck_\w+)`", " ".join(row)):
            assert re.search(rf"\b{name}\b", text), name


def test_every_row_is_held_by_a_test_or_says_that_the_field_is_not_used() -> None:
    for row in ROWS:
        held = "`test_" in row[-1] or row[-1] in ("the same", "test", "-")
        assert held and ("-" in row or row[-1] != "-"), row
