"""Makes what a tracking session asks for: grabbers, detectors, arena tracker and health.

This is the factory of the thesis's figure 2.11.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.arena import ArenaState, Frame
from vsense.cameras.camera import Camera
from vsense.cameras.grabber import CameraEvent, GrabberError
from vsense.cameras.health import Health
from vsense.cameras.recorded_grabber import CameraRecording, PacedGrabber, RecordedGrabber
from vsense.cameras.recordings import DirectoryRecording, VideoRecording
from vsense.config.live_cameras import live_grabber
from vsense.config.tracking_specs import (
    DIRECTORY,
    CameraTrackerSpec,
    GrabberSpec,
    TrackerSpec,
    TrackingSession,
)
from vsense.markers.families import SquareFamily, load_family
from vsense.tracking.arena_tracker import ArenaTracker
from vsense.tracking.detector import Detector, make_detector
from vsense.tracking.prediction import Prediction, SearchPlan
from vsense.tracking.tracks import Limits


class SetGrabber(Protocol):
    """A camera set that also says what happens to its cameras."""

    @property
    def timesteps(self) -> int | None:
        """How many there are, where that is known."""

    @property
    def missed(self) -> int:
        """Timesteps that were left out because later ones were due already."""

    def next(self, timeout_s: float) -> Sequence[Frame]:
        """Waits for the next timestep's pictures; see `vsense.cameras.grabber.Grabber`."""

    def events(self) -> list[CameraEvent]:
        """Gives what happened since the last call."""

    def close(self) -> None:
        """Lets the cameras go; can be called again."""


class CameraDetectors:
    """A detector that finds in each camera's pictures what that camera's tracker looks for."""

    def __init__(self, detectors: Mapping[str, Detector]) -> None:
        """Takes the detector of each camera."""
        self._detectors = detectors
        self._each = list({id(detector): detector for detector in detectors.values()}.values())

    @property
    def overflows(self) -> int:
        """Pictures with more in them than the detectors' tables hold; markers may be missed."""
        return sum(detector.overflows for detector in self._each)

    def detect(self, image: NDArray[np.uint8], camera: Camera) -> NDArray[np.void]:
        """Returns the DETECTION array of a (height, width) uint8 picture of `camera`."""
        return self._detectors[camera.id].detect(image, camera)


class Tracking:
    """A tracking session at work.

    Attributes:
        grabber: where the pictures come from.
        tracker: makes the arena state of them.
        cameras: the arena's cameras, in the session's order.
        record: takes the pictures that the tracker is about to be given, in the tracker's thread.
    """

    def __init__(self, session: TrackingSession, grabber: SetGrabber) -> None:
        """Starts the tracker's workers.

        Args:
            session: what to track.
            grabber: where the pictures come from.

        Raises:
            VsenseError: a family does not have the tags.
        """
        self.grabber = grabber
        self.cameras = [view.camera for view in session.views]
        heights_m = session.heights_m
        speed_m_s = max(view.tracker.max_speed_m_s for view in session.views)
        prediction = Prediction(SearchPlan(session.key_frame_period, session.square_size_m))
        make = lambda: _detectors(session.views, prediction)  # noqa: E731
        self.tracker = ArenaTracker(
            self.cameras, make, heights_m, Limits(speed_m_s), pin=True, prediction=prediction
        )
        self.record: Callable[[Sequence[Frame]], None] = lambda frames: None
        self._health = Health(self.cameras, self.tracker.heights_m)

    def step(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame], list[CameraEvent]]:
        """Waits for pictures and makes the arena state of them.

        Returns:
            The state, its pictures, and what happened to the cameras.

        Raises:
            NoMorePictures: a recording has come to its end.
            GrabberError: no picture came in `timeout_s`.
        """
        frames = self.grabber.next(timeout_s)
        self.record(frames)
        tracker = self.tracker
        state = tracker.update(frames)
        events = self.grabber.events()
        return (
            state,
            frames,
            events + self._health.update(frames, tracker.found, tracker.overflowed),
        )

    def close(self) -> None:
        """Ends the workers and lets the cameras go; can be called again."""
        self.grabber.close()
        self.tracker.close()


def build(session: TrackingSession, clock: Callable[[], int], offline: bool) -> Tracking:
    """Opens a session's cameras or recordings and gets everything ready.

    Args:
        session: what to track.
        clock: the host's monotonic clock [ns].
        offline: give recordings out as fast as they are asked for, not at their own pace.

    Raises:
        ConfigError: a recording cannot be used; the error names the place in the resources file.
        VsenseError: something else cannot be used.
    """
    grabber = _grabber(session, clock, offline)
    try:
        return Tracking(session, grabber)
    except BaseException:
        grabber.close()
        raise


def _grabber(session: TrackingSession, clock: Callable[[], int], offline: bool) -> SetGrabber:
    sizes_px = {v.camera.id: (v.camera.width_px, v.camera.height_px) for v in session.views}
    if session.is_live:
        return live_grabber(session, sizes_px, clock)
    recordings = {v.camera.id: _recording(session, v.grabber) for v in session.views}
    recorded = RecordedGrabber(recordings, sizes_px, clock)
    return recorded if offline else PacedGrabber(recorded, clock)


def _recording(session: TrackingSession, spec: GrabberSpec) -> CameraRecording:
    kind = DirectoryRecording if spec.type == DIRECTORY else VideoRecording
    start_ns = round(spec.start_s * 1e9)
    try:
        return kind(Path(spec.source), spec.timestamps, start_ns, spec.frame_rate_hz)
    except GrabberError as error:
        raise session.resources.error(spec.line, f"<grabber> path: {error}") from None


def _detectors(views: Sequence[CameraTrackerSpec], prediction: Prediction) -> CameraDetectors:
    """Makes one detector per tracker; cameras of one tracker share it."""
    trackers = {view.tracker.id: view.tracker for view in views}
    made = {id: _detector(tracker, prediction) for id, tracker in trackers.items()}
    return CameraDetectors({v.camera.id: made[v.tracker.id] for v in views})


def _detector(tracker: TrackerSpec, prediction: Prediction) -> Detector:
    """Makes the detector of a tracker's family, for one thread."""
    family = load_family(tracker.family)
    if isinstance(family, SquareFamily):
        family = replace(family, heading_deg=family.heading_deg + tracker.heading_deg)
    heights_m = tracker.heights_m.values()
    return make_detector(
        family,
        sorted(tracker.heights_m),
        median(heights_m),
        prediction,
        set(heights_m),
        tracker.open_roster,
    )
