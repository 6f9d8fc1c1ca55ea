"""Runs the tracker again on recorded pictures, and compares the new arena states with the recorded.

With the recorded settings both are the same in every bit. The tracker's memory is recorded where
pictures begin, at the beginning and after each gap, so that they are the same from anywhere.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import cv2

from vsense.base.arena import ArenaState, Frame
from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor.recording import form
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.cameras.picture import decode
from vsense.vision.tracking import recorded_tracker
from vsense.vision.tracking.camera_tracking import CameraTracking

_REMEMBERED = 500
"""Timesteps whose new state waits for the recorded one, or the other way round: pictures may have
been written later than their arena states."""


@dataclass(slots=True)
class RetrackComparison:
    """How two trackings of the same pictures differ.

    Attributes:
        timesteps: arena states that were compared.
        equal: those of them that are the same in every bit.
        no_pictures: recorded arena states whose pictures are not in the recording.
        robots: poses that are in both.
        position_m, heading_rad: the largest distance and angle between two of them.
        only_before, only_now: robots in timesteps where only one tracking has them.
        fields: in how many timesteps each field differs.
        first: the first timestep that differs, or None.
        gaps: how often the pictures are interrupted.
        versions: by name, what computed then and what now, where they differ.
    """

    timesteps: int = 0
    equal: int = 0
    no_pictures: int = 0
    robots: int = 0
    position_m: float = 0.0
    heading_rad: float = 0.0
    only_before: int = 0
    only_now: int = 0
    fields: dict[str, int] = field(default_factory=dict)
    first: int | None = None
    gaps: int = 0
    versions: dict[str, tuple[str, str]] = field(default_factory=dict)

    def add(self, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        """Compares two data of `/arena`; KeyError, TypeError, ValueError if `before` is damaged."""
        different = [name for name in now if not _same(before.get(name), now[name])]
        self.timesteps += 1
        self.equal += not different
        if different and self.first is None:
            self.first = now["timestep"]
        for name in different:
            self.fields[name] = self.fields.get(name, 0) + 1
        was, here = _poses(before["robots"]), _poses(now["robots"])
        self.only_before += len(was.keys() - here.keys())
        self.only_now += len(here.keys() - was.keys())
        for tag in was.keys() & here.keys():
            (x0, y0, yaw0), (x1, y1, yaw1) = was[tag], here[tag]
            self.robots += 1
            self.position_m = max(self.position_m, math.hypot(x1 - x0, y1 - y0))
            turn_rad = abs(math.remainder(yaw1 - yaw0, math.tau))
            self.heading_rad = max(self.heading_rad, turn_rad)

    @property
    def exit_code(self) -> int:
        """0: other settings track otherwise."""
        return 0

    def lines(self) -> list[str]:
        """The comparison for people."""
        lines = [f"{self.timesteps} timesteps compared, {self.equal} the same in every bit"]
        if self.no_pictures:
            lines.append(f"{self.no_pictures} timesteps without pictures: not compared")
        if self.gaps:
            lines.append(f"the pictures are interrupted {self.gaps} times")
        for name, (then, now) in sorted(self.versions.items()):
            lines.append(f"{name} was {then}, now {now}: the last bits may differ")
        if self.equal < self.timesteps:
            where = ", ".join(f"{name} {count}" for name, count in sorted(self.fields.items()))
            lines += [
                f"the first timestep that differs: {self.first}; by field: {where}",
                f"{self.robots} poses in both: up to {1e3 * self.position_m:.3f} mm and"
                f" {math.degrees(self.heading_rad):.3f} degrees apart",
                f"robots only in the recording: {self.only_before}, only now: {self.only_now}"
                " (robots times timesteps)",
            ]
        return lines


class _RecordedPictures:
    """The pictures of a recording as a grabber: a timestep when all of its pictures were added."""

    timesteps: int | None = None
    missed = 0

    def __init__(self) -> None:
        self._frames: list[Frame] = []
        self._update = -1

    def add(self, message: Message) -> bool:
        """Adds a picture; whether all of its timestep are there."""
        data = message.data
        if data["update"] != self._update:
            self._frames = []
        self._update = data["update"]
        self._frames.append(_frame(message))
        complete: bool = len(self._frames) == data["pictures"]
        return complete

    def next(self, timeout_s: float) -> list[Frame]:
        """Gives the pictures that were added."""
        frames, self._frames = self._frames, []
        return frames

    def events(self) -> list[CameraEvent]:
        """There are none."""
        return []

    def close(self) -> None:
        """Drops the pictures that were added."""
        self._frames = []


class Retracking:
    """The tracker on a recording with pictures.

    `change` gives the description of the tracker to run, from the recorded one.
    """

    def __init__(self, recording: Recording, change: Callable[[dict[str, Any]], dict[str, Any]]):
        self.comparison = RetrackComparison()
        self._recording = recording
        self._change = change
        self._tracking: CameraTracking | None = None
        self._setup: dict[str, Any] | None = None
        self._pictures = _RecordedPictures()
        self._now: dict[int, dict[str, Any]] = {}
        self._before: dict[int, Mapping[str, Any]] = {}

    def states(self) -> Iterator[ArenaState]:
        """Tracks to the recording's end; gives each new arena state.

        Raises:
            RecordingError: there is nothing to track in the recording.
            VsenseError: the settings make no tracker.
        """
        try:
            for message in self._recording.messages(_needed):
                if message.topic == form.TRACKER_TOPIC:
                    self._begin(message)
                elif message.topic == "/arena":
                    # By capture time: a run numbers its timesteps itself.
                    self._before[message.data["capture_ns"]] = message.data
                    self._compare(message.data["capture_ns"])
                else:
                    yield from self._track(message)
            self.comparison.no_pictures += len(self._before)
        except (*DAMAGED, cv2.error) as error:
            name = self._recording.path
            raise RecordingError(f"{name}: cannot be tracked again: {error!r}") from None
        finally:
            if self._tracking is not None:
                self._tracking.close()
        if self._tracking is None:
            raise RecordingError(
                f"{self._recording.path}: holds no pictures of our own cameras to track again;"
                " record with record_image"
            )

    def _begin(self, message: Message) -> None:
        """Makes the tracker; after a gap, restores the memory that it had then."""
        setup = dict(message.data["made"])
        changed = self._change(setup)
        self._pictures.close()
        if self._tracking is None:
            now = recorded_tracker.versions()
            then = {name: str(setup["versions"].get(name)) for name in now}
            self.comparison.versions = {n: (then[n], now[n]) for n in now if then[n] != now[n]}
        else:
            self.comparison.gaps += 1
        if self._tracking is None or changed != self._setup:
            if self._tracking is not None:
                self._tracking.close()
            tracker = recorded_tracker.make(changed)
            self._tracking = CameraTracking(self._pictures, tracker, lambda line: None)
            self._setup = changed
        if changed == setup:
            recorded_tracker.restore(self._tracking.tracker, message.data["memory"])

    def _track(self, message: Message) -> Iterator[ArenaState]:
        """Adds a picture; when all of a timestep are there, tracks."""
        if self._tracking is not None and self._pictures.add(message):
            state, _ = self._tracking.next(0.0)
            self._now[state.capture_ns] = state.data()
            if len(self._now) > _REMEMBERED:
                del self._now[next(iter(self._now))]
            self._compare(state.capture_ns)
            yield state

    def _compare(self, capture_ns: int) -> None:
        """Compares an arena state if both of this capture time are known."""
        if capture_ns in self._now and capture_ns in self._before:
            before = self._before.pop(capture_ns)
            now = self._now[capture_ns] | {"timestep": before["timestep"]}
            self.comparison.add(before, now)
        elif len(self._before) > _REMEMBERED:
            del self._before[next(iter(self._before))]
            self.comparison.no_pictures += 1


def _needed(topic: str) -> bool:
    return topic in (form.TRACKER_TOPIC, "/arena") or topic.startswith(form.PICTURE)


def _frame(message: Message) -> Frame:
    data = message.data
    gray = decode(message.blob, f"a picture of camera {data['camera']}")
    times = int(data["timestep"]), int(data["capture_ns"]), int(data["ready_ns"])
    return Frame(str(data["camera"]), gray, *times)


def _same(before: Any, now: Any) -> bool:
    # As text: 0.0 and -0.0 are equal, but not the same.
    return before == now and json.dumps(before) == json.dumps(now)


def _poses(columns: Mapping[str, Any]) -> dict[int, tuple[float, float, float]]:
    rows = zip(columns["tag"], columns["x_m"], columns["y_m"], columns["yaw_rad"], strict=True)
    return {tag: (x, y, yaw) for tag, x, y, yaw in rows}
