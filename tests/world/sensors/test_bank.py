"""The sensor bank: what each robot is sent, and how old it is."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vsense.base.arena import ArenaState
from vsense.world.entities import VIRTUAL_TAG_MIN, VirtualRobot
from vsense.world.sensors.bank import SensorBank, TableEntry
from vsense.world.sensors.base import MountedSensor, SensorError, layout_dtype
from vsense.world.sensors.quality import ALWAYS, Quality, Scale, Updating
from vsense.world.world import NEVER_NS, World

States = Callable[..., ArenaState]
STEP_NS = 100_000_000
PERFECT = Quality()


@dataclass
class Compass:
    """A sensor for tests: gives where the robot is, times `factor`."""

    name: str = "compass"
    layout: str = "2*f4"
    factor: float = 1.0
    scale: Scale = field(default_factory=Scale)

    def read(self, world: World, robots: NDArray[np.void]) -> NDArray[Any]:
        return self.factor * np.stack((robots["x_m"], robots["y_m"]), axis=-1)


def bank_of(
    *sensors: Any,
    tags: tuple[int, ...] = (7, 3),
    quality: Quality = PERFECT,
    updating: Updating = ALWAYS,
    blind: bool = False,
    seed: int = 0,
) -> SensorBank:
    mounted = [MountedSensor(sensor, 1, quality, updating) for sensor in sensors]
    return SensorBank(mounted, tags, blind, seed)


def test_the_table_numbers_sensors_from_one_in_the_files_order() -> None:
    bank = bank_of(Compass(), Compass("b", "3*u1"))
    assert bank.table == (TableEntry(1, "compass", "2*f4", 8), TableEntry(2, "b", "3*u1", 3))


def test_every_robot_gets_its_own_value_with_its_capture_time(state: States) -> None:
    bank, world = bank_of(Compass(), Compass("second", factor=2.0)), World((7, 3))
    world.update(state({3: (0.5, 1, 0), 7: (2, -3, 0)}, STEP_NS), 0)
    assert bank.encode(world, 0) == {
        7: [(struct.pack("<2f", 2, -3), STEP_NS), (struct.pack("<2f", 4, -6), STEP_NS)],
        3: [(struct.pack("<2f", 0.5, 1), STEP_NS), (struct.pack("<2f", 1, 2), STEP_NS)],
    }


def test_defect_12_an_unseen_robot_keeps_its_value_and_its_age_grows(state: States) -> None:
    bank, world = bank_of(Compass()), World((7, 3))
    world.update(state({7: (2, -3, 0)}, STEP_NS), 0)
    assert bank.encode(world, 0)[3] == [(bytes(8), NEVER_NS)]
    world.update(state({3: (1, 1, 0), 7: (9, 9, 0)}, 2 * STEP_NS, lost=frozenset({7})), 1)
    values = bank.encode(world, 1)
    assert values[7] == [(struct.pack("<2f", 2, -3), STEP_NS)]
    assert values[3] == [(struct.pack("<2f", 1, 1), 2 * STEP_NS)]


def test_defect_14_an_unchanged_value_is_sent_with_its_new_capture_time(state: States) -> None:
    bank, world = bank_of(Compass(), tags=(7,)), World((7,))
    for k in (1, 2):
        world.update(state({7: (2, -3, 0)}, k * STEP_NS), k)
        assert bank.encode(world, k) == {7: [(struct.pack("<2f", 2, -3), k * STEP_NS)]}


def test_update_every_decides_when_value_and_stamp_are_recomputed(state: States) -> None:
    bank, world = bank_of(Compass(), quality=Quality(update_every=3)), World((7, 3))
    stamps: dict[int, list[int]] = {7: [], 3: []}
    for k in range(9):
        # Robot 3 appears late, and robot 7 is lost just when it is due.
        lost = frozenset({3} if k < 2 else {7} if k == 3 else {})
        world.update(state({3: (k, 0, 0), 7: (k, 0, 0)}, (k + 1) * STEP_NS, lost), k)
        values = bank.encode(world, k)
        for tag in (7, 3):
            ((value, capture_ns),) = values[tag]
            stamps[tag].append(capture_ns // STEP_NS - 1 if capture_ns != NEVER_NS else -1)
            assert struct.unpack("<2f", value)[0] == max(stamps[tag][-1], 0)
    assert stamps[7] == [0, 0, 0, 0, 4, 4, 4, 7, 7]
    assert stamps[3] == [-1, -1, 2, 2, 2, 5, 5, 5, 8]


def test_blind_holds_zero_at_the_normal_capture_times(state: States) -> None:
    bank, world = bank_of(Compass(), tags=(7,), blind=True), World((7,))
    world.update(state({7: (2, -3, 0)}, STEP_NS), 0)
    assert bank.encode(world, 0) == {7: [(bytes(8), STEP_NS)]}


@pytest.mark.parametrize(
    ("layout", "factor"),
    [("2*f4", np.nan), ("2*f4", np.inf), ("2*f4", 1e39), ("2*u1", 300), ("2*u1", -1)],
)
def test_no_number_that_cannot_travel_reaches_a_robot(
    state: States, layout: str, factor: float
) -> None:
    bank, world = bank_of(Compass("compass", layout, factor), tags=(7,)), World((7,))
    world.update(state({7: (1, 1, 0)}, STEP_NS), 0)
    with pytest.raises(SensorError, match=r"sensor .compass.:.*layout"):
        bank.encode(world, 0)


def test_a_reading_of_the_wrong_shape_is_refused(state: States) -> None:
    bank, world = bank_of(Compass(layout="3*f4"), tags=(7,)), World((7,))
    world.update(state({7: (1, 1, 0)}, STEP_NS), 0)
    with pytest.raises(SensorError, match=r"\(1, 2\).*\(1, 3\)"):
        bank.encode(world, 0)


def test_layouts() -> None:
    assert layout_dtype("f4") == (1, np.dtype("<f4"))
    assert layout_dtype("24*i2") == (24, np.dtype("<i2"))
    for wrong in ("", "f8", "0*f4", "u8", "f4*2", "2*", "-1*f4", "f1", "i1"):
        with pytest.raises(SensorError, match=r"'type'.*'count\*type'"):
            layout_dtype(wrong)


def test_the_same_history_gives_the_same_bytes(state: States) -> None:
    runs = []
    for _ in range(2):
        bank, world = bank_of(Compass()), World((7, 3))
        run = []
        for k in range(5):
            world.update(state({3: (k, 1, 0), 7: (-k, 2, 0)}, (k + 1) * STEP_NS), k)
            run.append(bank.encode(world, k))
        runs.append(run)
    assert runs[0] == runs[1]


def readings(
    bank: SensorBank, state: States, xs: list[float], tag: int = 7
) -> list[tuple[float, int]]:
    """Moves robots along x; gives what the one is sent: first number, and timestep of its time."""
    world, sent = World((7, 3)), []
    for k, x in enumerate(xs):
        world.update(state({3: (-x, 0, 0), 7: (x, 0, 0)}, (k + 1) * STEP_NS), k)
        value, capture_ns = bank.encode(world, k)[tag][0]
        number = struct.unpack("<f", value[:4])[0]
        sent.append((number, capture_ns // STEP_NS - 1 if capture_ns != NEVER_NS else -1))
    return sent


def test_latency_delays_value_and_capture_time_together(state: States) -> None:
    bank = bank_of(Compass(), quality=Quality(latency=2))
    assert readings(bank, state, [5, 6, 7, 8]) == [(0, -1), (0, -1), (5, 0), (6, 1)]


def test_drop_out_keeps_the_last_value_with_its_growing_age(state: States) -> None:
    bank = bank_of(Compass(), quality=Quality(drop_out=0.3))
    sent = readings(bank, state, [float(k) for k in range(1, 2001)])
    fresh = [timestep == k for k, (_, timestep) in enumerate(sent)]
    assert sum(fresh) / len(fresh) == pytest.approx(0.7, abs=0.05)
    assert all(number == timestep + 1 for number, timestep in sent if timestep >= 0)


def test_drop_out_of_one_drops_everything(state: States) -> None:
    bank = bank_of(Compass(), quality=Quality(drop_out=1.0))
    assert readings(bank, state, [5, 6]) == [(0, -1), (0, -1)]


def test_a_dropped_reading_is_lost_until_the_next_one_is_due(state: States) -> None:
    bank = bank_of(Compass(), quality=Quality(drop_out=0.5, update_every=10), seed=3)
    stamps = {timestep for _, timestep in readings(bank, state, [1.0] * 400)}
    assert stamps - {-1} <= set(range(0, 400, 10))
    assert 10 < len(stamps) < 35


def test_on_change_value_and_time_wait_for_a_change(state: States) -> None:
    bank = bank_of(Compass(), updating=Updating("change"))
    assert readings(bank, state, [5, 5, 6, 6]) == [(5, 0), (5, 0), (6, 2), (6, 2)]


def test_by_threshold_small_changes_add_up_against_what_was_sent(state: States) -> None:
    bank = bank_of(Compass(scale=Scale(unit=10.0)), updating=Updating("threshold", 0.1))
    xs = [5, 5.5, 5.9, 6, 5.5, 5]
    assert readings(bank, state, xs) == [(5, 0), (5, 0), (5, 0), (6, 3), (6, 3), (5, 5)]


def test_a_robot_that_appears_late_is_sent_its_first_value_whatever_it_is(state: States) -> None:
    bank, world = bank_of(Compass(), updating=Updating("change")), World((7, 3))
    world.update(state({7: (1, 1, 0)}, STEP_NS), 0)
    bank.encode(world, 0)
    world.update(state({3: (0, 0, 0), 7: (1, 1, 0)}, 2 * STEP_NS), 1)
    values = bank.encode(world, 1)
    assert values[3] == [(bytes(8), 2 * STEP_NS)]
    assert values[7] == [(struct.pack("<2f", 1, 1), STEP_NS)]


class Doorbell(Compass):
    """Has a condition of its own: rises only."""

    def changed(self, sent: NDArray[Any], fresh: NDArray[Any]) -> NDArray[np.bool_]:
        return np.asarray(fresh[:, 0] > sent[:, 0])


def test_a_sensor_may_have_its_own_condition(state: States) -> None:
    bank = bank_of(Doorbell(), updating=Updating("own"))
    assert readings(bank, state, [5, 4, 6, 5]) == [(5, 0), (5, 0), (6, 2), (6, 2)]


def test_noise_differs_between_robots_and_repeats_with_the_seed(state: States) -> None:
    noisy = Quality(noise_level=0.5)
    runs = [
        [
            readings(bank_of(Compass(), quality=noisy, seed=seed), state, [1.0] * 20, tag)
            for tag in (7, 3)
        ]
        for seed in (1, 1, 2)
    ]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]
    assert runs[0][0] != [(-number, timestep) for number, timestep in runs[0][1]]


def test_noise_never_leaves_what_the_layout_holds(state: States) -> None:
    bank = bank_of(
        Compass(layout="2*u1", factor=0.0), tags=(7,), quality=Quality(noise_std_dev=500)
    )
    world, seen = World((7,)), set()
    for k in range(100):
        world.update(state({7: (1, 1, 0)}, (k + 1) * STEP_NS), k)
        seen.update(bank.encode(world, k)[7][0][0])
    assert {0, 255} <= seen


def test_whole_numbers_are_rounded_to_the_nearest(state: States) -> None:
    bank, world = bank_of(Compass(layout="2*i2"), tags=(7,)), World((7,))
    world.update(state({7: (2.6, -2.6, 0)}, STEP_NS), 0)
    assert bank.encode(world, 0)[7][0][0] == struct.pack("<2h", 3, -3)


def test_noise_that_would_fill_empty_places_is_tidied_away(state: States) -> None:
    class Tidy(Compass):
        def tidy(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.where(values < 0, 0.0, values)

    bank = bank_of(Tidy(factor=0.0), quality=Quality(bias=-1.0))
    assert readings(bank, state, [1.0]) == [(0, 0)]


def test_a_virtual_robot_may_carry_sensors_and_leave(state: States) -> None:
    ghosts = [VirtualRobot(f"g{k}", VIRTUAL_TAG_MIN + k, float(k), 9.0) for k in (1, 2)]
    tags = (7, VIRTUAL_TAG_MIN + 1, VIRTUAL_TAG_MIN + 2)
    bank, world = bank_of(Compass(), tags=tags), World((7,), entities=ghosts)
    world.update(state({7: (5, 0, 0)}, STEP_NS), 0)
    first = bank.encode(world, 0)
    assert [struct.unpack("<2f", first[tag][0][0]) for tag in tags] == [(5, 0), (1, 9), (2, 9)]
    world.remove("g1")
    world.move("g2", 8.0, 8.0)
    world.update(state({7: (6, 0, 0)}, 2 * STEP_NS), 1)
    assert bank.encode(world, 1) == {
        7: [(struct.pack("<2f", 6, 0), 2 * STEP_NS)],
        tags[1]: [(struct.pack("<2f", 1, 9), STEP_NS)],
        tags[2]: [(struct.pack("<2f", 8, 8), 2 * STEP_NS)],
    }


def test_virtual_robots_are_sensed_and_need_carry_no_sensors(state: States) -> None:
    ghost = VirtualRobot("ghost", VIRTUAL_TAG_MIN, 9.0, 9.0)
    bank, world = bank_of(Compass()), World((7, 3), entities=[ghost])
    world.update(state({3: (1, 0, 0), 7: (2, 0, 0)}, STEP_NS), 0)
    assert bank.encode(world, 0) == {
        7: [(struct.pack("<2f", 2, 0), STEP_NS)],
        3: [(struct.pack("<2f", 1, 0), STEP_NS)],
    }


def test_without_sensors_every_robot_is_sent_nothing(state: States) -> None:
    world = World((7, 3))
    world.update(state({3: (1, 0, 0)}, STEP_NS), 0)
    assert bank_of().encode(world, 0) == {7: [], 3: []}
