"""Child processes: how Python ones start, and how all end.

`python -m` searches the current folder for modules before its own library: a user's `random.py` or
`queue.py` would break vsense there, and a `numpy.py` of somebody else's would run. So whatever
starts a Python module starts it with `python_module`.

A fork of this process begins without all that: what is imported is there. It is safe only where
nothing else goes on in the process (`ForkedProcess`).
"""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO, Any
from weakref import WeakSet

END_TIMEOUT_S = 5.0
"""A process that was asked to end and does not within this time is killed."""

LAUNCHER = (
    "import sys; del sys.path[0]; import runpy;"
    " runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)
"""Does what `python -P -m` does, for a Python before 3.11, which has no `-P`: with `-c`, as with
`-m`, the current folder is the first that is searched, and `sys` itself is searched for nowhere."""

_SAFE = ("-P", "-m") if sys.version_info >= (3, 11) else ("-c", LAUNCHER)

Started = tuple[subprocess.Popen[bytes], IO[bytes], IO[bytes]]
"""A process, and the pipes to its standard input and from its standard output."""

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""A run keeps one processor busy; threads of libraries only get in each other's way."""


def python_module(module: str) -> tuple[str, ...]:
    """The words that start a Python module: nothing in the current folder is imported for it."""
    return (sys.executable, *_SAFE, module)


def python_file(path: Path) -> tuple[str, ...]:
    """The words that start a file in Python: it imports what lies beside it."""
    return (sys.executable, str(path))


def start_module(module: str, *arguments: str, **options: Any) -> Started:
    """Starts a Python module in a session of its own: Ctrl-C reaches only this process."""
    process = subprocess.Popen(
        [*python_module(module), *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        **options,
    )
    assert process.stdin is not None and process.stdout is not None
    _lines.add(process.stdin)
    return process, process.stdin, process.stdout


_lines: WeakSet[IO[bytes]] = WeakSet()
_lifelines: WeakSet[Lifeline] = WeakSet()


def _let_go() -> None:
    """In a fork, such as users' code makes: what ends other processes when this one's parent closes
    it, or ends, is not held open."""
    null = os.open(os.devnull, os.O_RDWR)
    # In their place: objects that are left in the fork close these descriptors once more.
    for line in [line for line in _lines if not line.closed]:
        os.dup2(null, line.fileno(), inheritable=False)
    for lifeline in _lifelines:
        lifeline.let_go(null)
    os.close(null)


os.register_at_fork(after_in_child=_let_go)


class ForkedProcess:
    """A fork of this process in a session of its own, with what `subprocess.Popen` has, too.

    Attributes:
        allowed: this process is a command's, to which everything in it belongs.
    """

    allowed = False

    def __init__(
        self, work: Callable[[], int], stdin: int, stdout: int, shared: Collection[int]
    ) -> None:
        """Forks; the fork calls `work`, and ends with the code that it gives.

        Of open descriptors it has `stdin`, `stdout`, standard error and those of `shared`.
        """
        self._returncode: int | None = None
        for stream in (sys.stdout, sys.stderr):  # what waits there is printed once
            with suppress(AttributeError, OSError):  # it may be closed, or there is none
                stream.flush()
        self.pid = os.fork()
        if self.pid == 0:
            code = 1
            try:
                _forget_parent(stdin, stdout, shared)
                code = work()
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(code)

    @classmethod
    def allow(cls) -> None:
        """Makes this process one that may be forked: it is a command's, and has one thread.

        Is called before NumPy is imported, whose library starts a thread for each processor.
        """
        os.environ.update(ONE_THREAD)
        cls.allowed = True

    @classmethod
    def is_safe(cls) -> bool:
        """Whether a fork would be whole: another thread, and what it holds, would be gone."""
        return cls.allowed and len(os.listdir("/proc/self/task")) == 1

    def poll(self) -> int | None:
        """The exit code, negative that of a signal; None: it runs."""
        return self._wait(os.WNOHANG)

    def wait(self) -> int:
        """Waits for its end; gives what `poll` gives then."""
        code = self._wait(0)
        assert code is not None
        return code

    def _wait(self, flags: int) -> int | None:
        if self._returncode is None:
            pid, status = os.waitpid(self.pid, flags)
            if pid:
                self._returncode = os.waitstatus_to_exitcode(status)
        return self._returncode


def begin_worker(
    module: str, shared: Sequence[int], fresh: bool
) -> tuple[subprocess.Popen[bytes] | ForkedProcess, IO[bytes], IO[bytes]]:
    """Begins a process with one thread that does what a module's `run` does with descriptors.

    It is a fork where that is safe and it need not be `fresh`, and else `start_module`'s, with the
    descriptors as arguments. Gives the process, and the pipes as in `Started`.
    """
    if fresh or not ForkedProcess.is_safe():
        environment = {**os.environ, **ONE_THREAD}
        return start_module(module, *map(str, shared), pass_fds=shared, env=environment)
    work = partial(importlib.import_module(module).run, *shared)
    source, jobs = os.pipe()
    answers, target = os.pipe()
    try:
        process = ForkedProcess(work, source, target, shared)
    finally:
        os.close(source)
        os.close(target)
    return process, os.fdopen(jobs, "wb"), os.fdopen(answers, "rb")


def _forget_parent(stdin: int, stdout: int, shared: Collection[int]) -> None:
    """In a fork: leaves it as a Python that was started by `start_module` is.

    Descriptors keep their numbers: objects of the parent's that are left close only their own.
    """
    os.setsid()
    for number in signal.valid_signals():
        if callable(signal.getsignal(number)):
            signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.dup2(stdin, 0)
    os.dup2(stdout, 1)
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        if descriptor > 2 and descriptor not in {null, *shared}:
            os.dup2(null, descriptor, inheritable=False)
    # What lies beside the program is no module, as with `-P`.
    beside = os.path.dirname(os.path.realpath(sys.argv[0]))
    sys.path[:1] = [folder for folder in sys.path[:1] if folder != beside]


class Lifeline:
    """What robots' daemons on this machine have as standard input: a pipe without a byte.

    It ends with this process, or when it is closed. Those that are built for this machine end then
    (`robot/lab/orphan.c`), and stop their robots.

    Attributes:
        place: its file, for daemons that somebody else starts.
    """

    def __init__(self) -> None:
        self._theirs, self._ours = os.pipe()
        self.place = f"/proc/{os.getpid()}/fd/{self._theirs}"
        _lifelines.add(self)

    def start(self, command: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
        """Starts a daemon, in a session of its own; its words go to the end of a file."""
        with log.open("ab") as words:
            return subprocess.Popen(
                command, stdin=self._theirs, stdout=words, stderr=words, start_new_session=True
            )

    def let_go(self, null: int) -> None:
        """In a fork, which does not hold it; `null` takes its place."""
        os.dup2(null, self._ours, inheritable=False)

    def close(self) -> None:
        _lifelines.discard(self)
        os.close(self._theirs)
        os.close(self._ours)


def end(process: subprocess.Popen[Any], timeout_s: float = END_TIMEOUT_S) -> None:
    """Waits for a process that was asked to end, and kills it where it does not."""
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def terminate(processes: Collection[subprocess.Popen[Any]]) -> None:
    """Ends all: SIGTERM, and SIGKILL for those that do not end."""
    processes = [*processes]  # another thread may change what it was taken from
    for process in processes:
        process.terminate()
    for process in processes:
        end(process)


def describe_exit(returncode: int) -> str:
    """Says in words how a process ended."""
    if returncode < 0:
        return f"was killed by {signal.Signals(-returncode).name}"
    return f"ended with exit code {returncode}"


def read_line(descriptor: int) -> bytes:
    """Reads a line and not a byte further, so that `select` sees all that follows.

    The line is empty where the input ended before it did.
    """
    line = bytearray()
    while not line.endswith(b"\n"):
        byte = os.read(descriptor, 1)
        if not byte:
            return b""
        line += byte
    return bytes(line)
