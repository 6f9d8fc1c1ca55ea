"""`vsense benchmark check`: a result against the runs that lie beside it; nothing is believed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.run.runs_csv import RUNS, RunRow
from vsense.studies.benchmark import definition
from vsense.studies.benchmark.definition import Definition, digest
from vsense.studies.benchmark.evidence import (
    RunEvidence,
    Tell,
    evidence_of,
    misplaced,
    rows_of,
    uncounted,
)
from vsense.studies.benchmark.result import DEFINITION, Benchmark, figures, read, row_of
from vsense.studies.series import plan as plans
from vsense.studies.series.parts import PlanLoader

_SAME = 1e-6
"""Figures that differ by a smaller share are the same: other versions of NumPy round otherwise."""


@dataclass(frozen=True, slots=True)
class Checked:
    """Something that was looked at: `wrong` are words about what does not hold."""

    what: str
    found: str
    wrong: Sequence[str] = ()


def check(path: Path, tell: Tell) -> list[Checked]:
    """Checks a result; `tell` takes what is at work.

    Raises:
        UsageError: there is no result that can be read.
        VsenseError: the missions of this vsense cannot be loaded.
    """
    path, told = read(path)
    known = definition.load()
    checked = [_definition(known, path.parent, told)]
    if checked[0].wrong:
        return checked
    benchmark = _benchmark(known, path.parent, told)
    return [*checked, *_runs(benchmark, told, tell)]


def lines(checked: Sequence[Checked]) -> Iterator[str]:
    """What was found, for people."""
    for one in checked:
        yield f"{'WRONG' if one.wrong else 'ok':<6} {one.what}: {one.found}"
        for words in one.wrong[:20]:
            yield f"       {words}"
        if len(one.wrong) > 20:
            yield f"       and {len(one.wrong) - 20} more"


def _definition(known: Definition, folder: Path, told: Mapping[str, Any]) -> Checked:
    """Whether the missions were those of the definition, which this vsense has, too."""
    wrong = []
    if told.get("definition_sha256") != known.sha256:
        wrong.append(
            f"the result is of {told['benchmark']} {told.get('definition_sha256')}, this vsense has"
            f" {known.name} {known.sha256}: check it with the vsense that made it"
        )
    for name, expected in {**known.digests, definition.FILE: known.sha256}.items():
        copy = folder / DEFINITION / name
        try:
            if digest(copy) != expected:
                wrong.append(f"{copy}: is not the definition's")
        except VsenseError as error:
            wrong.append(str(error))
    return Checked("definition", f"{known.name}, {known.sha256[:16]}…", wrong)


def _benchmark(known: Definition, folder: Path, told: Mapping[str, Any]) -> Benchmark:
    """What the result says that it is, with this vsense's missions."""
    quick, robots = told.get("quick") is True, told.get("robots")
    plan = plans.read(known.plan(quick), "sim")
    if not quick and isinstance(robots, int) and robots != known.robots:
        plan = replace(plan, count=robots)
    loaded = PlanLoader(plan).load_all()
    return Benchmark(known, replace(plan, mode=str(told["mode"])), loaded, folder, quick)


def _runs(benchmark: Benchmark, told: Mapping[str, Any], tell: Tell) -> Iterator[Checked]:
    deviations = benchmark.deviations
    wrong = [] if told.get("deviations") == deviations else [f"told: {told.get('deviations')}"]
    yield Checked("deviations", "; ".join(deviations) or "none", wrong)
    try:
        rows = rows_of(benchmark.folder)
    except VsenseError as error:
        yield Checked("runs", "none", [str(error)])
        return
    voids = [f"{row.run} ({row.why})" for row in rows if not row.valid]
    words = f"{len(rows) - len(voids)} valid, {len(voids)} void{': ' if voids else ''}"
    yield Checked(
        "runs",
        words + "; ".join(voids),
        [*misplaced(benchmark.plan, rows), *_table(rows, told)],
    )
    runs, lost = _evidence(benchmark, rows, tell)
    yield Checked("recordings", f"{len(runs)} read again", [*lost, *_files(runs, told)])
    yield Checked(
        "scores",
        f"{sum(len(run.counted) for run in runs)} measures computed anew from recorded poses",
        [words for run in runs for words in uncounted(run)],
    )
    if len(runs) == benchmark.plan.runs:
        tell("measuring the lab")
        anew = figures(benchmark.definition, rows, runs, None)
        yield Checked("figures", "computed anew from the runs", list(_figures(told, anew)))
    else:
        yield Checked("figures", "not computed", ["runs are missing"])


def _evidence(
    benchmark: Benchmark, rows: Sequence[RunRow], tell: Tell
) -> tuple[list[RunEvidence], list[str]]:
    """What can be read of the valid runs, and why the others cannot."""
    found, wrong, valid = [], [], [row for row in rows if row.valid]
    for number, row in enumerate(valid, 1):
        tell(f"reading the recordings: {number} of {len(valid)} ({row.run})")
        try:
            planned = benchmark.known[row.condition]
            found.append(evidence_of(benchmark.folder, benchmark.plan, planned, row))
        except VsenseError as error:
            wrong.append(str(error))
        except (KeyError, StopIteration):
            wrong.append(f"{row.run}: {row.condition}, {row.start} is not in the plan")
    return found, wrong


def _table(rows: Sequence[RunRow], told: Mapping[str, Any]) -> Iterator[str]:
    """Where the result's runs and those of the table differ."""
    try:
        ours = [row_of(one) for one in told["runs"]]
    except (KeyError, TypeError):
        yield "the result's runs are damaged"
        return
    if [row.run for row in ours] != [row.run for row in rows]:
        yield f"the result has {len(ours)} runs, {RUNS} has {len(rows)}, or in another order"
        return
    for one, row in zip(ours, rows):
        names = [n for n in RunRow.__slots__ if getattr(one, n) != getattr(row, n)]
        if names:
            yield f"{row.run}: the result and {RUNS} have another {', '.join(names)}"


def _files(runs: Sequence[RunEvidence], told: Mapping[str, Any]) -> Iterator[str]:
    """Files of runs that are not as they were."""
    before = {one.get("run"): one.get("files") for one in told["runs"] if isinstance(one, dict)}
    for run in runs:
        known = before.get(run.row.run)
        for name, found in run.files.items():
            if not isinstance(known, dict) or known.get(name) != found:
                yield f"{name}: has changed since the result was made"


def _figures(told: Mapping[str, Any], anew: Mapping[str, Any]) -> Iterator[str]:
    """Figures that are not what the runs give."""
    for name, value in anew.items():
        yield from _differing(name, told.get(name), value)


def _differing(name: str, told: Any, anew: Any) -> Iterator[str]:
    if name == "noise.roster":
        return  # measured before, with nothing of the runs
    if isinstance(anew, Mapping) and isinstance(told, Mapping):
        for key in dict.fromkeys((*anew, *told)):
            yield from _differing(f"{name}.{key}", told.get(key), anew.get(key))
    elif isinstance(anew, list) and isinstance(told, list) and len(anew) == len(told):
        for number, (one, other) in enumerate(zip(told, anew)):
            yield from _differing(f"{name}[{number}]", one, other)
    elif not _same(told, anew):
        yield f"{name}: told {told}, the runs give {anew}"


def _same(told: Any, anew: Any) -> bool:
    numbers = (int, float)
    if type(told) in numbers and type(anew) in numbers:
        return math.isclose(told, anew, rel_tol=_SAME, abs_tol=1e-9)
    return bool(told == anew)
