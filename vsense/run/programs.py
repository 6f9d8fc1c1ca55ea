"""The programs of an experiment's robots, in this process: the robots of all controllers as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.link.robots.table import Table
from vsense.link.robots.wire import Shown, Values, Wanted
from vsense.robot import build, inprocess
from vsense.robot.inprocess import Robots

PROGRESS_BYTES = inprocess.PROGRESS_BYTES + 4
"""Those of `Robots`, and which of the experiment's controllers it is: a u32."""


def shared_objects(experiment: Experiment) -> dict[str, Path]:
    """Gives the program of each controller, by its id, as a shared object; builds what is missing.

    Raises:
        UsageError: there is no such controller.
        BuildError: no compiler, or a source that does not compile.
    """
    folder = experiment.path.parent
    return {c.id: build.shared(c.library, folder) for c in experiment.controllers}


class Programs:
    """Robots of an experiment, each with the program of its own controller; see `Robots`.

    Attributes:
        wheels_steps_s, leds: as those of `Robots`, in the order of the tags.
    """

    def __init__(
        self,
        experiment: Experiment,
        controllers: Mapping[int, str],
        libraries: Mapping[str, Path],
        tables: Mapping[str, Table],
        seed: int,
        progress: Any = None,
    ) -> None:
        """Loads the programs and greets every robot.

        Args:
            controllers: the id of its controller by the tag of each robot, at least one.
            libraries: shared objects by the controller's id.
            tables: sensor tables by the controller's id.
            seed: of the run.
            progress: `PROGRESS_BYTES` of writable memory, None: not wanted.

        Raises:
            SimError: a shared object cannot be loaded, or its controller cannot be run.
            WireError: the experiment does not fit the robots' protocol.
        """
        note = memoryview(bytearray(PROGRESS_BYTES) if progress is None else progress).cast("B")
        own, self._present = note[: inprocess.PROGRESS_BYTES], note[-4:].cast("I")
        drivers = np.array(list(controllers.values()))
        self.wheels_steps_s = np.zeros((len(drivers), 2), dtype=np.int16)
        self.leds = np.zeros(len(drivers), dtype=np.uint16)
        self._parts: list[tuple[int, NDArray[np.intp], Robots]] = []
        for number, spec in enumerate(experiment.controllers):
            rows = np.flatnonzero(drivers == spec.id)
            if len(rows):
                self._present[0] = number
                tags = [tag for tag, name in controllers.items() if name == spec.id]
                which = libraries[spec.id], tags, tables[spec.id], experiment.timestep_ns
                robots = Robots(*which, seed, spec.params_text, own)
                self._parts.append((number, rows, robots))

    def step(
        self,
        wanted: Wanted,
        from_timestep: int,
        timestep: int,
        times_ns: tuple[int, int],
        readings: Mapping[int, Values],
        prox_raw: NDArray[np.int16],
    ) -> None:
        """One control step of every robot; see `Robots.step`."""
        for number, rows, robots in self._parts:
            self._present[0] = number
            robots.step(wanted, from_timestep, timestep, times_ns, readings, prox_raw[rows])
            self.wheels_steps_s[rows], self.leds[rows] = robots.wheels_steps_s, robots.leds

    def reports(self) -> dict[int, bytes]:
        """See `Robots.reports`."""
        return {tag: block for *_, robots in self._parts for tag, block in robots.reports().items()}

    def shown(self) -> list[tuple[int, Shown]]:
        """See `Robots.shown`."""
        return [some for *_, robots in self._parts for some in robots.shown()]

    def logged(self) -> Sequence[tuple[int, str]]:
        """See `Robots.logged`."""
        return [some for *_, robots in self._parts for some in robots.logged()]

    def complaints(self) -> list[str]:
        """See `Robots.complaints`."""
        return [words for *_, robots in self._parts for words in robots.complaints()]
