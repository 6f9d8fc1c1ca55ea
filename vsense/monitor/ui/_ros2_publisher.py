"""Publishes a run or a replay on ROS 2's DDS (`--ros2`), to look only, by a process of its own.

The publisher's thread only puts messages in. Of every topic the newest one waits, so a slow network
skips and never lags; a thread sends them. `python -m vsense.monitor.ui._ros2_publisher` is the
process: it takes messages from its standard input, and writes what follows from them to DDS. A
network of strangers is nothing that a run should break by.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError, require
from vsense.base.message_bus import Message, MessageBus
from vsense.base.processes import python_module
from vsense.base.terminal import Console
from vsense.monitor.ros2 import LATCHED, Ros2Converter, build, dds_types

_TOPICS = frozenset({"/experiment", "/arena", "/readings", "/robots"})
_START_S, _END_S, _WAKE_S = 20.0, 3.0, 0.1
_KEPT = 10
_BLOCKED_NS = 10_000_000


class Ros2Error(VsenseError):
    """Nothing can be published on DDS."""


def check_ros2(domain: int | None) -> None:
    """Raises UsageError where the package is missing; None: nothing is asked for."""
    if domain is not None:
        require("--ros2 needs", "cyclonedds")


class Ros2Publisher:
    """Publishes what a bus carries, in a domain of DDS; ends with `close`.

    `utc_shift_ns` is UTC less the clock of the bus's messages; None: these are dated by now.
    """

    def __init__(
        self, bus: MessageBus, domain: int, console: Console, utc_shift_ns: int | None = None
    ) -> None:
        self._bus, self._domain, self._console = bus, domain, console
        self._shift_ns = utc_shift_ns
        self._waiting: dict[str, Message] = {}
        self._news = threading.Condition()
        self._closing = False

    def start(self) -> None:
        """Begins to publish, and says where; VsenseError if it cannot."""
        check_ros2(self._domain)
        shift_ns = time.time_ns() - host_ns() if self._shift_ns is None else self._shift_ns
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                python_module("vsense.monitor.ui._ros2_publisher"),
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._link = Connection(ours.detach())
        why = "its process has ended"
        with suppress(OSError, EOFError):
            self._link.send((self._domain, shift_ns))
            why = self._link.recv() if self._link.poll(_START_S) else "it has not begun"
        if why:
            self._end_process()
            raise Ros2Error(f"--ros2: domain {self._domain}: {why}")
        self._thread = threading.Thread(target=self._run, name="vsense-ros2", daemon=True)
        self._thread.start()
        self._listener = self._bus.join(self._receive, _TOPICS.__contains__)
        self._console.say(
            f"ROS 2: /tf, /poses, /robot_TAG/pose and readings in domain {self._domain}, for every"
            " machine that DDS reaches; there are no keys"
        )

    def close(self) -> None:
        """Ends the publishing."""
        self._bus.leave(self._listener)
        with self._news:
            self._closing = True
            self._news.notify()
        self._thread.join(_END_S)
        self._end_process()

    def _receive(self, message: Message) -> None:
        """Takes a message of the bus; does not wait."""
        with self._news:
            self._waiting[message.topic] = message
            self._news.notify()

    def _run(self) -> None:
        try:
            while not self._closing:
                with self._news:
                    if not self._waiting:
                        self._news.wait(_WAKE_S)
                    waiting, self._waiting = self._waiting, {}
                if waiting:
                    # What the run is comes before what happens in it.
                    order = sorted(waiting, key=lambda topic: topic != "/experiment")
                    self._link.send([waiting[topic] for topic in order])
        except OSError as error:
            if not self._closing:
                text = f"ROS 2: nothing is published any more, and the run goes on: {error}"
                self._console.say(text, "warning")

    def _end_process(self) -> None:
        self._link.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class DdsWriters:
    """Writes messages of ROS 2 to DDS; topics are made when they are written to first."""

    def __init__(self, domain: int) -> None:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        self._domain, self._kinds = DomainParticipant(domain), dds_types()
        self._topic, self._writer = Topic, DataWriter
        reliable = Policy.Reliability.Reliable(_BLOCKED_NS)
        lasting = Policy.Durability.TransientLocal
        self._live = Qos(reliable, Policy.History.KeepLast(_KEPT))
        self._latched = Qos(reliable, Policy.History.KeepLast(1), lasting)
        self._writers: dict[str, Any] = {}

    def write(self, topic: str, kind: str, fields: dict[str, Any]) -> None:
        """Writes a message; `kind` is a name in `DEFINITIONS`."""
        if topic not in self._writers:
            qos = self._latched if topic.endswith(LATCHED) else self._live
            made = self._topic(self._domain, f"rt{topic}", self._kinds[kind])
            self._writers[topic] = self._writer(self._domain, made, qos=qos)
        self._writers[topic].write(build(self._kinds, kind, fields, lambda array: array.tolist()))


def main() -> int:
    """Publishes until its standard input ends."""
    link = Connection(0)
    domain, shift_ns = link.recv()
    try:
        writers = DdsWriters(domain)
    except Exception as error:  # whatever the library raises becomes one line
        link.send(str(error) or type(error).__name__)
        return 1
    link.send("")
    converter = Ros2Converter(shift_ns)
    with suppress(EOFError, OSError):
        while True:
            for message in link.recv():
                for found in converter.convert(message):
                    writers.write(found.topic, found.kind, found.fields)
    return 0


if __name__ == "__main__":
    sys.exit(main())
