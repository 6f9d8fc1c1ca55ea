"""The option `--roster` and what goes with it: who plays, and which boards are meant."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base.errors import UsageError
from vsense.commands import _arguments
from vsense.config import roster
from vsense.config.casting import Casting, pair
from vsense.config.roster import FILE_NAME, Roster, RosterRobot

if TYPE_CHECKING:
    from vsense.robots.deploying import RobotHost

HERE = f"(default: {FILE_NAME} in the current folder, where there is one)"


MARKERS = "the lab's robots: where it says how a marker sits on one, poses are the robot's"


def add_roster(parser: argparse.ArgumentParser, text: str, default: str = HERE) -> None:
    """Declares `--roster`; `default` says which one it is where none is named."""
    _arguments.option(parser, "--roster", Path, "FILE", f"{text} {default}".strip())


def roster_of(options: argparse.Namespace, here: bool = True) -> Roster | None:
    """Reads the roster that is meant; None: none is. Raises as `find_roster`."""
    return roster.find_roster(options.roster, here)


def wanted_roster(options: argparse.Namespace) -> Roster:
    """Reads the roster, which there has to be; raises as `require_roster`."""
    return roster.require_roster(options.roster)


def add_casting(parser: argparse.ArgumentParser, default: str = HERE) -> None:
    """Declares who plays: `--roster` and `--replace`; for `default` see `add_roster`."""
    add_roster(
        parser,
        f"{MARKERS}, and those that work and are no spares, in their order, take the roles to"
        " which the experiment gives no tags",
        default,
    )
    add_replace(parser, "23=37: robot 37 takes the role of 23, with its controller, start and name")


def add_replace(parser: argparse.ArgumentParser, text: str) -> None:
    """Declares `--replace`."""
    _arguments.repeated(parser, "--replace", tag_pair, "TAG=TAG", f"{text}; may be given again")


tag_pair = _arguments.parsed(pair)
"""Reads "23=37" as an option's value."""


def casting_of(options: argparse.Namespace, here: bool) -> Casting:
    """Who plays; raises as `roster_of`."""
    limit = getattr(options, "robots", None)
    return Casting.of(roster_of(options, here), options.replace, limit)


def add_tags(parser: argparse.ArgumentParser) -> None:
    """Declares which robots of a roster are meant."""
    text = (
        "these robots of the roster only, such as 23,30-34 (default: all but those that are"
        " out of order)"
    )
    _arguments.option(parser, "--tags", _arguments.numbers, "TAGS", text)


def chosen(
    roster: Roster, tags: Collection[int] | None, say: Callable[[str], None]
) -> list[RosterRobot]:
    """The robots that `--tags` names, or all that are not out of order, of which the rest is told.

    Raises:
        UsageError: the roster has no robot of such a tag, or all are out of order.
    """
    if tags is not None:
        for tag in tags:
            if tag not in roster.tags:
                there = ", ".join(map(str, roster.tags))
                raise UsageError(f"--tags {tag}: {roster.path} has {there}")
        return [robot for robot in roster.robots if robot.tag in tags]
    for robot in roster.robots:
        if robot.out_of_order:
            say(f"{robot} is left out: {robot.why_not} (--tags {robot.tag} brings it in)")
    working = [robot for robot in roster.robots if not robot.out_of_order]
    if not working:
        raise UsageError(f"{roster.path}: all robots are out of order; --tags names some")
    return working


def board_of(roster: Roster, robot: RosterRobot) -> RobotHost:
    """What `vsense robot deploy` knows of a robot: how it is reached, and vsensed's settings.

    Raises:
        ConfigError: what was measured of it is nothing that vsensed takes.
    """
    from vsense.robots.deploying import RobotHost  # a simulation asks no board

    board = {_SETTINGS.get(name, name): value for name, value in robot.board.items()}
    own = {"tag": str(robot.tag), "name": robot.name, "uid": robot.uid}
    settings = {name: value for name, value in own.items() if value}
    return RobotHost(robot.host, {**settings, **board, **roster.settings_of(robot)}, robot.line)


_SETTINGS = {"run_host": "host", "battery_stop_mv": "battery-stop-mv"}
"""Settings of vsensed that have another name in a roster."""


def boards(
    roster: Roster, tags: Collection[int] | None, say: Callable[[str], None]
) -> list[RobotHost]:
    """The boards of the `chosen` robots; without `--tags` of those whose host is known yet.

    Raises:
        UsageError: as `chosen`; or the roster does not say how one that is named, or any, is
            reached.
    """
    robots = chosen(roster, tags, say)
    reached = [robot for robot in robots if robot.host]
    if tags is not None or not reached:
        for robot in robots:
            check_host(roster, robot)
    if left := [str(robot.tag) for robot in robots if not robot.host]:
        say(f"without a host in {roster.path}, and left out: {', '.join(left)}")
    return [board_of(roster, robot) for robot in reached]


def check_host(roster: Roster, robot: RosterRobot) -> None:
    """Raises UsageError where the roster does not say how a robot is reached."""
    if not robot.host:
        raise roster.error(robot, 'no host for this robot: add host = "root@ADDRESS"')
