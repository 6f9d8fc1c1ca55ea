"""What the lab's processes have logged of one run: truth, actuations, control steps.

All runs of a lab are in the same files, which other processes write while the run is reported: only
what came since the run began is read.
"""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.base.interruption import left_s
from vsense.base.shared import LabError
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.modes.lab._swarm import LabRobot, last_traced, read_trace
from vsense.modes.lab.truth import read_truth, truth_at

_WAIT_S, _POLL_S = 1.0, 0.02
"""The last records may come so much later than the robots stand: a disk may be slow."""

_BEFORE_BYTES = 256 << 10
"""So much of each file from before a run is read, too: its first timesteps are of pictures that
were taken before it began, which may be long ago where the tracker is slow."""


class RunLogs:
    """The logs of a run that begins now.

    Attributes:
        truth: of the run's timesteps, up to the first that the log lacks; None before `end`, and
            where it has nothing of the run.
    """

    def __init__(self, truth: Path, actuations: Path, robots: Sequence[LabRobot]) -> None:
        """Notes how long the files are; that of a robot may not be there yet."""
        self.truth: NDArray[np.void] | None = None
        self._truth, self._actuations = truth, actuations
        logs = (truth, actuations, *(robot.trace for robot in robots))
        sizes = {path: os.path.getsize(path) for path in logs if os.path.isfile(path)}
        self._offsets = {path: max(size - _BEFORE_BYTES, 0) for path, size in sizes.items()}

    def end(
        self, timesteps: NDArray[np.int64], driving: Collection[LabRobot], late: int
    ) -> list[str]:
        """Takes what there is of these timesteps; gives what the logs lack of them, in words.

        `driving` have made control steps to the end, of which the last may be `late` timesteps old.
        """
        if not len(timesteps):
            return []
        try:
            truth = truth_at(self._read_truth(int(timesteps[-1])), timesteps)
            words, lacking = [], len(timesteps) - len(truth)
            if lacking:
                words.append(f"{lacking} timesteps of {self._truth.name}")
            self.truth = truth if len(truth) else None
            for robot in driving:
                if last_traced(robot) < timesteps[-1] - late:
                    words.append(f"the last steps of {robot.trace.name}")
        except LabError as error:
            return [f"what cannot be read ({error})"]
        return words

    def _read_truth(self, last: int) -> NDArray[np.void]:
        # After SIGTERM most of the time is the figures'.
        until_s = time.monotonic() + min(_WAIT_S, left_s() / 4.0)
        while True:
            truth = read_truth(self._truth, self._offsets.get(self._truth, 0))
            if (len(truth) and truth["timestep"][-1] >= last) or time.monotonic() > until_s:
                return truth
            time.sleep(_POLL_S)

    def known_truth(self) -> NDArray[np.void]:
        """`truth`; LabError where there is none."""
        if self.truth is None:
            raise LabError(f"truth log {self._truth}: it lacks the run from its first timestep")
        return self.truth

    def actuations(self) -> NDArray[np.void]:
        """As `read_actuations`."""
        return read_actuations(self._actuations, self._offsets.get(self._actuations, 0))

    def trace(
        self, robot: LabRobot, sensors: Sequence[str], judged: str | None
    ) -> NDArray[np.void]:
        """As `read_trace`."""
        return read_trace(robot, sensors, judged, self._offsets.get(robot.trace, 0))
