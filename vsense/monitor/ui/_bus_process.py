"""A process that is sent what a message bus carries, and serves it to strangers.

However many clients it has and however slowly they read, a run shares neither descriptors nor
memory nor Python's lock with them. The bus's thread only puts messages in. Of every topic the
newest one waits, so a slow process skips and never lags; a thread sends them.

The process is a Python module whose standard input is the link to its parent (`ParentLink`). What
it is to do comes first. It answers ("ready", value) or ("failed", reason); then messages come, and
it may send pairs of its own, as JSON: it faces strangers, and nothing of it is unpickled here. It
ends when its input ends.
"""

from __future__ import annotations

import json
import os
import resource
import socket
import subprocess
import threading
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.base.message_bus import Message, MessageBus
from vsense.base.processes import python_module

MEMORY_BYTES, DESCRIPTORS = 2 << 30, 256
"""What the process may take: what has more clients than that ends, and the run goes on."""
_NICE = 5
_EVENTS = 200
_WAKE_S = 0.1
_MOST_HEARD = 1 << 20
_START_S, _END_S = 20.0, 3.0

Heard = list[tuple[str, Any]]
"""What a process has sent: what it is about, and a value."""


class BusProcess:
    """The parent's end; ends with `close`."""

    def __init__(
        self,
        bus: MessageBus,
        module: str,
        follow: Callable[[list[Message], Heard], None],
        ended: Callable[[Exception], None],
    ) -> None:
        """Starts nothing yet.

        Args:
            bus: Whose messages are sent.
            module: The Python module that is the process.
            follow: Takes what was sent and what was heard meanwhile, now and then; on its thread.
            ended: Takes why nothing is sent any more, unless it was closed; on its thread.
        """
        self._bus, self._module = bus, module
        self._follow, self._tell_end = follow, ended
        self._waiting: dict[str, Message] = {}
        self._events: deque[Message] = deque(maxlen=_EVENTS)
        self._news = threading.Condition()
        self._closing = self._has_ended = False

    def start(self, spec: object, wants: Callable[[str], bool], first: str) -> Any:
        """Starts the process; gives the value of its answer.

        Args:
            spec: What it is to do.
            wants: Whether messages of a topic are sent.
            first: The topic that goes before the others.

        Raises:
            VsenseError: It does not begin; says why, and nothing else.
        """
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                python_module(self._module),
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._link = Connection(ours.detach())
        kind, value = "failed", "its process has ended"
        with ExitStack() as undone:
            undone.callback(self._end)  # also where a signal ends this
            with suppress(OSError, EOFError):
                self._link.send(spec)
                value = f"it has not begun within {_START_S:g} s"
                if self._link.poll(_START_S):
                    value = "its process has ended"
                    kind, value = self._hear()
            if kind != "ready":
                raise VsenseError(str(value))
            undone.pop_all()
        name, work = self._module, partial(self._run, first)
        self._thread = threading.Thread(target=work, name=name, daemon=True)
        self._thread.start()
        self._listener = self._bus.join(
            self._receive, lambda topic: not self._has_ended and wants(topic)
        )
        return value

    def close(self) -> None:
        """Ends the process; can be called again."""
        self._bus.leave(self._listener)
        with self._news:
            self._closing = True
            self._news.notify()
        self._thread.join(_END_S)
        self._end()

    def _hear(self) -> tuple[str, Any]:
        """Reads a pair; EOFError, OSError: the process has ended."""
        kind, value = json.loads(self._link.recv_bytes(_MOST_HEARD))
        return str(kind), value

    def _receive(self, message: Message) -> None:
        """Takes a message of the bus; does not wait."""
        with self._news:
            if message.topic == "/event":
                self._events.append(message)
            else:
                self._waiting.pop(message.topic, None)
                self._waiting[message.topic] = message
            self._news.notify()

    def _run(self, first: str) -> None:
        try:
            while not self._closing:
                messages = sorted(self._next(), key=lambda message: message.topic != first)
                heard: Heard = []
                while self._link.poll():
                    heard.append(self._hear())
                # Before anything is sent: to a process that has ended nothing can be.
                if reasons := [reason for kind, reason in heard if kind == "failed"]:
                    raise VsenseError(reasons[0])
                for message in messages:
                    self._link.send(message)
                self._follow(messages, heard)
        except Exception as error:
            self._has_ended = True
            if not self._closing:
                self._tell_end(error)

    def _next(self) -> list[Message]:
        """Waits for messages, at most for a moment."""
        with self._news:
            if not (self._waiting or self._events or self._closing):
                self._news.wait(_WAKE_S)
            waiting, self._waiting = self._waiting, {}
            events = list(self._events)
            self._events.clear()
        return [*waiting.values(), *events]

    def _end(self) -> None:
        self._link.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class ParentLink:
    """The process's end; its methods may be called by any thread."""

    def __init__(self) -> None:
        """Takes standard input over, and gives way to a run for processors and memory."""
        os.nice(_NICE)
        for kind, most in (
            (resource.RLIMIT_AS, MEMORY_BYTES),
            (resource.RLIMIT_NOFILE, DESCRIPTORS),
        ):
            _, hard = resource.getrlimit(kind)
            bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (bound, hard))
        with suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text("1000")
        self._connection = Connection(os.dup(0))
        self._lock = threading.Lock()

    def serve(self, work: Callable[[Any], None]) -> None:
        """Has `work` do what the parent says first, until it ends; says why it failed."""
        try:
            work(self._connection.recv())
        except (EOFError, ConnectionError):
            return
        except Exception as error:  # whatever a library raises becomes one line
            with suppress(OSError):
                self.send("failed", str(error) or type(error).__name__)

    def send(self, kind: str, value: object) -> None:
        """Sends a pair, of which the value has a form in JSON."""
        with self._lock:
            self._connection.send_bytes(json.dumps((kind, value)).encode())

    def messages(self, wait_s: float | None = None) -> list[Message]:
        """What has come; waits for the first. EOFError: the parent has ended."""
        messages = []
        while self._connection.poll(wait_s):
            messages.append(self._connection.recv())
            wait_s = 0.0
        return messages
