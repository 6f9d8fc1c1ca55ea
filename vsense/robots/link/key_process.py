"""The swarm's keys in a process of their own, which gives robots' keys and nothing else.

Loop functions, sensors and virtual robots' controllers are users' code, and run in the process that
serves the robots. That one must never have had the swarm's keys: who has them is every robot.

`python -m vsense.robots.link.key_process [FILE]` reads a file of keys, or makes a key that no file
has. It writes a line of JSON: the keys' numbers, or what is wrong. For each line that it reads, a
uid, it writes the robot's keys by the number of the swarm's. It ends with its input. One that was
killed is started again, where its keys are in a file.
"""

from __future__ import annotations

import ctypes
import json
import os
import select
import signal
import sys
import threading
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from typing import IO, Any

from vsense.base.errors import ConfigError, VsenseError
from vsense.base.processes import start_module
from vsense.robots.link import keys

START_S = 30.0
"""It must have read its file within this time."""

PATIENCE_S = 5.0
"""It must answer within this time, where no robot waits for what it says ..."""

ROBOT_PATIENCE_S = 0.1
"""... and within this one in the thread that serves the robots, whose wheels stop after 0.4 s."""

AGAIN_S = 5.0
"""One that has ended is not started again before this time."""

ROBOTS_MAX = 1024
"""Robots whose keys are remembered: who was asked for longest ago is forgotten."""

_DROP = "drop "
_SET_DUMPABLE = 4  # PR_SET_DUMPABLE of prctl(2)


class KeyProcess:
    """The process; a `KeySource`, for any thread.

    Args:
        path: the file of the keys; None: a key is made, which goes with the process.

    Attributes:
        numbers: see `KeySource`.

    Raises:
        VsenseError: the keys cannot be used, or the process has not answered; so with all methods.
        ConfigError: a line of the file is wrong.
    """

    def __init__(self, path: Path | None = None) -> None:
        # As it is now: code of users may change folder and environment of this process.
        self._path = None if path is None else path.absolute()
        self._environment = dict(os.environ)
        self._lock = threading.Lock()
        self._known: dict[bytes, dict[int, bytes]] = {}
        self._start()
        self.numbers: Sequence[int] = self._answer(START_S)["numbers"]

    def _start(self) -> None:
        """Starts it; the first that it says are the numbers of the keys."""
        arguments = () if self._path is None else (str(self._path),)
        self._started_s = time.monotonic()
        started = start_module(__name__, *arguments, env=self._environment)
        process, self._questions, self._answers = started
        self._end = weakref.finalize(self, _end, process, self._questions, self._answers)
        self._is_owed = True

    @property
    def newest(self) -> int:
        """See `KeySource`."""
        return self.numbers[0]

    def robot_key(self, uid: bytes, number: int | None = None) -> bytes:
        """See `KeySource`."""
        return self._keys_of(uid, PATIENCE_S)[self.newest if number is None else number]

    def roots(self, uid: bytes) -> Sequence[tuple[int, bytes]]:
        """See `KeySource`."""
        return tuple(self._keys_of(uid, ROBOT_PATIENCE_S).items())

    def drop_former(self, newest: int) -> list[int]:
        """Has the keys before one taken out of their file; gives their numbers."""
        with self._lock:
            former: list[int] = self._ask(f"{_DROP}{newest}", PATIENCE_S)["former"]
            self._known.clear()
        self.numbers = [number for number in self.numbers if number not in former]
        return former

    def _keys_of(self, uid: bytes, limit_s: float) -> dict[int, bytes]:
        with self._lock:
            found = self._known.pop(uid, None)
            if found is None:
                said = self._ask(uid.hex(), limit_s)["keys"]
                found = {int(number): bytes.fromhex(key) for number, key in said.items()}
            self._known[uid] = found
            if len(self._known) > ROBOTS_MAX:
                del self._known[next(iter(self._known))]
            return found

    def _ask(self, question: str, limit_s: float) -> dict[str, Any]:
        if self._is_owed:  # the answer to a question that nobody waits for any more
            said = self._answer(0.0)
            if "numbers" in said:  # it was started again, and has read its file anew
                self.numbers = said["numbers"]
                self._known.clear()
        try:
            self._questions.write(f"{question}\n".encode())
            self._questions.flush()
        except OSError:
            raise self._ended() from None
        self._is_owed = True
        return self._answer(limit_s)

    def _answer(self, limit_s: float) -> dict[str, Any]:
        # One question at a time: whatever can be read is the begin of a whole line.
        if not select.select([self._answers], [], [], limit_s)[0]:
            raise VsenseError("the process that holds the swarm's keys does not answer")
        line = self._answers.readline()
        self._is_owed = False
        if not line:
            raise self._ended()
        said: dict[str, Any] = json.loads(line)
        if "wrong" in said:
            raise ConfigError(*said["wrong"])
        if "error" in said:
            raise VsenseError(said["error"])
        return said

    def _ended(self) -> VsenseError:
        """Starts it again, where its keys are not lost; nobody waits for that."""
        said = "the process that holds the swarm's keys has ended"
        if self._path is None or time.monotonic() - self._started_s < AGAIN_S:
            return VsenseError(said)
        self._end()
        self._start()
        return VsenseError(f"{said}, and is started again")


def _end(process: Popen[bytes], questions: IO[bytes], answers: IO[bytes]) -> None:
    """Ends it at once: there is nothing that it could lose."""
    process.kill()
    process.wait()
    answers.close()
    questions.raw.close()  # type: ignore[attr-defined]  # what it was not sent goes nowhere


def _tell(**said: object) -> None:
    print(json.dumps(said), flush=True)


@contextmanager
def _telling_errors() -> Iterator[None]:
    try:
        yield
    except ConfigError as error:
        _tell(wrong=(error.file, error.line, error.message))
    except VsenseError as error:
        _tell(error=str(error))


def answer(path: Path | None) -> None:
    """Answers questions until there are none."""
    # It ends with its standard input; an interruption is its parent's to answer.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Other programs of this account cannot look into this one, and it leaves no core behind.
    ctypes.CDLL(None).prctl(_SET_DUMPABLE, 0, 0, 0, 0)
    with _telling_errors():
        store = keys.make() if path is None else keys.read(path)
        _tell(numbers=store.numbers)
        for line in sys.stdin:
            with _telling_errors():
                if line.startswith(_DROP) and path is not None:
                    store, former = keys.drop_former(path, int(line.removeprefix(_DROP)))
                    _tell(former=former)
                else:
                    roots = store.roots(bytes.fromhex(line))
                    _tell(keys={number: key.hex() for number, key in roots})


if __name__ == "__main__":
    answer(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
