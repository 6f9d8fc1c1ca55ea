"""What the site holds, and in which order: pages that lie beside the code, and generated ones.

A page is named by its path in the repository. A README is the page, there is no second text. What
starts with `reference/` is written by a module of this folder when the site is built.
"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]

HOME = "README.md"
"""The first page."""

SECTIONS: dict[str, tuple[str, ...]] = {
    "Begin": (
        "vsense/config/experiments/FIRST_HOUR.md",
        "vsense/modes/live/FIRST_DAY.md",
        "vsense/modes/live/LAB.md",
        "vsense/config/experiments/README.md",
        "vsense/config/ARGOS.md",
    ),
    "Write experiments": (
        "reference/experiment.md",
        "vsense/world/sensors/README.md",
        "reference/devices.md",
        "reference/world.md",
        "robot/README.md",
        "vsense/modes/sim/README.md",
        "vsense/studies/PYTHON.md",
        "reference/commands.md",
    ),
    "In the lab": (
        "vsense/tools/camera_setup/README.md",
        "vsense/vision/tracking/README.md",
        "vsense/vision/tracking/NODES.md",
        "reference/tracking_files.md",
        "vsense/tools/robot_calibration/README.md",
        "vsense/modes/live/README.md",
        "vsense/studies/series/README.md",
        "vsense/studies/benchmark/README.md",
        "vsense/modes/live/SHARING.md",
        "robot/WHICH_ROBOT.md",
        "vsense/modes/live/HARDWARE.md",
        "vsense/monitor/ui/README.md",
    ),
    "Results": (
        "vsense/run/OUTPUT.md",
        "vsense/monitor/recording/README.md",
        "vsense/studies/report/README.md",
        "vsense/studies/packages/README.md",
    ),
    "Protocols": (
        "c_src/PROTOCOL.md",
        "c_src/MICROCONTROLLERS.md",
        "vsense/robots/link/SECURITY.md",
        "vsense/robots/link/PORTS.md",
        "vsense/robots/link/TRACKERS.md",
        "robot/DRIVERS.md",
        "vsense/monitor/ROS2.md",
        "vsense/robots/link/LEGACY.md",
        "vsense/monitor/ui/MESSAGES.md",
        "firmware_bridge/README.md",
        "firmware_bridge/FRAMES.md",
    ),
    "Change vsense": (
        "scripts/site/README.md",
        "vsense/DESIGN.md",
        "vsense/EXTENDING.md",
        "tests/bench/README.md",
        "tests/README.md",
        "tests/fuzz/README.md",
        "CHANGELOG.md",
    ),
}
"""The pages of each section of the site's navigation."""

GENERATED = "reference/"

STANDS_IN = {
    "experiment-files": "reference/experiment.md",
    "tracking-files": "reference/tracking_files.md",
    "sensors-and-actuators": "reference/devices.md",
    "loop-functions-and-the-world": "reference/world.md",
    "commands": "reference/commands.md",
}
"""Sections of `STAND_IN` that tell of a generated page where there is no site, by their anchors."""

STAND_IN = "scripts/site/README.md"


def pages() -> list[str]:
    """All pages, the first page first."""
    return [HOME, *(page for section in SECTIONS.values() for page in section)]


def sources() -> list[str]:
    """The pages that lie in the repository."""
    return [page for page in pages() if not page.startswith(GENERATED)]


NO_PAGES = ("tests/data/", ".github/")
"""Folders whose Markdown files are no pages: where data comes from, and how the project is run."""
