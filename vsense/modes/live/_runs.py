"""The runs of `vsense camera track`: what orders begin and end, what each shows, and what is kept.

Thesis, 2.3.1: with `change_root_directory_on_start` each run is what lies between a start and a
stop, and has a recording of its own; without it all are one, which a stop only suspends.
"""

from __future__ import annotations

import json
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vsense.base.arena import ArenaState, Frame
from vsense.base.errors import VsenseError, failing_as
from vsense.base.terminal import Console, print_data
from vsense.modes._several import Series
from vsense.modes.live._talk import Talk
from vsense.monitor.recording import MCAP
from vsense.monitor.recording.form import Data
from vsense.monitor.recording.pictures import (
    BackgroundRecorder,
    PictureRecorder,
    PictureRecordingError,
    write_session_files,
)
from vsense.monitor.ui.recorders import OFF, Recorders
from vsense.run import directory as run_directory
from vsense.run.control import TRACKING_RULES, Control, State
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.specs import TrackingSession


class RunPictures:
    """Keeps pictures while a run is on. A disk that fails ends the recording, not the run.

    Attributes:
        wanted: whether pictures are kept; any thread.
        failure: why a recording is not whole, None: nothing has failed.
        trouble: likewise of the present run, or the last one.
    """

    def __init__(
        self,
        begin: Callable[[], BackgroundRecorder | None],
        each_run: bool,
        say: Callable[[str], None],
    ) -> None:
        """`begin` gives None where no recording is wanted; `each_run`: one for every run."""
        self.wanted = True
        self.failure: PictureRecordingError | None = None
        self.trouble: PictureRecordingError | None = None
        self._begin = begin
        self._each_run = each_run
        self._say = say
        self._recorder: BackgroundRecorder | None = None
        self._given_up = False

    def begin_run(self) -> None:
        """Begins the recording now, and not with the first picture.

        PictureRecordingError if it cannot be begun; the run can go on without.
        """
        self.trouble, self._given_up = None, False
        try:
            self._open()
        except PictureRecordingError as error:
            self._give_up(error)
            raise

    def timestep(self, running: bool, frames: Sequence[Frame]) -> None:
        """Takes the pictures of a timestep; they are kept where it belongs to a run."""
        if not running:
            if self._each_run:
                self.close()
            self._given_up = False
            return
        if not self.wanted or self._given_up:
            return
        try:
            self._open()
            if self._recorder is not None:
                self._recorder.write(frames)
        except PictureRecordingError as error:
            self._give_up(error)
            self._say(f"{error}; this run is not recorded")
            self.close()

    def _open(self) -> None:
        """Begins the recording where one is wanted, and none is there."""
        if self.wanted and self._recorder is None:
            self._recorder = self._begin()

    def _give_up(self, error: PictureRecordingError) -> None:
        """Nothing is tried again before the next run, or before somebody wants it."""
        self._given_up = True
        self.failure = self.failure or error
        self.trouble = error

    def end_run(self) -> Data:
        """Ends the run, and its recording if each has one; gives the recording's last `state`."""
        recorder = self._recorder
        self.timestep(False, ())
        return self._state_of(recorder)

    def switch(self, on: bool) -> str:
        """Switches the recording on or off; gives a line for people. Any thread."""
        self.wanted, self._given_up = on, False
        return "pictures are kept" if on else "pictures are not kept any more"

    def state(self) -> Data:
        """The "recording" of the message /run; any thread."""
        return self._state_of(self._recorder)

    def _state_of(self, recorder: BackgroundRecorder | None) -> Data:
        trouble = None if self.trouble is None else str(self.trouble)
        if recorder is None:
            return {**OFF, "trouble": trouble}
        disk = recorder.recorder
        return {
            "on": self.wanted,
            "file": str(disk.directory),
            "bytes": disk.bytes,
            "lost_messages": recorder.dropped,
            "trouble": trouble,
        }

    def close(self) -> None:
        """Ends the recording; can be called again."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        try:
            recorder.close()
        except PictureRecordingError as error:
            if error is not self.trouble:
                self._say(str(error))
            self._give_up(error)
        self._say(recorder.in_words())
        if recorder.dropped:
            why = "could not be encoded and written as fast as they came"
            self._say(f"the pictures of {recorder.dropped} timesteps {why}: they are left out")


def begin_recording(session: TrackingSession, talk: Talk) -> BackgroundRecorder | None:
    """Begins the recording that the experiment file asks for."""
    record = session.record
    if not record.record_image:
        return None
    directory = record.root_directory
    if record.change_root_directory_on_start:
        with failing_as(PictureRecordingError, f"{directory}: cannot be written"):
            directory = run_directory.make_new(directory / time.strftime("%Y-%m-%d-%H%M%S"))
    cameras = [view.camera for view in session.views]
    recorder = PictureRecorder(directory, cameras, record.image_format)
    trackers = {view.camera.id: view.tracker for view in session.views}
    with failing_as(PictureRecordingError, f"{directory}: cannot be written"):
        write_session_files(directory, cameras, trackers, session.mask)
    talk.say(f"recording into {directory}")
    return BackgroundRecorder(recorder)


@dataclass(slots=True)
class RunCounts:
    """What one run has shown; `before` are the cameras' counts when it began."""

    before: Mapping[str, int]
    timestep: int = -1
    timesteps: int = 0
    pictures: int = 0
    detected: int = 0
    time_ns: int = 0
    seen: Counter[int] = field(default_factory=Counter)
    _last: tuple[int, int] | None = None

    def add(self, state: ArenaState, pictures: int) -> None:
        """Counts a timestep of the run; those that were left out have numbers, too."""
        last = self._last
        self.timestep += 1 if last is None else max(state.timestep - last[0], 1)
        self.time_ns += 0 if last is None else max(state.capture_ns - last[1], 0)
        self._last = state.timestep, state.capture_ns
        self.timesteps += 1
        self.pictures += pictures
        self.detected += state.detected
        # A robot that is never seen belongs in the table, too.
        robots = state.robots
        for tag, seen in zip(robots["tag"].tolist(), robots["seen"].tolist(), strict=True):
            self.seen[tag] += seen

    def pause(self) -> None:
        """The run is suspended: the time until its next timestep does not count."""
        self._last = None

    def summary(self, now: Mapping[str, int]) -> dict[str, Any]:
        """The figures; `now` are the cameras' counts."""
        time_s, most = self.time_ns / 1e9, max(self.timesteps, 1)
        rate_hz = (self.timesteps - 1) / time_s if time_s > 0.0 else None
        return {
            "timesteps": self.timesteps,
            "time_s": round(time_s, 3),
            "rate_hz": None if rate_hz is None else round(rate_hz, 3),
            "pictures": self.pictures,
            "detected_per_timestep": round(self.detected / most, 4),
            "robots": {str(tag): round(self.seen[tag] / most, 4) for tag in sorted(self.seen)},
            "cameras": {name: now[name] - self.before.get(name, 0) for name in now},
        }


class Runs:
    """The runs of one process; all methods but `recording` belong to its thread.

    Attributes:
        control: the state of the runs; takes orders.
        stays: after a run the process waits for the next one.
        counts: of the present run, or the last one.
        ended: number of the last run that is completed.
        directory: of the present run; None: nothing is kept.
        recorders: of MCAP files.
        pictures: of folders, as the experiment file wants them.
    """

    def __init__(
        self,
        name: str,
        recorders: Recorders,
        pictures: RunPictures,
        console: Console,
        interrupted: threading.Event,
        stays: bool,
        folders: bool,
        holds: bool = False,
        suspends: bool = False,
    ) -> None:
        """`name` is the session's; `folders`: its experiment file wants pictures in folders.

        For `holds` and `suspends` see `Control`.
        """
        self.name, self.stays = name, stays
        self.control = Control(
            lambda wanted: None,
            console.say,
            holds,
            suspends,
            record=self._switch,
            rules=TRACKING_RULES,
        )
        self.recorders, self.pictures = recorders, pictures
        self.counts = RunCounts({})
        self.directory: Path | None = None
        self.ended = 0
        self._console, self._interrupted = console, interrupted
        self._folders, self._files = folders, recorders.wanted or not folders
        self._series: Series | None = None
        self._trouble: VsenseError | None = None
        self._failure: VsenseError | None = None
        self._summaries: list[dict[str, Any]] = []
        self._lock = threading.RLock()

    def keep_in(self, wanted: Path | None) -> None:
        """Makes the folder of all runs, `wanted` or one in `runs/`.

        UnusableDirectory if it cannot be made, or is not empty.
        """
        root = run_directory.make(wanted, self.name, None)
        say = self._console.say
        self._series = Series(self.name, root, 1, self.stays, self._interrupted, say)
        for summary in self._summaries:
            self._series.add(summary)

    @property
    def running(self) -> bool:
        """Whether the present timestep belongs to a run."""
        return self.control.state == State.RUNNING

    def recording(self) -> Data:
        """The "recording" of the message /run: what is true on the disk; any thread."""
        state = self.recorders.state()
        state = self.pictures.state() if self._folders and state["file"] is None else state
        trouble = state["trouble"] or self._trouble or self.pictures.trouble
        return {**state, "trouble": None if trouble is None else str(trouble)}

    @property
    def failure(self) -> VsenseError | None:
        """What could not be kept as it was wanted, in any run; None: nothing has failed."""
        return self._failure or self.pictures.failure

    def begin(self, tracking: CameraTracking) -> None:
        """Begins what a run keeps, when it is RUNNING and before its first timestep.

        A disk that fails is told and ends nothing, but for a process that has only this run.

        Raises:
            PictureRecordingError: the folder that the experiment file names cannot be used.
            DirectoryError: likewise that of the run.
        """
        self.counts = RunCounts(tracking.figures())
        self._trouble = None
        for begin in (self._begin_folder, self.pictures.begin_run):
            try:
                begin()
            except (run_directory.DirectoryError, PictureRecordingError) as error:
                if self.control.run == 1 and not self.stays:
                    raise
                self._trouble = error
                self._failure = self._failure or error
                self._console.say(f"vsense: {error}; tracking goes on without", "trouble")

    def suspend(self) -> None:
        """The run stands still, and what is recorded, too."""
        self.counts.pause()
        self.recorders.suspend()

    def end(self, tracking: CameraTracking) -> None:
        """Completes what the run has kept, and its figures."""
        self.ended = self.control.run
        pictures, recording = self.pictures.end_run(), self.recorders.end_run()
        recording = pictures if recording["file"] is None else recording
        summary = {
            "session": self.name,
            "run": self.control.run,
            "ended": self.control.why,
            **self.counts.summary(tracking.figures()),
            "recording": {name: recording[name] for name in ("file", "bytes", "lost_messages")},
        }
        self._summaries.append(summary)
        if self._series is not None:
            self._series.add(summary)
        directory, self.directory = self.directory, None
        if directory is None:
            return
        try:
            run_directory.write_summary(directory, summary, False)
        except run_directory.DirectoryError as error:
            self._console.say(f"the run's figures are not kept: {error}", "trouble")

    def next_run(self) -> None:
        """Goes on to the next run; nobody sees the last one's figures under its number."""
        self.counts = RunCounts({})
        self.control.next_run()

    def report(self, on_stdout: bool) -> None:
        """Writes the figures of all runs where there may be several, and prints what is wanted.

        VsenseError if that is not possible.
        """
        several = self.stays or len(self._summaries) > 1
        if self._series is not None and several:
            self._series.end(None, on_stdout)
        elif on_stdout:
            single = self._summaries[0] if self._summaries else {}
            data = {"experiment": self.name, "runs": self._summaries} if several else single
            print_data(json.dumps(data, indent=2))

    def _begin_folder(self) -> None:
        with self._lock:
            # An order may have been faster.
            if self.directory is None and (self._series is not None or self.recorders.wanted):
                self._open()

    def _open(self) -> None:
        """Makes the run's folder, into which its recording goes if it is wanted."""
        if self._series is None:
            self.keep_in(None)
        assert self._series is not None
        self.directory = self._series.directory(self.control.run)
        self.recorders.begin_run(self.directory / f"{self.name}{MCAP}")

    def _switch(self, on: bool) -> str:
        """Carries out RECORD, of all that was recorded from the beginning; else of an MCAP file."""
        said = [self.pictures.switch(on)] if self._folders else []
        if self._files:
            said.append(self._switch_file(on))
        return "; ".join(said)

    def _switch_file(self, on: bool) -> str:
        with self._lock:
            if (
                on
                and self.directory is None
                and self.control.state in (State.RUNNING, State.PAUSED)
            ):
                self._open()
        return self.recorders.switch(on)
