"""Four cameras for the tests of a file; each test starts those it needs anew."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.gige.network import GigeCameras
from tests.vision.tracking.synthetic import Robot

ROBOTS = [
    Robot(700, -0.4, -0.3, 0.5),
    Robot(31, 0.45, -0.2, 1.0),
    Robot(1843, -0.3, 0.35, -2.0),
    Robot(77, 0.5, 0.3, 2.5),
]
"""One in the middle of each camera's picture."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GigeCameras]:
    """The network, without any camera yet."""
    made = GigeCameras(tmp_path_factory.mktemp("scenes"), ROBOTS)
    yield made
    made.close()
