"""Recordings: everything a run told, in one MCAP file; read, replayed, exported, tracked again."""

from __future__ import annotations

from vsense import errors


def require() -> None:
    """Checks that the packages for recordings are installed.

    Raises:
        UsageError: one is not; the message says how to install it.
    """
    errors.require("recordings need", "mcap", "zstandard")
