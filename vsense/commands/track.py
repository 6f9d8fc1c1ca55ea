"""`vsense camera track`: from cameras or recordings to arena states."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.commands import _arguments, _experiments, _hardware, _rosters
from vsense.modes.live import track

DESCRIPTION = (
    "Finds and follows every robot in the pictures of cameras or recordings, and prints one arena"
    " state per timestep. The resources file says which picture sources, trackers and cameras there"
    " are, the experiment file which of them to use. Lengths are in m, angles in rad, times in ns."
    " Page, keys and vsense control start, pause, stop and reset begin, suspend and end runs: what"
    " lies between is printed and recorded. With --web and cameras a stop leaves them in the page,"
    " and a start begins the next run; else tracking ends with the run."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _arguments.add_tracking_files(parser, optional=True)
    text = "work on a recording as fast as possible, not at the pace of its pictures"
    _arguments.flag(parser, "--offline", text)
    text = "jsonl: one object per timestep (default); csv: one row per robot and timestep"
    _arguments.choice(parser, "--format", ("jsonl", "csv"), text, "jsonl")
    _arguments.flag(
        parser, "--json", "print no states, but at the end the run's figures as one JSON object"
    )
    text = "draw the last state: the cameras' pictures with every robot's ring, heading and id"
    _arguments.option(parser, "--snapshot", Path, "PNG", text)
    _arguments.option(parser, "--frames", _arguments.natural, "N", "end after N timesteps of runs")
    text = (
        "folder for what runs leave: figures, and recordings (default: none; where something"
        " is recorded, runs/...)"
    )
    _arguments.option(parser, "-o --output", Path, "DIR", text)
    _rosters.add_roster(parser, _rosters.MARKERS)
    _experiments.add_doors(parser)
    group = _experiments.add_hold(
        parser,
        "track, but begin no run by itself: a key, the page or vsense control start does; after a"
        " run wait for the next one, until Ctrl-C. A recording begins again with each run",
    )
    _experiments.add_recording(group)


def run(options: argparse.Namespace) -> int:
    """Tracks; see `vsense.modes.live.track.run`."""
    room, markers = _experiments.room_of(options, "runs", "locked"), _hardware.markers_of(options)
    return track.run(_arguments.fill(track.TrackOptions, options, room=room, markers=markers))
