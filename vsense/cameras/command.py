"""The actions of the command `vsense cameras`."""

from __future__ import annotations

import argparse

from vsense.cameras import beginning, listing, showing, tuning


def run(options: argparse.Namespace) -> int:
    """Runs an action.

    Raises:
        VsenseError: it cannot be done; one clear line.
    """
    actions = {
        "list": listing.run,
        "show": showing.run,
        "tune": tuning.run,
        "init": beginning.run,
    }
    return actions[options.action or "list"](options)
