"""The recordings of one process: a file per run, begun with it or by an order."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.arena import Frame
from vsense.base.clock import pace
from vsense.base.errors import VsenseError
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Level
from vsense.monitor import recording
from vsense.monitor.recording.form import Data

if TYPE_CHECKING:
    from vsense.config.specs import MarkerSpec
    from vsense.monitor.recording._recorder import Recorder
    from vsense.vision.tracking.camera_tracking import CameraTracking
    from vsense.vision.tracking.specs import TrackingSession

OFF: Data = {
    "on": False,
    "file": None,
    "bytes": 0,
    "lost_messages": 0,
    "lost_why": None,
    "trouble": None,
}


class Recorders:
    """Makes and ends recordings; its methods may be called by any thread.

    Args:
        bus: what is recorded.
        wanted: every run is recorded from its beginning; else only by an order.
        pictures: cameras' pictures are recorded, too.
        trouble: takes a line about what cannot be recorded; any thread.
        say: likewise about what is recorded, and where.
    """

    def __init__(
        self,
        bus: MessageBus,
        wanted: bool,
        pictures: bool,
        trouble: Callable[[str], None],
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._tracker: Mapping[str, Any] | None = None
        # Until pictures were tried: how long a timestep is, and the newest pictures.
        self._timestep_s: float | None = None
        self._sample: Sequence[Frame] = ()
        self._can_slow = False
        self._bus = bus
        self._wanted = wanted
        self._pictures = pictures
        self._trouble, self._say = trouble, say
        self._path: Path | None = None
        self._recorder: Recorder | None = None
        self._suspended = False
        self._lock = threading.RLock()

    def begin_run(self, path: Path) -> None:
        """Begins a run, whose recording goes to `path`."""
        self.end_run()
        with self._lock:
            self._path, self._suspended = path, False
            self._try()
            if self._wanted and self._open():
                self._say(f"recording to {path}")

    def end_run(self) -> Data:
        """Completes the run's recording, says where it is, and gives its last `state`."""
        with self._lock:
            recorder, self._recorder, self._path = self._recorder, None, None
        if recorder is None:
            return dict(OFF)
        # While what waits is written; it may be seconds.
        self._say(f"completing the recording {recorder.path}")
        seconds = recorder.seconds
        recorder.close()
        state = recorder.state()
        self._say(recording.size_line(recorder.path, state["bytes"], seconds))
        if state["lost_messages"]:
            lost, why = state["lost_messages"], state["lost_why"] or "they cannot be written"
            self._trouble(
                f"the recording lacks {lost} messages and pictures: {why}; vsense report shows when"
            )
        return state

    @property
    def wanted(self) -> bool:
        """Whether this run, or the next one, is to be recorded."""
        return self._wanted

    def suspend(self) -> None:
        """The run stands still, and so does its recording, until `go_on`."""
        with self._lock:
            self._suspended = True
            if self._recorder is not None:
                self._recorder.pause()

    def go_on(self) -> None:
        """The run goes on, and so does its recording, if it is wanted."""
        with self._lock:
            self._suspended = False
            if not self._wanted:
                return
            if self._recorder is not None:
                self._recorder.resume()
            elif self._open():
                self._say(f"recording to {self._path}")

    def switch(self, on: bool) -> str:
        """Switches the recording on or off; gives a line for people, and does not wait for disks.

        UsageError if a library is missing.
        """
        recording.require()
        with self._lock:
            self._wanted, recorder, path = on, self._recorder, self._path
        if path is None:
            return f"the next run is {'' if on else 'not '}recorded"
        if self._suspended:
            return f"the run is {'' if on else 'not '}recorded when it goes on"
        if recorder is None and on:
            threading.Thread(target=self._open_late, name="vsense-record", daemon=True).start()
            return f"recording to {path}"
        if recorder is None:
            return "nothing was being recorded"
        if on:
            recorder.resume()
            return f"recording goes on in {recorder.path}"
        recorder.pause()
        return f"recording is off: {recorder.path}"

    def watch_session(
        self,
        session: TrackingSession,
        tracking: CameraTracking,
        by_file: bool = True,
        timestep_s: float | None = None,
    ) -> None:
        """Records the pictures of a tracking session, if options or, `by_file`, its file want them.

        With `timestep_s`, it is tried before the first run whether this computer keeps up.
        UsageError if a library is missing.
        """
        wanted = by_file and session.record.record_image
        self._wanted, self._pictures = self._wanted or wanted, self._pictures or wanted

        def describe() -> Mapping[str, Any]:
            from vsense.vision.tracking import recorded_tracker

            return recorded_tracker.of_session(session)

        self._watch(tracking, describe, timestep_s)

    def watch_family(self, marker: MarkerSpec, tracking: CameraTracking, timestep_s: float) -> None:
        """Records the pictures of a lab's cameras, if wanted: it can go slower (`--pace`).

        UsageError if a library is missing.
        """
        tracker = tracking.tracker
        cameras, heights_m, offsets = tracker.cameras, dict(tracker.heights_m), tracker.offsets

        def describe() -> Mapping[str, Any]:
            from vsense.vision.tracking import recorded_tracker

            return recorded_tracker.of_family(cameras, marker.family, heights_m, offsets=offsets)

        self._can_slow = True
        self._watch(tracking, describe, timestep_s)

    def _watch(
        self,
        tracking: CameraTracking,
        describe: Callable[[], Mapping[str, Any]],
        timestep_s: float | None,
    ) -> None:
        """`describe` imports the arena tracker, which only pictures need."""
        if not self._pictures:
            return
        recording.require()
        self._tracker, self._timestep_s = describe(), timestep_s

        def record(frames: Sequence[Frame]) -> None:
            if self._timestep_s is not None:
                self._keep(frames)
            recorder = self._recorder
            if recorder is not None:
                recorder.pictures(frames, tracking.tracker)

        tracking.record = record

    def _keep(self, frames: Sequence[Frame]) -> None:
        """Keeps pictures until they are tried; the first of a run wait for that."""
        with self._lock:
            self._sample = [replace(frame, image=frame.image.copy()) for frame in frames]
            self._try()

    def _try(self) -> None:
        """Says once, before a run, what its pictures cost, and whether this computer keeps up."""
        timestep_s, path, sample = self._timestep_s, self._path, self._sample
        if timestep_s is None or path is None or not sample:
            return
        self._timestep_s, self._sample = None, ()
        from vsense.monitor.recording._recorder import try_pictures

        # What cannot be written is said by the recording itself.
        with suppress(VsenseError, OSError):
            able, size = try_pictures(sample, path.parent)
            rate = len(sample) / timestep_s
            words = (
                f"pictures: about {recording.megabytes(60.0 * size * rate)} for each minute of the"
                f" run; of {rate * pace():.0f} in a second this computer writes"
            )
            if able >= rate * pace():
                return self._say(f"{words} all")
            slower = max(math.floor(80.0 * able / rate) / 100.0, 0.01)
            way = f"--pace {slower:g} would do" if self._can_slow else "fewer cameras would do"
            self._say(f"{words} {able:.0f}: some will be left out; {way}")

    def state(self) -> Data:
        """The "recording" of the message /run."""
        recorder = self._recorder
        return dict(OFF) if recorder is None else recorder.state()

    def _report(self, text: str, level: Level) -> None:
        """Takes what a recorder says; any thread."""
        (self._trouble if level == "trouble" else self._say)(text)

    def _open_late(self) -> None:
        with self._lock:
            if self._wanted and self._recorder is None:
                self._open()

    def _open(self) -> bool:
        """Begins the run's recording, or says what prevents it."""
        if self._path is None:
            return False
        try:
            recording.require()
            from vsense.monitor.recording._recorder import Recorder

            recorder = Recorder(self._bus, self._path, self._pictures, self._report)
        except VsenseError as error:
            self._trouble(f"run not recorded: {error}")
            return False
        if self._tracker is not None:
            recorder.describe_tracker(self._tracker)
        self._recorder = recorder
        return True
