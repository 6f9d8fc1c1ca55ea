"""Motion capture systems as arena sources, through the package motioncapture.

A process of its own asks the system (`_mocap_process.py`) and writes lines as any other tracker
does (TRACKERS.md), but into a socket that it has got from here: no other program can. It is started
again when it has ended.
"""

from __future__ import annotations

import json
import os
import signal
import socket
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns
from vsense.base.processes import Started, describe_exit, start_module
from vsense.robots.link.trackers._mocap_process import ENDED, SILENT_S
from vsense.robots.link.trackers.lines import ArenaListener, Writer

_LOOK_NS = 300_000_000
_AGAIN_NS = 1_000_000_000


MOCAP_TYPES = (
    *("vicon", "optitrack", "optitrack_closed_source", "qualisys", "nokov", "vrpn"),
    *("motionanalysis", "fzmotion", "mock"),
)
"""Systems that the package motioncapture knows; a build of it need not have all."""


@dataclass(frozen=True, slots=True)
class MocapSystem:
    """A motion capture system; the arguments of `motioncapture.connect`, and what bodies are.

    Attributes:
        type: one of `MOCAP_TYPES`.
        settings: "hostname" and others.
        bodies: robots' tags by their rigid bodies' names; empty: a body is named as its robot, or
            after its tag.
        up: the axis that points up, "y" or "z".
    """

    type: str
    settings: Mapping[str, str]
    bodies: Mapping[str, int]
    up: str


class MocapListener(ArenaListener):
    """A source of arena states of a motion capture system.

    Args:
        system: which.
        tags, say, clock: see `TrackerLink`.
    """

    def __init__(
        self,
        system: MocapSystem,
        tags: Collection[int],
        say: Callable[[str], None],
        clock: Callable[[], int] = host_ns,
    ) -> None:
        super().__init__(None, 0, tags, say, clock)
        self.name = f"{system.type} at {system.settings['hostname']}"
        self._order = {
            "type": system.type,
            "settings": dict(system.settings),
            "bodies": dict(system.bodies),
            "up": system.up,
        }
        self._process: Started | None = None
        self._begin_ns = 0
        self._said = self._words = self._reason = ""

    def _check(self) -> None:
        """Starts the process where none runs, and hands on what it says."""
        if self._process is None:
            if self._clock() >= self._begin_ns:
                module = "vsense.robots.link.trackers._mocap_process"
                ours, theirs = socket.socketpair()
                with theirs:
                    order = json.dumps(self._order | {"socket": theirs.fileno()})
                    self._process = start_module(module, order, pass_fds=(theirs.fileno(),))
                self._admit(ours, "this machine")
                os.set_blocking(self._process[2].fileno(), False)
            return
        process = self._process[0]
        ended = process.poll() is not None
        self._words += (self._process[2].read() or b"").decode(errors="replace")
        *lines, self._words = self._words.split("\n")
        for line in lines:
            if line.startswith(ENDED):
                self._reason = line.removeprefix(ENDED)
            else:
                self._say(f"motion capture: {line}")
        if ended:
            self._tell(self._reason or _why(process.returncode))
            self._end_process()
            self._begin_ns = self._clock() + _AGAIN_NS

    def _tell(self, words: str) -> None:
        """Says why nothing comes, once for each reason in a row."""
        if words != self._said:
            self._said = words
            self._say(f"motion capture, {self.name}: {words}; it is tried again")

    def _step(self, until_ns: int) -> ArenaState | None:
        state = super()._step(min(until_ns, self._clock() + _LOOK_NS))
        if state is not None:
            self._said = ""
        return state

    def _let_go(self, tracker: Writer, reason: str) -> None:
        # One that has written nothing yet has not been told of either.
        super()._let_go(tracker, reason if tracker is self._tracker else "")

    def _hang_up(self) -> None:
        self._end_process()
        super()._hang_up()

    def _end_process(self) -> None:
        if self._process is None:
            return
        process, stdin, stdout = self._process
        process.kill()  # it may wait in C for ever
        process.wait()
        stdin.close()
        stdout.close()
        self._process, self._words, self._reason = None, "", ""


def _why(code: int) -> str:
    if code == -signal.SIGALRM:
        return f"no frame for {SILENT_S:g} s"
    return f"the process that asks it {describe_exit(code)}"
