"""Keys of the terminal that an experiment was started in: one key, one order."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from contextlib import suppress

from vsense.base.errors import VsenseError
from vsense.base.interruption import last_acts
from vsense.run.orders import Give, Order, OrderKind

KEYS = {
    "s": OrderKind.START,
    "p": OrderKind.PAUSE,
    "x": OrderKind.STOP,
    "r": OrderKind.RESET,
    "\x1b": OrderKind.EMERGENCY,
    "e": OrderKind.EMERGENCY,
}
_SEQUENCE = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|O[ -~])")
"""What a terminal sends for arrows and the like."""

TRACKING_HELP = "keys: s start, p pause, x stop, r reset; Ctrl-C ends vsense"
HELP = "keys: s start, p pause, x stop, r reset, Esc or e EMERGENCY STOP; Ctrl-C ends vsense"


def usable() -> bool:
    """Whether there is a keyboard, and this process is in its foreground."""
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError):
        return False


class Keyboard:
    """Reads keys of the terminal on a thread of its own, without Enter."""

    def __init__(self, give: Give, say: Callable[[str], None]) -> None:
        self._give = give
        self._say = say
        self._descriptor = sys.stdin.fileno()
        self._before = termios.tcgetattr(self._descriptor)
        tty.setcbreak(self._descriptor)
        # Nobody shall stop the terminal of a run with Ctrl-S; one that is stopped goes on.
        now = termios.tcgetattr(self._descriptor)
        now[0] &= ~termios.IXON
        termios.tcsetattr(self._descriptor, termios.TCSANOW, now)
        last_acts.append(self._restore)
        self._out, self._in = os.pipe()
        self._thread = threading.Thread(target=self._run, name="vsense-keyboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Restores the terminal."""
        os.write(self._in, b".")
        self._thread.join()
        os.close(self._in)
        os.close(self._out)
        last_acts.remove(self._restore)
        self._restore()

    def _restore(self) -> None:
        # One that was closed cannot be restored; what is on the way there may never leave.
        with suppress(termios.error):
            termios.tcsetattr(self._descriptor, termios.TCSANOW, self._before)

    def _run(self) -> None:
        while True:
            ready = select.select([self._descriptor, self._out], [], [])[0]
            if self._out in ready:
                return
            try:
                keys = os.read(self._descriptor, 64).decode(errors="ignore")
            except OSError:
                return
            if not keys:
                return
            self._press(keys)

    def _press(self, keys: str) -> None:
        """Carries out the keys; an arrow key is no Esc, though it begins with one."""
        pressed = _SEQUENCE.sub("", keys).lower()
        for kind in (KEYS[key] for key in pressed if key in KEYS):
            try:
                self._give(Order(kind, "keyboard"))
            except VsenseError as error:
                self._say(str(error))
