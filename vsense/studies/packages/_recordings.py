"""Recordings of a package: copied into it, and their runs made again from it.

A copy names nobody; pictures are left out or kept. What is compared later stays as it is: arena
states, readings, actuations, and what the tracker is made from. Made again, pictures are tracked
and arena states sensed; measures and the row of runs.csv follow from both. What robots and cameras
did was measured once, and is not made again.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from vsense.base.errors import Interrupted, VsenseError, failing_as
from vsense.base.message_bus import Message
from vsense.modes.sim.watch import Flag
from vsense.monitor.recording import form
from vsense.monitor.recording.form import ExperimentMessage
from vsense.monitor.recording.foxglove_export import copy_messages
from vsense.monitor.recording.pictures import PicturePainter
from vsense.monitor.recording.reader import Recording, open_recording
from vsense.monitor.recording.resense import Resensing
from vsense.monitor.recording.retrack import Retracking
from vsense.monitor.recording.writer import RecordingWriter
from vsense.run.directory import MEASURES_CSV, TIMESTEPS_CSV
from vsense.studies.packages import _comparing
from vsense.studies.packages._archive import PackageError
from vsense.studies.packages._comparing import Claims
from vsense.studies.packages._contents import NO_RECORDING, PackedRun
from vsense.studies.packages._places import PackagePlaces, Scrubber, Untrusted, is_own


@dataclass(frozen=True, slots=True)
class CopiedRecording:
    """What became of a recording.

    Attributes:
        left_out: pictures were left out.
        painted: pictures in which what is outside of the arena was painted over.
        lacks: what it lacks, in words.
    """

    left_out: bool
    painted: int
    lacks: Sequence[str]


_TEXTS = ("/experiment", "/run", "/event", "/cameras", form.GAP)
"""Topics in which somebody may be named."""


def copy(
    path: Path,
    into: Path,
    scrubber: Scrubber,
    kept: tuple[bool, bool],
    progress: Callable[[float], None] = lambda share: None,
) -> CopiedRecording:
    """Writes a recording as it goes into a package.

    Args:
        kept: whether pictures go in, and are painted over outside of the arena.

    Raises:
        RecordingError: it is none.
        PackageError: it cannot be written.
    """
    left_out, (pictures, masked) = False, kept
    topics: set[str] = set()

    def change(message: Message) -> Message | None:
        nonlocal left_out
        topics.add(message.topic)
        if not pictures and message.topic.startswith((form.PICTURE, form.TRACKER_TOPIC)):
            left_out = True
            return None
        if masked and message.topic.startswith(form.PICTURE):
            return painter.painted(message)
        return _scrubbed(message, scrubber)

    with open_recording(path) as recording, failing_as(PackageError, f"{into}: cannot be written"):
        painter = PicturePainter(recording.experiment)
        writer = RecordingWriter(into, recording.begin_ns, recording.utc_shift_ns)
        copy_messages(recording, writer, progress, change)
        lacks = [*_lacks(recording, topics, left_out), *painter.lacks()]
    return CopiedRecording(left_out, len(painter.pictures), lacks)


def _lacks(recording: Recording, topics: Collection[str], left_out: bool) -> list[str]:
    """What a recording lacks, that was read with these topics."""
    experiment, lacks = ExperimentMessage.read(recording.experiment), []
    if gaps := recording.gaps:
        many = f"{len(gaps)} gaps" if len(gaps) > 1 else "a gap"
        lacks.append(f"has {many} ({gaps[0].why}): only what is beside can be made again")
    if not recording.complete:
        lacks.append("was cut off: its last second may be missing")
    if recording.damaged:
        lacks.append(f"{len(recording.damaged)} parts of it are damaged")
    if experiment.mode == "sim" or form.DEEDS not in topics:
        return lacks
    if experiment.made is None:
        lacks.append("does not say how its experiment was read: readings cannot be made again")
    if left_out:
        lacks.append("its pictures were left out (--pictures): poses cannot be tracked again")
    elif form.TRACKER_TOPIC not in topics:
        lacks.append("has no pictures (--record-images): poses cannot be tracked again")
    return lacks


def _scrubbed(message: Message, scrubber: Scrubber) -> Message:
    if message.topic not in _TEXTS:
        return message
    data = dict(message.data)
    setup = data.pop("made", None)
    text = data.pop("file_text", None)
    data = {**scrubber.data(data), **({"user": None} if "user" in data else {})}
    if setup is not None:
        data["made"] = scrubber.setup(setup)
    if isinstance(text, str):
        data["file_text"] = scrubber.text(text)
    return replace(message, data={name: data[name] for name in message.data})


class RecordedRuns:
    """The recorded runs of a package; for the arguments see `Simulating`."""

    def __init__(
        self,
        places: PackagePlaces,
        claims: Claims,
        trusted: bool,
        interrupted: Flag,
        show: Callable[[str], None],
    ) -> None:
        self._places, self._claims, self._trusted = places, claims, trusted
        self._interrupted, self._show = interrupted, show

    def make(self, run: PackedRun) -> None:
        """Makes again what follows from the recordings of a run."""
        if not run.recordings:
            self._claims.cannot(f"{run.title}: readings and poses", NO_RECORDING)
            return
        for name in run.recordings:
            path, public = self._places.package / name, partial(self._public, name)
            with self._claims.attempt(f"{name}: poses", public), open_recording(path) as file:
                self._track(name, file)
            with self._claims.attempt(f"{name}: readings", public), open_recording(path) as file:
                self._sense(run, name, file)

    def _public(self, name: str, error: object) -> str:
        return self._places.public(error).removeprefix(f"@package/{name}: ")

    def _track(self, name: str, recording: Recording) -> None:
        if form.TRACKER_TOPIC not in recording.topics:
            raise VsenseError("it holds no pictures of cameras of vsense's own (--record-images)")
        tracking = Retracking(recording, lambda setup: setup)
        for number, _ in enumerate(tracking.states(), 1):
            self._say(f"{name}: tracked again, timestep {number}")
        comparison = tracking.comparison
        differs = comparison.equal < comparison.timesteps or not comparison.timesteps
        words = "; ".join(comparison.lines())
        self._claims.judge(f"{name}: poses", words if differs else "", words)

    def _sense(self, run: PackedRun, name: str, recording: Recording) -> None:
        """Makes the world again, with readings, measures and the run's row."""
        experiment = ExperimentMessage.read(recording.experiment)
        setup = experiment.made
        if not setup or not isinstance(setup.get("path"), str):
            raise VsenseError("it does not say how its experiment was read: an older vsense")
        self._require_trust(experiment)
        path = self._places.experiment_path(setup["path"])
        sensing = Resensing(recording, path, self._moved)
        measures: dict[int, dict[str, float]] = {}
        for run_timestep in sensing.timesteps():
            self._say(f"{name}: sensed again, timestep {run_timestep}")
            if run_timestep >= 0:
                measures[run_timestep] = sensing.measures
        comparison = sensing.comparison
        words = "; ".join(comparison.lines())
        self._claims.judge(f"{name}: readings", words if comparison.different else "", words)
        self._compare_measures(run, measures)
        self._compare_row(run, experiment, {**sensing.measures, **sensing.end()})

    def _require_trust(self, experiment: ExperimentMessage) -> None:
        """Raises Untrusted unless the experiment is vsense's own, or the package is believed."""
        setup = experiment.made or {}
        if not self._trusted and not is_own(setup.get("path"), setup, experiment.file_text):
            raise Untrusted

    def _moved(self, experiment: ExperimentMessage) -> ExperimentMessage:
        """What a recording says of its experiment, with the paths of here; a recording may say
        something else of it later, and Untrusted is raised for each."""
        self._require_trust(experiment)
        setup = self._places.real(dict(experiment.made or {}))
        code = setup.get("code")
        self._places.make_folders(code.get("includes", ()) if isinstance(code, dict) else ())
        return replace(experiment, made=setup, file_text=self._places.real(experiment.file_text))

    def _compare_measures(self, run: PackedRun, now: Mapping[int, Mapping[str, float]]) -> None:
        path = self._places.package / run.folder / MEASURES_CSV
        if not run.folder or not os.path.isfile(path):
            return
        text = path.read_text(encoding="utf-8", errors="replace")
        rows = list(csv.DictReader(text.splitlines()))
        lines = [text.partition("\n")[0]]
        for row in rows:
            step = int(row["run_timestep"]) if row["run_timestep"].isdigit() else -1
            measures = now.get(step, {})
            cells = {n: "" if measures.get(n) is None else f"{measures[n]:.12g}" for n in row}
            cells |= {n: row[n] for n in ("run_timestep", "time_s") if n in row and measures}
            lines.append(",".join(cells.values()))
        words = _comparing.tables(text, "\n".join([*lines, ""]))
        self._claims.judge(f"{run.folder}/{MEASURES_CSV}", words, f"{len(rows)} timesteps")

    def _compare_row(
        self, run: PackedRun, experiment: ExperimentMessage, results: Mapping[str, float]
    ) -> None:
        """Compares what of a row follows from the recording and from timesteps.csv."""
        if run.row is None or not run.table:
            return
        before = _comparing.row_of(self._places.package / run.table, run.row)
        tags = [robot.get("tag") for robot in experiment.robots]
        now = {"robots": str(len(tags)), "tags": " ".join(map(str, tags))}
        now |= {name: f"{value:.12g}" for name, value in results.items() if name in before}
        now |= self._timing(run, experiment, before)
        words = f"{', '.join(now)}; its other cells were measured"
        thing = f"{run.title}: row of {run.table}"
        self._claims.judge(thing, _comparing.cells(before, now), words)

    def _timing(
        self, run: PackedRun, experiment: ExperimentMessage, before: Mapping[str, str]
    ) -> dict[str, str]:
        """The share of late timesteps, as `vsense.run.figures` counts it."""
        path = self._places.package / run.folder / TIMESTEPS_CSV
        if not run.folder or not os.path.isfile(path) or not experiment.timestep_s:
            return {}
        with path.open(encoding="utf-8", errors="replace") as file:
            rows = list(csv.DictReader(file))
        try:
            dt_ns = round(experiment.timestep_s * 1e9)
            wanted = round(float(before["duration_s"]) / experiment.timestep_s)
            spans = [int(row["sent_ns"]) - int(row["capture_ns"]) for row in rows]
        except (KeyError, TypeError, ValueError):
            return {}
        late = sum(span > dt_ns for span in spans) + wanted - len(rows)
        return {"late": f"{late / wanted:.12g}"} if wanted else {}

    def _say(self, text: str) -> None:
        self._show(text)
        if self._interrupted.is_set():
            raise Interrupted
