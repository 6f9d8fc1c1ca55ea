"""How many timesteps may follow: speeds, single steps, and machines that are too slow."""

from __future__ import annotations

import math

import pytest

from vsense.modes.sim._paced import FRAME_S, SimPace


class Machine:
    """A simulation on a machine of a given rate, paced on a clock of its own."""

    def __init__(self, pace: SimPace, rate_hz: float) -> None:
        self.pace, self.rate_hz = pace, rate_hz
        self.now_s, self.timestep = 100.0, 0
        self.stretches: list[int] = []

    def go(self, seconds: float) -> int:
        """Goes on for a time; gives how many timesteps that were."""
        begun, end_s = self.timestep, self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            count, wait_s = self.pace.grant(self.timestep, self.now_s)
            if not count and wait_s is None:
                break
            self.timestep += count
            self.stretches += [count] * bool(count)
            self.now_s += count / self.rate_hz if count else wait_s or 0.0
        return self.timestep - begun


@pytest.mark.parametrize("speed", [0.1, 1.0, 3.0, 50.0])
def test_time_passes_at_the_wanted_speed(speed: float) -> None:
    machine = Machine(SimPace(0.1, speed), 2000.0)
    assert machine.go(20.0) == pytest.approx(200 * speed, rel=0.02, abs=1)


def test_fast_runs_go_in_long_stretches_between_two_frames() -> None:
    machine = Machine(SimPace(0.1, math.inf), 10_000.0)
    assert machine.go(2.0) == pytest.approx(20_000, rel=0.05)
    assert max(machine.stretches) == pytest.approx(10_000 * FRAME_S, rel=0.05)
    assert len(machine.stretches) < 60, "the page is told 20 times a second"


def test_who_is_too_slow_does_not_catch_up() -> None:
    """A machine that was slow for a while is at the wanted speed afterwards, not above it."""
    machine = Machine(SimPace(0.1, 10.0), 20.0)
    assert machine.go(10.0) == pytest.approx(200, abs=3)
    machine.rate_hz = 10_000.0
    assert machine.go(10.0) == pytest.approx(1000, rel=0.05)


def test_pause_steps_and_play() -> None:
    machine = Machine(SimPace(0.1, playing=False), 1000.0)
    assert machine.go(5.0) == 0
    machine.pace.step()
    machine.pace.step(2)
    assert machine.go(5.0) == 3
    machine.pace.play(True)
    assert machine.go(2.0) == pytest.approx(20, abs=1)
    machine.pace.step()
    assert machine.go(5.0) == 1, "a step pauses a run that plays"
    machine.pace.step(5)
    machine.pace.play(False)
    assert machine.go(5.0) == 0, "a pause forgets what was asked for"
