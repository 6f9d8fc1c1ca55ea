"""What all tests of the shipped experiments share."""

from __future__ import annotations

from tests.modes.sim.conftest import cache

__all__ = ["cache"]
