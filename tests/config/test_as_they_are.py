"""Files of ARGoS as they are: what its parser takes, parked robots, solid boxes, slow clocks."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from vsense.base.errors import ConfigError
from vsense.config.experiment import read
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Stage
from vsense.run.environment import physics_of
from vsense.world.loop_functions import LoopFunctionsError
from vsense.world.robot_models import EPUCK

PLAIN = """<?xml version="1.0" ?>
<argos-configuration>
  <framework>
    <experiment length="5" ticks_per_second="10" random_seed="3" />
  </framework>
  <controllers>
    <mine id="mine" library="mine.c">
      <actuators><epuck_wheels implementation="default" /></actuators>
      <sensors><epuck_proximity implementation="default" /></sensors>
    </mine>
  </controllers>
  <arena size="2,2,1">
    <box id="north" size="1,0.02,0.1" movable="false">
      <body position="0,0.3,0" orientation="0,0,0" />
    </box>
    <box id="south" size="1,0.02,0.1" movable="false">
      <body position="0,-0.3,0" orientation="0,0,0" />
    </box>
    <cylinder id="post" radius="0.05" height="0.1" movable="false">
      <body position="0.4,0,0" orientation="0,0,0" />
    </cylinder>
    <e-puck id="fb0"><body position="0,0,0" orientation="90,0,0" /><controller config="mine" />
    </e-puck>
  </arena>
  <physics_engines><dynamics2d id="dyn2d" /></physics_engines>
</argos-configuration>
"""
ROBOT = PLAIN[PLAIN.index("<e-puck") : PLAIN.index("  </arena>")]
PARKED = PLAIN.replace(ROBOT, "".join(ROBOT.replace("fb0", f"fb{i}") for i in range(12)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("plain")
    (place / "mine.c").touch()
    return place


def loaded(folder: Path, text: str, stage: Stage = Stage.SIM) -> Experiment:
    return read(text.encode(), "x.argos", folder / "x.argos", stage=stage)


def told(experiment: Experiment) -> str:
    return "\n".join(experiment.warnings)


def line_of(text: str, words: str) -> int:
    return text[: text.index(words)].count("\n") + 1


@pytest.mark.parametrize("comment", ["a -- b", "--", "- - -", " <e-puck id='x'> -- \n -", "-"])
def test_dashes_in_comments_are_taken_as_by_tinyxml(folder: Path, comment: str) -> None:
    text = PLAIN.replace("<arena", f"<!--{comment}--><arena")
    assert told(loaded(folder, text, Stage.RUN)).count("wear") == 1
    # Lines are counted as before.
    robot = loaded(folder, text).robots[0]
    assert robot.line == line_of(text, '<e-puck id="fb0"')


def test_text_between_the_elements_is_told_with_its_line(folder: Path) -> None:
    text = PLAIN.replace("<arena", "<!-- a\n b -->\n left over\n behind --><arena")
    line = line_of(text, "left over")
    assert f"x.argos:{line}: text 'left over\\n behind -->' between the elements" in told(
        loaded(folder, text)
    )


def test_numbers_end_where_argos_stops_reading(folder: Path) -> None:
    text = PLAIN.replace('radius="0.05"', 'radius="0.05f"').replace('"0.4,0,0"', '"0.4,-0.1.8,0"')
    experiment = loaded(folder, text)
    assert experiment.cylinders[0].radius_m == 0.05
    assert experiment.cylinders[0].position_m == (0.4, -0.1, 0.0)
    assert "<cylinder> radius: '0.05f' is read as 0.05" in told(experiment)
    assert "<body> position: '-0.1.8' is read as -0.1" in told(experiment)
    with pytest.raises(ConfigError, match=r"'LENGTH'.*number"):
        loaded(folder, PLAIN.replace('length="5"', 'length="LENGTH"'))


def test_attributes_need_no_blank_between_them(folder: Path) -> None:
    text = PLAIN.replace('radius="0.05" height', "radius='0.05'height")
    assert loaded(folder, text).cylinders[0].height_m == 0.1


def test_a_floor_is_found_where_argos_is_started(folder: Path) -> None:
    inner = folder / "experiments"
    inner.mkdir(exist_ok=True)
    (inner / "mine.c").touch()
    picture = inner / "spot.png"
    cv2.imwrite(str(picture), np.zeros((2, 2, 3), dtype=np.uint8))
    floor = '<floor id="f" source="image" path="experiments/spot.png" /><cylinder'
    experiment = loaded(inner, PLAIN.replace("<cylinder", floor))
    assert experiment.floor is not None and experiment.floor.path is not None
    assert experiment.floor.path.samefile(picture)
    assert "<floor> path: 'experiments/spot.png' is not there, " in told(experiment)
    beside = loaded(inner, PLAIN.replace("<cylinder", floor.replace("experiments/", "")))
    assert beside.floor is not None and beside.floor.path == picture
    assert "is not there" not in told(beside)


def test_what_argos_passes_over_is_told_and_strict_refuses_it(folder: Path) -> None:
    text = PLAIN.replace(
        '<dynamics2d id="dyn2d" />',
        '<iridia_tracking_system id="its" topic="poses" its_host="10.0.0.2" /><box2d id="b" />',
    )
    text = text.replace('<body position="0,0,0"', "<dynamics2d id='x' /><body position=\"0,0,0\"")
    text = text.replace("<epuck_proximity", "<epuck_proximity nois_std_deviation='1.5'")
    experiment = loaded(folder, text)
    for words in (
        "<iridia_tracking_system> topic is not known here",
        "<box2d> is not supported: it is not known in <physics_engines>",
        "<dynamics2d> is not supported: robots move in one plane",
        "<epuck_proximity> nois_std_deviation is not known here: it has no effect",
    ):
        assert words in told(experiment)
    with pytest.raises(ConfigError, match=r"--strict"):
        experiment.refuse_warnings()


def test_settings_from_outside_must_be_known_even_so(folder: Path) -> None:
    with pytest.raises(ConfigError, match="velocity"):
        read(PLAIN.encode(), "x.argos", folder / "x.argos", None, {"epuck_proximity.velocity": "1"})


def test_a_file_with_our_own_names_is_read_strictly(folder: Path) -> None:
    ours = PLAIN.replace("<argos-configuration", '<argos-configuration xmlns:vs="urn:vsense:1"')
    ours = ours.replace('<e-puck id="fb0"', '<e-puck id="fb0" vs:tag="7" topic="x"')
    with pytest.raises(ConfigError, match=r"topic:.*attribute"):
        loaded(folder, ours)


@pytest.mark.parametrize("stage", [Stage.SIM, Stage.LAB])
def test_boxes_and_cylinders_of_such_a_file_are_solid(folder: Path, stage: Stage) -> None:
    experiment = loaded(folder, PLAIN, stage)
    assert [thing.id for thing in (*experiment.boxes, *experiment.cylinders)] == [
        "north", "south", "post",
    ]  # fmt: skip
    assert "virtual" not in told(experiment)
    physics = physics_of(settle(experiment, 1), 1)
    physics.drive(0, 500, 500, 1)
    physics.advance(20_000_000_000)
    assert physics.poses[0, 1] == pytest.approx(0.3 - 0.01 - EPUCK.radius_m, abs=1e-3)


def test_where_robots_are_real_only_walls_are_solid(folder: Path) -> None:
    experiment = loaded(folder, PLAIN, Stage.RUN)
    assert not experiment.boxes
    assert told(experiment).count("is virtual") == 3
    ours = PLAIN.replace("<argos-configuration", '<argos-configuration xmlns:vs="urn:vsense:1"')
    ours = ours.replace('id="north"', 'id="north" vs:physical="true"')
    assert [box.id for box in loaded(folder, ours).boxes] == ["north"]


@pytest.mark.parametrize(
    ("stage", "ticks", "loads"),
    [(Stage.SIM, 1, True), (Stage.SIM, 0, False), (Stage.LAB, 5, False), (Stage.RUN, 5, False)],
)
def test_slow_clocks_are_for_simulation(
    folder: Path, stage: Stage, ticks: int, loads: bool
) -> None:
    text = PLAIN.replace('ticks_per_second="10"', f'ticks_per_second="{ticks}"')
    if loads:
        assert loaded(folder, text, stage).timestep_s == 1.0
        return
    with pytest.raises(ConfigError, match="ticks_per_second") as caught:
        loaded(folder, text, stage)
    assert ("'vsense sim' takes 1 to 5" in str(caught.value)) == (stage is not Stage.SIM)


@pytest.mark.parametrize("stage", [Stage.SIM, Stage.LAB])
def test_robots_that_are_parked_on_one_place_are_placed_anew(folder: Path, stage: Stage) -> None:
    experiment = loaded(folder, PARKED, stage)
    line = line_of(PARKED, '<e-puck id="fb1"')
    tag = experiment.robots[0].tag
    words = f"<e-puck> 'fb1' overlaps with the body with tag {tag}, and 10 more like it"
    assert f"x.argos:{line}: {words}: the seed says where near by they stand" in told(experiment)
    settled = settle(experiment, 4)
    assert settle(experiment, 4) == settled != settle(experiment, 5)
    poses = [robot.pose for robot in settled.robots]
    assert all(pose is not None for pose in poses)
    places = [(pose.x_m, pose.y_m) for pose in poses if pose is not None]
    assert places[0] == (0.0, 0.0)
    for number, place in enumerate(places):
        # Between the two walls, like the place in the file, and beside the post.
        assert abs(place[1]) < 0.29 - EPUCK.radius_m
        assert math.dist(place, (0.4, 0.0)) > 0.05 + EPUCK.radius_m
        for other in places[:number]:
            assert math.dist(place, other) > 2.0 * EPUCK.radius_m
    assert len({pose.yaw_rad for pose in poses if pose is not None}) == 12


def test_robots_that_are_placed_anew_stand_around_their_place_in_the_file(folder: Path) -> None:
    text = PARKED.replace('"0,0,0" orientation', '"-0.6,0.1,0" orientation')
    poses = [robot.pose for robot in settle(loaded(folder, text), 4).robots]
    places = np.array([(pose.x_m, pose.y_m) for pose in poses if pose is not None])
    assert len(places) == 12
    assert np.median(places, axis=0) == pytest.approx((-0.6, 0.1), abs=0.15)
    assert 0.1 < np.hypot(*(places - (-0.6, 0.1)).T).max() < 0.5


def test_a_robot_that_only_touches_another_keeps_its_heading(folder: Path) -> None:
    text = PARKED.replace(ROBOT.replace("fb0", "fb5"), ROBOT.replace("fb0", "fb5").replace(
        '"0,0,0" orientation="90', '"0.05,0,0" orientation="30'))  # fmt: skip
    robot = settle(loaded(folder, text), 1).robots[5]
    assert robot.pose is not None
    assert robot.pose.yaw_rad == pytest.approx(math.radians(30.0))


def test_real_robots_stand_where_they_stand(folder: Path) -> None:
    experiment = loaded(folder, PARKED, Stage.RUN)
    assert "overlaps" not in told(experiment)
    assert settle(experiment, 1, real=False).robots == experiment.robots


def test_without_room_the_robot_is_refused_at_its_line(folder: Path) -> None:
    text = PARKED.replace('size="2,2,1"', 'size="0.15,0.15,1"')
    for name in ("north", "south", "post"):
        start = text.index(f'id="{name}"')
        start = text.rindex("<", 0, start)
        kind = "cylinder" if name == "post" else "box"
        end = text.index(f"</{kind}>", start) + len(f"</{kind}>")
        text = text[:start] + "\n" * text[start:end].count("\n") + text[end:]
    with pytest.raises(ConfigError, match=r"'fb1'.*room"):
        settle(loaded(folder, text), 1)


def test_a_file_whose_loop_functions_add_the_robots_says_what_to_write(folder: Path) -> None:
    text = PLAIN.replace(ROBOT, "").replace(
        "<arena", '<loop_functions library="build/libcrowd.so" label="crowd" rows="2" /><arena'
    )
    with pytest.raises(ConfigError, match=r"<distribute> .*space\.add_robot\("):
        loaded(folder, text)
    port = folder / "libcrowd"
    port.mkdir(exist_ok=True)
    (port / "mine.c").touch()
    (port / "crowd.py").write_text(CROWD)
    experiment = loaded(port, text)
    assert [robot.id for robot in experiment.robots] == ["ep0", "ep1", "ep2", "ep3"]
    assert experiment.robots[3].pose == pytest.approx((0.3, 0.2, math.pi / 2))
    # They are drawn from the file's seed, and those that overlap are placed anew.
    assert loaded(port, text).robots == experiment.robots
    settle(experiment, 1)
    (port / "crowd.py").write_text(CROWD.replace('"mine"', '"nobody"'))
    with pytest.raises(ConfigError, match="controller 'nobody'"):
        loaded(port, text)
    (port / "crowd.py").write_text(CROWD.replace("0.1 * i, 0.2", "9, 9"))
    with pytest.raises(LoopFunctionsError, match=r"crowd\.py:3:.*arena"):
        loaded(port, text)


CROWD = """def populate(space):
    for i in range(2 * int(space.params["rows"])):
        space.add_robot(f"ep{i}", "mine", 0.1 * i, 0.2, 1.5707963267948966)
    assert space.random.random() == space.random.__class__(3).random()
"""
