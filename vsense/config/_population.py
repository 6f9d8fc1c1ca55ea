"""Completes a file's robots: those that loop functions add, tags, and who plays which part.

A hook `populate(space)` of the experiment's loop functions in Python is called while the file is
read. It takes the place of ARGoS's C++ loop functions that add e-pucks to the space in Init:

    def populate(space):
        for i in range(20):
            space.add_robot(f"ep{i}", "automode", space.random.uniform(-1, 1), 0.1 * i - 1)

Robots that overlap are placed anew, as those of the file (`vsense.config.placement`).
"""

from __future__ import annotations

import math
import random
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from itertools import islice

from vsense.base.errors import ConfigError
from vsense.base.files import read_bytes
from vsense.base.xml.element import Document, Element
from vsense.config._robots import ArenaContents, add_epuck
from vsense.config.casting import Casting
from vsense.config.specs import LoopSpec
from vsense.vision.markers.families import load_family, ranked_tags
from vsense.world.entities import Arena, WorldError
from vsense.world.loop_functions import LoopFunctions

HOOK = "populate"

_MOST_CHOSEN = 128
"""Choosing takes about 10 ms a tag; the robots of larger swarms wear whatever is free."""


class Space:
    """What `populate` may do.

    Attributes:
        arena: where the robots stand.
        params: the settings of the loop functions.
        random: to draw from; the file's seed decides.
    """

    def __init__(
        self, document: Document, spec: LoopSpec, bodies: ArenaContents, seed: int
    ) -> None:
        self.arena: Arena = bodies.arena
        self.params: Mapping[str, str] = dict(spec.params)
        self.random = random.Random(seed)
        self._document, self._line, self._bodies = document, spec.line, bodies

    def add_robot(
        self, name: str, controller: str, x_m: float, y_m: float, yaw_rad: float = 0.0
    ) -> None:
        """Adds an e-puck with the id `name`, driven by the controller of that id.

        Raises:
            WorldError: there is another thing with this id, or no such place.
        """
        robot = self._element("e-puck", id=str(name))
        place = f"{float(x_m)!r},{float(y_m)!r},0"
        turn = math.degrees(math.remainder(float(yaw_rad), 2.0 * math.pi))
        robot.append(self._element("body", position=place, orientation=f"{turn!r},0,0"))
        robot.append(self._element("controller", config=str(controller)))
        try:
            add_epuck(robot, self._bodies)
        except ConfigError as error:
            raise WorldError(error.message) from None

    def _element(self, name: str, **attributes: str) -> Element:
        return Element(self._document, name, self._line, attributes)


def populate(document: Document, spec: LoopSpec | None, bodies: ArenaContents, seed: int) -> None:
    """Calls the hook of loop functions that have one, if there are any.

    Raises:
        LoopFunctionsError: their file cannot be run, or the hook failed.
    """
    if spec is None or spec.program is not None:
        return
    if HOOK in read_bytes(spec.path).decode(errors="replace"):
        hooks = LoopFunctions(spec.path, spec.label, spec.params)
        hooks.populate(Space(document, spec, bodies, seed))


def cast(bodies: ArenaContents, family: str, casting: Casting) -> None:
    """Gives everybody a tag of a marker family who has none, and puts robots in for others.

    Raises:
        ConfigError: roster or marker family have not so many; the message says who is left out.
        UsageError: a part is not there, or a robot that is put in has one, or is out of order.
    """
    idle = _take_robots(bodies, casting)
    owned = (*casting.free, *(tag for tag, _ in casting.others))
    _give_tags(bodies, family, owned, idle)
    _put_in(bodies, casting)


def _take_robots(bodies: ArenaContents, casting: Casting) -> frozenset[str]:
    """Gives robots without a tag those of a roster; without one nothing is given.

    Returns:
        The robots without a tag that do not play, and need none of the roster's.

    Raises:
        ConfigError: the roster has not so many; the message says who is left out, and why.
    """
    if not casting.roster:
        return frozenset()
    robots = {robot.id for robot in bodies.robots}
    names = [name for _, group in bodies.untagged for name in group if name in robots]
    playing = [robot.id for robot in bodies.robots][: casting.limit]
    wanted = [name for name in playing if name in names]
    free = [tag for tag in casting.free if tag not in bodies.lines_of_tags]
    if len(free) < len(wanted):
        element = next(e for e, group in bodies.untagged if robots & set(group))
        raise element.error(
            f"asks for {len(wanted)} robots, and {casting.roster} has {len(free)} for it"
            f"{_left_out(casting, bodies.lines_of_tags)}"
        )
    given = dict(zip(wanted, free))
    bodies.taken.extend(given.values())
    bodies.robots[:] = [replace(r, tag=given.get(r.id, r.tag)) for r in bodies.robots]
    for name, tag in given.items():
        bodies.lines_of_tags[tag] = bodies.lines[name]
    bodies.untagged[:] = [
        (element, rest)
        for element, group in bodies.untagged
        if (rest := [name for name in group if name not in given])
    ]
    return frozenset(names) - given.keys()


def _left_out(casting: Casting, worn: Collection[int]) -> str:
    """Says who is not taken, and why."""
    why = [f"{tag} {words}" for tag, words in casting.others]
    why += [f"{tag} has a part by its tag" for tag in casting.free if tag in worn]
    return f": {'; '.join(why)}" if why else ""


def _give_tags(
    bodies: ArenaContents, family: str, owned: Collection[int] = (), idle: Collection[str] = ()
) -> None:
    """Gives a free tag of a marker family to every body without one in the file, and warns.

    Nobody is given one that is `owned`: it is that of a robot. Of who is `idle` nothing is said.
    """
    names = [name for _, group in bodies.untagged for name in group]
    if not names:
        return
    free = _free_tags(family, len(names), frozenset(bodies.lines_of_tags) | frozenset(owned))
    if len(free) < len(names):
        element = bodies.untagged[-1][0]
        raise element.error(f"has no tag, and the marker family {family!r} has none left for it")
    given = dict(zip(names, free))
    for element, ids in bodies.untagged:
        if not (group := [name for name in ids if name not in idle]):
            continue
        key = "vs:tags" if element.name == "entity" else "vs:tag"
        last = f" to {group[-1]!r}" if len(group) > 1 else ""
        element.warn(
            f"{key} is missing: {group[0]!r}{last} wear"
            f" {', '.join(str(given[name]) for name in group)}"
        )
    bodies.robots[:] = [replace(r, tag=given.get(r.id, r.tag)) for r in bodies.robots]
    bodies.objects[:] = [replace(o, tag=given.get(o.id, o.tag)) for o in bodies.objects]


def _free_tags(family: str, count: int, worn: frozenset[int]) -> list[int]:
    """Chooses free tags, those of `vsense markers --ids auto:N` first.

    Another robot at the end of a file leaves the others theirs.
    """
    chosen = _well_apart(family, min(count + len(worn), _MOST_CHOSEN))
    taken = worn | set(chosen)
    rest = (tag for tag in range(load_family(family).tags) if tag not in taken)
    free = [tag for tag in chosen if tag not in worn][:count]
    return [*free, *islice(rest, count - len(free))]


@cache
def _well_apart(family: str, count: int) -> tuple[int, ...]:
    """See `ranked_tags`; all that there are of a family that has not so many."""
    markers = load_family(family)
    return tuple(ranked_tags(markers, min(count, markers.tags)))


def _put_in(bodies: ArenaContents, casting: Casting) -> None:
    """Has robots play the parts of others."""
    for pair in casting.replaced:
        out, new = pair
        playing = [robot.tag for robot in bodies.robots]
        casting.check(f"--replace {out}={new}", pair, playing, bodies.tags.values())
        bodies.robots[:] = [replace(r, tag=new) if r.tag == out else r for r in bodies.robots]
        bodies.lines_of_tags[new] = bodies.lines_of_tags.pop(out)
