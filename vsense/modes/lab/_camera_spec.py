"""The lab's cameras, in a grid above the arena, looking down; the messages of their process."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base import clock
from vsense.base.errors import VsenseError
from vsense.base.shared import LabError
from vsense.config.specs import Experiment
from vsense.modes.lab._backdrop import Block
from vsense.modes.lab._bodies import OBJECT, ROBOT, Body
from vsense.modes.lab._reach import reachable
from vsense.modes.lab.hardware import RobotHardware
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena
from vsense.world.robot_models import EPUCK

GridShape = tuple[int, int]
"""Columns along x, and rows along y."""

HEIGHT_M = 2.43
"""Above the floor. Source: thesis, 2.1."""
FOCAL_PX = 1620.0
"""Gives 1.5 mm per pixel on the floor."""
SIZE_PX = (1620, 1220)
"""Width and height of a picture. Source: thesis, 2.1."""
DISTORTION = (-0.12, 0.02, 0.0, 0.0, 0.0)
"""A barrel of 47 px in the corners."""

MOST_CAMERAS = 64
HIGHEST_M = 6.0
"""Of a camera that has to see much: its pictures grow with its height, so that a millimetre has as
many pixels as anywhere."""

TALLEST_M = 0.15
"""The cameras see markers up to this height whole, and higher ones where there are such."""
_MARGIN_M = 0.05
_FEW: GridShape = (2, 2)


class TooLargeArena(LabError):
    """The lab's cameras do not see an experiment's whole arena."""

    exit_code = 2


def rig(arena: Arena, grid: GridShape | None = None, tallest_m: float = TALLEST_M) -> list[Camera]:
    """Cameras that see a whole arena: "cam_0_0" and so on, column and row from low x and y.

    Each hangs above the middle of its part of the arena and sees at least 5 cm beyond it,
    so that every marker is whole in one picture.

    Args:
        grid: columns and rows; they hang higher than `HEIGHT_M`, with larger pictures, where they
            would not see everything. None: as many as are needed, two by two at least.
        tallest_m: height of the highest marker.

    Raises:
        TooLargeArena: it takes more than `MOST_CAMERAS`, or a height of more than `HIGHEST_M`.
    """
    size = np.array(arena.size_m[:2])
    columns, rows = grid = grid or _needed(arena, tallest_m)
    height_m = float(np.max((size / grid / 2.0 + _MARGIN_M) / _slope())) + tallest_m
    height_m = max(HEIGHT_M, math.ceil(height_m * 1000.0) / 1000.0)
    who = f"arena of {size[0]:g} x {size[1]:g} m: {columns} x {rows} cameras"
    if columns * rows > MOST_CAMERAS:
        raise TooLargeArena(f"{who} are too many: the lab has at most {MOST_CAMERAS}")
    if height_m > HIGHEST_M:
        raise TooLargeArena(
            f"{who} would have to hang {height_m:.1f} m high, and the lab's ceiling is at"
            f" {HIGHEST_M:g} m: take more"
        )
    return [
        camera_at(
            f"cam_{column}_{row}",
            arena.centre_m[0] + (column - (columns - 1) / 2.0) * arena.size_m[0] / columns,
            arena.centre_m[1] + (row - (rows - 1) / 2.0) * arena.size_m[1] / rows,
            height_m,
        )
        for row in range(rows)
        for column in range(columns)
    ]


def _needed(arena: Arena, tallest_m: float) -> GridShape:
    """How many cameras see an arena from `HEIGHT_M`, in columns and rows."""
    side_m = 2.0 * ((HEIGHT_M - tallest_m) * _slope() - _MARGIN_M)
    columns, rows = np.ceil(np.array(arena.size_m[:2]) / side_m).astype(int).tolist()
    return max(columns, _FEW[0]), max(rows, _FEW[1])


def _slope() -> NDArray[np.float64]:
    """How far the lab's cameras see to their right and up, (2,) for each metre of height."""
    test = camera_at("test", 0.0, 0.0)
    edges = np.array(((test.width_px - 1.0, test.cy_px), (test.cx_px, 0.0)))
    return np.diag(test.to_plane(edges, TALLEST_M)) / (HEIGHT_M - TALLEST_M)


def cameras_above(experiment: Experiment, grid: GridShape | None) -> list[Camera]:
    """The cameras above the arena, or above what walls leave of one that is too large for four."""
    arena = experiment.arena
    heights = (experiment.marker_height_m(body.model) for body in experiment.bodies)
    tallest_m = max([TALLEST_M, *heights])
    is_small = _needed(arena, tallest_m) == _FEW
    return rig(arena if is_small else reachable(experiment), grid, tallest_m)


def camera_at(id: str, x_m: float, y_m: float, height_m: float = HEIGHT_M) -> Camera:
    """One of the lab's cameras, which looks straight down; a high one has more pixels."""
    scale = height_m / HEIGHT_M
    width, height = (4 * math.ceil(pixels * scale / 4) for pixels in SIZE_PX)
    return Camera.looking_down(
        id, x_m, y_m, height_m, FOCAL_PX * scale, (width, height), DISTORTION
    )


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
        permille: the clock's pace, as in `vsense.base.clock.slow`.
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
    permille: int = 1000

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
        bodies = [body.message() for body in self.bodies]
        return json.dumps(asdict(self) | {"log": str(self.log), "bodies": bodies})

    @classmethod
    def from_json(cls, text: str) -> LabCameraSpec:
        """Reads the line of `to_json`; LabError where the text is none."""
        try:
            values: dict[str, Any] = json.loads(text)
            values["cameras"] = tuple(
                Camera.from_json(json.dumps(camera)) for camera in values["cameras"]
            )
            values["boxes"] = tuple(Block(**box) for box in values["boxes"])
            values["bodies"] = tuple(Body.of(body) for body in values["bodies"])
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


def spec_for(
    experiment: Experiment,
    truth: str,
    seed: int,
    log: Path,
    grid: GridShape | None = None,
    cameras: Sequence[Camera] | None = None,
    hardware: Mapping[int, RobotHardware] = {},
    worn: Mapping[int, int] = {},
) -> LabCameraSpec:
    """The spec of an experiment's cameras; the truth ring holds the robots, then the objects.

    They are `cameras`, or those of `cameras_above` for a `grid` as in `rig`; `hardware` says where
    markers sit, by tag; `worn` are the markers of robots that wear another one than their tag.

    Raises:
        TooLargeArena: it is too large for the cameras.
    """
    return LabCameraSpec(
        cameras=tuple(cameras or cameras_above(experiment, grid)),
        boxes=tuple(Block.of(thing) for thing in experiment.solids),
        bodies=(
            *(
                robot_body(experiment, robot.tag, hardware.get(robot.tag), worn)
                for robot in experiment.robots
            ),
            *(
                Body(thing.tag, experiment.marker_height_m(thing.model), OBJECT, model=thing.model)
                for thing in experiment.objects
            ),
        ),
        family=experiment.marker.family,
        timestep_ns=experiment.timestep_ns,
        truth=truth,
        log=log,
        seed=seed,
        permille=round(clock.pace() * 1000),
    )


def robot_body(
    experiment: Experiment,
    tag: int,
    built: RobotHardware | None,
    worn: Mapping[int, int] = {},
) -> Body:
    """How a robot looks from above; for `built` and `worn` see `spec_for`."""
    model = experiment.models.get(tag, EPUCK)
    height_m = experiment.marker_height_m(model)
    return Body(worn.get(tag, tag), height_m, ROBOT, _marker(built), model)


def _marker(built: RobotHardware | None) -> tuple[float, float, float]:
    if built is None:
        return (0.0, 0.0, 0.0)
    return (built.marker.x_m, built.marker.y_m, built.marker.yaw_rad)
