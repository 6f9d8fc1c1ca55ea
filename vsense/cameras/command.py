"""The actions of the command `vsense cameras`."""

from __future__ import annotations

import argparse
import os
import sys

from vsense.cameras import init, listing, shooting, showing, tuning


def run(options: argparse.Namespace) -> int:
    """Runs an action.

    Raises:
        VsenseError: it cannot be done; one clear line.
    """
    actions = {
        "list": listing.run,
        "show": showing.run,
        "tune": tuning.run,
        "init": init.run,
        "shoot": shooting.run,
    }
    try:
        return actions[options.action or "list"](options)
    except BrokenPipeError:
        # Whoever read the output has seen enough, and nothing more can be written there.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
