"""A benchmark's result: one file, benchmark.json, from which others can compare and check."""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import replace_text
from vsense.config.roster import Roster
from vsense.modes.sim.fingerprint import of_file
from vsense.run.directory import DirectoryError
from vsense.run.runs_csv import RunRow, utc
from vsense.studies.benchmark._definition import Definition, Mission
from vsense.studies.benchmark._evidence import (
    Progress,
    RunEvidence,
    evidence_of,
    misplaced,
    rows_of,
    wrong_measures,
)
from vsense.studies.benchmark._motion import robots_of, shift_of, standing_noise
from vsense.studies.report import Questions
from vsense.studies.report.study._results import StudyResult, results_of
from vsense.studies.series._parts import PlannedExperiment
from vsense.studies.series._plan import SeriesPlan


def latency(runs: Sequence[RunEvidence]) -> dict[str, Any] | None:
    """How late readings and wheels are; None in simulation, where time is the experiment's.

    `stations`: from the middle of an exposure (of `picture_...`: from the last picture in memory;
    of `arena_to_sent`: from the arena state), the median of the runs' medians, and the greatest of
    their 99th percentiles and of all.
    """
    latencies = [run.summary["latency_ms"] for run in runs if "latency_ms" in run.summary]
    if not latencies:
        return None
    stations = {
        f"{name}_ms": _spread([stations[name] for stations in latencies if name in stations])
        for name in dict.fromkeys(name for stations in latencies for name in stations)
    }
    late = [run.row.late for run in runs if run.row.late is not None]
    return {
        "stations": {name: spread for name, spread in stations.items() if spread},
        "late_share_mean": sum(late) / len(late) if late else None,
        "late_share_worst": max(late, default=None),
    }


def _spread(spreads: Sequence[Mapping[str, float | None]]) -> dict[str, float]:
    """The spread of a latency over runs; empty where none has it."""
    valid = [spread for spread in spreads if spread.get("p50") is not None]
    if not valid:
        return {}
    worst = {name: max(float(spread[name] or 0.0) for spread in valid) for name in ("p99", "max")}
    return {"p50": median(float(spread["p50"] or 0.0) for spread in valid), **worst}


def accuracy(runs: Sequence[RunEvidence]) -> dict[str, Any]:
    """How true poses are.

    `truth`: in the lab, what was read of markers against where they truly were; `calibration`: what
    `vsense camera calibrate check` found of the cameras in use, or the lab of those of
    `--calibrate`; both None where nothing is known. `seen_share`: robots seen in a timestep.
    """
    tracked = [run.summary["tracking"] for run in runs if "tracking" in run.summary]
    calibrations = [run.calibration for run in runs if run.calibration]
    robots = [run.row.robots or 0 for run in runs]
    seen = sum(_seen(run) for run in runs)
    return {
        "truth": _against_truth(tracked) if tracked else None,
        "calibration": calibrations[-1] if calibrations else None,
        "seen_share": seen / sum(robots) if sum(robots) else None,
    }


def _seen(run: RunEvidence) -> float:
    if "tracking" in run.summary:
        return float(run.summary["tracking"]["detected_mean"] or 0.0)
    if "arena" in run.summary:
        return float(run.summary["arena"]["seen_mean"] or 0.0)
    return float(run.row.robots or 0)


def _against_truth(tracked: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "position_rms_mm": _rms([tracking["position_rmse_mm"] for tracking in tracked]),
        "heading_rms_deg": _rms([tracking["heading_rmse_deg"] for tracking in tracked]),
        "wrong_ids": sum(tracking["wrong_ids"] for tracking in tracked),
    }


def _rms(values: Sequence[float | None]) -> float | None:
    numbers = [value for value in values if value is not None]
    return math.sqrt(sum(value**2 for value in numbers) / len(numbers)) if numbers else None


def noise(runs: Sequence[RunEvidence], roster: Roster | None) -> dict[str, Any]:
    """What the runs show of wheels and noise; see `motion`.

    `told_shift_ms`: by how much reported speeds were shifted in time; `robots`: of each robot;
    `standing`: of poses and readings of robots that stand; `roster`: by tag, what `vsense robot
    calibrate` has measured before.
    """
    motions = [run.motion for run in runs]
    shift_s = shift_of(motions)
    roster_data = {} if roster is None else {
        str(robot.tag): values
        for robot in roster.robots
        if (values := {n: v for n, v in asdict(robot.calibration).items() if v})
    }  # fmt: skip
    return {
        "told_shift_ms": None if shift_s is None else 1e3 * shift_s,
        "robots": [asdict(robot) for robot in robots_of(motions, shift_s or 0.0)],
        "standing": [asdict(noise) for noise in standing_noise(motions)],
        "roster": roster_data,
    }


RESULT = "benchmark.json"
DEFINITION = "definition"
"""In the folder of the runs: the result, and a copy of the definition's files."""
FORM = 1
"""Of the result's file; it rises when an older vsense can no longer read it."""

UNITS = {
    "_s": "s", "_ms": "ms", "_mm": "mm", "_deg": "degrees", "_v": "V", "_share": "0 to 1",
    "_over_": "ratio", "sigma": "its entry's unit",
}  # fmt: skip
"""What parts of names say; numbers of a mission and its measures are in the mission's unit."""


@dataclass(frozen=True, slots=True)
class LabSetup:
    """What results call a lab, and how it was made, by option."""

    name: str
    setup: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A benchmark that is carried out, or was.

    Attributes:
        folder: of the series.
        by_condition: what each condition runs.
        quick: it is a first look only.
    """

    definition: Definition
    plan: SeriesPlan
    by_condition: Mapping[str, PlannedExperiment]
    folder: Path
    quick: bool = False

    @property
    def robots(self) -> int:
        """So many play."""
        return self.definition.robots if self.plan.count is None else self.plan.count

    @property
    def deviations(self) -> list[str]:
        """In what it is not the definition's."""
        texts = ["quick: a first look, never comparable"] if self.quick else []
        if not self.quick and self.robots != self.definition.robots:
            texts.append(f"{self.robots} robots in place of {self.definition.robots}")
        return texts

    @property
    def files(self) -> dict[str, Path]:
        """The definition's files by their names."""
        files = {path for planned in self.by_condition.values() for path in planned.files}
        files |= {self.definition.plan(), self.definition.plan(True)}
        return {path.name: path for path in sorted(files, key=lambda path: path.name)}

    def rows(self) -> list[RunRow]:
        """All runs so far.

        Raises:
            VsenseError: some are missing, or are not the plan's.
        """
        rows = rows_of(self.folder)
        if wrong := list(misplaced(self.plan, rows)):
            raise VsenseError(f"{self.folder}: {'; '.join(wrong[:5])}")
        return rows

    def evidence(
        self, rows: Sequence[RunRow], progress: Progress
    ) -> tuple[list[RunEvidence], list[VsenseError]]:
        """What the valid runs have left, and why that of others cannot be read."""
        runs, errors, valid = [], [], [row for row in rows if row.valid]
        for number, row in enumerate(valid, 1):
            progress(f"reading the recordings: {number} of {len(valid)} ({row.run})")
            try:
                runs.append(evidence_of(self.folder, self.plan, self.by_condition, row))
            except VsenseError as error:
                errors.append(error)
        return runs, errors


def make(
    benchmark: Benchmark, lab: LabSetup, roster: Roster | None, progress: Progress
) -> dict[str, Any]:
    """Measures a lab by the runs that it has made, all of which are there.

    Raises:
        VsenseError: runs or files are missing, or say different things.
    """
    rows = benchmark.rows()
    runs, errors = benchmark.evidence(rows, progress)
    if errors:
        raise errors[0]
    if wrong := [text for run in runs for text in wrong_measures(run)]:
        raise VsenseError("; ".join(wrong[:5]))
    progress("measuring the lab")
    return {
        "form": FORM,
        "benchmark": benchmark.definition.name,
        "definition_sha256": benchmark.definition.sha256,
        "definition_files": {n: of_file(path) for n, path in benchmark.files.items()},
        "quick": benchmark.quick,
        "deviations": benchmark.deviations,
        "robots": benchmark.robots,
        "site": lab.name,
        "mode": benchmark.plan.mode,
        "setup": dict(lab.setup),
        "made": utc(time.time()),
        "versions": sorted({word for row in rows for word in row.versions}),
        "units": UNITS,
        **figures(benchmark.definition, rows, runs, roster),
        "runs": [
            {**asdict(row), "files": next((run.files for run in runs if run.row is row), {})}
            for row in rows
        ],
    }


def figures(
    definition: Definition,
    rows: Sequence[RunRow],
    runs: Sequence[RunEvidence],
    roster: Roster | None,
) -> dict[str, Any]:
    """All that is computed from runs: qualification and scores."""
    return {
        "counts": {"valid": len(runs), "void": len(rows) - len(runs)},
        "latency": latency(runs),
        "accuracy": accuracy(runs),
        "noise": noise(runs, roster),
        "missions": [
            _mission(definition.measures[result.measures[0].measure], result)
            for result in studies_of(definition, rows)
        ],
    }


def studies_of(
    definition: Definition, rows: Sequence[RunRow], tests: bool = False
) -> list[StudyResult]:
    """Each mission's runs, sighted and blind, in its score only; with `tests` needs SciPy."""
    asked = Questions(only=list(definition.measures), tests=tests)
    return results_of(rows, asked)


def _mission(mission: Mission, result: StudyResult) -> dict[str, Any]:
    """The score of a mission: sighted runs, blind ones, and how far these lie apart."""
    measured = result.measures[0]
    arms = {}
    for name, arm, spread in zip(("sighted", "blind"), result.study.arms, measured.spreads):
        assert spread is not None, "every place of the plan has a valid run"
        arms[name] = {**asdict(spread), "void": len(arm.voids)}
        arms[name]["quartiles"] = list(spread.quartiles)
        arms[name]["notch"] = None if spread.notch is None else list(spread.notch)
    effect = measured.pairs[0].effect
    assert effect is not None, "both have runs"
    better = effect.a12 if mission.better == "more" else 1.0 - effect.a12
    return {
        "mission": mission.name,
        **{name: getattr(mission, name) for name in ("measure", "unit", "better", "margin")},
        **arms,
        "sighted_better": better,
        "shift": effect.shift,
        "shift_95": [effect.shift_low, effect.shift_high],
    }


def write(benchmark: Benchmark, result: Mapping[str, Any]) -> Path:
    """Writes a result and the definition's files beside its runs; DirectoryError if it cannot."""
    path, copies = benchmark.folder / RESULT, benchmark.folder / DEFINITION
    with failing_as(DirectoryError, f"{path}: cannot be written"):
        copies.mkdir(exist_ok=True)
        for file in (*benchmark.files.values(), benchmark.definition.file):
            shutil.copyfile(file, copies / file.name)
        replace_text(path, json.dumps(result, indent=1) + "\n")
    return path
