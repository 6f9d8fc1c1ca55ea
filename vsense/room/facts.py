"""What does not change while an experiment runs: the message /experiment."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import vsense
from vsense.config.specs import Experiment
from vsense.environment import Environment
from vsense.link.table import Direction
from vsense.room.messages import Data
from vsense.sensors.base import layout_dtype
from vsense.tracking.camera import Camera
from vsense.tracking.snapshot import as_they_hang
from vsense.tracking.troubles import Troubles
from vsense.world.entities import BODY_RADIUS_M


@dataclass(frozen=True, slots=True)
class Scene:
    """What is the same in all runs of one process.

    Attributes:
        command: "lab" or "run".
        file_text: the experiment's file.
        blind: the virtual sensors are held at 0.
        cameras: our own, in no order.
        trackers: name of each camera's tracker, by camera; without one the camera's own.
        troubles: what the cameras suffer from.
    """

    command: str
    file_text: str
    blind: bool
    cameras: Sequence[Camera]
    trackers: dict[str, str]
    troubles: Troubles


def experiment(scene: Scene, environment: Environment) -> Data:
    """Gives /experiment."""
    spec = environment.experiment
    arena = spec.arena
    return {
        "mode": "live",
        "command": scene.command,
        "name": spec.name,
        "seed": environment.seed,
        "blind": scene.blind,
        "version": vsense.__version__,
        "file_text": scene.file_text,
        "timestep_s": spec.timestep_s,
        "length_s": spec.length_s or None,
        "arena": {"size_m": list(arena.size_m), "centre_m": list(arena.centre_m)},
        "robots": [
            {"tag": robot.tag, "name": robot.id, "height_m": spec.marker.height_m}
            for robot in spec.robots
        ],
        "objects": [{"tag": thing.tag, "name": thing.id} for thing in spec.objects],
        "sensors": _sensors(spec),
        "actuators": [
            {"name": e.name, "layout": e.layout, "count": layout_dtype(e.layout)[0]}
            for e in environment.table_entries
            if e.direction == Direction.ACTUATOR
        ],
        "cameras": cameras(scene.cameras, scene.trackers),
        "body_radius_m": BODY_RADIUS_M,
    }


def _sensors(spec: Experiment) -> list[Data]:
    found = []
    for mounted in spec.sensors:
        sensor = mounted.sensor
        ring = getattr(sensor, "ring", None)
        angles = getattr(ring, "angles_rad", None)
        found.append(
            {
                "name": sensor.name,
                "layout": sensor.layout,
                "count": layout_dtype(sensor.layout)[0],
                "unit": getattr(sensor, "unit", None),
                "angles_rad": None if angles is None else angles.tolist(),
            }
        )
    return found


def cameras(found: Sequence[Camera], trackers: dict[str, str]) -> list[Data]:
    """Gives the cameras with their places in a grid as seen from above, +y up."""
    return [
        {
            "id": camera.id,
            "tracker": trackers.get(camera.id, camera.id),
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "position_m": list(camera.position_m),
            "row": row,
            "column": column,
            "model": json.loads(camera.to_json()),
        }
        for row, line in enumerate(as_they_hang(found))
        for column, camera in enumerate(line)
    ]
