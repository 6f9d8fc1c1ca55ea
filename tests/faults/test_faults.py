"""Twenty faults of the rig (tests/README.md), and whether its judge sees what is wrong."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Collection
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.conftest import require_own_network
from tests.faults import stage as rig
from tests.faults.faults import Fault
from tests.faults.judge import Wheels, Window, judge, judge_end, judge_kill
from tests.faults.stage import Canary
from tests.rigs.places import ROOT
from vsense.modes.lab._microcontrollers import ACTUATION

MS = 1_000_000
GOES, STANDS = (-300, 300), (0, 0)
BEGUN, ENDED, UNTIL = 1000 * MS, 2000 * MS, 5000 * MS


def test_six_faults_break_no_promise() -> None:
    require_own_network()
    command = [sys.executable, "-m", "tests.faults.campaign", "--seeds", "6", "--seed", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "6 faults, 0 broke a promise" in done.stdout


def verdict(
    rows: list[tuple[int, tuple[int, int]]],
    said: str = "",
    on_air: Collection[int] = (),
    **promises: Any,
) -> tuple[int, int, list[str]]:
    """Judges one robot whose wheels were told these speeds at these times [ms]."""
    log = np.array([(at * MS, 0, *speeds, 0) for at, speeds in rows], ACTUATION)
    stage: Any = SimpleNamespace(
        places=range(1),
        tags=[31],
        on_air=on_air,
        normal={GOES, STANDS},
        rows=lambda place: log,
        lab=SimpleNamespace(said=["before\n", said]),
    )
    found = judge(stage, Fault("it", 1.0, **promises), Window(BEGUN, ENDED, UNTIL, 1))
    return found.stop_ns // MS, found.back_ns // MS, found.broken


STOPPED = [(0, GOES), (1400, STANDS), (2500, GOES)]


@pytest.mark.quick
@pytest.mark.parametrize(
    ("rows", "said", "promises", "words"),
    [
        (STOPPED, "", {"stops": [0]}, ""),
        ([(0, GOES), (500, STANDS), (2500, GOES)], "", {"stops": [0]}, ""),
        ([(0, GOES)], "", {"spared": [0], "silent": "lost"}, ""),
        ([(0, GOES), (1200, (0, 300)), (1201, STANDS), (2100, GOES)], "", {"stops": [0]}, ""),
        ([(0, GOES), (1500, STANDS), (2500, GOES)], "", {"stops": [0]}, "stands 500 ms after"),
        ([(0, GOES)], "", {"stops": [0]}, "stands 1000 ms after"),
        ([*STOPPED[:2], (1700, GOES), (1900, STANDS), (2100, GOES)], "", {"stops": [0]}, "900 ms"),
        (STOPPED, "", {"spared": [0]}, "stands 400 ms after what does not concern it"),
        ([(0, GOES), (1400, STANDS)], "", {"stops": [0]}, "not back"),
        ([*STOPPED, (2700, STANDS)], "", {"stops": [0]}, "not back 3.00 s"),
        ([(0, GOES), (1200, (-300, 400)), (1300, GOES)], "", {}, "speeds {(-300, 400)}"),
        ([(0, GOES)], "robot 31 is lost\n", {"silent": "lost"}, "the host said 'robot 31 is lost'"),
        ([(0, GOES)], "all is well\n", {"says": "lost"}, "did not say 'lost'"),
        ([(0, GOES)], "Traceback (most recent call last)\n", {}, "Traceback"),
    ],
)
def test_the_judge(rows: Any, said: str, promises: dict[str, Any], words: str) -> None:
    *_, broken = verdict(rows, said, **promises)
    assert bool(broken) == bool(words), broken
    assert not words or words in broken[0]


@pytest.mark.quick
@pytest.mark.parametrize(
    ("stands_ms", "by_cable", "by_air"), [(440, 0, 0), (530, 1, 0), (570, 1, 1)]
)
def test_a_robot_without_a_board_has_the_air_s_time_too(
    stands_ms: int, by_cable: int, by_air: int
) -> None:
    rows = [(0, GOES), (1000 + stands_ms, STANDS), (2500, GOES)]
    broken = [len(verdict(rows, on_air=air, stops=[0])[2]) for air in ((), (0,))]
    assert broken == [by_cable, by_air]


@pytest.mark.quick
def test_its_figures() -> None:
    assert verdict(STOPPED, stops=[0])[:2] == (400, 500)


@pytest.mark.quick
def test_a_return_is_later_where_the_way_is_longer() -> None:
    rows = [(0, GOES), (1100, STANDS), (4500, GOES)]
    log = np.array([(at * MS, 0, *speeds, 0) for at, speeds in rows], ACTUATION)
    assert Wheels.of(log).first(True, ENDED) == 4500 * MS
    assert "not back 2.50 s" in verdict(rows, stops=[0])[2][0]
    assert verdict(rows, stops=[0], round_trip_s=0.2)[2] == []


@pytest.mark.quick
def test_who_stands_once_more_is_back_when_it_goes_on() -> None:
    rows = [(0, GOES), (2100, STANDS), (2600, GOES)]
    assert verdict(rows) == (0, 600, [])


def ended_lab(printed: str = '{"timesteps": 9}', rows: Any = (), left: Any = ()) -> Any:
    """A lab that has ended, as its stage shows it; its one robot's wheels were told `rows`."""
    log = np.array([(at * MS, 0, *speeds, 0) for at, speeds in rows], ACTUATION)
    return SimpleNamespace(
        places=range(1),
        tags=[31],
        on_air=(),
        restarted=left,
        rows=lambda: log,
        newest=lambda place: rows[-1][1] if rows else STANDS,
        lab=SimpleNamespace(said=["it turns\n"], printed=[printed], relatives=dict),
    )


class Survivor:
    """A daemon that does not end with its lab."""

    args = "31.sh"

    def wait(self, patience_s: float) -> int:
        raise subprocess.TimeoutExpired(self.args, patience_s)


@pytest.mark.quick
@pytest.mark.parametrize(
    ("stage", "code", "took_s", "logged", "words"),
    [
        (ended_lab(), 143, 1.0, True, ""),
        (ended_lab(), 1, 1.0, False, "exit code 1 after SIGTERM: it turns"),
        (ended_lab(), 143, 2.1, True, "ended 2.1 s after"),
        (ended_lab(printed=""), 143, 1.0, True, "no figures"),
        (ended_lab(printed="{ half"), 143, 1.0, True, "no figures"),
        (ended_lab(rows=[(0, GOES)]), 143, 1.0, True, "wheels turn at the end: [31]"),
        (ended_lab(rows=[(0, GOES)]), 143, 1.0, False, ""),
        (ended_lab(left=[Survivor()]), 143, 1.0, True, "still runs: '31.sh'"),
    ],
)
def test_how_a_lab_ends(stage: Any, code: int, took_s: float, logged: bool, words: str) -> None:
    broken = judge_end(stage, signal.SIGTERM, code, took_s, logged)
    assert bool(broken) == bool(words), broken
    assert not words or words in broken[0]


@pytest.mark.quick
def test_a_machine_that_others_use_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    others, ours, spent = 10**7, os.getpid(), {10**7: 3.0, os.getpid(): 1.0}
    monkeypatch.setattr(rig, "processor_times", lambda: dict(spent))
    monkeypatch.setattr(Canary, "LATE_S", 1e9)
    canary = Canary()
    canary.close()
    spent[ours] += 1e9
    assert canary.busy() == ""
    spent[others] += 1e9
    assert canary.busy().startswith("others had ")
    canary.begin()
    assert canary.busy() == ""
    spent[others + 1] = 1e9  # it has begun since
    assert canary.busy()


@pytest.mark.quick
def test_processor_times_are_the_systems() -> None:
    before_s, start_s = rig.processor_times()[os.getpid()], time.process_time()
    while time.process_time() - start_s < 0.1:
        pass
    assert rig.processor_times()[os.getpid()] - before_s > 0.05


@pytest.mark.quick
def test_wheels_after_a_kill() -> None:
    rows = [(0, GOES), (1400, GOES), (1450, STANDS)]
    assert judge_kill(ended_lab(rows=rows), BEGUN) == []
    assert "[31]" in judge_kill(ended_lab(rows=[*rows, (1451, GOES)]), BEGUN)[0]
