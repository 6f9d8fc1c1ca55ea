"""Starts and watches the processes that simulate, on this machine."""

from __future__ import annotations

import json
import os
import selectors
import struct
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from itertools import islice
from typing import Any, Generic, Protocol, TypeVar

from vsense.base.errors import Interrupted
from vsense.base.processes import begin_worker
from vsense.base.shared import SharedBlock
from vsense.base.users_code import UsersCode
from vsense.modes.sim._simulation import WARM_UP_TIMESTEPS
from vsense.modes.sim.outcome import JobAnswer, Task
from vsense.run.programs import RUN_PROGRESS_BYTES

CHECK_PERIOD_S = 0.1
"""Period of the checks. Checks are counted, not time: a machine that slept, or a process that was
stopped, is no endless loop."""

HANG_MAX_S = 10.0
"""A controller that has not returned for so long hangs."""

Named = TypeVar("Named")
"""What a caller knows a job by."""


class WorkerProcess(Generic[Named]):
    """A worker process, its present task, and the pipe of its answers.

    `page` is the descriptor of a socket to whoever watches its runs, None: nobody does.

    Attributes:
        task: what was given with the present job; None: there is none.
        answers: can be read when an answer has come, or the process has ended.
    """

    def __init__(self, page: int | None = None) -> None:
        self.task: Named | None = None
        self._looks = 0
        self._last: tuple[int, int, int] | None = None
        self._block = SharedBlock.anonymous("vsense-sim", RUN_PROGRESS_BYTES)
        descriptor = os.open(self._block.name, os.O_RDWR)
        shared = [descriptor] if page is None else [descriptor, page]
        try:
            self._process, self._jobs, self.answers = begin_worker(
                "vsense.modes.sim._worker", shared, fresh=UsersCode.ran
            )
        finally:
            os.close(descriptor)

    def start(self, task: Named, line: bytes) -> None:
        """Starts a run, a job of one line; there is no other."""
        self.task, self._looks, self._last = task, 0, None
        self._block.bytes[:] = 0
        # `receive` reports a process that has ended.
        with suppress(BrokenPipeError):
            self._jobs.write(line)
            self._jobs.flush()

    def receive(self) -> JobAnswer:
        """Takes the answer, which has come."""
        line = self.answers.readline()
        if not line:
            return self._answer(ended=self._process.wait())
        answer = self._answer(**json.loads(line))
        self.task = None
        return answer

    def check(self, limit_s: float) -> JobAnswer | None:
        """Answers for a controller that hangs for `limit_s`; is called every `CHECK_PERIOD_S`."""
        if self.task is None:
            return None
        now = self._progress()
        self._looks = self._looks + 1 if now == self._last and now[1] else 0
        self._last = now
        return self._answer(hung_s=limit_s) if self._looks * CHECK_PERIOD_S >= limit_s else None

    @property
    def timesteps(self) -> int:
        """Timesteps of its run that are over."""
        return max(self._progress()[0] - WARM_UP_TIMESTEPS, 0)

    @property
    def is_free(self) -> bool:
        """Whether it runs, and has no job."""
        return self.task is None and self._process.poll() is None

    def close(self) -> None:
        """Ends the process and its run."""
        with suppress(BrokenPipeError):
            self._jobs.close()
        self._process.wait()
        self.answers.close()
        self._block.close()

    def _answer(self, **members: Any) -> JobAnswer:
        return {**members, "progress": self._progress()}

    def _progress(self) -> tuple[int, int, int]:
        """What `Programs` noted last; see `Task`."""
        timestep, robot, controller = struct.unpack("=III", self._block.bytes.tobytes())
        return timestep, robot, controller


Show = Callable[[Sequence[WorkerProcess[Task]]], None]


class Flag(Protocol):
    """What ends runs, such as a `threading.Event`."""

    def is_set(self) -> bool:
        """Whether they shall end."""
        ...


def simulate_all(
    tasks: Iterable[Task],
    processes: int,
    interrupted: Flag,
    show: Show,
    limit_s: float = HANG_MAX_S,
) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Does runs in several processes; yields each task with its result as soon as it is done.

    Args:
        show: called every `CHECK_PERIOD_S` with the processes.
        limit_s: a controller must return within this time.

    Raises:
        Interrupted: `interrupted` was set.
        VsenseError: a run has failed; the others are ended.
    """
    jobs = [(task, task.job.to_line()) for task in tasks]
    with ExitStack() as stack:
        workers = []
        for _ in range(min(processes, len(jobs))):
            workers.append(WorkerProcess[Task]())
            stack.callback(workers[-1].close)
        for task, answer in watch(jobs, workers, interrupted, show, limit_s):
            yield task, task.result(answer)


def watch(
    jobs: Iterable[tuple[Named, bytes]],
    workers: Sequence[WorkerProcess[Named]],
    interrupted: Flag,
    show: Callable[[Sequence[WorkerProcess[Named]]], None],
    limit_s: float = HANG_MAX_S,
) -> Iterator[tuple[Named, JobAnswer]]:
    """Has processes do jobs; yields each with its answer, the last one where a process is lost.

    Args:
        jobs: with what the caller knows each by.
        workers: free ones.
        interrupted, show, limit_s: see `simulate_all`.

    Raises:
        Interrupted: `interrupted` was set.
    """
    waiting = iter(jobs)
    with selectors.DefaultSelector() as selector:
        for worker, job in zip(workers, islice(waiting, len(workers))):
            selector.register(worker.answers, selectors.EVENT_READ, worker)
            worker.start(*job)
        due_s = time.monotonic() + CHECK_PERIOD_S
        while any(worker.task is not None for worker in workers):
            for key, _ in selector.select(max(due_s - time.monotonic(), 0.0)):
                task, answer = _exchange(key.data, waiting)
                yield task, answer
                if "ended" in answer:
                    return
            if interrupted.is_set():
                raise Interrupted
            if time.monotonic() >= due_s:
                due_s = max(due_s + CHECK_PERIOD_S, time.monotonic())
                for worker in workers:
                    if (hung := worker.check(limit_s)) is not None:
                        assert worker.task is not None
                        yield worker.task, hung
                        return
                show(workers)


def _exchange(
    worker: WorkerProcess[Named], waiting: Iterator[tuple[Named, bytes]]
) -> tuple[Named, JobAnswer]:
    """Takes an answer and gives the next job."""
    done, answer = worker.task, worker.receive()
    assert done is not None
    if worker.task is None and (job := next(waiting, None)) is not None:
        worker.start(*job)
    return done, answer
