"""What people import from vsense: `from vsense import World`.

Each name is loaded from its module when somebody asks for it, so that a sensor's file does not load
the whole toolkit. Authors of sensors, actuators and loop functions find the records and seams that
they need here; scripts find experiments, recordings and reports. Modules may move; these names
stay.
"""

# Nothing is imported here: see `vsense/_moved.py`.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from vsense.base.errors import VsenseError
    from vsense.base.xml.element import Element
    from vsense.modes.lab.truth import read_truth
    from vsense.modes.sim.stepping import SteppedSimulation
    from vsense.monitor.recording.reader import open_recording
    from vsense.robots.policy import save_policy
    from vsense.robots.python_robot import Robot
    from vsense.robots.python_swarm import Leds, Swarm
    from vsense.studies.live_run import LiveRun
    from vsense.studies.notebook import LoadedExperiment, parallel_env
    from vsense.studies.notebook import load_experiment as load
    from vsense.studies.report.report import make_report
    from vsense.studies.results import FinishedRun, RunTable, unpack
    from vsense.studies.series.compare import compare
    from vsense.studies.series.optimize import optimize
    from vsense.tools.camera_setup.photographs import detect
    from vsense.vision.cameras.camera import Camera
    from vsense.world.actuators.base import VirtualActuator
    from vsense.world.entities import Box, Cylinder, Light, VirtualRobot, Zone
    from vsense.world.fields import Floor
    from vsense.world.sensors.base import Robots, Scope, VirtualSensor
    from vsense.world.sensors.quality import Scale
    from vsense.world.world import World

PLACES = {
    "Box": "vsense.world.entities",
    "Camera": "vsense.vision.cameras.camera",
    "Cylinder": "vsense.world.entities",
    "Element": "vsense.base.xml.element",
    "Floor": "vsense.world.fields",
    "Leds": "vsense.robots.python_swarm",
    "Light": "vsense.world.entities",
    "LiveRun": "vsense.studies.live_run",
    "LoadedExperiment": "vsense.studies.notebook",
    "Robot": "vsense.robots.python_robot",
    "Robots": "vsense.world.sensors.base",
    "RunTable": "vsense.studies.results",
    "Scale": "vsense.world.sensors.quality",
    "Scope": "vsense.world.sensors.base",
    "FinishedRun": "vsense.studies.results",
    "SteppedSimulation": "vsense.modes.sim.stepping",
    "Swarm": "vsense.robots.python_swarm",
    "VirtualActuator": "vsense.world.actuators.base",
    "VirtualRobot": "vsense.world.entities",
    "VirtualSensor": "vsense.world.sensors.base",
    "VsenseError": "vsense.base.errors",
    "World": "vsense.world.world",
    "Zone": "vsense.world.entities",
    "compare": "vsense.studies.series.compare",
    "detect": "vsense.tools.camera_setup.photographs",
    "load": "vsense.studies.notebook:load_experiment",
    "make_report": "vsense.studies.report.report",
    "open_recording": "vsense.monitor.recording.reader",
    "optimize": "vsense.studies.series.optimize",
    "parallel_env": "vsense.studies.notebook",
    "read_truth": "vsense.modes.lab.truth",
    "save_policy": "vsense.robots.policy",
    "unpack": "vsense.studies.results",
}
"""The module of each public name, and its name there where that is another one."""

__all__ = [
    "Box",
    "Camera",
    "Cylinder",
    "Element",
    "FinishedRun",
    "Floor",
    "Leds",
    "Light",
    "LiveRun",
    "LoadedExperiment",
    "Robot",
    "Robots",
    "RunTable",
    "Scale",
    "Scope",
    "SteppedSimulation",
    "Swarm",
    "VirtualActuator",
    "VirtualRobot",
    "VirtualSensor",
    "VsenseError",
    "World",
    "Zone",
    "compare",
    "detect",
    "load",
    "make_report",
    "open_recording",
    "optimize",
    "parallel_env",
    "read_truth",
    "save_policy",
    "unpack",
]


def __getattr__(name: str) -> "Any":
    if name not in PLACES:
        raise AttributeError(f"module 'vsense' has no attribute {name!r}")
    import importlib

    module, _, original = PLACES[name].partition(":")
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        import vsense.base.errors as errors

        raise errors.lacking(f"vsense.{name} needs", error) from None
    value = globals()[name] = getattr(found, original or name)
    return value


def __dir__() -> "list[str]":
    return sorted(PLACES)
