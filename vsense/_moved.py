"""Where modules of vsense 0.1 are now: one finder gives them for their old names, with a warning.

It ends with vsense 0.3. `vsense.sensors.base` is `vsense.world.sensors.base`, the same object.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
import warnings
from types import ModuleType

_ENDS = "0.3"

TABLE = {
    "actuators": "world.actuators",
    "arena": "base.arena",
    "bench": "tools.bench",
    "benchmark": "studies.benchmark",
    "calibration": "vision.calibration",
    "camera_setup": "tools.camera_setup",
    "cameras": "vision.cameras",
    "clock": "base.clock",
    "doctor": "tools.doctor",
    "errors": "base.errors",
    "experiments": "config.experiments",
    "files": "base.files",
    "foxglove": "monitor.foxglove",
    "homing": "run.homing",
    "lab": "modes.lab",
    "lab.processes": "base.processes",
    "lab.shared": "base.shared",
    "link": "robots.link",
    "link.robots": "robots.link",
    "live": "modes.live",
    "markers": "vision.markers",
    "message_bus": "base.message_bus",
    "modes.lab.shared": "base.shared",
    "modes.sim.campaign": "studies.campaign.campaign",
    "modes.sim.comparison": "studies.campaign.comparison",
    "modes.sim.pacing": "modes.sim.paced",
    "monitor.pictures.canvas": "base.canvas",
    "native": "base.native",
    "packages": "studies.packages",
    "physics": "world.physics",
    "pictures": "monitor.pictures",
    "pictures.canvas": "base.canvas",
    "processes": "base.processes",
    "recording": "monitor.recording",
    "report": "studies.report",
    "robot": "robots",
    "robot_calibration": "tools.robot_calibration",
    "robots.link.robots": "robots.link",
    "run.portrait": "modes.live.run",
    "sensors": "world.sensors",
    "series": "studies.series",
    "sharing": "base.sharing",
    "shipped": "tools.shipped",
    "sim": "modes.sim",
    "sim.campaign": "studies.campaign.campaign",
    "sim.comparison": "studies.campaign.comparison",
    "sim.pacing": "modes.sim.paced",
    "terminal": "base.terminal",
    "tracking": "vision.tracking",
    "ui": "monitor.ui",
    "xml": "base.xml",
}
"""Old and new names below `vsense`; what lay in a package is found below its new name."""


def _new_name(name: str) -> str | None:
    """Gives the full new name of a module that has moved."""
    parts = name.split(".")[1:]
    for count in range(len(parts), 0, -1):
        if moved := TABLE.get(".".join(parts[:count])):
            return ".".join(["vsense", moved, *parts[count:]])
    return None


class _Finder:
    """Finds modules by their old names; stands before all other finders in `sys.meta_path`."""

    @staticmethod
    def find_spec(
        name: str, path: object = None, target: object = None
    ) -> importlib.machinery.ModuleSpec | None:
        """See `importlib.abc.MetaPathFinder`."""
        if not name.startswith("vsense."):
            return None
        found = _new_name(name)
        if found is None:
            return None
        if name.removeprefix("vsense.") in TABLE:
            text = f"{name} is {found} now; the old name ends with vsense {_ENDS}"
            warnings.warn(text, FutureWarning, stacklevel=2)
        return importlib.machinery.ModuleSpec(name, _Alias(found))  # type: ignore[arg-type]


class _Alias:
    """Loads the module under its new name, and gives it for the old one."""

    def __init__(self, new_name: str) -> None:
        self._new_name = new_name
        self._spec: importlib.machinery.ModuleSpec | None = None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        """See `importlib.abc.Loader`."""
        module = importlib.import_module(self._new_name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Gives the module its own spec back, which the import system has replaced."""
        module.__spec__ = self._spec


def install() -> None:
    """Has the import system know the old names."""
    sys.meta_path.insert(0, _Finder())
