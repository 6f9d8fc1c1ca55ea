"""Between runs a robot is put in for another: from people's threads into that of the timesteps.

A part keeps its name, controller and start; who plays it is told to everybody, and is in the
recording (`/parts`), in the run's summary and in runs.csv.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from vsense.base.errors import VsenseError
from vsense.config import parts
from vsense.config.casting import Pair
from vsense.config.specs import Experiment
from vsense.robots.link.status import RobotStatus
from vsense.run.orders import OrderError


class Wish(NamedTuple):
    """Whom somebody wants to play in whose place."""

    pair: Pair
    by: str


class Recasting:
    """Takes wishes from any thread, until the thread of the timesteps carries them out.

    Args:
        experiment: gives what is played now.
        lease: takes a robot for this process, before it hears of a run; VsenseError: it cannot.
        able: says why a robot cannot come; "": it can.
    """

    def __init__(
        self,
        experiment: Callable[[], Experiment],
        lease: Callable[[int], None] = lambda tag: None,
        able: Callable[[int], str] = lambda tag: "",
    ) -> None:
        self._experiment, self._lease, self._able = experiment, lease, able
        self._wishes: list[Wish] = []
        self._lock = threading.Lock()

    def ask(self, pair: Pair, by: str) -> str:
        """Has a robot put in for another before the next timestep between runs.

        Returns:
            A line for people.

        Raises:
            OrderError: it cannot be.
        """
        out, new = pair
        with self._lock:
            try:
                experiment = self._experiment()
                for wish in self._wishes:
                    experiment = parts.recast(experiment, wish.pair)
                parts.recast(experiment, pair)
                if why := self._able(new):
                    raise OrderError(f"{out}={new}: {why}")
                self._lease(new)
            except VsenseError as error:
                raise OrderError(str(error)) from None
            self._wishes.append(Wish(pair, by))
        name = next(robot.id for robot in experiment.robots if robot.tag == out)
        return f"robot {new} is put in for {out} ({name})"

    def due(self) -> list[Wish]:
        """Takes the wishes that wait."""
        if not self._wishes:
            return []
        with self._lock:
            due, self._wishes = self._wishes, []
        return due


def played(experiment: Experiment, robots: Mapping[int, RobotStatus]) -> list[dict[str, Any]]:
    """Who plays which part of an experiment, one object for each, in the experiment's order.

    "part" is the tag in its file, "tag" the robot's own; uid, controller and its source's hash are
    None before it has connected. `robots` are their status, by tag.
    """
    first = parts.parts_of(experiment)
    return [
        {"part": first[robot.tag], "name": robot.id, "tag": robot.tag}
        | _told(robots.get(robot.tag))
        for robot in experiment.robots
    ]


def _told(status: RobotStatus | None) -> dict[str, str | None]:
    """What a robot has told of itself."""
    uid = None if status is None else status.uid
    if status is None or uid is None:
        return dict.fromkeys(("uid", "controller", "hash"))
    return {
        "uid": uid.hex(),
        "controller": status.controller or None,
        "hash": status.hash or None,
    }
