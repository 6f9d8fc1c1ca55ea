"""Keys pressed in a real terminal, which gets its settings back."""

from __future__ import annotations

import os
import pty
import sys
import termios
from collections.abc import Iterator
from threading import Event

import pytest

from vsense.monitor.ui import keyboard
from vsense.run.orders import Order, OrderError, OrderKind

PATIENCE_S = 20.0


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The end at which somebody types; the other one is standard input."""
    fingers, line = pty.openpty()
    with os.fdopen(line, "r") as typed:
        monkeypatch.setattr(sys, "stdin", typed)
        yield fingers
    os.close(fingers)


class Desk:
    def __init__(self, most: int) -> None:
        self.kinds: list[OrderKind] = []
        self.full = Event()
        self._most = most

    def give(self, order: Order) -> str:
        assert order.by == "keyboard"
        self.kinds.append(order.kind)
        if len(self.kinds) == self._most:
            self.full.set()
        if order.kind == OrderKind.RESET:
            raise OrderError("nothing to reset")
        return "done"


def test_each_key_is_one_order_without_enter(terminal: int) -> None:
    desk, said = Desk(6), list[str]()
    before = termios.tcgetattr(sys.stdin.fileno())
    keys = keyboard.Keyboard(desk.give, said.append)
    os.write(terminal, b"s?P x\n")
    os.write(terminal, b"re")
    assert not desk.full.wait(0.2)
    os.write(terminal, b"\x1b")
    assert desk.full.wait(PATIENCE_S)
    keys.close()
    assert desk.kinds == [
        *(OrderKind.START, OrderKind.PAUSE, OrderKind.STOP, OrderKind.RESET),
        *(OrderKind.EMERGENCY, OrderKind.EMERGENCY),
    ]
    assert said == ["nothing to reset"]
    assert termios.tcgetattr(sys.stdin.fileno()) == before, "the terminal is as it was"


def test_an_arrow_is_no_emergency(terminal: int) -> None:
    desk = Desk(1)
    keys = keyboard.Keyboard(desk.give, lambda text: None)
    os.write(terminal, b"\x1b[A\x1b[1;5C\x1bOP")
    assert not desk.full.wait(0.3)
    os.write(terminal, b"p")
    assert desk.full.wait(PATIENCE_S)
    keys.close()
    assert desk.kinds == [OrderKind.PAUSE]


def test_nobody_sits_at_a_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    out, into = os.pipe()
    os.close(into)
    with os.fdopen(out) as end:
        monkeypatch.setattr(sys, "stdin", end)
        assert not keyboard.usable()


@pytest.mark.parametrize("typed", [b"\x1b\x1b", b"\x1bs", b"\x1b[A\x1b"])
def test_an_escape_among_other_keys_is_an_emergency(terminal: int, typed: bytes) -> None:
    desk = Desk(1)
    keys = keyboard.Keyboard(desk.give, lambda text: None)
    os.write(terminal, typed)
    assert desk.full.wait(PATIENCE_S)
    keys.close()
    assert desk.kinds[0] == OrderKind.EMERGENCY
