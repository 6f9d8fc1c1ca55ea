"""The actuator bank: what reports come to, however they come."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.base.arena import ArenaState
from vsense.world.actuators.bank import ActuatorBank
from vsense.world.actuators.base import ActuatorError, MountedActuator
from vsense.world.sensors.bank import TableEntry
from vsense.world.sensors.quality import Quality, Scale
from vsense.world.world import World

States = Callable[..., ArenaState]
STEP_NS = 100_000_000
TAGS = (7, 3, 9)


@dataclass
class Pump:
    """An actuator for tests: a level (0..100) and a counter; keeps what was asked of it."""

    name: str = "pump"
    layout: str = "2*f4"
    scale: Scale = field(default_factory=lambda: Scale((1.0, 0.0), 0.0, (100.0, 1e6)))
    calls: list[tuple[list[int], Any, Any]] = field(default_factory=list)

    def apply(self, world: World, rows: Any, values: Any, increments: Any) -> None:
        self.calls.append((world.robots["tag"][rows].tolist(), values.copy(), increments.copy()))

    @property
    def levels(self) -> dict[int, float]:
        """The newest levels by tag."""
        tags, values, _ = self.calls[-1]
        return dict(zip(tags, values[:, 0].tolist()))

    def grown(self) -> dict[int, float]:
        """All growths of the counter by tag."""
        total: dict[int, float] = {}
        for tags, _, increments in self.calls:
            for tag, amount in zip(tags, increments[:, 1].tolist()):
                total[tag] = total.get(tag, 0.0) + amount
        return total


class Rig:
    """A bank with one pump on three robots in a world that is updated for every step."""

    def __init__(self, state: States, quality: Quality | None = None, seed: int = 1) -> None:
        self.pump = Pump()
        self.bank = ActuatorBank([MountedActuator(self.pump, 1, quality or Quality())], TAGS, seed)
        self.world = World(TAGS)
        self._state = state
        self._run_timestep = 0

    def step(
        self,
        reports: Mapping[int, tuple[float, float]],
        senders: Mapping[int, bytes] | None = None,
        seen: tuple[int, ...] = TAGS,
    ) -> None:
        """One timestep with (level, count) by tag."""
        places = {tag: (float(tag), 0.0, 0.0) for tag in seen}
        self.world.update(self._state(places, self._run_timestep * STEP_NS), self._run_timestep)
        self._run_timestep += 1
        payloads = {tag: struct.pack("<2f", *said) for tag, said in reports.items()}
        self.bank.apply(self.world, payloads, senders or {})


def test_the_table_goes_on_where_the_sensors_end() -> None:
    mounted = [MountedActuator(Pump(), 1), MountedActuator(Pump("horn", "3*u1", Scale()), 2)]
    bank = ActuatorBank(mounted, TAGS, first_id=4)
    assert bank.table == (TableEntry(4, "pump", "2*f4", 8), TableEntry(5, "horn", "3*u1", 3))


def test_robots_act_in_the_order_of_the_worlds_rows(state: States) -> None:
    rig = Rig(state)
    rig.step({9: (1, 0), 3: (2, 0), 7: (3, 0)})
    assert rig.pump.calls[0][0] == list(TAGS)
    assert rig.pump.levels == {7: 3.0, 3: 2.0, 9: 1.0}


def test_a_level_holds_until_the_next_report_and_ends_with_silence(state: States) -> None:
    rig = Rig(state)
    rig.step({7: (5, 0), 3: (1, 0)})
    rig.step({7: (5, 0), 3: (2, 0)})
    assert rig.pump.levels == {7: 5.0, 3: 2.0, 9: 0.0}
    rig.step({3: (2, 0)})
    assert rig.pump.levels == {7: 0.0, 3: 2.0, 9: 0.0}


@settings(max_examples=150)
@given(
    lives=st.lists(st.lists(st.integers(0, 5), min_size=1, max_size=8), min_size=1, max_size=4),
    fate=st.lists(st.sampled_from(["lost", "once", "twice"]), min_size=40, max_size=40),
)
def test_lost_and_repeated_reports_change_nothing(
    state: States, lives: list[list[int]], fate: list[str]
) -> None:
    """Whatever gets through, the world sees the growth of the counter, over restarts, too."""
    rig, total, fates = Rig(state), 0, iter(fate)
    for life in lives:
        count = 0
        rig.step({7: (0, 0)})
        for drops in life:
            count, total = count + drops, total + drops
            for _ in range({"lost": 0, "once": 1, "twice": 2}[next(fates, "once")]):
                rig.step({7: (0, count)})
        rig.step({7: (0, count)})
    assert rig.pump.grown()[7] == total


@given(st.permutations([(7, (1.5, 3)), (3, (0.25, 1)), (9, (50, 8))]))
def test_the_order_of_arrival_changes_nothing(
    state: States, arrived: list[tuple[int, tuple[float, float]]]
) -> None:
    first, second = Rig(state, NOISY), Rig(state, NOISY)
    for _ in range(3):
        first.step(dict(sorted(arrived)))
        second.step(dict(arrived))
    for one, other in zip(first.pump.calls, second.pump.calls):
        assert one[0] == other[0]
        np.testing.assert_array_equal(one[1], other[1])
        np.testing.assert_array_equal(one[2], other[2])


NOISY = Quality(noise_level=0.5, noise_std_dev=0.1, drop_out=0.3)


def test_each_sender_has_counters_of_its_own(state: States) -> None:
    rig = Rig(state)
    for sender, count in ((b"a", 10), (b"b", 3), (b"a", 12), (b"b", 3), (b"b", 20)):
        rig.step({7: (0, count)}, {7: sender})
    assert rig.pump.grown()[7] == 12 + 20


def test_a_robot_that_nobody_has_seen_acts_once_it_has_been(state: States) -> None:
    rig = Rig(state)
    rig.step({7: (5, 4), 3: (1, 1)}, seen=(3, 9))
    assert rig.pump.calls[-1][0] == [3, 9]
    rig.step({7: (5, 6), 3: (1, 1)})
    assert rig.pump.levels[7] == 5.0 and rig.pump.grown() == {7: 6, 3: 1, 9: 0}
    rig.step({7: (4, 6)}, seen=(3, 9))
    assert rig.pump.levels[7] == 4.0, "it acts where it was seen last"


@given(st.binary(min_size=8, max_size=8))
def test_no_bytes_of_a_report_reach_the_world_out_of_bounds(state: States, raw: bytes) -> None:
    rig = Rig(state)
    rig.step({})
    rig.bank.apply(rig.world, {7: raw})
    rig.bank.apply(rig.world, {7: bytes(8)})
    for _, values, increments in rig.pump.calls:
        assert np.isfinite(values).all() and np.isfinite(increments).all()
        assert (values >= 0.0).all() and (values <= [100.0, 1e6]).all()
        assert (increments >= 0.0).all() and (increments <= [100.0, 1e6]).all()


def test_a_report_of_another_size_is_refused(state: States) -> None:
    rig = Rig(state)
    rig.step({})
    with pytest.raises(ActuatorError, match=r"tag 3:.*7 byte.*8"):
        rig.bank.apply(rig.world, {3: bytes(7)})


def test_latency_delays_levels_and_growth_alike(state: States) -> None:
    rig = Rig(state, Quality(latency=2))
    for said in ((1, 1), (2, 3), (3, 6), (4, 10)):
        rig.step({7: said})
    assert [call[1][0].tolist() for call in rig.pump.calls] == [[0, 0], [0, 0], [1, 1], [2, 3]]
    assert [call[2][0, 1] for call in rig.pump.calls] == [0, 0, 1, 2]


def test_update_every_holds_levels_and_gathers_growth(state: States) -> None:
    rig = Rig(state, Quality(update_every=3))
    for step in range(7):
        rig.step({7: (step, step)})
    assert [call[1][0, 0] for call in rig.pump.calls] == [0, 0, 0, 3, 3, 3, 6]
    assert [call[2][0, 1] for call in rig.pump.calls] == [0, 0, 0, 3, 0, 0, 3]


def test_drop_out_loses_no_growth_and_happens_as_often_as_it_says(state: States) -> None:
    rig = Rig(state, Quality(drop_out=0.25), seed=3)
    for step in range(1, 2001):
        rig.step({7: (step % 90 + 1, step)})
    kept = sum(call[2][0, 1] == 0 for call in rig.pump.calls)
    assert 430 < kept < 570
    assert rig.pump.grown()[7] >= 2000 - 20


def test_noise_is_of_the_size_asked_for_and_leaves_off_what_is_off(state: States) -> None:
    rig = Rig(state, Quality(noise_level=0.5, bias=2.0))
    levels = []
    for _ in range(2000):
        rig.step({7: (50, 5), 3: (0, 1)})
        assert rig.pump.levels[3] == 0.0
        levels.append(rig.pump.levels[7])
    assert 51.5 <= min(levels) < 51.51 and 52.49 < max(levels) <= 52.5
    assert abs(np.mean(levels) - 52.0) < 0.03
    assert rig.pump.grown() == {7: 5, 3: 1, 9: 0}, "a counter is no measurement"


def test_saturation_and_resolution(state: States) -> None:
    rig = Rig(state, Quality(low=0.0, high=10.0, bits=1))
    for said, done in ((3, 0), (7, 10), (80, 10)):
        rig.step({7: (said, 0)})
        assert rig.pump.levels[7] == done


def test_the_same_seed_gives_the_same_noise_and_another_one_another(state: States) -> None:
    rigs = [Rig(state, NOISY, seed) for seed in (1, 1, 2)]
    for rig in rigs:
        for _ in range(20):
            rig.step({7: (50, 0), 9: (20, 0)})
    first, same, other = ([call[1].tolist() for call in rig.pump.calls] for rig in rigs)
    assert first == same != other
