"""Tokens: drawn, read from files, compared."""

from __future__ import annotations

from pathlib import Path

import pytest

from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console
from vsense.monitor.ui.access import (
    Rights,
    Tokens,
    WebAddress,
    is_loopback,
    make_tokens,
    read_tokens,
)
from vsense.monitor.ui.room import ControlRoom, RoomOptions

TOKENS = Tokens("look-secret", "control-secret")


def file(folder: Path, text: str) -> Path:
    path = folder / "tokens"
    path.write_text(text)
    path.chmod(0o600)
    return path


def test_drawn_tokens_differ_and_fit_into_an_address() -> None:
    drawn = [make_tokens() for _ in range(50)]
    every = {token for tokens in drawn for token in (tokens.look, tokens.control)}
    assert len(every) == 100
    assert all(
        len(token) >= 20 and token.replace("-", "").replace("_", "").isalnum() for token in every
    )


def test_what_a_token_gives() -> None:
    assert TOKENS.rights("look-secret") is Rights.LOOK
    assert TOKENS.rights("control-secret") is Rights.CONTROL
    for wrong in ("", "look", "look-secret ", "LOOK-SECRET", "ä", "\udcff"):
        assert TOKENS.rights(wrong) is Rights.NONE


def test_tokens_stay_out_of_pictures_of_the_program() -> None:
    assert "secret" not in repr(TOKENS)


def test_a_file_with_both(tmp_path: Path) -> None:
    path = file(tmp_path, "# ours\n\ncontrol = control-secret\nlook=look-secret\n")
    assert read_tokens(path) == TOKENS


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("look=look-secret\n", "no line 'control=...'"),
        ("", "no line 'look=...'"),
        ("look=look-secret\nlook=look-secret2\n", "tokens:2: a second 'look=' line"),
        ("look=look-secret\nadmin=x\n", "tokens:2: expected 'look=...' or 'control=...'"),
        ("\nwhatever\n", "tokens:2: expected"),
        ("look=short\n", "tokens:1: the look token is not usable: expected at least 8"),
        ("look=with space in it\n", "tokens:1: the look token is not usable"),
        ("look=ääääääääää\n", "tokens:1: the look token is not usable"),
        ("look=same-secret\ncontrol=same-secret\n", "the same token"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(VsenseError) as caught:
        read_tokens(file(tmp_path, text))
    assert words in str(caught.value) and str(tmp_path) in str(caught.value)
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("mode", [0o644, 0o620, 0o601, 0o666])
def test_a_file_that_others_can_use_is_refused(tmp_path: Path, mode: int) -> None:
    path = file(tmp_path, "control = control-secret\nlook=look-secret\n")
    path.chmod(0o640)
    assert read_tokens(path) == TOKENS
    path.chmod(mode)
    with pytest.raises(VsenseError) as caught:
        read_tokens(path)
    assert f"(mode 0{mode:o}): chmod 600 {path}" in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(VsenseError, match=r"nothing: cannot read the tokens: No such file"):
        read_tokens(tmp_path / "nothing")
    path = tmp_path / "binary"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VsenseError, match="not a text file"):
        read_tokens(path)


def test_what_is_this_machine_only() -> None:
    assert all(
        map(is_loopback, ("127.0.0.1", "127.1.2.3", "::1", "[::1]", "localhost", "LocalHost"))
    )
    assert not any(map(is_loopback, ("0.0.0.0", "::", "10.0.0.7", "robots.lab", "")))


def test_what_the_page_needs_is_looked_at_before_anything_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    web = WebAddress("127.0.0.1", 0, file(tmp_path, "look=only-one\n"))
    with pytest.raises(VsenseError, match="no line 'control="):
        ControlRoom(RoomOptions(web=web), Console())
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match="the page needs the Python package aiohttp"):
        ControlRoom(RoomOptions(web=WebAddress("127.0.0.1", 0)), Console())
