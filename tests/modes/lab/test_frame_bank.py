"""The cameras' memory: what the host has been lent is not drawn over, and cameras never wait."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.rigs.places import ROOT
from vsense.base.shared import BANK_SLOTS, MOST_LENT, FrameBank, LabError, SharedBlock

SHAPE = (2, 30, 40)
TIMESTEPS = 20_000

PAINTER = """
import sys
from vsense.base.shared import FrameBank

bank = FrameBank.open(sys.argv[1], (2, 30, 40))
for timestep in range(int(sys.argv[2])):
    slot = bank.begin(timestep)
    bank.images[slot] = timestep % 251
    print(timestep, slot, flush=True)
"""


class Cameras:
    """The side that draws, in this process."""

    def __init__(self, bank: FrameBank) -> None:
        self._bank = FrameBank.open(bank.name, SHAPE)
        self.timestep = -1

    def draw(self) -> int:
        """Draws the next timestep; gives its slot."""
        self.timestep += 1
        slot = self._bank.begin(self.timestep)
        self._bank.images[slot] = self.timestep % 251
        return slot


@pytest.fixture
def bank() -> Iterator[FrameBank]:
    made = FrameBank.make(SHAPE)
    yield made
    made.close()


def lend(bank: FrameBank, slot: int, timestep: int) -> np.ndarray:
    images = bank.lend(slot, timestep)
    assert images is not None and images.shape == SHAPE
    assert (images == timestep % 251).all()
    return images


def test_cameras_far_ahead_draw_over_nothing_that_anybody_still_looks_at(bank: FrameBank) -> None:
    cameras = Cameras(bank)
    whole = lend(bank, cameras.draw(), 0)
    view = lend(bank, cameras.draw(), 1)[1, 10:20]
    for _ in range(100):
        cameras.draw()
    assert (whole == 0).all() and (view == 1).all()
    assert np.shares_memory(whole, bank.images) and np.shares_memory(view, bank.images)
    for _ in range(100):
        newest = lend(bank, cameras.draw(), cameras.timestep)
    assert (whole == 0).all() and (view == 1).all() and np.shares_memory(newest, bank.images)


def test_a_slot_comes_back_when_the_last_view_is_gone(bank: FrameBank) -> None:
    cameras = Cameras(bank)
    slot = cameras.draw()
    images = lend(bank, slot, 0)
    view = images[0]
    del images
    gc.collect()
    taken = {cameras.draw() for _ in range(10 * BANK_SLOTS)}
    assert taken == set(range(BANK_SLOTS)) - {slot}
    thread = threading.Thread(target=lambda held: None, args=(view,))
    del view
    thread.start()
    thread.join()
    del thread
    gc.collect()
    lend(bank, cameras.draw(), cameras.timestep)
    assert slot in {cameras.draw() for _ in range(BANK_SLOTS)}


def test_who_keeps_too_many_gets_copies_and_the_cameras_go_on(bank: FrameBank) -> None:
    cameras = Cameras(bank)
    kept = [lend(bank, cameras.draw(), n) for n in range(3 * BANK_SLOTS)]
    lent = [np.shares_memory(images, bank.images) for images in kept]
    assert lent == [True] * MOST_LENT + [False] * (3 * BANK_SLOTS - MOST_LENT)
    for _ in range(10 * BANK_SLOTS):
        cameras.draw()
    assert all((images == n).all() for n, images in enumerate(kept))


def mapped(address: int) -> bool:
    """Whether this process has memory at an address."""
    lines = Path("/proc/self/maps").read_text().splitlines()
    ends = ([int(end, 16) for end in line.split()[0].split("-")] for line in lines)
    return any(begin <= address < end for begin, end in ends)


def test_a_copy_s_memory_goes_back_to_the_system_not_to_the_heap() -> None:
    large = FrameBank.make((1, 1024, 2048))
    # Once something as large was released, the heap keeps what is released next.
    del [np.ones(16 << 20, np.uint8)][:]
    held = [large.lend(large.begin(n), n) for n in range(MOST_LENT + 1)]
    copy = held.pop()
    assert copy is not None and not np.shares_memory(copy, large.images)
    middle = copy.ctypes.data + copy.nbytes // 2
    assert mapped(middle)
    del copy
    assert not mapped(middle)
    held.clear()
    large.close()


def test_the_newest_is_there_until_two_newer_ones_are_begun(bank: FrameBank) -> None:
    cameras = Cameras(bank)
    kept = [lend(bank, cameras.draw(), n) for n in range(MOST_LENT)]
    slot = cameras.draw()
    cameras.draw()
    kept.append(lend(bank, slot, MOST_LENT))
    slot = cameras.draw()
    for _ in range(2):
        cameras.draw()
    assert bank.lend(slot, MOST_LENT + 2) is None, "two newer ones were begun"
    assert all((images == n).all() for n, images in enumerate(kept))


def test_another_process_draws_as_fast_as_it_can(bank: FrameBank) -> None:
    command = [sys.executable, "-c", PAINTER, bank.name, str(TIMESTEPS)]
    held: list[tuple[int, np.ndarray]] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as painter:
        assert painter.stdout is not None
        got = 0
        for line in painter.stdout:
            timestep, slot = map(int, line.split())
            images = bank.lend(slot, timestep)
            if images is not None:
                got += 1
                held = [*held[-2:], (timestep, images)]
            assert all((images == timestep % 251).all() for timestep, images in held)
    assert painter.returncode == 0 and got > 0


def test_a_bank_that_is_too_small_or_gone_is_refused(bank: FrameBank) -> None:
    with pytest.raises(LabError, match="frame bank: 64 bytes, 18496 are needed"):
        FrameBank.open(SharedBlock.anonymous("small", 64).name, SHAPE)
    name = bank.name
    bank.close()
    with pytest.raises(LabError, match="nobody has made it"):
        FrameBank.open(name, SHAPE)
