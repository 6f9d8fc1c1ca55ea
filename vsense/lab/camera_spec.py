"""The lab's cameras, two by two above the arena, looking down; the messages of their process."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vsense.cameras.camera import Camera
from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.lab.backdrop import Block
from vsense.lab.bodies import OBJECT, ROBOT, Body
from vsense.lab.reach import reachable
from vsense.lab.shared import LabError
from vsense.world.entities import Arena

HEIGHT_M = 2.43
"""Above the floor. Source: thesis, 2.1."""
FOCAL_PX = 1620.0
"""Gives 1.5 mm per pixel on the floor."""
SIZE_PX = (1620, 1220)
"""Width and height of a picture. Source: thesis, 2.1."""
DISTORTION = (-0.12, 0.02, 0.0, 0.0, 0.0)
"""A barrel of 47 px in the corners."""

_TALLEST_M = 0.15
_MARGIN_M = 0.05


class TooLargeArena(LabError):
    """The lab's cameras do not see an experiment's whole arena."""

    exit_code = 2


def rig(arena: Arena) -> list[Camera]:
    """Four cameras, "cam_0_0" to "cam_1_1": column and row, from low x and y.

    Each hangs above the middle of its quarter of the arena and sees at least 5 cm beyond it,
    so that every marker is whole in one picture.

    Raises:
        TooLargeArena: it is too large for four cameras.
    """
    size_x, size_y = arena.size_m[:2]
    test = camera_at("test", 0.0, 0.0)
    corner = np.array((test.width_px - 1.0, 0.0))
    edges = np.array(((corner[0], test.cy_px), (test.cx_px, corner[1])))
    reach = test.to_plane(edges, _TALLEST_M)
    reach_x, reach_y = reach[0, 0] - _MARGIN_M, reach[1, 1] - _MARGIN_M
    if size_x > 4.0 * reach_x or size_y > 4.0 * reach_y:
        raise TooLargeArena(
            f"arena of {size_x:g} x {size_y:g} m: the lab's four cameras see at most "
            f"{4.0 * reach_x:.2f} x {4.0 * reach_y:.2f} m"
        )
    return [
        camera_at(
            f"cam_{column}_{row}",
            arena.centre_m[0] + (column - 0.5) * size_x / 2.0,
            arena.centre_m[1] + (row - 0.5) * size_y / 2.0,
        )
        for row in range(2)
        for column in range(2)
    ]


def _cameras(experiment: Experiment) -> list[Camera]:
    """The cameras above the arena, or above what walls leave of one that is too large."""
    try:
        return rig(experiment.arena)
    except TooLargeArena:
        return rig(reachable(experiment))


def camera_at(id: str, x_m: float, y_m: float) -> Camera:
    """One of the lab's cameras, which looks straight down."""
    return Camera.looking_down(id, x_m, y_m, HEIGHT_M, FOCAL_PX, SIZE_PX, DISTORTION)


LITTER = 25
"""Pieces of litter per picture. Source: tracking.md section 1."""


@dataclass(frozen=True, slots=True)
class LabCameraSpec:
    """Everything that decides about the pictures.

    Attributes:
        cameras: all pictures have one size.
        boxes: walls, boxes and cylinders.
        bodies: what moves, in the order of the truth ring.
        family: name of the marker family.
        truth: name of the truth ring.
        log: path of the truth log.
        seed: of floor, litter, light and noise.
        frames: timesteps after which the cameras stop; None: never.
    """

    cameras: tuple[Camera, ...]
    boxes: tuple[Block, ...]
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
        """The spec as one line."""
        return json.dumps(asdict(self) | {"log": str(self.log)})

    @classmethod
    def from_json(cls, text: str) -> LabCameraSpec:
        """Reads the line of `to_json`; LabError where the text is none."""
        try:
            values: dict[str, Any] = json.loads(text)
            values["cameras"] = tuple(
                Camera.from_json(json.dumps(camera)) for camera in values["cameras"]
            )
            values["boxes"] = tuple(Block(**box) for box in values["boxes"])
            values["bodies"] = tuple(Body(**body) for body in values["bodies"])
            values["log"] = Path(values["log"])
            return cls(**values)
        except (TypeError, ValueError, KeyError, VsenseError) as error:
            raise LabError(f"camera spec: {error}") from None


@dataclass(frozen=True, slots=True)
class Exposure:
    """The process's message of one timestep; times on the host's monotonic clock.

    Attributes:
        timestep: number of the trigger.
        slot: that of its pictures in the frame bank.
        capture_ns: middle of the exposure.
        ready_ns: the last picture was in memory.
    """

    timestep: int
    slot: int
    capture_ns: int
    ready_ns: int


def spec_for(experiment: Experiment, truth: str, seed: int, log: Path) -> LabCameraSpec:
    """The spec of an experiment's cameras; the truth ring holds the robots, then the objects.

    Raises:
        TooLargeArena: it is too large for the cameras.
    """
    height_m = experiment.marker.height_m
    return LabCameraSpec(
        cameras=tuple(_cameras(experiment)),
        boxes=tuple(Block.of(thing) for thing in experiment.solids),
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
