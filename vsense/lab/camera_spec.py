"""What the camera process is told before its first picture, and what it says about each."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.lab.backdrop import Box
from vsense.lab.bodies import OBJECT, ROBOT, Body
from vsense.lab.rig import rig
from vsense.lab.shared import LabError
from vsense.tracking.camera import Camera

LITTER = 25
"""Pieces of litter per picture. Source: tracking.md section 1."""


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """Everything that decides about the pictures.

    Attributes:
        cameras: The cameras; all pictures have one size.
        boxes: Walls, boxes and cylinders.
        bodies: What moves, in the order of the truth ring.
        family: Name of the marker family.
        timestep_ns: Time from trigger to trigger.
        truth: Name of the truth ring.
        log: Path of the truth log.
        seed: Decides about floor, litter, light and noise.
        frames: Timesteps after which the cameras stop; None: never.
        litter: Pieces of litter per picture.
    """

    cameras: tuple[Camera, ...]
    boxes: tuple[Box, ...]
    bodies: tuple[Body, ...]
    family: str
    timestep_ns: int
    truth: str
    log: Path
    seed: int
    frames: int | None = None
    litter: int = LITTER

    def __post_init__(self) -> None:
        if len({(camera.width_px, camera.height_px) for camera in self.cameras}) != 1:
            raise LabError("cameras: there must be some, and their pictures must have one size")
        if self.timestep_ns <= 0:
            raise LabError(f"timestep_ns: {self.timestep_ns} is not positive")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Cameras, and rows and columns of a picture."""
        return len(self.cameras), self.cameras[0].height_px, self.cameras[0].width_px

    def to_json(self) -> str:
        """Returns the spec as one line."""
        values = asdict(self)
        values["log"] = str(self.log)
        return json.dumps(values)

    @classmethod
    def from_json(cls, text: str) -> CameraSpec:
        """Reads the line of `to_json`.

        Raises:
            LabError: The text is no such line.
        """
        try:
            values: dict[str, Any] = json.loads(text)
            values["cameras"] = tuple(
                Camera.from_json(json.dumps(camera)) for camera in values["cameras"]
            )
            values["boxes"] = tuple(Box(**box) for box in values["boxes"])
            values["bodies"] = tuple(Body(**body) for body in values["bodies"])
            values["log"] = Path(values["log"])
            return cls(**values)
        except (TypeError, ValueError, KeyError) as error:
            raise LabError(f"camera spec: {error}") from None
        except VsenseError as error:
            raise LabError(f"camera spec: {error}") from None


@dataclass(frozen=True, slots=True)
class Exposure:
    """What the process says about one timestep; times on the host's monotonic clock.

    Attributes:
        timestep: Number of the trigger.
        slot: Where in the frame bank its pictures are.
        capture_ns: Middle of the exposure.
        ready_ns: The last picture was in memory.
        prepare_ms: Time it took to draw the empty arena, before the trigger.
        wait_ms: Time from the exposure's end until the truth of it was known.
        render_ms: Time it took then to draw the bodies.
    """

    timestep: int
    slot: int
    capture_ns: int
    ready_ns: int
    prepare_ms: float
    wait_ms: float
    render_ms: float


def spec_for(experiment: Experiment, truth: str, seed: int, log: Path) -> CameraSpec:
    """Returns the spec of an experiment's cameras.

    Args:
        experiment: Says what stands in the arena.
        truth: Name of a truth ring with the robots, then the objects.
        seed: Decides about all that is random in the pictures.
        log: Path of the truth log.

    Raises:
        LabError: The arena is too large for the cameras.
    """
    height_m = experiment.marker.height_m
    return CameraSpec(
        cameras=tuple(rig(experiment.arena)),
        boxes=(
            *(Box(*box.position_m[:2], box.yaw_rad, *box.size_m) for box in experiment.boxes),
            *(
                Box(*c.position_m[:2], 0.0, 2 * c.radius_m, 2 * c.radius_m, c.height_m, True)
                for c in experiment.cylinders
            ),
        ),
        bodies=(
            *(Body(robot.tag, height_m, ROBOT) for robot in experiment.robots),
            *(Body(thing.tag, height_m, OBJECT) for thing in experiment.objects),
        ),
        family=experiment.marker.family,
        timestep_ns=experiment.timestep_ns,
        truth=truth,
        log=log,
        seed=seed,
    )
