"""Reads robots and tagged objects into what is in the arena."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from vsense.base.errors import ConfigError, UsageError
from vsense.base.native import lib
from vsense.base.xml.element import Element, shown
from vsense.config import argos, geofence
from vsense.config._distribute import OBJECT_ELEMENT, DistributedCrowd, DistributedSpec
from vsense.config._things import Media, read_place
from vsense.config.geofence import Geofence
from vsense.config.specs import (
    FieldSpec,
    FloorSpec,
    MarkerSpec,
    ObjectSpec,
    Pose,
    RobotSpec,
    Stage,
)
from vsense.vision.markers.families import load_family
from vsense.world.entities import VIRTUAL_TAG_MIN, Arena, Entity, VirtualRobot
from vsense.world.robot_models import EPUCK, RobotModel, model_of
from vsense.world.sensors.base import RobotSettings
from vsense.world.world import MESSAGE_MAX

MOST_MASS_RATIO = 100


@dataclass(slots=True)
class ArenaContents:
    """What is in the arena, while it is read.

    Attributes:
        folder: where files with relative paths are looked for.
        stage: what the experiment is loaded for.
        entities, distributed: what stands where the file says, and where the seed will say.
        objects: tagged things that are no robots.
        fields: quantities spread over the floor.
        controllers: by robot id the `<controller>` element that names what drives it.
        settings: by robot id those of its simulated devices.
        without_controller: by id the robots that nothing drives: objects, as in the thesis.
        crowds: how many `<distribute>` were read.
        robot_crowds: those of real robots.
        unseen: boxes and cylinders that only virtual sensors notice.
        untagged: elements of bodies without a tag, with the bodies' ids.
        taken: tags that were taken out of a roster.
        lines, lines_of_tags: by id or tag the line of its element.
    """

    arena: Arena
    folder: Path
    media: Media
    timestep_s: float
    stage: Stage
    entities: list[Entity] = field(default_factory=list)
    distributed: list[DistributedSpec] = field(default_factory=list)
    robots: list[RobotSpec] = field(default_factory=list)
    objects: list[ObjectSpec] = field(default_factory=list)
    floor: FloorSpec | None = None
    fields: list[FieldSpec] = field(default_factory=list)
    controllers: dict[str, Element] = field(default_factory=dict)
    without_controller: dict[str, Element] = field(default_factory=dict)
    settings: dict[str, RobotSettings] = field(default_factory=dict)
    crowds: int = 0
    robot_crowds: list[DistributedCrowd] = field(default_factory=list)
    unseen: list[Element] = field(default_factory=list)
    untagged: list[tuple[Element, list[str]]] = field(default_factory=list)
    taken: list[int] = field(default_factory=list)
    lines: dict[str, int] = field(default_factory=dict)
    lines_of_tags: dict[int, int] = field(default_factory=dict)

    @property
    def tags(self) -> dict[str, int]:
        """Markers of all tagged things by id."""
        bodies: list[RobotSpec | ObjectSpec] = [*self.robots, *self.objects]
        return {body.id: body.tag for body in bodies}

    @property
    def everything(self) -> dict[str, Entity]:
        """All entities by id; the places of the distributed ones are not known yet."""
        entities = [*self.entities, *(spec.entity for spec in self.distributed)]
        return {entity.id: entity for entity in entities}

    def read_geofence(
        self, arena: Element, simulated: bool, replaced: Iterable[tuple[int, int]]
    ) -> Geofence | None:
        """Reads the fence of all that is here; see `geofence.read_geofence`."""
        fastest_m_s = max(robot.model.v_max_m_s for robot in self.robots)
        return geofence.read_geofence(
            arena, self.arena, self.tags, simulated, replaced, fastest_m_s
        )

    def claim_id(self, element: Element, name: str) -> None:
        """Notes an id, which must be printable and no other element's."""
        if not name.isprintable():
            raise element.error(f"{name!r} holds a character that is not printable", "id")
        if name in self.lines:
            line = self.lines[name]
            raise element.error(f"{name!r} is the id of another element, in line {line}", "id")
        self.lines[name] = element.line

    def claim_tag(self, element: Element, attribute: str, tag: int) -> None:
        """Notes a tag, which no other thing may wear."""
        if tag in self.lines_of_tags:
            line = self.lines_of_tags[tag]
            raise element.error(f"tag {tag} is worn by another one, in line {line}", attribute)
        self.lines_of_tags[tag] = element.line

    def next_virtual_tag(self) -> int:
        there = self.everything.values()
        return VIRTUAL_TAG_MIN + sum(isinstance(entity, VirtualRobot) for entity in there)


MAX_TAG = 65_535

_ID = re.compile(r"(.+)_([0-9]{1,9})_([0-9]{1,9})")
_NO_TAG = -1
"""Stands in for the tag of a body until it is given one."""
_MAX_RAB_BYTES = 10_000


def add_robot(element: Element, bodies: ArenaContents) -> None:
    """Reads one of `argos.ROBOTS`: a real robot, a virtual one, without a controller an object."""
    _pass_over(element)
    if element.boolean("vs:virtual", False):
        _add_virtual(element, bodies)
        return
    controller = element.optional_child("controller")
    if controller is None:
        bodies.without_controller[add_object(element, bodies)] = element
        return
    name, tag, number = _read_identity(element, bodies)
    _check_name(element, name)
    pose = _read_pose(element, bodies)
    number = len(bodies.robots) if number is None else number
    model = _read_model(element, bodies)
    config = _name_controller(element, controller, name, model, bodies)
    bodies.robots.append(RobotSpec(name, tag, number, pose, None, config, element.line, model))


def _read_model(element: Element, bodies: ArenaContents) -> RobotModel:
    """Reads which kind of robot it is, or how large an object is."""
    try:
        usual = argos.ROBOTS.get(element.name, EPUCK.name)
        return model_of(element.text("vs:model", usual), bodies.folder)
    except UsageError as error:
        raise element.error(str(error), "vs:model") from None


def _check_masses(arena: Element, bodies: ArenaContents) -> None:
    """Refuses bodies whose masses differ too much: contacts of the heavy ones would not be resolved
    where light ones touch each other."""
    there: list[RobotSpec | ObjectSpec | VirtualRobot] = [*bodies.robots, *bodies.objects]
    there += [thing for thing in bodies.everything.values() if isinstance(thing, VirtualRobot)]
    by_mass = sorted((body.model.mass_kg, body.model.name) for body in there)
    (least_kg, light), (most_kg, heavy) = by_mass[0], by_mass[-1]
    if most_kg > MOST_MASS_RATIO * least_kg:
        words = f"{light} has {least_kg:g} kg in this arena, and {heavy} {most_kg:g} kg"
        raise arena.error(f"{words}: expected at most {MOST_MASS_RATIO} times as much")


def check_models(controller: Element, robots: Sequence[str], bodies: ArenaContents) -> None:
    """Refuses a controller whose `robots` are of several models: their sensors differ."""
    models = {bodies.settings[robot].model.name for robot in robots}
    if len(models) > 1:
        words = f"drives robots of the models {' and '.join(sorted(models))}"
        raise controller.error(f"{words}: each needs a controller of its own")


def _pass_over(element: Element) -> None:
    """Passes over what only a simulated robot has."""
    argos.pass_over(element, argos.EPUCK_SETTINGS)
    for name, instead in argos.EPUCK_PARTS.items():
        for child in element.children(name):
            child.leave_out(instead)


def _read_settings(element: Element, model: RobotModel) -> RobotSettings:
    """Reads what a robot's element says of its simulated devices."""
    usual = RobotSettings.of(model)
    aperture_deg = math.degrees(usual.aperture_rad)
    size = element.integer("rab_data_size", 1, _MAX_RAB_BYTES, usual.message_bytes)
    if size > MESSAGE_MAX:
        element.warn(
            f"rab_data_size is {size}: messages of <range_and_bearing> end at {MESSAGE_MAX}"
        )
    return RobotSettings(
        model,
        rab_range_m=element.number("rab_range", 0.001, 1000.0, "m", usual.rab_range_m),
        message_bytes=min(size, MESSAGE_MAX),
        aperture_rad=element.angle("omnidirectional_camera_aperture", 0.1, 89.999, aperture_deg),
    )


def add_object(element: Element, bodies: ArenaContents) -> str:
    """Reads a thing with a marker on it that is no robot; gives its id."""
    name, tag, _ = _read_identity(element, bodies)
    pose, model = _read_pose(element, bodies), _read_model(element, bodies)
    bodies.objects.append(ObjectSpec(name, tag, pose, None, element.line, model))
    return name


def add_crowd(crowd: DistributedCrowd, bodies: ArenaContents) -> None:
    """Adds the robots or objects of an `<entity>`.

    With vs:tags they are called NAME_TAG_NUMBER, with numbers from base_num; without, NAME and the
    number, as in ARGoS.
    """
    element = crowd.element
    prefix = element.text("id")
    is_robot = element.name != OBJECT_ELEMENT
    if is_robot:
        _pass_over(element)
        if element.boolean("vs:virtual", False):
            _add_virtual_crowd(crowd, prefix, bodies)
            return
    controller = element.child("controller") if is_robot else None
    model = _read_model(element, bodies)
    untagged: list[str] = []
    for number, tag in zip(crowd.numbers, _read_tags(crowd, bodies), strict=True):
        name = f"{prefix}{number}" if tag == _NO_TAG else f"{prefix}_{tag}_{number}"
        bodies.claim_id(element, name)
        untagged += [name] if tag == _NO_TAG else []
        line, drawn = element.line, crowd.distribution
        if controller is None:
            bodies.objects.append(ObjectSpec(name, tag, None, drawn, line, model))
            continue
        _check_name(element, name)
        config = _name_controller(element, controller, name, model, bodies)
        bodies.robots.append(RobotSpec(name, tag, number, None, drawn, config, line, model))
    if untagged:
        bodies.untagged.append((crowd.entity, untagged))
    if controller is not None:
        bodies.robot_crowds.append(crowd)


def _add_virtual(element: Element, bodies: ArenaContents) -> None:
    name = element.text("id")
    bodies.claim_id(element, name)
    model = _read_model(element, bodies)
    driver = _driver(element, name, model, bodies)
    pose = _read_pose(element, bodies)
    bodies.entities.append(VirtualRobot(name, bodies.next_virtual_tag(), *pose, driver, model))


def _add_virtual_crowd(crowd: DistributedCrowd, prefix: str, bodies: ArenaContents) -> None:
    element, model = crowd.element, _read_model(crowd.element, bodies)
    for number in crowd.numbers:
        name = f"{prefix}{number}"
        bodies.claim_id(element, name)
        driver = _driver(element, name, model, bodies)
        robot = VirtualRobot(name, bodies.next_virtual_tag(), 0.0, 0.0, 0.0, driver, model)
        bodies.distributed.append(DistributedSpec(robot, crowd.distribution, element.line))


def _driver(element: Element, name: str, model: RobotModel, bodies: ArenaContents) -> str:
    """The id of the controller that drives a virtual robot; "": loop functions move it."""
    controller = element.optional_child("controller")
    if controller is None:
        return ""
    return _name_controller(element, controller, name, model, bodies)


def _name_controller(
    element: Element, controller: Element, name: str, model: RobotModel, bodies: ArenaContents
) -> str:
    """Notes the `<controller>` of a robot, and its settings; gives the id that it names."""
    bodies.controllers[name] = controller
    bodies.settings[name] = _read_settings(element, model)
    return controller.text("config")


def _read_identity(element: Element, bodies: ArenaContents) -> tuple[str, int, int | None]:
    """Reads an id of the form NAME_TAG_ROBOT, or another one and the tag from vs:tag.

    Gives the id, the tag or _NO_TAG, and the robot's number or None.
    """
    name = element.text("id")
    bodies.claim_id(element, name)
    match = _ID.fullmatch(name)
    tag, number = (int(match[2]), int(match[3])) if match else (_NO_TAG, None)
    if tag > MAX_TAG or (number or 0) > MAX_TAG:
        raise element.error(f"{name!r}: expected tag and number from 0 to {MAX_TAG}", "id")
    if element.has("vs:tag"):
        said = element.integer("vs:tag", 0, MAX_TAG)
        if tag not in (said, _NO_TAG):
            raise element.error(f"is {said}, but the id {name!r} says {tag}", "vs:tag")
        tag = said
    if tag == _NO_TAG:
        bodies.untagged.append((element, [name]))
    else:
        bodies.claim_tag(element, "vs:tag" if match is None else "id", tag)
    return name, tag, number


def _read_tags(crowd: DistributedCrowd, bodies: ArenaContents) -> list[int]:
    entity, quantity = crowd.entity, crowd.quantity
    if not entity.has("vs:tags") or crowd.untagged:
        return [_NO_TAG] * quantity
    tags = entity.integers("vs:tags", 0, MAX_TAG)
    if entity.is_set("quantity") and not entity.is_set("vs:tags"):
        # The file's tags are for the file's quantity: those that there are go to the first robots.
        tags = [*tags[:quantity], *[_NO_TAG] * (quantity - len(tags))]
    if len(tags) != quantity:
        expected = f"expected {quantity} as in quantity"
        text = shown(entity.text("vs:tags"))
        raise entity.error(f"{text} has {len(tags)} tags, {expected}", "vs:tags")
    for tag in tags:
        if tag != _NO_TAG:
            bodies.claim_tag(entity, "vs:tags", tag)
    return tags


def _check_name(element: Element, name: str) -> None:
    """Refuses an id that a robot cannot give when it greets the host."""
    size = len(name.encode())
    if size > lib.VS_NAME_MAX:
        raise element.error(f"{name!r} has {size} bytes, expected at most {lib.VS_NAME_MAX}", "id")


def _read_pose(element: Element, bodies: ArenaContents) -> Pose:
    body = element.child("body")
    place = read_place(body, bodies.arena)
    x_m, y_m, z_m = place.position_m
    if z_m != 0.0:
        raise body.error(f"z is {z_m:g}, expected 0: it stands on the floor", "position")
    return Pose(x_m, y_m, place.yaw_rad)


def check_bodies(arena: Element, bodies: ArenaContents, marker: MarkerSpec) -> None:
    """Refuses masses that do not go together, and tags that the family does not have; warns of
    models whose markers sit elsewhere."""
    _check_masses(arena, bodies)
    document = arena.document
    tags = load_family(marker.family).tags
    tagged: list[RobotSpec | ObjectSpec] = [*bodies.robots, *bodies.objects]
    for body in tagged:
        if body.tag >= tags and body.tag in bodies.lines_of_tags:
            range_text = f"the marker family {marker.family!r} has tags 0 to {tags - 1}"
            raise ConfigError(document.file, body.line, f"{body.id!r}: {range_text}")
    for model in {body.model for body in tagged} if marker.is_said else ():
        if model != EPUCK and model.marker_height_m != marker.height_m:
            words = f"height={marker.height_m:g} counts for all; that of {model.name} would be"
            line = f"<vs:marker> {words} {model.marker_height_m:g} m"
            document.passed_over.append((marker.line, line))
