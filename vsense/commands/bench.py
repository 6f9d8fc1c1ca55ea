"""`vsense bench`: how fast and how well, against the best of the others."""

from __future__ import annotations

import argparse

from vsense.commands import arguments

HELP = "measure the detectors against OpenCV's and AprilTag's on this machine"

DESCRIPTION = (
    "Renders pictures of 20 robots on a cluttered floor and lets vsense's detectors, cv2.aruco"
    " and, if pupil-apriltags is installed, AprilTag 3 find them, in turns, in one run."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("subject", choices=["tracking"], help="what is measured")
    parser.add_argument(
        "--rounds",
        type=arguments.positive,
        default=5,
        metavar="N",
        help="how often each detector does its pictures (default: 5)",
    )
    parser.add_argument(
        "--pictures",
        type=arguments.positive,
        default=8,
        metavar="N",
        help="pictures of each kind of marker (default: 8)",
    )
    parser.add_argument(
        "--walk",
        type=arguments.positive,
        default=60,
        metavar="N",
        help="pictures in the sequence of moving robots (default: 60)",
    )
    parser.add_argument("--json", action="store_true", help="print the report as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Runs the benchmark; see `vsense.bench.tracking.run`."""
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense.bench import output

    return output.run(options)
