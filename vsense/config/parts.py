"""Gives the parts of an experiment, while it is read, to the robots of its `Casting`."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace

from vsense.base.errors import UsageError
from vsense.config.casting import Casting, Pair
from vsense.config.robots import ArenaContents, give_tags
from vsense.config.roster import SPARE
from vsense.config.specs import Experiment, RobotSpec


def cast(bodies: ArenaContents, family: str, casting: Casting) -> None:
    """Gives everybody a tag of a marker family who has none, and puts robots in for others.

    Raises:
        ConfigError, UsageError: as `take_robots`, `give_tags` and `put_in`.
    """
    idle = take_robots(bodies, casting)
    owned = (*casting.free, *(tag for tag, _ in casting.others))
    give_tags(bodies, family, owned, idle)
    put_in(bodies, casting)


def take_robots(bodies: ArenaContents, casting: Casting) -> frozenset[str]:
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


def put_in(bodies: ArenaContents, casting: Casting) -> None:
    """Has robots play the parts of others.

    Raises:
        UsageError: a part is not there, or a robot that is put in has one, or is out of order.
    """
    for pair in casting.replaced:
        check(f"--replace {pair[0]}={pair[1]}", pair, bodies.robots, bodies.tags.values(), casting)
        out, new = pair
        bodies.robots[:] = [replace(r, tag=new) if r.tag == out else r for r in bodies.robots]
        bodies.lines_of_tags[new] = bodies.lines_of_tags.pop(out)


def check(
    what: str, pair: Pair, robots: Iterable[RobotSpec], worn: Collection[int], casting: Casting
) -> None:
    """Refuses a robot that cannot play another's part.

    Args:
        what: how errors call it.
        pair: of whom, and who.
        robots: those that play.
        worn: all tags in the experiment.

    Raises:
        UsageError: there is no such part, or the robot has one, or is out of order.
    """
    out, new = pair
    there = [robot.tag for robot in robots]
    if out not in there:
        raise UsageError(
            f"{what}: no robot has tag {out}; expected one of {', '.join(map(str, there))}"
        )
    if new in worn:
        raise UsageError(f"{what}: {new} is in the experiment already")
    broken = [why for tag, why in casting.others if tag == new and why != SPARE]
    if broken:
        raise UsageError(f"{what}: {new} is {broken[0]}")


def recast(experiment: Experiment, pair: Pair) -> Experiment:
    """The experiment with a robot in the place of another, as `--replace` does it at the start.

    The part keeps its name, controller and start.

    Raises:
        UsageError: as `check`.
    """
    out, new = pair
    worn = [robot.tag for robot in experiment.robots]
    worn += [thing.tag for thing in experiment.objects]
    worn += [robot.tag for robot in experiment.virtual_robots]
    check(f"{out}={new}", pair, experiment.robots, worn, experiment.casting)
    return replace(
        experiment,
        robots=tuple(replace(r, tag=new) if r.tag == out else r for r in experiment.robots),
        sources=tuple(replace(s, tag=new) if s.tag == out else s for s in experiment.sources),
        casting=experiment.casting.with_replaced(pair),
    )


def parts_of(experiment: Experiment) -> dict[int, int]:
    """The tag of each robot's part, by its own: another one's where it plays in its place."""
    first = {new: out for out, new in experiment.casting.replaced}
    return {robot.tag: first.get(robot.tag, robot.tag) for robot in experiment.robots}


def spares_for(experiment: Experiment) -> list[int]:
    """The roster's robots that work and do not play, spares first."""
    playing = {robot.tag for robot in experiment.robots}
    free = (tag for tag in experiment.casting.free if tag not in playing)
    return [*only_spares(experiment), *free]


def only_spares(experiment: Experiment) -> list[int]:
    """The roster's spares that work and do not play."""
    playing = {robot.tag for robot in experiment.robots}
    others = experiment.casting.others
    return [tag for tag, why in others if why == SPARE and tag not in playing]
