"""The physics of the lab's floor: differential drive by stepper motors, and bodies in the way."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.arena import wrap_angle
from vsense.lab.contacts import Boxes, Contacts, Floats, Neighbourhood

AXLE_M = 0.053
"""Distance between the wheels' contact points. Source: epuck.md section 6."""
STEP_M = 0.041 * np.pi / 1000
"""Way of a wheel per motor step: 41 mm wheels, 1000 steps per turn. Source: epuck.md section 6."""
MAX_SPEED_STEPS_S = 1000
"""Fastest speed that the motor library takes. Source: epuck.md section 1.3."""

_TIMER_HZ = 10_000
"""The motor library counts the time between two steps in ticks of 0.1 ms."""
_STANDING_MOBILITY = 0.25
"""How readily a robot with blocked wheels gives way, beside 1 for one whose wheels turn.

Both weigh the same, so a pusher's tyres slip about as easily as those of a pushed robot drag:
it creeps, at a fifth of the pusher's speed.
"""


def _quantised_speeds() -> Floats:
    """What the stepper makes of each commanded speed 0..1000, in steps/s.

    Source: epuck.md section 1.6: a period is floor(10000 / |v|) timer ticks.
    """
    commanded = np.arange(1, MAX_SPEED_STEPS_S + 1)
    return np.concatenate([[0.0], _TIMER_HZ / (_TIMER_HZ // commanded)])


_REAL_SPEEDS_STEPS_S = _quantised_speeds()


def real_speed_m_s(commanded_steps_s: ArrayLike) -> Floats:
    """Speed over ground of a wheel, in m/s, from commanded speeds (...) in steps/s, integers.

    Commands beyond `MAX_SPEED_STEPS_S` count as that speed.
    """
    commanded = np.asarray(commanded_steps_s, dtype=np.int64)
    size = np.minimum(np.abs(commanded), MAX_SPEED_STEPS_S)
    return np.sign(commanded) * _REAL_SPEEDS_STEPS_S[size] * STEP_M


def roll(poses: Floats, wheels_m_s: Floats, duration_s: Floats) -> None:
    """Rolls robots along their arcs, exactly, in place.

    Args:
        poses: (m, 3) x_m, y_m, yaw_rad, arena frame; changed; the yaw is not wrapped.
        wheels_m_s: (m, 2) speed over ground of the left and the right wheel.
        duration_s: (m,) for how long.
    """
    way_m = wheels_m_s.sum(axis=1) * (0.5 * duration_s)
    half_turn_rad = (wheels_m_s[:, 1] - wheels_m_s[:, 0]) * (0.5 / AXLE_M * duration_s)
    chord_m = way_m * np.sinc(half_turn_rad / np.pi)
    middle_rad = poses[:, 2] + half_turn_rad
    poses[:, 0] += chord_m * np.cos(middle_rad)
    poses[:, 1] += chord_m * np.sin(middle_rad)
    poses[:, 2] += 2 * half_turn_rad


class Physics:
    """Robots that drive, objects and boxes that stand, and nobody inside anybody.

    Time is an argument: the same calls give the same poses. Bodies are discs of
    `BODY_RADIUS_M`. Contacts are without friction, so a robot pressed against a wall slides
    along it and can turn on the spot.

    Attributes:
        poses: (n, 3) true x_m, y_m, yaw_rad, arena frame, yaw in (-pi, pi]: robots, then
            objects. Holds for the time of the last `tick`.
        near: who is near whom at these poses.
    """

    def __init__(
        self, robots: ArrayLike, objects: ArrayLike, boxes: ArrayLike, time_ns: int
    ) -> None:
        """A scene that starts at rest.

        Args:
            robots: (m, 3) x_m, y_m, yaw_rad of what drives, arena frame.
            objects: (k, 3) likewise of tagged bodies that never move.
            boxes: (b, 5) x_m, y_m, yaw_rad, size_x_m, size_y_m of walls and boxes.
            time_ns: when the scene starts.
        """
        driving = np.asarray(robots, dtype=np.float64).reshape(-1, 3)
        standing = np.asarray(objects, dtype=np.float64).reshape(-1, 3)
        self.poses = np.concatenate([driving, standing])
        self.poses[:, 2] = wrap_angle(self.poses[:, 2])
        self.near = Neighbourhood(len(driving), Boxes.from_rows(boxes))
        self.near.update(self.poses[:, :2])
        self._mobility = np.zeros(len(self.poses))
        self._mobility[: len(driving)] = _STANDING_MOBILITY
        self._contacts = Contacts(self._mobility, self.near)
        self._commands = [(0, 0)] * len(driving)
        self._wheels_m_s = np.zeros((len(driving), 2))
        self._rolled_ns: NDArray[np.int64] = np.full(len(driving), time_ns, dtype=np.int64)

    def drive(self, robot: int, left_steps_s: int, right_steps_s: int, time_ns: int) -> None:
        """Lets a robot's wheels turn at new speeds from `time_ns` on.

        A time before the last tick counts as the time of that tick: the past stays as it is.

        Args:
            robot: its row in `poses`.
            left_steps_s, right_steps_s: commanded speeds.
            time_ns: when the microcontroller changed the speeds.
        """
        command = (left_steps_s, right_steps_s)
        if command == self._commands[robot]:
            return
        self._commands[robot] = command
        if time_ns > self._rolled_ns[robot]:
            self._roll(slice(robot, robot + 1), time_ns)
        self._wheels_m_s[robot] = real_speed_m_s(command)
        self._mobility[robot] = 1.0 if any(command) else _STANDING_MOBILITY

    def tick(self, time_ns: int) -> None:
        """Moves everything on to `time_ns`, later than all calls before."""
        self._roll(slice(0, len(self._rolled_ns)), time_ns)
        self._contacts.separate(self.poses[:, :2])
        self.poses[:, 2] = wrap_angle(self.poses[:, 2])

    def _roll(self, rows: slice, time_ns: int) -> None:
        duration_s = (time_ns - self._rolled_ns[rows]).astype(np.float64) * 1e-9
        roll(self.poses[rows], self._wheels_m_s[rows], duration_s)
        self._rolled_ns[rows] = time_ns
