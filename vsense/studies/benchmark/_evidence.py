"""What the runs of a benchmark have left: their files, figures, poses, and measures computed again.

Only recorded poses are believed: the world of the mission is made from the definition's own files,
moved and measured with the recorded arena states. What robots sensed, and what they did to the
world, plays no part in the measures of these missions.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError, failing_as
from vsense.base.files import parse_json, read_text
from vsense.base.message_bus import DAMAGED
from vsense.config.specs import Experiment
from vsense.modes.sim.fingerprint import of_file
from vsense.monitor.recording import MCAP, form
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import Recording, open_recording
from vsense.monitor.recording.resense import arena_state
from vsense.run.directory import SUMMARY
from vsense.run.environment import Environment
from vsense.run.runs_csv import RUNS, RunRow, read_runs
from vsense.studies.benchmark._definition import BLIND
from vsense.studies.benchmark._motion import RunMotion, read_motion
from vsense.studies.series._order import Cell, cells, valid_by_cell
from vsense.studies.series._parts import PlannedExperiment
from vsense.studies.series._plan import SeriesPlan


def recount(recording: Recording, experiment: Experiment, seed: int) -> dict[str, float]:
    """The measures at the run's end, by name.

    Args:
        recording: of the run, from its beginning.
        experiment: the mission's, with everything at the run's start.
        seed: the run's own.

    Raises:
        RecordingError: it is not of this run, or not all of it is there.
        VsenseError: the mission's loop functions have failed.
    """
    path = recording.path
    environment: Environment | None = None
    newest = -1
    try:
        for message in recording.messages({"/experiment", "/arena", form.ORDERS_TOPIC}):
            if message.topic == form.ORDERS_TOPIC:
                raise RecordingError(f"{path}: somebody changed the world while the run went on")
            if message.topic == "/experiment":
                environment = environment or _environment_of(
                    recording, message.data, experiment, seed
                )
            elif environment is not None and newest + 1 < experiment.timesteps:
                newest = _step(environment, message.data, newest)
    except DAMAGED as error:
        raise RecordingError(f"{path}: cannot be counted again: {error!r}") from None
    if environment is None or newest < 0:
        raise RecordingError(f"{path}: holds no run")
    return environment.end()


def _environment_of(
    recording: Recording, stated: Mapping[str, Any], experiment: Experiment, seed: int
) -> Environment:
    """The mission's world before its first timestep, with the robots that played."""
    tags = [int(robot["tag"]) for robot in stated["robots"]]
    if stated["seed"] != seed or len(tags) != len(experiment.robots):
        raise RecordingError(
            f"{recording.path}: is of {len(tags)} robots and seed {stated['seed']}, expected"
            f" {len(experiment.robots)} and {seed}"
        )
    robots = tuple(replace(robot, tag=tag) for robot, tag in zip(experiment.robots, tags))
    return Environment(replace(experiment, robots=robots), seed)


def _step(environment: Environment, data: Mapping[str, Any], newest: int) -> int:
    run_timestep: int = data["run_timestep"]
    environment.world.update(arena_state(data), run_timestep)
    if run_timestep <= newest:
        return newest
    environment.pre_step()
    environment.act({})
    environment.post_step()
    return run_timestep


Progress = Callable[[str], None]
"""Takes what is at work, for people."""


@dataclass(frozen=True, slots=True)
class RunEvidence:
    """What a valid run has left.

    Attributes:
        row: of runs.csv.
        files: SHA-256 of its files, by their path in the series' folder.
        measures: computed again from the recording.
        summary: its summary.json; empty in simulation.
        calibration: what is known of the cameras' calibration; None: nothing.
        motion: of its robots.
    """

    row: RunRow
    files: Mapping[str, str]
    measures: Mapping[str, float]
    summary: Mapping[str, Any]
    calibration: Mapping[str, Any] | None
    motion: RunMotion


def rows_of(folder: Path) -> list[RunRow]:
    """The runs of a series' folder; VsenseError where there is no table that can be read."""
    with failing_as(VsenseError, f"{folder / RUNS}: cannot be read"):
        return read_runs(folder / RUNS)


def misplaced(plan: SeriesPlan, rows: Sequence[RunRow]) -> Iterator[str]:
    """What is wrong with the rows of a series, in words: each place of the plan has one valid run.

    Void ones have to say why.
    """
    for row in rows:
        if not (row.valid or row.why):
            yield f"{row.run} is invalid and does not say why"
    valid = valid_by_cell(rows)
    for cell in cells(plan):
        placed = valid.pop(cell.key, [])
        where = f"{cell.condition}, {cell.start}, repetition {cell.repetition}"
        if len(placed) != 1:
            yield f"{where}: {len(placed)} valid runs, expected one"
        for row in placed:
            if wrong := _differs(row, cell, plan.mode):
                yield f"{row.run} ({where}): {wrong}"
    for condition, start, repetition in valid:
        yield f"{condition}, {start}, repetition {repetition}: not in the plan"


def _differs(row: RunRow, cell: Cell, mode: str) -> str:
    """What of a row is not as its place in the plan says; "": nothing."""
    name = f"run-{cell.number:03d}"
    if row.run != name and not row.run.startswith(f"{name}-"):
        return f"its place in the order is {cell.number}"
    if row.mode != mode:
        return f"mode {row.mode}, expected {mode}"
    if row.seed != cell.seed or row.block != str(cell.block):
        return f"seed {row.seed} in block {row.block}, expected {cell.seed} in {cell.block}"
    return ""


def evidence_of(
    folder: Path, plan: SeriesPlan, by_condition: Mapping[str, PlannedExperiment], row: RunRow
) -> RunEvidence:
    """Reads what a valid run has left; `by_condition` is what each condition runs.

    Raises:
        VsenseError: something is missing, damaged, or not of this run.
    """
    if row.condition not in by_condition or row.start not in {start.name for start in plan.starts}:
        raise VsenseError(f"{row.run}: {row.condition}, {row.start} is not in the plan")
    place = folder / row.run
    paths = sorted(place.glob(f"*{MCAP}"))
    if len(paths) != 1:
        raise VsenseError(f"{place}: {len(paths)} recordings, expected one")
    summary = _summary(place / SUMMARY) if row.mode != "sim" else {}
    files = [paths[0], *([place / SUMMARY] if summary else [])]
    experiment = plan.start(row.start).places.settled(by_condition[row.condition].experiment)
    with open_recording(paths[0]) as recording:
        _require_kind(recording, row)
        measures = recount(recording, experiment, row.seed or 0)
        calibration = recording.experiment.get("calibration")
        motion = read_motion(recording, not row.condition.endswith(BLIND))
    digests = {str(path.relative_to(folder)): of_file(path) for path in files}
    return RunEvidence(row, digests, measures, summary, calibration, motion)


def wrong_measures(run: RunEvidence) -> Iterator[str]:
    """Measures that the table has otherwise than the recording, in words."""
    for name in sorted({*run.measures, *run.row.measures}):
        stated, measured = run.row.measures.get(name), run.measures.get(name)
        texts = {value if value is None else f"{value:.9g}" for value in (stated, measured)}
        if len(texts) > 1:
            yield f"{run.row.run}: {name} is {stated} in {RUNS}, and {measured} by its recording"


def _require_kind(recording: Recording, row: RunRow) -> None:
    """Raises VsenseError where a recording is of another kind of run, or lacks something."""
    stated = recording.experiment
    blind, command = row.condition.endswith(BLIND), stated.get("command")
    if stated.get("blind") is not blind or command != row.mode:
        kind = "blind" if stated.get("blind") else "sighted"
        raise VsenseError(f"{recording.path}: is of a {kind} run of vsense {command}")
    if not recording.complete or recording.gaps:
        raise VsenseError(f"{recording.path}: is not whole: it was cut off, or has gaps")


def _summary(path: Path) -> dict[str, Any]:
    try:
        summary = parse_json(read_text(path))
        if isinstance(summary, dict):
            return summary
        raise ValueError("no object")
    except OSError as error:
        raise VsenseError(f"{path}: cannot be read: {error.strerror}") from None
    except (json.JSONDecodeError, ValueError) as error:
        raise VsenseError(f"{path}: is damaged: {error}") from None
