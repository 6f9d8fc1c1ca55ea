"""Start poses: drawn from the seed alone, uniform, and without overlap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import ConfigError
from vsense.config.experiment import load
from vsense.config.placement import MIN_GAP_M, Footprint, of_entity, of_robot, settle
from vsense.config.specs import Experiment, Pose
from vsense.world.entities import Box, Cylinder, Entity, Light
from vsense.world.robot_models import EPUCK

Read = Callable[..., Experiment]


def footprint(entity: Entity) -> Footprint:
    found = of_entity(entity)
    assert found is not None
    return found


def place(experiment: Experiment, seed: int) -> dict[int, Pose]:
    """The settled poses of all robots and objects, by tag."""
    settled = settle(experiment, seed)
    bodies = (*settled.robots, *settled.objects)
    return {body.tag: body.pose for body in bodies if body.pose is not None}


@pytest.fixture(scope="module")
def pollutant() -> Experiment:
    return load("pollutant")


@given(st.integers(0, 2**32 - 1))
def test_the_same_seed_gives_the_same_poses_and_no_two_bodies_overlap(
    pollutant: Experiment, seed: int
) -> None:
    poses = place(pollutant, seed)
    assert poses == place(pollutant, seed)
    assert sorted(poses) == sorted(b.tag for b in (*pollutant.robots, *pollutant.objects))
    for a, b in itertools.combinations(poses.values(), 2):
        assert math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) >= 2 * EPUCK.radius_m + MIN_GAP_M
    for pose in poses.values():
        assert abs(pose.x_m) <= 1.48 - EPUCK.radius_m - MIN_GAP_M + 1e-12
        assert abs(pose.y_m) <= 1.18 - EPUCK.radius_m - MIN_GAP_M + 1e-12
        assert -math.pi < pose.yaw_rad <= math.pi


def test_poses_are_uniform_over_arena_and_circle(pollutant: Experiment) -> None:
    poses = np.array([place(pollutant, s)[r.tag] for s in range(200) for r in pollutant.robots])
    for column, half in ((0, 1.44), (1, 1.14), (2, math.pi)):
        shares, _ = np.histogram(poses[:, column], bins=6, range=(-half, half))
        # Six standard deviations of a binomial count; the polluter's own place costs 0.1 %.
        assert np.all(np.abs(shares - 500) < 6 * math.sqrt(3000 / 6 * 5 / 6))


def test_placed_poses_are_kept_and_distributed_ones_keep_away(
    read_text: Read, example: str
) -> None:
    experiment = read_text(example)
    poses = place(experiment, 3)
    assert poses[23] == experiment.robots[0].pose
    assert poses[22] == experiment.objects[1].pose
    for robot in experiment.robots[1:]:
        for box in experiment.boxes:
            apart_m = footprint(box).distance_to_point_m(*poses[robot.tag][:2])
            assert apart_m >= EPUCK.radius_m + MIN_GAP_M


def test_bodies_that_the_file_places_into_each_other_are_refused(
    read_text: Read, example: str
) -> None:
    experiment = read_text(example.replace('"0.5,-0.5,0"', '"0.05,0,0"'))
    with pytest.raises(ConfigError, match=r"x\.argos:29: 'epuck_23_30'.*body"):
        place(experiment, 1)
    experiment = read_text(example.replace('"0.5,-0.5,0"', '"1.05,0.5,0"'))
    with pytest.raises(ConfigError, match="overlaps with box 'crate'"):
        place(experiment, 1)


def test_bodies_that_touch_are_accepted(read_text: Read, example: str) -> None:
    place(read_text(example.replace('"0.5,-0.5,0"', '"0.07,0,0"')), 1)


def test_a_robot_without_room_is_refused_at_its_entity(read_text: Read, example: str) -> None:
    text = example.replace('max="1.4,1.1,0"', 'max="-1.3,-1.0,0"')
    with pytest.raises(ConfigError, match=r"x\.argos:36: <entity> max_trials:.*'swarm_"):
        for seed in range(5):
            place(read_text(text), seed)


def test_every_method_of_drawing(read_text: Read, example: str) -> None:
    text = example.replace(
        '"uniform" min="-1.4,-1.1,0" max="1.4,1.1,0"', '"gaussian" mean="0,0,0" std_dev="0.5,0.4,0"'
    ).replace('"gaussian" mean="0,0,0" std_dev="360,0,0"', '"constant" values="90,0,0"')
    poses = place(read_text(text), 1)
    assert all(poses[tag].yaw_rad == pytest.approx(math.pi / 2) for tag in (5, 6, 7))


@given(
    st.floats(-math.pi, math.pi),
    st.floats(-2, 2),
    st.floats(-2, 2),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_box_distance_agrees_with_the_nearest_of_many_points(
    yaw: float, x: float, y: float, box_x: float, box_y: float
) -> None:
    box = Box("b", (box_x, box_y, 0.0), (0.6, 0.4, 0.1), yaw)
    u, v = np.meshgrid(np.linspace(-0.3, 0.3, 61), np.linspace(-0.2, 0.2, 41))
    px = box_x + u * math.cos(yaw) - v * math.sin(yaw)
    py = box_y + u * math.sin(yaw) + v * math.cos(yaw)
    nearest = np.hypot(px - x, py - y).min()
    distance = footprint(box).distance_to_point_m(x, y)
    assert nearest - 0.0075 <= distance <= nearest + 1e-12


@given(
    st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi), st.floats(-1, 1), st.floats(-1, 1)
)
def test_two_boxes_are_apart_where_no_point_of_one_is_near_the_other(
    yaw: float, other_yaw: float, x: float, y: float
) -> None:
    one = footprint(Box("a", (0, 0, 0), (0.6, 0.2, 0.1), yaw))
    other = footprint(Box("b", (x, y, 0), (0.3, 0.1, 0.1), other_yaw))
    u, v = np.meshgrid(np.linspace(-0.15, 0.15, 31), np.linspace(-0.05, 0.05, 11))
    px = x + u * math.cos(other_yaw) - v * math.sin(other_yaw)
    py = y + u * math.sin(other_yaw) + v * math.cos(other_yaw)
    nearest = min(one.distance_to_point_m(*p) for p in zip(px.ravel(), py.ravel()))
    assert one.distance_m(other) == pytest.approx(other.distance_m(one))
    # Of boxes that face each other with corners the gap is the smaller number, by 1 / sqrt(2).
    assert one.distance_m(other) <= nearest + 1e-9
    assert max(one.distance_m(other), 0.0) >= nearest / math.sqrt(2) - 0.011


def test_discs_and_heights() -> None:
    robot = of_robot("r", Pose(0.0, 0.0, 0.0))
    pillar = footprint(Cylinder("c", (0.3, 0.0, 0.0), 0.1, 0.2))
    assert robot.distance_m(pillar) == pytest.approx(0.3 - 0.1 - EPUCK.radius_m)
    beam = footprint(Box("b", (0.0, 0.0, 0.5), (1.0, 0.1, 0.1)))
    assert robot.distance_m(beam) == math.inf  # it hangs above
    assert of_entity(Light("l", (0.0, 0.0, 0.0))) is None


CROWD = """
  <distribute>
    <position method="{}" />
    <orientation method="constant" values="90,0,0" />
    <entity quantity="4" max_trials="500"><{} /></entity>
  </distribute></arena>"""
KINDS = (
    'box id="b" size="0.1,0.2,0.1" movable="false"',
    'cylinder id="c" radius="0.08" height="0.1" movable="false"',
    'cylinder id="c" radius="0.08" height="0.1" movable="false" vs:physical="true"',
    'light id="l" intensity="2"',
    'vs:zone id="z" shape="circle" radius="0.1"',
    'e-puck id="ghost" vs:virtual="true"',
    'vs:object id="thing"',
    'vs:object id="thing"',
)
ROOM = 'uniform" min="-1.4,-1.1,0.2" max="1.4,1.1,0.4'


def with_crowd(example: str, kind: str, position: str = ROOM) -> str:
    return example.replace("</arena>", CROWD.format(position, kind))


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_is_distributed_finds_the_place_that_the_seed_says(
    read_text: Read, example: str, kind: str
) -> None:
    experiment = read_text(with_crowd(example, kind))
    settled = settle(experiment, 5)
    assert settled == settle(experiment, 5) != settle(experiment, 6)
    assert settled.distributed == ()
    assert len(settled.entities) == len(experiment.entities) + len(experiment.distributed)
    assert settle(settled, 99) == settled
    assert place(settled, 99) == place(experiment, 5)
    placed = [of_entity(entity) for entity in settled.entities]
    bodies = [f for f in placed if f] + [
        of_robot(str(tag), pose) for tag, pose in place(settled, 1).items()
    ]
    drawn = bodies[2:]  # the wall and the crate stand where the file says
    for a, b in itertools.combinations(drawn, 2):
        assert a.distance_m(b) >= min(MIN_GAP_M, 0.0) - 1e-9


def test_what_stands_in_the_real_arena_stays_on_the_floor(read_text: Read, example: str) -> None:
    virtual, physical = (settle(read_text(with_crowd(example, KINDS[i])), 2) for i in (1, 2))
    assert all(e.position_m[2] > 0.1 for e in virtual.entities if isinstance(e, Cylinder))
    assert [c.position_m[2] for c in physical.cylinders] == [0.0] * 4
    assert any("z does not count" in w for w in read_text(with_crowd(example, KINDS[2])).warnings)


def test_a_grid_is_filled_from_its_corner_as_in_argos(read_text: Read, example: str) -> None:
    grid = 'grid" center="0.5,0.4,0" distances="0.3,0.2,0" layout="2,3,1'
    entities = settle(read_text(with_crowd(example, KINDS[3], grid)), 1).entities
    lights = [entity for entity in entities if isinstance(entity, Light)]
    expected = [(0.65, 0.6), (0.35, 0.6), (0.65, 0.4), (0.35, 0.4)]
    assert [light.position_m[:2] for light in lights] == [pytest.approx(p) for p in expected]
    with pytest.raises(ConfigError, match=r"layout: .*2 places.*4"):
        read_text(with_crowd(example, KINDS[3], grid.replace("2,3,1", "2,1,1")))


def test_a_grid_place_that_is_taken_is_refused_at_once(read_text: Read, example: str) -> None:
    grid = 'grid" center="1,0.5,0" distances="0.3,0.2,0" layout="1,4,1'
    experiment = read_text(with_crowd(example, KINDS[0], grid))
    with pytest.raises(ConfigError, match=r"'b\d'.*1.*'crate'"):
        settle(experiment, 1)


def test_robots_that_a_tracker_finds_are_in_nobodys_way(read_text: Read, example: str) -> None:
    text = with_crowd(example, KINDS[0]).replace('"0.5,-0.5,0"', '"0,0,0"')
    experiment = read_text(text)
    with pytest.raises(ConfigError, match="overlaps"):
        settle(experiment, 1)
    settled = settle(experiment, 1, real=False)
    assert settled.robots == experiment.robots
    assert settled.objects == experiment.objects
    assert settled.distributed == ()


@pytest.mark.parametrize("kind", KINDS)
def test_a_crowd_may_be_of_one(read_text: Read, example: str, kind: str) -> None:
    one = with_crowd(example, kind).replace('quantity="4"', 'quantity="1"')
    with_one, without = read_text(one), read_text(example)
    counts = [len(e.distributed) + len(e.objects) for e in (with_one, without)]
    assert counts[0] == counts[1] + 1
