"""What a campaign goes through: combinations and seeds, as the command line says them."""

from __future__ import annotations

import argparse

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import UsageError
from vsense.commands import _arguments
from vsense.modes.sim.job import Sweep

words = st.text(st.sampled_from("abc019.-"), min_size=1, max_size=5)


@given(st.dictionaries(words, st.lists(words, min_size=1, max_size=4, unique=True), max_size=3))
def test_every_combination_comes_once(values) -> None:
    sweep = Sweep.of([(key, ",".join(some)) for key, some in values.items()], 2, None)
    combinations = list(sweep.combinations())
    distinct = {tuple(some.items()) for some in combinations}
    count = 1
    for some in values.values():
        count *= len(some)
    assert len(combinations) == len(distinct) == count
    assert combinations[0] == sweep.first
    assert all(some[key] in values[key] for some in combinations for key in values)


def test_the_last_setting_changes_fastest() -> None:
    sweep = Sweep.of([("a.x", "1,2"), ("b.y", "3,4")], None, None)
    found = [tuple(some.values()) for some in sweep.combinations()]
    assert found == [("1", "3"), ("1", "4"), ("2", "3"), ("2", "4")]
    assert sweep.seeds == (1,)


def test_values_with_commas_of_their_own_are_separated_by_semicolons() -> None:
    for text, values in (("0,0;1,1", ("0,0", "1,1")), ("0,0,5;", ("0,0,5",))):
        assert Sweep.of([("light.position", text)], 1, None).values == {"light.position": values}


def test_one_value_and_no_seeds_is_no_campaign() -> None:
    assert Sweep.of([("sensor.noise", "0.1")], None, None).seeds is None
    assert Sweep.of([], None, None).seeds is None
    assert Sweep.of([], 3, None).seeds == (1, 2, 3)
    assert Sweep.of([], None, (4, 5)).seeds == (4, 5)


@pytest.mark.parametrize(
    ("settings", "runs", "seeds", "words"),
    [
        ([("a.x", "1"), ("a.x", "2")], None, None, r"--set a\.x: given twice"),
        ([("a.x", "1,,2")], None, None, r"--set a\.x=1,,2: expected values"),
        ([("a.x", "1,1")], None, None, "every value once"),
        ([], 3, (1, 2), "--runs 3: --seeds names 2"),
    ],
)
def test_what_contradicts_itself_is_refused(settings, runs, seeds, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        Sweep.of(settings, runs, seeds)


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("1-4", (1, 2, 3, 4)), ("7", (7,)), ("1,3,5-6", (1, 3, 5, 6)), ("9,2", (9, 2))],
)
def test_seeds_are_numbers_and_ranges(text: str, seeds: tuple[int, ...]) -> None:
    assert _arguments.numbers(text) == seeds


@pytest.mark.parametrize("text", ["", "5-1", "1,1", "1-3,2", "a", "1-", "-4", "0-9999999", "1.5"])
def test_seeds_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        _arguments.numbers(text)
