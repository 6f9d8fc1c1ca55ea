"""`vsense robot keys`: the swarm's keys, and which robots have which."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, aligned, print_data
from vsense.commands import _arguments, _experiments, _rosters
from vsense.robots import deploying, key_holders
from vsense.robots.deploying import Outcome, Part, Plan, RobotHost
from vsense.robots.key_holders import Holder
from vsense.robots.link import keys as swarm_keys
from vsense.robots.link.key_process import KeyProcess
from vsense.robots.link.keys import KeySource


def add_arguments(parser: argparse.ArgumentParser) -> None:
    _experiments.add_key(parser)
    text = (
        "make a swarm key: the first one, or one that follows it. Robots that it does not"
        " reach keep their older one, which the host still takes, and are named"
    )
    _arguments.flag(parser, "--new-key", text)
    _rosters.add_roster(
        parser,
        "bring the newest key to the robots of this roster whose daemons have a key already; their"
        " wheels stop for a moment (default: bring it nowhere)",
        default="",
    )
    _rosters.add_tags(parser)
    text = "take swarm key N out of the file: robots that still have it are refused from now on"
    _arguments.option(parser, "--forget", _arguments.positive, "N", text)
    add_reach(parser)


def add_reach(parser: argparse.ArgumentParser) -> None:
    """Declares how robots are reached, and how what became of them is printed."""
    add_ssh(parser)
    text = "replace it on robots that are in a running experiment, too; their wheels stop"
    _arguments.flag(parser, "--force", text)
    _arguments.flag(parser, "--json", "print the results as JSON")


def add_ssh(parser: Any) -> None:
    """Declares how robots are reached."""
    _arguments.flag(parser, "--sudo", "become root on the robots with sudo")
    text = (
        "what ssh gets with -o, such as HostKeyAlgorithms=+ssh-rsa for an old board; may"
        " be given several times"
    )
    _arguments.repeated(parser, "--ssh-option", str, "NAME=VALUE", text)


def bring(plan: Plan, options: argparse.Namespace, robots: Sequence[RobotHost]) -> list[Outcome]:
    """Deploys, and notes to whom a key was brought."""
    outcomes = _deploy(plan, robots)
    if plan.keys is not None:
        note(options, plan.keys, outcomes)
    return outcomes


def _deploy(plan: Plan, robots: Sequence[RobotHost]) -> list[Outcome]:
    """Deploys, and shows how far it is."""
    console, done = Console(), [0]

    def show(outcome: Outcome) -> None:
        done[0] += 1
        console.progress(f"{done[0]} of {len(robots)}: {outcome.robot.destination}")

    outcomes = deploying.deploy(plan, robots, show)
    console.end_progress()
    return outcomes


def holders_of(options: argparse.Namespace) -> Path:
    return key_holders.file_of(_experiments.key_path(options))


def renewing(plan: Plan, options: argparse.Namespace, robots: Sequence[RobotHost]) -> Plan:
    """A plan that brings the newest key, too, to those of the robots that have a former one."""
    path = _experiments.key_path(options)
    if not os.path.exists(path):
        return plan
    store, holders = KeyProcess(path), key_holders.read(holders_of(options))
    older = [holder for holder in holders if holder.key != store.newest]
    having = {(holder.destination, holder.tag) for holder in older}
    reached = [r for r in robots if (r.destination, int(r.settings["tag"])) in having]
    return replace(plan, keys=store, uids=key_holders.uids(older, reached)) if reached else plan


def note(options: argparse.Namespace, store: KeySource, outcomes: Sequence[Outcome]) -> None:
    """Notes to whom a key was brought, and forgets former ones that nobody needs any more."""
    holders = key_holders.note(holders_of(options), store.newest, outcomes)
    robots = [o.robot for o in outcomes]
    store, forgotten = key_holders.forget(_experiments.key_path(options), store, holders, robots)
    for line in said_of(forgotten, store):
        Console().say(line)


def run(options: argparse.Namespace) -> int:
    """Makes, brings and forgets swarm keys; then says which robots have which."""
    path = _experiments.key_path(options)
    if options.new_key:
        swarm_keys.follow(path)
    if not os.path.exists(path):
        raise UsageError(f"no swarm key ({path}): --new-key makes one")
    if options.forget is not None:
        _forget(path, options.forget)
    store: KeySource = KeyProcess(path)
    outcomes = [] if options.roster is None else _bring_keys(options, store)
    holders = key_holders.note(holders_of(options), store.newest, outcomes)
    store, forgotten = key_holders.forget(path, store, holders, [o.robot for o in outcomes])
    facts = {**_key_facts(path, store, holders), "forgotten": forgotten}
    text = key_table(path, store, holders, outcomes)
    text += "".join(f"\n{line}" for line in said_of(forgotten, store))
    print_data(json.dumps(facts, indent=2) if options.json else text)
    return 0 if all(outcome.ok for outcome in outcomes) else 1


def _forget(path: Path, number: int) -> None:
    """Takes a former key out of the file."""
    with swarm_keys.changing(path):
        store = swarm_keys.read(path)
        former = sorted(set(store.numbers) - {store.newest})
        if number not in former:
            # A key that follows would get the number of the newest: who was brought that could
            # not be told from who was brought the other.
            numbers = ", ".join(map(str, former)) or "none"
            raise UsageError(
                f"--forget: expected a key that another follows, there are: {numbers}; the newest"
                f" is {store.newest}: --new-key makes one that follows it"
            )
        swarm_keys.write(path, store.without(number))


def _bring_keys(options: argparse.Namespace, store: KeySource) -> list[Outcome]:
    """Brings the newest key to the robots of a list."""
    robots = _rosters.boards(_rosters.wanted_roster(options), options.tags, Console().say)
    plan = Plan(
        sudo=options.sudo,
        force=options.force,
        ssh_options=tuple(options.ssh_option),
        part=Part.KEY,
        keys=store,
        uids=key_holders.uids(key_holders.read(holders_of(options)), robots),
    )
    return _deploy(plan, robots)


def said_of(forgotten: Sequence[int], store: KeySource) -> list[str]:
    """What is told where former keys were forgotten."""
    return [
        f"key {number} is forgotten: all robots have key {store.newest}" for number in forgotten
    ]


def key_table(
    path: Path, store: KeySource, holders: Sequence[Holder], outcomes: Sequence[Outcome]
) -> str:
    """The swarm's keys, a row for every robot that was given one, and those with an older one."""
    numbers = ", ".join(map(str, sorted(store.numbers)))
    lines = [f"{path} holds key {numbers}; robots are brought key {store.newest}"]
    if holders:
        rows = [("robot", "tag", "key", "since", "uid")]
        rows += [(h.destination, str(h.tag), str(h.key), h.since, h.uid) for h in holders]
        lines += aligned(rows)
    lines += [
        f"{outcome.robot.destination}, tag {outcome.robot.settings['tag']}: {outcome.text}"
        for outcome in outcomes
        if not outcome.ok
    ]
    for holder in holders:
        if holder.key != store.newest:
            taken = "still takes" if holder.key in store.numbers else "refuses"
            lines.append(
                f"robot {holder.tag} ({holder.destination}) was not reached with key"
                f" {store.newest}: the host {taken} its key {holder.key}, until"
                " 'vsense robot keys --roster FILE' or 'vsense robot deploy' brings it"
            )
    return "\n".join(lines)


def _key_facts(path: Path, store: KeySource, holders: Sequence[Holder]) -> dict[str, Any]:
    return {
        "file": str(path),
        "keys": sorted(store.numbers),
        "newest": store.newest,
        "robots": [asdict(holder) for holder in holders],
    }
