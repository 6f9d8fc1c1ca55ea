"""`scripts/bench argos`: the simulator beside an installed ARGoS 3, in the same world, in turn.

It needs `argos3` on the PATH with the plug-in argos3-epuck (`ARGOS_PLUGIN_PATH`), its headers where
the compiler finds them (`CXXFLAGS=-I...` for another place), and a C++ compiler. The world is that
of `scripts/bench sim`, word by word; `wander.cpp` is its controller there. Here it runs as a C
controller with our own sensors ("port"), and as the very file that ARGoS reads with the very C++
controller that it runs ("file"). Each turn runs all with each number of robots, twice: short and
long. The rate is what the longer run did more, over the processor time that it took more: so
start-up, whose time is reported apart, does not count.

`--whole FILE` runs published files from their beginning to their end instead, in ARGoS and in a
campaign of `--runs` seeds, and compares the processor time of a run. The file's libraries are built
already; options of `vsense sim` follow `--`, such as `--sources`: where it finds their sources.
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
STEPS = {"argos": 300_000, "port": 900_000, "file": 450_000}
"""Robots times timesteps of a long run, as many as take each about 2 s; of a short one, SHORT."""
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
        for name in ("port", "file"):
            self.spent_s(name, 15, 10)

    def spent_s(self, name: str, robots: int, timesteps: int) -> float:
        """Processor time of a run."""
        text, seconds = sim.experiment_text(robots), timesteps * sim.TIMESTEP_S
        path = self._folder / f"{name}.argos"
        path.write_text(text if name == "port" else for_argos(text, str(self._library), seconds))
        if name == "argos":
            return cpu_s(["argos3", "-z", "-c", str(path)])
        sources = [] if name == "port" else ["--sources", f"wander={CONTROLLER}"]
        return self.campaign_s(path, 1, ["--duration", f"{seconds:g}", *sources])

    def campaign_s(self, path: Path, runs: int, options: Sequence[str]) -> float:
        """Processor time of runs of a file with `vsense sim`."""
        output = self._folder / "results.csv"
        output.unlink(missing_ok=True)
        words = ["sim", str(path), "--runs", str(runs), "-j", "1", *options]
        return cpu_s([sys.executable, "-m", "vsense", *words, "-o", str(output)])

    def turn(self, name: str, robots: int) -> tuple[float, float]:
        """Robot-steps per second, and the processor time of the short run."""
        short, long = (max(steps // robots, 10) for steps in (SHORT, STEPS[name]))
        first_s = self.spent_s(name, robots, short)
        return robots * (long - short) / (self.spent_s(name, robots, long) - first_s), first_s


def turns(contest: Contest, rounds: int) -> dict[int, dict[str, list[float]]]:
    """Robot-steps per second of each turn, by robots and name."""
    rates: dict[int, dict[str, list[float]]] = {n: {s: [] for s in STEPS} for n in sim.ROBOTS}
    for number in range(1, rounds + 1):
        for robots, each in rates.items():
            for name in STEPS:
                rate, first_s = contest.turn(name, robots)
                each[name].append(rate)
                what = f"{robots} robots: {rate:,.0f} robot-steps/s, short run {first_s:.2f} s"
                print(f"turn {number}: {name}, {what}", file=sys.stderr)
    return rates


def rows_of(rates: dict[int, dict[str, list[float]]]) -> list[dict[str, Any]]:
    """The report: medians, and the ratios of each turn, from the least to the largest."""
    rows = []
    for robots, each in rates.items():
        medians = {name: statistics.median(each[name]) for name in STEPS}
        row: dict[str, Any] = {"robots": robots, "argos_robot_steps_per_s": medians["argos"]}
        for name in ("port", "file"):
            ratios = sorted(ours / theirs for ours, theirs in zip(each[name], each["argos"]))
            row[f"{name}_robot_steps_per_s"] = medians[name]
            row[f"{name}_ratio"] = medians[name] / medians["argos"]
            row[f"{name}_ratios"] = ratios
        rows.append(row)
    return rows


def whole(contest: Contest, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Published files, whole: the processor time of a run [s] in both, in turn."""
    rows = []
    for file in options.whole:
        contest.campaign_s(file, 1, options.options)  # builds its sources
        turns = []
        for _ in range(options.rounds):
            argos = cpu_s(["argos3", "-z", "-c", str(file)])
            ours = contest.campaign_s(file, options.runs, options.options) / options.runs
            turns.append((argos, ours))
            print(f"{file.name}: ARGoS {argos:.2f}, vsense {ours:.2f} CPU-s", file=sys.stderr)
        argos_s, vsense_s = (statistics.median(column) for column in zip(*turns))
        ratios = sorted(argos / ours for argos, ours in turns)
        row = {"file": file.name, "argos_s": argos_s, "vsense_s": vsense_s}
        rows.append({**row, "ratio": argos_s / vsense_s, "ratios": ratios})
    return rows


def _print(rows: Sequence[dict[str, Any]]) -> None:
    for row in rows:
        if "file" in row:
            spread = f"{row['ratios'][0]:.1f} to {row['ratios'][-1]:.1f}"
            seconds = f"{row['vsense_s']:.2f} against {row['argos_s']:.2f} CPU-s"
            print(f"{row['file']}: {seconds} a run: {row['ratio']:.1f} ({spread})")
            continue
        theirs = f"{row['argos_robot_steps_per_s']:,.0f}"
        for name in ("port", "file"):
            ours, ratios = f"{row[f'{name}_robot_steps_per_s']:,.0f}", row[f"{name}_ratios"]
            spread = f"{ratios[0]:.1f} to {ratios[-1]:.1f}"
            print(
                f"{row['robots']} robots, {name}: {ours} against {theirs}:"
                f" {row[f'{name}_ratio']:.1f} ({spread})"
            )


def main() -> int:
    """Runs the turns and prints the report."""
    parser = argparse.ArgumentParser(prog="scripts/bench argos", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="turns (default: 5)")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.add_argument(
        "--whole", type=Path, nargs="+", default=[], metavar="FILE", help="published files, whole"
    )
    parser.add_argument("--runs", type=int, default=30, help="of each, in vsense (default: 30)")
    parser.add_argument("options", nargs="*", help="of vsense sim, after --")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="vsense-bench-") as folder:
        contest = Contest(Path(folder))
        rows = whole(contest, options) if options.whole else rows_of(turns(contest, options.rounds))
    if options.json:
        print(json.dumps({"rows": rows}, indent=2))
    else:
        _print(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
