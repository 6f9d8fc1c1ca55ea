"""`vsense share`: how several accounts of this machine share one arena, and who does."""

from __future__ import annotations

import argparse
import json
import re
import shlex
from typing import Any

from vsense.base import sharing
from vsense.base.errors import UsageError
from vsense.base.sharing import LabFolder, NotMember
from vsense.base.terminal import print_data
from vsense.commands import _arguments
from vsense.run import leases

DESCRIPTION = (
    "Runs, robots and keys belong to a lab, not to an account: where an administrator has made the"
    " lab's folder, members of its Unix group see, pause, stop and hand over each other's runs, and"
    " use one key of the swarm. Without a folder this says what root types to make it; with one,"
    " its members and which of them has which robots. Nothing is changed."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "users", nargs="*", type=_name, metavar="USER", help="its members (default: you)"
    )
    text = f"the Unix group (default: {sharing.GROUP}, or that of the folder that is there)"
    _arguments.option(parser, "--group", _name, "NAME", text)
    _arguments.flag(parser, "--json", "print it as one JSON object")


def _name(text: str) -> str:
    """A name that a shell and useradd(8) take."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]{0,31}", text):
        raise argparse.ArgumentTypeError(f"{shlex.quote(text)}: expected the name of an account")
    return text


def run(options: argparse.Namespace) -> int:
    """Says what there is; 0, or 1 where there is no folder that this account may use."""
    reason, lab = "", None
    try:
        lab = sharing.lab()
    except NotMember as error:
        reason = str(error)
    if sharing.place() is None:
        raise UsageError(f"{sharing.ENVIRONMENT} is empty: this account shares nothing")
    if lab is None or options.users or options.group:
        return _say_how(options, lab, reason)
    facts = _facts(lab)
    print_data(json.dumps(facts, indent=2) if options.json else table(facts))
    return 0


def _say_how(options: argparse.Namespace, lab: LabFolder | None, reason: str) -> int:
    group = options.group or (sharing.GROUP if lab is None else lab.group)
    lines = [] if reason and not options.users else sharing.instructions(group, options.users)
    if options.json:
        print_data(json.dumps({"folder": None, "why": reason or None, "as_root": lines}, indent=2))
    elif reason and not options.users:
        print_data(reason)
    else:
        head = "as root, once; new members have to log in again:"
        print_data("\n".join([head, *(f"    {line}" for line in lines)]))
    return int(lab is None)


def _facts(lab: LabFolder) -> dict[str, Any]:
    """The folder, who shares it, and who has which robots."""
    held = leases.by_lease(leases.holders(lab.path))
    return {
        "folder": str(lab.path),
        "group": lab.group,
        "members": sharing.members(lab.gid),
        "runs": [{"robots": tags, "lease": str(lease)} for lease, tags in held.items()],
    }


def table(facts: dict[str, Any]) -> str:
    """The facts as a person reads them."""
    lines = [
        f"{facts['folder']}: group '{facts['group']}': {', '.join(facts['members']) or 'nobody'}"
    ]
    runs = facts["runs"]
    lines += [f"{leases.robots(row['robots'])} in use: {row['lease']}" for row in runs]
    return "\n".join(lines if runs else [*lines, "no run has robots"])
