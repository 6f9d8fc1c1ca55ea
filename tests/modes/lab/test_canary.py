"""The canary of a lab, and a run that ends before its first tick."""

from __future__ import annotations

import select

import pytest

from vsense.base import clock
from vsense.modes.lab._canary import Canary, Lateness, watch


def test_a_run_that_ends_at_once_has_no_ticks() -> None:
    # Its process is told to end before it has begun to look, unless this one is kept waiting.
    assert len(Canary().end()) < 1000


def test_how_late_ticks_were_takes_as_much_memory_as_different_figures_do() -> None:
    lateness = Lateness()
    for late_ms in (0.1234, 0.1233, 7.0):
        lateness.note(late_ms)
    assert dict(lateness) == {0.123: 2, 7.0: 1} and lateness.worst_ms == 7.0
    assert sorted(lateness.ticks()) == [0.123, 0.123, 7.0]


def test_its_time_is_that_of_a_slow_lab(monkeypatch: pytest.MonkeyPatch) -> None:
    waits_s: list[float] = []
    monkeypatch.setattr(clock, "_permille", 250)
    monkeypatch.setattr(select, "select", lambda *words: (waits_s.append(words[3]) or [0], [], []))
    assert watch() == {} and waits_s == [0.04]
