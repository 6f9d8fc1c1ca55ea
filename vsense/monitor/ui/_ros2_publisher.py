"""Publishes a run or a replay on ROS 2's DDS (`--ros2`), to look only, by a process of its own.

`python -m vsense.monitor.ui._ros2_publisher` is that process, a `BusProcess`: it is sent a domain
and UTC less the messages' clock, and writes what follows from messages to DDS. A network of
strangers is nothing that a run should break by.
"""

from __future__ import annotations

import time
from typing import Any

from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError, require
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Console
from vsense.monitor.ros2 import LATCHED, Ros2Converter, build, dds_types
from vsense.monitor.ui._bus_process import BusProcess, ParentLink

_TOPICS = frozenset({"/experiment", "/arena", "/readings", "/robots"})
_MODULE = "vsense.monitor.ui._ros2_publisher"
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
        self._domain, self._console = domain, console
        self._shift_ns = utc_shift_ns
        self._process = BusProcess(bus, _MODULE, lambda sent, heard: None, self._tell_end)

    def start(self) -> None:
        """Begins to publish, and says where; VsenseError if it cannot."""
        check_ros2(self._domain)
        shift_ns = time.time_ns() - host_ns() if self._shift_ns is None else self._shift_ns
        try:
            # What the run is comes before what happens in it.
            self._process.start((self._domain, shift_ns), _TOPICS.__contains__, "/experiment")
        except VsenseError as error:
            raise Ros2Error(f"--ros2: domain {self._domain}: {error}") from None
        self._console.say(
            f"ROS 2: /tf, /poses, /robot_TAG/pose and readings in domain {self._domain}, for every"
            " machine that DDS reaches; there are no keys"
        )

    def close(self) -> None:
        """Ends the publishing; can be called again."""
        self._process.close()

    def _tell_end(self, error: Exception) -> None:
        text = f"ROS 2: nothing is published any more, and the run goes on: {error!r}"
        self._console.say(text, "warning")


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


def main() -> None:
    """Publishes until its standard input ends."""
    link = ParentLink()

    def publish(spec: tuple[int, int]) -> None:
        domain, shift_ns = spec
        writers, converter = DdsWriters(domain), Ros2Converter(shift_ns)
        link.send("ready", None)
        while True:
            for message in link.messages():
                for found in converter.convert(message):
                    writers.write(found.topic, found.kind, found.fields)

    link.serve(publish)


if __name__ == "__main__":
    main()
