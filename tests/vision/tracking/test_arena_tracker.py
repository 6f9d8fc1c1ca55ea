"""The arena tracker, with a detector that is told what to see, and once with real pictures."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import DETECTION, UNNAMED, ArenaState, Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._workers import Picture
from vsense.vision.tracking.arena_tracker import ArenaTracker, TrackingError
from vsense.vision.tracking.marker_detector import Detected

STEP_NS = 100_000_000
SIZE = (64, 48)
CAMERAS = [
    Camera.looking_down(name, x, y, 2.43, 1620.0, SIZE)
    for name, x, y in (("a", -0.02, 0.0), ("b", 0.02, 0.0), ("c", 0.0, 0.01), ("d", 0.5, 0.5))
]
HEIGHTS = {1: 0.06, 2: 0.06, 3: 0.06}
SPREAD = np.diag((1e-7, 1e-7, 1e-6))


class Script:
    """A detector that reads from the picture's first pixel which scene to report."""

    def __init__(self, scenes: list[list[tuple[int, float, float, float]]]) -> None:
        self._scenes = scenes

    def detect_all(self, pictures: Sequence[Picture]) -> list[Detected]:
        """Reports a scene's (tag, x, y, yaw) where the cameras see them."""
        return [Detected(self._detect(p.image, p.camera), False) for p in pictures]

    def _detect(self, image: np.ndarray, camera: Camera) -> np.ndarray:
        rows = []
        for tag, x_m, y_m, yaw_rad in self._scenes[image[0, 0]]:
            pixel = camera.project(np.array([x_m, y_m, 0.06]))
            if camera.contains(pixel):
                rows.append((tag, *pixel, yaw_rad, SPREAD, 0.02, 9.0, True, True))
        return np.array(rows, dtype=DETECTION)


def frames(scene: int, timestep: int, names: str = "abcd") -> list[Frame]:
    image = np.full(SIZE[::-1], scene, np.uint8)
    time_ns = timestep * STEP_NS
    return [Frame(name, image, timestep, time_ns, time_ns + 1) for name in names]


def tracker(*scenes: list[tuple[int, float, float, float]]) -> ArenaTracker:
    return ArenaTracker(CAMERAS, Script(list(scenes)), HEIGHTS)


def outline(state: ArenaState) -> tuple[object, ...]:
    return (
        state.timestep,
        state.capture_ns,
        state.robots.tobytes(),
        state.detected,
        state.unnamed,
        state.duplicates,
    )


def robot(state: ArenaState, tag: int) -> np.void:
    (row,) = state.robots[state.robots["tag"] == tag]
    return row


def test_overlapping_cameras_make_one_robot() -> None:
    arena = tracker([(2, 0.0, 0.002, 1.0), (1, 0.5, 0.5, -2.0), (UNNAMED, 0.5, 0.51, 0.0)])
    state = arena.update(frames(0, 1))
    assert state.robots["tag"].tolist() == [1, 2]
    assert state.detected == 2 and state.unnamed == 1 and state.duplicates == ()
    assert robot(state, 2)["cameras"] == 3 and robot(state, 1)["cameras"] == 1
    assert robot(state, 2)["x_m"] == pytest.approx(0.0, abs=1e-9)
    assert robot(state, 2)["y_m"] == pytest.approx(0.002, abs=1e-9)
    assert robot(state, 2)["yaw_rad"] == pytest.approx(1.0)
    assert state.robots["seen"].all() and (state.robots["confidence"] == 1.0).all()


scenes = st.lists(
    st.lists(
        st.tuples(
            st.sampled_from([UNNAMED, 1, 2, 3]),
            st.floats(-0.04, 0.04),
            st.floats(-0.03, 0.03),
            st.floats(-3.1, 3.1),
        ),
        max_size=5,
    ),
    min_size=1,
    max_size=5,
)


@given(scenes, st.randoms(use_true_random=False))
@settings(max_examples=40)
def test_the_order_of_the_frames_never_changes_the_result(
    played: list[list[tuple[int, float, float, float]]], random: object
) -> None:
    straight, shuffled = tracker(*played), tracker(*played)
    for step in range(len(played)):
        now = frames(step, step + 1)
        mixed = now + frames(0, step)
        random.shuffle(mixed)  # type: ignore[attr-defined]
        assert outline(straight.update(now)) == outline(shuffled.update(mixed))
    straight.close()
    shuffled.close()


def test_a_frame_older_than_the_newest_is_dropped_and_counted() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0)], [(1, 0.01, 0.0, 0.0)])
    first = arena.update(frames(0, 5) + frames(1, 4, "ab"))
    assert first.timestep == 5 and arena.counters.old_frames == 2
    assert arena.update(frames(1, 5)) is first
    assert arena.update(frames(1, 3)) is first
    assert arena.update([]) is first
    assert arena.counters.old_frames == 10 and arena.state is first


def test_a_camera_that_delivers_twice_counts_once() -> None:
    arena = tracker([(1, 0.5, 0.5, 0.0)])
    state = arena.update(frames(0, 1) + frames(0, 1, "d"))
    assert state.duplicates == () and arena.counters.repeated_frames == 1


HOUR_NS = 3600 * 10**9


@pytest.mark.parametrize("off_ns", [HOUR_NS, -HOUR_NS])
@pytest.mark.parametrize("names", ["abcd", "ad"])
def test_a_camera_with_a_wrong_clock_costs_itself_and_nobody_else(off_ns: int, names: str) -> None:
    """Robot 1 is seen by `a` to `c`, robot 2 by `d`, whose clock jumps and comes back."""
    arena = tracker([(1, 0.0, 0.0, 0.0), (2, 0.5, 0.5, 0.0)])
    seen, ages_s = [], []
    for timestep in range(12):
        off = off_ns if 3 <= timestep < 10 else 0
        now = [replace(f, capture_ns=f.capture_ns + off * (f.camera == "d")) for f in
               frames(0, timestep, names if timestep != 6 else "d")]  # fmt: skip
        state = arena.update(now)
        seen.append(state.robots["tag"][state.robots["seen"]].tolist())
        ages_s.append(state.robots["age_ns"].max() / 1e9)
    assert seen == [[1, 2]] * 3 + [[1]] * 7 + [[1, 2]] * 2
    assert max(ages_s) < 1.0 and arena.counters.untimely_frames == 7
    assert arena.counters.notes() == ["7 pictures dated far beside the others' were dropped"]


def test_a_camera_with_a_wrong_clock_is_believed_where_it_is_the_only_one_for_long() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0), (2, 0.5, 0.5, 0.0)])
    arena.update(frames(0, 0))
    late = lambda step, names: [  # noqa: E731
        replace(f, capture_ns=f.capture_ns + HOUR_NS * (f.camera == "d"))
        for f in frames(0, step, names)
    ]
    arena.update(late(1, "abcd"))
    tags = [arena.update(late(step, "d")).robots["tag"].tolist() for step in range(2, 14)]
    assert tags == [[1, 2]] * 9 + [[2]] * 3


def test_iridia_defect_12_a_lost_robot_says_so_ages_and_goes() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0), (2, 0.01, 0.01, 0.0)], [(2, 0.01, 0.01, 0.0)])
    arena.update(frames(0, 0))
    confidence = 1.0
    for step in range(1, 51):
        state = arena.update(frames(1, step))
        lost = robot(state, 1)
        assert not lost["seen"] and lost["cameras"] == 0
        assert lost["age_ns"] == step * STEP_NS and lost["capture_ns"] == 0
        assert lost["confidence"] < confidence
        assert state.detected == 1 and robot(state, 2)["age_ns"] == 0
        confidence = float(lost["confidence"])
    assert confidence < 0.01
    assert arena.update(frames(1, 51)).robots["tag"].tolist() == [2]


def test_a_lost_robot_that_comes_back_is_seen_again_at_once() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0)], [], [(1, 0.02, 0.0, 0.0)])
    for step, scene in enumerate((0, 1, 1, 2)):
        state = arena.update(frames(scene, step))
    assert robot(state, 1)["seen"] and robot(state, 1)["age_ns"] == 0


def test_predictions_do_not_count_as_detected() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0)], [])
    arena.update(frames(0, 0))
    assert arena.update(frames(1, 1)).detected == 0


def test_a_duplicated_tag_is_flagged_and_never_merged() -> None:
    twice = [(1, 0.0, 0.0, 0.0), (1, 0.5, 0.5, 0.0)]
    arena = tracker([(1, 0.0, 0.0, 0.0)], twice, [])
    state = arena.update(frames(0, 0))
    assert state.duplicates == ()
    state = arena.update(frames(1, 1))
    assert state.duplicates == (1,) and state.detected == 1
    assert robot(state, 1)["x_m"] == pytest.approx(0.0, abs=1e-9)
    assert robot(state, 1)["confidence"] == 0.5
    assert arena.counters.duplicates == 1 and arena.counters.out_of_reach == 1


def test_a_tag_that_is_twice_there_from_the_start_is_no_robot_yet() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0), (1, 0.5, 0.5, 0.0)])
    state = arena.update(frames(0, 0))
    assert state.duplicates == (1,) and len(state.robots) == 0


def test_a_jump_is_counted_and_not_followed() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0)], [(1, 0.5, 0.5, 0.0)])
    arena.update(frames(0, 0))
    state = arena.update(frames(1, 1))
    assert not robot(state, 1)["seen"] and robot(state, 1)["x_m"] == pytest.approx(0.0, abs=1e-9)
    assert arena.counters.out_of_reach == 1


def test_missing_cameras_are_no_trouble() -> None:
    arena = tracker([(1, 0.0, 0.0, 0.0)])
    for step, names in enumerate(itertools.permutations("abc", 2)):
        state = arena.update(frames(0, step, "".join(names)))
        assert state.timestep == step and robot(state, 1)["cameras"] == 2


def test_foreign_and_wrong_pictures_are_named() -> None:
    arena = tracker([])
    with pytest.raises(TrackingError, match="camera 'x'"):
        arena.update(frames(0, 0, "x"))
    wrong = Frame("a", np.zeros((10, 20), np.uint8), 0, 0, 0)
    with pytest.raises(TrackingError, match=r"20 x 10 px.*64 x 48"):
        arena.update([wrong])
    with pytest.raises(TrackingError, match="an id of its own"):
        ArenaTracker(CAMERAS[:1] * 2, Script([]), HEIGHTS)
    with pytest.raises(TrackingError, match="needs cameras"):
        ArenaTracker([], Script([]), HEIGHTS)


def test_real_pictures_of_overlapping_cameras_at_two_heights() -> None:
    family = load_family("arrow4x4")
    cameras = [
        Camera.looking_down(name, x, 0.0, 2.43, 1620.0, (800, 480), (-0.12, 0.02, 0, 0, 0))
        for name, x in (("left", -0.4), ("right", 0.4))
    ]
    robots = [Robot(31, 0.0, 0.1, 3.1), Robot(1843, -0.5, -0.1, -1.0), Robot(7167, 0.6, 0.0, 0.4)]
    high = Robot(52447, 0.05, -0.15, -3.1)
    heights = {robot.tag: HEIGHT_M for robot in robots} | {high.tag: 0.10}
    arena = ArenaTracker.for_family(cameras, family, heights)
    shots = []
    for camera in cameras:
        low = render(camera, family, robots, Look(litter=0, noise=0.0), seed=3)
        both = render(camera, family, [high], Look(litter=0, noise=0.0), seed=3, height_m=0.10)
        empty = render(camera, family, [], Look(litter=0, noise=0.0), seed=3)
        shots.append(Frame(camera.id, np.where(both != empty, both, low), 0, 0, 0))
    state = arena.update(shots)
    arena.close()
    assert state.detected == 4 and state.unnamed == 0 and state.duplicates == ()
    assert robot(state, 31)["cameras"] == 2
    for truth in [*robots, high]:
        row = robot(state, truth.tag)
        assert (row["x_m"], row["y_m"]) == pytest.approx((truth.x_m, truth.y_m), abs=1e-3)
        assert row["yaw_rad"] == pytest.approx(truth.yaw_rad, abs=0.01)


def test_a_robot_that_is_not_on_the_roster_joins_and_is_followed() -> None:
    family, new = load_family("arrow4x4"), 0b0101_1010_1100_0011
    camera = Camera.looking_down("top", 0.0, 0.0, 2.43, 1620.0, (480, 360), (-0.12, 0.02, 0, 0, 0))
    heights = {31: HEIGHT_M, 1843: HEIGHT_M}
    told = {open_: [] for open_ in (True, False)}
    for open_, states in told.items():
        arena = ArenaTracker.for_family([camera], family, heights, open_roster=open_)
        for step in range(14):
            way = 0.01 * step
            robots = [Robot(31, -0.2, 0.1, 1.0), Robot(new, -0.2 + way, -0.1, 0.0, 0.12)]
            picture = render(camera, family, robots, Look(litter=3), seed=step)
            states.append(arena.update([Frame("top", picture, step, step * STEP_NS, 0)]))
        arena.close()
        assert set(arena.heights_m) == {31, 1843} | ({new} if open_ else set())
    assert [state.unnamed for state in told[True]] == [1] * 11 + [0] * 3
    assert [state.joined for state in told[True]] == [()] * 11 + [(new,)] * 3
    last = robot(told[True][-1], new)
    assert last["seen"] and last["x_m"] == pytest.approx(-0.07, abs=1e-3)
    assert all(state.unnamed == 1 and state.joined == () for state in told[False])


def test_every_pose_says_how_sure_it_is_and_where_the_pictures_show_it() -> None:
    arena = tracker([(2, 0.0, 0.002, 1.0), (1, 0.5, 0.5, -2.0)], [])
    state = arena.update(frames(0, 1))
    for row in state.robots:
        assert (np.linalg.eigvalsh(row["covariance"]) > 0.0).all()
    # Four pictures, three of them of robot 2.
    assert state.cameras == ("a", "b", "c", "d")
    assert {name: state.camera_state(name)["tag"].tolist() for name in "abcd"} == {
        "a": [2], "b": [2], "c": [2], "d": [1],
    }  # fmt: skip
    for camera in CAMERAS[:3]:
        (image,) = state.camera_state(camera.id)
        pixel = camera.project(np.array((0.0, 0.002, 0.06)))
        assert (image["x_px"], image["y_px"]) == pytest.approx(tuple(pixel))
    gone = arena.update(frames(1, 2))
    assert len(gone.images) == 0 and gone.cameras == state.cameras
    for before, after in zip(state.robots, gone.robots, strict=True):
        assert after["covariance"].trace() > before["covariance"].trace()


def test_a_camera_below_its_robots_is_refused() -> None:
    with pytest.raises(TrackingError, match=r"2\.43 m"):
        ArenaTracker(CAMERAS, Script([]), {1: 0.06, 2: 2.5})


@pytest.mark.parametrize("row_time_s", [0.0, 20e-6])
def test_a_rolling_shutter_dates_each_robot_by_its_row(row_time_s: float) -> None:
    """Robots drive down the picture at 20 cm/s, in its first and in its last rows."""
    size, speed_m_s = (640, 1200), 0.2
    camera = Camera.looking_down("a", 0.0, 0.0, 2.43, 1620.0, size)
    family, tags = load_family("arrow4x4"), [31, 7167, 52447]
    arena = ArenaTracker.for_family(
        [replace(camera, row_time_s=row_time_s)], family, dict.fromkeys(tags, HEIGHT_M)
    )
    homes = [(-0.2, 0.75), (0.0, 0.1), (0.2, -0.6)]
    off_m = []
    for step in range(8):
        robots, true_m = [], []
        for tag, (x_m, y_m) in zip(tags, homes):
            true_m.append((x_m, y_m - speed_m_s * step * STEP_NS / 1e9))
            row = camera.project(np.array([*true_m[-1], HEIGHT_M]))[1]
            shown_m = true_m[-1][1] - speed_m_s * 20e-6 * (row - 599.5)
            robots.append(Robot(tag, x_m, shown_m, -np.pi / 2))
        image = render(camera, family, robots, Look(litter=0), step)
        state = arena.update([Frame("a", image, step, step * STEP_NS, step * STEP_NS)])
        if step >= 4:
            seen = [robot(state, tag) for tag in tags]
            off_m += [row["y_m"] - y_m for row, (_, y_m) in zip(seen, true_m)]
    arena.close()
    # 20 us a row, half of 1200 rows: 12 ms, in which a robot drives 2.4 mm.
    worst_m = max(map(abs, off_m))
    assert worst_m < 0.3e-3 if row_time_s else 1.5e-3 < worst_m < 2.4e-3
