"""`<vs:geofence>`: what is read of it, what is refused, and depths in polygons."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from vsense.base.errors import ConfigError
from vsense.config.casting import Casting
from vsense.config.experiment import SHIPPED_FOLDER, load, read
from vsense.config.geofence import MAX_SPEED_M_S, Polygon
from vsense.config.specs import Experiment, Stage

Read = Callable[..., Experiment]

FENCE = """<vs:geofence polygon="-1,-1 1,-1 1,1 -1,1" v_max="0.05">
<vs:forbidden polygon="0.5,0.5 0.9,0.5 0.9,0.9" /><vs:keep_off tag="9" distance="0.5" />
</vs:geofence>"""


def fenced(example: str, fence: str = FENCE) -> str:
    """The example with a fence, which begins in line 40."""
    return example.replace("\n  </arena>", f"\n{fence}</arena>")


def test_what_the_file_says(read_text: Read, example: str) -> None:
    experiment = read_text(fenced(example))
    fence = experiment.geofence
    assert fence is experiment.fence and fence is not None
    assert fence.boundary.corners == ((-1, -1), (1, -1), (1, 1), (-1, 1))
    assert [zone.corners for zone in fence.forbidden] == [((0.5, 0.5), (0.9, 0.5), (0.9, 0.9))]
    assert (fence.keep_off, fence.v_max_m_s) == ({"lamp_9_0": 0.5}, 0.05)
    (controller,) = experiment.controllers
    assert controller.params_for("epuck_23_30") == "vs:v_max=0.050000\nalpha=0.5\nwheels.speed=3\n"


def test_without_it_the_fence_is_the_arena_and_no_speed_is_sent() -> None:
    for stage in Stage:
        experiment = load("pollutant", stage=stage)
        assert experiment.geofence is None
        assert experiment.fence.boundary.corners == experiment.arena.corners_m
        assert "v_max" not in experiment.controllers[0].params_for("any")


def test_a_part_of_it_may_be_left_out(read_text: Read, example: str) -> None:
    experiment = read_text(fenced(example, '<vs:geofence v_max="0.128" />'))
    assert experiment.fence.boundary.corners == experiment.arena.corners_m
    assert experiment.fence.v_max_m_s == 0.128


def test_a_simulation_says_that_it_holds_nobody(example: str, tmp_path) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "mine.c").touch()
    given = fenced(example).encode(), "x.argos", tmp_path / "x.argos"
    place = "x.argos:40: <vs:geofence> "
    (warning,) = [w for w in read(*given, stage=Stage.SIM).warnings if w.startswith(place)]
    assert "simulation" in warning
    for stage in (Stage.RUN, Stage.LAB):
        assert not [w for w in read(*given, stage=stage).warnings if w.startswith(place)]


@pytest.mark.parametrize(
    ("before", "after", "line", "attribute", "value"),
    [
        ('"-1,-1 1,-1 1,1 -1,1"', '"-1,-1 1,-1"', 40, "<vs:geofence> polygon", "2 points"),
        ('"-1,-1 1,-1 1,1 -1,1"', '""', 40, "<vs:geofence> polygon", "empty"),
        ('"-1,-1 1,-1 1,1 -1,1"', '"-1,-1 1,1 1,-1 -1,1"', 40, "<vs:geofence> polygon", "meet"),
        ('"-1,-1 1,-1 1,1 -1,1"', '"0,0 1,0 1,0 0,1"', 40, "<vs:geofence> polygon", "meet"),
        ('"-1,-1 1,-1 1,1 -1,1"', '"0,0 1,0 0,1e-170"', 40, "<vs:geofence> polygon", "0.001 m"),
        ('"-1,-1 1,-1 1,1 -1,1"', '"0,0 1,0 2,0"', 40, "<vs:geofence> polygon", "meet"),
        ('"-1,-1 1,-1 1,1 -1,1"', '"0,0 1,0 1,nan"', 40, "<vs:geofence> polygon", "nan"),
        ('"-1,-1 1,-1 1,1 -1,1"', '"0,0 1,0 1,2000"', 40, "<vs:geofence> polygon", "2000"),
        ('"-1,-1 1,-1 1,1 -1,1"', '"0,0 1,0,0 1,2"', 40, "<vs:geofence> polygon", "1,0,0"),
        ('"0.5,0.5 0.9,0.5 0.9,0.9"', '"0,0"', 41, "<vs:forbidden> polygon", "1 points"),
        ('polygon="0.5,0.5 0.9,0.5 0.9,0.9"', "", 41, "<vs:forbidden> polygon", "missing"),
        ('tag="9"', 'tag="10"', 41, "<vs:keep_off> tag", "10"),
        ('tag="9"', 'tag="nobody"', 41, "<vs:keep_off> tag", "nobody"),
        ("<vs:keep", '<vs:keep_off tag="9" distance="1" /><vs:keep', 41, "<vs:keep_off> tag", "9"),
        ('distance="0.5"', 'distance="-1"', 41, "<vs:keep_off> distance", "-1"),
        ('v_max="0.05"', 'v_max="0"', 40, "<vs:geofence> v_max", "0 is out of range"),
        ('v_max="0.05"', 'v_max="-1"', 40, "<vs:geofence> v_max", "-1"),
        ('v_max="0.05"', 'v_max="0.2"', 40, "<vs:geofence> v_max", f"{MAX_SPEED_M_S:g} m/s"),
        ('v_max="0.05"', 'v_min="0.2"', 40, "<vs:geofence> v_min", "v_max"),
        ("<vs:forbidden", "<vs:zone", 41, "<vs:zone>", "vs:forbidden"),
        ("</vs:geofence>", "</vs:geofence><vs:geofence />", 42, "<vs:geofence>", "twice"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(
    read_text: Read, example: str, before: str, after: str, line: int, attribute: str, value: str
) -> None:
    assert before in FENCE
    with pytest.raises(ConfigError) as refused:
        read_text(fenced(example, FENCE.replace(before, after)))
    assert str(refused.value).startswith(f"x.argos:{line}: {attribute}")
    assert value in str(refused.value)


def test_more_zones_than_can_be_checked_in_time_are_refused(read_text: Read, example: str) -> None:
    zones = [f'<vs:forbidden polygon="0,0 1,0 1,{n}" />' for n in range(1, 52)]
    read_text(fenced(example, f"<vs:geofence>{''.join(zones[:50])}</vs:geofence>"))
    with pytest.raises(ConfigError, match="at most 50"):
        read_text(fenced(example, f"<vs:geofence>{''.join(zones)}</vs:geofence>"))


def star(rng: np.random.Generator) -> list[tuple[float, float]]:
    """A polygon whose sides do not cross: each corner farther around the middle."""
    count = int(rng.integers(3, 12))
    angles = 2 * math.pi * (np.arange(count) + rng.uniform(0.05, 0.95, count)) / count
    away = rng.uniform(0.2, 2.0, count)
    return list(zip((away * np.cos(angles)).tolist(), (away * np.sin(angles)).tolist()))


def test_depths_are_those_of_opencv() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        corners = star(rng)
        points = rng.uniform(-2.5, 2.5, (20, 2))
        # Its corners are floats of 32 bits.
        outline = np.array(corners, np.float32)
        expected = [cv2.pointPolygonTest(outline, p, True) for p in points.tolist()]
        found = Polygon(tuple(corners)).depth_m(points)
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_stars_are_read_and_with_two_corners_exchanged_they_cross(
    read_text: Read, example: str
) -> None:
    rng = np.random.default_rng(2)
    for _ in range(30):
        corners = star(rng)
        text = " ".join(f"{x:.6f},{y:.6f}" for x, y in corners)
        fence = FENCE.replace("-1,-1 1,-1 1,1 -1,1", text)
        assert len(read_text(fenced(example, fence)).fence.boundary.corners) == len(corners)
    square = "0,0 1,0 1,1 0,1"
    for crossed in ("0,0 1,1 1,0 0,1", "0,0 1,0 0,1 1,1"):
        with pytest.raises(ConfigError, match="meet"):
            read_text(fenced(example, FENCE.replace("-1,-1 1,-1 1,1 -1,1", crossed)))
    notched = "0,0 3,0 3,1 2,1 2,0.5 1,0.5 1,1 0,1"  # two sides lie on one line
    for fine in (square, notched):
        read_text(fenced(example, FENCE.replace("-1,-1 1,-1 1,1 -1,1", fine)))


def test_the_tag_of_a_robot_that_is_replaced_is_that_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "kept-off.argos"
    fence = '<vs:geofence><vs:keep_off tag="31" distance="0.5" /></vs:geofence></arena>'
    path.write_text((SHIPPED_FOLDER / "pollutant.argos").read_text().replace("</arena>", fence))
    before = load(str(path))
    after = load(str(path), casting=Casting(replaced=((31, 37),)))
    assert before.fence.keep_off == after.fence.keep_off and len(after.fence.keep_off) == 1
    (name,) = after.fence.keep_off
    assert [robot.tag for robot in after.robots if robot.id == name] == [37]


def test_the_fastest_model_bounds_the_speed_limit(read_text: Read, example: str) -> None:
    text = fenced(example, FENCE.replace('v_max="0.05"', 'v_max="0.15"'))
    with pytest.raises(ConfigError, match="v_max"):
        read_text(text)
    fence = read_text(text.replace("<e-puck ", '<e-puck vs:model="thymio2" ')).geofence
    assert fence is not None and fence.v_max_m_s == 0.15
