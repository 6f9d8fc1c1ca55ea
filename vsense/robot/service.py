"""What lies on a robot's board beside `vsensed`: its settings, and what starts it.

The folder `board/` holds the files as they go there: a unit for systemd, an init script for boards
without it (plain sh, BusyBox will do), and the script that puts everything in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

_BOARD = Path(__file__).parent / "board"
FILES = ("install.sh", "vsensed.init", "vsensed.service")


def settings_text(settings: Mapping[str, str]) -> str:
    """The settings file: one `name = value` in a line."""
    lines = "".join(f"{name} = {value}\n" for name, value in settings.items())
    return f"# Settings of vsensed, written by `vsense robot deploy`; see vsensed --help.\n{lines}"


def files() -> dict[str, bytes]:
    """What is the same on all boards, by name."""
    return {name: (_BOARD / name).read_bytes() for name in FILES}
