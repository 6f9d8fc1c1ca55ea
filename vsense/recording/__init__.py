"""Recordings: everything a run told, in one MCAP file; read, replayed, exported, tracked again."""

from __future__ import annotations

from vsense import errors


def require() -> None:
    """Raises UsageError, with how to install them, if packages for recordings are missing."""
    errors.require("recordings need", "mcap", "zstandard")
