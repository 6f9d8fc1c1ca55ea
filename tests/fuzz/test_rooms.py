"""A few hundred cases of every Python room: the mutators work, and find nothing. And every C target
is compiled and reads its corpus, with any compiler: none falls behind unseen where clang is not."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.fuzz.c_targets import FLAGS, HERE, STRICT, names, sources
from tests.fuzz.rooms import ROOMS
from tests.fuzz.running import random_of, run_room
from tests.rigs.compiling import compiled
from tests.robots.conftest import Builder

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


def test_all_c_targets_compile_and_their_corpora_hold(tmp_path: Path) -> None:
    flags = [*FLAGS, "-O0"]
    objects = Builder(tmp_path).objects(list(sources()), flags)
    shared = tmp_path / "shared.a"
    subprocess.run(["ar", "rcs", str(shared), *map(str, objects)], check=True)
    for name in names():
        source = HERE / "targets" / f"{name}.c"
        words = [*flags, *STRICT, "-DWITHOUT_LIBFUZZER", source, shared, "-lm"]
        program = compiled(tmp_path / name, *words)
        corpus = sorted(map(str, (HERE / "corpus" / name).iterdir()))
        assert corpus, name
        run = [str(program), *corpus]
        done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=60)
        assert done.returncode == 0, f"{name}: {done.stderr}"
