"""Measures of a run: finite numbers by name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from vsense.world.entities import WorldError
from vsense.world.world import Results


def test_numbers_by_name() -> None:
    results = Results()
    results["one"] = 1
    results["two"] = np.float32(2.5)
    results["three"] = np.bool_(True)
    results.update(four=4.0)
    del results["one"]
    assert dict(results) == {"two": 2.5, "three": 1.0, "four": 4.0} and len(results) == 3
    assert all(type(number) is float for number in results.values())
    assert repr(results) == "{'two': 2.5, 'three': 1.0, 'four': 4.0}"


@pytest.mark.parametrize("number", [math.nan, math.inf, "1", None, [1.0], np.zeros(2), 1j])
def test_what_is_no_finite_number_is_refused(number: Any) -> None:
    results = Results()
    with pytest.raises(WorldError, match=r"'share'.*finite"):
        results["share"] = number
    assert not results


def test_an_update_in_place_is_checked_like_any_other() -> None:
    results = Results()
    results |= {"one": 1}
    with pytest.raises(WorldError, match="finite"):
        results |= {"two": math.nan}
    assert dict(results) == {"one": 1.0}


@pytest.mark.parametrize("name", ["", " ", 3, None, "two\nlines"])
def test_a_name_is_a_name(name: Any) -> None:
    with pytest.raises(WorldError, match="expected a name"):
        Results()[name] = 1.0
