"""Texts of files that would speak to the terminal, through the commands that print them."""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Callable
from pathlib import Path

import pytest

from vsense import cli
from vsense.base.message_bus import Message
from vsense.monitor.ui._page_clients import Frames
from vsense.studies.report._markup import document, note

EVIL = "EVIL\x1b]0;title\x07\u202e\x9b31m"
TOML = r"EVIL\u001b]0;title\u0007\u202e\u009b31m"
"""The same, as TOML writes it."""


def roster(folder: Path) -> None:
    text = f'[[robot]]\ntag = 1\nhost = "root@a"\nname = "{TOML}"\n'
    (folder / "robots.toml").write_text(text)


def plan(folder: Path) -> None:
    text = 'mode = "sim"\nexperiment = "foraging"\nduration_s = 1\n[[condition]]\n'
    (folder / "plan.toml").write_text(f'{text}name = "{TOML}"\n')


def nothing(folder: Path) -> None:
    """The file is not there; its name is what is printed."""


CASES: tuple[tuple[str, Callable[[Path], None]], ...] = (
    ("robot list --roster robots.toml", roster),
    ("robot list --roster robots.toml --json", roster),
    ("markers --roster robots.toml -o sheet.pdf", roster),
    ("series plan.toml --dry", plan),
    *(
        (f"{command} NAME", nothing)
        for command in (
            *("sim", "lab --dry", "run --dry", "series", "report", "pack", "reproduce", "replay"),
            *("export", "track"),
            *("robot list --roster", "robot keys --key", "benchmark --roster", "new mine --from"),
        )
    ),
)


@pytest.mark.parametrize(("line", "write"), CASES, ids=[line for line, _ in CASES])
def test_no_file_speaks_to_the_terminal(
    line: str,
    write: Callable[[Path], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    capsys.readouterr()
    try:
        cli.main([f"{EVIL}.x" if word == "NAME" else word for word in line.split()])
    except SystemExit as end:
        assert end.code == 2
    said = capsys.readouterr()
    printed = said.out + said.err
    assert "EVIL" in printed or line.startswith("markers"), printed
    bad = {c for c in printed if c != "\n" and unicodedata.category(c) in {"Cc", "Cs", "Zl", "Zp"}}
    assert not bad and "\u202e" not in printed, repr(printed)
    if "--json" in line:
        assert json.loads(said.out)[0]["name"] == EVIL


def test_who_holds_a_key_is_named_in_plain_text_or_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["robot", "keys", "--key", "swarm.key", "--new-key"]) == 0
    (tmp_path / "swarm.key.robots").write_text(f"1 {'5' * 32} 7 2026-01-01 {EVIL}\n", "utf-8")
    capsys.readouterr()
    assert cli.main(["robot", "keys", "--key", "swarm.key"]) == 2
    assert "swarm.key.robots:1: expected key, uid" in capsys.readouterr().err


def test_no_table_or_recording_speaks_to_a_page() -> None:
    """Neither `report.html` nor what a page is sent changes the direction of writing."""
    page = document(EVIL, EVIL, note(EVIL, "warning"), EVIL)
    sent = Frames().frame(Message("/event", 1, {"text": EVIL, "plain": "\\u202e é 🔬"}))
    assert isinstance(sent, str)
    assert json.loads(sent)[2]["plain"] == "\\u202e é 🔬", "and the rest is as it was"
    for text in (page, json.loads(sent)[2]["text"]):
        assert "EVIL" in text and not {"\u202e", "\x9b"} & set(text)
