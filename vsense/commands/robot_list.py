"""`vsense robot list`: the roster as a table."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

from vsense.commands import arguments, rosters
from vsense.config import battery_history
from vsense.config.battery_history import BatteryRow
from vsense.config.roster import Roster, RosterRobot
from vsense.terminal import aligned, print_data


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    rosters.add_roster(parser, "whose robots")
    arguments.flag(parser, "--json", "print the table as JSON")


def run(options: argparse.Namespace) -> int:
    """Prints the roster."""
    known = rosters.wanted_roster(options)
    batteries = battery_history.last(battery_history.read(battery_history.history_of(known.path)))
    if options.json:
        rows = [_facts(robot, batteries.get(robot.tag)) for robot in known.robots]
        print_data(json.dumps(rows, indent=2))
    else:
        print_data(table(known, batteries))
    return 0


def table(known: Roster, batteries: Mapping[int, BatteryRow]) -> str:
    """A line for each robot: whether it plays, what was measured of it, and its last battery."""
    head = ("tag", "name", "host", "base", "calibrated", "marker", "battery", "")
    rows = [head]
    for robot in known.robots:
        calibration, marker = robot.calibration, robot.marker
        rows.append(
            (
                str(robot.tag),
                robot.name or "-",
                robot.host or "-",
                robot.base or "-",
                (calibration.when or "yes") if calibration.settings else "no",
                "-" if marker is None else f"{marker.text}{f' {marker.when}' * bool(marker.when)}",
                _battery(batteries.get(robot.tag)),
                robot.why_not.removeprefix("a "),
            )
        )
    ready = sum(robot.is_ready for robot in known.robots)
    return "\n".join([*aligned(rows), f"{ready} of {len(known.robots)} robots can be taken"])


def _battery(row: BatteryRow | None) -> str:
    """The last known voltage, and when that was."""
    if row is None:
        return "-"
    volts = row.begin_v if row.end_v is None else row.end_v
    return f"{'?' if volts is None else f'{volts:.2f} V'} {row.time[:16].replace('T', ' ')}"


def _facts(robot: RosterRobot, battery: BatteryRow | None) -> dict[str, Any]:
    """A robot for programs."""
    return {
        "tag": robot.tag,
        "name": robot.name or None,
        "host": robot.host or None,
        "uid": robot.uid or None,
        "base": robot.base or None,
        "spare": robot.spare,
        "out_of_order": robot.out_of_order or None,
        "calibration": {**robot.calibration.settings, "when": robot.calibration.when or None},
        "marker": None if robot.marker is None else robot.marker.values,
        "battery": None
        if battery is None
        else {name: getattr(battery, name) for name in battery_history.COLUMNS},
    }
