"""The microcontrollers of the lab's robots: real firmware code behind what real daemons open."""

from __future__ import annotations

import select
import struct
import tempfile
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.native import lib
from vsense.base.shared import LabError, LogFile, file_errors
from vsense.modes.lab._air import Air
from vsense.modes.lab._links import PROGRAMS, Bus, Link, Terminal
from vsense.modes.lab._ros2_robot import Ros2Robot
from vsense.modes.lab._thymio import Dongle
from vsense.world.robot_models import EPUCK, RobotModel

ACTUATION = np.dtype(
    [
        ("time_ns", "<i8"), ("robot", "<u2"),
        ("left_steps_s", "<i2"), ("right_steps_s", "<i2"), ("leds", "<u2"),
    ]
)  # fmt: skip
"""A microcontroller's command to motors and LEDs; an actuation log is these, end to end.

`time_ns` is the host's monotonic clock when the firmware gave it; `robot` the robot's index; speeds
and lit LEDs, bits 0-7 ring, 8 body, 9 front, hold from then on.
"""

_RECORD = struct.Struct("<qHhhH")

WATCHDOG_US: int = lib.FW_WATCHDOG_TICKS * lib.FW_WATCHDOG_TICK_MS * 1000
"""How long a firmware with a watchdog waits for the next command."""


class Actuation(NamedTuple):
    """A row of `ACTUATION`."""

    time_ns: int
    robot: int
    left_steps_s: int
    right_steps_s: int
    leds: int


class Microcontrollers:
    """One emulated microcontroller, and what its daemon opens, per robot.

    The lines stay open when a daemon ends, and the microcontroller keeps its state. Nothing here
    waits: bytes are lost when a terminal is full, as on a wire. Time is an argument in ns and never
    goes back.

    Attributes:
        links: of each robot; tests make faults in their C structs.
        bases: the values of `--base` of the robots' daemons.
    """

    def __init__(
        self,
        kinds: Sequence[str],
        watchdog: bool = False,
        grounded: bool = False,
        models: Sequence[RobotModel] = (),
    ) -> None:
        """Powers one on for each of `kinds`, of `vsense.modes.lab._links.PROGRAMS`.

        Args:
            kinds: of each robot.
            watchdog: their firmware stops the motors when its host falls silent, as
                `firmware_bridge/fw_watchdog.h` does and stock firmware does not.
            grounded: those on a bus have a ground board, and their daemons are told.
            models: of the robots; without, they are e-pucks.

        Raises:
            LabError: no such kind, it is not for the robot's model, or there are not that many
                pseudo-terminals or sockets.
            VsenseError: a package is missing.
        """
        self.links: list[Link] = []
        self._folder = tempfile.TemporaryDirectory(prefix="vsense-")
        self._robots: dict[int, int] = {}  # by descriptor
        self._heard: dict[int, int | None] = {}  # descriptor in `_ready`, by robot
        self._ready, self._dues = select.epoll(), dict[int, int]()  # dues of who is not idle
        try:
            for robot, kind in enumerate(kinds):
                model = models[robot] if models else EPUCK
                self.links.append(_link(kind, robot, Path(self._folder.name), model))
        except OSError as error:
            count = len(self.links)
            self.close()
            raise LabError(
                f"emulated robots: {count} of {len(kinds)}, then: {error.strerror or error}"
            ) from None
        except BaseException:
            self.close()
            raise
        self._power_on(kinds, watchdog, grounded)

    def _power_on(self, kinds: Sequence[str], watchdog: bool, grounded: bool) -> None:
        for link in self.links:
            link.program.state.body.watchdog_us = WATCHDOG_US if watchdog else 0
        self.bases = [
            link.program.kind.base(kind, link.device)
            + (",ground" if grounded and isinstance(link, Bus) else "")
            for kind, link in zip(kinds, self.links)
        ]
        for robot in range(len(self.links)):
            self._plan(robot)

    @property
    def due_ns(self) -> int | None:
        """When `advance_due` has something to do again, None while all lines are idle."""
        return min(self._dues.values(), default=None)

    @property
    def devices(self) -> list[str]:
        """What the robots' daemons open: a terminal's path, or `unix:` and a socket's."""
        return [link.device for link in self.links]

    def fileno(self) -> int:
        """A descriptor that is readable while `readable` has something."""
        return self._ready.fileno()

    def readable(self) -> list[int]:
        """The descriptors that have bytes which `receive` would take now."""
        return [descriptor for descriptor, _ in self._ready.poll(0)]

    def receive(self, descriptors: Iterable[int], now_ns: int) -> None:
        """Passes the daemons' bytes to the microcontrollers, which have them at `now_ns`.

        `descriptors` are those of `readable` before that time: what a daemon writes later must not
        count as having come by then.
        """
        for descriptor in descriptors:
            robot = self._robots[descriptor]
            self.links[robot].receive(now_ns)
            self._plan(robot)

    def advance(self, now_ns: int) -> list[Actuation]:
        """Runs all microcontrollers up to `now_ns` and passes on the bytes that they sent.

        Returns the commands to motors and LEDs since the last call, in order for each robot.
        """
        return self._advance(sorted(self._dues), now_ns)

    def advance_due(self, now_ns: int) -> list[Actuation]:
        """As `advance`, for those alone that have to do something by then.

        The others' sensors must not change before the next `advance`.
        """
        return self._advance([r for r, due_ns in self._dues.items() if due_ns <= now_ns], now_ns)

    def _advance(self, robots: Collection[int], now_ns: int) -> list[Actuation]:
        applied = []
        for robot in robots:
            for out in self.links[robot].advance(now_ns):
                speeds = out.left_steps_s, out.right_steps_s
                applied.append(Actuation(out.time_ns, robot, *speeds, out.leds))
            self._plan(robot)
        return applied

    def sense(self, prox_raw: NDArray[np.int16]) -> None:
        """Sets the raw values (count, 8) of the proximity sensors ps0..ps7 from now on."""
        for link, raw in zip(self.links, prox_raw):
            link.program.proximity[:] = raw

    def sense_ground(self, raw: NDArray[np.int16]) -> None:
        """Sets what ground boards, and Thymios, measure, (count, 3): left, centre, right."""
        for link, values in zip(self.links, raw.tolist()):
            if isinstance(link, Bus):
                link.ground.ground = values
            elif isinstance(link, Dongle):
                link.program.state.body.inputs.ground[0:3] = values

    def wake(self) -> None:
        """Makes the next `advance` run every microcontroller, as after a change of its state."""
        self._dues.update(dict.fromkeys(range(len(self.links)), 0))

    def counters(self) -> dict[str, int]:
        """Counters of the lines since power on, summed over all robots.

        `frames` are the commands that reached a microcontroller; `overlapped_bytes` and
        `overflowed_bytes` as in `fw_uart.h`; `failed_transactions` as in `fw_i2c.h`; `sent_bytes`
        to the daemons, and `lost_bytes` that a full terminal did not take.
        """
        names = "sent_bytes lost_bytes frames overlapped_bytes overflowed_bytes transactions"
        totals = dict.fromkeys((*names.split(), "failed_transactions"), 0)
        for link in self.links:
            totals["sent_bytes"] += link.sent_bytes
            totals["lost_bytes"] += link.lost_bytes
            totals["frames"] += getattr(link.program.state, link.program.kind.count)
            for name, value in link.faults().items():
                totals[name] += value
        return totals

    def close(self) -> None:
        """Closes all lines."""
        for link in self.links:
            link.close()
        self.links = []
        self._ready.close()
        self._folder.cleanup()

    def _plan(self, robot: int) -> None:
        """Notes when it is due again, and what has it receive."""
        link = self.links[robot]
        if link.due_ns is None:
            self._dues.pop(robot, None)
        else:
            self._dues[robot] = link.due_ns
        if link.readable() != self._heard.get(robot):
            self._listen(robot, link.readable())

    def _listen(self, robot: int, descriptor: int | None) -> None:
        before, self._heard[robot] = self._heard.get(robot), descriptor
        if before is not None:
            self._ready.unregister(before)
        if descriptor is not None:
            self._ready.register(descriptor, select.EPOLLIN)
            self._robots[descriptor] = robot


def _link(name: str, robot: int, folder: Path, model: RobotModel) -> Link:
    kind = PROGRAMS.get(name)
    if kind is None:
        raise LabError(f"no base {name!r} in the lab: expected one of {', '.join(PROGRAMS)}")
    if name == "wifi":
        return Air(kind, robot)
    if name == "thymio":
        return Dongle(kind, model)
    if name == "ros2":
        return Ros2Robot(kind, robot, folder, model)
    return Terminal(kind) if kind.byte_ns else Bus(kind, folder / f"{robot}.i2c")


class ActuationLog:
    """Writes a file of `ACTUATION` records."""

    def __init__(self, path: Path) -> None:
        """Starts an empty log; raises LabError where the file cannot be written."""
        self._file = LogFile(path)
        self._pending = bytearray()

    def append(self, actuation: Actuation) -> None:
        """Adds one record; `flush` writes it to the file."""
        self._pending += _RECORD.pack(*actuation)

    def flush(self) -> None:
        """Writes all records so far to the file."""
        self._file.append(self._pending)
        self._pending.clear()

    def close(self) -> None:
        """Writes the last records, and ends the file."""
        self.flush()
        self._file.close()


def read_actuations(path: Path, offset: int = 0) -> NDArray[np.void]:
    """Reads an actuation log: (n,) `ACTUATION`; a last record cut short is left out.

    Args:
        path: of the file.
        offset: records that end before this byte of it are left out.

    Raises:
        LabError: the file cannot be read.
    """
    with file_errors(path), path.open("rb") as file:
        file.seek(offset // ACTUATION.itemsize * ACTUATION.itemsize)
        content = file.read()
    return np.frombuffer(content, dtype=ACTUATION, count=len(content) // ACTUATION.itemsize)
