"""A smaller swarm than the file's: its first robots, or a clear refusal."""

from __future__ import annotations

from dataclasses import replace

import pytest

from vsense.base.errors import UsageError
from vsense.config.experiment import first_robots, load


def test_a_smaller_swarm_is_the_first_of_the_file() -> None:
    experiment = load("pollutant")
    assert first_robots(experiment, 4).robots == experiment.robots[:4]
    assert first_robots(experiment, None) is experiment
    with pytest.raises(UsageError, match=r"--robots 16: .* has 15"):
        first_robots(experiment, 16)


def test_what_pollutes_stays() -> None:
    experiment = load("pollutant")
    source = replace(experiment.sources[0], tag=experiment.robots[9].tag)
    polluted = replace(experiment, sources=(source,))
    assert len(first_robots(polluted, 10).robots) == 10
    with pytest.raises(UsageError, match="--robots 9: would leave out what pollutes"):
        first_robots(polluted, 9)
