"""Callbacks of the page's thread that fail: a run goes on without what has failed, and says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults.callbacks import Attempt, prepared, try_point

pytestmark = pytest.mark.quick


@pytest.mark.parametrize(
    "point", ["_server:WebServer._serve", "_web_listener:WebListener._sweep_often"]
)
def test_a_page_that_fails_ends_no_run(point: str) -> None:
    broken, said = try_point("sim", f"web|vsense.monitor.ui.{point}", 1)
    assert broken == [], "".join(said)


def test_the_rig_sees_what_nobody_says(tmp_path: Path) -> None:
    with prepared("sim", tmp_path) as words:
        nowhere = "--throw", "web|vsense.monitor.ui._server:WebServer.never|1"
        attempt = Attempt(tmp_path, [*words, "--dry"], *nowhere)
        assert attempt.broken(tmp_path) == ["void: not called so often"]
        (tmp_path / "thrown").touch()
        assert attempt.broken(tmp_path) == ["not a word of it"]
