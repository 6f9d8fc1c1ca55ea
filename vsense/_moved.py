"""Where modules of vsense 0.1 are now: one finder gives them for their old names, with a warning.

It ends with vsense 0.3. `vsense.sensors.base` is `vsense.world.sensors.base`, the same object.

`python -m vsense` loads this module before `vsense/__main__.py` can take the current folder out of
the search: until an old name is asked for, nothing is imported here but `sys`.
"""

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec
    from types import ModuleType

_ENDS = "0.3"
_WARNED = "VSENSE_OLD_NAMES"
"""The environment variable by which a process tells those that it starts what it has warned of."""

TABLE = {
    "actuators": "world.actuators",
    "arena": "base.arena",
    "benchmark": "studies.benchmark",
    "benchmark.charts": "studies.benchmark.page",
    "benchmark.identification": "studies.benchmark.motion",
    "benchmark.qualification": "studies.benchmark.result",
    "benchmark.scores": "studies.benchmark.evidence",
    "calibration": "vision.calibration",
    "calibration.check": "vision.calibration.checked",
    "calibration.floor": "vision.calibration.placement",
    "calibration.lens": "vision.calibration.bundle",
    "camera_setup": "tools.camera_setup",
    "camera_setup.align_page": "tools.camera_setup.aligning",
    "camera_setup.listing": "tools.camera_setup.files",
    "camera_setup.markers": "vision.tracking.marker_finder",
    "camera_setup.opening": "vision.tracking.single_camera",
    "cameras": "vision.cameras",
    "cameras.aravis_stream": "vision.cameras.aravis_camera",
    "cameras.controls": "vision.tracking.single_camera",
    "cameras.frame_timing": "vision.cameras.lateness",
    "cameras.gige": "vision.cameras.networks",
    "cameras.image_plane": "vision.cameras.camera",
    "cameras.steadiness": "vision.cameras.health",
    "clock": "base.clock",
    "commands.handover": "commands.orders",
    "commands.homes": "commands.experiments",
    "commands.robot_calibrate": "commands.robot_measure",
    "commands.robot_check": "commands.robot_measure",
    "commands.robot_sensors": "commands.robot_measure",
    "commands.series_robots": "commands.series",
    "commands.sim_run": "modes.sim.experiment",
    "config.controllers": "config.experiment",
    "config.parts": "run.cast",
    "config.roster_text": "base.toml",
    "config.sentences": "tools.shipped.sentences",
    "config.starting": "config.placement",
    "doctor": "tools.doctor",
    "doctor.versions": "tools.doctor.checks",
    "errors": "base.errors",
    "experiments": "config.experiments",
    "files": "base.files",
    "foxglove": "monitor.foxglove",
    "homing": "run.homing",
    "homing.motion": "run.homing.traffic",
    "lab": "modes.lab",
    "lab.processes": "base.processes",
    "lab.radio": "modes.lab.hardware",
    "lab.shared": "base.shared",
    "lab.sprites": "modes.lab.renderer",
    "link": "robots.link",
    "link.descriptors": "robots.link.strangers",
    "link.robots": "robots.link",
    "live": "modes.live",
    "live.batteries": "run.robots",
    "markers": "vision.markers",
    "markers.codes": "vision.markers.families",
    "message_bus": "base.message_bus",
    "native": "base.native",
    "packages": "studies.packages",
    "packages.copying": "studies.packages.recordings",
    "packages.findings": "studies.packages.comparing",
    "packages.origin": "modes.origin",
    "packages.recorded": "studies.packages.recordings",
    "packages.scrub": "studies.packages.places",
    "packages.simulating": "studies.packages.reproduce",
    "physics": "world.physics",
    "physics.wheel_noise": "world.physics.motion",
    "pictures": "monitor.pictures",
    "pictures.arena_view": "monitor.pictures.views",
    "pictures.camera_view": "monitor.pictures.views",
    "pictures.canvas": "base.canvas",
    "pictures.run_cameras": "monitor.pictures.run_figure",
    "pictures.world_snapshot": "monitor.pictures.run_samples",
    "recording": "monitor.recording",
    "recording.tracker_made": "vision.tracking.recorded_tracker",
    "report": "studies.report",
    "report.campaigns": "studies.report.compare",
    "report.study.boxes": "studies.report.study.section",
    "report.study.exact": "studies.report.study.rank_tests",
    "report.tracks": "studies.report.gather",
    "robot": "robots",
    "robot.programs": "robots.sources",
    "robot.ssh": "robots.boards",
    "robot_calibration": "tools.robot_calibration",
    "robot_calibration.areas": "tools.robot_calibration.places",
    "robot_calibration.sensor_results": "tools.robot_calibration.results",
    "robot_calibration.swarm": "tools.robot_calibration.driving",
    "run.homecoming": "run.homing.starts",
    "run.link_load": "run.link_check",
    "run.link_verdict": "run.link_check",
    "run.obedience": "run.alarms",
    "run.overload": "run.alarms",
    "run.portrait": "modes.live.run",
    "run.recasting": "run.cast",
    "run.several": "modes.several",
    "sensors": "world.sensors",
    "sensors.neighbours": "world.sensors.geometry",
    "sensors.readings": "base.readings",
    "sensors.updating": "world.sensors.quality",
    "series": "studies.series",
    "series.cast": "studies.series.parts",
    "series.fields": "base.toml",
    "series.forecast": "studies.series.order",
    "series.criteria": "run.verdict",
    "series.witness": "run.witness",
    "sharing": "base.sharing",
    "shipped": "tools.shipped",
    "sim": "modes.sim",
    "sim.campaign": "studies.series.campaign",
    "sim.comparison": "studies.series.comparison",
    "sim.dask_cluster": "modes.sim.engine",
    "sim.pacing": "modes.sim.paced",
    "sim.recordings": "studies.series.simulated",
    "sim.remote": "modes.sim.engine",
    "sim.results": "studies.series.folder",
    "sim.watched": "modes.sim.room",
    "terminal": "base.terminal",
    "tracking": "vision.tracking",
    "tracking.covariance": "vision.tracking.outlines",
    "tracking.decoder": "vision.tracking.naming",
    "tracking.layers": "vision.tracking.workers",
    "tracking.legibility": "vision.tracking.marker_detector",
    "tracking.marker_offsets": "vision.tracking.arena_tracker",
    "tracking.memory": "vision.tracking.recorded_tracker",
    "ui": "monitor.ui",
    "world.floor": "world.fields",
    "world.users_code": "world.loop_functions",
    "xml": "base.xml",
}
"""Old and new names below `vsense`; what lay in a package is found below its new name."""

GONE = {
    "bench": "the benchmarks of vsense itself are in its sources: scripts/bench --help",
    "commands.bench": "the benchmarks of vsense itself are in its sources: scripts/bench --help",
}
"""Modules and packages that left the package, and where one finds them."""


def _found_at(parts: "list[str]") -> "str | None":
    """Where `TABLE` says that a module is; None: where it was."""
    for count in range(len(parts), 0, -1):
        if moved := TABLE.get(".".join(parts[:count])):
            return ".".join([moved, *parts[count:]])
    return None


def _children() -> "dict[str, str]":
    """`from vsense.packages import kinds` asks the new package for a module that it has not."""
    names = {}
    for name, moved in TABLE.items():
        parent, _, leaf = name.rpartition(".")
        new_parent = _found_at(parent.split("."))
        if new_parent and moved != f"{new_parent}.{leaf}":
            names[f"{new_parent}.{leaf}"] = moved
    return names


TABLE.update(_children())


class _Finder:
    """Finds modules by their old names; stands before all other finders in `sys.meta_path`."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> "ModuleSpec | None":
        """See `importlib.abc.MetaPathFinder`."""
        if not name.startswith("vsense."):
            return None
        old = name[len("vsense.") :]
        if reason := GONE.get(old):
            raise ModuleNotFoundError(f"{name} has left the package: {reason}", name=name)
        moved = _found_at(old.split("."))
        if moved is None:
            return None
        new = f"vsense.{moved}"
        return _alias(name, _private(new) or new, warns=old in TABLE)


class _PrivateFinder:
    """Finds what only its own room imports by the name without the underscore; asked last."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> "ModuleSpec | None":
        """See `importlib.abc.MetaPathFinder`."""
        new = _private(name)
        return None if new is None else _alias(name, new, warns=True)


def _private(name: str) -> "str | None":
    """`vsense.world._inventory` for `vsense.world.inventory`; None: there is none."""
    parent, _, leaf = name.rpartition(".")
    if not parent.startswith("vsense.") or leaf.startswith("_"):
        return None
    from importlib.util import find_spec

    private = f"{parent}._{leaf}"
    return private if find_spec(private) else None


def _alias(name: str, new: str, warns: bool) -> "ModuleSpec":
    import os
    import warnings
    from importlib.machinery import ModuleSpec

    known = os.environ.get(_WARNED, "").split()
    if warns and name not in known:
        text = f"{name} is {new} now; the old name ends with vsense {_ENDS}"
        warnings.warn(text, FutureWarning, stacklevel=3)
        os.environ[_WARNED] = " ".join([*known, name])
    return ModuleSpec(name, _Alias(new))  # type: ignore[arg-type]


class _Alias:
    """Loads the module under its new name, and gives it for the old one."""

    def __init__(self, new_name: str) -> None:
        self._new_name = new_name
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: "ModuleSpec") -> "ModuleType":
        """See `importlib.abc.Loader`."""
        import importlib

        module = importlib.import_module(self._new_name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: "ModuleType") -> None:
        """Gives the module its own spec back, which the import system has replaced."""
        module.__spec__ = self._spec


def install() -> None:
    """Has the import system know the old names."""
    sys.meta_path.insert(0, _Finder())
    sys.meta_path.append(_PrivateFinder())
