"""The arena state as text says what the state says."""

from __future__ import annotations

import csv
import json

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vsense import arena_lines
from vsense.arena import POSE, ArenaState

NUMBERS = st.floats(-1e4, 1e4)
ROBOTS = st.lists(
    st.tuples(
        st.integers(0, 2**32 - 1), NUMBERS, NUMBERS, st.floats(-3.1, 3.1), st.floats(0, 10),
        st.integers(0, 2**62), st.integers(0, 2**62), st.floats(0, 1, width=32),
        st.integers(0, 16), st.booleans(),
    ),
    max_size=5,
)  # fmt: skip


@given(ROBOTS, st.integers(0, 2**40), st.integers(0, 2**62), st.sets(st.integers(0, 99)))
def test_both_formats_say_the_same_as_the_state(
    robots: list[tuple[float, ...]], timestep: int, capture_ns: int, twice: set[int]
) -> None:
    poses = np.array(robots, dtype=POSE)
    state = ArenaState(timestep, capture_ns, poses, len(poses), 2, tuple(sorted(twice)))
    line = arena_lines.to_json(state)
    assert "\n" not in line
    said = json.loads(line)
    assert (said["timestep"], said["capture_ns"]) == (timestep, capture_ns)
    assert (said["detected"], said["unnamed"]) == (len(poses), 2)
    assert said["duplicates"] == sorted(twice)
    text = f"{arena_lines.CSV_HEADER}\n{arena_lines.to_csv(state)}\n"
    rows = list(csv.DictReader(text.splitlines()))
    assert len(said["robots"]) == len(rows) == len(poses)
    for pose, robot, row in zip(poses, said["robots"], rows):
        assert int(row["timestep"]) == timestep and int(row["state_capture_ns"]) == capture_ns
        for name in POSE.names or ():
            for value in (float(robot[name]), float(row[name])):
                assert abs(value - float(pose[name])) <= 6e-4 * (name == "confidence") + 6e-5


def test_a_state_without_robots_is_a_line_of_json_and_none_of_csv() -> None:
    state = ArenaState(3, 4, np.zeros(0, dtype=POSE), 0)
    assert json.loads(arena_lines.to_json(state))["robots"] == []
    assert arena_lines.to_csv(state) == ""
