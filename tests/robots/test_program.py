"""Kinds of programs: chosen by the suffix, and what has no kind is told with those that have."""

from __future__ import annotations

from pathlib import Path

import pytest

from vsense.base.errors import UsageError
from vsense.robots.inprocess import CompiledProgram
from vsense.robots.program import KINDS_BY_SUFFIX, kind_of
from vsense.robots.sources import ProgramSources


@pytest.mark.parametrize("suffix", [".c", ".cpp"])
def test_the_suffix_chooses_the_kind(suffix: str) -> None:
    assert kind_of(ProgramSources((Path(f"/x/mine{suffix}"),))).open is CompiledProgram


def test_a_file_of_no_kind_is_refused_with_those_that_are() -> None:
    with pytest.raises(UsageError) as caught:
        kind_of(ProgramSources((Path("/x/mine.rs"), Path("/x/other.c"))))
    assert str(caught.value).startswith("/x/mine.rs: ")
    assert all(suffix in str(caught.value) for suffix in KINDS_BY_SUFFIX)
