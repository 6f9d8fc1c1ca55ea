"""What a worker of a cluster does with a job: looks whether it can, and has a process do it.

The process is `vsense.modes.sim.worker`, as on the user's own machine: users' code never runs in
the worker itself, and what crashes or hangs is told by numbers. It starts in most of a second; so
one that has done its job waits a moment for the next.
"""

from __future__ import annotations

import os
import socket
import threading
from contextlib import suppress

from vsense.modes.sim import fingerprint
from vsense.modes.sim.fingerprint import Machine
from vsense.modes.sim.outcome import Answer, Interrupted
from vsense.modes.sim.watch import LIMIT_S, WorkerProcess, watch

KEPT_S = 5.0
"""So long a process waits for its next job."""

_NOTHING = (0, 0, 0)


class Place:
    """Where a job is done, as its engine knows it. What engines know more is in their own."""

    def name(self) -> str:
        """The worker's name for people."""
        return f"{socket.gethostname()} (process {os.getpid()})"

    def is_wanted(self) -> bool:
        """Whether somebody still waits for the job that this thread does; is asked often."""
        return True


class _Unwanted:
    """Is set as soon as nobody waits for a job."""

    def __init__(self, place: Place) -> None:
        self._place = place

    def is_set(self) -> bool:
        return not self._place.is_wanted()


def do(line: str, needs: Machine, place: Place) -> Answer:
    """Does a job, which is a line of JSON; on a worker, in a thread of its own.

    `needs`: `of_machine` where the campaign was begun.
    """
    differs = fingerprint.difference(needs)
    if differs:
        return {"refused": f"worker {place.name()} {differs}", "progress": _NOTHING}
    process = _hire()
    try:
        job = (True, line.encode())
        ((_, answer),) = watch([job], [process], _Unwanted(place), lambda workers: None, LIMIT_S)
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
    timer = threading.Timer(KEPT_S, _end, [process])
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
