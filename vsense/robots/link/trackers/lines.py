"""The JSON-lines link: arena states from any other tracker, over TCP.

TRACKERS.md, for users, specifies the lines and what is made of them.
"""

from __future__ import annotations

import contextlib
import json
import math
import select
import socket
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns
from vsense.robots.link import strangers
from vsense.robots.link.network import listen
from vsense.robots.link.status import LinkError
from vsense.robots.link.strangers import PortPlaces, StrangerLog, owner_of
from vsense.robots.link.trackers._repair import Repair, StateCounters, TrackerLink
from vsense.robots.link.trackers.protocol import ROBOTS_MAX, TrackerReport

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
    robots: tuple[TrackerReport, ...]


def parse(text: bytes) -> Line:
    """Reads one line without its end.

    Raises:
        LinkError: it is no such line; the message names the member, what is there, and what was
            expected.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LinkError(f"no JSON: {error}") from None
    if not isinstance(values, dict):
        raise LinkError("expected one object with timestep, capture_ns and robots")
    capture_ns = _integer(values, "capture_ns", "")
    robots = values.get("robots")
    if not isinstance(robots, list) or len(robots) > ROBOTS_MAX:
        raise LinkError(f"robots is {_show(robots)}, expected a list of at most {ROBOTS_MAX}")
    reports = (_robot(robot, f"robots[{place}]") for place, robot in enumerate(robots))
    return Line(
        timestep=_integer(values, "timestep", ""),
        capture_ns=capture_ns,
        send_ns=_integer(values, "send_ns", "") if "send_ns" in values else capture_ns,
        robots=tuple(report for report in reports if report is not None),
    )


def _robot(value: object, where: str) -> TrackerReport | None:
    """Reads one robot; None where the tracker says that it does not see it."""
    if not isinstance(value, dict):
        raise LinkError(f"{where} is {_show(value)}, expected an object")
    seen = value.get("seen", True)
    if not isinstance(seen, bool):
        raise LinkError(f"{where}.seen is {_show(seen)}, expected true or false")
    tag = _integer(value, "tag", f"{where}.")
    x_m, y_m = (_real(value, name, f"{where}.") for name in ("x_m", "y_m"))
    turn = _real(value, "yaw_rad", f"{where}.")
    return TrackerReport(tag, x_m, y_m, math.pi - (math.pi - turn) % math.tau) if seen else None


def _integer(values: dict[str, Any], name: str, where: str) -> int:
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
        lines: list[tuple[int, bytes | None]] = []
        *ended, rest = data.split(b"\n")
        for part in ended:
            self._number += 1
            self._grow(part)
            lines.append((self._number, None if self._skipping else bytes(self._bytes)))
            self._bytes.clear()
            self._skipping = False
        self._grow(rest)
        return lines

    def _grow(self, part: bytes) -> None:
        if len(self._bytes) + len(part) > LINE_MAX:
            self._bytes.clear()
            self._skipping = True
        elif not self._skipping:
            self._bytes += part


class SenderClock:
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


TRACKER_SILENCE_NS = 1_000_000_000
"""A tracker that writes no valid line for this long has to make room for another."""
CANDIDATES_MAX, CANDIDATES_EACH = 8, 4
"""Connections without a valid line, in all and from one address; the oldest makes way for one
more."""
BAD_MAX = 16
"""Bad lines until a connection without a valid one is closed: each costs time that the tracker's
lines wait."""
TOLD_MAX = 3
"""Bad lines of one connection that a person gets to see; the tracker gets all."""

_LATE_NS, _LATE_LINES = 500_000_000, 10
"""So many lines in a row of pictures that are older are told: robots stand for older readings."""
_JUMP_MAX = 100_000
_CHUNK = 65_536


@dataclass(slots=True)
class ListenerCounters(StateCounters):
    """What happened on the link so far; `refused` trackers came while another one was writing."""

    bad_lines: int = 0
    connections: int = 0
    refused: int = 0


class Writer:
    """Who has opened a connection to write lines."""

    def __init__(self, sock: socket.socket, origin: str, now_ns: int) -> None:
        self.sock = sock
        self.origin = origin
        self.heard_ns = now_ns
        self.inbox = LineInbox()
        self.clock = SenderClock()
        self.timestep: int | None = None
        self.bad = self._late = 0

    def ages(self, age_ns: int) -> bool:
        """Takes how old a line's picture is; whether it is to be told that all are."""
        self._late = self._late + 1 if age_ns > _LATE_NS else 0
        return self._late == _LATE_LINES


class ArenaListener(TrackerLink):
    """A source of arena states; it has no thread and waits in `next` only.

    Args:
        host: name or address of the interface to listen on; None: nobody can connect, and who
            writes is given to `_admit`.
        port: its number; 0 takes any that is free.
        tags: the tags of the experiment.
        say, clock: see `TrackerLink`.

    Raises:
        LinkError: the host is unknown, or the port is taken.
    """

    def __init__(
        self,
        host: str | None,
        port: int,
        tags: Collection[int],
        say: Callable[[str], None],
        clock: Callable[[], int] = host_ns,
    ) -> None:
        self._listener: socket.socket | None
        self._listener, self.port = (None, 0) if host is None else listen(host, port)
        super().__init__(f"on port {self.port}", say, clock)
        self.counters = ListenerCounters()
        self.repair = Repair(tags)
        self._tracker: Writer | None = None
        self._candidates = PortPlaces[Writer](CANDIDATES_MAX, CANDIDATES_EACH)
        self._strangers = StrangerLog(f"port {self.port}", say)
        self._resume_ns = 0

    def start(self) -> None:
        """The link has no runs: a tracker writes as long as it is connected."""

    def stop(self) -> None:
        """See `start`."""

    def _miss(self, timeout_s: float) -> str:
        return f"on {self._tracker.origin}" if self._tracker else self.name

    def _step(self, until_ns: int) -> ArenaState | None:
        now_ns = self._clock()
        self._strangers.tick(now_ns)
        trackers = [*([self._tracker] if self._tracker else []), *self._candidates]
        socks = [tracker.sock for tracker in trackers]
        listener = self._listener
        if listener is not None and now_ns >= self._resume_ns:
            socks.append(listener)
        elif listener is not None:
            until_ns = min(until_ns, self._resume_ns)
        ready = self._poll(dict.fromkeys(socks, select.POLLIN), until_ns)
        state = None
        for tracker in trackers:
            if tracker.sock.fileno() in ready:
                state = self._read(tracker) or state
        if listener is not None and listener.fileno() in ready:
            self._accept(listener)
        return state

    def _hang_up(self) -> None:
        for tracker in (self._tracker, *self._candidates):
            if tracker is not None:
                self._let_go(tracker, "")
        if self._listener is not None:
            self._listener.close()

    def _accept(self, listener: socket.socket) -> None:
        now_ns = self._clock()
        try:
            sock, address = listener.accept()
        except (BlockingIOError, InterruptedError, ConnectionError):
            return
        except OSError as error:
            text = f"cannot accept a connection: {error.strerror}"
            self._strangers.note("this machine", text, now_ns)
            self._resume_ns = now_ns + round(strangers.PAUSE_S * 1e9)
            return
        self._admit(sock, str(address[0]))

    def _admit(self, sock: socket.socket, origin: str) -> None:
        """Takes lines of a connection, unless another tracker writes."""
        now_ns = self._clock()
        sock.setblocking(False)
        candidate = Writer(sock, origin, now_ns)
        if self._is_written(now_ns):
            self._refuse(candidate)
            return
        loser = self._candidates.add(candidate, owner_of(candidate.origin))
        if loser is not None:
            loser.sock.close()
            self._strangers.note(loser.origin, "no valid line", now_ns)

    def _is_written(self, now_ns: int) -> bool:
        """Whether a tracker writes, whose place no other gets."""
        return self._tracker is not None and now_ns - self._tracker.heard_ns < TRACKER_SILENCE_NS

    def _refuse(self, candidate: Writer) -> None:
        assert self._tracker is not None
        self.counters.refused += 1
        origin = self._tracker.origin
        _answer(candidate.sock, {"error": f"a tracker on {origin} is writing already"})
        self._let_go(candidate, f": refused, one on {origin} is writing")

    def _read(self, tracker: Writer) -> ArenaState | None:
        try:
            data = tracker.sock.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError as error:
            self._let_go(tracker, f" is gone: {error.strerror}")
            return None
        if not data:
            self._let_go(tracker, " has closed the connection")
            return None
        newest, now_ns = None, self._clock()
        for number, text in tracker.inbox.feed(data):
            try:
                line = self._parse(tracker, text)
            except LinkError as error:
                self._reject(tracker, number, str(error))
                if tracker is not self._tracker and tracker.bad >= BAD_MAX:
                    self._let_go(tracker, f": closed after {BAD_MAX} bad lines and no valid one")
                    break
                continue
            if line is None:
                continue
            if not self._takes_over(tracker, now_ns):
                break
            state = self._follow(tracker, line, now_ns)
            self.counters.skipped += newest is not None
            newest = state
        return newest

    def _takes_over(self, tracker: Writer, now_ns: int) -> bool:
        """Whether a valid line counts: whoever writes one has the place, unless another has it."""
        if tracker is not self._tracker:
            if self._is_written(now_ns):
                self._refuse(tracker)
                return False
            if self._tracker is not None:
                self._let_go(self._tracker, " has fallen silent, another one takes over")
            self._candidates.remove(tracker)
            self._tracker = tracker
            self.counters.connections += 1
            self._say_of(tracker, ": connected")
        tracker.heard_ns = now_ns
        return True

    def _parse(self, tracker: Writer, text: bytes | None) -> Line | None:
        """Reads a line that follows those before; None if it is empty."""
        if text is None:
            raise LinkError(f"longer than {LINE_MAX} bytes")
        if not text.strip():
            return None
        line = parse(text)
        step = 1 if tracker.timestep is None else line.timestep - tracker.timestep
        if not 1 <= step <= _JUMP_MAX:
            raise LinkError(f"timestep is {line.timestep} after {tracker.timestep}, expected more")
        return line

    def _follow(self, tracker: Writer, line: Line, now_ns: int) -> ArenaState:
        step = 1 if tracker.timestep is None else line.timestep - tracker.timestep
        tracker.timestep = line.timestep
        self.counters.states += 1
        capture_ns = tracker.clock.host_ns(line, now_ns)
        if tracker.ages(now_ns - capture_ns):
            old = f"{(now_ns - capture_ns) / 1e9:.1f} s old"
            why = "it is slow, or its clock was set back and it must connect again"
            self._say_of(tracker, f": its lines are {old}, robots stand: {why}")
        return self.repair.follow(line.robots, step, capture_ns)

    def _reject(self, tracker: Writer, number: int, error: str) -> None:
        self.counters.bad_lines += 1
        tracker.bad += 1
        _answer(tracker.sock, {"line": number, "error": error})
        if tracker.bad <= TOLD_MAX:
            more = " (more of this is only counted)" if tracker.bad == TOLD_MAX else ""
            self._say_of(tracker, f": line {number}: {error}{more}")

    def _let_go(self, tracker: Writer, reason: str) -> None:
        tracker.sock.close()
        self._candidates.remove(tracker)
        if tracker is self._tracker:
            self._tracker = None
        if reason:
            self._say_of(tracker, reason)

    def _say_of(self, tracker: Writer, text: str) -> None:
        """Tells something of a tracker; whoever reaches the port can be one."""
        text, deed = f"tracker on {tracker.origin}{text}", "connections and bad lines"
        self._strangers.say(tracker.origin, text, deed, self._clock())


def _answer(sock: socket.socket, values: dict[str, object]) -> None:
    with contextlib.suppress(OSError):
        sock.send(json.dumps(values).encode() + b"\n")
