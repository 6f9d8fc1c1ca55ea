"""Identical runs of `vsense lab`, and how far their figures are from each other.

`scripts/bench spread` prints the table of `tests/bench/README.md`. The same seed gives the
same floor, starts, controllers' chance and noise; what remains is what real time leaves open: when
each process gets its turn, and so which picture a control step hears of.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vsense.modes.lab.truth import read_truth

FIGURES = {
    "rms error of places, mm": ("tracking", "position_rmse_mm"),
    "rms error of headings, deg": ("tracking", "heading_rmse_deg"),
    "markers named per timestep": ("tracking", "detected_mean"),
    "late timesteps": ("late_timesteps",),
    "fresh readings, share": ("sensing", "fresh_share"),
    "capture to sent, median, ms": ("latency_ms", "capture_to_sent", "p50"),
    "capture to wheels, median, ms": ("latency_ms", "capture_to_wheels", "p50"),
    "age wrong by, 99 %, ms": ("clock", "age_error_ms_p99"),
}
"""What is told of a run beside the experiment's own measures, and where its summary has it."""


def main(words: list[str] | None = None) -> int:
    """Runs the lab and prints the table."""
    options = _parser().parse_args(words)
    with tempfile.TemporaryDirectory(prefix="vsense-spread-") as folder:
        summaries, ends = [], []
        for number in range(options.runs):
            directory = Path(folder) / str(number)
            summaries.append(_run(options, directory))
            ends.append(read_truth(directory / "truth.bin")["poses"][-1, :, :2])
            print(f"run {number + 1} of {options.runs}", file=sys.stderr)
    print(table(summaries))
    away = np.linalg.norm(np.array(ends) - np.mean(ends, axis=0), axis=-1)
    rms_mm = 1e3 * float(np.sqrt((away**2).mean()))
    print(f"\nAt the end robots are {rms_mm:.0f} mm rms from their mean place over the runs.")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench spread", description=__doc__)
    parser.add_argument("experiment", nargs="?", default="aggregation")
    parser.add_argument("--runs", type=int, default=10, metavar="N")
    parser.add_argument("--duration", type=float, default=20.0, metavar="S")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--pace", default="1", metavar="P", help="as of vsense lab")
    return parser


def _run(options: argparse.Namespace, directory: Path) -> dict[str, Any]:
    words = ["lab", options.experiment, "--seed", str(options.seed), "--port", "0", "--json"]
    words += ["--duration", str(options.duration), "--pace", options.pace, "-o", str(directory)]
    done = subprocess.run([sys.executable, "-m", "vsense", *words], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{done.stderr}vsense lab has ended with {done.returncode}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def table(summaries: Iterable[Mapping[str, Any]]) -> str:
    """A Markdown table: of every measure its median, extremes and standard deviation."""
    rows: dict[str, list[float]] = {}
    for summary in summaries:
        for name, keys in FIGURES.items():
            value: Any = summary
            for key in keys:
                value = value[key]
            rows.setdefault(name, []).append(np.nan if value is None else value)
        for name, value in summary["measures"].items():
            rows.setdefault(name.replace("_", " "), []).append(value)
    lines = ["| measure | median | least | most | standard deviation |", "|---|--:|--:|--:|--:|"]
    for name, values in rows.items():
        spread = np.median(values), np.min(values), np.max(values), np.std(values, ddof=1)
        lines.append(f"| {name} | {' | '.join(f'{value:.4g}' for value in spread)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
