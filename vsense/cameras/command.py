"""The actions of the command `vsense cameras`."""

from __future__ import annotations

import argparse

from vsense.cameras import listing


def run(options: argparse.Namespace) -> int:
    """Runs an action.

    Raises:
        VsenseError: it cannot be done; one clear line.
    """
    actions = {None: listing.run, "list": listing.run}
    return actions[options.action](options)
