"""The benchmarks' reports, as a table or as JSON."""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any

from vsense.bench import grabbing, identity, robot, tracking, world


def run(options: argparse.Namespace) -> int:
    """Runs a benchmark and prints its report; returns 0."""
    if options.subject == "tracking":
        report = tracking.run(options.rounds, options.pictures, options.walk, _say)
        text = table(report)
    elif options.subject == "identity":
        report = identity.run(options.timesteps, _say)
        text = identity.table(report)
    elif options.subject == "grabbing":
        report = grabbing.run(options.rounds, options.device, _say)
        text = grabbing.table(report)
    elif options.subject == "robot":
        report = robot.run(_say)
        text = robot.table(report)
    else:
        report = world.run(options.rounds, _say)
        text = world.table(report)
    print(json.dumps(_finite(report), indent=2) if options.json else text)
    return 0


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
    widths = [max(len(line[k]) for line in lines) for k in range(len(titles))]
    text = [
        "  ".join(
            cell.ljust(width) if k < 2 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    ]
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
    return "\n".join(text)


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
