"""The actions of the command `vsense robot`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from vsense.console import Console
from vsense.robot import building, deploying, hosts
from vsense.robot.deploying import Outcome, Plan
from vsense.room import terminal


def run(options: argparse.Namespace) -> int:
    """Runs an action.

    Returns:
        0, or 1 where a robot was not served.

    Raises:
        VsenseError: it cannot be done; one clear line.
    """
    actions = {"build": build, "deploy": deploy, "status": terminal.robots}
    return actions[options.action](options)


def build(options: argparse.Namespace) -> int:
    """Builds `vsensed` for a board and says what it is."""
    built = building.build(options.controller, options.target, options.output)
    facts: dict[str, Any] = {
        "path": str(built.path),
        "target": built.target,
        "size": built.size,
        "controller": str(built.controller),
        "hash": built.hash,
        "compiler": built.compiler,
    }
    if options.json:
        print(json.dumps(facts, indent=2))
    else:
        print(
            f"{built.path}: {built.size} bytes for {built.target},"
            f" controller {built.controller.name} {built.hash}"
        )
    return 0


def deploy(options: argparse.Namespace) -> int:
    """Brings `vsensed` to all robots of a list and prints a table of what became of them.

    Returns:
        0, or 1 where a robot has failed.
    """
    robots = hosts.read(options.hosts)
    settings = {"host": options.host, "port": str(options.port), "base": options.base}
    plan = Plan(
        deploying.load(options.binary),
        {name: value for name, value in settings.items() if value is not None},
        options.service,
        options.sudo,
        options.check,
    )
    deploying.check(plan, robots, str(options.hosts))
    console, done = Console(), [0]

    def told(outcome: Outcome) -> None:
        done[0] += 1
        console.progress(f"{done[0]} of {len(robots)}: {outcome.robot.destination}")

    outcomes = deploying.deploy(plan, robots, told)
    console.end_progress()
    print(json.dumps([_facts(o) for o in outcomes], indent=2) if options.json else table(outcomes))
    return 0 if all(outcome.ok for outcome in outcomes) else 1


def table(outcomes: list[Outcome]) -> str:
    """Returns a row for every robot, and what the failed ones said below it."""
    rows = [("robot", "tag", "", "")]
    rows += [
        (o.robot.destination, o.robot.settings["tag"], "ok" if o.ok else "FAILED", o.text)
        for o in outcomes
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = []
    for row, outcome in zip(rows, [None, *outcomes]):
        cells = "  ".join(cell.ljust(width) for cell, width in zip(row, widths))
        lines.append(f"{cells}  {row[3]}".rstrip())
        if outcome is not None and not outcome.ok:
            lines += [f"    {line}" for line in outcome.details]
    return "\n".join(lines)


def _facts(outcome: Outcome) -> dict[str, Any]:
    """An outcome for programs."""
    return {
        "robot": outcome.robot.destination,
        "tag": int(outcome.robot.settings["tag"]),
        "ok": outcome.ok,
        "text": outcome.text,
        "details": list(outcome.details),
    }
