"""`vsense camera serve`: the arena tracking server."""

from __future__ import annotations

import argparse

from vsense.commands import _arguments, _hardware, _rosters
from vsense.modes.live import serve

DESCRIPTION = (
    "Tracks robots as `vsense camera track` does and hands the arena state to clients over TCP, in"
    " the original system's protocol (ONE_SHOT, START_EXPERIMENT, STOP_EXPERIMENT), one client"
    " after another. A recording is played from its beginning in every run. Ends with Ctrl-C."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _arguments.add_tracking_files(parser)
    _rosters.add_roster(parser, _rosters.MARKERS)
    text = (
        "interface to listen on, 0.0.0.0: all (default: 127.0.0.1, this machine only): the"
        " original's protocol knows no keys, so any machine that reaches the port is served"
    )
    _arguments.option(parser, "--host", str, "ADDRESS", text, "127.0.0.1")
    text = "TCP port; 0 takes a free one (default: the experiment file's server_port)"
    _arguments.option(parser, "--port", _arguments.port, "P", text)


def run(options: argparse.Namespace) -> int:
    """Serves; see `vsense.modes.live.serve.run`."""
    markers = _hardware.markers_of(options)
    return serve.run(options.resources, options.experiment, options.host, options.port, markers)
