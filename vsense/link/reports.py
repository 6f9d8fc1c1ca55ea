"""What the robots' virtual actuators say, as far as the host may still act on it; sans-I/O."""

from __future__ import annotations

from dataclasses import dataclass

from vsense.link.wire import Header, Telemetry

LIFE_NS = 1_000_000_000
"""A report counts while its robot's controller acts: this long after the newest control step that
the host has heard of."""


@dataclass(frozen=True, slots=True)
class Report:
    """The newest report of one robot.

    Attributes:
        uid: who reports: another robot with the same tag has counters of its own.
        payload: the actuators' block, in the sensor table's order.
    """

    uid: bytes
    payload: bytes


class Reporter:
    """One robot's reports in one session.

    Packets that were repeated, came too late, belong to another session or were made for another
    table never get here: the acceptance filter has dropped them.
    """

    def __init__(self) -> None:
        self._uid = b""
        self._newest: tuple[int, Telemetry] | None = None
        self._control_step: int | None = None
        self._acted_ns = 0

    def open(self, uid: bytes) -> None:
        """A session opens: what the robot said in the one before is forgotten."""
        self._uid, self._newest, self._control_step = uid, None, None

    def close(self) -> None:
        """The session ends."""
        self._newest = None

    def take(self, header: Header, telemetry: Telemetry, now_ns: int) -> None:
        """Takes accepted telemetry that came at now_ns, host's clock."""
        self._newest = header.run, telemetry
        if telemetry.control_step != self._control_step:
            self._control_step, self._acted_ns = telemetry.control_step, now_ns

    def report(self, run: int, now_ns: int) -> Report | None:
        """Gives the robot's report.

        Args:
            run: number of the present run.
            now_ns: host's clock.

        Returns:
            The report; None if there is none of this run, or none that still counts.
        """
        if self._newest is None or now_ns - self._acted_ns >= LIFE_NS:
            return None
        of_run, telemetry = self._newest
        return Report(self._uid, telemetry.payload) if of_run == run else None
