"""Robots with the original client, sans-I/O: what each is still to be told; one per experiment.

Of readings only the newest wait: a robot that is slow to take them misses those between, as it
would have with the original, but never holds up anybody else and never grows a queue.
"""

from __future__ import annotations

from collections.abc import Mapping

from vsense.link.legacy_wire import END, START, Translation, update
from vsense.link.status import LinkError

OCTET_MAX = 254


class LegacyRobot:
    """One connection's state.

    Attributes:
        tag: the robot's.
        name: its name in the experiment.
        updates: timesteps in which it was told something.
    """

    def __init__(self, tag: int, name: str, table: bytes) -> None:
        """Begins with the table."""
        self.tag = tag
        self.name = name
        self.updates = 0
        self._out = table
        self._running = False
        self._ended = False
        self._newest: Mapping[int, bytes] = {}
        self._told: dict[int, bytes] = {}

    def start(self) -> None:
        """The experiment starts, or has started before this robot came."""
        if not self._running and not self._ended:
            self._running = True
            self._out += START

    def end(self) -> None:
        """The experiment ends: nothing follows, as the original's robots expect nothing more."""
        self._ended = self._ended or self._running

    def sense(self, payloads: Mapping[int, bytes]) -> None:
        """Takes the newest readings, by the sensor's number; after the end none."""
        if not self._ended:
            self._newest = payloads

    @property
    def pending(self) -> bool:
        """Whether there is anything to write."""
        return bool(self.chunk())

    def chunk(self) -> bytes:
        """The bytes to write next; empty if there are none.

        What has begun to leave is finished first. Only then is the next message made, of all
        that differs from what this robot was told last; the end comes after the newest readings.
        """
        if not self._out and self._running:
            changed = {k: p for k, p in self._newest.items() if self._told.get(k) != p}
            self._out = update(changed.items())
            self._told |= changed
            self.updates += bool(changed)
            if self._ended and not changed:
                self._running, self._out = False, END
        return self._out

    def wrote(self, count: int) -> None:
        """Says how many bytes of the last `chunk` the kernel took."""
        self._out = self._out[count:]


class LegacySwarm:
    """Who of an experiment's robots is connected, and what all are told.

    Attributes:
        robots: those that are connected, by the last octet of their address.
        translation: of the readings.
    """

    def __init__(self, translation: Translation, numbers: Mapping[int, tuple[int, str]]) -> None:
        """Prepares it.

        Args:
            translation: of the readings.
            numbers: tag and name of each robot by the last octet of its address.
        """
        self.translation = translation
        self.robots: dict[int, LegacyRobot] = {}
        self._numbers = dict(numbers)
        self._payloads: dict[int, Mapping[int, bytes]] = {}
        self._running = False

    def join(self, octet: int) -> LegacyRobot | None:
        """Lets a robot in, at any time; one that comes again begins anew.

        Returns:
            Its state; None if no robot of the experiment has this number.
        """
        if octet not in self._numbers:
            return None
        tag, name = self._numbers[octet]
        robot = LegacyRobot(tag, name, self.translation.table)
        robot.sense(self._payloads.get(tag, {}))
        if self._running:
            robot.start()
        self.robots[octet] = robot
        return robot

    def leave(self, octet: int, robot: LegacyRobot) -> bool:
        """Forgets a robot; False if it had come again meanwhile."""
        if self.robots.get(octet) is not robot:
            return False
        del self.robots[octet]
        return True

    def start(self) -> None:
        """The experiment starts."""
        self._running = True
        for robot in self.robots.values():
            robot.start()

    def end(self) -> None:
        """The experiment ends."""
        self._running = False
        for robot in self.robots.values():
            robot.end()

    def sense(self, tag: int, payloads: Mapping[int, bytes]) -> None:
        """Takes a robot's newest readings."""
        self._payloads[tag] = payloads
        for robot in self.robots.values():
            if robot.tag == tag:
                robot.sense(payloads)

    def known(self) -> str:
        """The numbers that are expected, for people."""
        return ", ".join(map(str, sorted(self._numbers))) or "none"


def by_octet(robots: Mapping[int, tuple[str, int]]) -> dict[int, tuple[int, str]]:
    """Sorts an experiment's robots by the last octet of their addresses.

    Args:
        robots: name and number of each by tag; the number is the last part of its id
            (NAME_TAG_NUMBER).

    Returns:
        Tag and name by number; robots whose number is no octet of an address are left out.

    Raises:
        LinkError: two have the same number, or none has one.
    """
    found: dict[int, tuple[int, str]] = {}
    for tag, (name, number) in robots.items():
        if not 1 <= number <= OCTET_MAX:
            continue
        if number in found:
            raise LinkError(
                f"{found[number][1]} and {name} have the same number {number}: with the original"
                f" client a robot is known by it, the last octet of its address"
            )
        found[number] = (tag, name)
    if not found:
        raise LinkError(
            "no robot's id ends with the last octet of an address (NAME_TAG_OCTET, such as"
            " epuck_23_30): so robots with the original client are known"
        )
    return found
