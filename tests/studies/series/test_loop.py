"""A series that somebody else makes the runs of: what is repeated, what ends it, what is kept."""

from __future__ import annotations

import io
import json
import re
import resource
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vsense.base.errors import Interrupted, UsageError, VsenseError
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.modes.sim.fingerprint import software
from vsense.modes.sim.job import Setup
from vsense.modes.sim.outcome import SimulatedRunError, Task
from vsense.run.directory import TIMESTEPS_CSV
from vsense.run.runs_csv import RunRow, read_runs
from vsense.studies.series import _simulated
from vsense.studies.series._folder import SeriesFolder
from vsense.studies.series._order import PlannedRun, VoidLimit, cells, pending
from vsense.studies.series._plan import SeriesPlan, read
from vsense.studies.series._series import RunOutcome, RunResult, SeriesLoop
from vsense.studies.series._simulated import SimulatedRuns

PLAN = """
name = "walks"
mode = "lab"
experiment = "foraging"
again = 1
[[condition]]
name = "a"
[[condition]]
name = "b"
[[start]]
name = "s"
seed = 7
[void]
lost_s = 5
"""


class Script:
    """Makes runs as a script says: the outcome of one after the other, then good ones."""

    def __init__(self, *script: RunOutcome | None, interrupted: Interruption) -> None:
        self.made: list[str] = []
        self._script = list(script)
        self._interrupted = interrupted

    def make(self, runs: Sequence[PlannedRun], folder: SeriesFolder) -> Iterator[RunResult]:
        outcome = self._script.pop(0) if self._script else outcome_of()
        self.made.append(runs[0].name)
        directory = folder.of_run(runs[0])
        (directory / TIMESTEPS_CSV).touch()
        if outcome is None:
            raise VsenseError("the lamp is broken")
        if outcome.ended == "interrupted":
            self._interrupted.set()
        yield runs[0], outcome


def outcome_of(ended: str = "time", why: str = "", halt_reason: str = "") -> RunOutcome:
    row = RunRow(run="", mode="lab", experiment="foraging", condition="", measures={"food": 3.0})
    return RunOutcome(replace(row, why=why), ended, halt_reason)


LOST = outcome_of(why="seven lost for 6.0 s")


@pytest.fixture
def plan(tmp_path: Path) -> SeriesPlan:
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    return read(path)


def carried_out(plan: SeriesPlan, *script: RunOutcome | None) -> tuple[SeriesLoop, list[str], str]:
    """One call of the command: the loop, the runs that were made, and what was said."""
    said, interrupted = io.StringIO(), Interruption()
    maker = Script(*script, interrupted=interrupted)
    with SeriesFolder(plan.path.parent / "walks", plan, []) as folder:
        make = partial(maker.make, folder=folder)
        loop = SeriesLoop(plan, folder, make, Console(said), interrupted)
        try:
            loop.run()
        except VsenseError as error:
            said.write(f"failed: {error}")
    return loop, maker.made, said.getvalue()


def rows(plan: SeriesPlan) -> list[tuple[str, str]]:
    return [(r.run, r.why) for r in read_runs(plan.path.parent / "walks" / "runs.csv")]


def test_void_runs_are_kept_named_and_repeated(plan: SeriesPlan) -> None:
    loop, made, said = carried_out(plan, LOST)
    assert made == ["run-001", "run-002", "run-001-2"]
    why = "seven lost for 6.0 s"
    assert rows(plan) == [("run-001", why), ("run-002", ""), ("run-001-2", "")]
    assert f"is invalid: {why}" in said and (loop.end_reason, loop.valid) == ("", 2)
    assert loop.facts()["void"] == [{"run": "run-001", "why": why}]
    assert carried_out(plan)[1] == [], "all is done"
    lines = [line.split() for line in loop.table()]
    assert lines[1:] == [["a", "food", "1", "3", "3", "to", "3"], ["b", *lines[1][1:]]]
    facts = loop.facts()["conditions"][0]
    assert (facts["condition"], facts["measures"]["food"]["median"]) == ("a", 3.0)


def test_too_many_void_runs_end_it_with_every_why(plan: SeriesPlan) -> None:
    _, made, said = carried_out(plan, LOST, outcome_of(), LOST)
    assert made == ["run-001", "run-002", "run-001-2"]
    assert "failed: " in said and "invalid 2 times" in said
    assert "run-001: seven lost for 6.0 s; run-001-2: seven lost" in said
    with SeriesFolder(plan.path.parent / "walks", plan, []) as folder, pytest.raises(VoidLimit):
        SeriesLoop(
            plan, folder, lambda runs: iter(()), Console(io.StringIO()), Interruption()
        ).run()


def test_who_stops_a_run_ends_the_series_and_it_goes_on_later(plan: SeriesPlan) -> None:
    by = "stopped by ben (terminal)"
    loop, made, _ = carried_out(plan, outcome_of(by, f"{by} before its end", by))
    assert (loop.end_reason, made) == (by, ["run-001"])
    assert carried_out(plan)[1] == ["run-002", "run-001-2"]


def test_what_was_simulated_before_it_ends_is_kept(
    plan: SeriesPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first run takes longer than the second one, in which Ctrl-C comes."""

    def simulate(todo: Sequence[Any], **rest: object) -> Iterator[tuple[Any, dict[str, Any]]]:
        yield todo[1], {"complaints": (), "recording": {"bytes": 1, "trouble": ""}}
        raise Interrupted

    def task(maker: SimulatedRuns, run: PlannedRun, folder: SeriesFolder) -> object:
        return SimpleNamespace(job=SimpleNamespace(recording=str(folder.recording(run, "a"))))

    monkeypatch.setattr(SimulatedRuns, "_task", task)
    monkeypatch.setattr(_simulated, "outcome", lambda *some: outcome_of())
    runs = pending(plan, [])
    warned = SimpleNamespace(experiment=SimpleNamespace(warnings=()))
    maker = SimulatedRuns(
        plan,
        dict.fromkeys("ab", warned),  # type: ignore[arg-type]
        lambda planned, cell: Setup("foraging"),
        simulate,
        Console(io.StringIO()),
        Interruption(),
        record=True,
    )
    with SeriesFolder(plan.path.parent / "walks", plan, []) as folder:
        made = maker.make(runs, folder)
        assert next(made)[0] is runs[1]
        with pytest.raises(Interrupted):
            next(made)
        there = [run.name for run in runs if (folder.path / run.name).exists()]
    assert there == [runs[1].name], "nor is there a folder of what never began"


def test_a_simulated_run_that_has_failed_has_its_row(
    plan: SeriesPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment: Any = SimpleNamespace(
        warnings=(), sources=(), name="a", timestep_s=0.1, timesteps=9, controllers=(),
        robots=(SimpleNamespace(tag=7),),
    )  # fmt: skip
    answer = {"error": "a.py:3: no such field", "exit_code": 1, "progress": (5, 0, 0)}

    def simulate(todo: Sequence[Task], **rest: object) -> Iterator[tuple[Task, dict[str, Any]]]:
        yield todo[0], todo[0].result(answer)

    monkeypatch.setattr(_simulated, "libraries_of", lambda experiment: {})
    planned: Any = SimpleNamespace(experiment=experiment)
    console, interrupted = Console(io.StringIO()), Interruption()
    maker = SimulatedRuns(
        plan, dict.fromkeys("ab", planned), lambda p, cell: Setup("a"), simulate,
        console, interrupted,
    )  # fmt: skip
    with SeriesFolder(plan.path.parent / "walks", plan, []) as folder:
        loop = SeriesLoop(plan, folder, lambda runs: maker.make(runs, folder), console, interrupted)
        with pytest.raises(SimulatedRunError, match=r"^run-001 .*: a\.py:3"):
            loop.run()
        (row,) = folder.rows
    assert (row.run, row.verdict, row.tags) == ("run-001", "void", [7])
    assert row.why == "failed in mid-run: a.py:3: no such field"


def test_what_is_cut_off_is_told_and_counts_for_nothing(plan: SeriesPlan) -> None:
    cut = outcome_of("interrupted")
    for attempt in ("run-001", "run-002", "run-001-2"):
        loop, made, _ = carried_out(plan, cut)
        assert (loop.end_reason, made) == ("interrupted", [attempt])
    # As a killed process leaves it: a folder with timesteps, and no row.
    _, _, said = carried_out(plan, None)
    assert "failed: the lamp is broken" in said
    _, made, _ = carried_out(plan)
    assert made == ["run-001-3", "run-002-3"]
    assert dict(rows(plan))["run-002-2"] == "cut off: vsense was ended in it"
    table = read_runs(plan.path.parent / "walks" / "runs.csv")
    assert {row.experiment for row in table} == {"foraging"}, "a report counts it with the others"


def test_a_run_that_was_only_waited_for_leaves_no_trace(plan: SeriesPlan) -> None:
    folder = plan.path.parent / "walks"
    carried_out(plan)
    with SeriesFolder(folder, plan, []) as taken:
        run = PlannedRun(cells(plan)[0], 5)
        waited = taken.of_run(run)
        (waited / "log.txt").touch()
        assert not taken.is_cut_off(run)
        assert taken.of_run(run) == waited and not any(waited.iterdir())


def test_one_process_at_a_time_and_no_folder_of_something_else(plan: SeriesPlan) -> None:
    folder = plan.path.parent / "walks"
    other = SeriesFolder(folder, plan, [])
    with (
        SeriesFolder(folder, plan, []),
        pytest.raises(UsageError, match="carries"),
    ):
        other.__enter__()
    with pytest.raises(UsageError, match="empty"):
        SeriesFolder(plan.path.parent, plan, []).__enter__()
    (folder / "series.json").write_text('{"experiment": "foraging"}')  # of lab --runs
    with pytest.raises(UsageError, match="is of no series by a plan"):
        SeriesFolder(folder, plan, []).__enter__()
    for text in ("[" * 100_000, '{"plan": {"repetitions": null}, "files": {}}'):
        (folder / "series.json").write_text(text)
        with pytest.raises(VsenseError, match=r"series\.json: is damaged"):
            SeriesFolder(folder, plan, []).__enter__()


def test_a_full_disk_is_told(plan: SeriesPlan) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        with pytest.raises(VsenseError, match=r"cannot write to .*: File too large"):
            SeriesFolder(plan.path.parent / "walks", plan, []).__enter__()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_folder_that_was_only_begun_is_taken(plan: SeriesPlan) -> None:
    folder = plan.path.parent / "walks"
    folder.mkdir()
    (folder / ".series.json.0a1b2c3d").touch()  # as a kill leaves it
    assert carried_out(plan)[0].valid == 2


def test_a_plan_may_try_more_often_and_not_less(plan: SeriesPlan) -> None:
    assert "invalid 2 times" in carried_out(plan, LOST, outcome_of(), LOST)[2]
    plan.path.write_text(PLAN.replace("again = 1", "again = 2\nrepetitions = 2"))
    more = read(plan.path)
    _, made, said = carried_out(more)
    assert "again: 1 before, now 2" in said and "repetitions: 1 before, now 2" in said
    assert made == ["run-001-3", "run-003", "run-004"]
    noted = json.loads((plan.path.parent / "walks" / "series.json").read_text())
    assert len(noted["changes"]) == 1 and len(noted["changes"][0]["what"]) == 2
    assert "before, now" not in carried_out(more)[2], "it is told once"
    with pytest.raises(UsageError, match=r"repetitions: 2.*1"):
        carried_out(plan)


def test_a_series_goes_on_with_other_files_only_where_that_is_wanted(plan: SeriesPlan) -> None:
    program = plan.path.with_name("walk.c")
    program.write_text("one")
    folder = plan.path.parent / "walks"
    with SeriesFolder(folder, plan, [program]) as first:
        assert first.changed == []
    program.write_text("two")
    with pytest.raises(UsageError, match=rf"began: {program}. Runs .* --allow-upgrade"):
        SeriesFolder(folder, plan, [program]).__enter__()
    with SeriesFolder(folder, plan, [program], allows_upgrade=True) as again:
        assert again.changed == [str(program)] and again.check_files() == []
        program.write_text("one")
        assert (again.check_files(), again.changed) == ([], [])
        program.unlink()
        assert again.check_files() == [str(program)]


def test_a_series_goes_on_with_another_vsense_only_where_that_is_wanted(plan: SeriesPlan) -> None:
    folder = plan.path.parent / "walks"
    with SeriesFolder(folder, plan, []):
        notes = json.loads((folder / "series.json").read_text())
    assert notes["software"] == software() and len(notes["software"]["sources"]) == 12
    before = notes["software"] | {"sources": "0123456789ab", "commit": ""}
    (folder / "series.json").write_text(json.dumps(notes | {"software": before}))
    now = software()["commit"] or software()["sources"]
    words = f"vsense 0.1.0 (0123456789ab) became vsense 0.1.0 ({now})"
    with pytest.raises(UsageError, match=re.escape(f"began: {words}. Runs")):
        SeriesFolder(folder, plan, []).__enter__()
    said = io.StringIO()
    with SeriesFolder(folder, plan, [], allows_upgrade=True) as again:
        make = partial(Script(interrupted=Interruption()).make, folder=again)
        SeriesLoop(plan, again, make, Console(said), Interruption()).run()
        assert {row.note for row in again.rows} == {f"changed since the series began: {words}"}
    assert said.getvalue().count(words) == 1
    # One of vsense 0.1 has a version only.
    del notes["software"]
    (folder / "series.json").write_text(json.dumps(notes))
    with SeriesFolder(folder, plan, []) as older:
        assert older.upgrade == ""
    assert json.loads((folder / "series.json").read_text())["software"] == software()


@pytest.mark.parametrize("allowed", [False, True])
def test_a_file_that_changes_while_the_series_goes_on_ends_it(
    plan: SeriesPlan, allowed: bool
) -> None:
    def make(runs: Sequence[PlannedRun]) -> Iterator[RunResult]:
        yield runs[0], outcome_of()
        plan.path.with_name("walk.c").write_text("another")
        yield runs[1], outcome_of()

    program = plan.path.with_name("walk.c")
    program.write_text("one")
    said, never = io.StringIO(), Interruption()
    with SeriesFolder(plan.path.parent / "walks", plan, [program], allowed) as folder:
        loop = SeriesLoop(plan, folder, make, Console(said), never)
        with nullcontext() if allowed else pytest.raises(UsageError, match="--allow-upgrade"):
            loop.run()
        rows = [(row.verdict, row.note) for row in folder.rows]
    note = "changed since the series began: walk.c"
    assert rows == [("valid", ""), ("valid" if allowed else "void", note)]
    assert (f"changed since this series began: {program}" in said.getvalue()) == allowed


def test_recordings_that_are_not_whole_are_counted_and_the_first_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings = _simulated._Recordings(tmp_path, 3, Console())
    for trouble in ("", "no space left", "still none"):
        recordings.add({"bytes": 2_000_000, "trouble": trouble})
    recordings.say()
    said = capsys.readouterr().err
    assert "2.0 MB a run, about 6.0 MB for all 3" in said and said.count("a run,") == 1
    assert "a recording is not whole: no space left" in said and "still none" not in said
    assert f"{tmp_path}, 3 recordings, 6.0 MB" in said and "2 of them are not whole" in said
