"""A few hundred cases of every Python room: the mutators work, and find nothing."""

from __future__ import annotations

import pytest

from tests.fuzz.rooms import ROOMS
from tests.fuzz.running import random_of, run_room

CASES = {"py-argos": 40, "py-mcap": 60, "py-mcap-json": 30, "py-family": 120, "py-session": 120}
"""Of those whose cases cost most; all others have 300."""


@pytest.mark.parametrize("name", ROOMS)
def test_some_cases_find_nothing(name: str) -> None:
    outcome = run_room(name, 16, 0, CASES.get(name, 300), None)
    assert outcome.findings == ()
    assert outcome.executions == CASES.get(name, 300)


def test_a_case_is_made_again_from_seed_and_number() -> None:
    first = random_of("py-lists", 1, 2).random()
    assert random_of("py-lists", 1, 2).random() == first
    assert random_of("py-lists", 1, 3).random() != first


def test_what_no_refusal_explains_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    room = ROOMS["py-access"]

    def fails(random: object, scene: object) -> None:
        raise KeyError("oh")

    monkeypatch.setitem(ROOMS, "py-access", type(room)(room.prepare, fails, room.refusals))
    outcome = run_room("py-access", 1, 0, 3, None)
    assert len(outcome.findings) == 1, "three of one kind"
    assert "scripts/bench fuzz --seed 1 --case 0 py-access" in outcome.findings[0]
