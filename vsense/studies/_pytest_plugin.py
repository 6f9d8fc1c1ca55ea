"""A plug-in of pytest, found by its entry point: behaviour tests of swarms.

    def test_foraging_is_as_good_as_before(vsense_compare):
        vsense_compare("main:", "mine/mine.argos", maximize="items_home", margin="10%")

Nothing of vsense is loaded before a test asks for the fixture.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from vsense.studies.series.compare import Comparison


@pytest.fixture
def vsense_compare(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., Comparison]:
    """`vsense.compare` that fails the test unless the new side is better or not worse.

    Paths are seen from pytest's root folder. Runs lie in the test's own folder: what a controller
    in Python opens by itself, nobody knows, so that none are taken from another day.
    """

    def compare(old: str | Path, new: str | Path, **how: Any) -> Comparison:
        from vsense.studies.series import compare as comparing

        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(request.config.rootpath)
            answer = comparing.compare(old, new, **{"output": tmp_path, **how})
        if not answer.passed:
            pytest.fail(f"{answer}\nruns: {answer.table}\npicture: {answer.picture}", pytrace=False)
        return answer

    return compare
