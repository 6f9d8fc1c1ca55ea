"""What recordings say: figures, a page, and charts that Matplotlib draws."""

from __future__ import annotations

import importlib.util

from vsense.base.errors import pip_line

FORMATS = ("png", "svg", "pdf")
"""Files that charts can be kept in."""


def lacking() -> str:
    """The message where Matplotlib is not installed."""
    return f"charts need the Python package matplotlib: {pip_line('matplotlib')}"


def can_draw() -> bool:
    """Whether Matplotlib is installed; it is not imported."""
    return importlib.util.find_spec("matplotlib") is not None
