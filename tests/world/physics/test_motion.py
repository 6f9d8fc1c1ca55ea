"""The lab's physics: closed forms, no overlaps, plausible pushes, symmetry."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.world.physics.motion import NoisyWheels, Physics, WheelNoise
from vsense.world.physics.proximity_ring import ProximityRing
from vsense.world.robot_models import EPUCK, RingModel, RobotModel
from vsense.world.sensors.quality import generator

TICK_NS = 10_000_000
FULL_M_S = EPUCK.max_steps_s * EPUCK.step_m
speeds = st.integers(-EPUCK.max_steps_s, EPUCK.max_steps_s)
yaws = st.floats(-math.pi, math.pi)
seeds = st.integers(0, 2**32 - 1)
WALLS = [[0.4, 0, 0, 0.01, 1], [-0.4, 0, 0, 0.01, 1], [0, 0.4, 0, 1, 0.01], [0, -0.4, 0.2, 1, 0.01]]


def real_speed_m_s(commanded: int) -> float:
    """Speed of a wheel: the motor library counts the time of a step in ticks of 0.1 ms.

    Source: epuck.md 1.6.
    """
    ticks = 10_000 // abs(commanded) if commanded else math.inf
    return math.copysign(10_000 / ticks, commanded) * EPUCK.step_m


def box_gap_m(place: np.ndarray, row: list[float]) -> float:
    """Distance of a point to the outline of a box, negative inside."""
    x, y, yaw, size_x, size_y = row
    turned = complex(place[0] - x, place[1] - y) * cmath.exp(-1j * yaw)
    beyond = abs(turned.real) - size_x / 2, abs(turned.imag) - size_y / 2
    return math.hypot(max(beyond[0], 0.0), max(beyond[1], 0.0)) + min(max(beyond), 0.0)


def run(physics: Physics, ticks: int, start_ns: int = 0) -> None:
    for tick in range(1, ticks + 1):
        physics.tick(start_ns + tick * TICK_NS)


def alone(yaw_rad: float = 0.0) -> Physics:
    return Physics([[0.1, -0.2, yaw_rad]], [], [], 0)


def crowd(seed: int, robots: int, half_m: float = 0.28) -> np.ndarray:
    """Poses (robots, 3) drawn in a square without overlaps."""
    random = np.random.default_rng(seed)
    poses: list[np.ndarray] = []
    while len(poses) < robots:
        pose = random.uniform(-1, 1, 3) * (half_m, half_m, math.pi)
        if all(np.hypot(*(pose - other)[:2]) > 2 * EPUCK.radius_m for other in poses):
            poses.append(pose)
    return np.array(poses)


def worst_overlap_m(physics: Physics, rows: list[list[float]]) -> float:
    """Deepest overlap between any two bodies, or a body and a box."""
    places = physics.poses[:, :2]
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, 1.0)
    to_box = min((box_gap_m(place, row) for place in places for row in rows), default=1.0)
    return max(2 * EPUCK.radius_m - apart.min(), EPUCK.radius_m - to_box)


@pytest.mark.parametrize(
    ("commanded", "real"),
    [(0, 0), (1, 1), (600, 625), (700, 714.2857), (900, 909.0909), (1000, 1000), (1500, 1000)],
)
def test_the_stepper_quantises(commanded, real) -> None:
    for sign in (1, -1):
        physics = Physics([[0, 0, 0]], [], [], 0)
        physics.drive(0, sign * commanded, sign * commanded, 0)
        run(physics, 10)
        np.testing.assert_allclose(
            physics.poses, [[sign * real * EPUCK.step_m / 10, 0, 0]], atol=1e-7
        )


@given(yaws, st.integers(1, EPUCK.max_steps_s), st.integers(1, 300))
def test_equal_speeds_drive_straight(yaw, speed, ticks) -> None:
    physics = alone(yaw)
    physics.drive(0, speed, speed, 0)
    run(physics, ticks)
    way = real_speed_m_s(speed) * ticks * 0.01
    expected = [0.1 + way * math.cos(yaw), -0.2 + way * math.sin(yaw)]
    np.testing.assert_allclose(physics.poses[0, :2], expected, atol=1e-9)
    assert math.cos(physics.poses[0, 2] - yaw) == pytest.approx(1.0)


@given(yaws, speeds, speeds, st.integers(1, 300))
def test_unequal_speeds_drive_an_exact_arc(yaw, left, right, ticks) -> None:
    """Closed form around the centre of rotation, in the complex plane."""
    slow, fast = real_speed_m_s(left), real_speed_m_s(right)
    if slow == fast:
        return
    physics = alone(yaw)
    physics.drive(0, left, right, 0)
    run(physics, ticks)
    radius = EPUCK.axle_m / 2 * (fast + slow) / (fast - slow)
    turn = (fast - slow) / EPUCK.axle_m * ticks * 0.01
    centre = complex(0.1, -0.2) + radius * 1j * cmath.exp(1j * yaw)
    expected = centre - radius * 1j * cmath.exp(1j * (yaw + turn))
    np.testing.assert_allclose(physics.poses[0, :2], [expected.real, expected.imag], atol=1e-7)
    assert cmath.exp(1j * (yaw + turn)) == pytest.approx(cmath.exp(1j * physics.poses[0, 2]))
    assert -math.pi < physics.poses[0, 2] <= math.pi


@given(speeds, speeds, speeds, speeds, st.integers(1, TICK_NS - 1))
def test_speeds_change_at_their_time_inside_a_tick(
    left, right, then_left, then_right, at_ns
) -> None:
    inside, at_a_tick = alone(), alone()
    for physics in (inside, at_a_tick):
        physics.drive(0, left, right, 0)
    at_a_tick.tick(at_ns)
    for physics in (inside, at_a_tick):
        physics.drive(0, then_left, then_right, at_ns)
        physics.tick(TICK_NS)
    np.testing.assert_allclose(inside.poses, at_a_tick.poses, atol=1e-12)


def test_a_command_from_before_the_last_tick_changes_no_past() -> None:
    late, punctual = alone(), alone()
    for physics in (late, punctual):
        physics.tick(TICK_NS)
    late.drive(0, 500, 700, TICK_NS // 2)
    punctual.drive(0, 500, 700, TICK_NS)
    for physics in (late, punctual):
        physics.tick(2 * TICK_NS)
    np.testing.assert_array_equal(late.poses, punctual.poses)


@settings(max_examples=25)
@given(seeds, st.integers(2, 20))
def test_nobody_gets_into_anybody(seed, robots) -> None:
    random = np.random.default_rng(seed)
    poses = crowd(seed, robots + 1)
    physics = Physics(poses[:robots], poses[robots:], WALLS, 0)
    for tick in range(60):
        if tick % 20 == 0:
            for robot, (left, right) in enumerate(random.integers(-1000, 1001, (robots, 2))):
                physics.drive(robot, int(left), int(right), tick * TICK_NS)
        physics.tick((tick + 1) * TICK_NS)
        assert worst_overlap_m(physics, WALLS) < 1e-4
    np.testing.assert_array_equal(
        physics.poses[robots], Physics([], poses[robots:], [], 0).poses[0]
    )


@settings(max_examples=10)
@given(seeds)
def test_a_crowd_that_presses_into_a_corner_stays_apart(seed) -> None:
    poses = crowd(seed, 15, half_m=0.25)
    poses[:, 2] = np.arctan2(0.4 - poses[:, 1], 0.4 - poses[:, 0])
    physics = Physics(poses, [], WALLS, 0)
    for robot in range(15):
        physics.drive(robot, 1000, 1000, 0)
    for tick in range(1, 200):
        physics.tick(tick * TICK_NS)
        assert worst_overlap_m(physics, WALLS) < 1e-4


@settings(max_examples=30)
@given(seeds, yaws, speeds, speeds)
def test_alone_a_robot_never_outruns_its_wheels(seed, yaw, left, right) -> None:
    """Walls and posts only ever take away from its motion."""
    random = np.random.default_rng(seed)
    posts = [
        [*(0.14 * np.array([math.cos(a), math.sin(a)])), random.uniform(0, 3), 0.03, 0.12]
        for a in np.arange(5) * 2 * math.pi / 5
    ]
    physics = Physics([[0, 0, yaw]], [[0.0, 0.0705, 0.0]], posts, 0)
    physics.drive(0, left, right, 0)
    ahead = abs(real_speed_m_s(left) + real_speed_m_s(right)) / 2 * 0.01
    for tick in range(1, 150):
        before = physics.poses[0, :2].copy()
        physics.tick(tick * TICK_NS)
        assert np.hypot(*(physics.poses[0, :2] - before)) <= ahead + 2e-5


def test_a_robot_pressed_against_a_wall_slides_along_it() -> None:
    physics = Physics([[0, 0, math.pi / 4]], [], [[0.04, 0, 0, 0.01, 4]], 0)
    physics.drive(0, 1000, 1000, 0)
    run(physics, 100)
    expected = [0, FULL_M_S * math.sqrt(0.5), math.pi / 4]
    np.testing.assert_allclose(physics.poses[0], expected, atol=1e-4)


def test_a_robot_pressed_against_a_wall_turns_on_the_spot() -> None:
    physics = Physics([[0, 0, 0]], [], [[0.04, 0, 0, 0.01, 4]], 0)
    physics.drive(0, 250, -250, 0)
    run(physics, 100)
    np.testing.assert_allclose(
        physics.poses[0], [0, 0, -500 * EPUCK.step_m / EPUCK.axle_m], atol=1e-9
    )


def test_a_robot_stops_at_an_object() -> None:
    physics = Physics([[0, 0, 0]], [[0.2, 0, 0]], [], 0)
    physics.drive(0, 1000, 1000, 0)
    run(physics, 300)
    np.testing.assert_allclose(physics.poses[0], [0.2 - 2 * EPUCK.radius_m, 0, 0], atol=1e-4)
    np.testing.assert_array_equal(physics.poses[1], [0.2, 0, 0])


def test_a_standing_robot_is_pushed_slowly_and_only_while_pushed() -> None:
    physics = Physics([[0, 0, 0], [2 * EPUCK.radius_m, 0, 0]], [], [], 0)
    physics.drive(0, 1000, 1000, 0)
    run(physics, 100)
    pushed_m = physics.poses[1, 0] - 2 * EPUCK.radius_m
    assert pushed_m == pytest.approx(FULL_M_S / 5, rel=0.02)
    physics.drive(0, -1000, -1000, 100 * TICK_NS)
    physics.tick(101 * TICK_NS)
    resting = physics.poses[1].copy()
    run(physics, 50, 101 * TICK_NS)
    np.testing.assert_array_equal(physics.poses[1], resting)


def test_two_that_drive_at_each_other_stand_still() -> None:
    physics = Physics([[-0.05, 0, 0], [0.05, 0, math.pi]], [], [], 0)
    physics.drive(0, 800, 800, 0)
    physics.drive(1, 800, 800, 0)
    run(physics, 200)
    np.testing.assert_allclose(physics.poses[:, :2], [[-0.035, 0], [0.035, 0]], atol=1e-4)


@settings(max_examples=20)
@given(seeds)
def test_a_mirrored_scene_goes_the_mirrored_way(seed) -> None:
    random = np.random.default_rng(seed)
    poses, flip = crowd(seed, 10, half_m=0.2), np.array([1, -1, -1])
    walls = np.array([[0.25, 0, 0.1, 0.01, 1], [0, 0.3, 0.4, 1, 0.01], [-0.25, 0, 0, 0.01, 1]])
    here = Physics(poses[:9], poses[9:], walls, 0)
    there = Physics(poses[:9] * flip, poses[9:] * flip, walls * [1, -1, -1, 1, 1], 0)
    for robot, (left, right) in enumerate(random.integers(-1000, 1001, (9, 2)).tolist()):
        here.drive(robot, left, right, 0)
        there.drive(robot, right, left, 0)
    for physics in (here, there):
        run(physics, 100)
    np.testing.assert_allclose(there.poses[:, :2], (here.poses * flip)[:, :2], atol=1e-6)
    np.testing.assert_allclose(np.cos(there.poses[:, 2] + here.poses[:, 2]), 1.0, atol=1e-9)


@settings(max_examples=5)
@given(seeds)
def test_the_same_calls_give_the_same_poses(seed) -> None:
    def once() -> bytes:
        physics = Physics(crowd(seed, 12), [], WALLS, 0)
        for robot in range(12):
            physics.drive(robot, 50 * robot, 600, 1_234_567 * robot % TICK_NS)
        run(physics, 80)
        return physics.poses.tobytes()

    assert once() == once()


@pytest.mark.parametrize("radius_m", [0.01, 0.035, 0.3])
def test_a_robot_stops_at_a_cylinder_of_any_size(radius_m: float) -> None:
    physics = Physics([[0, 0, 0]], [], [], 0, [[0.5, 0, radius_m]])
    physics.drive(0, 1000, 1000, 0)
    run(physics, 500)
    np.testing.assert_allclose(physics.poses, [[0.465 - radius_m, 0, 0]], atol=1e-4)
    np.testing.assert_array_equal(physics.bodies[1], [0.5, 0, 0])


@settings(max_examples=10)
@given(seeds, st.integers(1, 95_000_000))
def test_to_advance_is_to_tick_on_the_grid(seed, time_ns) -> None:
    """However the way there is cut, ticks lie on multiples of 10 ms and at its end."""
    one, other = (Physics(crowd(seed, 10), [], WALLS, 0) for _ in range(2))
    commands = np.random.default_rng(seed).integers(-1000, 1001, (10, 2)).astype(np.int16)
    one.drive_all(commands, 0)
    for robot, (left, right) in enumerate(commands.tolist()):
        other.drive(robot, left, right, 0)
    one.advance(time_ns)
    one.advance(time_ns)
    for tick_ns in range(TICK_NS, time_ns, TICK_NS):
        other.tick(tick_ns)
    other.tick(time_ns)
    np.testing.assert_array_equal(one.poses, other.poses)


def test_a_robot_that_is_put_in_drives_as_it_is_built() -> None:
    built = (1.02, 0.97, 0.0535)
    poses = [[0.0, 0.0, 0.3], [0.0, 0.5, 0.3]]
    meant = Physics(poses, [], [], 0, built=np.array([built, (1.0, 1.0, EPUCK.axle_m)]))
    nominal, rebuilt = Physics(poses, [], [], 0), Physics(poses, [], [], 0)
    rebuilt.rebuild(0, built)
    for physics in (meant, nominal, rebuilt):
        for robot in range(2):
            physics.drive(robot, 400, 300, 0)
        for tick in range(1, 101):
            physics.tick(tick * TICK_NS)
    assert (rebuilt.poses == meant.poses).all()
    assert (rebuilt.poses[0] != nominal.poses[0]).all()


shares = st.floats(-2.0, 2.0)
both = st.tuples(shares, shares)
noises = st.builds(WheelNoise, both.map(np.abs), both, both.map(np.abs), both, both.map(np.abs))


@given(
    st.lists(st.none() | noises, min_size=1, max_size=5),
    seeds,
    st.lists(st.sampled_from([0, 0, 1, -7, 400, -1000]) | speeds, min_size=10, max_size=10),
)
def test_wheels_slip_as_in_numpy(
    models: list[WheelNoise | None], seed: int, told: list[int]
) -> None:
    """The same bits, from the same numbers drawn; NoisyWheels says which formula."""

    def column(name: str) -> np.ndarray:
        return np.array([getattr(model or WheelNoise(), name) for model in models])

    wheels, random, shape = NoisyWheels(models, seed), generator(seed, "wheels"), (len(models), 2)
    bias = column("bias_m_s") + column("bias_dev_m_s") * random.normal(size=shape)
    commands = np.array(told, dtype=np.int16).reshape(-1, 2)[: len(models)]
    for _ in range(2):
        drawn = commands * (1.0 + column("relative") * random.normal(size=shape))
        factor = column("factor") + column("factor_dev") * random.normal(size=shape)
        turning = (commands != 0).any(axis=1)[:, None]
        expected = np.rint(np.where(turning, factor * (drawn + bias / EPUCK.step_m), drawn))
        expected = np.clip(expected, -EPUCK.max_steps_s, EPUCK.max_steps_s)
        quiet = not any(models)
        assert (wheels.apply(commands) == (commands if quiet else expected)).all()


def test_a_wheel_is_as_fast_as_its_model_says() -> None:
    fast, quick = heavy(max_steps_s=2000), heavy(acceleration_m_s2=0.5)
    physics = Physics([[0, 0, 0], [0, 1, 0], [0, 2, 0]], [], [], 0, models=[EPUCK, fast, quick])
    physics.drive_all(np.full((3, 2), 1500, dtype=np.int16), 0)
    physics.advance(1_000_000_000)
    way = 1500 * fast.step_m
    assert physics.poses[0, 0] == pytest.approx(1000 * EPUCK.step_m)
    assert physics.poses[1, 0] == pytest.approx(way)
    top_m_s = 1000 * quick.step_m
    # It gains 5 mm/s before each tick of 10 ms.
    gained = np.minimum(0.005 * np.arange(1, 101), top_m_s)
    assert physics.poses[2, 0] == pytest.approx(0.01 * gained.sum(), rel=1e-9)


def test_the_heavier_of_two_robots_gives_way_less() -> None:
    model = heavy(radius_m=0.1, mass_kg=10.0 * EPUCK.mass_kg)
    physics = Physics([[0, 0, 0], [0.12, 0, 0]], [], [], 0, models=[EPUCK, model])
    physics.tick(10_000_000)
    small, large = -physics.poses[0, 0], physics.poses[1, 0] - 0.12
    assert small + large == pytest.approx(EPUCK.radius_m + 0.1 - 0.12, abs=1e-5)
    assert small / large == pytest.approx(10.0, rel=1e-6)


def test_a_large_robot_is_felt_where_its_rim_is() -> None:
    wide = heavy(radius_m=0.3)
    physics = Physics([[0, 0, 0], [0.34, 0, 0]], [], [], 0, models=[EPUCK, wide])
    proximity = ProximityRing(physics.near, 1, models=physics.models)
    far, _ = proximity.distances(physics.bodies)
    # The rim is 0.04 m ahead of the middle, and ps0 and ps7 sit 0.03 m before it.
    assert far[[0, 7]].min() == pytest.approx(0.01, abs=0.002)
    blind = ProximityRing(physics.near, 1, models=[replace(EPUCK, ring=RingModel()), wide])
    assert (blind.read(physics.bodies)[0] == 0).all() and (proximity.read(physics.bodies) > 0).all()


def heavy(**changes: float) -> RobotModel:
    """An e-puck that is somewhat different, without its motors' timer."""
    return replace(EPUCK, timer_hz=0, **changes)
