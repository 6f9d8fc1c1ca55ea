"""What is in the arena, gathered while `<arena>` is read: everything with an id or a tag."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from vsense.config.draws import DistributedSpec
from vsense.config.element import Element
from vsense.config.media import Media
from vsense.config.specs import FieldSpec, FloorSpec, ObjectSpec, RobotSpec
from vsense.world.entities import VIRTUAL_TAG_MIN, Arena, Entity, VirtualRobot


@dataclass(slots=True)
class Bodies:
    """What is in the arena, while it is read.

    Attributes:
        arena: the arena.
        folder: where files with relative paths are looked for.
        media: what lights may refer to.
        timestep_s: length of a timestep.
        entities: what stands at a place that the file says.
        distributed: what stands at a place that the seed will say.
        robots: the real robots.
        objects: tagged things that are no robots.
        floor: the floor, None: not said.
        fields: quantities spread over it.
        controllers: by robot id the `<controller>` element that names what drives it.
        without_controller: by id the e-pucks that nothing drives: objects, as in the thesis.
        crowds: how many `<distribute>` were read.
        unseen: boxes and cylinders that only virtual sensors feel.
        untagged: elements of bodies whose tag nobody says, with the bodies' ids.
        lines: by id the line of its element.
    """

    arena: Arena
    folder: Path
    media: Media
    timestep_s: float
    entities: list[Entity] = field(default_factory=list)
    distributed: list[DistributedSpec] = field(default_factory=list)
    robots: list[RobotSpec] = field(default_factory=list)
    objects: list[ObjectSpec] = field(default_factory=list)
    floor: FloorSpec | None = None
    fields: list[FieldSpec] = field(default_factory=list)
    controllers: dict[str, Element] = field(default_factory=dict)
    without_controller: dict[str, Element] = field(default_factory=dict)
    crowds: int = 0
    unseen: list[Element] = field(default_factory=list)
    untagged: list[tuple[Element, list[str]]] = field(default_factory=list)
    lines: dict[str, int] = field(default_factory=dict)
    _lines_of_tags: dict[int, int] = field(default_factory=dict)

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

    def claim_id(self, element: Element, name: str) -> None:
        """Notes an id.

        Raises:
            ConfigError: another element has it, or it does not fit one line.
        """
        if not name.isprintable():
            raise element.error(f"{name!r} holds a character that is not printable", "id")
        if name in self.lines:
            line = self.lines[name]
            raise element.error(f"{name!r} is the id of another element, in line {line}", "id")
        self.lines[name] = element.line

    def claim_tag(self, element: Element, attribute: str, tag: int) -> None:
        """Notes a tag.

        Raises:
            ConfigError: another thing wears it.
        """
        if tag in self._lines_of_tags:
            line = self._lines_of_tags[tag]
            raise element.error(f"tag {tag} is worn by another one, in line {line}", attribute)
        self._lines_of_tags[tag] = element.line

    @property
    def worn(self) -> frozenset[int]:
        """The tags that the file gives."""
        return frozenset(self._lines_of_tags)

    def next_virtual_tag(self) -> int:
        """Gives a tag for another virtual robot."""
        there = [*self.entities, *(spec.entity for spec in self.distributed)]
        return VIRTUAL_TAG_MIN + sum(isinstance(entity, VirtualRobot) for entity in there)
