"""The robots of a simulation: the real controller in the daemon's own runtime, in this process.

The shared object holds `robot/inprocess.c`, the controller runtime of a daemon's worker, and one
controller (`vsense.robots.build.shared`). Its structures are part of `vsense._native`; the types of
its functions are cut out of the header beside its sources, which takes no parser of C.
"""

from __future__ import annotations

import ctypes
import mmap
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import VsenseError
from vsense.base.native import check, ffi, lib
from vsense.base.readings import SensorReadings
from vsense.robots import build
from vsense.robots.link.status import LogLines
from vsense.robots.link.table import Direction, Table, robot_seed
from vsense.robots.link.wire import Header, PacketType, ShownData, Wanted, Welcome, encode, shown_of
from vsense.world.robot_models import RobotModel

PROGRESS_BYTES = 8
"""`struct vs_inprocess_progress`: timestep and robot, two u32."""

CONTROL_NS = 30_000_000
"""From the capture to the controller of a robot that runs in this process, as long as it takes a
real one: 10 ms readout, and 20 ms from the picture (`latency_ms.capture_to_control` of
`vsense lab pollutant`)."""
ACT_NS = 31_000_000
"""From the capture to its wheels."""

AMBIENT_RAW = 3000
"""What every light sensor measures in an evenly lit room, higher is darker."""
LIGHT_RAW: int = lib.EPUCK_ARGOS_RAW_MAX - AMBIENT_RAW
"""The same as the controller is given it, higher is brighter."""


class SimError(VsenseError):
    """A simulation cannot go on; the message says why."""


class ControllerFailure(SimError):
    """The controller of robot `tag` cannot go on, and `words` say why."""

    def __init__(self, tag: int, controller: str, words: str) -> None:
        super().__init__(f"robot {tag}: controller '{controller}' cannot go on: {words}")
        self.tag = tag
        self.words = words


_PROTOTYPE = re.compile(r"^(\w[\w ]*\**)(vs_([a-z]+)_\w+)(\([^;]*\));", re.MULTILINE)


@cache
def declarations(part: str = "inprocess") -> Mapping[str, Any]:
    """Gives the types of the functions of a header in `robot/` that bear its name, by theirs.

    Raises:
        BuildError: the C sources are not there.
    """
    header = (build.source_tree().root / "robot" / f"{part}.h").read_text()
    return {
        name: ffi.typeof(f"{result}(*){arguments}")
        for result, name, owner, arguments in _PROTOTYPE.findall(header)
        if owner == part
    }


def functions(library: Path, part: str = "inprocess") -> Any:
    """The `declarations` of a shared object, which stays loaded; OSError: it cannot be."""
    loaded, kinds = ctypes.CDLL(str(library)), declarations(part)
    places = {n: ctypes.cast(loaded[n], ctypes.c_void_p).value for n in kinds}
    return SimpleNamespace(**{n: ffi.cast(kind, places[n]) for n, kind in kinds.items()})


def _address(pointer: Any) -> int:
    return int(ffi.cast("uintptr_t", pointer))


class ProgramKernel(NamedTuple):
    """`struct vs_sim_program` without the robots' rows: addresses, and arrays of a program."""

    step: int
    all: int
    now: int
    timestep: int
    capture_ns: int
    now_ns: int
    logged: int
    failed: int
    prox: NDArray[np.int16]
    wheels: NDArray[np.int16]
    leds: NDArray[np.uint16]
    shown: NDArray[np.uint8]
    shown_before: NDArray[np.uint8]
    reports: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class ProgramSetup:
    """What a program is opened with: the robots of one controller, and their run.

    Attributes:
        library: what its kind has built.
        tags: the robots.
        table: what they sense and do virtually.
        timestep_ns: length of a timestep.
        seed: of the run; every robot's controller gets one of its own made from it.
        params: the controller's settings, lines "key=value\\n"; by tag, or those of all.
        progress: `PROGRESS_BYTES` of writable memory where the robots note what they do.
    """

    library: Path
    tags: Sequence[int]
    table: Table
    timestep_ns: int
    seed: int
    params: str | Mapping[int, str]
    progress: Any = field(default_factory=lambda: bytearray(PROGRESS_BYTES))


class CompiledProgram:
    """All robots of a run, each with a controller runtime of its own.

    Attributes:
        tags: the robots, n of them.
        wheels_steps_s: (n, 2) int16, left and right, as commanded in the newest step, after
            safety.
        leds: (n,) uint16, bits 0-7 ring, 8 body, 9 front.
    """

    _shown_last: bytes

    def __init__(self, setup: ProgramSetup) -> None:
        """Loads the controller and greets every robot.

        Raises:
            SimError: the shared object cannot be loaded, or its controller cannot be run.
            WireError: the experiment does not fit the robots' protocol.
        """
        self.tags, table, params = list(setup.tags), setup.table, setup.params
        try:
            self._lib = functions(setup.library)
        except OSError as error:
            raise SimError(f"{setup.library}: cannot be loaded: {error}") from None
        self._begin(setup.progress)
        for robot, tag in enumerate(self.tags):
            text = params if isinstance(params, str) else params[tag]
            welcome = Welcome(table, setup.timestep_ns // 1000, robot_seed(setup.seed, tag), text)
            packet = encode(Header(PacketType.WELCOME, table_hash=table.hash), welcome)
            # A virtual robot's tag is no marker's, and does not fit the wire's 16 bits.
            wire_tag = tag % 2**16
            code = self._lib.vs_inprocess_welcome(self._all, robot, wire_tag, packet, len(packet))
            check(code, f"robot {tag}")
        self._make_room(table)

    def _begin(self, progress: Any) -> None:
        count = len(self.tags)
        self._memory = mmap.mmap(-1, self._lib.vs_inprocess_size(count))
        self._progress = progress
        self._all = ffi.cast("struct vs_inprocess *", ffi.from_buffer(self._memory))
        note = ffi.cast("struct vs_inprocess_progress *", ffi.from_buffer(progress))
        if self._lib.vs_inprocess_init(self._all, count, note) < 0:
            raise SimError(
                f"controller '{self.controller}': expected a name of plain text of at most"
                f" {lib.VS_NAME_MAX} bytes and a smaller state; see robot/controller.h"
            )

    @property
    def controller(self) -> str:
        """The controller's name, as it calls itself."""
        name: bytes = ffi.string(self._lib.vs_inprocess_controller())
        return name.decode(errors="replace")

    def embody(self, model: RobotModel) -> None:
        """Its robots are of a model that is no e-puck."""
        lengths = round(1e9 * model.step_m), round(1e6 * model.axle_m)
        self._lib.vs_inprocess_embody(self._all, model.max_steps_s, *lengths)

    def begin(self) -> None:
        """Every controller begins its run now, and not with its first control step.

        Raises:
            ControllerFailure: a controller cannot.
        """
        self._lib.vs_inprocess_begin(self._all)
        self.check()

    def step(
        self,
        wanted: Wanted,
        from_timestep: int,
        timestep: int,
        times_ns: tuple[int, int],
        readings: SensorReadings,
        prox_raw: NDArray[np.int16],
    ) -> None:
        """One control step of every robot.

        Args:
            wanted: what the host wants of them.
            from_timestep: with RUN, the first timestep of the run.
            timestep: of the arena state, from 0, rising.
            times_ns: when the arena was seen, and when the controllers act on that.
            readings: what they sense, in the table's order.
            prox_raw: (n, 8) int16 of their own proximity sensors.

        Raises:
            ControllerFailure: a controller cannot go on.
        """
        self.sense(readings.of(self.tags))
        self._prox[:] = prox_raw
        now = self._now
        now.wanted, now.from_timestep, now.timestep = wanted, from_timestep, timestep
        now.capture_ns, now.now_ns = times_ns
        self.decide(wanted)
        check(self._lib.vs_inprocess_step(self._all, now), "robots whose run is over")
        self.check()

    def decide(self, wanted: Wanted) -> None:
        """What is decided in this process before the step: C decides in the step itself."""

    def home(self, timestep: int, times_ns: tuple[int, int], goals: NDArray[np.int16]) -> None:
        """One step of every robot's walk home, to goals (n, 3) as STATE has them; see `step`.

        Of an experiment without virtual sensors.
        """
        now = self._now
        self._goals = np.ascontiguousarray(goals)
        self._point("goals", self._goals)
        now.wanted, now.timestep = Wanted.HOME, timestep
        now.capture_ns, now.now_ns = times_ns
        check(self._lib.vs_inprocess_step(self._all, now), "robots whose run is over")

    def sense(self, readings: SensorReadings) -> None:
        """Sets what the robots sense: the arrays, in their order, as they are at each step."""
        self._readings = readings
        self._point("values", readings.block)
        self._point("captures_ns", readings.captures_ns)

    def kernel(self) -> ProgramKernel:
        """The robots as C steps them, with RUN in `from_timestep` as of the newest step."""
        now, address = self._now, _address
        return ProgramKernel(
            step=address(self._lib.vs_inprocess_step),
            all=address(self._all),
            now=address(now),
            timestep=address(ffi.addressof(now, "timestep")),
            capture_ns=address(ffi.addressof(now, "capture_ns")),
            now_ns=address(ffi.addressof(now, "now_ns")),
            logged=address(ffi.addressof(now, "logged")),
            failed=address(ffi.addressof(now, "failed")),
            prox=self._prox,
            wheels=self.wheels_steps_s,
            leds=self.leds,
            shown=self._shown,
            shown_before=self._shown_before,
            reports=self._reports,
        )

    def end(self) -> None:
        """The run is over: every controller ends what it began.

        Raises:
            ControllerFailure: a controller failed to.
        """
        self._lib.vs_inprocess_end(self._all)
        self.check()

    def check(self) -> None:
        """Raises ControllerFailure where a controller cannot go on."""
        robot = ffi.new("uint32_t *")
        words = self._lib.vs_inprocess_failure(self._all, robot)
        if words != ffi.NULL:
            said: bytes = ffi.string(words)
            text = said.decode(errors="replace")
            raise ControllerFailure(self.tags[robot[0]], self.controller, text)

    def reports(self) -> dict[int, bytes]:
        """What every robot's virtual actuators say: by tag the actuators' block; {}: none."""
        size = self._report_bytes
        if not size:
            return {}
        data = self._reports.tobytes()
        return {tag: data[i * size : (i + 1) * size] for i, tag in enumerate(self.tags)}

    def shown(self) -> list[tuple[int, ShownData]]:
        """All values that a controller shows, by tag, where one has changed since the last call."""
        now = self._shown.tobytes()
        if now == self._shown_last:
            return []
        self._shown_last = now
        changed = np.flatnonzero((self._shown != self._shown_before).any(axis=1))
        self._shown_before[changed] = self._shown[changed]
        return [
            (self.tags[i], shown_of(self._shown[i, 1 : 1 + self._shown[i, 0]].tobytes()))
            for i in changed
        ]

    def logged(self) -> list[tuple[int, str]]:
        """What controllers have logged since the last call: tag, and what to say."""
        if self._now.logged == 0:
            return []
        robot, number = ffi.new("uint32_t *"), ffi.new("uint32_t *")
        line = ffi.new("const char **")
        said = []
        while self._lib.vs_inprocess_log(self._all, robot, number, line):
            text = ffi.string(line[0]).decode()
            said += [(self.tags[robot[0]], row) for row in self._log[robot[0]].add(number[0], text)]
        self._now.logged = 0
        return said

    def failures(self) -> dict[int, str]:
        """By tag why a robot's controller has failed; of those in C none goes on then."""
        return {}

    def complaints(self) -> list[str]:
        """What the controllers asked for and did not get, or do not know: each complaint once."""
        said: bytes = ffi.string(self._lib.vs_inprocess_complaints(self._all))
        return said.decode(errors="replace").splitlines()

    def _make_room(self, table: Table) -> None:
        """Lays out what goes into a step and comes out of it."""
        count = len(self.tags)
        sizes = dict.fromkeys(Direction, 0)
        for entry, size in zip(table.entries, table.sizes):
            sizes[entry.direction] += size
        self._report_bytes = sizes[Direction.ACTUATOR]
        self._reports = np.zeros((count, self._report_bytes), dtype=np.uint8)
        self._prox = np.zeros((count, 8), dtype=np.int16)
        self._light = np.full((count, 8), LIGHT_RAW, dtype=np.int16)
        self.wheels_steps_s = np.zeros((count, 2), dtype=np.int16)
        self.leds = np.zeros(count, dtype=np.uint16)
        self._shown = np.zeros((count, 1 + lib.VS_SHOWN_MAX), dtype=np.uint8)
        self._shown_before = self._shown.copy()
        self._shown_last = self._shown.tobytes()
        self._log = [LogLines() for _ in self.tags]
        self._now = ffi.new("struct vs_inprocess_timestep *")
        for name in ("reports", "prox", "light", "shown"):
            self._point(name, getattr(self, f"_{name}"))
        self._point("wheels_steps_s", self.wheels_steps_s)
        self._point("leds", self.leds)

    def _point(self, field: str, array: NDArray[Any]) -> None:
        kind = f"{array.dtype.name}_t *"
        setattr(self._now, field, ffi.cast(kind, array.ctypes.data))
