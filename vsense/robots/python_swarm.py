"""What a controller in Python sees and may do: a `Robot`, or all robots of a controller as arrays.

A file has one of these classes:

    class Controller:                  # one is made for every robot
        def __init__(self, robot):     # bind sensors and read parameters here
            self.light = robot.sensor("light")

        def step(self, robot):         # one control step: read, think, set wheels and LEDs
            if self.light.known:
                robot.set_wheels(300, 500)

    class SwarmController:             # one is made for all of them; everything is an array
        def __init__(self, swarm):
            self.light = swarm.sensor("light")

        def step(self, swarm):
            bright = self.light.values.max(axis=1)
            swarm.set_wheels(300 + 200 * (bright > 1), 500)

`end(self)` is called after the run where it is there. Names, units, limits and what holds for
readings that are stale are those of `robot/controller.h`; what is set stays until it is set again.
Nothing here blocks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, instead

RowMask = NDArray[np.bool_]


class Leds(IntFlag):
    """For `set_leds`: the eight red LEDs around the body, the green body, the front."""

    RING = 0xFF
    BODY = 0x100
    FRONT = 0x200


OWN_COUNTS = {
    "proximity": 8, "light": 8, "battery_low": 1, "ground": 3, "wheels": 2, "range_and_bearing": 31,
    "accelerometer": 3, "microphones": 4, "battery": 1, "gyroscope": 3, "distance": 1,
}  # fmt: skip
"""How many numbers the robots' own sensors have at most. Source: robot/base_sensors.c."""

_ALL_LEDS = int(Leds.RING | Leds.BODY | Leds.FRONT)
RGB = "+rgb"  # the actuator of robots that are driven from here: three levels for each of four LEDs
_NEVER_NS = 2**64 - 1
_MOST_STEPS_S = 32767.0


class SwarmReading:
    """A sensor of all robots, as it is in this control step; n robots, k numbers each."""

    def __init__(self, swarm: Swarm, name: str, count: int) -> None:
        self._swarm, self._step = swarm, -1
        self._handle = swarm.runtime.call("sensor", name)
        robots = swarm.runtime.count
        self._values, self._ages_ns = np.zeros((robots, count)), np.zeros(robots, np.uint64)
        self._stale = np.zeros(robots, np.bool_)

    def _read(self) -> None:
        if self._step != self._swarm.steps:
            # New arrays: what somebody has kept of an earlier step stays as it was.
            (robots, count), self._step = self._values.shape, self._swarm.steps
            into = (
                np.zeros((robots, count)),
                np.zeros(robots, np.uint64),
                np.zeros(robots, np.bool_),
            )
            self._swarm.runtime.call("read", self._handle, count, *into)
            for array in into:
                array.setflags(write=False)
            self._values, self._ages_ns, self._stale = into

    @property
    def values(self) -> Floats:
        """(n, k) its numbers; 0 where it is not known."""
        self._read()
        return self._values

    @property
    def value(self) -> Floats:
        """(n,) the first of its numbers."""
        return self.values[:, 0]

    @property
    def known(self) -> RowMask:
        """(n,) it has been measured once; False: nobody offers it, or not yet."""
        self._read()
        return np.asarray(self._ages_ns != _NEVER_NS)

    @property
    def stale(self) -> RowMask:
        """(n,) older than 2.5 timesteps, or not known."""
        self._read()
        return self._stale

    @property
    def age_s(self) -> Floats:
        """(n,) [s] since it was measured; infinite where it is not known."""
        self._read()
        return np.where(self.known, self._ages_ns * 1e-9, np.inf)


class SwarmActuator:
    """A virtual actuator of all robots."""

    def __init__(self, swarm: Swarm, name: str, count: int) -> None:
        self._swarm, self._count = swarm, count
        self._handle = swarm.runtime.call("actuator", name)
        self._values = np.zeros((swarm.runtime.count, count))
        self._changed = np.zeros(swarm.runtime.count, np.bool_)

    def set(self, values: ArrayLike, index: int = 0, where: ArrayLike = True) -> None:
        """Sets number `index` of it, for the robots of `where`.

        Raises:
            IndexError: it has fewer numbers.
            ValueError: `values` are not one number, or one for each robot.
        """
        rows = self._swarm.rows(where)
        self.set_of(rows, self._swarm.column(values)[rows], index)

    def set_of(self, rows: Any, values: Any, index: int) -> None:
        """The same of some robots, by their places; raises IndexError as `set`."""
        if not 0 <= index < self._count:
            raise IndexError(f"number {index} of an actuator that has {self._count}")
        self._values[rows, index], self._changed[rows] = values, True

    def set_all(self, values: Floats, where: ArrayLike = True) -> None:
        """Sets all of its numbers, (n, k), for the robots of `where`."""
        rows = self._swarm.rows(where)
        self._values[rows], self._changed[rows] = values[rows, : self._count], True

    def rest(self, robot: int) -> None:
        """All numbers of one robot are 0."""
        self._values[robot], self._changed[robot] = 0.0, True

    def send(self) -> None:
        """Hands to the robots what was set."""
        if self._changed.any():
            given = self._changed, self._handle, self._count, self._values
            self._swarm.runtime.call("actuate", *given)
            self._changed[:] = False


class SwarmWalk:
    """How all robots get about, see `robot/walk.h`; the newest order of a control step counts."""

    WANDER, TOWARDS, REST = 1, 2, 3
    """As `vs_hosted_walk` has them."""

    def __init__(self, swarm: Swarm) -> None:
        self._swarm, self._walks = swarm, swarm.runtime.walks()
        swarm.runtime.call("walk_begin", self._walks)
        self._does = np.zeros(swarm.runtime.count, np.uint8)
        self._bearings_rad = np.zeros(swarm.runtime.count)

    def wander(self, where: ArrayLike = True) -> None:
        """A random walk that turns away from obstacles."""
        self.order(self._swarm.rows(where), self.WANDER)

    def towards(self, bearings_rad: ArrayLike, where: ArrayLike = True) -> None:
        """Towards a bearing, counter-clockwise from ahead; obstacles are passed by first."""
        rows = self._swarm.rows(where)
        self.order(rows, self.TOWARDS, self._swarm.column(bearings_rad)[rows])

    def rest(self, where: ArrayLike = True) -> None:
        """Stands still."""
        self.order(self._swarm.rows(where), self.REST)

    def order(self, rows: Any, what: int, bearings_rad: Any = 0.0) -> None:
        """These robots do something in this control step, whatever their wheels were set to."""
        self._does[rows], self._bearings_rad[rows] = what, bearings_rad
        self._swarm.wheels_set[rows] = False

    def drop(self, rows: Any) -> None:
        """These robots do not walk in this control step: their wheels are set."""
        self._does[rows] = 0

    def send(self) -> None:
        """Has the robots make their step."""
        if self._does.any():
            self._swarm.runtime.call("walk", self._walks, self._does, self._bearings_rad)
            self._does[:] = 0


class Swarm:
    """All robots of a controller, n of them; what it is given and gives are arrays in their order.

    Attributes:
        tags: (n,) the robots.
        timestep_s: [s] length of a timestep; control steps are about that far apart.
        offered, actuates: how many numbers the virtual sensors and actuators have, by name.
    """

    _strict = False

    def __init__(
        self,
        runtime: Any,
        tags: Sequence[int],
        timestep_s: float,
        counts: Mapping[str, int],
        actuator_counts: Mapping[str, int],
    ) -> None:
        """See the attributes; a fused sensor has its "+". `runtime`: `hosted.HostedRobots`."""
        self.tags, self.timestep_s, self.steps = np.array(tags), timestep_s, 0
        self.runtime, self.offered, self.actuates = runtime, counts, actuator_counts
        self._readings = dict[str, SwarmReading]()
        self._actuators = dict[str, SwarmActuator]()
        self._walk: SwarmWalk | None = None
        count = runtime.count
        self._wheels, self.wheels_set = np.zeros((count, 2), np.int32), np.zeros(count, np.bool_)
        self._leds, self._leds_set = np.zeros(count, np.uint32), np.zeros(count, np.bool_)

    def __len__(self) -> int:
        return len(self.tags)

    def sensor(self, name: str) -> SwarmReading:
        """Binds a sensor by name; of one that nobody offers the reading is not known."""
        if name not in self._readings:
            offered = [offer.removeprefix("+") for offer in self.offered]
            self._check(name, "sensor", [*offered, *OWN_COUNTS])
            count = self.offered.get(name, self.offered.get(f"+{name}", OWN_COUNTS.get(name, 1)))
            self._readings[name] = SwarmReading(self, name, count)
        return self._readings[name]

    def actuator(self, name: str) -> SwarmActuator:
        """Binds a virtual actuator by name."""
        if name not in self._actuators:
            self._check(name, "virtual actuator", self.actuates)
            self._actuators[name] = SwarmActuator(self, name, self.actuates.get(name, 1))
        return self._actuators[name]

    def refuse_unknown(self) -> None:
        """From now on a name that the experiment does not have is an error."""
        self._strict = True

    def _check(self, name: str, kind: str, known: Iterable[str]) -> None:
        if self._strict and name not in known:
            raise UsageError(f"there is no {kind} {name!r}; {instead(name, list(known))}")

    def walk(self) -> SwarmWalk:
        """Begins walking by `robot/walk.h`, which reads speed_cm_s, walk_s and near_raw."""
        if self._walk is None:
            self._walk = SwarmWalk(self)
        return self._walk

    def param(
        self, name: str, fallback: float, least: int | None = None, most: int | None = None
    ) -> Floats:
        """(n,) a parameter of the experiment; one beyond its bounds is refused before the run."""
        return np.array([self.param_of(i, name, fallback, least, most) for i in range(len(self))])

    def param_of(
        self, robot: int, name: str, fallback: float, least: int | None, most: int | None
    ) -> float:
        """The same of one robot, by its place."""
        if least is None and most is None:
            return float(self.runtime.call("param", robot, name, fallback))
        bounds = -(2**31) if least is None else least, 2**31 - 1 if most is None else most
        return float(self.runtime.call("param_in", robot, name, fallback, *bounds))

    def set_wheels(
        self, left_steps_s: ArrayLike, right_steps_s: ArrayLike, where: ArrayLike = True
    ) -> None:
        """Wheels of the robots of `where` [step/s], forwards; ValueError: not finite numbers."""
        rows = self.rows(where)
        for side, given in enumerate((left_steps_s, right_steps_s)):
            steps_s = np.clip(self.column(given)[rows], -_MOST_STEPS_S, _MOST_STEPS_S)
            self._wheels[rows, side] = steps_s
        self._are_set(rows)

    def set_wheels_of(self, robot: int, left_steps_s: float, right_steps_s: float) -> None:
        """The same of one robot, by its place."""
        for side, given in enumerate((left_steps_s, right_steps_s)):
            self._wheels[robot, side] = max(-_MOST_STEPS_S, min(given, _MOST_STEPS_S))
        self._are_set(robot)

    def _are_set(self, rows: Any) -> None:
        self.wheels_set[rows] = True
        if self._walk is not None:
            self._walk.drop(rows)

    def set_leds(self, leds: ArrayLike, where: ArrayLike = True) -> None:
        """Which LEDs are on, see `Leds`; bit n of the ring is LED n. ValueError: they are none."""
        rows, wanted = self.rows(where), np.asarray(leds)
        if wanted.dtype.kind not in "iub" or ((wanted < 0) | (wanted > _ALL_LEDS)).any():
            raise ValueError(f"{leds!r}: expected LEDs, whole numbers of 0 to {_ALL_LEDS}")
        self._leds[rows] = np.broadcast_to(wanted, len(self))[rows]
        self._leds_set |= rows

    def set_leds_of(self, robot: int, leds: int) -> None:
        """The same of one robot, by its place."""
        # numpy's bool is no index.
        if not isinstance(leds, (int, np.integer)) or not 0 <= leds <= _ALL_LEDS:
            raise ValueError(f"{leds!r}: expected LEDs, a whole number of 0 to {_ALL_LEDS}")
        self._leds[robot], self._leds_set[robot] = leds, True

    def set_rgb(
        self, led: int, red: ArrayLike, green: ArrayLike, blue: ArrayLike, where: ArrayLike = True
    ) -> None:
        """Colour of LED 0 to 3, 0 to 255 each, see `vs_robot_set_rgb`; nothing in a simulation."""
        if RGB not in self.actuates:
            return
        for channel, levels in enumerate((red, green, blue)):
            self.actuator(RGB).set(levels, 3 * led + channel, where)

    def random_of(self, robot: int) -> float:
        """The next random number of one robot, by its place."""
        return float(self.random(np.arange(len(self)) == robot)[robot])

    def random(self, where: ArrayLike = True) -> Floats:
        """(n,) uniform in [0, 1), of each robot's own generator; 0 for the others."""
        values = np.zeros(len(self))
        self.runtime.call("random", self.rows(where), values)
        return values

    def show(self, name: str, values: ArrayLike, where: ArrayLike = True) -> None:
        """Shows a number of every robot to people, under a name of 15 bytes at most."""
        for row in np.flatnonzero(self.rows(where)):
            self.runtime.call("show", int(row), name, float(self.column(values)[row]))

    def log(self, robot: int, line: object) -> None:
        """One line for the host's list of events, from the robot at this place in `tags`.

        IndexError: there is none.
        """
        if not 0 <= robot < len(self):
            expected = f"expected its place in swarm.tags, 0 to {len(self) - 1}"
            raise IndexError(f"robot {robot}: {expected}")
        self.runtime.call("log", robot, str(line))

    def rows(self, where: ArrayLike) -> RowMask:
        """(n,) the robots that `where` means: one truth value, or one for each.

        ValueError: it is something else, such as places.
        """
        rows = np.asarray(where)
        if rows.dtype != np.bool_ or rows.shape not in ((), (len(self),)):
            expected = f"expected one truth value, or {len(self)}: one for each robot"
            raise ValueError(f"where: an array of {rows.dtype}, shape {rows.shape}; {expected}")
        return np.array(np.broadcast_to(rows, len(self)))

    def column(self, values: ArrayLike) -> Floats:
        """(n,) one number, or one for each robot; ValueError: they are not, or not finite."""
        column = np.asarray(values, np.float64)
        if column.shape not in ((), (len(self),)):
            expected = f"expected one number, or {len(self)}: one for each robot"
            raise ValueError(f"an array of shape {column.shape}; {expected}")
        if not np.isfinite(column).all():
            raise ValueError("numbers that are not finite")
        return np.broadcast_to(column, len(self))

    def send(self) -> None:
        """Hands to the robots what was set in this control step."""
        runtime = self.runtime
        if self._walk is not None:
            self._walk.send()
        if self.wheels_set.any():
            runtime.call("wheels", self.wheels_set, self._wheels)
            self.wheels_set[:] = False
        if self._leds_set.any():
            runtime.call("leds", self._leds_set, self._leds)
            self._leds_set[:] = False
        for actuator in self._actuators.values():
            actuator.send()

    def rest(self, robot: int) -> None:
        """This robot stands, is dark, and does nothing virtual."""
        self.set_wheels_of(robot, 0.0, 0.0)
        self.set_leds_of(robot, 0)
        for actuator in self._actuators.values():
            actuator.rest(robot)
