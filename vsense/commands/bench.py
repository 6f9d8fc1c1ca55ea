"""`vsense bench`: how fast and how well, against the best of the others."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import aligned
from vsense.commands import arguments
from vsense.tools.bench import grabbing, homing, identity, robot, sim, tracking, trade_off, world

DESCRIPTION = (
    "'tracking' renders pictures of 20 robots on a cluttered floor and lets vsense's detectors,"
    " cv2.aruco and, if pupil-apriltags is installed, AprilTag 3 find them, in turns, in one run;"
    " and it tracks robots in pictures that are hard to read with several search plans, to show"
    " what they cost and find (the thesis's Table 2.1; -o draws it as figure 2.14)."
    " 'identity' tracks 20 robots below four cameras for a long time and judges every name."
    " 'world' times the virtual world's timestep for 15, 100 and 1000 robots with 24 light"
    " sensors each, and a simulation of the pollutant experiment. 'sim' counts the robots that a"
    " simulation steps in a second of processor time, in the world in which it was compared with"
    " ARGoS. 'homing' has robots drive from random places to random places, with wrong wheels, lost"
    " packets, a dead robot and one that is not seen for a while. 'grabbing' says what a GigE"
    " camera's pictures cost on top of finding markers in them, with Aravis' fake camera or your"
    " own (--device). 'robot' says how large vsensed"
    " is on every kind of board, how much memory it holds, and how many instructions and system"
    " calls a control step takes."
)

_PICTURES = 8
_WALK = 60
_TIMESTEPS = 2500
_ONLY = {
    **dict.fromkeys(("pictures", "walk", "output", "plans"), "tracking"),
    "timesteps": "identity",
    "seeds": "homing",
    "device": "grabbing",
}
"""Options that one subject has only."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "subject",
        choices=["tracking", "identity", "grabbing", "world", "sim", "homing", "robot"],
        help="what is measured",
    )
    parser.add_argument(
        "--rounds",
        type=arguments.positive,
        default=5,
        metavar="N",
        help="how often each detector or size of swarm takes its turn (default: 5)",
    )
    _add_tracking(parser)
    parser.add_argument(
        "--timesteps",
        type=arguments.positive,
        metavar="N",
        help=f"identity: how many, of each marker family (default: {_TIMESTEPS})",
    )
    parser.add_argument(
        "--seeds",
        type=arguments.positive,
        metavar="N",
        help=f"homing: from so many random places (default: {homing.SEEDS})",
    )
    parser.add_argument(
        "--device", metavar="ID", help="grabbing: a GigE camera's address, id or serial number"
    )
    parser.add_argument("--json", action="store_true", help="print the report as one JSON object")


def _add_tracking(parser: argparse.ArgumentParser) -> None:
    """Declares what only the subject tracking has."""
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
        help=f"tracking: pictures in the sequences of moving robots (default: {_WALK}, of the hard"
        f" ones {trade_off.TIMESTEPS})",
    )
    parser.add_argument(
        "--plans",
        action="store_true",
        default=None,
        help="tracking: only the search plans on hard pictures, which takes less than a minute",
    )
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        metavar="FILE",
        help="tracking: draw the search plans' times and robots (.png, .svg, .pdf)",
    )


def run(options: argparse.Namespace) -> int:
    """Runs a benchmark and prints its report; UsageError for an option of another subject."""
    for option, subject in _ONLY.items():
        if options.subject != subject and getattr(options, option) is not None:
            raise UsageError(f"--{option}: 'vsense bench {options.subject}' has none")
    if options.subject == "tracking":
        report, text = _tracking(options)
    elif options.subject == "identity":
        report = identity.run(options.timesteps or _TIMESTEPS, _say)
        text = identity.table(report)
    elif options.subject == "grabbing":
        report = grabbing.run(options.rounds, options.device, _say)
        text = grabbing.table(report)
    elif options.subject == "robot":
        report = robot.run(_say)
        text = robot.table(report)
    elif options.subject == "homing":
        report = homing.run(_say, options.seeds or homing.SEEDS)
        text = homing.table(report)
    elif options.subject == "sim":
        report = sim.run(options.rounds, _say)
        text = sim.table(report)
    else:
        report = world.run(options.rounds, _say)
        text = world.table(report)
    print(json.dumps(_finite(report), indent=2) if options.json else text)
    return 0


def _tracking(options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """Runs the benchmark of detectors and search plans; gives its report, also for a person."""
    report: dict[str, Any] = {}
    if options.output is not None:
        trade_off.require_drawing(options.output)
    if not options.plans:
        pictures, walk = options.pictures or _PICTURES, options.walk or _WALK
        report = tracking.run(options.rounds, pictures, walk, _say)
    text = f"{table(report)}\n\n" if report else ""
    rows = trade_off.run(options.rounds, options.walk or trade_off.TIMESTEPS, _say)
    if options.output is not None:
        trade_off.draw(rows, options.output)
        _say(f"chart: {options.output}")
    return report | {"search_plans": rows}, text + trade_off.table(rows)


def _say(text: str) -> None:
    print(f"vsense: bench: {text}", file=sys.stderr, flush=True)


def table(report: dict[str, Any]) -> str:
    """Returns the detectors' report for a person."""
    titles = ("detector", "frames", "threads", "ms/frame", "detected", "wrong ids", "rms px")
    lines = [titles]
    for row in report["rows"]:
        lines.append(
            (
                row["detector"],
                row["frames"],
                str(row["threads"]),
                f"{row['ms_per_frame']:.2f}",
                f"{100.0 * row['detected_share']:.2f} %",
                str(row["wrong_ids"]),
                f"{row['position_rms_px']:.3f}",
            )
        )
    text = aligned(lines, left=2)
    sixteen = report["set16"]
    text += [
        "",
        f"floor: one read of a picture {report['floor_ms']:.3f} ms,"
        f" one copy {report['memcpy_ms']:.3f} ms",
        f"16 cameras, 20 robots in total, {sixteen['threads']} threads:"
        f" {sixteen['ms']:.1f} ms, {sixteen['times_floor']:.1f} times the floor",
        f"faster than cv2.aruco with sub-pixel corners: {_times(report['ratio_to_aruco'])},"
        f" than its best tuning: {_times(report['ratio_to_aruco_tuned'])}",
        f"faster than AprilTag 3 (decimate 2): {_times(report['ratio_to_apriltag'])}",
    ]
    for dictionary, squares in report["squares"].items():
        text += [
            f"{dictionary}: {squares['ms_per_frame']:.2f} ms; faster than cv2.aruco with sub-pixel"
            f" corners: {_times(squares['ratio_to_aruco'])}, than its fastest setting:"
            f" {_times(squares['ratio_to_aruco_fastest'])}, than AprilTag 3:"
            f" {_times(squares['ratio_to_apriltag'])}"
        ]
    return "\n".join([*text, _whole(report["whole_tracker"])])


def _whole(whole: dict[str, float]) -> str:
    return (
        "whole tracker, 16 cameras x 20 robots, every picture searched:"
        f" arrows {whole['arrows_ms']:.1f} ms (of processor time {whole['arrows_cpu_ms']:.1f},"
        f" {100.0 * whole['c_share']:.0f} % in C), 36h11 {whole['squares_ms']:.1f} ms"
        f" ({whole['squares_cpu_ms']:.1f})"
    )


def _times(ratio: float | None) -> str:
    if ratio is None:
        return "not measured, install it with: pip install pupil-apriltags"
    return f"{ratio:.1f} times"


def _finite(value: Any) -> Any:
    """JSON has no NaN: what is not known becomes null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
