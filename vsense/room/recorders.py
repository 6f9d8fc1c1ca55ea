"""The recordings of one process: a file per run, begun with it or by whoever presses record."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from vsense import recording
from vsense.arena import Frame
from vsense.hub import Hub
from vsense.room.messages import Data

if TYPE_CHECKING:
    from vsense.config.specs import MarkerSpec
    from vsense.config.tracking_build import Tracking
    from vsense.config.tracking_specs import TrackingSession
    from vsense.recording.recorder import Recorder
    from vsense.runtime import Pictures
    from vsense.tracking.arena_tracker import ArenaTracker
    from vsense.tracking.camera import Camera

OFF: Data = {"on": False, "file": None, "bytes": 0, "lost_messages": 0, "trouble": None}


class Recorders:
    """Makes and ends recordings; its methods may be called by any thread."""

    def __init__(self, hub: Hub, wanted: bool, pictures: bool) -> None:
        """Prepares recordings.

        Args:
            hub: what is recorded.
            wanted: every run is recorded from its beginning; else only when somebody wants it.
            pictures: cameras' pictures are recorded, too.
        """
        self._tracker: Mapping[str, Any] | None = None
        self._hub = hub
        self._wanted = wanted
        self._pictures = pictures
        self._path = Path()
        self._recorder: Recorder | None = None
        self._lock = threading.RLock()

    def begin_run(self, path: Path) -> None:
        """A run begins; `path` is where its recording goes.

        Raises:
            VsenseError: it cannot be made, or a library is missing.
        """
        with self._lock:
            self._path = path
            if self._wanted:
                self._open()

    def end_run(self) -> None:
        """Completes the run's recording."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.close()

    def switch(self, on: bool) -> str:
        """Switches the recording on or off; gives a line for people.

        Raises:
            VsenseError: it cannot be made, or a library is missing.
        """
        with self._lock:
            self._wanted = on
            recorder = self._recorder
            if recorder is None and on:
                return f"recording to {self._open().path}"
            if recorder is None:
                return "nothing was being recorded"
            if on:
                recorder.resume()
                return f"recording goes on in {recorder.path}"
            recorder.pause()
            return "recording is off"

    def watch_session(self, session: TrackingSession, tracking: Tracking) -> None:
        """Has recordings hold the pictures of a tracking session, if it or its file wants them.

        Raises:
            VsenseError: a library is missing.
        """
        self._pictures |= session.record.record_image
        if self._pictures:
            made = _recording().tracker_made.of_session(session)
            tracking.record = self._watched(made, tracking.tracker)

    def watch_family(
        self,
        cameras: Sequence[Camera],
        marker: MarkerSpec,
        source: Pictures,
        tracker: ArenaTracker,
    ) -> None:
        """Has recordings hold the pictures of cameras that look for one family of markers.

        Raises:
            VsenseError: a library is missing.
        """
        if self._pictures:
            heights_m = dict(tracker.heights_m)
            made = _recording().tracker_made.of_family(cameras, marker.family, heights_m)
            source.record = self._watched(made, tracker)

    def _watched(
        self, made: Mapping[str, Any], tracker: ArenaTracker
    ) -> Callable[[Sequence[Frame]], None]:
        self._tracker = made

        def record(frames: Sequence[Frame]) -> None:
            recorder = self._recorder
            if recorder is not None:
                recorder.pictures(frames, tracker)

        return record

    def state(self) -> Data:
        """How it goes; "recording" of the message /run."""
        recorder = self._recorder
        return dict(OFF) if recorder is None else recorder.state()

    def _open(self) -> Recorder:
        recorder: Recorder = _recording().recorder.Recorder(self._hub, self._path, self._pictures)
        if self._tracker is not None:
            recorder.describe_tracker(self._tracker)
        self._recorder = recorder
        return recorder


def _recording() -> ModuleType:
    """The package with recordings. Whoever records nothing needs no library for it.

    Raises:
        UsageError: that is missing.
    """
    recording.require()
    importlib.import_module("vsense.recording.recorder")
    importlib.import_module("vsense.recording.tracker_made")
    return recording
