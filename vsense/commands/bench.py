"""`vsense bench`: how fast and how well, against the best of the others."""

from __future__ import annotations

import argparse

from vsense.commands import arguments
from vsense.errors import UsageError

HELP = "measure the detectors, or the virtual world, on this machine"

DESCRIPTION = (
    "'tracking' renders pictures of 20 robots on a cluttered floor and lets vsense's detectors,"
    " cv2.aruco and, if pupil-apriltags is installed, AprilTag 3 find them, in turns, in one run."
    " 'world' times the virtual world's timestep for 15, 100 and 1000 robots with 24 light"
    " sensors each, and a simulation of the pollutant experiment."
)

_PICTURES = 8
_WALK = 60


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("subject", choices=["tracking", "world"], help="what is measured")
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
    parser.add_argument("--json", action="store_true", help="print the report as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Runs the benchmark; see `vsense.bench.tracking.run` and `vsense.bench.world.run`.

    Raises:
        UsageError: an option that the subject does not have.
    """
    for option in ("pictures", "walk"):
        if options.subject == "world" and getattr(options, option) is not None:
            raise UsageError(f"--{option}: 'vsense bench world' renders no pictures")
    options.pictures, options.walk = options.pictures or _PICTURES, options.walk or _WALK
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense.bench import output

    return output.run(options)
