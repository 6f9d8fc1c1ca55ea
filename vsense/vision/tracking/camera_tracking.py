"""The camera step: the pictures of a timestep in, one arena state out, camera health beside it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState, Floats, Frame
from vsense.base.errors import GrabberError, NoMorePictures, VsenseError
from vsense.vision.cameras._paced_grabber import HeldPlayer
from vsense.vision.cameras._reference import ReferenceWatch
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import CameraEvent, Grabber, Troubles
from vsense.vision.cameras.health import Health
from vsense.vision.tracking._marker_watch import MarkerWatch
from vsense.vision.tracking._nodes import Nodes
from vsense.vision.tracking._views import ahead_m, heading_px_rad
from vsense.vision.tracking.arena_tracker import ArenaTracker

CHECK_NS = 80_000_000
"""Pictures of a live camera that follow each other faster than this are not all checked."""


class _Tracked(NamedTuple):
    """A picture that was tracked, what was found in its timestep, whether it held too much, and
    how far beside the others it was dated where it was left out for that [ns]."""

    frame: Frame
    seen: Mapping[str, NDArray[np.void]]
    overflowed: bool
    off_ns: int


class CameraTracking:
    """Turns pictures into arena states: of live cameras, of recordings, and of the lab.

    `next` belongs to one thread; all other methods may be called by any. Camera health is checked
    in `check_cameras` only, which the caller of `next` or the thread that uses the states calls
    when the timestep's work is done.

    Attributes:
        record: takes the pictures that the tracker is about to be given, in the thread of `next`;
            none of nodes' cameras, whose coarse ones may be a second older than what they show.
        troubles: what the cameras suffer from.
        nodes: other computers, which have some of the cameras; None: none has.
    """

    def __init__(
        self,
        grabber: Grabber,
        tracker: ArenaTracker,
        say: Callable[[str], None],
        troubles: Troubles | None = None,
        check_all: bool = False,
        nodes: Nodes | None = None,
        references: ReferenceWatch | None = None,
    ) -> None:
        """Takes grabber, tracker and nodes over.

        Args:
            say: takes a line about a camera, for a person; any thread, must not wait.
            troubles: where to count what happens to cameras; None: begins with nothing known.
            check_all: every timestep is checked, as recordings want it: `next` checks what was not
                checked yet. Otherwise only the newest one is, and not more often than every
                `CHECK_NS`.
            nodes: other computers, which have some of the cameras, and look at their pictures.
            references: compares cameras with their reference pictures, before and after runs.
        """
        self.grabber = grabber
        self.tracker = tracker
        self.record: Callable[[Sequence[Frame]], None] = lambda frames: None
        self.troubles = troubles or Troubles()
        self._say = say
        self._check_all = check_all
        self.nodes = nodes
        self._references = references or ReferenceWatch({})
        for note in self._references.notes:
            say(note)
        self._elsewhere = frozenset[str]() if nodes is None else nodes.cameras
        self._health = Health(tracker.cameras, tracker.heights_m, self._elsewhere)
        self._markers = MarkerWatch(tracker.cameras, tracker.heights_m)
        # By camera. The thread of `next` puts in, `check_cameras` takes out.
        self._unchecked: dict[str, _Tracked] = {}
        self._noting = threading.Lock()
        self._checking = threading.Lock()
        self._checked_ns: dict[str, int] = {}
        self._pictures = self._missed_before = 0

    def start(self) -> None:
        """The run begins: timesteps left out count from here, and held recordings are played."""
        self._missed_before = self.grabber.missed
        if isinstance(self.grabber, HeldPlayer):
            self.grabber.play()

    def pause(self) -> None:
        """The run is suspended: a held recording stands still, cameras are tracked on."""
        if isinstance(self.grabber, HeldPlayer):
            self.grabber.pause()

    def go_on(self) -> None:
        """The run goes on, and so does a held recording."""
        if isinstance(self.grabber, HeldPlayer):
            self.grabber.go_on()

    def stop(self) -> None:
        """The run has ended; cameras are tracked in a run and out of it, and compared again."""
        self._references.again()

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the newest pictures and tracks the robots in them.

        Returns:
            The state, and the pictures that it was made from, valid as `Grabber.next` says.

        Raises:
            NoMorePictures: a recording has come to its end.
            GrabberError: no picture came in `timeout_s`.
            VsenseError: the tracker has failed, or a recording had no picture that can be used.
        """
        if self._check_all:
            self.check_cameras()
        self.tracker.learn()  # while no picture waits
        try:
            frames = self.grabber.next(timeout_s)
        except GrabberError as error:
            with self._checking:
                self._tell_events(self._events())
            nothing = isinstance(error, NoMorePictures) and self.tracker.state.timestep < 0
            if nothing and self.troubles.counts:
                raise VsenseError(f"{error}: {self._unusable()}") from None
            raise
        self.record([frame for frame in frames if frame.camera not in self._elsewhere])
        if displaced := self._references.look(frames):
            with self._checking:
                self._tell_events(displaced)
        state = self.tracker.update(frames)
        # A recording that is held shows one picture again and again: its camera has not frozen.
        if not (isinstance(self.grabber, HeldPlayer) and self.grabber.held):
            self._pictures += len(frames)
            self._note(frames)
        return state, frames

    def check_cameras(self) -> None:
        """Checks the newest pictures that were not checked yet, and reports what began or ended.

        It takes 1 ms of processor time for a camera of two megapixels.
        """
        with self._checking:
            events = self._events()
            with self._noting:
                noted, self._unchecked = self._unchecked, {}
            due = [tracked for tracked in noted.values() if self._is_due(tracked.frame)]
            if due:
                newest = max(due, key=lambda tracked: tracked.frame.timestep)
                frames = [tracked.frame for tracked in due]
                seen = {c: t.seen[c] for t in due if (c := t.frame.camera) in t.seen}
                crowded = [tracked.frame.camera for tracked in due if tracked.overflowed]
                off_ns = {tracked.frame.camera: tracked.off_ns for tracked in due}
                events += self._health.update(frames, seen, crowded, newest.seen, off_ns)
                for line in self._markers.update(frames, seen):
                    self._say(line)
            self._tell_events(events)

    def figures(self) -> dict[str, int]:
        """What is reported of the cameras.

        `pictures` that were tracked, without those of a held recording; timesteps `left_out` since
        the start of the run because later ones were due or there; `old_pictures` dropped;
        `overflows` of the detectors' tables; and `camera_events`.
        """
        counters = self.tracker.counters
        return {
            "pictures": self._pictures,
            "left_out": self.grabber.missed - self._missed_before,
            "old_pictures": counters.old_frames
            + counters.repeated_frames
            + counters.untimely_frames,
            "overflows": counters.overflows,
            "camera_events": sum(self.troubles.counts.values()),
        }

    def close(self) -> None:
        """Ends a `next` that waits, lets the cameras go, ends the workers; can be called again."""
        self.grabber.close()
        self.tracker.close()
        if self.nodes is not None:
            self.nodes.close()

    def _events(self) -> list[CameraEvent]:
        """What grabber and nodes have to say of the cameras."""
        return self.grabber.events() + ([] if self.nodes is None else self.nodes.events())

    def _unusable(self) -> str:
        """Says that no picture could be used, and what was wrong with them."""
        counts = sorted(self.troubles.counts.items())
        reasons = ", ".join(f"camera {c}: {count} times {kind}" for (c, kind), count in counts)
        return f"none has a picture that can be used ({reasons})"

    def _note(self, frames: Sequence[Frame]) -> None:
        """Keeps each camera's newest picture for the next check."""
        tracker = self.tracker
        full, off_ns = tracker.overflowed, tracker.untimely_ns
        noted = {
            f.camera: _Tracked(f, tracker.markers, f.camera in full, off_ns.get(f.camera, 0))
            for f in frames
        }
        with self._noting:
            self._unchecked.update(noted)

    def _is_due(self, frame: Frame) -> bool:
        """Whether a picture is to be checked: each camera has a period of its own."""
        last_ns = self._checked_ns.get(frame.camera)
        if not self._check_all and last_ns is not None and frame.capture_ns - last_ns < CHECK_NS:
            return False
        self._checked_ns[frame.camera] = frame.capture_ns
        return True

    def _tell_events(self, events: Iterable[CameraEvent]) -> None:
        for line in self.troubles.lines(events):
            self._say(line)


class ImagePoses:
    """Finds for each robot the picture that shows it best."""

    def __init__(self, cameras: Sequence[Camera], heights_m: Mapping[int, float]) -> None:
        self._cameras = list(cameras)
        self._heights_m = dict(heights_m)

    def learn(self, heights_m: Mapping[int, float]) -> None:
        """Takes the heights of tags that have joined, too; any thread."""
        self._heights_m.update(heights_m)

    def __call__(self, robots: NDArray[np.void]) -> Floats:
        """Returns (n,) POSE robots' poses in the picture whose middle they are nearest to.

        Returns:
            (n, 3) column and row of the disc's centre [px], and the heading in the picture
            [degrees], counter-clockwise in (-180, 180] and 0 to the right.
        """
        height = [self._heights_m.get(int(tag), 0.0) for tag in robots["tag"]]
        place = np.stack((robots["x_m"], robots["y_m"], np.array(height, dtype=float)), axis=-1)
        best = np.zeros((len(robots), 3))
        nearest = np.full(len(robots), np.inf)
        for camera in self._cameras:
            at_px = camera.project(place)
            ahead_px = camera.project(place + ahead_m(robots["yaw_rad"]))
            theta = np.degrees(heading_px_rad(ahead_px - at_px))
            size = np.array((camera.width_px, camera.height_px))
            off = np.abs((at_px + 0.5) / size - 0.5).max(axis=1)
            better = off < nearest
            nearest[better] = off[better]
            best[better] = np.column_stack((at_px, theta))[better]
        return best
