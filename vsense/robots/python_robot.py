"""One robot as its controller in Python sees it: a row of `vsense.robots.python_swarm.Swarm`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.robots.python_swarm import RGB, Swarm, SwarmActuator, SwarmReading, SwarmWalk


class Reading:
    """A sensor of one robot, as it is in this control step."""

    __slots__ = ("_all", "_row")

    def __init__(self, all_robots: SwarmReading, row: int) -> None:
        self._all, self._row = all_robots, row

    @property
    def value(self) -> float:
        """The first of its numbers, 0 if it is not known."""
        return float(self._all.values[self._row, 0])

    @property
    def values(self) -> Floats:
        """(k,) its numbers, 0 if it is not known."""
        return np.asarray(self._all.values[self._row])

    @property
    def known(self) -> bool:
        """It has been measured once; False: nobody offers it, or not yet."""
        return bool(self._all.known[self._row])

    @property
    def stale(self) -> bool:
        """Older than 2.5 timesteps, or not known."""
        return bool(self._all.stale[self._row])

    @property
    def age_s(self) -> float:
        """[s] since it was measured, infinite if it is not known."""
        return float(self._all.age_s[self._row])


class Actuator:
    """A virtual actuator of one robot."""

    __slots__ = ("_all", "_row")

    def __init__(self, all_robots: SwarmActuator, row: int) -> None:
        self._all, self._row = all_robots, row

    def set(self, value: float, index: int = 0) -> None:
        """Sets number `index` of it, a level or a counter; stays until it is set again.

        Raises:
            IndexError: it has fewer numbers.
            ValueError: the value is not finite.
        """
        self._all.set_of(self._row, finite(value), index)


class Walk:
    """How one robot gets about, see `robot/walk.h`; the newest order of a control step counts."""

    __slots__ = ("_all", "_row")

    def __init__(self, all_robots: SwarmWalk, row: int) -> None:
        self._all, self._row = all_robots, row

    def wander(self) -> None:
        """A random walk that turns away from obstacles."""
        self._all.order(self._row, SwarmWalk.WANDER)

    def towards(self, bearing_rad: float) -> None:
        """Towards a bearing, counter-clockwise from ahead; obstacles are passed by first."""
        self._all.order(self._row, SwarmWalk.TOWARDS, finite(bearing_rad))

    def rest(self) -> None:
        """Stands still."""
        self._all.order(self._row, SwarmWalk.REST)


class Robot:
    """What a `Controller` is given: its robot.

    Attributes:
        tag: the robot's.
        timestep_s: [s] length of a timestep; control steps are about that far apart.
    """

    def __init__(self, swarm: Swarm, row: int) -> None:
        self._swarm, self._row = swarm, row
        self.tag, self.timestep_s = int(swarm.tags[row]), swarm.timestep_s

    def sensor(self, name: str) -> Reading:
        """Binds a sensor by name; of one that nobody offers the reading is not known."""
        return Reading(self._swarm.sensor(name), self._row)

    def actuator(self, name: str) -> Actuator:
        """Binds a virtual actuator by name."""
        return Actuator(self._swarm.actuator(name), self._row)

    def walk(self) -> Walk:
        """Begins walking by `robot/walk.h`, which reads speed_cm_s, walk_s and near_raw."""
        return Walk(self._swarm.walk(), self._row)

    def param(
        self, name: str, fallback: float, least: int | None = None, most: int | None = None
    ) -> float:
        """A parameter of the experiment; one beyond its bounds is refused before the run."""
        return self._swarm.param_of(self._row, name, fallback, least, most)

    def param_text(self, name: str, fallback: str = "") -> str:
        """A parameter as text."""
        text = self._swarm.runtime.text(self._row, name)
        return fallback if text is None else text

    def set_wheels(self, left_steps_s: float, right_steps_s: float) -> None:
        """Its wheels [step/s], forwards; ValueError: they are not finite."""
        self._swarm.set_wheels_of(self._row, finite(left_steps_s), finite(right_steps_s))

    def set_leds(self, leds: int) -> None:
        """Which LEDs are on, see `Leds`; bit n of the ring is LED n."""
        self._swarm.set_leds_of(self._row, leds)

    def set_rgb(self, led: int, red: float, green: float, blue: float) -> None:
        """Colour of LED 0 to 3, 0 to 255 each, where it has some; nothing in a simulation."""
        for channel, level in enumerate((red, green, blue)):
            if RGB in self._swarm.actuates:
                self._swarm.actuator(RGB).set_of(self._row, finite(level), 3 * led + channel)

    def random(self) -> float:
        """Uniform in [0, 1), of this robot's own generator."""
        return self._swarm.random_of(self._row)

    def show(self, name: str, value: float | str) -> None:
        """Shows a number, or a text of 48 bytes at most, to people; names have 15 bytes at most."""
        runtime = self._swarm.runtime
        if isinstance(value, str):
            runtime.call("show_text", self._row, name, value)
        else:
            runtime.call("show", self._row, name, float(value))

    def log(self, line: object) -> None:
        """One line for the host's list of events."""
        self._swarm.log(self._row, line)


def finite(value: Any) -> float:
    """The number; ValueError: it is not finite. TypeError: it is none."""
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number}: expected a finite number")
    return number
