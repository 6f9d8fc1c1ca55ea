"""How the host tells robots' wheels what to do: a virtual sensor that `calibrate.c` obeys.

An experiment's arena, cameras and robots stay; what drives the robots is the shipped controller
`calibrate`, which stands where the sensor's reading is stale. Robots that run another controller
are turned away before they could move.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from vsense.config.specs import ControllerSpec, Experiment
from vsense.robot import build
from vsense.sensors.base import MountedSensor, Readings, Robots
from vsense.sensors.quality import Scale
from vsense.world.entities import Box, Cylinder
from vsense.world.world import World

CONTROLLER = "calibrate"


@dataclass(slots=True)
class WheelsWanted:
    """The virtual sensor "wheels_wanted": what each robot's wheels shall do [steps/s].

    Attributes:
        speeds: left and right, by tag; all others stand.
    """

    speeds: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    name: str = "wheels_wanted"
    layout: str = "2*i2"
    scale: ClassVar[Scale] = Scale(low=-1000.0, high=1000.0)

    def read(self, world: World, robots: Robots) -> Readings:
        """Gives the speeds; see `VirtualSensor.read`."""
        wanted = [self.speeds.get(tag, (0, 0)) for tag in robots["tag"].tolist()]
        return np.array(wanted, dtype=np.float64).reshape(-1, 2)


def commanded(experiment: Experiment, wheels: WheelsWanted) -> Experiment:
    """The experiment with nothing in it but arena, walls, robots and objects; `wheels` drive.

    Poses are those of markers: where they sit is what is to be found.
    """
    source = build.source_tree().controllers()[CONTROLLER]
    controller = ControllerSpec(
        id=CONTROLLER,
        label=CONTROLLER,
        library=CONTROLLER,
        sources=(source,),
        includes=(),
        params={},
        sensors=(MountedSensor(wheels, 0),),
        actuators=(),
        line=0,
        strict=True,
    )
    solid = (Box, Cylinder)
    return replace(
        experiment,
        name=f"{experiment.name}-{CONTROLLER}",
        length_s=0.0,
        controllers=(controller,),
        robots=tuple(replace(robot, controller=CONTROLLER) for robot in experiment.robots),
        entities=tuple(e for e in experiment.entities if isinstance(e, solid) and e.physical),
        sources=(),
        fields=(),
        floor=None,
        loop_functions=None,
        markers={},
    )
