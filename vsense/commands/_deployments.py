"""What `vsense robot deploy` would do and has done, as tables and for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from vsense.base.terminal import aligned, print_data
from vsense.robots.deploying import Outcome, Part, Plan, RobotHost


def say_planned(plan: Plan, robots: Sequence[RobotHost], as_json: bool) -> None:
    """Prints what a plan would bring to robots."""
    planned = [_planned(plan, robot) for robot in robots]
    print_data(json.dumps(planned, indent=2) if as_json else _planned_table(planned))


def say(outcomes: Sequence[Outcome], as_json: bool) -> None:
    """Prints what became of robots."""
    facts = [_facts(outcome) for outcome in outcomes]
    print_data(json.dumps(facts, indent=2) if as_json else _table(outcomes))


def _planned(plan: Plan, robot: RobotHost) -> dict[str, Any]:
    """What a robot would be sent: facts for programs."""
    all_of_it = plan.part is Part.ALL
    return {
        "robot": robot.destination,
        "tag": int(robot.settings["tag"]),
        "vsensed_bytes": len(plan.binaries[robot.destination]) if plan.binaries else None,
        "settings": plan.settings_of(robot) if all_of_it else None,
        "driver": sorted(robot.files),
        "key": plan.brings_key(robot),
        "service": plan.kind if all_of_it else None,
        "check": plan.check,
        "part": plan.part.value or "all",
    }


def _planned_table(planned: Sequence[Mapping[str, Any]]) -> str:
    """A row for each robot, and what would be done on all."""
    rows = [("robot", "tag", "vsensed", "key", "settings")]
    binary, kept = "-", "stay"
    if planned[0]["part"] == Part.BACK.value:
        binary, kept = "the one before", "those before"
    for facts in planned:
        settings = facts["settings"] or {}
        rows.append(
            (
                facts["robot"],
                str(facts["tag"]),
                f"{facts['vsensed_bytes']} bytes" if facts["vsensed_bytes"] else binary,
                "a new one" if facts["key"] else "stays",
                " ".join(f"{name}={value}" for name, value in settings.items()) or kept,
            )
        )
    first = planned[0]
    deeds = {
        "rollback": "vsensed and its settings become those before the last deploy",
        "daemon": "/usr/local/bin/vsensed is replaced, and started again",
    }
    every = (
        "vsensed goes to /usr/local/bin, settings to /etc/vsensed.conf"
        f"{', a key to /etc/vsensed.key' * any(facts['key'] for facts in planned)};"
        f" it is started now and at each start ({first['service']}); the radio's power saving is"
        " turned off"
    )
    deed = deeds.get(first["part"], every)
    check = "; then vsensed --check" if first["check"] else ""
    return "\n".join([*aligned(rows), f"on each: {deed}{check}", "nothing was sent (--dry)"])


def _table(outcomes: Sequence[Outcome]) -> str:
    """A row for every robot, and below it the output of those that failed."""
    rows = [("robot", "tag", "", "")]
    rows += [
        (o.robot.destination, o.robot.settings["tag"], "ok" if o.ok else "FAILED", o.text)
        for o in outcomes
    ]
    head, *lines = aligned(rows)
    text = [head]
    for line, outcome in zip(lines, outcomes):
        text += [line] if outcome.ok else [line, *(f"    {said}" for said in outcome.details)]
    return "\n".join(text)


def _facts(outcome: Outcome) -> dict[str, Any]:
    return {
        "robot": outcome.robot.destination,
        "tag": int(outcome.robot.settings["tag"]),
        "ok": outcome.ok,
        "uid": outcome.uid or None,
        "text": outcome.text,
        "details": list(outcome.details),
    }
