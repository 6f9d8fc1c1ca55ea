"""How the host tells robots' wheels what to do: a virtual sensor that `calibrate.c` obeys.

What their own sensors measure comes back by a virtual actuator, raw: as the base measures it, not
as the robot's settings would have it, or what was measured would be applied twice.

An experiment's arena, cameras and robots stay; what drives the robots is the shipped controller
`calibrate`, which stands where the sensor's reading is stale. Robots that run another controller
are turned away before they could move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from vsense.base.arena import Floats
from vsense.config.specs import ControllerSpec, Experiment
from vsense.robots import build
from vsense.world.actuators.base import MountedActuator, RowNumbers
from vsense.world.entities import Box, Cylinder
from vsense.world.sensors.base import MountedSensor, Readings, Robots
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

CALIBRATE = "calibrate"


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


PROXIMITY, GROUND = "proximity", "ground"
OWN_SENSORS = (PROXIMITY, GROUND)
"""Names of the robots' own sensors that can be calibrated, as controllers know them."""

_KNOWN = {PROXIMITY: 1, GROUND: 2}


@dataclass(slots=True)
class OwnReadings:
    """The virtual actuator "own_readings": what each robot's own sensors measure, raw.

    Attributes:
        wanted: of `OWN_SENSORS`.
        newest: by tag and name; what a robot does not measure, or does not tell now, is not there.
    """

    wanted: Sequence[str] = OWN_SENSORS
    newest: dict[int, dict[str, Floats]] = field(default_factory=dict)
    name: str = "own_readings"
    layout: str = "12*i2"
    scale: ClassVar[Scale] = Scale(low=-4096.0, high=4096.0)

    def apply(self, world: World, rows: RowNumbers, values: Floats, increments: Floats) -> None:
        """Keeps the readings; see `VirtualActuator.apply`."""
        tags = world.robots["tag"][rows].tolist()
        self.newest = {
            tag: {
                name: (numbers[1:9] if name == PROXIMITY else numbers[9:]).copy()
                for name in OWN_SENSORS
                if int(numbers[0]) & _KNOWN[name]
            }
            for tag, numbers in zip(tags, values)
        }


def commanded(
    experiment: Experiment, wheels: WheelsWanted, readings: OwnReadings | None = None
) -> Experiment:
    """The experiment with nothing in it but arena, walls, robots and objects; `wheels` drive.

    With `readings` the robots tell what their own sensors measure.

    Poses are those of markers: where they sit is what is to be found.
    """
    source = build.source_tree().controllers()[CALIBRATE]
    controller = ControllerSpec(
        id=CALIBRATE,
        label=CALIBRATE,
        library=CALIBRATE,
        sources=(source,),
        includes=(),
        params={} if readings is None else dict.fromkeys(readings.wanted, "1"),
        sensors=(MountedSensor(wheels, 0),),
        actuators=() if readings is None else (MountedActuator(readings, 0),),
        line=0,
    )
    solid = (Box, Cylinder)
    return replace(
        experiment,
        name=f"{experiment.name}-{CALIBRATE}",
        length_s=0.0,
        controllers=(controller,),
        robots=tuple(replace(robot, controller=CALIBRATE) for robot in experiment.robots),
        entities=tuple(e for e in experiment.entities if isinstance(e, solid) and e.physical),
        sources=(),
        fields=(),
        floor=None,
        loop_functions=None,
        markers={},
    )
