"""`vsense cameras list`: what is there."""

from __future__ import annotations

import argparse
import json
import sys

from vsense.cameras import table
from vsense.cameras.finding import find

NOTHING = (
    "no camera found. What to check:",
    "  power and cable: does the camera's lamp shine? PoE needs a switch or an injector for it.",
    "  network: is this host on the cameras' network (ip -4 addr)? A firewall passes UDP 3956?",
    "  /dev/video*: is there one, and are you in the group video (groups)?",
)


def run(options: argparse.Namespace) -> int:
    """Prints the table.

    Returns:
        0, also where there is none: then standard error tells what to check.
    """
    if sys.stderr.isatty():
        print("asking who is there ...", end="", file=sys.stderr, flush=True)
    found, missing = find()
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    if options.json:
        print(json.dumps([table.facts(camera) for camera in found], indent=2))
    elif found:
        print("\n".join(table.lines(found)))
    if missing:
        print(f"vsense: {missing}", file=sys.stderr)
    if not found:
        print("\n".join(NOTHING), file=sys.stderr)
    return 0
