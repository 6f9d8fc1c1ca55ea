"""Who plays the parts of experiments, while these run: spares, and robots that people put in.

A part keeps its name, controller and start; who plays it is told to everybody, and is in the
recording (`/parts`), in the run's summary and in runs.csv.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from vsense.base.errors import VsenseError
from vsense.base.terminal import Level
from vsense.config.casting import Pair
from vsense.config.specs import Experiment
from vsense.robots.link.status import RobotStatus
from vsense.run.orders import OrderError, RequestQueue


def recast(experiment: Experiment, pair: Pair) -> Experiment:
    """The experiment with a robot in the place of another, as `--replace` does it at the start.

    The part keeps its name, controller and start.

    Raises:
        UsageError: as `Casting.check`.
    """
    out, new = pair
    playing = {robot.tag: robot.model.name for robot in experiment.robots}
    experiment.casting.check(f"{out}={new}", pair, playing, [*playing, *_worn(experiment)])
    return recast_parts(experiment, {parts_of(experiment)[out]: new})


def recast_parts(experiment: Experiment, robots: Mapping[int, int]) -> Experiment:
    """The experiment with robots in parts, by the parts' tags, all at once; other parts stay.

    Robots may exchange parts; parts that the experiment does not have are passed over.

    Raises:
        UsageError: as `Casting.check`, or a robot would play two parts.
    """
    parts, casting = parts_of(experiment), experiment.casting
    moves = {tag: robots[part] for tag, part in parts.items() if robots.get(part, tag) != tag}
    worn = [*(tag for tag in parts if tag not in moves), *_worn(experiment)]
    models = {robot.tag: robot.model.name for robot in experiment.robots if robot.tag in moves}
    for pair in moves.items():
        casting.check(f"{pair[0]}={pair[1]}", pair, models, worn)
        worn.append(pair[1])
    pairs = [(part, tag) for part, tag in casting.replaced if robots.get(part, tag) == tag]
    pairs += [(parts[tag], new) for tag, new in moves.items() if parts[tag] != new]
    return replace(
        experiment,
        robots=tuple(replace(r, tag=moves.get(r.tag, r.tag)) for r in experiment.robots),
        sources=tuple(replace(s, tag=moves.get(s.tag, s.tag)) for s in experiment.sources),
        casting=replace(casting, replaced=tuple(pairs)),
    )


def _worn(experiment: Experiment) -> list[int]:
    """Tags that no robot can play with: those of tagged things and virtual robots."""
    virtual = [robot.tag for robot in experiment.virtual_robots]
    return [*(thing.tag for thing in experiment.objects), *virtual]


def parts_of(experiment: Experiment) -> dict[int, int]:
    """The tag of each robot's part, by its own: another one's where it plays in its place."""
    first = {new: out for out, new in experiment.casting.replaced}
    return {robot.tag: first.get(robot.tag, robot.tag) for robot in experiment.robots}


def spares_for(experiment: Experiment) -> list[int]:
    """The roster's robots that work and do not play, spares first."""
    playing, casting = {robot.tag for robot in experiment.robots}, experiment.casting
    return [*casting.spares(playing), *(tag for tag in casting.free if tag not in playing)]


class Replacement(NamedTuple):
    """Whom somebody wants to play in whose place."""

    pair: Pair
    by: str


class Cast:
    """The robots of a run's experiment, or of all experiments of a series.

    Args:
        experiments: gives what is played now.
        lease: takes a robot for this process, before it hears of a run; VsenseError: it cannot.
        able: says why a robot cannot come; "": it can.
    """

    def __init__(
        self,
        experiments: Callable[[], Iterable[Experiment]],
        lease: Callable[[int], None] = lambda tag: None,
        able: Callable[[int], str] = lambda tag: "",
    ) -> None:
        self._experiments, self._lease, self._able = experiments, lease, able
        self._requests: RequestQueue[Replacement] = RequestQueue()
        self._replaced: set[int] = set()

    def substitutes(self, tags: Collection[int]) -> dict[int, int]:
        """Chooses spares for robots that cannot go on: by tag of each for whom there is one.

        Spares play in none of the experiments. Whoever was replaced here is not chosen again.
        """
        experiments = list(self._experiments())
        playing = {robot.tag for experiment in experiments for robot in experiment.robots}
        spares = experiments[0].casting.spares(playing | self._replaced | set(tags))
        chosen = dict(zip(tags, spares))
        self._replaced |= chosen.keys()
        return chosen

    def ask(self, pair: Pair, by: str) -> str:
        """Has a robot put in for another before the next timestep between runs; in any thread.

        Returns:
            A line for people.

        Raises:
            OrderError: it cannot be.
        """
        out, new = pair

        def check(pending: Sequence[Replacement]) -> None:
            try:
                for experiment in self._experiments():
                    for request in pending:
                        experiment = recast(experiment, request.pair)
                    recast(experiment, pair)
                if why := self._able(new):
                    raise OrderError(f"{out}={new}: {why}")
                self._lease(new)
            except VsenseError as error:
                raise OrderError(str(error)) from None

        self._requests.put(Replacement(pair, by), check)
        return f"robot {new} takes the role of {out}"

    def ask_for_spares(self, gone: Mapping[int, str], say: Callable[[str, Level], None]) -> None:
        """Asks for spares in place of robots, each with the reason, while there are some."""
        for tag, spare in self.substitutes(gone).items():
            try:
                self.ask((tag, spare), gone[tag])
            except OrderError as error:
                say(f"no spare for robot {tag}: {error}", "warning")

    def due(self) -> list[Replacement]:
        """Takes what was asked for; in the thread of the timesteps."""
        return self._requests.take()


def played(experiment: Experiment, robots: Mapping[int, RobotStatus]) -> list[dict[str, Any]]:
    """Who plays which part of an experiment, one object for each, in the experiment's order.

    "part" is the tag in its file, "tag" the robot's own; uid, controller and its source's hash are
    None before it has connected. `robots` are their status, by tag.
    """
    first = parts_of(experiment)
    return [
        {"part": first[robot.tag], "name": robot.id, "tag": robot.tag}
        | _reported(robots.get(robot.tag))
        for robot in experiment.robots
    ]


def _reported(status: RobotStatus | None) -> dict[str, str | None]:
    uid = None if status is None else status.uid
    if status is None or uid is None:
        return dict.fromkeys(("uid", "controller", "hash"))
    return {
        "uid": uid.hex(),
        "controller": status.controller or None,
        "hash": status.hash or None,
    }
