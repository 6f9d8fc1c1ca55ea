"""The process that simulates: one after the other, every run in a fork of its own.

A controller is a user's C code, and a campaign is many runs. A fork costs milliseconds, separates
the runs from each other, and gives every run the same fresh memory. What a run needs is imported
before.

`python -m vsense.modes.sim._worker DESCRIPTOR [PAGE]` shares the memory of `Programs`' progress
through the first descriptor; through the other one, a socket, a page watches the runs. It reads
jobs from standard input, one line each (`vsense.modes.sim.job`), and answers on standard output
with one line of JSON each:

    {"result": {...}}                 see `simulate`
    {"error": "...", "exit_code": 1}  what a user can mend
    {"refused": "..."}                it cannot be done on this machine
    {"status": 139, "place": "..."}   how the fork ended otherwise, as of `os.waitpid`; words that
                                      follow, such as " at mine.c:12", or ""

The next job comes after the answer. The process ends with its standard input.
"""

from __future__ import annotations

import fcntl
import gc
import json
import mmap
import os
import select
import signal
import sys
import time
import traceback
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import VsenseError
from vsense.base.processes import read_line
from vsense.base.terminal import Console
from vsense.base.users_code import UsersCode
from vsense.config.devices import virtual_devices
from vsense.config.specs import Experiment
from vsense.modes.sim import fingerprint
from vsense.modes.sim._kept import KeptRun, prepare
from vsense.modes.sim._simulation import Simulation
from vsense.modes.sim.job import Job, Setup
from vsense.robots.crashes import CrashNote
from vsense.robots.inprocess import declarations
from vsense.run.programs import RUN_PROGRESS_BYTES, shared_objects

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

EVENTS_TOLD = 20
"""Of what controllers log so many lines come with the result; events.csv has them all."""


def simulate(
    job: Job, experiment: Experiment, progress: Any, page: Connection | None = None
) -> dict[str, Any]:
    """Does one run of the experiment that the job's setup loads.

    `progress`: see `Programs`; `page`: whoever watches and paces it.

    Returns:
        The experiment's `name`, number of `robots` and `timesteps`, `timestep_s`, `wall_s` that
        the timesteps took and `cpu_s` of this process for them, `swarm` as of `metrics.swarm`,
        `measures` of its own, whether it is `complete` or was stopped, `changes`: how often people
        changed its world, `complaints` of controllers, which have `failed`, the first `events` that
        they logged (seconds and words) and their number; `recording`, see `KeptRun`.

    Raises:
        VsenseError: the run cannot be had.
    """
    libraries = {name: Path(path) for name, path in job.libraries.items()}
    run = Simulation(experiment, libraries, job.seed, job.setup.blind, progress)
    files = KeptRun(run, job, page)
    begun_s, cpu_begun_s = time.perf_counter(), time.process_time()
    try:
        measures = run.run()
    except VsenseError:
        files.end()
        with suppress(VsenseError):  # the first one counts
            files.save()
        raise
    wall_s, cpu_s = time.perf_counter() - begun_s, time.process_time() - cpu_begun_s
    # Tables and recording are whole, and the page has the last timestep, whatever fails then.
    recording = files.end()
    files.save()
    return {
        **_notes(run, files),
        "recording": recording,
        "timesteps": len(run.record.timesteps),
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "measures": measures,
    }


def _notes(run: Simulation, files: KeptRun) -> dict[str, Any]:
    """What it was, what became of it, and what controllers complained of and logged."""
    experiment, events = run.environment.experiment, run.record.events
    whose = {"name": experiment.name, "robots": len(experiment.robots)}
    whose["timestep_s"] = experiment.timestep_s
    events_data = {"events": events[:EVENTS_TOLD], "events_in_all": len(events)}
    facts = {"complete": run.is_whole, "changes": files.changes, "complaints": run.complaints()}
    facts["failed"] = run.failed()
    return {**whose, "swarm": run.record.swarm(), **facts, **events_data}


class NotHere(VsenseError):
    """A job of another machine cannot be done on this one."""


def settled(job: Job) -> Job:
    """Makes a job of another machine one of this: finds its files, and builds its controllers.

    Raises:
        NotHere: that is not possible.
    """
    origin = job.origin
    if origin is None:
        return job
    for name, expected in origin.files.items():
        _check_file(Path(name), expected, origin.host)
    with suppress(OSError):  # it has no file of a user then
        os.chdir(origin.folder)
    if origin.cxxflags is None:
        os.environ.pop("CXXFLAGS", None)
    else:
        os.environ["CXXFLAGS"] = origin.cxxflags
    try:
        built = shared_objects(job.setup.load())
    except VsenseError as error:
        raise NotHere(str(error)) from None
    return replace(job, libraries={name: str(path) for name, path in built.items()}, origin=None)


def _check_file(path: Path, expected: str, host: str) -> None:
    same = f"on every machine expected as it is on {host}: in a folder that they share, or copied"
    try:
        digest = fingerprint.of_file(path)
    except VsenseError as error:
        raise NotHere(f"{error}; {same}") from None
    if digest != expected:
        raise NotHere(f"{path}: is another one there; {same}")


class Worker:
    """Does jobs.

    `progress` is shared memory, `answers` the descriptor to answer on; `page` see `simulate`.
    """

    def __init__(self, progress: Any, answers: int, page: Connection | None = None) -> None:
        self._progress = progress
        self._answers = answers
        self._page = page
        self._crash = CrashNote()
        self._shared: Setup | None = None
        self._experiment: Experiment | None = None

    def work(self) -> None:
        """Does jobs until standard input ends."""
        while line := read_line(0):
            answer = self._do(line)
            if answer is None:
                return
            os.write(self._answers, json.dumps(answer).encode() + b"\n")

    def _do(self, line: bytes) -> dict[str, Any] | None:
        """Does a job in a fork; None where the parent has ended it."""
        job = Job.from_line(line)
        prepare(job, self._page is not None)
        self._share(job)
        source, target = os.pipe()
        gc.freeze()  # what is here already is no garbage of the fork's, which leaves it shared
        # The fork dies with this process, even in an endless loop: see `_die_with_parent`.
        alive, life = os.pipe()
        pid = os.fork()
        if pid == 0:
            os.close(life)
            os.close(source)
            _die_with_parent(alive)
            self._answer(job, target)
        os.close(target)
        os.close(alive)
        try:
            answer = _listen(source, pid)
        finally:
            _, status = os.waitpid(pid, 0)
            os.close(source)
            os.close(life)
        if answer is None:
            return None
        if status == 0 and answer:
            facts: dict[str, Any] = json.loads(answer)
            if facts.pop("shares", False) and job.origin is None:
                self._shared = job.setup
            return facts
        return {"status": status, "place": self._crash.words()}

    def _share(self, job: Job) -> None:
        """Loads the experiment of a job like the one before, for all that follow.

        The first is loaded in its fork: it may fail, and what a user's Python code leaves behind
        is no other run's business.
        """
        if job.origin is not None or job.setup != self._shared:
            self._shared = self._experiment = None
        elif self._experiment is None:
            with suppress(VsenseError):  # the fork will say so
                self._experiment = job.setup.load()

    def _answer(self, job: Job, target: int) -> None:
        """In the fork: does the job, writes its answer, and ends the process."""
        code = 1
        try:
            # What a controller prints goes to standard error; it has nothing to read.
            os.dup2(2, 1)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.close(self._answers)
            self._crash.watch()
            with redirect_stdout(sys.stderr):  # which keeps nothing back
                data = json.dumps(self._answer_to(job)).encode()
            while data:
                data = data[os.write(target, data) :]
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _answer_to(self, job: Job) -> dict[str, Any]:
        try:
            job = settled(job)
            experiment = self._experiment or job.setup.load()
            shares = not UsersCode.ran
            result = simulate(job, experiment, self._progress, self._page)
        except NotHere as error:
            return {"refused": str(error)}
        except VsenseError as error:
            return {"error": str(error), "exit_code": error.exit_code}
        return {"result": result, "shares": shares}


def _die_with_parent(alive: int) -> None:
    """Has the kernel end this process when the pipe's other end closes."""
    signal.signal(signal.SIGIO, signal.SIG_DFL)
    fcntl.fcntl(alive, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(alive, fcntl.F_SETFL, fcntl.fcntl(alive, fcntl.F_GETFL) | os.O_ASYNC)
    # It may have closed before the kernel was asked to watch.
    if select.select([alive], [], [], 0)[0]:
        os._exit(1)


def _listen(source: int, pid: int) -> bytes | None:
    """Waits for a fork's answer; kills the fork and gives None when standard input ends."""
    answer = bytearray()
    while True:
        ready = select.select([source, 0], [], [])[0]
        if 0 in ready:
            os.kill(pid, signal.SIGKILL)
            return None
        part = os.read(source, 65536)
        if not part:
            return bytes(answer)
        answer += part


def run(progress: int, page: int | None = None) -> int:
    """Does the process's work; the descriptors are those of the module's arguments."""
    memory = mmap.mmap(progress, RUN_PROGRESS_BYTES)
    answers = os.dup(1)
    os.dup2(2, 1)
    try:
        declarations()
        virtual_devices()  # imports them all
    except VsenseError as error:
        Console().say(f"vsense sim: {error}")
        return error.exit_code
    watcher = None
    if page is not None:
        from multiprocessing.connection import Connection

        watcher = Connection(page)
    Worker(memory, answers, watcher).work()
    return 0


if __name__ == "__main__":
    sys.exit(run(*map(int, sys.argv[1:])))
