"""`vsense status`, `start`, `stop`, `replace` and their like: to a running experiment."""

from __future__ import annotations

import argparse
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
from vsense.base.terminal import Console, aligned, print_data
from vsense.commands import COMMANDS, arguments
from vsense.monitor.ui.control_socket import TRACKER, folders

DESCRIPTION = (
    "Talks to the `vsense run` or `vsense lab` that this user, or another member of its lab (see"
    " `vsense share`), runs on this machine, or, where there is none, to its `vsense track`. Orders"
    " from here, from its keyboard and from the page are the same, and all see them."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of all six."""
    name = parser.prog.split()[-1]
    text = COMMANDS[name][1]
    parser.description = f"{text[:1].upper()}{text[1:]}. {DESCRIPTION}"
    if name == "replace":
        parser.add_argument(
            "pair",
            type=_tag_pair,
            metavar="TAG=TAG",
            help="23=37: robot 37 plays the part of 23 from the next run on, with its controller,"
            " start and name; refused while a run goes on",
        )
    add_process(parser)
    arguments.flag(parser, "--json", "print the answer as one JSON object")
    if name == "stop":
        parser.add_argument(
            "--emergency",
            action="store_true",
            help="stop all robots now, whatever the run is doing; only a reset ends it",
        )
        arguments.flag(
            parser,
            "--all",
            "stop every experiment on this machine that this user runs, or a member of its lab",
        )


def _tag_pair(text: str) -> tuple[int, int]:
    from vsense.commands.rosters import tag_pair  # which a stop must not wait for

    return tag_pair(text)


def add_process(parser: argparse.ArgumentParser) -> None:
    """Declares which experiment is meant."""
    arguments.option(
        parser, "--process", arguments.process, "PID", "its process number, where several run"
    )


PATIENCE_S = 5.0
_MOST_BYTES = 1 << 24
BRIEF_S = 0.5
"""For who is asked what it is, while somebody wants to stop it."""


_NOTHING_RUNS = (
    "no experiment runs on this machine: start one with vsense run or vsense lab, or only track"
    " robots with vsense track"
)


class TerminalError(VsenseError):
    """The running experiment does not answer, or refuses."""


def run(options: argparse.Namespace) -> int:
    """Asks the running experiment, or gives it an order."""
    if options.command == "status":
        answer = ask({"ask": "status"}, options.process)
        print_data(json.dumps(answer, indent=2) if options.json else table(answer))
        return 0
    kind = "emergency" if getattr(options, "emergency", False) else options.command
    order: dict[str, Any] = {"order": kind, "by": "terminal"}
    if options.command == "replace":
        order["pair"] = list(options.pair)
    if getattr(options, "all", False):
        return _order_all(order, options)
    answer = ask(order, options.process)
    print_data(json.dumps(answer) if options.json else text_of(answer))
    return 0


def text_of(answer: Mapping[str, Any]) -> str:
    """What an order did, and whose run it was where that is another account's."""
    whose = f" (a run of {answer['user']}'s)" if "user" in answer else ""
    return f"{answer['text']}{whose}"


def _order_all(order: Mapping[str, Any], options: argparse.Namespace) -> int:
    """Gives an order to all experiments at once.

    1 where one does not answer, or refuses, and where there may be some that are not reached.
    """
    if options.process is not None:
        raise UsageError("--all and --process: one or the other")
    sockets, reasons = _sockets()
    found = sorted(sockets.items())
    line = json.dumps(order).encode() + b"\n"
    # One that hangs must not hold up the stop of the others: nothing is asked before.
    with ThreadPoolExecutor(max(len(found), 1)) as pool:
        given = zip(found, pool.map(lambda one: _obeyed(one[1], line), found))
        answers = {number: answer for (number, _), answer in given if answer is not None}
        names = dict(pool.map(lambda one: (one[0], told(*one)), found))
    if not answers:
        raise UsageError("\n".join([_NOTHING_RUNS, *reasons]))
    for reason in reasons:
        Console().say(f"vsense: runs of others were not reached: {reason}", "trouble")
    if options.json:
        print_data(json.dumps({str(number): answer for number, answer in answers.items()}))
    else:
        rows = [(*names[number][:4], _became(answer)) for number, answer in answers.items()]
        print_data("\n".join(aligned(rows)))
    failed = any("error" in a and not _is_idle(a) for a in answers.values())
    return int(failed or bool(reasons))


def _became(answer: Mapping[str, Any]) -> str:
    """What became of a stop."""
    if "error" not in answer:
        return str(answer["text"])
    return f"{'nothing to stop' if _is_idle(answer) else 'NOT STOPPED'}: {answer['error']}"


def _is_idle(answer: Mapping[str, Any]) -> bool:
    """Whether a run refuses a stop because nothing of it moves."""
    return str(answer["error"]).startswith("cannot stop: ")


def _obeyed(path: Path, line: bytes) -> dict[str, Any] | None:
    """The answer to an order; {"error": reason} where there is none, None: nobody is there."""
    try:
        return exchange(path, line)
    except (ConnectionRefusedError, FileNotFoundError):
        return None
    except (OSError, ValueError) as error:
        return {"error": f"does not answer: {error}"}


def robots(options: argparse.Namespace) -> int:
    """Shows the robots of the running experiment."""
    answer = ask({"ask": "status"}, options.process)
    rows = answer["robots"]
    shown = seen_table if answer["command"] == "track" else robot_table
    print_data(json.dumps(rows, indent=2) if options.json else shown(rows))
    return 0


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
    rows = [told(number, path) for number, path in sorted(found.items())]
    return "\n".join([f"{len(rows)} experiments run:", *(f"  {row}" for row in aligned(rows))])


def told(number: int, path: Path) -> tuple[str, ...]:
    """A running experiment in words, as far as it answers."""
    try:
        answer = exchange(path, b'{"ask": "status"}\n', BRIEF_S)
        port = f"robots' port {answer['port']}" if "port" in answer else ""
        now = answer["run"]
        age = f"run {now['run']} {now['state']}, {now['time_s']:.0f} s"
        command, where = f"vsense {answer['command']}{_whose(answer)}", str(answer["directory"])
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


def table(answer: Mapping[str, Any]) -> str:
    """The state of the run and its robots for a person."""
    now, rows = answer["run"], answer["robots"]
    length = "" if now["length_s"] is None else f" of {now['length_s']:g}"
    late = f", {now['late']} late" if now["late"] else ""
    latency = now["latency_ms"]
    sent = "" if latency is None else f", capture to sent {latency['p50']:.0f} ms"
    silent = f"\nno arena state for {now['silent_s']:.1f} s" if now["silent_s"] else ""
    which = _of_series(answer["series"]) if "series" in answer else f"run {now['run']}"
    head = f"{answer['name']}{_whose(answer)}: {which} is {now['state']}"
    return (
        f"{head}, {now['time_s']:.1f}{length} s,"
        f" timestep {now['timestep']}{late}; {now['rate_hz']:.1f} Hz{sent}{silent}{_kept(now)}\n\n"
        f"{seen_table(rows) if answer['command'] == 'track' else robot_table(rows)}"
    )


def _of_series(told: Mapping[str, Any]) -> str:
    """Which run of a series by plan it is."""
    again = f", attempt {told['attempt']}" if told["attempt"] > 1 else ""
    return (
        f"run {told['number']} of {told['of']} of the series {told['name']} ({told['condition']},"
        f" start {told['start']}, repetition {told['repetition']}{again})"
    )


def _whose(answer: Mapping[str, Any]) -> str:
    """Whose run it is, where it is another account's."""
    user = answer.get("user", user_name())
    return "" if user == user_name() else f", {user}'s"


def _kept(now: Mapping[str, Any]) -> str:
    """Where the run is recorded, if it is."""
    made = now.get("recording") or {}
    trouble = f"\nrecording in trouble: {made['trouble']}" if made.get("trouble") else ""
    if not made.get("on"):
        return trouble
    return f"\nrecording to {made['file']}, {made['bytes'] / 1e6:.1f} MB{trouble}"


def seen_table(rows: Mapping[str, list[Any]]) -> str:
    """A line for each robot that is only tracked."""
    columns = zip(*(rows[name] for name in ("tag", "x_m", "y_m", "yaw_rad", "seen")), strict=True)
    lines = [
        (str(tag), f"{x_m:.3f}", f"{y_m:.3f}", f"{yaw_rad:.2f}", "yes" if seen else "lost")
        for tag, x_m, y_m, yaw_rad, seen in columns
    ]
    return "\n".join(aligned([("tag", "x [m]", "y [m]", "yaw [rad]", "seen"), *lines]))


def robot_table(rows: Mapping[str, list[Any]]) -> str:
    """A line for each robot."""
    head = (
        *("robot", "tag", "software", "controller", "link", "signal", "pose", "battery"),
        *("base errors", ""),
    )
    robots = ({key: rows[key][n] for key in rows} for n in range(len(rows["tag"])))
    mixed = len(set(rows["expected"])) > 1
    return "\n".join(aligned([head, *(_cells(robot, mixed) for robot in robots)]))


def _cells(robot: Mapping[str, Any], mixed: bool) -> tuple[str, ...]:
    """A robot's line; in a mixed swarm with the controller that the experiment has for it."""
    runs = " ".join(filter(None, (robot["controller"], robot["hash"]))) or "-"
    battery_mv = robot["battery_mv"]
    battery = {True: "low", False: "ok", None: "-"}[robot["battery_low"]]
    return (
        robot["name"],
        str(robot["tag"]),
        robot["version"] or "-",
        f"{robot['expected']}: {runs}" if mixed else runs,
        _age(robot["heard_ms"]) if robot["connected"] else "lost" if robot["sessions"] else "never",
        "-" if robot.get("signal_dbm") is None else f"{robot['signal_dbm']} dBm",
        _age(robot["pose_age_ms"]),
        f"{battery_mv / 1e3:.2f} V" if battery_mv else battery,
        "-" if robot["base_errors"] is None else str(robot["base_errors"]),
        f"{robot['trouble'] or robot['state']}"
        f"{', power saving is on' if robot.get('power_saving') else ''}"
        f"{', not authenticated' if robot['authenticated'] is False else ''}",
    )


def _age(milliseconds: float | None) -> str:
    return "-" if milliseconds is None else f"{milliseconds:.0f} ms"
