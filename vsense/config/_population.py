"""Completes a file's robots: those that are added, tags, and which robot plays which part.

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
from itertools import accumulate, islice, pairwise

from vsense.base.errors import ConfigError, UsageError
from vsense.base.files import read_bytes
from vsense.base.xml.element import Document, Element
from vsense.config._robots import MAX_TAG, ArenaContents, add_crowd, add_robot
from vsense.config.casting import Casting, free_tags
from vsense.config.specs import LoopSpec, Stage
from vsense.vision.markers.families import known_families, load_family
from vsense.world.entities import Arena, WorldError
from vsense.world.loop_functions import LoopFunctions

HOOK = "populate"


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
            add_robot(robot, self._bodies)
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


def _grow(bodies: ArenaContents, count: int | None, file: str) -> None:
    """Adds robots until there are `count`: every `<distribute>` of real ones grows in proportion.

    Their numbers follow those that there are. None: nothing is added.

    Raises:
        UsageError: all robots have places of their own, or a `<distribute>` has no places for more.
    """
    missing = (count or 0) - len(bodies.robots)
    if missing <= 0:
        return
    error = f"{count} robots: {file} has {len(bodies.robots)}"
    crowds = list(bodies.robot_crowds)
    if not crowds:
        raise UsageError(
            f"{error}, all at places of their own: only robots of a <distribute> can be more"
        )
    ends = [0, *accumulate(crowd.quantity for crowd in crowds)]
    shares = [round(missing * end / ends[-1]) for end in ends]
    for crowd, more in zip(crowds, (b - a for a, b in pairwise(shares))):
        draw, wanted = crowd.distribution.position_m, crowd.quantity + more
        if not draw.is_random and wanted > (places := math.prod(draw.layout)):
            raise UsageError(
                f"{error}; line {crowd.entity.line} would have {wanted} for the {places} places of"
                f" its method {draw.method!r}; 'uniform' has as many as the floor"
            )
        if more:
            prefix = crowd.element.text("id")
            alike = [c for c in bodies.robot_crowds if c.element.text("id") == prefix]
            first = max(other.numbers.stop for other in alike)
            add_crowd(replace(crowd, quantity=more, first=first, untagged=True), bodies)


def cast(bodies: ArenaContents, family: str, casting: Casting, file: str) -> None:
    """Adds robots until there are as many as are wanted, gives everybody a tag of a marker family
    who has none, and puts robots in for others.

    A simulation has no cameras: once a family has none left, its robots get numbers beyond it. Of
    the tags of robots that were `added` only people with real robots have to know.

    Raises:
        ConfigError: roster or marker family have not so many; the message says who is left out.
        UsageError: a part is not there, or a robot that is put in has one, or is out of order; or
            the robots that are there cannot be more.
    """
    _grow(bodies, casting.limit, file)
    idle = _take_robots(bodies, casting)
    owned = (*casting.free, *(tag for tag, _ in casting.others))
    _give_tags(bodies, family, owned, idle)
    _put_in(bodies, casting)
    for robot in bodies.robots:
        if unfit := casting.unfit(robot.tag, robot.model.name):
            words = f"{robot.id!r}: {casting.roster} says that robot {robot.tag} {unfit}"
            raise ConfigError(file, robot.line, words)


def _take_robots(bodies: ArenaContents, casting: Casting) -> frozenset[str]:
    """Gives robots without a tag those of a roster; without one nothing is given.

    Returns:
        The robots without a tag that do not play, and need none of the roster's.

    Raises:
        ConfigError: the roster has not so many; the message says who is left out, and why.
    """
    if not casting.roster:
        return frozenset()
    models = {robot.id: robot.model.name for robot in bodies.robots}
    robots = models.keys()
    names = [name for _, group in bodies.untagged for name in group if name in robots]
    playing = [robot.id for robot in bodies.robots][: casting.limit]
    wanted = [name for name in playing if name in names]
    free = [tag for tag in casting.free if tag not in bodies.lines_of_tags]
    given = dict[str, int]()
    for name in wanted:
        fitting = (tag for tag in free if not casting.unfit(tag, models[name]))
        if (tag := next(fitting, None)) is not None:
            given[name] = tag
            free.remove(tag)
    if len(given) < len(wanted):
        element = next(e for e, group in bodies.untagged if robots & set(group))
        raise element.error(
            f"asks for {len(wanted)} robots, and {casting.roster} has {len(given)} for it"
            f"{_left_out(casting, bodies.lines_of_tags, free)}"
        )
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


def _left_out(casting: Casting, worn: Collection[int], free: Collection[int]) -> str:
    """Says who is not taken, and why; who is still `free` is of another model."""
    why = [f"{tag} {words}" for tag, words in casting.others]
    why += [f"{tag} has a part by its tag" for tag in casting.free if tag in worn]
    why += [f"{tag} is of the model {model}" for tag, model in casting.models if tag in free]
    return f": {'; '.join(why)}" if why else ""


def _give_tags(
    bodies: ArenaContents, family: str, owned: Collection[int] = (), idle: Collection[str] = ()
) -> None:
    """Gives a free tag of a marker family to every body without one in the file.

    Warns where real robots have to wear it.

    Nobody is given one that is `owned`: it is that of a robot. Of who is `idle` nothing is said.
    """
    names = [name for _, group in bodies.untagged for name in group]
    if not names:
        return
    worn = frozenset(bodies.lines_of_tags) | frozenset(owned)
    free = free_tags(family, len(names), worn)
    if bodies.stage is Stage.SIM:
        beyond = (tag for tag in range(load_family(family).tags, MAX_TAG + 1) if tag not in worn)
        free += islice(beyond, len(names) - len(free))
    if len(free) < len(names):
        raise bodies.untagged[-1][0].error(
            f"{len(names)} bodies have no tag, and the marker family {family!r} has {len(free)}"
            f" left for them{_larger(len(names) + len(worn))}"
        )
    given = dict(zip(names, free))
    for element, ids in bodies.untagged if bodies.stage is Stage.RUN else ():
        if not (group := [name for name in ids if name not in idle]):
            continue
        key = "vs:tags" if element.name == "entity" else "vs:tag"
        lacks = "has tags for the others only" if element.has(key) else "is missing"
        last = f" to {group[-1]!r}" if len(group) > 1 else ""
        element.warn(
            f"{key} {lacks}: {group[0]!r}{last} wear"
            f" {', '.join(str(given[name]) for name in group)}; a roster gives them others:"
            " vsense robot init"
        )
    bodies.robots[:] = [replace(r, tag=given.get(r.id, r.tag)) for r in bodies.robots]
    bodies.objects[:] = [replace(o, tag=given.get(o.id, o.tag)) for o in bodies.objects]


def _larger(count: int) -> str:
    """Names the marker families that have so many tags."""
    sizes = {name: load_family(name).tags for name in known_families()}
    words = " or ".join(f"{name} ({tags})" for name, tags in sizes.items() if tags >= count)
    return words and f"; --set marker.family=NAME takes a larger one: {words}"


def _put_in(bodies: ArenaContents, casting: Casting) -> None:
    """Has robots play the parts of others."""
    for pair in casting.replaced:
        out, new = pair
        playing = {robot.tag: robot.model.name for robot in bodies.robots}
        casting.check(f"--replace {out}={new}", pair, playing, bodies.tags.values())
        bodies.robots[:] = [replace(r, tag=new) if r.tag == out else r for r in bodies.robots]
        bodies.lines_of_tags[new] = bodies.lines_of_tags.pop(out)
