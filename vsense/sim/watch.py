"""Starts and watches the processes that simulate; names the controller that crashed or hangs."""

from __future__ import annotations

import json
import os
import selectors
import struct
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any

from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.lab.processes import describe_exit, start_module
from vsense.lab.shared import SharedBlock
from vsense.robot.inprocess import SimError
from vsense.robot.loop_library import FUNCTIONS
from vsense.run.programs import PROGRESS_BYTES
from vsense.sim.job import Job
from vsense.sim.simulation import LOOP_FUNCTION, WARM_UP

POLL_S = 0.1
"""Period of the checks. Checks are counted, not time: a machine that slept, or a process that was
stopped, is no endless loop."""

LIMIT_S = 10.0
"""A controller that has not returned for so long hangs."""


class Interrupted(Exception):
    """The user has ended the runs."""


class SimulatedRunError(VsenseError):
    """An error in a run's own process, with its message."""

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(text)
        self.exit_code = exit_code


@dataclass(frozen=True, slots=True)
class Task:
    """A job with what errors name; `label`: which run of many, "" where there is only one."""

    job: Job
    experiment: Experiment
    label: str = ""

    def named(self, words: str) -> str:
        """Puts the label before some words."""
        return f"{self.label}: {words}" if self.label else words


class WorkerProcess:
    """A worker process, its present task, and the pipe of its answers."""

    def __init__(self) -> None:
        self.task: Task | None = None
        self._looks = 0
        self._last: tuple[int, int, int] | None = None
        self._block = SharedBlock.anonymous("vsense-sim", PROGRESS_BYTES)
        descriptor = os.open(self._block.name, os.O_RDWR)
        try:
            self._process, self._jobs, self.answers = start_module(
                "vsense.sim.worker",
                str(descriptor),
                pass_fds=[descriptor],
                # A run keeps one processor busy; threads of libraries only get in each other's way.
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            )
        finally:
            os.close(descriptor)

    def start(self, task: Task) -> None:
        """Starts a run; there is no other."""
        self.task, self._looks, self._last = task, 0, None
        self._block.bytes[:] = 0
        # `receive` reports a process that has ended.
        with suppress(BrokenPipeError):
            self._jobs.write(task.job.to_line())
            self._jobs.flush()

    def receive(self) -> dict[str, Any]:
        """Takes the answer, which has come: that of `vsense.sim.worker.simulate`.

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
        """Raises SimError for a controller that hangs for `limit_s`; is called every `POLL_S`."""
        if self.task is None:
            return
        now = self._progress()
        self._looks = self._looks + 1 if now == self._last and now[1] else 0
        self._last = now
        if self._looks * POLL_S >= limit_s:
            raise SimError(f"{self._who(self.task)} did not return within {limit_s:g} s")

    @property
    def timesteps(self) -> int:
        """Timesteps of its run that are over."""
        return max(self._progress()[0] - WARM_UP, 0)

    def close(self) -> None:
        """Ends the process and its run."""
        with suppress(BrokenPipeError):
            self._jobs.close()
        self._process.wait()
        self.answers.close()
        self._block.close()

    def _progress(self) -> tuple[int, int, int]:
        """The newest timestep, 1 + the robot that is in its control step, and the controller.

        The robot is a number among those of that controller.
        """
        timestep, robot, controller = struct.unpack("=III", self._block.bytes.tobytes())
        return timestep, robot, controller

    def _who(self, task: Task) -> str:
        """Names the controller that is running, and the timestep."""
        experiment = task.experiment
        timestep, robot, number = self._progress()
        if timestep < WARM_UP:
            when = "before the first timestep"
        else:
            time_s = (timestep - WARM_UP) * experiment.timestep_s
            when = f"in timestep {timestep - WARM_UP} (t = {time_s:g} s)"
        if not robot:
            return task.named(f"outside of any controller, {when}, the simulation")
        if number >= LOOP_FUNCTION:
            function, loop = FUNCTIONS[number - LOOP_FUNCTION], experiment.loop_functions
            assert loop is not None
            return task.named(f"{when}: loop functions '{loop.label}' ({loop.path}): {function}")
        controller = experiment.controllers[number]
        spec = [r for r in experiment.robots if r.controller == controller.id][robot - 1]
        return task.named(
            f"robot {spec.id} (tag {spec.tag}), {when}: its controller '{controller.library}'"
        )


def simulate_all(
    tasks: Iterable[Task],
    processes: int,
    interrupted: threading.Event,
    show: Callable[[Sequence[WorkerProcess]], None],
    limit_s: float = LIMIT_S,
) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Does runs in several processes; yields each task with its result as soon as it is done.

    Args:
        show: called every `POLL_S` with the processes.
        limit_s: a controller must return within this time.

    Raises:
        Interrupted: `interrupted` was set.
        VsenseError: a run has failed; the others are ended.
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
