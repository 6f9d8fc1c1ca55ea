"""The pages that are written from the code."""

from __future__ import annotations

from collections.abc import Callable

from scripts.site import commands, docstrings, reference, tracking_files

WRITERS: dict[str, Callable[[], str]] = {
    "reference/commands.md": commands.page,
    "reference/tracking_files.md": tracking_files.page,
    "reference/experiment.md": reference.page,
    "reference/devices.md": docstrings.devices,
    "reference/world.md": docstrings.world_page,
}
"""What writes each page, by its name in the contents."""


def generated() -> dict[str, str]:
    """The text of each generated page, by its name."""
    return {name: write() for name, write in WRITERS.items()}
