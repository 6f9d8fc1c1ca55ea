"""The static daemon on a real ARM kernel: it connects, drives, and stops when the link is lost."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.board.board import HOST, I2C, UART, Board
from tests.conftest import require_zig
from tests.robots.rig import MS, TAG, Rig
from vsense.modes.lab._microcontrollers import Microcontrollers
from vsense.robots.boards import TARGETS, toolchain
from vsense.robots.build import cache_directory

pytestmark = pytest.mark.system

STOP_NS = 450 * MS
CANARY_NS = 10 * MS
ROUNDS = 5
MOST_VOID = 20
MEMORY_MAX_KB = 200
"""Of guard and worker together (Pss), with the guard's memory locked."""
RADIO_MAX_KB = 100
"""Of the process that asks the Wi-Fi's driver, where the kernel has wireless extensions."""


class BoardRig(Rig):
    """A rig whose daemon runs on a board."""

    def __init__(self, folder: Path, kind: str, files: dict[str, Path]) -> None:
        super().__init__(files["vsensed"])
        self.base.close()
        self.base = Microcontrollers([kind])
        self._folder = folder
        self._kind = kind
        self._files = files

    @property
    def board(self) -> Board:
        board = self.daemons[-1]
        assert isinstance(board, Board)
        return board

    def switch_on(self, old: bool = False) -> Board:
        """Switches the board on; `old`: see `Board`."""
        on_bus = self.device.startswith("unix:")
        words = self.words(host=HOST, base=f"{self._kind}:{I2C if on_bus else UART}")
        bus = self.device.removeprefix("unix:") if on_bus else None
        board = Board(self._folder, self._files, words, None if on_bus else self.device, bus, old)
        self.daemons.append(board)  # type: ignore[arg-type]
        return board


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory, arm_daemon: Path) -> dict[str, Path]:
    """The daemon and the board's first process, for ARMv5."""
    require_zig()
    init = tmp_path_factory.mktemp("board") / "init"
    compiler = toolchain(TARGETS["epuck"], cache_directory())
    source = Path(__file__).parent / "init.c"
    words = [*compiler.flags, "-s", "-Wall", "-Werror", "-o", str(init), str(source)]
    done: subprocess.CompletedProcess[str] = compiler.run(words)
    assert done.returncode == 0, done.stderr
    return {"init": init, "vsensed": arm_daemon}


@pytest.fixture
def rig(tmp_path: Path, files: dict[str, Path]) -> Iterator[Callable[[str], BoardRig]]:
    made: list[BoardRig] = []

    def make(kind: str) -> BoardRig:
        made.append(BoardRig(tmp_path, kind, files))
        return made[-1]

    yield make
    for one in made:
        one.close()


def said(rig: BoardRig, pattern: str, times: int = 1) -> Callable[[], bool]:
    return lambda: len(re.findall(pattern, rig.board.said)) >= times


def stop_times(rig: BoardRig) -> tuple[list[float], int]:
    """Lets the host fall silent again and again: times to speed 0 [ms], and void rounds.

    Void is a round that seems late to a loop that was itself held up.
    """
    took_ms: list[float] = []
    void = 0
    while len(took_ms) < ROUNDS and void < MOST_VOID:
        rig.wait_for(lambda: rig.moving, "motion", 60)
        rig.live_for(100 * MS)
        rig.held_up_ns = 0
        silent_ns, rig.host.silent = rig.host.fresh_ns, True
        rig.wait_for(lambda: not rig.moving, "rest")
        took_ns = rig.applied[-1].time_ns - silent_ns
        if took_ns <= STOP_NS or rig.held_up_ns < CANARY_NS:
            took_ms.append(took_ns / MS)
        else:
            void += 1
        rig.host.silent = False
    return took_ms, void


@pytest.mark.parametrize("kind", ["argos", "gctronic"])
def test_board(rig: Callable[[str], BoardRig], kind: str) -> None:
    one = rig(kind)
    board = one.switch_on()
    one.wait_for(said(one, "board: has /dev/"), "the kernel and its devices", 120)
    one.wait_for(lambda: one.host.connected, "a session", 60)
    one.run()
    took_ms, void = stop_times(one)
    print(f"{kind}: speed 0 after {sorted(took_ms)} ms; {void} void")
    assert took_ms and max(took_ms) <= STOP_NS / MS
    board.tell("memory")
    one.wait_for(said(one, "board: memory end"), "its memory")
    resident = [int(kb) for kb in re.findall(r"board: memory\s+(\d+) kB", board.said)]
    print(f"{kind}: resident {resident} kB")
    guard, worker, radio = resident
    assert guard + worker <= MEMORY_MAX_KB and radio <= RADIO_MAX_KB
    one.wait_for(lambda: one.moving, "motion again")
    board.tell("term")
    one.wait_for(lambda: not one.moving, "rest")
    one.wait_for(said(one, "board: vsensed ended 0"), "a clean end")
    one.wait_for(lambda: board.process.poll() is not None, "power off")


def test_on_a_system_of_2010(rig: Callable[[str], BoardRig]) -> None:
    """Linux 2.6.24 and no machine-id: it runs, and its network card says who it is."""
    one = rig("argos")
    board = one.switch_on(old=True)
    one.wait_for(said(one, "board: kernel is old"), "the kernel and its filter", 120)
    one.wait_for(lambda: one.host.connected, "a session", 60)
    assert one.host.hellos[0].uid.hex() == f"{TAG:02x}00200000000000" + "0000" + "000425010203"
    one.run()
    one.live_for(1000 * MS)
    assert one.host.last.guard_restarts == 0
    board.tell("term")
    one.wait_for(said(one, "board: vsensed ended 0"), "a clean end")
