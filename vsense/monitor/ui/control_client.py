"""The terminal's end of a running experiment's socket: finds them, asks, and gives orders."""

from __future__ import annotations

import json
import os
import socket
import stat
import time
from collections.abc import Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError, VsenseError
from vsense.base.sharing import user_name
from vsense.base.terminal import Console, aligned
from vsense.monitor.ui.control_socket import TRACKER_SUFFIX, folders

if TYPE_CHECKING:
    from vsense.run.leases import Lease

ANSWER_TIMEOUT_S = 5.0
_MOST_BYTES = 1 << 24
BRIEF_S = 0.5
"""For who is asked what it is, while somebody wants to stop it."""

_NOTHING_RUNS = (
    "no experiment runs on this machine: start one with vsense run or vsense lab, or only track"
    " robots with vsense camera track"
)


Answered = tuple[tuple[str, ...], dict[str, Any]]
"""An experiment in words, its process number first, and its answer."""


HANDOVER_TIMEOUT_S = 60.0
"""A run's figures and pictures may take so long after its end."""
_POLL_S = 0.1


class HandoverError(VsenseError):
    """The robots were not given back."""


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
        if question.get("ask") != "status" or "error" in answer:
            _check_words(answer)
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
    (trackers, reasons), (experiments, _) = _sockets(TRACKER_SUFFIX), _sockets()
    processes = {**trackers, **experiments}
    if process in processes:
        return processes[process]
    # What moves no robot is never in the way of an order that shall stop some.
    there = alive() or alive(TRACKER_SUFFIX)
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


_TYPED = {"track": "camera track"}
"""Commands that are typed in another way than they call themselves."""


def _running(processes: Mapping[int, Path]) -> str:
    """What runs, one line each, so that everybody knows which is his."""
    if not processes:
        return "no experiment runs"
    rows = [describe(number, path) for number, path in sorted(processes.items())]
    return "\n".join([f"{len(rows)} experiments run:", *(f"  {row}" for row in aligned(rows))])


def describe(number: int, path: Path) -> tuple[str, ...]:
    """A running experiment in words, as far as it answers."""
    try:
        answer = exchange(path, b'{"ask": "status"}\n', BRIEF_S)
        port = f"robots' port {answer['port']}" if "port" in answer else ""
        now = answer["run"]
        age = f"run {now['run']} {now['state']}, {now['time_s']:.0f} s"
        typed = _TYPED.get(answer["command"], answer["command"])
        command, where = f"vsense {typed}{whose(answer)}", str(answer["directory"])
        return str(number), str(answer["name"]), command, port, age, where
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return str(number), "does not answer", "", "", "", ""


def _is_alive(path: Path) -> bool:
    """Whether anybody listens; what a killed process left is taken away."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(ANSWER_TIMEOUT_S)
        try:
            line.connect(str(path))
            return True
        except ConnectionRefusedError:
            with suppress(FileNotFoundError):
                path.unlink()
        except OSError:
            pass
    return False


def exchange(path: Path, question: bytes, timeout_s: float = ANSWER_TIMEOUT_S) -> dict[str, Any]:
    """Sends one line to a process and gives its answer; OSError, ValueError where there is none."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(timeout_s)
        line.connect(str(path))
        line.sendall(question)
        data, end_s = b"", time.monotonic() + timeout_s
        while chunk := line.recv(65536):
            data += chunk
            # Of one that only goes on talking nobody waits for the end.
            if len(data) > _MOST_BYTES or time.monotonic() > end_s:
                raise ValueError("its answer has no end")
    try:
        answer = json.loads(data)
    except RecursionError:
        answer = None
    if not isinstance(answer, dict):
        raise ValueError("its answer makes no sense")
    return answer


def _check_words(answer: dict[str, Any]) -> dict[str, Any]:
    """Gives an answer in which words say what was done, or why not; ValueError: it is none."""
    if not isinstance(answer.get("error", answer.get("text")), str):
        raise ValueError("its answer makes no sense")
    return answer


def whose(answer: Mapping[str, Any]) -> str:
    """Whose run it is, where it is another account's."""
    user = answer.get("user", user_name())
    return "" if user == user_name() else f", {user}'s"


def order_own(order: Mapping[str, Any]) -> list[Answered]:
    """Gives an order to all experiments of this account at once; see `order_all`."""
    sockets, _ = _sockets()
    return _order({number: path for number, path in sockets.items() if _is_own(path)}, order)


def _is_own(path: Path) -> bool:
    with suppress(OSError):  # its process has just ended
        return path.lstat().st_uid == os.getuid()
    return False


def order_all(order: Mapping[str, Any]) -> tuple[list[Answered], list[str]]:
    """Gives an order to all experiments at once.

    Returns:
        Each experiment in words, with its answer, {"error": reason} where it has none; and why some
        are not reached.

    Raises:
        UsageError: nothing runs here.
    """
    sockets, reasons = _sockets()
    answered = _order(sockets, order)
    if not answered:
        raise UsageError("\n".join([_NOTHING_RUNS, *reasons]))
    return answered, reasons


def _order(sockets: Mapping[int, Path], order: Mapping[str, Any]) -> list[Answered]:
    rows = sorted(sockets.items())
    line = json.dumps(order).encode() + b"\n"
    # One that hangs must not hold up the stop of the others: nothing is asked before.
    with ThreadPoolExecutor(max(len(rows), 1)) as pool:
        answers = list(pool.map(lambda row: _answer(row[1], line), rows))
        names = pool.map(lambda row: describe(*row), rows)
        return [(name, answer) for name, answer in zip(names, answers) if answer is not None]


def _answer(path: Path, line: bytes) -> dict[str, Any] | None:
    """The answer to an order; {"error": reason} where there is none, None: nobody is there."""
    try:
        return _check_words(exchange(path, line))
    except (ConnectionRefusedError, FileNotFoundError):
        return None
    except (OSError, ValueError) as error:
        return {"error": f"does not answer: {error}"}


def text_of(answer: Mapping[str, Any]) -> str:
    """What an order did, and whose run it was where that is another account's."""
    owner = f" (a run of {answer['user']}'s)" if "user" in answer else ""
    return f"{answer['text']}{owner}"


def held_robots() -> dict[int, Lease]:
    """All robots that a run has, in the folders that this account sees.

    UsageError: there are none, and some folder cannot be used.
    """
    from vsense.run import leases  # which a stop must not wait for

    places, reasons = folders()
    held = {tag: lease for place in places for tag, lease in leases.holders(place).items()}
    if not held and reasons:
        raise UsageError("\n".join(["no run has robots here", *reasons]))
    return held


def hand_over(
    tags: Collection[int], process: int | None, force: bool, console: Console
) -> tuple[list[int], list[int]]:
    """Ends the runs that have robots, and waits until the robots are free.

    Args:
        tags: of the robots that are wanted; none: all that one run has.
        process: of that run; None: the only one.
        force: a run that is going on ends, too.

    Returns:
        The robots that are free, and the processes that had them.

    Raises:
        UsageError: nobody has them, or it is not clear which are meant.
        TerminalError: a run refuses.
        HandoverError: they were not given back.
    """
    held = _wanted(held_robots(), tags, process)
    processes = sorted({lease.process for lease in held.values()})
    for number in processes:
        answer = ask({"ask": "handover", "force": force}, number)
        console.say(f"process {number} {text_of(answer)}")
    _wait(held, console)
    return sorted(held), processes


def _wanted(
    held: Mapping[int, Lease], tags: Collection[int], process: int | None
) -> dict[int, Lease]:
    if tags and process is not None:
        raise UsageError("robots and --process: one or the other")
    if not held:
        raise UsageError("no run has robots here")
    owners = {lease.process for tag, lease in held.items() if not tags or tag in tags}
    if process is not None:
        owners &= {process}
    if not owners:
        who = f"process {process} has no robots" if process is not None else "nobody has them"
        raise UsageError(f"{who}; there are:\n{holders_text(held)}")
    if len(owners) > 1 and not tags:
        raise UsageError(
            f"several runs have robots:\n{holders_text(held)}\nsay which, or --process PID"
        )
    # A run gives back all that it has.
    return {tag: lease for tag, lease in held.items() if lease.process in owners}


def _wait(wanted: Mapping[int, Lease], console: Console) -> None:
    end_s = time.monotonic() + HANDOVER_TIMEOUT_S
    while left := {tag: lease for tag, lease in held_robots().items() if wanted.get(tag) == lease}:
        if time.monotonic() > end_s:
            console.end_progress()
            raise HandoverError(f"{robots_are(left)} not given back: {next(iter(left.values()))}")
        console.progress(f"waiting for the end of that run: {robots_are(left)} still held")
        time.sleep(_POLL_S)
    console.end_progress()


def holders_text(held: Mapping[int, Lease]) -> str:
    """Who has which robots, in lines."""
    from vsense.run import leases

    if not held:
        return "no run has robots here"
    lines = (f"{robots_are(tags)} in use: {who}" for who, tags in leases.by_lease(held).items())
    return "\n".join(lines)


def robots_are(tags: Iterable[int]) -> str:
    """Robots in words, with their verb: "robots 23, 24 are"."""
    from vsense.run import leases

    return leases.robots(tags)
