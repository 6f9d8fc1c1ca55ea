"""Recordings: everything a run told, in one MCAP file; read, replayed, exported, tracked again."""

from __future__ import annotations

import importlib.util

from vsense.errors import UsageError


def require() -> None:
    """Makes sure that what recordings need is installed.

    Raises:
        UsageError: it is not; the message says how to install it.
    """
    for module in ("mcap", "zstandard"):
        if importlib.util.find_spec(module) is None:
            raise UsageError(
                f"recordings need the Python package {module}: pip install 'vsense[record]'"
            )
