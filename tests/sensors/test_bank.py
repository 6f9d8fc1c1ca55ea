"""The sensor bank: what each robot is sent, and how old it is."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vsense.arena import ArenaState
from vsense.sensors.bank import SensorBank, TableEntry
from vsense.sensors.base import MountedSensor, SensorError, layout_dtype
from vsense.world.world import NEVER_NS, World

States = Callable[..., ArenaState]
STEP_NS = 100_000_000


@dataclass
class Compass:
    """A sensor for tests: gives where the robot is, times `scale`."""

    name: str = "compass"
    layout: str = "2*f4"
    scale: float = 1.0

    def read(self, world: World, robots: NDArray[np.void]) -> NDArray[Any]:
        return self.scale * np.stack((robots["x_m"], robots["y_m"]), axis=-1)


def bank_of(
    *sensors: Any, tags: tuple[int, ...] = (7, 3), every: int = 1, blind: bool = False
) -> Any:
    return SensorBank([MountedSensor(s, every, 1) for s in sensors], tags, blind)


def test_the_table_numbers_sensors_from_one_in_the_files_order() -> None:
    bank = bank_of(Compass(), Compass("b", "3*u1"))
    assert bank.table == (TableEntry(1, "compass", "2*f4", 8), TableEntry(2, "b", "3*u1", 3))


def test_every_robot_gets_its_own_value_with_its_capture_time(state: States) -> None:
    bank, world = bank_of(Compass(), Compass("second", scale=2.0)), World((7, 3))
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
    bank, world = bank_of(Compass(), tags=(7, 3), every=3), World((7, 3))
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
    ("layout", "scale"),
    [("2*f4", np.nan), ("2*f4", np.inf), ("2*f4", 1e39), ("2*u1", 300), ("2*u1", -1)],
)
def test_no_number_that_cannot_travel_reaches_a_robot(
    state: States, layout: str, scale: float
) -> None:
    bank, world = bank_of(Compass("compass", layout, scale), tags=(7,)), World((7,))
    world.update(state({7: (1, 1, 0)}, STEP_NS), 0)
    with pytest.raises(SensorError, match=r"sensor .compass.: .* does not fit its layout"):
        bank.encode(world, 0)


def test_a_reading_of_the_wrong_shape_is_refused(state: States) -> None:
    bank, world = bank_of(Compass(layout="3*f4"), tags=(7,)), World((7,))
    world.update(state({7: (1, 1, 0)}, STEP_NS), 0)
    with pytest.raises(SensorError, match=r"gave shape \(1, 2\), expected \(1, 3\)"):
        bank.encode(world, 0)


def test_layouts() -> None:
    assert layout_dtype("f4") == (1, np.dtype("<f4"))
    assert layout_dtype("24*i2") == (24, np.dtype("<i2"))
    for wrong in ("", "f8", "0*f4", "u8", "f4*2", "2*", "-1*f4", "f1", "i1"):
        with pytest.raises(SensorError, match="expected 'type' or 'count\\*type'"):
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
