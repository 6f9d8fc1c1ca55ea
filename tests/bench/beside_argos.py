"""`scripts/bench argos`: the simulator beside an installed ARGoS 3, in the same world, in turn.

It needs `argos3` on the PATH with the plug-in argos3-epuck (`ARGOS_PLUGIN_PATH`), its headers where
the compiler finds them (`CXXFLAGS=-I...` for another place), and a C++ compiler. The world is that
of `scripts/bench sim`, word by word; `wander.cpp` is its controller there. Each turn runs both with
each number of robots, twice: short and long. The rate is what the longer run did more, over the
processor time that it took more: so start-up, whose time is told apart, does not count.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.bench import sim

CONTROLLER = Path(__file__).parent / "wander.cpp"
STEPS = {"argos": 300_000, "vsense": 900_000}
"""Robots times timesteps of a long run, as many as take both about 2 s; of a short one, SHORT."""
SHORT = 3_000
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}


def for_argos(text: str, library: str, seconds: float) -> str:
    """The experiment file for ARGoS: without what only vsense knows."""
    text = re.sub(r"\s*<vs:rig>.*?</vs:rig>", "", text, flags=re.DOTALL)
    text = re.sub(r' (?:xmlns:vs|vs:\w+)="[^"]*"', "", text)
    text = re.sub(r"<virtual_light_sensor[^>]*/>", '<epuck_light implementation="default" />', text)
    text = re.sub(r'library="[^"]*"', f'library="{library}"', text)
    text = re.sub(r'length="[^"]*"', f'length="{seconds:g}"', text)
    return text.replace("<framework>", '<framework><system threads="0" />')


def cpu_s(command: Sequence[str]) -> float:
    """Processor time [s] of a command and its children; ends the program if it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ran = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **_ONE_THREAD})
    if ran.returncode:
        sys.exit(f"{shlex.join(command)}: {(ran.stdout + ran.stderr)[-2000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


class Contest:
    """Both simulators, ready to run in a folder."""

    def __init__(self, folder: Path) -> None:
        """Builds both controllers; ends the program where that cannot be."""
        if shutil.which("argos3") is None:
            sys.exit("there is no argos3 on the PATH")
        self._folder, self._library = folder, folder / "libwander.so"
        flags = ["-O3", "-std=c++17", "-fPIC", "-shared", *shlex.split(os.getenv("CXXFLAGS", ""))]
        cpu_s([os.getenv("CXX", "c++"), *flags, str(CONTROLLER), "-o", str(self._library)])
        self.spent_s("vsense", 15, 10)

    def spent_s(self, name: str, robots: int, timesteps: int) -> float:
        """Processor time of a run."""
        text, seconds = sim.experiment_text(robots), timesteps * sim.TIMESTEP_S
        path = self._folder / f"{name}.argos"
        if name == "argos":
            path.write_text(for_argos(text, str(self._library), seconds))
            return cpu_s(["argos3", "-z", "-c", str(path)])
        path.write_text(text)
        output = self._folder / "results.csv"
        output.unlink(missing_ok=True)
        words = ["sim", str(path), "--duration", f"{seconds:g}", "--runs", "1", "-j", "1"]
        return cpu_s([sys.executable, "-m", "vsense", *words, "-o", str(output)])

    def turn(self, name: str, robots: int) -> tuple[float, float]:
        """Robot-steps per second, and the processor time of the short run."""
        short, long = (max(steps // robots, 10) for steps in (SHORT, STEPS[name]))
        first_s = self.spent_s(name, robots, short)
        return robots * (long - short) / (self.spent_s(name, robots, long) - first_s), first_s


def rows_of(rates: dict[int, dict[str, list[float]]]) -> list[dict[str, Any]]:
    """The report: medians, and the ratio of each turn, from the least to the largest."""
    rows = []
    for robots, each in rates.items():
        ratios = sorted(ours / theirs for ours, theirs in zip(each["vsense"], each["argos"]))
        medians = {f"{name}_robot_steps_per_s": statistics.median(each[name]) for name in STEPS}
        median = medians["vsense_robot_steps_per_s"] / medians["argos_robot_steps_per_s"]
        rows.append({"robots": robots, **medians, "ratio": median, "ratios": ratios})
    return rows


def main() -> int:
    """Runs the turns and prints the report."""
    parser = argparse.ArgumentParser(prog="scripts/bench argos", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="turns (default: 5)")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args()
    rates: dict[int, dict[str, list[float]]] = {n: {s: [] for s in STEPS} for n in sim.ROBOTS}
    with tempfile.TemporaryDirectory(prefix="vsense-bench-") as folder:
        contest = Contest(Path(folder))
        for number in range(1, options.rounds + 1):
            for robots in sim.ROBOTS:
                for name in STEPS:
                    rate, first_s = contest.turn(name, robots)
                    rates[robots][name].append(rate)
                    what = f"{robots} robots: {rate:,.0f} robot-steps/s, short run {first_s:.2f} s"
                    print(f"turn {number}: {name}, {what}", file=sys.stderr)
    rows = rows_of(rates)
    if options.json:
        print(json.dumps({"rows": rows}, indent=2))
        return 0
    for row in rows:
        both = (row[f"{name}_robot_steps_per_s"] for name in ("vsense", "argos"))
        ours, theirs = (f"{rate:,.0f}" for rate in both)
        spread = f"{row['ratios'][0]:.1f} to {row['ratios'][-1]:.1f}"
        print(f"{row['robots']} robots: {ours} against {theirs}: {row['ratio']:.1f} ({spread})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
