"""The JSON-lines link: arena states from any other tracker, over TCP. For users: TRACKERS.md.

The tracker connects to vsense and writes one JSON object per line (UTF-8, ended by a line feed,
at most 1 MiB), one line per timestep:

    {"timestep": 17, "capture_ns": 81234567890123, "send_ns": 81234601234567, "robots": [
      {"tag": 23, "x_m": 0.512, "y_m": -0.103, "yaw_rad": 1.5708}]}

(on one line). `timestep` grows from line to line. `capture_ns` is the middle of the exposure and
`send_ns` when the line was written, both on a clock of the tracker's that never jumps, whatever
its zero; without `send_ns` the quickest line is taken to have needed no time. Places are in m and
headings in rad in the arena frame, counter-clockwise, 0 along +x. A robot with `"seen": false` is
as good as left out, and members that are not named here are ignored, so

    vsense track resources.xml experiment.xml | nc HOST PORT

works. In Python a tracker is

    link = socket.create_connection((host, port))
    for n in itertools.count():
        picture, capture_ns = camera.take()
        robots = [{"tag": t, "x_m": x, "y_m": y, "yaw_rad": a} for t, x, y, a in find(picture)]
        line = {"timestep": n, "capture_ns": capture_ns, "robots": robots}
        link.sendall(json.dumps(line | {"send_ns": time.monotonic_ns()}).encode() + b"\\n")

A line that is no such object is dropped and answered with one line of its own,
`{"line": 3, "error": "robots[0].x_m is 'a', expected a number"}`; the next line is good again.
One tracker is listened to at a time; a new one takes over where the old one fell silent for 1 s.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

from vsense.link.arena_wire import ROBOTS_MAX, Report
from vsense.link.status import LinkError

LINE_MAX = 1_048_576

_DRIFT_PER_MILLION = 250
_WHOLE_MAX = 2**62
_PLACE_MAX_M = 10_000.0


@dataclass(frozen=True, slots=True)
class Line:
    """One timestep as the tracker wrote it; times on the tracker's clock."""

    timestep: int
    capture_ns: int
    send_ns: int
    robots: tuple[Report, ...]


def parse(text: bytes) -> Line:
    """Reads one line without its end.

    Raises:
        LinkError: it is no such line; the message names the member, what is there, and what
            was expected.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LinkError(f"no JSON: {error}") from None
    if not isinstance(values, dict):
        raise LinkError("expected one object with timestep, capture_ns and robots")
    capture_ns = _whole(values, "capture_ns", "")
    robots = values.get("robots")
    if not isinstance(robots, list) or len(robots) > ROBOTS_MAX:
        raise LinkError(f"robots is {_show(robots)}, expected a list of at most {ROBOTS_MAX}")
    found = (_robot(robot, f"robots[{place}]") for place, robot in enumerate(robots))
    return Line(
        timestep=_whole(values, "timestep", ""),
        capture_ns=capture_ns,
        send_ns=_whole(values, "send_ns", "") if "send_ns" in values else capture_ns,
        robots=tuple(report for report in found if report is not None),
    )


def _robot(value: object, where: str) -> Report | None:
    """Reads one robot; None where the tracker says that it does not see it."""
    if not isinstance(value, dict):
        raise LinkError(f"{where} is {_show(value)}, expected an object")
    seen = value.get("seen", True)
    if not isinstance(seen, bool):
        raise LinkError(f"{where}.seen is {_show(seen)}, expected true or false")
    tag = _whole(value, "tag", f"{where}.")
    x_m, y_m = (_real(value, name, f"{where}.") for name in ("x_m", "y_m"))
    turn = _real(value, "yaw_rad", f"{where}.")
    return Report(tag, x_m, y_m, math.pi - (math.pi - turn) % math.tau) if seen else None


def _whole(values: dict[str, Any], name: str, where: str) -> int:
    value = values.get(name)
    if type(value) is not int or not 0 <= value <= _WHOLE_MAX:
        raise LinkError(f"{where}{name} is {_show(value)}, expected a whole number from 0")
    return value


def _real(values: dict[str, Any], name: str, where: str) -> float:
    value = values.get(name)
    if type(value) not in (int, float) or not abs(value) <= _PLACE_MAX_M:  # type: ignore[arg-type]
        raise LinkError(f"{where}{name} is {_show(value)}, expected a number")
    return float(value)  # type: ignore[arg-type]


def _show(value: object) -> str:
    """A value as an error shows it."""
    if value is None:
        return "missing"
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


class LineInbox:
    """Cuts received bytes into lines, however the network chunked them, in bounded memory."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._number = 0
        self._skipping = False

    def feed(self, data: bytes) -> list[tuple[int, bytes | None]]:
        """Takes bytes in; gives the whole lines with their numbers, from 1; None: too long."""
        found: list[tuple[int, bytes | None]] = []
        *ended, rest = data.split(b"\n")
        for part in ended:
            self._number += 1
            self._grow(part)
            found.append((self._number, None if self._skipping else bytes(self._bytes)))
            self._bytes.clear()
            self._skipping = False
        self._grow(rest)
        return found

    def _grow(self, part: bytes) -> None:
        if len(self._bytes) + len(part) > LINE_MAX:
            self._bytes.clear()
            self._skipping = True
        elif not self._skipping:
            self._bytes += part


class ClockMap:
    """Turns times of another clock into the host's, by the line that was the quickest."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._at_ns = 0

    def host_ns(self, line: Line, arrived_ns: int) -> int:
        """Gives a line's capture time on the host's clock; never later than its arrival."""
        offset_ns = arrived_ns - line.send_ns
        # An old offset loses its worth: the two clocks may drift apart.
        worth_ns = (arrived_ns - self._at_ns) * _DRIFT_PER_MILLION // 1_000_000
        if self._offset_ns is None or offset_ns <= self._offset_ns + worth_ns:
            self._offset_ns, self._at_ns = offset_ns, arrived_ns
        return min(line.capture_ns + self._offset_ns, arrived_ns)
