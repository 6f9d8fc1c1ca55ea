"""The same pictures and settings make the same arena states in every bit, from anywhere."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.monitor.recording.conftest import record
from tests.monitor.recording.scene import (
    MADE,
    OFFSETS,
    STRANGER,
    TIMESTEPS,
    frames,
    session_files,
    track,
)
from vsense.base.errors import UsageError, VsenseError
from vsense.base.message_bus import Message
from vsense.config import tracking_session
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.recording.retrack import RetrackComparison, Retracking
from vsense.vision.tracking import recorded_tracker
from vsense.vision.tracking import recorded_tracker as tracker_memory
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.mask import Mask
from vsense.vision.tracking.opening import open_tracking
from vsense.vision.tracking.recorded_tracker import change_settings

Change = Callable[[dict[str, Any]], dict[str, Any]]


def again(path: Path, change: Change = lambda made: made) -> RetrackComparison:
    with open_recording(path) as recording:
        tracking = Retracking(recording, change)
        for _ in tracking.states():
            pass
        return tracking.comparison


def test_the_labs_tracker_is_the_same_in_every_bit(lab: ArenaTracker, tmp_path: Path) -> None:
    path = track(tmp_path / "run.mcap", lab, MADE)
    assert lab.state.joined == (STRANGER,), "somebody has joined"
    compared = again(path)
    assert (compared.timesteps, compared.equal) == (TIMESTEPS, TIMESTEPS)
    assert compared.lines() == [
        f"{TIMESTEPS} timesteps compared, {TIMESTEPS} the same in every bit"
    ]


@pytest.mark.parametrize("begin", [1, 5, 9, 13, 16, 20])
def test_a_recording_may_begin_and_break_off_anywhere(
    lab: ArenaTracker, tmp_path: Path, begin: int
) -> None:
    off = range(begin + 2, begin + 3)
    path = track(tmp_path / "run.mcap", lab, MADE, begin, off)
    compared = again(path)
    assert compared.timesteps == compared.equal == TIMESTEPS - begin - len(off)
    assert compared.gaps == 1


@pytest.mark.parametrize("is_masked", [False, True])
def test_a_sessions_tracker_is_the_same_in_every_bit(tmp_path: Path, is_masked: bool) -> None:
    everywhere = Mask(((-0.1, -9.0), (9.0, -9.0), (9.0, 9.0), (-0.1, 9.0)), 0.07)
    mask = everywhere if is_masked else None
    files = session_files(tmp_path / "session", mask)
    session = replace(tracking_session.load(*files), offsets=OFFSETS)
    assert session.mask == mask
    tracking = open_tracking(session, lambda: 0, print)
    path = track(tmp_path / "run.mcap", tracking.tracker, recorded_tracker.of_session(session), 3)
    assert (min(tracking.tracker.state.robots["x_m"]) > -0.17) == is_masked
    tracking.close()
    compared = again(path)
    assert compared.timesteps == compared.equal == TIMESTEPS - 3


def test_other_settings_differ_and_it_says_how(lab: ArenaTracker, tmp_path: Path) -> None:
    path = track(tmp_path / "run.mcap", lab, MADE)
    compared = again(path, lambda made: change_settings(made, {"tracker.height_m": "0.05"}))
    assert compared.timesteps == TIMESTEPS and compared.equal == 0 and compared.first == 0
    assert 0.0001 < compared.position_m < 0.01 and compared.heading_rad < 0.1
    assert compared.only_before == compared.only_now == 0
    closed = again(path, lambda made: change_settings(made, {"tracker.open_roster": "false"}))
    assert 0 < closed.equal < TIMESTEPS, "the same until somebody joins"
    assert closed.only_before > 0 and closed.only_now == 0
    assert closed.lines()[-1].startswith(f"robots only in the recording: {closed.only_before}")


def test_a_division_by_what_somebody_wrote_is_said(lab: ArenaTracker, tmp_path: Path) -> None:
    path = track(tmp_path / "run.mcap", lab, MADE)
    with pytest.raises(RecordingError, match=r"run\.mcap: cannot be tracked again: ZeroDivision"):
        again(path, lambda made: {**made, "plan": {**made["plan"], "key_frame_period": 0}})


def test_memory_survives_json(lab: ArenaTracker) -> None:
    for timestep in range(14):
        lab.update(frames(timestep))
    memory = tracker_memory.freeze(lab)
    other = recorded_tracker.make(MADE)
    tracker_memory.restore(other, json.loads(json.dumps(memory)))
    assert json.dumps(tracker_memory.freeze(other)) == json.dumps(memory)
    # Recordings made before hold these fields under these names.
    assert {"whereabouts", "tracks"} < memory.keys()
    assert all({"spread", "lean"} < track["last"].keys() for track in memory["tracks"])
    assert memory["tracks"]
    other.close()


def test_settings_that_are_none() -> None:
    for key, value, expected in (
        ("limits.speed", "1", "limits.speed: is no setting of the tracker; known are limits.max_"),
        ("plan.warm", "yes", "plan.warm: 'yes' is not true or false"),
        ("limits.insist", "2.5", "limits.insist: '2.5' is not a whole number"),
        ("tracker.heading_deg", "nan", "tracker.heading_deg: 'nan' is not a number"),
    ):
        with pytest.raises(UsageError, match=expected):
            change_settings(MADE, {key: value})
    assert change_settings(MADE, {"plan.warm": "true"})["plan"]["warm"] is True
    assert MADE["plan"]["warm"] is False


def test_recordings_that_cannot_be_tracked_again(tmp_path: Path) -> None:
    path = record(tmp_path / "none.mcap", [Message("/arena", 1, {"timestep": 1, "capture_ns": 1})])
    with pytest.raises(RecordingError, match=r"none\.mcap: holds no pictures"):
        again(path)
    for name, data in (
        ("a", {}),
        ("b", {"made": {**MADE, "cameras": [{}]}, "memory": {}}),
        ("c", {"made": MADE, "memory": {"newest": 1}}),
        ("d", {"made": {**MADE, "limits": {"x": 1}}, "memory": {}}),
    ):
        path = record(tmp_path / f"{name}.mcap", [Message("/tracker", 1, data)])
        with pytest.raises(VsenseError):
            again(path)
