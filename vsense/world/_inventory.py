"""Everything that stands in the world besides what has a marker, by id."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TypeVar

from vsense.base.errors import instead
from vsense.world.entities import (
    VIRTUAL_TAG_MIN,
    Box,
    Color,
    Cylinder,
    Entity,
    Light,
    VirtualRobot,
    WorldError,
    Zone,
    moved,
)

EntityKind = TypeVar("EntityKind", Box, Cylinder, Light, Zone, VirtualRobot)

ENTITY_TYPES = (Box, Cylinder, Light, Zone, VirtualRobot)


class _ById(dict[str, Entity]):
    def __missing__(self, name: object) -> Entity:
        raise KeyError(f"there is no {name!r} in the arena; {instead(str(name), self)}")


class Inventory:
    """Entities by id, in the order in which they were put; `version` grows with every change.

    `free_tag` is greater than that of every virtual robot since the start of the run: controllers
    and sensors go by tag, and shall not take one robot for another that is gone.

    What raises WorldError and why stands in `World`.
    """

    def __init__(self, entities: Iterable[Entity] = ()) -> None:
        """Takes what is there at the start; that may be physical."""
        self.version = 0
        self._entities = _ById()
        self._by_kind: dict[type, tuple[Entity, ...]] = {}
        self._versions = dict.fromkeys(ENTITY_TYPES, 0)
        self.free_tag = VIRTUAL_TAG_MIN
        for entity in entities:
            if entity.id in self._entities:
                raise WorldError(f"two things in the world are called {entity.id!r}")
            self._add(entity)
        self._first, self._first_tag = dict(self._entities), self.free_tag

    def reset(self) -> None:
        """Goes back to the start."""
        gone = self._entities.values()
        self._entities, self.free_tag = _ById(self._first), self._first_tag
        self._changed(*gone, *self._entities.values())

    def changed_since(self, version: int) -> set[type]:
        """The kinds of which some entity has changed after a version."""
        return {kind for kind, changed in self._versions.items() if changed > version}

    @property
    def entities(self) -> Mapping[str, Entity]:
        """A view of all of them by id."""
        return MappingProxyType(self._entities)

    def of(self, kind: type[EntityKind]) -> tuple[EntityKind, ...]:
        """All entities of one kind."""
        if kind not in self._by_kind:
            entities = tuple(e for e in self._entities.values() if isinstance(e, kind))
            self._by_kind[kind] = entities
        return self._by_kind[kind]  # type: ignore[return-value]

    def put(self, entity: object) -> None:
        """See `World.put`."""
        if not isinstance(entity, ENTITY_TYPES):
            names = ", ".join(kind.__name__ for kind in ENTITY_TYPES)
            raise WorldError(f"{entity!r:.60} cannot be put into the world, expected: {names}")
        _check_virtual(entity)
        _check_virtual(self._entities.get(entity.id))
        self._add(entity)

    def remove(self, name: str) -> None:
        """See `World.remove`."""
        _check_virtual(self.get(name))
        self.tear_down(name)

    def rebuild(self, entity: Entity) -> None:
        """See `World.rebuild`."""
        self._add(entity)

    def tear_down(self, name: str) -> None:
        """See `World.tear_down`."""
        gone = self.get(name)
        del self._entities[name]
        self._changed(gone)

    def move(self, name: str, x_m: float, y_m: float, yaw_rad: float | None) -> None:
        """See `World.move`."""
        _check_virtual(self.get(name))
        self._entities[name] = moved(self._entities[name], x_m, y_m, yaw_rad)
        self._changed(self._entities[name])

    def set_leds(self, name: str, colors: Sequence[Color]) -> None:
        """See `World.set_leds`."""
        thing = self.get(name)
        if not isinstance(thing, (Box, Cylinder)):
            raise WorldError(f"{name!r} is no box or cylinder: it has no LEDs")
        leds = thing.leds
        if len(colors) != len(leds):
            raise WorldError(f"{name!r} has {len(leds)} LEDs, and {len(colors)} colours came")
        lit = tuple(led._replace(color=color) for led, color in zip(leds, colors))
        self._entities[name] = replace(thing, leds=lit)
        self._changed(thing)

    def get(self, name: str) -> Entity:
        """The entity of an id; WorldError where there is none."""
        if name not in self._entities:
            raise WorldError(f"there is no {name!r} in the world; {instead(name, self._entities)}")
        return self._entities[name]

    def _add(self, entity: Entity) -> None:
        if isinstance(entity, VirtualRobot):
            twins = (e for e in self.of(VirtualRobot) if e.tag == entity.tag and e.id != entity.id)
            for twin in twins:
                raise WorldError(f"{entity.id!r} and {twin.id!r} have the same tag {entity.tag}")
            self.free_tag = max(self.free_tag, int(entity.tag) + 1)
        before = self._entities.get(entity.id, entity)
        self._entities[entity.id] = entity
        self._changed(before, entity)

    def _changed(self, *entities: Entity) -> None:
        self.version += 1
        for kind in ENTITY_TYPES:
            if any(isinstance(entity, kind) for entity in entities):
                self._versions[kind] = self.version
                self._by_kind.pop(kind, None)


def _check_virtual(entity: Entity | None) -> None:
    """Raises WorldError for what robots can drive against: only the experiment file places it."""
    if isinstance(entity, (Box, Cylinder)) and entity.physical:
        raise WorldError(f"{entity.id!r} stands in the real arena: the world cannot change it")
