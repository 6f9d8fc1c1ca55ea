"""Behaviour test of start.argos: its swarm does as well as before your changes.

`pytest` runs it here, against what the branch `main` has; OLD names another revision. For pull and
merge requests `.github/workflows/behaviour.yml` and `.gitlab-ci.yml` have it run, where this folder
is a repository; in a part of one move the two to its top, and name the folder behind `pytest`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

OLD = os.environ.get("OLD", "main")


def test_as_many_robots_are_on_the_spot(vsense_compare: Callable[..., Any]) -> None:
    """Their mean over a run may be 10 % less, not more."""
    mine = Path(__file__).parent / "start.argos"
    vsense_compare(f"{OLD}:", mine, maximize="robots_on_spot_mean", margin="10%")
