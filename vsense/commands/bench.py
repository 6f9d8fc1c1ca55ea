"""`vsense bench`: how fast and how well, against the best of the others."""

from __future__ import annotations

import argparse

from vsense.commands import arguments
from vsense.errors import UsageError

HELP = "measure detectors, the tracker's names, cameras, the virtual world, the robots' daemon"

DESCRIPTION = (
    "'tracking' renders pictures of 20 robots on a cluttered floor and lets vsense's detectors,"
    " cv2.aruco and, if pupil-apriltags is installed, AprilTag 3 find them, in turns, in one run."
    " 'identity' tracks 20 robots below four cameras for a long time and judges every name."
    " 'world' times the virtual world's timestep for 15, 100 and 1000 robots with 24 light"
    " sensors each, and a simulation of the pollutant experiment. 'grabbing' says what a GigE"
    " camera's pictures cost on top of finding markers in them, with Aravis' fake camera or your"
    " own (--device). 'robot' says how large vsensed"
    " is on every kind of board, how much memory it holds, and how many instructions a control"
    " step takes."
)

_PICTURES = 8
_WALK = 60
_TIMESTEPS = 2500


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "subject",
        choices=["tracking", "identity", "grabbing", "world", "robot"],
        help="what is measured",
    )
    parser.add_argument(
        "--rounds",
        type=arguments.positive,
        default=5,
        metavar="N",
        help="how often each detector or size of swarm takes its turn (default: 5)",
    )
    parser.add_argument(
        "--pictures",
        type=arguments.positive,
        metavar="N",
        help=f"tracking: pictures of each kind of marker (default: {_PICTURES})",
    )
    parser.add_argument(
        "--walk",
        type=arguments.positive,
        metavar="N",
        help=f"tracking: pictures in the sequence of moving robots (default: {_WALK})",
    )
    parser.add_argument(
        "--timesteps",
        type=arguments.positive,
        metavar="N",
        help=f"identity: how many, of each marker family (default: {_TIMESTEPS})",
    )
    parser.add_argument(
        "--device", metavar="ID", help="grabbing: a GigE camera's address, id or serial number"
    )
    parser.add_argument("--json", action="store_true", help="print the report as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Runs the benchmark; see the `run` of `vsense.bench.tracking`, `.identity` and `.world`.

    Raises:
        UsageError: an option that the subject does not have.
    """
    for option, subject in (
        ("pictures", "tracking"),
        ("walk", "tracking"),
        ("timesteps", "identity"),
        ("device", "grabbing"),
    ):
        if options.subject != subject and getattr(options, option) is not None:
            raise UsageError(f"--{option}: 'vsense bench {options.subject}' has none")
    options.pictures, options.walk = options.pictures or _PICTURES, options.walk or _WALK
    options.timesteps = options.timesteps or _TIMESTEPS
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense.bench import output

    return output.run(options)
