"""Text of others: nothing in it controls the terminal or the page that shows it."""

from __future__ import annotations

import io
import socket
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.rig import PATIENCE_S
from tests.wire.strategies import reseal
from vsense.base.message_bus import Message, MessageBus
from vsense.base.native import WireError
from vsense.base.terminal import Console, printable, printable_lines
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.lines import ArenaListener
from vsense.robots.link.wire import PUBLISHED, Header, Hello, PacketType, decode, encode
from vsense.vision.cameras import _networks

HOSTILE = (
    "\x1b]0;title\x07\x1b[2J\r\b\x00\x7f\x9b31m\x85\x8d\u061c\u200e\u200f\u2028\u2029"
    "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\ud800"
)


def is_safe(text: str) -> bool:
    """By Unicode's own tables, not by ours."""
    directions = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
    return not any(
        unicodedata.category(c) in {"Cc", "Cs", "Zl", "Zp"}
        or unicodedata.bidirectional(c) in directions
        or c in "\u061c\u200e\u200f"
        for c in text
    )


@given(st.text(st.characters(exclude_categories=()), max_size=50))
def test_whatever_comes_is_safe_and_the_rest_is_as_it_was(text: str) -> None:
    found = printable(text + HOSTILE)
    assert is_safe(found) and found.isprintable() >= (text + HOSTILE).isprintable()
    if is_safe(text):
        assert printable(text) == text
    assert is_safe(printable_lines(f"{text}\n{text}").replace("\n", ""))


def test_it_is_still_readable() -> None:
    assert printable("a\x1b[2Jb\u202ec") == r"a\x1b[2Jb\u202ec"
    assert printable("Größe 3 µm — 機器人 👩\u200d🔬") == "Größe 3 µm — 機器人 👩\u200d🔬"
    assert printable("a\nb") == r"a\nb" and printable_lines("a\nb\r") == "a\nb\\r"


def test_the_wire_refuses_what_is_escaped_here() -> None:
    """Names and log lines of robots are checked by C; both have the same list."""
    whole = encode(Header(PacketType.HELLO), Hello(bytes(16), 1, "ab", ""))
    for number in [*range(1, 0x3000), 0xD7FF, 0xD800, 0xDFFF, 0xE000, 0xFEFF, 0x1F52C]:
        character = chr(number)
        escaped = printable(character) != character
        try:
            encode(Header(PacketType.HELLO), Hello(bytes(16), 1, character, ""))
        except WireError as error:
            assert error.name == "VS_ERR_TEXT" and escaped, hex(number)
        else:
            assert not escaped, hex(number)
    for hostile in (b"\x1b[", b"\xc2\x9b", b"\x80\x80"):
        forged = reseal(whole.replace(b"ab", hostile), PUBLISHED)
        with pytest.raises(WireError, match="control characters"):
            decode(forged)


def test_terminal_log_and_page() -> None:
    stream, also = io.StringIO(), list[str]()
    console = Console(stream)
    console.repeat_to(lambda text, level: also.append(text))
    console.say(f"a {HOSTILE}\nb")
    console.progress(f"line {HOSTILE}")
    console.print_only(HOSTILE)
    bus, events = MessageBus(), list[Message]()
    bus.join(events.append, lambda topic: True)
    bus.event(HOSTILE, "info", 1)
    texts = [*stream.getvalue().split("\n"), *also[0].split("\n"), console.newest]
    assert all(map(is_safe, [*texts, events[0].data["text"]]))
    assert len(also[0].split("\n")) == 2


def test_what_a_tracker_writes() -> None:
    told: list[str] = []
    listener = ArenaListener("127.0.0.1", 0, (1,), told.append)
    with socket.create_connection(("127.0.0.1", listener.port), PATIENCE_S) as sock:
        for part in (HOSTILE.encode(errors="surrogatepass"), b'{"capture_ns": "\\u202e\\u001b"}'):
            sock.sendall(part + b"\n")
        with pytest.raises(LinkError):
            listener.next(0.3)
    listener.close()
    assert len(told) == 2 and all(map(is_safe, told))


def test_what_a_camera_calls_itself() -> None:
    assert is_safe(_networks._text(HOSTILE.encode(errors="surrogatepass") + b"\0rest"))
