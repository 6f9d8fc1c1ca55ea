"""The simulations' controllers and experiments, for campaigns."""

from __future__ import annotations

from tests.modes.sim.conftest import pollutant, write_experiment

__all__ = ["pollutant", "write_experiment"]
