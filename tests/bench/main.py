"""`scripts/bench SUBJECT`: what measures vsense itself, with its options and reports."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable
from typing import Any

from tests.bench import embedded, grabbing, homing, identity, robot, sim, tracking, world
from vsense.base.errors import VsenseError
from vsense.commands import _arguments

Options = argparse.Namespace

SUBJECTS: dict[str, tuple[Callable[[Options], dict[str, Any]], Callable[[Any], str], str]] = {
    "tracking": (
        lambda options: tracking.run(options.rounds, options.pictures, options.walk, _say),
        tracking.table,
        "renders pictures of 20 robots on a cluttered floor and lets vsense's detectors, cv2.aruco"
        " and, where they are installed, AprilTag 3 (pupil-apriltags), napa-vision and locus-tag"
        " find them, in turns, in one run",
    ),
    "identity": (
        lambda options: identity.run(options.timesteps, _say),
        identity.table,
        "tracks 20 robots below four cameras for a long time and judges every name",
    ),
    "world": (
        lambda options: world.run(options.rounds, _say),
        world.table,
        "times the virtual world's timestep for 15, 100 and 1000 robots with 24 light sensors each,"
        " and a simulation of the pollutant experiment",
    ),
    "sim": (
        lambda options: sim.run(options.rounds, _say),
        sim.table,
        "counts the robots that a simulation steps in a second of processor time, in the world in"
        " which it was compared with ARGoS",
    ),
    "homing": (
        lambda options: homing.run(_say, options.seeds),
        homing.table,
        "has robots drive from random places to random places, with wrong wheels, lost packets, a"
        " dead robot and one that is not seen for a while; with --lab as the first option by"
        " cameras, network and daemons",
    ),
    "grabbing": (
        lambda options: grabbing.run(options.rounds, options.device, _say),
        grabbing.table,
        "says what a GigE camera's pictures cost on top of finding markers in them, with Aravis'"
        " fake camera or your own (--device)",
    ),
    "embedded": (
        lambda options: embedded.run(_say),
        embedded.table,
        "says what flash, memory and stack a robot's end of the protocol takes on a Cortex-M4",
    ),
    "robot": (
        lambda options: robot.run(_say),
        robot.table,
        "says how large vsensed is on every kind of board, how much memory it holds, and how many"
        " instructions and system calls a control step takes",
    ),
}
"""By name: what measures, what makes its report text for a person, and what it does."""


def _count(default: int, text: str) -> dict[str, Any]:
    text = f"{text} (default: {default})"
    return {"type": _arguments.positive, "metavar": "N", "default": default, "help": text}


_ROUNDS = _count(5, "how often each detector or size of swarm takes its turn")
_OPTIONS: dict[str, dict[str, dict[str, Any]]] = {
    "tracking": {
        "--rounds": _ROUNDS,
        "--pictures": _count(8, "pictures of each kind of marker"),
        "--walk": _count(60, "pictures in the sequences of moving robots"),
    },
    "identity": {"--timesteps": _count(2500, "how many, of each marker family")},
    "world": {"--rounds": _ROUNDS},
    "sim": {"--rounds": _ROUNDS},
    "homing": {"--seeds": _count(homing.SEEDS, "from so many random places")},
    "grabbing": {
        "--rounds": _ROUNDS,
        "--device": {"metavar": "ID", "help": "a GigE camera's address, id or serial number"},
    },
    "embedded": {},
    "robot": {},
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench")
    subjects = parser.add_subparsers(dest="subject", required=True)
    for name, (_, _, description) in SUBJECTS.items():
        subject = subjects.add_parser(name, description=f"It {description}.")
        for option, settings in _OPTIONS[name].items():
            subject.add_argument(option, **settings)
        subject.add_argument(
            "--json", action="store_true", help="print the report as one JSON object"
        )
    return parser


def main(words: list[str] | None = None) -> int:
    """Measures one subject and prints its report."""
    options = _parser().parse_args(words)
    measure, table, _ = SUBJECTS[options.subject]
    try:
        report = measure(options)
    except VsenseError as error:
        print(f"scripts/bench {options.subject}: {error}", file=sys.stderr)
        return error.exit_code
    print(json.dumps(_finite(report), indent=2) if options.json else table(report))
    return 0


def _say(text: str) -> None:
    print(f"scripts/bench: {text}", file=sys.stderr, flush=True)


def _finite(value: Any) -> Any:
    """JSON has no NaN: what is not known becomes null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    sys.exit(main())
