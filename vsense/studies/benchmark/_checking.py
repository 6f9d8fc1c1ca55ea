"""`vsense benchmark check`: a result's claims, computed again from the runs that lie beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.modes.sim.fingerprint import of_file
from vsense.run.runs_csv import RUNS, RunRow
from vsense.studies.benchmark import _definition as definition
from vsense.studies.benchmark._comparing import read, row_of
from vsense.studies.benchmark._definition import Definition
from vsense.studies.benchmark._evidence import (
    Progress,
    RunEvidence,
    misplaced,
    rows_of,
    wrong_measures,
)
from vsense.studies.benchmark._result import DEFINITION, Benchmark, figures
from vsense.studies.packages import _comparing
from vsense.studies.packages._comparing import Claims
from vsense.studies.series import _plan as plans
from vsense.studies.series._parts import PlanLoader

_SAME = 1e-6
"""Figures that differ by a smaller share are the same: other versions of NumPy round otherwise."""
_MOST_LINES = 20
"""Differences of a claim that are printed."""


def check(path: Path, progress: Progress) -> Claims:
    """Checks a result; `progress` takes what is at work.

    Raises:
        UsageError: there is no result that can be read.
        VsenseError: the missions of this vsense cannot be loaded.
    """
    path, result = read(path)
    current, claims = definition.load(), Claims()
    differences = list(_definition(current, path.parent, result))
    claims.judge("definition", differences, f"{current.name}, {current.sha256[:16]}…")
    if not differences:
        _check_runs(_benchmark(current, path.parent, result), result, claims, progress)
    return claims


def lines(claims: Claims) -> Iterator[str]:
    """All claims, for people."""
    for claim in claims.claims:
        yield f"{'ok' if claim.verdict == 'same' else 'WRONG':<6} {claim.thing}: {claim.words}"
        for text in claim.differences[:_MOST_LINES]:
            yield f"       {text}"
        if len(claim.differences) > _MOST_LINES:
            yield f"       and {len(claim.differences) - _MOST_LINES} more"


def as_json(claims: Claims) -> dict[str, Any]:
    """All claims, for programs."""
    checked = [
        {"what": claim.thing, "found": claim.words, "wrong": list(claim.differences)}
        for claim in claims.claims
    ]
    return {"holds": not claims.of("differs"), "checked": checked}


def _definition(current: Definition, folder: Path, result: Mapping[str, Any]) -> Iterator[str]:
    """In what the missions were not those of the definition, which this vsense has, too."""
    if result.get("definition_sha256") != current.sha256:
        yield (
            f"the result is of {result['benchmark']} {result.get('definition_sha256')}, this vsense"
            f" has {current.name} {current.sha256}: check it with the vsense that made it"
        )
    for name in (*current.digests, definition.DEFINITION_FILE):
        copy = folder / DEFINITION / name
        try:
            if not current.has(name, of_file(copy)):
                yield f"{copy}: is not the definition's"
        except VsenseError as error:
            yield str(error)


def _benchmark(current: Definition, folder: Path, result: Mapping[str, Any]) -> Benchmark:
    """What the result says that it is, with this vsense's missions."""
    quick, robots = result.get("quick") is True, result.get("robots")
    plan = plans.read(current.plan(quick), "sim")
    if not quick and isinstance(robots, int) and robots != current.robots:
        plan = replace(plan, count=robots)
    loaded = PlanLoader(plan).load_all()
    return Benchmark(current, replace(plan, mode=str(result["mode"])), loaded, folder, quick)


def _check_runs(
    benchmark: Benchmark, result: Mapping[str, Any], claims: Claims, progress: Progress
) -> None:
    deviations = benchmark.deviations
    differences = list(_comparing.figures("deviations", result.get("deviations"), deviations))
    claims.judge("deviations", differences, "; ".join(deviations) or "none")
    try:
        rows = rows_of(benchmark.folder)
    except VsenseError as error:
        claims.judge("runs", str(error), "none")
        return
    voids = [f"{row.run} ({row.why})" for row in rows if not row.valid]
    counts = f"{len(rows) - len(voids)} valid, {len(voids)} invalid{': ' if voids else ''}"
    wrong = [*misplaced(benchmark.plan, rows), *_rows(rows, result)]
    claims.judge("runs", wrong, counts + "; ".join(voids))
    runs, errors = benchmark.evidence(rows, progress)
    wrong = [*map(str, errors), *_files(runs, result)]
    claims.judge("recordings", wrong, f"{len(runs)} read again")
    count = sum(len(run.measures) for run in runs)
    wrong = [text for run in runs for text in wrong_measures(run)]
    claims.judge("scores", wrong, f"{count} measures computed again from recorded poses")
    if len(runs) < benchmark.plan.runs:
        claims.judge("figures", "runs are missing", "not computed")
        return
    progress("measuring the lab")
    recomputed = figures(benchmark.definition, rows, runs, None)
    claims.judge("figures", list(_figures(result, recomputed)), "computed again from the runs")


def _rows(rows: Sequence[RunRow], result: Mapping[str, Any]) -> Iterator[str]:
    """Where the result's runs and those of the table differ."""
    ours = [row_of(run) for run in result["runs"]]
    if [row.run for row in ours] != [row.run for row in rows]:
        yield f"the result has {len(ours)} runs, {RUNS} has {len(rows)}, or in another order"
        return
    for own, row in zip(ours, rows):
        names = [name for name in RunRow.__slots__ if getattr(own, name) != getattr(row, name)]
        if names:
            yield f"{row.run}: the result and {RUNS} have another {', '.join(names)}"


def _files(runs: Sequence[RunEvidence], result: Mapping[str, Any]) -> Iterator[str]:
    """Files of runs that are not as they were."""
    before = {run.get("run"): run.get("files") for run in result["runs"] if isinstance(run, dict)}
    for run in runs:
        digests = before.get(run.row.run)
        for name, sha256 in run.files.items():
            if not isinstance(digests, dict) or digests.get(name) != sha256:
                yield f"{name}: has changed since the result was made"


def _figures(result: Mapping[str, Any], recomputed: Mapping[str, Any]) -> Iterator[str]:
    for name, value in recomputed.items():
        if name == "noise":  # the roster's are measured before, and follow from no run
            value = {**value, "roster": (result.get(name) or {}).get("roster")}
        yield from _comparing.figures(name, result.get(name), value, _SAME)
