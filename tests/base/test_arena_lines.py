"""The arena state as text says what the state says."""

from __future__ import annotations

import csv
import json

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import CSV_HEADER, IMAGE_POSE, POSE, SIGHTING, ArenaState

NUMBERS = st.floats(-1e4, 1e4)
ROBOTS = st.lists(
    st.tuples(
        st.integers(0, 2**32 - 1), NUMBERS, NUMBERS, st.floats(-3.1, 3.1), st.floats(0, 10),
        st.integers(0, 2**62), st.integers(0, 2**62), st.floats(0, 1, width=32),
        st.integers(0, 16), st.booleans(), st.lists(st.floats(-9.0, 9.0), min_size=6, max_size=6),
    ),
    max_size=5, unique_by=lambda robot: robot[0],
)  # fmt: skip
UPPER = np.triu_indices(3)
PLAIN = [name for name in POSE.names or () if name != "covariance"]
SPREAD = ("xx_m2", "xy_m2", "x_yaw_m_rad", "yy_m2", "y_yaw_m_rad", "yaw_yaw_rad2")


def poses_of(robots: list[tuple[float, ...]]) -> np.ndarray:
    """Makes POSE rows; the last of each robot's values are a covariance's six numbers."""
    poses = np.zeros(len(robots), dtype=POSE)
    for row, (*values, spread) in zip(poses, robots, strict=True):
        for name, value in zip(PLAIN, values, strict=True):
            row[name] = value
        row["covariance"][UPPER] = spread
        row["covariance"].T[UPPER] = spread
    return poses


@given(ROBOTS, st.integers(0, 2**40), st.integers(0, 2**62), st.sets(st.integers(0, 99)))
def test_both_formats_say_the_same_as_the_state(
    robots: list[tuple[float, ...]], timestep: int, capture_ns: int, twice: set[int]
) -> None:
    poses = poses_of(robots)
    state = ArenaState(timestep, capture_ns, poses, len(poses), 2, tuple(sorted(twice)))
    line = state.to_json()
    assert "\n" not in line
    said = json.loads(line)
    assert (said["timestep"], said["capture_ns"]) == (timestep, capture_ns)
    assert (said["detected"], said["unnamed"]) == (len(poses), 2)
    assert said["duplicates"] == sorted(twice)
    text = f"{CSV_HEADER}\n{state.to_csv()}\n"
    rows = list(csv.DictReader(text.splitlines()))
    assert len(said["robots"]) == len(rows) == len(poses)
    for pose, robot, row in zip(poses, said["robots"], rows):
        assert int(row["timestep"]) == timestep and int(row["state_capture_ns"]) == capture_ns
        for name in PLAIN:
            for value in (float(robot[name]), float(row[name])):
                assert abs(value - float(pose[name])) <= 6e-4 * (name == "confidence") + 6e-5
        cells = [float(row[f"covariance_{name}"]) for name in SPREAD]
        assert robot["covariance"] == cells
        assert np.allclose(cells, pose["covariance"][UPPER], rtol=6e-3, atol=0.0)


def test_where_nobody_can_tell_the_error_nothing_is_said_of_it() -> None:
    poses = np.zeros(1, dtype=POSE)
    poses["covariance"] = np.nan
    state = ArenaState(3, 4, poses, 1)
    assert json.loads(state.to_json())["robots"][0]["covariance"] is None
    assert state.to_csv().endswith(",,,,,,")


def test_what_each_camera_sees_is_told_by_its_id() -> None:
    poses = np.zeros(2, dtype=POSE)
    poses["tag"] = 5, 7
    images = np.zeros(3, dtype=IMAGE_POSE)
    images["tag"], images["camera"], images["x_px"] = (5, 7, 5), (0, 0, 1), (10.0, 20.0, 30.004)
    state = ArenaState(3, 4, poses, 2, joined=(7,), cameras=("left", "right"), images=images)
    said = json.loads(state.to_json())
    five, seven = (robot["images"] for robot in said["robots"])
    assert said["joined"] == [7] and list(seven) == ["left"]
    assert five["left"] == {"x_px": 10.0, "y_px": 0.0, "yaw_px_rad": 0.0}
    assert five["right"]["x_px"] == 30.0
    twice = ArenaState(3, 4, poses, 2, 0, (5,), cameras=("left", "right"), images=images)
    assert json.loads(twice.to_json())["robots"][0]["images"] == {}


def test_a_tag_that_is_there_twice_is_told_with_both_places() -> None:
    sightings = np.array([(5, 0.1, 0.2, 0.3), (5, 1.0, 2.0, 3.0), (9, 0, 0, 0)], dtype=SIGHTING)
    state = ArenaState(3, 4, np.zeros(0, dtype=POSE), 2, 0, (5,), sightings)
    said = json.loads(state.to_json())
    assert said["duplicates"] == [5]
    assert said["duplicate_sightings"] == [
        {"tag": 5, "x_m": 0.1, "y_m": 0.2, "yaw_rad": 0.3},
        {"tag": 5, "x_m": 1.0, "y_m": 2.0, "yaw_rad": 3.0},
    ]


def test_a_state_without_robots_is_a_line_of_json_and_none_of_csv() -> None:
    state = ArenaState(3, 4, np.zeros(0, dtype=POSE), 0)
    assert json.loads(state.to_json())["robots"] == []
    assert state.to_csv() == ""
