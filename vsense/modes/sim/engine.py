"""Runs on other machines: by any engine that has the interface of `concurrent.futures.Executor`.

The engine schedules, retries and moves data. Here jobs are handed to it and its answers taken back
(`Engine`), and here is what its workers do with a job (`do`): each looks whether it can, and has a
process do it. The process is `vsense.modes.sim._worker`, as on the user's own machine: users' code
never runs in the worker itself, and what crashes or hangs is told by numbers. A process starts in
most of a second; so one that has done its job waits a moment for the next.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol

from vsense.base.errors import Interrupted, VsenseError, require
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.config.specs import Experiment
from vsense.modes.sim import fingerprint
from vsense.modes.sim.fingerprint import Machine
from vsense.modes.sim.job import JobOrigin
from vsense.modes.sim.outcome import JobAnswer, Task
from vsense.modes.sim.watch import CHECK_PERIOD_S, HANG_MAX_S, Show, WorkerProcess, watch

if TYPE_CHECKING:
    from distributed import Client


JOBS_AHEAD = 1000
"""An engine is handed so many jobs at a time: more than most clusters have processors, and few
enough to be looked at `CHECK_PERIOD_S` after `CHECK_PERIOD_S`."""

IDLE_PROCESS_S = 5.0
"""So long a process waits for its next job."""

_NOTHING = (0, 0, 0)


class PendingJob(Protocol):
    """What an engine gives for a job: a `concurrent.futures.Future`, or something like it."""

    def done(self) -> bool:
        """Whether it has an answer, or never will."""
        ...

    def result(self) -> Any:
        """The answer; raises what the engine says where there is none."""
        ...

    def cancel(self) -> Any:
        """Nobody waits for it any more."""
        ...


class JobExecutor(Protocol):
    """What takes jobs: a `concurrent.futures.Executor`, or something like it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> PendingJob:
        """Has `fn(*args)` called somewhere."""
        ...


class WorkPlace:
    """Where a job is done, as its engine knows it. What engines know more is in their own."""

    def name(self) -> str:
        """The worker's name for people."""
        return f"{socket.gethostname()} (process {os.getpid()})"

    def is_wanted(self) -> bool:
        """Whether somebody still waits for the job that this thread does; is asked often."""
        return True


@dataclass(frozen=True, slots=True)
class Engine:
    """Where the runs of a campaign are done.

    Attributes:
        name: for people.
        place: how a worker of it names itself, and learns that a job is no longer wanted.
    """

    name: str
    executor: JobExecutor
    place: WorkPlace = field(default_factory=WorkPlace)

    def simulate(
        self, tasks: Iterable[Task], interrupted: threading.Event, show: Show
    ) -> Iterator[tuple[Task, dict[str, Any]]]:
        """Does runs; yields each task with its result when it is done.

        Args:
            show: called every `CHECK_PERIOD_S`; the processes are not here, so there are none.

        Raises:
            Interrupted: `interrupted` was set.
            VsenseError: a run has failed, cannot be done on a worker, or the engine gave it up.
        """
        waiting, going = enumerate(_lines(tasks)), dict[int, tuple[Task, PendingJob]]()
        try:
            while True:
                for number, (task, line) in islice(waiting, JOBS_AHEAD - len(going)):
                    going[number] = task, self._submit(task, line)
                if not going:
                    return
                for number in [number for number, (_, job) in going.items() if job.done()]:
                    task, job = going.pop(number)
                    yield task, task.result(self._answer(task, job))
                show([])
                if interrupted.wait(CHECK_PERIOD_S):
                    raise Interrupted
        finally:
            for _, job in going.values():
                job.cancel()

    def _submit(self, task: Task, line: str) -> PendingJob:
        try:
            return self.executor.submit(do, line, fingerprint.of_machine(), self.place)
        except Exception as error:
            raise self._error(task, "takes no jobs any more", error) from None

    def _answer(self, task: Task, job: PendingJob) -> JobAnswer:
        try:
            answer: JobAnswer = job.result()
        except CancelledError:
            words = "has dropped it: nothing answers there any more, or somebody has cancelled it"
            raise self._error(task, words) from None
        except Exception as error:
            raise self._error(task, "gave it up", error) from None
        return answer

    def _error(self, task: Task, words: str, error: Exception | None = None) -> VsenseError:
        why = "" if error is None else f": {type(error).__name__}: {error}"
        return VsenseError(task.named(f"{self.name} {words}{why}"))


def _lines(tasks: Iterable[Task]) -> Iterator[tuple[Task, str]]:
    """Each task with its job as it travels; raises as `of_files`."""
    origins: dict[int, tuple[Experiment, JobOrigin]] = {}  # an experiment that is kept keeps its id
    for task in tasks:
        key = id(task.experiment)
        if key not in origins:
            origins[key] = task.experiment, _origin(task)
        job = replace(task.job, libraries={}, origin=origins[key][1])
        yield task, job.to_line().decode()


def _origin(task: Task) -> JobOrigin:
    cxxflags, files = os.environ.get("CXXFLAGS"), fingerprint.of_files(task)
    return JobOrigin(socket.gethostname(), os.getcwd(), cxxflags, files)


class _Unwanted:
    """Is set as soon as nobody waits for a job."""

    def __init__(self, place: WorkPlace) -> None:
        self._place = place

    def is_set(self) -> bool:
        return not self._place.is_wanted()


def do(line: str, needs: Machine, place: WorkPlace) -> JobAnswer:
    """Does a job, which is a line of JSON; on a worker, in a thread of its own.

    `needs`: `of_machine` where the campaign was begun.
    """
    differs = fingerprint.difference(needs)
    if differs:
        return {"refused": f"worker {place.name()} {differs}", "progress": _NOTHING}
    process = _hire()
    try:
        job = (True, line.encode())
        ((_, answer),) = watch([job], [process], _Unwanted(place), lambda workers: None, HANG_MAX_S)
    except Interrupted:
        return {"refused": "nobody waits for it", "progress": _NOTHING}
    finally:
        _dismiss(process)
    if "refused" in answer:
        answer["refused"] = f"worker {place.name()}: {answer['refused']}"
    return answer


_free: dict[WorkerProcess[bool], threading.Timer] = {}
"""Processes that wait for a job, and what ends them."""
_lock = threading.Lock()


def _hire() -> WorkerProcess[bool]:
    with _lock, suppress(KeyError):
        process, timer = _free.popitem()
        timer.cancel()
        if process.is_free:
            return process
        process.close()
    return WorkerProcess[bool]()


def _dismiss(process: WorkerProcess[bool]) -> None:
    """Keeps a process that can do another job, and ends others."""
    if not process.is_free:
        process.close()
        return
    timer = threading.Timer(IDLE_PROCESS_S, _end, [process])
    timer.daemon = True
    with _lock:
        _free[process] = timer
    timer.start()


def _end(process: WorkerProcess[bool]) -> None:
    """Ends a process, unless it was hired at the last moment."""
    with _lock:
        if _free.pop(process, None) is None:
            return
    process.close()


SCHEDULER_TIMEOUT_S = 5.0
"""A scheduler must answer within this time."""


def require_dask() -> None:
    """Raises UsageError where Dask is not installed."""
    require("--on needs", "distributed")


class DaskPlace(WorkPlace):
    """A worker of Dask, in the thread that does a job."""

    def name(self) -> str:
        """Its address, as Dask's own pages show it, and its machine."""
        from distributed import get_worker

        return f"{get_worker().address} on {socket.gethostname()}"

    def is_wanted(self) -> bool:
        """Whether the scheduler still wants the job, and the worker is not about to end."""
        from distributed import get_worker
        from distributed.worker import WORKER_ANY_RUNNING

        worker = get_worker()
        if worker.status not in WORKER_ANY_RUNNING:
            return False
        task = worker.state.tasks.get(worker.get_current_task())
        return task is not None and task.state in ("executing", "long-running")


@contextmanager
def connected(address: str, console: Console, interrupted: Interruption) -> Iterator[Engine]:
    """Connects to a scheduler, and looks whether its workers can run what runs here.

    Raises:
        UsageError: Dask is not installed.
        VsenseError: no scheduler answers there, or a worker would give other results.
        CutShort: the user has ended it meanwhile.
    """
    require_dask()
    with interrupted.at_once():
        client = _connect(address)
    try:
        with interrupted.at_once():
            _say_size(client, address, console)
        executor = client.get_executor(pure=False)
        yield Engine(f"the Dask cluster {address}", executor, DaskPlace())
    finally:
        client.close(timeout=1)


def _connect(address: str) -> Client:
    import asyncio

    from distributed import Client

    # What becomes of the connection is told in our words.
    for name in list(logging.root.manager.loggerDict):
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        asyncio.run(_greet(address))
        return Client(address, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False, name="vsense")
    except Exception as error:  # whatever is there may answer anything
        reason = str(error) or f"silence for {SCHEDULER_TIMEOUT_S:g} s"
        raise VsenseError(
            f"--on {address}: no Dask scheduler answers there: {reason};"
            " 'dask scheduler' starts one"
        ) from None


async def _greet(address: str) -> None:
    """Exchanges greetings with a scheduler; Dask's client would wait for a silent one for ever."""
    import asyncio

    from distributed import Security
    from distributed.comm.core import connect

    secured = Security().get_connection_args("client")
    connecting = connect(address, timeout=SCHEDULER_TIMEOUT_S, **secured)
    comm = await asyncio.wait_for(connecting, SCHEDULER_TIMEOUT_S + 1.0)
    comm.abort()


def _say_size(client: Client, address: str, console: Console) -> None:
    """Says how large the cluster is; raises VsenseError where workers do not fit."""
    needs = fingerprint.of_machine()
    answers: dict[str, Any]
    answers = client.run(fingerprint.difference, needs, on_error="return")
    refused = []
    for worker, answer in answers.items():
        if isinstance(answer, Exception):
            answer = f"cannot load vsense {needs['vsense']}: {answer}"
        if answer:
            refused.append(f"worker {worker} {answer}")
    if refused:
        raise VsenseError("\n".join(refused))
    places = sum(client.nthreads().values())
    if answers:
        console.say(f"{address}: workers: {len(answers)}, runs at the same time: {places}")
    else:
        console.say(f"{address}: no worker is there; runs begin when one comes")
