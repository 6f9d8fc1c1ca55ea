"""The pictures of an arena tracking server's runs, kept where the experiment file asks for it.

Thesis, 2.2.2 and 2.3.1: with `change_root_directory_on_start` each run is a recording of its own,
without it all runs are one, which goes on with the next run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vsense.arena import Frame
from vsense.tracking.picture_recorder import BackgroundRecorder, RecordingError


class RunPictures:
    """Keeps pictures while a run is on. A disk that fails ends the recording, not the server."""

    def __init__(
        self,
        begin: Callable[[], BackgroundRecorder | None],
        each_run: bool,
        say: Callable[[str], None],
    ) -> None:
        """Begins nothing yet.

        Args:
            begin: begins a recording; None where none is wanted.
            each_run: every run is a recording of its own.
            say: takes a line for a person.
        """
        self._begin = begin
        self._each_run = each_run
        self._say = say
        self._recorder: BackgroundRecorder | None = None
        self._running = False

    def timestep(self, running: bool, frames: Sequence[Frame]) -> None:
        """Takes the pictures of a timestep; they are kept where it belongs to a run."""
        try:
            if running and not self._running and self._recorder is None:
                self._recorder = self._begin()
            self._running = running
            if running and self._recorder is not None:
                self._recorder.write(frames)
            elif not running and self._each_run:
                self.close()
        except RecordingError as error:
            self._say(f"{error}; this run is not recorded")
            self.close()

    def close(self) -> None:
        """Ends the recording; can be called again."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        try:
            recorder.close()
        except RecordingError as error:
            self._say(str(error))
        if recorder.dropped:
            self._say(f"the disk was too slow: {recorder.dropped} timesteps were not recorded")
