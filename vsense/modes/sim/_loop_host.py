"""Loop functions in C++ in the process of a simulation, with the controllers that they use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.robots.link.table import Table
from vsense.robots.loop_library import FUNCTIONS, Colors, LoopCaller, LoopLibrary
from vsense.robots.program import ProgramOpener
from vsense.run.cxx_loop import LoopHost
from vsense.run.programs import LOADING, LOADING_LOOP, LOOP_PROGRAM, Programs, loading

LOOP_FUNCTION = 0x10000
"""What `Programs` notes as the number of its controller is this and more while loop functions in
C++ run: which of `FUNCTIONS`."""


class _Watched(LoopLibrary):
    """Loop functions in this process; which function runs stands in the memory of `Programs`."""

    first_number = LOOP_FUNCTION

    def __init__(self, library: Path, progress: Any, timestep: Callable[[], int]) -> None:
        with loading(progress, LOADING_LOOP - LOADING):
            super().__init__(library)
        self.note = memoryview(progress).cast("B").cast("I")
        self._timestep = timestep

    def call(
        self, function: str, lines: Sequence[str], numbers: NDArray[np.float64]
    ) -> tuple[str, Colors]:
        note, before = self.note, self.note[2]
        note[0], note[2] = self._timestep(), LOOP_FUNCTION + FUNCTIONS.index(function)
        # As if a robot were in its control step: so an endless loop is noticed.
        note[1] = 1
        answer = super().call(function, lines, numbers)
        note[1], note[2] = 0, before
        return answer


@dataclass(slots=True)
class LoopFunctionsHost:
    """Where loop functions in C++ run: here, and what they move is moved.

    Attributes:
        libraries, seed, progress: see `Simulation`.
        timestep: says which one is under way.
        robots: those whose controllers have begun before the loop functions, which use their
            objects; None: none have.
        openers: see `Programs`.
    """

    experiment: Experiment
    libraries: Mapping[str, Path]
    seed: int
    progress: Any
    timestep: Callable[[], int]
    robots: Programs | None = None
    openers: Mapping[str, ProgramOpener] | None = None

    def loop_host(self) -> LoopHost:
        """The same as an `Environment` takes it."""

        def called(path: Path) -> LoopCaller:
            return _Watched(path, self.progress, self.timestep)

        library = self.libraries.get(LOOP_PROGRAM)
        if library is None:
            return LoopHost(called, moves=True)
        host = LoopHost(called, True, lambda program: library)
        is_joined = any(library == self.libraries[c.id] for c in self.experiment.controllers)
        return replace(host, begin=self._begin) if is_joined else host

    def opened(self, tables: Mapping[str, Table]) -> Programs:
        """Opens the programs of all robots."""
        experiment = self.experiment
        controllers = {robot.tag: robot.controller for robot in experiment.robots}
        return Programs(
            experiment,
            controllers,
            self.libraries,
            tables,
            self.seed,
            self.progress,
            self.openers,
        )

    def _begin(self, tables: Mapping[str, Table]) -> None:
        self.robots = self.opened(tables)
        self.robots.begin()
