"""A camera whose clock jumps by an hour: the other's robots go on, it is told, and the recording
stays one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.rigs.scripted_camera import PERIOD_NS, Script
from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense import cli
from vsense.base.arena import ArenaState
from vsense.base.errors import GrabberError
from vsense.monitor.recording.pictures import PictureRecorder, one_tracker, write_session_files
from vsense.vision.cameras._live_grabber import LiveGrabber
from vsense.vision.cameras._recorded_grabber import undo_jumps
from vsense.vision.cameras._recordings import CaptureTime
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.source import Shot
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.camera_tracking import CameraTracking

S = 1_000_000_000
HOUR_NS = 3600 * S
SIZE = (320, 240)
FAMILY = load_family("arrow4x4")
ROBOTS = {"a": Robot(31, -1.0, 0.05, 0.4), "b": Robot(700, 1.0, -0.04, 2.0)}
CAMERAS = [
    Camera.looking_down(name, robot.x_m, 0.0, 2.4, 1600.0, SIZE) for name, robot in ROBOTS.items()
]
HEIGHTS_M = {31: HEIGHT_M, 700: HEIGHT_M}


class Rig:
    """Two cameras with a robot each, tracked and recorded; `a` is the one whose clock jumps."""

    def __init__(self, folder: Path) -> None:
        self.scripts = {"a": Script(), "b": Script()}
        self.images = {c.id: render(c, FAMILY, [ROBOTS[c.id]], Look(litter=2)) for c in CAMERAS}
        clock = lambda: self.scripts["b"].now_ns  # noqa: E731
        sizes = {camera.id: SIZE for camera in CAMERAS}
        grabber = LiveGrabber(
            self.scripts, sizes, clock, dict.fromkeys(sizes, 10.0), retry_s=0.0, patience_s=30.0
        )
        tracker = ArenaTracker.for_family(CAMERAS, FAMILY, HEIGHTS_M)
        self.told: list[str] = []
        self.tracking = CameraTracking(grabber, tracker, self.told.append)
        self.recorder = PictureRecorder(folder, CAMERAS)
        write_session_files(folder, CAMERAS, one_tracker(CAMERAS, "arrow4x4", HEIGHTS_M))
        self.tracking.record = self.recorder.write
        for script in self.scripts.values():
            assert script.waits.acquire(timeout=30.0)

    def step(self, jump_ns: int = 0) -> ArenaState:
        """Lives a timestep, before which the clock of `a` jumps."""
        for name, script in self.scripts.items():
            taken = script.shot()
            if name == "a":
                script.stamp_ns += jump_ns
            stamp_ns = taken.stamp_ns + (jump_ns if name == "a" else 0)
            script.give(Shot(self.images[name], stamp_ns, taken.arrived_ns))
        state, _ = self.tracking.next(30.0)
        self.tracking.check_cameras()
        return state

    def close(self) -> None:
        for script in self.scripts.values():
            for _ in range(4):
                script.comes.put(GrabberError("the end"))
        self.tracking.close()
        self.recorder.close()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path)
    yield made
    made.close()


@pytest.mark.parametrize("jump_ns", [HOUR_NS, -HOUR_NS])
def test_the_other_cameras_robots_go_on_and_the_recording_stays_one(
    rig: Rig, tmp_path: Path, jump_ns: int, capsys: pytest.CaptureFixture[str]
) -> None:
    states = [rig.step() for _ in range(8)]
    states += [rig.step(jump_ns)] + [rig.step() for _ in range(7)]
    states += [rig.step(-jump_ns)] + [rig.step() for _ in range(7)]
    for before, state in zip([None, *states], states):
        assert state.robots["tag"].tolist() == [31, 700] and state.robots["seen"].all()
        assert before is None or state.capture_ns - before.capture_ns == PERIOD_NS
    ways = ("ahead", "back") if jump_ns > 0 else ("back", "ahead")
    clock = [line for line in rig.told if "clock" in line]
    for line, way in zip(clock, ways, strict=True):
        assert line.startswith(f"camera a: its clock has jumped {way} by 3600.00 s")
    rig.close()
    files = [str(tmp_path / name) for name in ("resources.xml", "experiment.xml")]
    assert cli.main(["track", *files, "--offline"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(states)
    assert all(line.count('"seen":true') == 2 for line in lines)


def test_a_recording_whose_stamps_jumped_is_tracked_as_one_and_the_camera_told(
    rig: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(12):
        rig.step()
    rig.close()
    table = tmp_path / "pictures" / "a" / "timestamps.csv"
    head, *rows = table.read_text().splitlines()
    late = [re.sub(r"\d+$", lambda ns: str(int(ns[0]) + HOUR_NS), row) for row in rows[5:]]
    table.write_text("\n".join([head, *rows[:5], *late, ""]))
    files = [str(tmp_path / name) for name in ("resources.xml", "experiment.xml")]
    assert cli.main(["track", *files, "--offline"]) == 0
    out = capsys.readouterr()
    assert len(out.out.splitlines()) == 12
    assert all(line.count('"seen":true') == 2 for line in out.out.splitlines())
    told = "camera a: its stamps jump ahead by 3600.00 s after 000004.png: taken as if they did not"
    assert out.err.count(told) == 1 and out.err.count("stamps jump") == 1


def taken(times_s: Sequence[float], numbers: Sequence[int] | None = None) -> list[CaptureTime]:
    return [
        CaptureTime(f"{k}.png", None if numbers is None else numbers[k], round(t * S))
        for k, t in enumerate(times_s)
    ]


def jumped(times_s: np.ndarray, place: int, by_s: float) -> np.ndarray:
    return times_s + np.where(np.arange(len(times_s)) >= place, by_s, 0.0)


@pytest.mark.parametrize("numbered", [True, False])
@pytest.mark.parametrize("cameras", [2, 4])
def test_a_jump_is_undone_to_the_period_and_named(numbered: bool, cameras: int) -> None:
    times_s = np.round(np.arange(50) * 0.1, 3)
    numbers = range(50) if numbered else None
    all_taken = {f"c{n}": taken(times_s + 0.002 * n, numbers) for n in range(cameras)}
    before = dict(all_taken)
    all_taken["c1"] = taken(jumped(times_s + 0.002, 20, 3600.0), numbers)
    mended, events = undo_jumps(all_taken)
    assert [(e.camera, e.kind) for e in events] == [("c1", "clock")]
    assert "ahead by 3600.00 s after 19.png" in events[0].text
    for name, rows in before.items():
        off = [a.capture_ns - b.capture_ns for a, b in zip(mended[name], rows, strict=True)]
        assert max(map(abs, off)) <= 0.01 * S


@pytest.mark.parametrize("numbered", [True, False])
def test_time_that_passed_for_all_and_a_camera_that_was_away_are_no_jumps(numbered: bool) -> None:
    times_s = jumped(np.arange(40) * 0.1, 20, 3600.0)
    numbers = np.arange(40)
    all_taken = {name: taken(times_s, numbers if numbered else None) for name in "ab"}
    assert undo_jumps(all_taken) == (all_taken, [])
    on_s = np.arange(600) * 0.1
    away = np.r_[0:100, 500:600]
    all_taken = {
        "a": taken(on_s, np.arange(600) if numbered else None),
        "b": taken(on_s[away], away if numbered else None),
    }
    assert undo_jumps(all_taken) == (all_taken, [])


def test_cameras_that_jump_one_after_the_other_are_all_mended() -> None:
    times_s, numbers = np.arange(60) * 0.1, range(60)
    for first, second in ((20, 40), (40, 20)):
        all_taken = {
            "a": taken(jumped(times_s, first, 3600.0), numbers),
            "b": taken(jumped(times_s, second, 7200.0), numbers),
        }
        mended, events = undo_jumps(all_taken)
        assert sorted({e.camera for e in events}) == ["a", "b"]
        apart = [a.capture_ns - b.capture_ns for a, b in zip(mended["a"], mended["b"])]
        assert max(map(abs, apart)) < S


def test_slow_cameras_of_one_timestep_may_be_some_periods_apart() -> None:
    times_s, numbers = np.arange(30) * 5.0, range(30)
    all_taken = {"a": taken(times_s, numbers), "b": taken(times_s + 4.0, numbers)}
    assert undo_jumps(all_taken) == (all_taken, [])


def test_numbers_that_begin_elsewhere_and_clocks_that_drift_are_no_jumps() -> None:
    times_s = np.arange(100) * 0.1
    for begin in (1000, 50):
        all_taken = {
            "a": taken(times_s, range(100)),
            "b": taken(times_s, range(begin, begin + 100)),
        }
        assert undo_jumps(all_taken) == (all_taken, [])
    all_taken = {"a": taken(1.2 * times_s, range(100)), "b": taken(times_s, range(100))}
    assert undo_jumps(all_taken) == (all_taken, [])


def test_a_clock_that_is_an_hour_ahead_from_the_first_picture_on_is_mended() -> None:
    times_s = np.arange(20) * 0.1
    all_taken = {"a": taken(times_s, range(20)), "b": taken(times_s + 3600.0, range(20))}
    mended, events = undo_jumps(all_taken)
    assert [str(e) for e in events] == [
        "camera b: its stamps jump ahead by 3600.00 s from the first on: taken as if they did not"
    ]
    assert mended["b"] == all_taken["a"]


@given(
    cameras=st.lists(
        st.lists(st.integers(1, 40_000), min_size=1, max_size=30), min_size=1, max_size=4
    ),
    numbered=st.booleans(),
)
def test_whatever_the_times_none_is_lost_and_none_turns_back(
    cameras: list[list[int]], numbered: bool
) -> None:
    all_taken = {
        str(n): taken(np.cumsum(steps) / 10.0, np.cumsum(steps) if numbered else None)
        for n, steps in enumerate(cameras)
    }
    mended, _ = undo_jumps(all_taken)
    for camera, rows in all_taken.items():
        assert [t.timestep for t in mended[camera]] == [t.timestep for t in rows]
        after = [t.capture_ns for t in mended[camera]]
        assert all(a < b for a, b in pairwise(after))
