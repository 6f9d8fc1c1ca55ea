"""Cameras of our own, and recordings in their place, as sources of arena states."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from vsense.arena import ArenaState, Frame
from vsense.cameras.grabber import CameraEvent, GrabberError, Troubles
from vsense.cameras.opencv_source import teach_opencv
from vsense.cameras.recorded_grabber import PacedGrabber, RecordedGrabber
from vsense.config.tracking_build import build
from vsense.config.tracking_specs import TrackingSession


class CameraSource:
    """A tracking session at work; `next` belongs to one thread, the rest to any.

    Attributes:
        session: what it is made from.
        tracking: its parts.
        troubles: what its cameras suffer from.
    """

    def __init__(
        self,
        session: TrackingSession,
        tell: Callable[[str], None],
        clock: Callable[[], int],
    ) -> None:
        """Opens the session's cameras or recordings.

        Args:
            session: what to track.
            tell: takes what happens to cameras; must not wait.
            clock: the host's monotonic clock [ns].

        Raises:
            VsenseError: a recording or a marker family cannot be used. A camera that does not
                open is told and tried again.
        """
        teach_opencv()
        self.session = session
        self.tracking = build(session, clock, offline=True)
        self._tell = tell
        self._pictures = 0
        self.troubles = Troubles()

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for pictures and tracks the robots in them.

        Raises:
            NoMorePictures: a recording has come to its end.
            GrabberError: no picture came in time.
            VsenseError: the tracker has failed.
        """
        try:
            state, frames, events = self.tracking.step(timeout_s)
        except GrabberError:
            self._tell_some(self.tracking.grabber.events())
            raise
        self._pictures += len(frames)
        self._tell_some(events)
        return state, frames

    def start_run(self) -> None:
        """Cameras are watched in a run and out of it."""

    def stop_run(self) -> None:
        """See `start_run`."""

    def figures(self) -> dict[str, int]:
        """What is reported: pictures, timesteps left out, and troubles of cameras."""
        return {
            "pictures": self._pictures,
            "left_out": self.tracking.grabber.missed,
            "camera_events": sum(self.troubles.counts.values()),
        }

    def close(self) -> None:
        """Lets the cameras go; can be called again."""
        self.tracking.close()

    def _tell_some(self, events: Iterable[CameraEvent]) -> None:
        for line in self.troubles.lines(events):
            self._tell(line)


class RecordingSource(CameraSource):
    """A recording, played from its beginning when the run starts.

    Until then its first pictures are all that the cameras see, again and again: robots may take
    their time to connect. All capture times are the host's, as if it were happening now.
    """

    def __init__(
        self,
        session: TrackingSession,
        timestep_ns: int,
        tell: Callable[[str], None],
        clock: Callable[[], int],
    ) -> None:
        """Opens the recordings.

        Args:
            session: what to track; its pictures are recordings.
            timestep_ns: so often the first pictures are seen before the run.
            tell: takes what happens to cameras; must not wait.
            clock: the host's monotonic clock [ns].

        Raises:
            VsenseError: a recording or a marker family cannot be used.
        """
        super().__init__(session, tell, clock)
        recorded = self.tracking.grabber
        assert isinstance(recorded, RecordedGrabber)
        self._player = Player(recorded, timestep_ns / 1e9, clock)
        self.tracking.grabber = self._player

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the next pictures and tracks the robots in them.

        Raises:
            NoMorePictures: the recording has come to its end.
            GrabberError: no picture was due in time.
            VsenseError: the tracker has failed.
        """
        if self._player.still:
            # Not by way of the cameras' health: it would take them for frozen.
            frames = self._player.next(timeout_s)
            self.tracking.record(frames)
            return self.tracking.tracker.update(frames), frames
        return super().next(timeout_s)

    def start_run(self) -> None:
        """Has the recording played."""
        self._player.play()

    def close(self) -> None:
        """Ends all waiting and closes the recording; can be called again."""
        self._player.close()
        super().close()


class Player:
    """Hands a recording out: its first pictures until `play`, then all at their own pace.

    Attributes:
        timesteps: how many there are.
    """

    def __init__(
        self, recorded: RecordedGrabber, period_s: float, clock: Callable[[], int]
    ) -> None:
        """Stands still at the first pictures.

        Args:
            recorded: the recording; it is this player's alone.
            period_s: time between two looks at the first pictures.
            clock: the host's monotonic clock [ns].
        """
        self.timesteps = recorded.timesteps
        self._recorded = recorded
        self._period_s = period_s
        self._clock = clock
        self._started = threading.Event()
        self._first: Sequence[Frame] = ()
        self._paced: PacedGrabber | None = None
        self._shift_ns = 0
        self._timestep = -1

    @property
    def missed(self) -> int:
        """Timesteps left out because a later one was due already."""
        return self._recorded.missed

    @property
    def still(self) -> bool:
        """Whether the next pictures are the first ones again."""
        return not self._started.is_set()

    def play(self) -> None:
        """Goes on from now; any thread."""
        self._started.set()

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits until the next pictures are due; they are dated as if taken now.

        Raises:
            NoMorePictures: the recording has come to its end.
            GrabberError: none was due in `timeout_s`.
        """
        if not self._first:
            self._first = self._recorded.next(timeout_s)
        elif self._started.wait(min(self._period_s, timeout_s)):
            return self._played(timeout_s)
        return self._dated(self._first, anew=True)

    def events(self) -> list[CameraEvent]:
        """Gives what happened since the last call."""
        return self._recorded.events()

    def close(self) -> None:
        """Ends all waiting and closes the recording; can be called again."""
        self._started.set()
        if self._paced is not None:
            self._paced.close()
        self._recorded.close()

    def _played(self, timeout_s: float) -> Sequence[Frame]:
        if self._paced is not None:
            return self._dated(self._paced.next(timeout_s))
        self._paced = PacedGrabber(self._recorded, self._clock)
        return self._dated(self._paced.next(timeout_s), anew=True)

    def _dated(self, frames: Sequence[Frame], anew: bool = False) -> Sequence[Frame]:
        """Moves pictures to the host's clock; `anew`: the newest of them was taken just now."""
        now_ns = self._clock()
        if anew:
            self._shift_ns = now_ns - max(frame.capture_ns for frame in frames)
        self._timestep += 1
        return [
            replace(
                frame,
                timestep=self._timestep,
                capture_ns=frame.capture_ns + self._shift_ns,
                ready_ns=now_ns,
            )
            for frame in frames
        ]
