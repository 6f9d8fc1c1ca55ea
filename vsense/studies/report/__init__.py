"""What recordings and tables of runs say: figures, tests, a page, and charts."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from vsense.base.errors import pip_line

FORMATS = ("png", "svg", "pdf")
"""Files that charts can be kept in."""
BY = ("condition",)
"""The columns that are compared unless somebody asks for others."""
SEED = 1
"""Of the bootstrap unless somebody gives another: the same runs give the same page."""


@dataclass(frozen=True, slots=True)
class Questions:
    """What a person asks of tables of runs, before looking at them.

    Attributes:
        by: columns of runs.csv whose values are compared, see `studies`.
        independent: runs with the same start make no pairs.
        seed: of the bootstrap.
        margins: by measure, how far means may lie apart and still be called the same.
        only: measures that are looked at; (): all.
        against: the condition that all others are compared with; "": each with each.
        tests: SciPy is there.
    """

    by: Sequence[str] = BY
    independent: bool = False
    seed: int = SEED
    margins: Mapping[str, float] = field(default_factory=dict)
    only: Sequence[str] = ()
    against: str = ""
    tests: bool = True


def can_draw() -> bool:
    """Whether Matplotlib is installed; it is not imported."""
    return importlib.util.find_spec("matplotlib") is not None


def lacking() -> str:
    """The message where Matplotlib is not installed; "" where it is."""
    if can_draw():
        return ""
    return f"charts need the Python package matplotlib: {pip_line('matplotlib')}"


def lacking_tests() -> str:
    """The message where SciPy is not installed; "" where it is. It is not imported."""
    if importlib.util.find_spec("scipy") is not None:
        return ""
    return f"statistical tests need the Python package scipy: {pip_line('scipy')}"
