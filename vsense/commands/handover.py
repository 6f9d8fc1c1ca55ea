"""`vsense handover`: has the run that holds the robots give them back."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Collection, Mapping
from typing import Any

from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console, print_data
from vsense.commands import arguments, orders
from vsense.monitor.ui.control_socket import folders
from vsense.run import leases
from vsense.run.leases import Lease

DESCRIPTION = (
    "Robots belong to one `vsense run` at a time, also between its runs. This ends the run that has"
    " them, in order: robots stop, recordings and figures are completed; then it waits until they"
    " are free. A run that is going on ends with --force only. Members of a lab hand over each"
    " other's (see `vsense share`). Without robots: all that one run has."
)

PATIENCE_S = 60.0
"""A run's figures and pictures may take so long after its end."""

_POLL_S = 0.1


class HandoverError(VsenseError):
    """The robots were not given back."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "robots",
        nargs="*",
        type=arguments.natural,
        metavar="TAG",
        help="the robots that are wanted",
    )
    orders.add_process(parser)
    arguments.flag(parser, "--force", "end a run that is going on, too; its wheels stop")
    arguments.flag(parser, "--list", "only say who has which robots")
    arguments.flag(parser, "--json", "print the answer as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Has robots handed over, and waits until they are."""
    held = _held()
    if options.list:
        rows = {str(tag): str(lease) for tag, lease in held.items()}
        print_data(json.dumps(rows, indent=2) if options.json else table(held))
        return 0
    held = _wanted(held, options.robots, options.process)
    processes = sorted({lease.process for lease in held.values()})
    for process in processes:
        answer = orders.ask({"ask": "handover", "force": options.force}, process)
        Console().say(f"process {process} {orders.text_of(answer)}")
    _wait(held)
    told: dict[str, Any] = {"free": sorted(held), "processes": processes}
    print_data(json.dumps(told) if options.json else f"{leases.robots(held)} free")
    return 0


def _held() -> dict[int, Lease]:
    """All robots that a run has, in the folders that this account sees."""
    places, reasons = folders()
    held = {tag: lease for place in places for tag, lease in leases.holders(place).items()}
    if not held and reasons:
        raise UsageError("\n".join(["no run has robots here", *reasons]))
    return held


def _wanted(
    held: Mapping[int, Lease], tags: Collection[int], process: int | None
) -> dict[int, Lease]:
    """Of the robots that are held those that are meant; UsageError where there are none."""
    if tags and process is not None:
        raise UsageError("robots and --process: one or the other")
    if not held:
        raise UsageError("no run has robots here")
    owners = {lease.process for tag, lease in held.items() if not tags or tag in tags}
    if process is not None:
        owners &= {process}
    if not owners:
        who = f"process {process} has no robots" if process is not None else "nobody has them"
        raise UsageError(f"{who}; there are:\n{table(held)}")
    if len(owners) > 1 and not tags:
        raise UsageError(f"several runs have robots:\n{table(held)}\nsay which, or --process PID")
    # A run gives back all that it has.
    return {tag: lease for tag, lease in held.items() if lease.process in owners}


def _wait(wanted: Mapping[int, Lease]) -> None:
    """Waits until nobody has these robots any more."""
    console, end_s = Console(), time.monotonic() + PATIENCE_S
    while left := {tag: lease for tag, lease in _held().items() if wanted.get(tag) == lease}:
        if time.monotonic() > end_s:
            console.end_progress()
            raise HandoverError(
                f"{leases.robots(left)} not given back: {next(iter(left.values()))}"
            )
        console.progress(f"waiting for the end of that run: {leases.robots(left)} still held")
        time.sleep(_POLL_S)
    console.end_progress()


def table(held: Mapping[int, Lease]) -> str:
    """Who has which robots."""
    if not held:
        return "no run has robots here"
    lines = (f"{leases.robots(tags)} in use: {who}" for who, tags in leases.by_lease(held).items())
    return "\n".join(lines)
