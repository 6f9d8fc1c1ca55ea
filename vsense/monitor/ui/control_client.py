"""The terminal's end of a running experiment's socket: finds them, asks, and gives orders."""

from __future__ import annotations

import json
import socket
import stat
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError, VsenseError
from vsense.base.sharing import user_name
from vsense.base.terminal import aligned
from vsense.monitor.ui.control_socket import TRACKER, folders

PATIENCE_S = 5.0
_MOST_BYTES = 1 << 24
BRIEF_S = 0.5
"""For who is asked what it is, while somebody wants to stop it."""

_NOTHING_RUNS = (
    "no experiment runs on this machine: start one with vsense run or vsense lab, or only track"
    " robots with vsense track"
)


Answered = tuple[tuple[str, ...], dict[str, Any]]
"""An experiment in words, its process number first, and its answer."""


class TerminalError(VsenseError):
    """The running experiment does not answer, or refuses."""


def ask(question: Mapping[str, Any], process: int | None = None) -> dict[str, Any]:
    """Asks the experiment that runs on this machine.

    `question` is one of `vsense.monitor.ui.control_socket`.

    Raises:
        UsageError: none runs, or several do and `process` names none.
        TerminalError: it does not answer, or refuses.
    """
    path = _find(process, question.get("order") in ("stop", "emergency"))
    try:
        answer = exchange(path, json.dumps(question).encode() + b"\n")
    except (OSError, ValueError) as error:
        number = path.name.partition(".")[0]
        raise TerminalError(f"process {number} does not answer: {error}") from None
    if "error" in answer:
        raise TerminalError(answer["error"])
    return answer


def _sockets(kind: str = "") -> tuple[dict[int, Path], list[str]]:
    """The sockets of one kind, by the number of their process, and why some are not seen."""
    places, reasons = folders()
    sockets: dict[int, Path] = {}
    for place in places:
        try:
            paths = list(place.glob("*.sock"))
        except OSError as error:  # the others' runs are to be stopped nevertheless
            reasons.append(f"{place}: {error.strerror}")
            continue
        for path in paths:
            number = path.name.removesuffix(f"{kind}.sock")
            with suppress(OSError):  # its process has just ended
                if number.isdigit() and stat.S_ISSOCK(path.lstat().st_mode):
                    sockets[int(number)] = path
    return sockets, reasons


def alive(kind: str = "") -> dict[int, Path]:
    """The sockets of all that runs, by process: by default of experiments."""
    sockets, _ = _sockets(kind)
    return {number: path for number, path in sorted(sockets.items()) if _is_alive(path)}


def _find(process: int | None, all_too: bool = False) -> Path:
    (trackers, reasons), (experiments, _) = _sockets(TRACKER), _sockets()
    found = {**trackers, **experiments}
    if process in found:
        return found[process]
    # What moves no robot is never in the way of an order that shall stop some.
    there = alive() or alive(TRACKER)
    if process is not None:
        raise UsageError(
            "\n".join([f"process {process} runs no experiment; {_running(there)}", *reasons])
        )
    if not there:
        raise UsageError("\n".join([_NOTHING_RUNS, *reasons]))
    if len(there) > 1:
        every = ", or stop all of them with --all" if all_too else ""
        raise UsageError(f"{_running(there)}\nsay which with --process PID{every}")
    return next(iter(there.values()))


def _running(found: Mapping[int, Path]) -> str:
    """What runs, one line each, so that everybody knows which is his."""
    if not found:
        return "no experiment runs"
    rows = [describe(number, path) for number, path in sorted(found.items())]
    return "\n".join([f"{len(rows)} experiments run:", *(f"  {row}" for row in aligned(rows))])


def describe(number: int, path: Path) -> tuple[str, ...]:
    """A running experiment in words, as far as it answers."""
    try:
        answer = exchange(path, b'{"ask": "status"}\n', BRIEF_S)
        port = f"robots' port {answer['port']}" if "port" in answer else ""
        now = answer["run"]
        age = f"run {now['run']} {now['state']}, {now['time_s']:.0f} s"
        command, where = f"vsense {answer['command']}{whose(answer)}", str(answer["directory"])
        return str(number), str(answer["name"]), command, port, age, where
    except (OSError, ValueError, KeyError, TypeError):
        return str(number), "does not answer", "", "", "", ""


def _is_alive(path: Path) -> bool:
    """Whether anybody listens; what a killed process left is taken away."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(PATIENCE_S)
        try:
            line.connect(str(path))
            return True
        except ConnectionRefusedError:
            with suppress(FileNotFoundError):
                path.unlink()
        except OSError:
            pass
    return False


def exchange(path: Path, question: bytes, patience_s: float = PATIENCE_S) -> dict[str, Any]:
    """Sends one line to a process and gives its answer; OSError, ValueError where there is none."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(patience_s)
        line.connect(str(path))
        line.sendall(question)
        data, end_s = b"", time.monotonic() + patience_s
        while chunk := line.recv(65536):
            data += chunk
            # Of one that only goes on talking nobody waits for the end.
            if len(data) > _MOST_BYTES or time.monotonic() > end_s:
                raise ValueError("its answer has no end")
    answer = json.loads(data)
    if not isinstance(answer, dict):
        raise ValueError("its answer makes no sense")
    return answer


def whose(answer: Mapping[str, Any]) -> str:
    """Whose run it is, where it is another account's."""
    user = answer.get("user", user_name())
    return "" if user == user_name() else f", {user}'s"


def order_all(order: Mapping[str, Any]) -> tuple[list[Answered], list[str]]:
    """Gives an order to all experiments at once.

    Returns:
        Each experiment in words, with its answer, {"error": reason} where it has none; and why some
        are not reached.

    Raises:
        UsageError: nothing runs here.
    """
    sockets, reasons = _sockets()
    paths = sorted(sockets.items())
    line = json.dumps(order).encode() + b"\n"
    # One that hangs must not hold up the stop of the others: nothing is asked before.
    with ThreadPoolExecutor(max(len(paths), 1)) as pool:
        answers = list(pool.map(lambda row: _answer(row[1], line), paths))
        names = pool.map(lambda row: describe(*row), paths)
        answered = [(name, data) for name, data in zip(names, answers) if data is not None]
    if not answered:
        raise UsageError("\n".join([_NOTHING_RUNS, *reasons]))
    return answered, reasons


def _answer(path: Path, line: bytes) -> dict[str, Any] | None:
    """The answer to an order; {"error": reason} where there is none, None: nobody is there."""
    try:
        return exchange(path, line)
    except (ConnectionRefusedError, FileNotFoundError):
        return None
    except (OSError, ValueError) as error:
        return {"error": f"does not answer: {error}"}
