"""`vsense robot list` and `robot status --roster`: the roster, and how its robots are now."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from vsense.base.terminal import aligned, print_data
from vsense.commands import _arguments, _rosters, orders
from vsense.config import battery_history
from vsense.config.battery_history import BatteryRow
from vsense.config.roster import Roster, RosterRobot
from vsense.monitor.ui import control_client
from vsense.robots import boards

EMPTY_V = 3.4
"""Where the roster has no battery_stop_mv, an e-puck's battery is taken to be empty here."""

_PROGRAM = re.compile(
    r"vsensed (?P<version>\S+), controller (?P<controller>\S+)(?: (?P<hash>\S+))?"
)
"""What `vsensed --version` prints."""


@dataclass(frozen=True, slots=True)
class RobotNow:
    """How a robot is now.

    Attributes:
        text: whether it is there, in words.
        part: what it plays in the run that goes on; "": nothing.
        battery_v: as it tells; None: it does not.
        trouble: what is wrong with it; "": nothing is known to be.
        data: for programs.
    """

    text: str
    part: str = ""
    battery_v: float | None = None
    trouble: str = ""
    data: Mapping[str, Any] | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    _rosters.add_roster(parser, "whose robots")
    _arguments.flag(parser, "--json", "print the table as JSON")


def add_status(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of `robot status`."""
    orders.add_process(parser)
    _rosters.add_roster(
        parser,
        "show all robots of this roster: role, link and battery as the running experiment reports"
        " them, or where none runs, whether each board answers ssh and runs vsensed; and what the"
        " roster knows of each (default: only those of the running experiment)",
        default="",
    )
    _arguments.flag(parser, "--json", "print the table as JSON")


def run(options: argparse.Namespace) -> int:
    """Prints the roster."""
    return _print(_rosters.wanted_roster(options), None, options.json)


def status(options: argparse.Namespace) -> int:
    """Prints the robots of the running experiment, or with `--roster` those of a roster."""
    roster = _rosters.roster_of(options, here=False)
    if roster is None:
        return orders.robots(options)
    runs = control_client.alive()
    if options.process is None and not runs:
        now = boards_now(roster)
    else:
        now = run_now(control_client.ask({"ask": "status"}, options.process)["robots"])
    return _print(roster, now, options.json)


def _print(roster: Roster, now: Mapping[int, RobotNow] | None, as_json: bool) -> int:
    history = battery_history.read(battery_history.history_of(roster.path))
    if as_json:
        print_data(json.dumps([_facts(robot, history, now) for robot in roster.robots], indent=2))
    else:
        print_data(table(roster, history, now))
    return 0


def run_now(columns: Mapping[str, Sequence[Any]]) -> dict[int, RobotNow]:
    """What a running experiment tells of its robots, in the columns of `/robots`."""
    return {row["tag"]: _now(row) for row in orders.by_robot(columns)}


def _now(row: Mapping[str, Any]) -> RobotNow:
    heard_ms, seen = row["heard_ms"], "" if row["seen"] else ", not seen"
    link = f"link {heard_ms:.0f} ms" if row["connected"] and heard_ms is not None else "connected"
    there = link if row["connected"] else "link lost" if row["sessions"] else "not connected"
    millivolts, trouble = row["battery_mv"], str(row["trouble"] or "")
    volts = millivolts / 1e3 if millivolts else None
    words = trouble if row["connected"] or not trouble.startswith(("not conn", "link lost")) else ""
    return RobotNow(f"{there}{seen}", str(row["name"]), volts, words, row)


def boards_now(
    roster: Roster, call: Callable[[Sequence[str]], tuple[int, str]] = boards.call
) -> dict[int, RobotNow]:
    """Asks all boards at once whether they are there, and whether vsensed runs on them.

    `call` runs a command, and gives its exit code and what it said.
    """
    asked = [robot for robot in roster.robots if robot.host]
    words = (
        "if p=$(pidof vsensed); then /proc/${p%% *}/exe --version; echo runs; else echo stands; fi"
    )
    answers = boards.call_all([boards.ssh_command(robot.host, (), words) for robot in asked], call)
    return {robot.tag: _answer(robot, *answer) for robot, answer in zip(asked, answers)}


def _answer(robot: RosterRobot, code: int, said: str) -> RobotNow:
    if code:
        return RobotNow("no answer", trouble=boards.ssh_advice(robot.host, said.splitlines()) or "")
    is_on = said.split()[-1:] == ["runs"]
    runs = _PROGRAM.search(said)
    text = "on, vsensed runs" if is_on else "on, no vsensed"
    return RobotNow(text, data=runs.groupdict() if is_on and runs else None)


def table(
    roster: Roster, history: Sequence[BatteryRow], now: Mapping[int, RobotNow] | None = None
) -> str:
    """A line for each robot: whether it plays, what was measured of it, and its battery.

    With `now` how it is now, too: robots that are not in it play no part.
    """
    last = battery_history.last(history)
    more = () if now is None else ("part", "now", "battery now", "lasts")
    head = ("tag", "name", *more, "host", "base", "calibrated", "marker", "battery", "")
    rows: list[tuple[str, ...]] = [head]
    for robot in roster.robots:
        calibration, marker = robot.calibration, robot.marker
        is_now = None if now is None else now.get(robot.tag, _ABSENT)
        rows.append(
            (
                str(robot.tag),
                robot.name or "-",
                *(() if is_now is None else _now_cells(is_now, robot, history)),
                robot.host or ("this machine" if robot.is_driven_here else "-"),
                robot.base or "-",
                (calibration.when or "yes") if calibration.settings else "no",
                "-" if marker is None else f"{marker.text}{f' {marker.when}' * bool(marker.when)}",
                _battery(last.get(robot.tag)),
                "; ".join(filter(None, (robot.why_not.removeprefix("a "), _trouble(is_now)))),
            )
        )
    ready = sum(robot.is_ready for robot in roster.robots)
    lines = [*aligned(rows), f"{ready} of {len(roster.robots)} robots can be taken"]
    programs = {r.name or str(r.tag): (now or {}).get(r.tag, _ABSENT).data for r in roster.robots}
    known = {name: data for name, data in programs.items() if data is not None}
    return "\n".join([*lines, *orders.mixed_daemons(known)])


_ABSENT = RobotNow("-")


def _trouble(now: RobotNow | None) -> str:
    return "" if now is None else now.trouble


def _now_cells(
    now: RobotNow, robot: RosterRobot, history: Iterable[BatteryRow]
) -> tuple[str, str, str, str]:
    volts, minutes = now.battery_v, _minutes(now, robot, history)
    lasts = "-" if minutes is None else f"{minutes:.0f} min"
    return now.part or "-", now.text, "-" if volts is None else f"{volts:.2f} V", lasts


def _minutes(
    now: RobotNow | None, robot: RosterRobot, history: Iterable[BatteryRow]
) -> float | None:
    """How long its battery lasts, by the runs before; None: not known."""
    if now is None or now.battery_v is None:
        return None
    stop_mv = int(robot.board.get("battery_stop_mv", "0"))
    empty_v = stop_mv / 1e3 if stop_mv else EMPTY_V
    return battery_history.minutes_left(history, robot.tag, now.battery_v, empty_v)


def _battery(row: BatteryRow | None) -> str:
    """The last known voltage, and when that was."""
    if row is None:
        return "-"
    volts = row.begin_v if row.end_v is None else row.end_v
    return f"{'?' if volts is None else f'{volts:.2f} V'} {row.time[:16].replace('T', ' ')}"


def _facts(
    robot: RosterRobot, history: Sequence[BatteryRow], now: Mapping[int, RobotNow] | None
) -> dict[str, Any]:
    battery = battery_history.last(history).get(robot.tag)
    is_now = None if now is None else now.get(robot.tag, _ABSENT)
    minutes = _minutes(is_now, robot, history)
    now_facts = {} if is_now is None else {
        "now": {
            "text": is_now.text,
            "part": is_now.part or None,
            "battery_v": is_now.battery_v,
            "battery_minutes": None if minutes is None else round(minutes, 1),
            "trouble": is_now.trouble or None,
            "run": is_now.data,
        }
    }  # fmt: skip
    return {
        "tag": robot.tag,
        "name": robot.name or None,
        "host": robot.host or None,
        "driven_here": robot.is_driven_here,
        "uid": robot.uid or None,
        "base": robot.base or None,
        "spare": robot.spare,
        "out_of_order": robot.out_of_order or None,
        "calibration": {**robot.calibration.settings, "when": robot.calibration.when or None},
        "marker": None if robot.marker is None else robot.marker.values,
        "battery": None
        if battery is None
        else {name: getattr(battery, name) for name in battery_history.BATTERY_COLUMNS},
        **now_facts,
    }
