"""Runs of several conditions compared as a paper wants it: tests, effect sizes, figures, words."""

from __future__ import annotations

import importlib.util

from vsense.base.errors import pip_line

SUFFIX = ".csv"
"""Of tables of runs."""
BY = ("condition",)
"""The columns that are compared unless somebody asks for others."""
SEED = 1
"""Of the bootstrap unless somebody gives another: the same runs give the same page."""


def lacking_tests() -> str:
    """The message where SciPy is not installed; "" where it is. It is not imported."""
    if importlib.util.find_spec("scipy") is not None:
        return ""
    return f"statistical tests need the Python package scipy: {pip_line('scipy')}"
