"""The lab's cameras: where they hang, what their process is told, and what it says of each picture.

They hang two by two above the arena, looking straight down.
"""

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


def rig(arena: Arena) -> list[Camera]:
    """Hangs up four cameras, "cam_0_0" to "cam_1_1": column and row, from low x and y.

    Each stands above the middle of its quarter of the arena and sees at least 5 cm beyond it,
    so that every marker is whole in one picture.

    Raises:
        LabError: The arena is too large for four cameras.
    """
    size_x, size_y = arena.size_m[:2]
    test = _camera("test", 0.0, 0.0)
    corner = np.array((test.width_px - 1.0, 0.0))
    edges = np.array(((corner[0], test.cy_px), (test.cx_px, corner[1])))
    reach = test.to_plane(edges, _TALLEST_M)
    reach_x, reach_y = reach[0, 0] - _MARGIN_M, reach[1, 1] - _MARGIN_M
    if size_x > 4.0 * reach_x or size_y > 4.0 * reach_y:
        raise LabError(
            f"arena of {size_x:g} x {size_y:g} m: the lab's four cameras see at most "
            f"{4.0 * reach_x:.2f} x {4.0 * reach_y:.2f} m"
        )
    return [
        _camera(
            f"cam_{column}_{row}",
            arena.centre_m[0] + (column - 0.5) * size_x / 2.0,
            arena.centre_m[1] + (row - 0.5) * size_y / 2.0,
        )
        for row in range(2)
        for column in range(2)
    ]


def _camera(id: str, x_m: float, y_m: float) -> Camera:
    return Camera.looking_down(id, x_m, y_m, HEIGHT_M, FOCAL_PX, SIZE_PX, DISTORTION)


LITTER = 25
"""Pieces of litter per picture. Source: tracking.md section 1."""


@dataclass(frozen=True, slots=True)
class LabCameraSpec:
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
        """Returns the spec as one line."""
        values = asdict(self)
        values["log"] = str(self.log)
        return json.dumps(values)

    @classmethod
    def from_json(cls, text: str) -> LabCameraSpec:
        """Reads the line of `to_json`.

        Raises:
            LabError: The text is no such line.
        """
        try:
            values: dict[str, Any] = json.loads(text)
            values["cameras"] = tuple(
                Camera.from_json(json.dumps(camera)) for camera in values["cameras"]
            )
            values["boxes"] = tuple(Block(**box) for box in values["boxes"])
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


def spec_for(experiment: Experiment, truth: str, seed: int, log: Path) -> LabCameraSpec:
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
    return LabCameraSpec(
        cameras=tuple(rig(experiment.arena)),
        boxes=(
            *(Block(*box.position_m[:2], box.yaw_rad, *box.size_m) for box in experiment.boxes),
            *(
                Block(*c.position_m[:2], 0.0, 2 * c.radius_m, 2 * c.radius_m, c.height_m, True)
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
