"""A recording as a video: the virtual world over the cameras' pictures, the clock, the measures."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vsense.base.errors import failing_as, instead
from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor.recording import form
from vsense.monitor.recording._film import Film, RecordedPicture
from vsense.monitor.recording._scenes import RecordedScenes
from vsense.monitor.recording._video_file import open_video
from vsense.monitor.recording.form import ExperimentMessage, RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.vision.cameras.camera import Camera, CameraError
from vsense.vision.cameras.picture import PictureError, decode

ARENA_VIEW, BOTH, CAMERAS_VIEW = "arena", "both", "cameras"
MOST_FPS = 30.0
_USUAL_FPS = 10.0
_BEFORE_S = 5.0
_LOOKED_AT = 200
"""Arena states that tell how many there are in a second."""
_LONGEST_S = 60.0  # no timestep is longer
_UNDRAWN = (*DAMAGED, cv2.error)
_DURING = ("running", "paused")


@dataclass(frozen=True, slots=True)
class VideoPlan:
    """What a video shows.

    Attributes:
        view: "arena", "cameras", "both" or a camera's id; None: both where there are pictures.
        from_s, to_s: since the recording's beginning; None: as long as the first run lasts, or all.
        fps: frames per second of the video; None: as many as timesteps pass, at most `MOST_FPS`.
        speed: seconds of the recording per second of the video.
        size: width and height of a frame [px].
        robot: whose senses are drawn.
    """

    view: str | None = None
    from_s: float | None = None
    to_s: float | None = None
    fps: float | None = None
    speed: float = 1.0
    size: tuple[int, int] = (1280, 720)
    robot: int | None = None


class Video:
    """One video of a recording, which nobody else reads meanwhile.

    Attributes:
        frames: how many the video will have.
        fps: so many per second.
        old_pictures: in how many frames that were drawn a camera's picture was old, by its name.

    Raises:
        RecordingError: the recording does not hold what shall be shown.
    """

    def __init__(self, recording: Recording, plan: VideoPlan) -> None:
        self._recording, self._plan, self._name = recording, plan, str(recording.path)
        self.old_pictures = Counter[str]()
        data = recording.experiment
        try:
            self._scenes = RecordedScenes(data, plan.robot)
        except ValueError as error:
            raise RecordingError(f"{self._name}: cannot be drawn: {error}") from None
        facts = ExperimentMessage.read(data)
        self._check_robot(facts)
        self._arena, self._cameras = self._shown(facts)
        timestep_s = facts.timestep_s or 0.0
        usual = 1.0 / timestep_s if 0.0 < timestep_s <= _LONGEST_S else self._rate_hz()
        self.fps = plan.fps or min(usual * plan.speed, MOST_FPS)
        self._from_s, to_s = self._span()
        self.frames = max(int((to_s - self._from_s) / plan.speed * self.fps + 1e-6), 1)
        self._shots = {camera.id: form.PICTURE + camera.id for camera in self._cameras}

    def write(self, path: Path, report: Callable[[int], None], stopped: Callable[[], bool]) -> bool:
        """Writes the video; false where it was stopped, and then nothing is left of it.

        `report` is called with the number of frames so far.

        Raises:
            RecordingError: the file is there already, or cannot be written.
        """
        with open_video(path, self.fps, self._plan.size) as file:
            for number, frame in enumerate(self.images(stopped), 1):
                if stopped():
                    return False
                file.add(frame)
                report(number)
            if file.frames < self.frames:
                return False
            file.finish()
            return True

    def images(self, stopped: Callable[[], bool] = lambda: False) -> Iterator[Any]:
        """All frames, one after the other, (h, w, 3) BGR; no more of them once it is stopped."""
        where, invalid = (
            (self._arena, self._cameras, self._plan.size),
            bool(self._recording.run.why),
        )
        with failing_as(RecordingError, f"{self._name}: cannot be drawn", _UNDRAWN):
            film = Film(self._scenes, *where, self._measured(), invalid)
        self.old_pictures = film.old_pictures
        news = _Ahead(self._recording.messages(set(self._scenes.topics)), lambda m: m.time_ns)
        # Measures are drawn from the beginning on, pictures are wanted from now on.
        since_s = max(self._from_s - _BEFORE_S, 0.0)
        shots = self._recording.messages(set(self._shots.values()), since_s)
        seen = _Ahead(shots, _capture_ns)
        coming: dict[str, Message] = {}
        pictures: dict[str, RecordedPicture] = {}
        for number in range(self.frames):
            time_s = self._from_s + number * self._plan.speed / self.fps
            now_ns = self._recording.begin_ns + round(1e9 * time_s)
            for message in news.until(now_ns):
                # Before the first frame there can be an hour of them.
                if stopped():
                    return
                self._scenes.take(message)
            coming |= {message.topic: message for message in seen.until(now_ns)}
            for camera, topic in self._shots.items():
                picture = _decoded(coming.pop(topic, None))
                if picture is not None:
                    pictures[camera] = picture
            with failing_as(RecordingError, f"{self._name}: cannot be drawn", _UNDRAWN):
                frame = film.frame(pictures, now_ns)
            yield frame

    def _rate_hz(self) -> float:
        """How many arena states a second has, where nobody said how many there shall be."""
        states = islice(self._recording.messages({"/arena"}), _LOOKED_AT)
        apart_ns = np.diff([_capture_ns(state) for state in states])
        usual_ns = float(np.median(apart_ns)) if len(apart_ns) else 0.0
        return 1e9 / usual_ns if usual_ns > 0.0 else _USUAL_FPS

    def _measured(self) -> bool:
        """Whether there will be measures to show: those of the run, or robots in a cone."""
        signals = self._recording.newest({"/signals"}).get("/signals")
        return signals is not None and bool(
            signals.data.get("measures") or signals.data.get("cones")
        )

    def _check_robot(self, facts: ExperimentMessage) -> None:
        robot = self._plan.robot
        tags = [str(row.get("tag")) for row in facts.robots]
        if robot is not None and str(robot) not in tags:
            raise RecordingError(f"{self._name}: has no robot {robot}; {instead(str(robot), tags)}")

    def _shown(self, facts: ExperimentMessage) -> tuple[bool, Sequence[Camera]]:
        """Whether the arena is shown, and which cameras."""
        cameras = {c.id: c for c in map(_camera, facts.cameras) if c is not None}
        view = self._plan.view
        if view == ARENA_VIEW:
            return True, []
        if view not in (None, BOTH, CAMERAS_VIEW) and view not in cameras:
            views = [ARENA_VIEW, *cameras, *([CAMERAS_VIEW, BOTH] if cameras else [])]
            raise RecordingError(f"--view {view}: {instead(str(view), views)}")
        recorded = {camera for camera in cameras if self._has_pictures(camera)}
        wanted = set(cameras) if view in (None, BOTH, CAMERAS_VIEW) else {str(view)}
        chosen = [cameras[name] for name in cameras if name in wanted & recorded]
        if not chosen and view is None:
            return True, []
        if not chosen:
            raise RecordingError(
                f"{self._name}: holds no pictures of {'the cameras' if len(wanted) != 1 else view}:"
                " --record-images (record_image of vsense run) keeps them; expected --view arena"
            )
        return view in (None, BOTH), chosen

    def _has_pictures(self, camera: str) -> bool:
        return bool(self._recording.newest({form.PICTURE + camera}))

    def _span(self) -> tuple[float, float]:
        """From when to when the video goes, in s since the recording's beginning."""
        plan, length_s = self._plan, self._recording.duration_s
        first_s, last_s = self._run() if None in (plan.from_s, plan.to_s) else (0.0, length_s)
        from_s = first_s if plan.from_s is None else plan.from_s
        to_s = min(last_s if plan.to_s is None else plan.to_s, length_s)
        if plan.to_s is None and plan.from_s is not None:
            to_s = max(to_s, length_s) if from_s >= to_s else to_s
        if from_s >= to_s:
            raise RecordingError(
                f"{self._name}: lasts {length_s:.1f} s; nothing of it lies between"
                f" --from {from_s:g} and --to {to_s if plan.to_s is None else plan.to_s:g}"
            )
        return from_s, to_s

    def _run(self) -> tuple[float, float]:
        """When the first run begins and ends, or the whole recording."""
        begin_s, end_s = 0.0, self._recording.duration_s
        first: float | None = None
        for message in self._recording.messages({"/run"}):
            time_s = (message.time_ns - self._recording.begin_ns) / 1e9
            during = message.data.get("state") in _DURING
            if during and first is None:
                first = begin_s = max(time_s, 0.0)
            if first is not None and not during:
                return begin_s, max(min(time_s, end_s), begin_s)
        return begin_s, end_s


class _Ahead:
    """Messages up to a time, of a stream in which they follow each other by it."""

    def __init__(self, messages: Iterator[Message], when: Callable[[Message], int]) -> None:
        self._messages, self._when = messages, when
        self._next = next(messages, None)

    def until(self, time_ns: int) -> Iterator[Message]:
        while self._next is not None and self._when(self._next) <= time_ns:
            yield self._next
            self._next = next(self._messages, None)


def _capture_ns(message: Message) -> int:
    """When a picture was taken; it was written later."""
    reported = message.data.get("capture_ns")
    return reported if isinstance(reported, int) else message.time_ns


def _decoded(message: Message | None) -> RecordedPicture | None:
    """A picture; None: there is none, or it is damaged."""
    if message is None or not message.blob:
        return None
    try:
        return _capture_ns(message), decode(message.blob, "a picture")
    except PictureError:
        return None


def _camera(data: Any) -> Camera | None:
    """A camera of `/experiment`; None: it is damaged, or of another tracker."""
    try:
        return Camera.from_json(json.dumps(data["model"]))
    except (*DAMAGED, CameraError):
        return None
