"""The physics of lab and simulation: differential drive by stepper motors, bodies in the way.

Contacts are found in C (`c_src/host/vs_contacts.c`): with 15 robots in the pollutant experiment's
arena a tick takes 2 us, where NumPy took 125 us.

Noise of the wheels is as ARGoS has it: every command comes out a little different.

    <epuck_wheels noise_std_dev="0.05" />: v + v N(0, noise_std_dev)
    <differential_steering bias_avg bias_stddev factor_avg factor_stddev />, each also with _left
        and _right: N(factor_avg, factor_stddev) (v + bias) while one of the wheels turns; the bias
        [m/s] is drawn once for every robot

Source: argos3-epuck 66cb8d9, epuck_wheels_default_actuator.cpp lines 78-98; argos3 421bd76,
differential_steering_default_actuator.cpp lines 44-120.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer, random_in_c
from vsense.world.entities import Box, Cylinder
from vsense.world.robot_models import EPUCK, RobotModel
from vsense.world.sensors.quality import generator

_PAIR = np.dtype([("robot", "u4"), ("other", "u4")])
"""`struct vs_pair`."""


class Neighbourhood:
    """The pairs that are near enough to touch or to be sensed; see `struct vs_near`.

    Attributes:
        robots: how many of the bodies can sense and give way: the first ones.
        cdata: the `struct vs_near`, for calls of the C library.
        room: of how many pairs there may be.
    """

    def __init__(
        self, robots: int, boxes: ArrayLike, radii_m: ArrayLike, reach_m: float = EPUCK.reach_m
    ) -> None:
        """`boxes` as for `Physics`; `radii_m` (n,) of every body, robots first; `reach_m`: no
        robot touches or feels what is farther from its middle."""
        table = np.asarray(boxes, dtype=np.float64).reshape(-1, 5)
        axis = np.stack([np.cos(table[:, 2]), np.sin(table[:, 2])], axis=1)
        radii = np.ascontiguousarray(radii_m, dtype=np.float64)
        self.robots = robots
        self.room = robots * (len(radii) + len(table))
        # Pages that no pair ever reaches are never taken from the machine.
        self._buffers = (
            radii,
            np.ascontiguousarray(np.hstack([table[:, :2], axis, table[:, 3:] / 2])),
            np.zeros((len(radii), 2)),
            np.empty(max(self.room, 1), dtype=_PAIR),
            np.empty(len(radii), dtype=np.uint32),
            np.empty(2 * len(radii), dtype=np.uint32),
        )
        near: Any = kernel_ffi.new("struct vs_near *")
        near.robots, near.bodies, near.boxes = robots, len(radii), len(table)
        near.reach_m = reach_m
        near.radii_m, near.box_rows, near.searched_m = (
            pointer("double", array) for array in self._buffers[:3]
        )
        near.pairs = pointer("struct vs_pair", self._buffers[3])
        near.next, near.heads = (pointer("uint32_t", array) for array in self._buffers[4:])
        self.cdata = near


class Contacts:
    """Moves overlapping bodies apart by the least possible displacement; `struct vs_contacts`."""

    def __init__(self, mobility: Floats, near: Neighbourhood) -> None:
        """`mobility` (n,): how readily each body gives way, 0 not at all; may change meanwhile."""
        size = near.room * kernel_ffi.sizeof("struct vs_contact")
        self._buffers = (
            near,
            mobility,
            np.empty(size, dtype=np.uint8),
            np.empty(size, dtype=np.uint8),
            np.empty(2 * len(mobility)),
            np.empty(len(mobility), dtype=np.uint32),
        )
        _, _, now, before, moved_m, newest = self._buffers
        self.cdata: Any = kernel_ffi.new("struct vs_contacts *")
        self.cdata.near = near.cdata
        self.cdata.mobility = pointer("double", mobility)
        self.cdata.now = pointer("struct vs_contact", now)
        self.cdata.before = pointer("struct vs_contact", before)
        self.cdata.moved_m = pointer("double", moved_m)
        self.cdata.newest = pointer("uint32_t", newest)


TICK_NS: int = kernels.VS_TICK_NS
"""Contacts are looked at this often, in ns."""


class Physics:
    """Robots that drive, objects and boxes that stand, and no overlap between them.

    Bodies are discs. Contacts are without friction, so a robot pressed against a wall slides along
    it and can turn on the spot. The same calls give the same poses.

    Attributes:
        poses: (n, 3) true x_m, y_m, yaw_rad, arena frame, yaw in (-pi, pi]: robots, then
            objects. Holds for the time of the last `tick`. Objects may be moved by writing here;
            nothing else may.
        bodies: the same, then the cylinders.
        models: (n,) of robots, then of objects.
        near: the pairs of near bodies at these poses.
        cdata: the `struct vs_physics *`.
    """

    def __init__(
        self,
        robots: ArrayLike,
        objects: ArrayLike,
        boxes: ArrayLike,
        time_ns: int,
        cylinders: ArrayLike = (),
        built: Floats | None = None,
        models: Sequence[RobotModel] = (),
    ) -> None:
        """A scene that starts at rest, in the arena frame.

        Args:
            robots: (m, 3) x_m, y_m, yaw_rad of what drives.
            objects: (k, 3) likewise of tagged bodies that do not drive.
            boxes: (b, 5) x_m, y_m, yaw_rad, size_x_m, size_y_m of walls and boxes.
            cylinders: (c, 3) x_m, y_m, radius_m of cylinders that stand.
            built: (m, 3) how robots are built: way of the left and of the right wheel over that of
                the nominal one, and length of the axle [m]; None: all as their models say.
            models: of robots, then of objects; those that are not there are e-pucks.
        """
        driving, standing, posts = (
            np.asarray(rows, dtype=np.float64).reshape(-1, 3)
            for rows in (robots, objects, cylinders)
        )
        count, tagged = len(driving), len(driving) + len(standing)
        self.bodies = np.concatenate([driving, standing, posts])
        self.bodies[tagged:, 2] = 0.0
        self.poses = self.bodies[:tagged]
        self.models = [*models, *[EPUCK] * (tagged - len(models))]
        radii_m = [*(model.radius_m for model in self.models), *posts[:, 2]]
        reach_m = max([0.0, *(model.reach_m for model in self.models[:count])])
        self.near = Neighbourhood(count, boxes, radii_m, reach_m)
        mobility = np.zeros(len(self.bodies))
        self._contacts = Contacts(mobility, self.near)
        self.cdata = self._make(mobility, count)
        self._built: Floats | None = None
        if built is not None:
            self._build(np.ascontiguousarray(built, dtype=np.float64).reshape(count, 3))
        kernels.vs_physics_init(self.cdata, time_ns)

    def _build(self, built: Floats) -> None:
        self._built = built
        self.cdata.built = pointer("double", built)

    def rebuild(self, robot: int, built: Sequence[float]) -> None:
        """Has another robot stand in a row of `poses`, which is built so; see the constructor."""
        if self._built is None:
            models = self.models[: len(self._buffers[1])]
            self._build(np.array([(1.0, 1.0, model.axle_m) for model in models]))
        assert self._built is not None
        self._built[robot] = built

    def _make(self, mobility: Floats, count: int) -> Any:
        """Makes the `struct vs_physics`; its arrays live as long as this object."""
        wheels_m_s, commands = np.zeros((count, 2)), np.zeros((count, 2), dtype=np.int16)
        rolled_ns, arcs = np.zeros(count, dtype=np.int64), np.zeros((count, 2))
        drives = kernel_ffi.new("struct vs_drive[]", _drives(self.models[:count]))
        self._buffers = (mobility, wheels_m_s, commands, rolled_ns, arcs, drives)
        struct: Any = kernel_ffi.new("struct vs_physics *")
        struct.contacts = self._contacts.cdata
        struct.poses = pointer("double", self.bodies)
        struct.mobility = pointer("double", mobility)
        struct.wheels_m_s = pointer("double", wheels_m_s)
        struct.commands = pointer("int16_t", commands)
        struct.rolled_ns = pointer("int64_t", rolled_ns)
        struct.arcs = pointer("double", arcs)
        struct.drives = drives
        return struct

    def drive(self, robot: int, left_steps_s: int, right_steps_s: int, time_ns: int) -> None:
        """Sets the speeds of a robot's wheels from `time_ns` on; `robot` is its row in `poses`.

        A time before the last tick counts as the time of that tick.
        """
        kernels.vs_physics_drive(self.cdata, robot, left_steps_s, right_steps_s, time_ns)

    def drive_all(self, commands: NDArray[np.int16], time_ns: int) -> None:
        """As `drive`, for all robots at once; commands (m, 2), left and right."""
        kernels.vs_physics_drive_all(self.cdata, pointer("int16_t", commands), time_ns)

    def tick(self, time_ns: int) -> None:
        """Moves everything on to `time_ns`, later than all calls before."""
        kernels.vs_physics_tick(self.cdata, time_ns)

    def advance(self, time_ns: int) -> None:
        """Ticks every 10 ms up to `time_ns`, the last tick there."""
        kernels.vs_physics_advance(self.cdata, time_ns)


def _drives(models: Sequence[RobotModel]) -> list[tuple[float, ...]]:
    """The rows of `struct vs_drive`. Of two robots that touch, the heavier one gives way less."""
    lightest_kg = min((model.mass_kg for model in models), default=1.0)
    return [
        (
            model.step_m,
            0.5 / model.axle_m,
            model.acceleration_m_s2,
            lightest_kg / model.mass_kg,
            model.timer_hz,
            model.max_steps_s,
        )
        for model in models
    ]


def obstacles(
    boxes: Iterable[Box], cylinders: Iterable[Cylinder], height_m: float = EPUCK.height_m
) -> tuple[Floats, Floats]:
    """Boxes and cylinders that do not hang above the robots, which are so high, as `Physics` takes
    them."""
    walls = [
        (*box.position_m[:2], box.yaw_rad, *box.size_m[:2])
        for box in boxes
        if box.position_m[2] < height_m
    ]
    posts = [
        (*post.position_m[:2], post.radius_m) for post in cylinders if post.position_m[2] < height_m
    ]
    return np.array(walls).reshape(-1, 5), np.array(posts).reshape(-1, 3)


_STREAM = "wheels"

Wheels = tuple[float, float]
"""Of the left wheel, and of the right one."""


@dataclass(frozen=True, slots=True)
class WheelNoise:
    """What simulated wheels make of a command: factor * (v (1 + relative) + bias).

    Attributes:
        relative: standard deviation, each time.
        bias_m_s, bias_dev_m_s: mean and standard deviation, once for every robot.
        factor, factor_dev: likewise, each time.
    """

    relative: Wheels = (0.0, 0.0)
    bias_m_s: Wheels = (0.0, 0.0)
    bias_dev_m_s: Wheels = (0.0, 0.0)
    factor: Wheels = (1.0, 1.0)
    factor_dev: Wheels = (0.0, 0.0)


class NoisyWheels:
    """What becomes of the commands to the wheels of some robots.

    Attributes:
        is_quiet: nothing.
        cdata: the `struct vs_slip *`.
    """

    def __init__(
        self,
        noises: Sequence[WheelNoise | None],
        seed: int,
        robots: Sequence[RobotModel] = (),
    ) -> None:
        """Draws what stays the same during a run.

        Args:
            noises: that of each robot; None: its wheels obey.
            seed: of the run; the wheels draw independently of all devices.
            robots: their models, in their order; without, they are e-pucks.
        """
        self.is_quiet = not any(noises)
        models = [noise or WheelNoise() for noise in noises]
        random, shape = generator(seed, _STREAM), (len(models), 2)
        relative, factor, factor_dev, bias_m_s = (
            _column(models, name) for name in ("relative", "factor", "factor_dev", "bias_m_s")
        )
        deviation_m_s = _column(models, "bias_dev_m_s")
        kinds = [*robots[: len(models)]] or [EPUCK] * len(models)
        steps_m = np.array([kind.step_m for kind in kinds]).reshape(-1, 1)
        bias = (bias_m_s + deviation_m_s * random.normal(size=shape)) / steps_m
        most = max((kind.max_steps_s for kind in kinds), default=EPUCK.max_steps_s)
        arrays = relative, factor, factor_dev, bias, np.empty(shape)
        given = [pointer("double", array) for array in arrays]
        given.insert(-1, random_in_c(random, normal=True))
        self._owners = random, given
        self.cdata = kernel_ffi.new("struct vs_slip *", (len(models), most, *given))

    def apply(self, commands: NDArray[np.int16]) -> NDArray[np.int16]:
        """Gives the speeds (n, 2) [step/s] that robots drive at which are told `commands`.

        They are those of one control step: ARGoS draws anew with every command. No motor turns
        faster than it can.
        """
        if self.is_quiet:
            return commands
        speeds: NDArray[np.int16] = commands.copy()
        kernels.vs_slip_apply(self.cdata, pointer("int16_t", speeds))
        return speeds

    def of_robot(self, robot: int, left_steps_s: int, right_steps_s: int) -> tuple[int, int]:
        """The same for one robot, by its index."""
        if self.is_quiet:
            return left_steps_s, right_steps_s
        commands = np.zeros((self.cdata.robots, 2), dtype=np.int16)
        commands[robot] = left_steps_s, right_steps_s
        left, right = self.apply(commands)[robot].tolist()
        return left, right


def _column(noises: Sequence[WheelNoise], name: str) -> NDArray[np.float64]:
    """One setting of all robots, left and right: (n, 2)."""
    return np.array([getattr(noise, name) for noise in noises], dtype=np.float64).reshape(-1, 2)
