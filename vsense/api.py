"""What people import from vsense: `from vsense import World`.

Each name is loaded from its module when somebody asks for it, so that a sensor's file does not load
the whole toolkit. Authors of sensors, actuators and loop functions find the records and seams that
they need here; scripts find recordings, reports and campaigns. Modules may move; these names stay.
"""

# Nothing is imported here: see `vsense/_moved.py`.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from vsense.base.errors import VsenseError
    from vsense.base.terminal import Console, interruption
    from vsense.base.xml.element import Element
    from vsense.modes.lab.truth import read_truth
    from vsense.modes.sim.engine import Engine
    from vsense.modes.sim.job import Setup, Sweep
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
    from vsense.studies.series.campaign import Campaign
    from vsense.studies.series.campaign import run as run_campaign
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
    "Campaign": "vsense.studies.series.campaign",
    "Console": "vsense.base.terminal",
    "Cylinder": "vsense.world.entities",
    "Element": "vsense.base.xml.element",
    "Engine": "vsense.modes.sim.engine",
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
    "Setup": "vsense.modes.sim.job",
    "FinishedRun": "vsense.studies.results",
    "SteppedSimulation": "vsense.modes.sim.stepping",
    "Swarm": "vsense.robots.python_swarm",
    "Sweep": "vsense.modes.sim.job",
    "VirtualActuator": "vsense.world.actuators.base",
    "VirtualRobot": "vsense.world.entities",
    "VirtualSensor": "vsense.world.sensors.base",
    "VsenseError": "vsense.base.errors",
    "World": "vsense.world.world",
    "Zone": "vsense.world.entities",
    "compare": "vsense.studies.series.compare",
    "detect": "vsense.tools.camera_setup.photographs",
    "interruption": "vsense.base.terminal",
    "load": "vsense.studies.notebook:load_experiment",
    "make_report": "vsense.studies.report.report",
    "open_recording": "vsense.monitor.recording.reader",
    "optimize": "vsense.studies.series.optimize",
    "parallel_env": "vsense.studies.notebook",
    "read_truth": "vsense.modes.lab.truth",
    "run_campaign": "vsense.studies.series.campaign:run",
    "save_policy": "vsense.robots.policy",
    "unpack": "vsense.studies.results",
}
"""The module of each public name, and its name there where that is another one."""

__all__ = [
    "Box",
    "Camera",
    "Campaign",
    "Console",
    "Cylinder",
    "Element",
    "Engine",
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
    "Setup",
    "SteppedSimulation",
    "Swarm",
    "Sweep",
    "VirtualActuator",
    "VirtualRobot",
    "VirtualSensor",
    "VsenseError",
    "World",
    "Zone",
    "compare",
    "detect",
    "interruption",
    "load",
    "make_report",
    "open_recording",
    "optimize",
    "parallel_env",
    "read_truth",
    "run_campaign",
    "save_policy",
    "unpack",
]


def __getattr__(name: str) -> "Any":
    if name not in PLACES:
        raise AttributeError(f"module 'vsense' has no attribute {name!r}")
    import importlib

    module, _, original = PLACES[name].partition(":")
    value = globals()[name] = getattr(importlib.import_module(module), original or name)
    return value


def __dir__() -> "list[str]":
    return sorted(PLACES)
