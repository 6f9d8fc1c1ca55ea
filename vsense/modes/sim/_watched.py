"""Simulations that a page watches: one run after the other, in processes of their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from vsense.base.errors import Interrupted, VsenseError
from vsense.modes.sim._room import SimRoom
from vsense.modes.sim.outcome import Task
from vsense.modes.sim.watch import CHECK_PERIOD_S, HANG_MAX_S, Show, WorkerProcess, watch
from vsense.run.orders import OrderError

SAVE_TIMEOUT_S = 10.0
"""A run that shall end may take so long for its files."""


class WatchedRuns:
    """Carries out the runs of a room; a context that leaves no process behind.

    Attributes:
        cut: whether the newest run was ended by `interrupted`.
        failure: of the newest run; None: it has not failed.
    """

    def __init__(self, room: SimRoom, interrupted: threading.Event) -> None:
        self._room, self._interrupted = room, interrupted
        self._worker: WorkerProcess[Task] | None = None
        self._stack = ExitStack()
        self._asked_s: float | None = None
        self._stopped = False
        self.cut = False
        self.failure: VsenseError | None = None

    def __enter__(self) -> WatchedRuns:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def run(self, task: Task, show: Show) -> dict[str, Any]:
        """Does a run; a signal ends it where it is, with all that there was of it.

        `show` is called now and then with the processes, as of `simulate_all`.

        Raises:
            Interrupted: it was ended by a signal, and did not come to its end.
            VsenseError: it has failed.
        """
        worker = self._ready()
        self._asked_s, self._stopped, self.failure = None, False, None
        try:
            jobs = [(task, task.job.to_line())]
            ((_, answer),) = watch(jobs, [worker], self, show, HANG_MAX_S)
            result = task.result(answer)
        except (Interrupted, VsenseError) as error:
            self.failure = error if isinstance(error, VsenseError) else None
            if not worker.is_free:
                self._drop()
            raise
        finally:
            self.cut = self._asked_s is not None
        return result

    def is_set(self) -> bool:
        """Whether the run has to end at once: some time after a signal has asked it to end."""
        if not self._interrupted.is_set():
            return False
        if self._asked_s is None:
            self._asked_s = time.monotonic()
        if not self._stopped:
            with suppress(OrderError):  # it may listen when this is called again
                self._room.stop()
                self._stopped = True
        return time.monotonic() - self._asked_s > SAVE_TIMEOUT_S

    def rest(self, idle: Callable[[], None]) -> bool:
        """Waits after a run until another one is wanted; False where a signal ends everything.

        `idle` is called now and then.
        """
        while not self._room.control.next_asked:
            if self._interrupted.wait(CHECK_PERIOD_S):
                return False
            idle()
        return not self._interrupted.is_set()

    def _ready(self) -> WorkerProcess[Task]:
        """The process for the next run."""
        if self._worker is None:
            self._worker = WorkerProcess[Task](self._room.descriptor)
            self._stack.callback(self._worker.close)
        return self._worker

    def _drop(self) -> None:
        """Ends a process that hangs, or has ended."""
        self._stack.close()
        self._worker = None
