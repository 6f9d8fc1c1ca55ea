"""The data of messages, made from the run's state; `MESSAGES.md` describes every topic.

Arrays become columns; what is no number is null.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import fields as fields_of

import cv2
import numpy as np

import vsense
from vsense.config.specs import ControllerSpec, Experiment, ObjectSpec, RobotSpec
from vsense.monitor.pictures._views import as_they_hang
from vsense.monitor.recording.form import PART_COLUMNS, Data, ExperimentMessage
from vsense.robots.link.table import Direction, Entry
from vsense.run.environment import Environment, Equipment
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import Troubles
from vsense.world.actuators.messages import MessagesActuator
from vsense.world.entities import Entity, VirtualRobot
from vsense.world.fields import Field, Floor
from vsense.world.robot_models import EPUCK, WHEELS
from vsense.world.sensors.base import VirtualSensor, layout_dtype
from vsense.world.sensors.range_and_bearing import RangeAndBearingSensor
from vsense.world.world import World

ENTITY_KINDS = {
    "Box": "box", "Cylinder": "cylinder", "Light": "light", "Zone": "zone", "VirtualRobot": "robot",
}  # fmt: skip

MOST_FIELD_CELLS = 160
"""A field is shown with at most so many columns and rows."""

MOST_FLOOR_PX = 1024
"""A floor's picture is shown with at most so many columns and rows."""


def world(world: World) -> Data:
    """Gives /world: all virtual things and the floor."""
    floor = world.floor.with_zones(())
    return {"entities": [entity(e) for e in world.entities.values()], "floor": floor_data(floor)}


def entity(thing: Entity) -> Data:
    """One entity: its kind and its fields; of a robot's model its name and the body."""
    data: Data = {"kind": ENTITY_KINDS[type(thing).__name__]}
    for field in fields_of(thing):
        value = getattr(thing, field.name)
        data[field.name] = list(value) if isinstance(value, tuple) else value
    if isinstance(thing, VirtualRobot):
        model = thing.model
        data |= {"model": model.name, "radius_m": model.radius_m, "height_m": model.height_m}
    return data


def floor_data(floor: Floor) -> Data:
    """The floor without its zones, its picture as PNG."""
    png = None
    image = floor.picture(MOST_FLOOR_PX)
    if image is not None:
        encoded = cv2.imencode(".png", image[..., [2, 1, 0, 3][: image.shape[2]]])[1]
        png = base64.b64encode(encoded.tobytes()).decode()
    return {
        "color": list(floor.color),
        "size_m": list(floor.size_m),
        "centre_m": list(floor.centre_m),
        "png": png,
    }


def signals(world: World) -> Data:
    """Gives /signals: what the world shows and measures in this timestep."""
    lit = np.flatnonzero(world.leds.any(axis=1))
    cones = (world.cone(source) for source in world.sources)
    return {
        "timestep": world.run_timestep,
        "time_s": world.time_s,
        "leds": {"tag": world.robots["tag"][lit].tolist(), "color": world.leds[lit].tolist()},
        "cones": [dict(zip(("x_m", "y_m"), c.vertices().T.tolist())) for c in cones if c],
        "measures": {name: finite(value) for name, value in world.results.items()},
    }


def fields(grids: Iterable[Field]) -> Data:
    """Gives /fields: concentrations as shares of the highest, at display resolution."""
    return {"fields": [_field(grid) for grid in grids]}


def _field(grid: Field) -> Data:
    rows, cols = grid.concentration.shape
    step = -(-max(rows, cols) // MOST_FIELD_CELLS)
    shown = grid.concentration[::step, ::step]
    peak = float(shown.max())
    levels = np.round(shown * (255.0 / peak)) if peak > 0.0 else np.zeros(shown.shape)
    return {
        "id": grid.id,
        "corner_m": grid.corner_m.tolist(),
        "cell_m": grid.cell_m * step,
        "columns": shown.shape[1],
        "rows": shown.shape[0],
        "peak": peak,
        "levels": base64.b64encode(levels.astype(np.uint8).tobytes()).decode(),
    }


def numbers(entries: Sequence[Entry], payload: bytes) -> list[list[float]]:
    """A robot's actuators as numbers, one list for each."""
    columns, begin = [], 0
    for entry in entries:
        count, kind = layout_dtype(entry.layout)
        end = begin + count * kind.itemsize
        columns.append(np.frombuffer(payload[begin:end], kind).tolist())
        begin = end
    return columns


def finite(value: float) -> float | None:
    """A number for JSON."""
    return float(value) if math.isfinite(value) else None


@dataclass(frozen=True, slots=True)
class ExperimentFacts:
    """What is the same in all runs of one process.

    Attributes:
        command: "sim", "lab" or "run".
        file_text: the experiment's file.
        blind: the virtual sensors are held at 0.
        cameras: our own, in no order.
        trackers: name of each camera's tracker, by camera; without one the camera's own.
        troubles: of the cameras.
        made: see `vsense.modes.live.session.RunSetup`.
        mode: of the page, see `MESSAGES.md`.
        recorded: the cameras are recordings.
        user: whose run it is; None: nobody else can steer it.
        masks: see `cameras`.
        calibration: what is known of the cameras' calibration, see
            `vsense.vision.calibration.checked`.
        homes: robots drive to their starts before each run.
    """

    command: str
    file_text: str
    blind: bool
    cameras: Sequence[Camera]
    trackers: dict[str, str]
    troubles: Troubles
    made: Data = dataclasses.field(default_factory=dict)
    mode: str = "live"
    recorded: bool = False
    user: str | None = None
    masks: Mapping[str, object] | None = None
    calibration: Data | None = None
    homes: bool = False


def experiment(facts: ExperimentFacts, environment: Environment) -> Data:
    """Gives /experiment."""
    spec = environment.experiment
    arena = spec.arena
    return ExperimentMessage(
        mode=facts.mode,
        command=facts.command,
        user=facts.user,
        recorded=facts.recorded,
        name=spec.name,
        seed=environment.seed,
        blind=facts.blind,
        homes=facts.homes,
        version=vsense.__version__,
        file_text=facts.file_text,
        made=_setup_of(facts, spec),
        timestep_s=spec.timestep_s,
        length_s=spec.length_s or None,
        arena={
            "size_m": list(arena.size_m),
            "centre_m": list(arena.centre_m),
            **_fence(facts, spec),
        },
        robots=[
            _body(robot)
            | {"height_m": spec.marker_height_m(robot.model), "model": robot.model.name}
            | {name: getattr(robot.model, name) for name in WHEELS}
            | _driven(facts, spec, robot.tag)
            for robot in spec.robots
        ],
        objects=[_body(thing) for thing in spec.objects],
        controllers=[_controller(*which) for which in zip(spec.controllers, environment.equipment)],
        cameras=cameras(facts.cameras, facts.trackers, facts.masks),
        calibration=facts.calibration,
        body_radius_m=EPUCK.radius_m,
        body_height_m=EPUCK.height_m,
    ).data()


def _body(body: RobotSpec | ObjectSpec) -> Data:
    return {"tag": body.tag, "name": body.id, "radius_m": body.model.radius_m}


def _driven(facts: ExperimentFacts, spec: Experiment, tag: int) -> Data:
    """That a robot has no board, where that decides what stops it."""
    return {"driven_here": True} if facts.command == "run" and tag in spec.casting.here else {}


def _fence(facts: ExperimentFacts, spec: Experiment) -> Data:
    """The fence that the experiment's file names, where robots stand for it."""
    fence = spec.geofence
    if fence is None or facts.command == "sim":
        return {}
    tags = spec.tags
    keep_off = [
        {"tag": tags[id], "distance_m": m} for id, m in fence.keep_off.items() if id in tags
    ]
    return {
        "fence": {
            "boundary": fence.boundary.corners,
            "forbidden": [polygon.corners for polygon in fence.forbidden],
            "keep_off": keep_off,
        }
    }


def parts(rows: Sequence[Data], run: int, timestep: int) -> Data:
    """Gives /parts, of rows of `vsense.run.cast.played`."""
    return {
        "run": run,
        "timestep": timestep,
        **{name: [row[name] for row in rows] for name in PART_COLUMNS},
    }


def _setup_of(facts: ExperimentFacts, spec: Experiment) -> Data:
    """How the experiment was read; with its robots, where they do not follow from its file."""
    casting = spec.casting
    if not facts.made or not (casting.roster or casting.replaced or casting.limit):
        return facts.made
    return {**facts.made, "casting": dataclasses.asdict(casting)}


def _controller(spec: ControllerSpec, equipment: Equipment) -> Data:
    actuators = (mounted.actuator for mounted in spec.actuators)
    said_m = [a.range_m for a in actuators if isinstance(a, MessagesActuator)]
    return {
        "id": spec.id,
        "library": spec.library,
        "tags": list(equipment.tags),
        "sensors": [_sensor(mounted.sensor) for mounted in spec.sensors],
        "actuators": [
            {"name": e.name, "layout": e.layout, "count": layout_dtype(e.layout)[0]}
            for e in equipment.table.entries
            if e.direction == Direction.ACTUATOR
        ],
        "said_range_m": next((said for said in said_m if said > 0.0), None),
    }


def _sensor(sensor: VirtualSensor) -> Data:
    angles_rad = getattr(getattr(sensor, "ring", None), "angles_rad", None)
    return {
        "name": sensor.name,
        "layout": sensor.layout,
        "count": layout_dtype(sensor.layout)[0],
        "angles_rad": None if angles_rad is None else angles_rad.tolist(),
        **(_hearing(sensor) if isinstance(sensor, RangeAndBearingSensor) else {}),
    }


def _hearing(sensor: RangeAndBearingSensor) -> Data:
    """Whom a sensor hears, and how many of them: without these its numbers say nothing."""
    reach = sensor.reach
    facts = {"range_m": reach.range_m, "view_rad": reach.field_of_view_rad}
    return {**facts, "max_messages": sensor.max_messages}


def cameras(
    models: Sequence[Camera], trackers: dict[str, str], masks: Mapping[str, object] | None = None
) -> list[Data]:
    """Gives the cameras with their places in a grid as seen from above, +y up.

    `masks` are, by camera, the polygons in its picture [px] in which markers are looked for.
    """
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
            **({"mask_px": masks[camera.id]} if masks else {}),
        }
        for row, line in enumerate(as_they_hang(models))
        for column, camera in enumerate(line)
    ]
