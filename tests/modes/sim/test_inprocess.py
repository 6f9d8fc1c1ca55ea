"""The robots' minds in this process: the same random numbers, values and words as in the daemon."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.native import WireError
from vsense.base.readings import SensorReadings
from vsense.robots.inprocess import CompiledProgram, ProgramSetup, SimError
from vsense.robots.link._roster import robot_seed
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import Wanted

TABLE = Table([Entry(1, "smell", "f4"), Entry(2, "heard", "4*f4", Direction.ACTUATOR)])
TAGS = (7, 12, 40223)
STEP_NS = 100_000_000
IDLE_STEPS = 3


def splitmix64(seed: int):
    """The generator of robot/robot.c, by its paper: numbers in [0, 1)."""
    mask = 2**64 - 1
    while True:
        seed = (seed + 0x9E3779B97F4A7C15) & mask
        z = seed
        z = ((z ^ z >> 30) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ z >> 27) * 0x94D049BB133111EB) & mask
        yield ((z ^ z >> 31) >> 11) / 2**53


class Run:
    """A run of a few robots, timestep by timestep."""

    def __init__(self, library: Path, seed: int = 1, params: str = "") -> None:
        self.robots = CompiledProgram(ProgramSetup(library, TAGS, TABLE, STEP_NS, seed, params))
        self.timestep = 0

    def live(self, values: dict[int, float], capture_age_ns: int = 0) -> np.ndarray:
        """One timestep; gives what every robot heard, (robots, 4)."""
        wanted = Wanted.RUN if self.timestep >= IDLE_STEPS else Wanted.IDLE
        capture_ns = 10**9 + self.timestep * STEP_NS
        block = np.array([[values[tag]] for tag in TAGS], dtype="<f4").view(np.uint8)
        captures_ns = np.full((len(TAGS), 1), capture_ns - capture_age_ns)
        readings = SensorReadings(TAGS, [4], block, captures_ns)
        times_ns = capture_ns, capture_ns + 20_000_000
        prox = np.zeros((len(TAGS), 8), dtype=np.int16)
        self.robots.step(wanted, IDLE_STEPS, self.timestep, times_ns, readings, prox)
        self.timestep += 1
        reports = self.robots.reports()
        return np.array([np.frombuffer(reports[tag], "<f4") for tag in TAGS])

    def warm_up(self) -> None:
        for _ in range(IDLE_STEPS):
            self.live(dict.fromkeys(TAGS, 0.0))


@pytest.mark.parametrize("seed", [1, 2**32 - 1])
def test_random_numbers_are_those_of_the_daemon(probe: Path, seed: int) -> None:
    run = Run(probe, seed)
    run.warm_up()
    drawn = [splitmix64(robot_seed(seed, tag) << 16 | tag) for tag in TAGS]
    for _ in range(20):
        heard = run.live(dict.fromkeys(TAGS, 0.0))[:, 0]
        np.testing.assert_array_equal(heard, np.float32([next(numbers) for numbers in drawn]))


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=3, max_size=3), st.integers(0, 200))
def test_every_robot_hears_its_own_value_and_its_age(probe: Path, values, older_ms) -> None:
    run = Run(probe)
    run.warm_up()
    heard = run.live(dict(zip(TAGS, values)), older_ms * 1_000_000)
    np.testing.assert_array_equal(heard[:, 1], np.float32(values))
    np.testing.assert_allclose(heard[:, 2], older_ms + 20)


def test_before_the_run_nobody_moves_and_safety_limits_the_speed(probe: Path) -> None:
    run = Run(probe, params="speed=-70\n")
    for _ in range(IDLE_STEPS):
        run.live(dict.fromkeys(TAGS, 0.0))
        assert not run.robots.wheels_steps_s.any()
    run.live(dict.fromkeys(TAGS, 0.0))
    assert run.robots.wheels_steps_s.tolist() == [[-70, 1000]] * 3


def test_controllers_complain_once_in_the_daemons_words(probe: Path) -> None:
    run = Run(probe, params="speed=1\nwarp=9\n")
    assert run.robots.complaints() == []
    run.warm_up()
    for _ in range(3):
        run.live(dict.fromkeys(TAGS, 0.0))
    assert run.robots.complaints() == [
        "controller 'probe': nobody offers the sensor 'moonlight'",
        "controller 'probe' does not know the parameter 'warp': ignored",
    ]
    assert run.robots.controller == "probe"


def test_progress_is_where_the_watch_looks(probe: Path) -> None:
    progress = bytearray(8)
    robots = CompiledProgram(ProgramSetup(probe, TAGS, TABLE, STEP_NS, 1, "", progress))
    prox = np.zeros((len(TAGS), 8), dtype=np.int16)
    never = np.full((len(TAGS), 1), -1)
    readings = SensorReadings(TAGS, [4], np.zeros((len(TAGS), 4), dtype=np.uint8), never)
    robots.step(Wanted.RUN, 0, 1234, (10**9, 10**9 + 1), readings, prox)
    assert np.frombuffer(progress, dtype=np.uint32).tolist() == [1234, 0]


def test_what_is_no_shared_object_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "it.so").write_text("no library")
    with pytest.raises(SimError, match=r"it\.so: cannot be loaded"):
        CompiledProgram(ProgramSetup(tmp_path / "it.so", TAGS, TABLE, STEP_NS, 1, ""))


def test_params_that_no_robot_can_be_told_are_refused(probe: Path) -> None:
    with pytest.raises(WireError):
        CompiledProgram(ProgramSetup(probe, TAGS, TABLE, STEP_NS, 1, "a" * 5000))


def test_what_controllers_show_and_log_is_told_as_it_changes(probe: Path) -> None:
    run = Run(probe)
    run.warm_up()
    values = {7: 1.0, 12: 60.0, 40223: 2.0}
    run.live(values)
    assert run.robots.shown() == [(tag, (("smell", value),)) for tag, value in values.items()]
    assert run.robots.logged() == [(12, "logged: it smells")]
    run.live(values)
    assert run.robots.shown() == []
    run.live(values | {7: 3.0, 12: 95.0})
    assert run.robots.shown() == [(7, (("smell", 3.0),)), (12, (("smell", 95.0),))]
    lost, *lines = run.robots.logged()
    # Ten lines of one step and the one before: eight are kept.
    assert lost == (12, "3 of its log lines are lost")
    assert [text for _, text in lines] == ["logged: more"] * 7 + ["logged: last"]
    assert run.robots.logged() == []
