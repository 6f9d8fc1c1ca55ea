"""The programs of an experiment's robots, in this process: the robots of all controllers as one."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.readings import SwarmReadings
from vsense.config.specs import ControllerSpec, Experiment
from vsense.robots import build, inprocess
from vsense.robots.compiling import BuildError, native
from vsense.robots.inprocess import ControllerFailure, ProgramSetup, SimError
from vsense.robots.link.table import Table, ToldProgram
from vsense.robots.link.wire import ShownData, Wanted
from vsense.robots.program import Program, ProgramOpener, kind_of
from vsense.world.robot_models import EPUCK

RUN_PROGRESS_BYTES = inprocess.PROGRESS_BYTES + 4
"""Those of `Program`, and which of the experiment's controllers it is: a u32."""


LOOP_PROGRAM = "<loop_functions>"
"""What loop functions in C++ are called among `shared_objects`; no element has such an id."""


def shared_objects(experiment: Experiment) -> dict[str, Path]:
    """Gives the program of each controller, by its id, as a shared object; builds what is missing.

    Loop functions in C++ are among them. Where they use the only controller's class both are one.

    Raises:
        UsageError: there is no such controller.
        BuildError: no compiler, or a source that does not compile.
    """
    spec = experiment.loop_functions
    loop = None if spec is None else spec.program
    if loop is not None and are_together(experiment):
        (controller,) = experiment.controllers
        both = build.shared_with_loop_functions(controller.program, loop)
        return {LOOP_PROGRAM: both, controller.id: both}
    built = {} if loop is None else {LOOP_PROGRAM: build.loop_functions(loop)}
    return built | {c.id: kind_of(c.program).build(c.program) for c in experiment.controllers}


def are_together(experiment: Experiment) -> bool:
    """Whether loop functions ask for the objects of the only controller: a simulation has both in
    one shared object then."""
    spec, controllers = experiment.loop_functions, experiment.controllers
    if spec is None or spec.program is None or len(controllers) != 1:
        return False
    return build.are_together(controllers[0].program, spec.program)


_NAME = re.compile(r"\bvs_controller\s*=\s*\{[^\"{};]*\"([^\"]+)\"")
"""What a controller calls itself, in its source; see robot/controller.h."""


def told_programs(experiment: Experiment) -> dict[str, ToldProgram]:
    """Gives what a robot tells that runs a controller of the experiment, by the controller's id.

    A hash is not known without a compiler, and a name where the source does not show it.
    """
    return {controller.id: _told_program(controller) for controller in experiment.controllers}


def _told_program(controller: ControllerSpec) -> ToldProgram:
    program = build.on_robots(controller.program)
    texts = (path.read_text(errors="replace") for path in program.sources if os.path.isfile(path))
    names = [match[1] for match in map(_NAME.search, texts) if match]
    if program.is_argos or program.is_policy:
        names = [program.short_name]
    digest = ""
    with suppress(BuildError):
        digest = build.source_tree().daemon(program).controller_hash(native())
    return ToldProgram(names[0] if names else "", digest)


LOADING = 0x20000
"""What `RUN_PROGRESS_BYTES` note as the number of a controller is this and more while its shared
object is loaded: users' code runs then, too. `LOADING_LOOP`: that of loop functions."""
LOADING_LOOP = LOADING + 0xFFFF


@contextmanager
def loading(progress: Any, number: int) -> Iterator[None]:
    """Notes that the shared object of a controller is loaded, as if a robot were in its step."""
    words = memoryview(progress).cast("B").cast("I")
    before = words[2]
    words[1], words[2] = 1, LOADING + number
    yield
    words[1], words[2] = 0, before


def failed_words(failures: Mapping[int, str], kind: str = "") -> list[str]:
    """What `Program.failures` gives, in words; `kind` says which robots these are."""
    return [f"{kind}robot {tag}'s controller ({why})" for tag, why in failures.items()]


class Programs:
    """Robots of an experiment, each with the program of its own controller; see `Program`.

    Attributes:
        wheels_steps_s, leds: as those of `Program`, in the order of the tags.
    """

    def __init__(
        self,
        experiment: Experiment,
        controllers: Mapping[int, str],
        libraries: Mapping[str, Path],
        tables: Mapping[str, Table],
        seed: int,
        progress: Any = None,
        openers: Mapping[str, ProgramOpener] | None = None,
    ) -> None:
        """Loads the programs and greets every robot.

        Args:
            controllers: the id of its controller by the tag of each robot, at least one.
            libraries, tables: shared objects and sensor tables, by the controller's id.
            progress: `RUN_PROGRESS_BYTES` of writable memory, None: not wanted.
            openers: of what controls robots in place of their programs, by the controller's id.

        Raises:
            SimError: a shared object cannot be loaded, or its controller cannot be run.
            WireError: the experiment does not fit the robots' protocol.
        """
        note = memoryview(bytearray(RUN_PROGRESS_BYTES) if progress is None else progress).cast("B")
        own, self._present = note[: inprocess.PROGRESS_BYTES], note[-4:].cast("I")
        drivers, step_ns = np.array(list(controllers.values())), experiment.timestep_ns
        self._experiment, count = experiment, len(drivers)
        self.wheels_steps_s, self.leds = np.zeros((count, 2), np.int16), np.zeros(count, np.uint16)
        self._names = names = {robot.tag: robot.id for robot in experiment.robots}
        names.update((robot.tag, robot.id) for robot in experiment.virtual_robots)
        self._parts: list[tuple[int, NDArray[np.intp], Program]] = []
        for number, spec in enumerate(experiment.controllers):
            rows = np.flatnonzero(drivers == spec.id)
            if len(rows):
                self._present[0] = number
                tags = [tag for tag, name in controllers.items() if name == spec.id]
                params = {tag: spec.params_for(names[tag]) for tag in tags}
                opened = (openers or {}).get(spec.id) or kind_of(spec.program).open
                given = libraries[spec.id], tags, tables[spec.id], step_ns, seed, params, own
                with loading(note, number):
                    self._parts.append((number, rows, self._embodied(opened(ProgramSetup(*given)))))

    def _embodied(self, program: Program) -> Program:
        """A program that knows what its robots are, all of one model."""
        model = self._experiment.models.get(program.tags[0], EPUCK)
        if model != EPUCK:
            program.embody(model)
        return program

    def begin(self) -> None:
        """Every controller begins now; see `Program.begin`.

        Raises:
            SimError: a controller cannot, as `step`.
        """
        self._each(lambda robots: robots.begin())

    def step(
        self,
        wanted: Wanted,
        from_timestep: int,
        timestep: int,
        times_ns: tuple[int, int],
        readings: SwarmReadings,
        prox_raw: NDArray[np.int16],
    ) -> None:
        """One control step of every robot; see `Program.step`.

        Raises:
            SimError: a controller cannot go on; the message holds file, line and element.
        """
        for number, rows, robots in self._parts:
            self._present[0] = number
            own = readings.parts[self._experiment.controllers[number].id]
            try:
                robots.step(wanted, from_timestep, timestep, times_ns, own, prox_raw[rows])
            except ControllerFailure as failure:
                raise self._placed(number, failure) from None
            self.wheels_steps_s[rows], self.leds[rows] = robots.wheels_steps_s, robots.leds

    def parts(self) -> list[tuple[int, NDArray[np.intp], Program]]:
        """Each controller's number in the experiment, rows of its robots, and the robots."""
        return self._parts

    def by_controller(self) -> list[tuple[str, Program]]:
        """The robots of each controller, by its id."""
        return [(self._experiment.controllers[number].id, part) for number, _, part in self._parts]

    @property
    def present(self) -> memoryview:
        """Where the number of the controller that runs is noted, a u32."""
        return self._present

    def check(self) -> None:
        """Raises SimError where a controller cannot go on, as `step`."""
        for number, _, robots in self._parts:
            try:
                robots.check()
            except ControllerFailure as failure:
                raise self._placed(number, failure) from None

    def reports(self) -> dict[int, bytes]:
        """See `Program.reports`."""
        return {tag: block for *_, robots in self._parts for tag, block in robots.reports().items()}

    def shown(self) -> list[tuple[int, ShownData]]:
        """See `Program.shown`."""
        return [entry for *_, robots in self._parts for entry in robots.shown()]

    def logged(self) -> Sequence[tuple[int, str]]:
        """See `Program.logged`."""
        return [entry for *_, robots in self._parts for entry in robots.logged()]

    def failures(self) -> dict[int, str]:
        """See `Program.failures`."""
        return {tag: why for *_, robots in self._parts for tag, why in robots.failures().items()}

    def end(self) -> None:
        """See `Program.end`."""
        self._each(lambda robots: robots.end())

    def _each(self, act: Callable[[Program], None]) -> None:
        """Has the robots of each controller do something; raises as `step`."""
        for number, _, robots in self._parts:
            self._present[0] = number
            try:
                act(robots)
            except ControllerFailure as failure:
                raise self._placed(number, failure) from None

    def _placed(self, number: int, failure: ControllerFailure) -> SimError:
        """Names the controller's element and the robot."""
        spec, name = self._experiment.controllers[number], self._names[failure.tag]
        place = f"{self._experiment.file}:{spec.line}: <{spec.label}>"
        return SimError(f"{place} cannot go on, robot '{name}': {failure.words}")

    def complaints(self) -> list[str]:
        """See `Program.complaints`."""
        return [words for *_, robots in self._parts for words in robots.complaints()]
