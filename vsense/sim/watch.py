"""The side that watches simulations: it names who crashed, and who never came back."""

from __future__ import annotations

import json
import os
import selectors
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any

from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.lab.processes import describe_exit
from vsense.lab.shared import SharedBlock
from vsense.robot.inprocess import PROGRESS_BYTES, SimError
from vsense.sim.job import Job
from vsense.sim.simulation import WARM_UP

POLL_S = 0.1
"""So often the watch looks at what goes on. It counts its looks, not time: a machine that slept, or
a process that was stopped, is no loop without an end."""

LIMIT_S = 10.0
"""A controller that has not returned for so long never will."""


class Interrupted(Exception):
    """Nobody wants the runs any more."""


class SimulatedRunError(VsenseError):
    """What a run's own process could not do, in its words."""

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(text)
        self.exit_code = exit_code


@dataclass(frozen=True, slots=True)
class Task:
    """A job, and what is needed to say who did what in it.

    Attributes:
        job: the run.
        experiment: what it runs.
        label: which run of many it is; "" where there is only one.
    """

    job: Job
    experiment: Experiment
    label: str = ""

    def named(self, words: str) -> str:
        """Says which run some words are about."""
        return f"{self.label}: {words}" if self.label else words


class WorkerProcess:
    """A worker process, and what it is at.

    Attributes:
        task: what it does now, or None.
        answers: where its answers come.
    """

    def __init__(self) -> None:
        """Starts the process. It is in a session of its own: Ctrl-C is for this side to handle."""
        self.task: Task | None = None
        self._looks = 0
        self._last: tuple[int, int] | None = None
        self._block = SharedBlock.anonymous("vsense-sim", PROGRESS_BYTES)
        descriptor = os.open(self._block.name, os.O_RDWR)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "vsense.sim.worker", str(descriptor)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=[descriptor],
                # A run keeps one processor busy; threads of libraries only get in each other's way.
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                start_new_session=True,
            )
        finally:
            os.close(descriptor)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._jobs, self.answers = self._process.stdin, self._process.stdout

    def start(self, task: Task) -> None:
        """Has it do a run; it has nothing else to do."""
        self.task, self._looks, self._last = task, 0, None
        self._block.bytes[:] = 0
        # A process that is gone is found where its answer is missing.
        with suppress(BrokenPipeError):
            self._jobs.write(task.job.to_line())
            self._jobs.flush()

    def receive(self) -> dict[str, Any]:
        """Takes the answer, which is there: what `vsense.sim.worker.simulate` gave.

        Raises:
            VsenseError: what went wrong, and where.
        """
        line = self.answers.readline()
        if self.task is None or not line:
            raise SimError(f"the process that simulates {describe_exit(self._process.wait())}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise SimulatedRunError(self.task.named(answer["error"]), answer["exit_code"])
        if "status" in answer:
            how = describe_exit(os.waitstatus_to_exitcode(answer["status"]))
            raise SimError(f"{self._who(self.task)} {how}")
        result: dict[str, Any] = answer["result"]
        self.task = None
        return result

    def check(self, limit_s: float) -> None:
        """Sees whether its run goes on, if it has one; to be called every `POLL_S`.

        Raises:
            SimError: a controller has not returned for `limit_s`.
        """
        if self.task is None:
            return
        now = self._progress()
        self._looks = self._looks + 1 if now == self._last and now[1] else 0
        self._last = now
        if self._looks * POLL_S >= limit_s:
            raise SimError(f"{self._who(self.task)} did not return within {limit_s:g} s")

    @property
    def timesteps(self) -> int:
        """How many timesteps of its run are over."""
        return max(self._progress()[0] - WARM_UP, 0)

    def close(self) -> None:
        """Ends the process, whatever it is at."""
        with suppress(BrokenPipeError):
            self._jobs.close()
        self._process.wait()
        self.answers.close()
        self._block.close()

    def _progress(self) -> tuple[int, int]:
        """The newest timestep, and 1 + the robot that is in its control step."""
        timestep, robot = struct.unpack("=II", self._block.bytes.tobytes())
        return timestep, robot

    def _who(self, task: Task) -> str:
        """Names what is going on: the controller that is running, and when."""
        experiment = task.experiment
        timestep, robot = self._progress()
        if timestep < WARM_UP:
            when = "before the first timestep"
        else:
            time_s = (timestep - WARM_UP) * experiment.timestep_s
            when = f"in timestep {timestep - WARM_UP} (t = {time_s:g} s)"
        if not robot:
            return task.named(f"outside of any controller, {when}, the simulation")
        spec = experiment.robots[robot - 1]
        controller = experiment.controller.library
        return task.named(
            f"robot {spec.id} (tag {spec.tag}), {when}: its controller '{controller}'"
        )


def simulate_all(
    tasks: Iterable[Task],
    processes: int,
    interrupted: threading.Event,
    show: Callable[[Sequence[WorkerProcess]], None],
    limit_s: float = LIMIT_S,
) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Does many runs, several at once.

    Args:
        tasks: the runs; the next one is taken when a process has nothing to do.
        processes: how many at once.
        interrupted: set by whoever wants the runs to end.
        show: called every `POLL_S` with the processes.
        limit_s: a controller must return within this time.

    Yields:
        Each task with its result, in the order in which they are done.

    Raises:
        Interrupted: `interrupted` was set.
        VsenseError: a run has failed; the others are given up.
    """
    waiting = iter(tasks)
    with ExitStack() as stack, selectors.DefaultSelector() as selector:
        workers = [_start(task, stack, selector) for task in islice(waiting, processes)]
        looked_s = time.monotonic()
        while any(worker.task for worker in workers):
            for key, _ in selector.select(POLL_S):
                yield from _exchange(key.data, waiting)
            if interrupted.is_set():
                raise Interrupted
            if time.monotonic() - looked_s >= POLL_S:
                looked_s = time.monotonic()
                for worker in workers:
                    worker.check(limit_s)
                show(workers)


def _start(task: Task, stack: ExitStack, selector: selectors.BaseSelector) -> WorkerProcess:
    """Starts a process with its first run."""
    worker = WorkerProcess()
    stack.callback(worker.close)
    selector.register(worker.answers, selectors.EVENT_READ, worker)
    worker.start(task)
    return worker


def _exchange(
    worker: WorkerProcess, waiting: Iterator[Task]
) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Takes a result and gives the next task."""
    done, result = worker.task, worker.receive()
    assert done is not None
    task = next(waiting, None)
    if task is not None:
        worker.start(task)
    yield done, result
