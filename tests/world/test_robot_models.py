"""Robot models: what their files may say, and what is refused with file, line and value."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from vsense.base.errors import ConfigError, UsageError
from vsense.config.experiment import SHIPPED_FOLDER, load
from vsense.world.physics.motion import Physics
from vsense.world.physics.proximity_ring import ProximityRing
from vsense.world.robot_models import EPUCK, MODELS_FOLDER, model_of, models_in, shipped_models

THYMIO = (MODELS_FOLDER / "thymio2.toml").read_text()


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


@pytest.mark.parametrize(
    ("before", "after", "place", "words"),
    [
        ("radius_m = 0.08", "radius_m = -1", "radius_m", "a number from 0.001 to 5 m; got -1"),
        ("radius_m = 0.08", "radius_m = nan", "radius_m", "a number from 0.001 to 5 m; got nan"),
        ("radius_m = 0.08", "radious_m = 1", "radious_m", "is 'radius_m' meant"),
        ("height_m = 0.051\n", "", "[body]", "[body] lacks height_m"),
        ("marker_height_m = 0.06", "marker_height_m = 1.2", "marker_height_m", "0.001 to 0.99 m"),
        ("mass_kg = 0.2", "mass_kg = 1e4", "mass_kg", "a number from 0.001 to 100 kg; got 1"),
        ("[wheels]", "[whels]", "[whels]", "is 'wheels' meant"),
        ("diameter_m = 0.041", "diameter_m = 0.05", "diameter_m", "a step of 0.1571 mm, expected"),
        ("max_steps_s = 1289", "max_steps_s = 1289\ntimer_hz = 100", "timer_hz", "or 0"),
        ("axle_m = 0.094", "axle_m = 0.001", "axle_m", "expected 0.016 to 0.16 m within this body"),
        ("[0.062, 0.0485]", "[0.062, 3.0]", "places_m", "outside of the body of radius 0.08 m"),
        ("table_m = [0.0,", "table_m = [0.01,", "table_m", "rising distances from 0"),
        ("3705.1,", "4100.0,", "table_raw", "a number from 0 to 4095"),
        ("3366.0,", "3800.0,", "table_raw", "expected readings that fall"),
        ("headings_deg = [40.0, ", "headings_deg = [", "headings_deg", "6 numbers, expected 7"),
        ("[[2, 3], ", "[[2, 7], ", "stands_for", "numbers of sensors, 0 to 6"),
        ("[[2, 3], ", "[", "stands_for", "8 lists of sensors, for ps0 to ps7"),
        ("[[2, 3], ", "[2, ", "stands_for", "lists of sensors, as [[2, 3], [], ...]"),
        ("[ring]\n", "[ring]\nlike = 'mine'\n", "like", "there is no shipped model 'mine'"),
        ("[ring]\n", "[ring]\nlike = 'footbot'\n", "like", "footbot has no [ring] to be like"),
        ("[ring]\n", "[ring]\nlike = '../x'\n", "like", "the name of a shipped model"),
    ],
)
def test_what_no_robot_is_like_is_refused(
    tmp_path: Path, before: str, after: str, place: str, words: str
) -> None:
    assert THYMIO.count(before) >= 1
    text = THYMIO.replace(before, after, 1)
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError) as refused:
        model_of("mine", tmp_path)
    line = line_of(text, f"\n{place}") + 1
    assert str(refused.value).startswith(f"{tmp_path}/mine.toml:{line}: "), refused.value
    assert words in str(refused.value)


def test_a_table_that_is_like_a_shipped_one_has_all_of_it_but_what_it_says(tmp_path: Path) -> None:
    body = THYMIO[: THYMIO.index("[ring]")]
    (tmp_path / "mine.toml").write_text(f"{body}[ring]\nlike = 'epuck'\nnoise_raw = 3.0\n")
    mine = model_of("mine", tmp_path)
    assert mine.ring is not None and EPUCK.ring is not None and not mine.leds.ring_m
    assert mine.ring == replace(EPUCK.ring, noise_raw=3.0)


def test_a_file_without_wheels_says_so(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(THYMIO[: THYMIO.index("[wheels]")])
    with pytest.raises(ConfigError, match=r"mine.toml:1: there is no table \[wheels\]"):
        model_of("mine", tmp_path)


def test_names_that_are_none_and_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "lost.toml").symlink_to(tmp_path / "nowhere")
    (tmp_path / "robots.toml").write_text("[[robot]]\ntag = 1\n")
    (tmp_path / "mine.toml").write_text(THYMIO)
    assert models_in(tmp_path) == ["mine"] and "footbot" in shipped_models()
    for name in ("folder", "lost"):
        with pytest.raises(UsageError, match=f"cannot read .*{name}.toml"):
            model_of(name, tmp_path)
    for name in ("x" * 300, "../mine", "a/b", "", "mine\0"):
        with pytest.raises(UsageError, match="is no name of a robot model"):
            model_of(name, tmp_path)
    with pytest.raises(UsageError, match=r"there is no robot model 'roboter'; .* mine") as refused:
        model_of("roboter", tmp_path)
    assert "robots" not in str(refused.value)


def test_a_file_that_was_edited_is_read_again(tmp_path: Path) -> None:
    own = tmp_path / "mine.toml"
    own.write_text(THYMIO)
    before = model_of("mine", tmp_path)
    assert model_of("mine", tmp_path) is before
    own.write_text(THYMIO.replace("axle_m = 0.094", "axle_m = 0.1"))
    assert (before.axle_m, model_of("mine", tmp_path).axle_m) == (0.094, 0.1)


def test_rings_that_a_file_does_not_say_sit_outside_of_its_body() -> None:
    thymio, epuck2 = model_of("thymio2"), model_of("epuck2")
    assert thymio.infrared.radius_m - thymio.radius_m == pytest.approx(0.001)
    assert thymio.infrared.angles_rad == EPUCK.infrared.angles_rad
    assert epuck2.infrared == EPUCK.infrared and epuck2.generic == EPUCK.generic


def test_an_own_model_comes_before_a_shipped_one(tmp_path: Path) -> None:
    text = (MODELS_FOLDER / "epuck.toml").read_text()
    (tmp_path / "epuck.toml").write_text(text.replace("radius_m = 0.035", "radius_m = 0.04"))
    assert model_of("epuck", tmp_path).radius_m == 0.04 and model_of("epuck") == EPUCK
    assert model_of("epuck2").step_m == pytest.approx(125_664e-9, rel=1e-5)


def test_a_thymio_avoids_what_is_ahead_of_it_with_a_controller_for_e_pucks() -> None:
    """As its driver has it, controllers find the sensors where an e-puck's look the same way."""
    model = model_of("thymio2")
    mapped = [[model.ring.headings_deg[s] for s in part] for part in model.ring.stands_for]
    assert mapped == [[0, -20], [-40], [], [180], [180], [], [40], [20, 0]]
    physics = Physics([[0, 0, 0], [0.13, 0.05, 0]], [], [], 0, models=[model, EPUCK])
    raw = ProximityRing(physics.near, 1, models=physics.models).read(physics.bodies)[0]
    assert raw[7] > raw[0] > 0 and raw[6] > raw[1] and not raw[[2, 5]].any()
    own = replace(model, ring=replace(model.ring, stands_for=()))
    seven = ProximityRing(physics.near, 1, models=[own, EPUCK]).read(physics.bodies)[0]
    assert seven[7] == 0
    assert raw.tolist() == [
        max((int(seven[s]) for s in p), default=0) for p in model.ring.stands_for
    ]


def test_bodies_of_very_different_masses_are_refused(tmp_path: Path) -> None:
    text = (SHIPPED_FOLDER / "phototaxis.argos").read_text().replace("phototaxis.py", "p.py")
    (tmp_path / "p.py").write_text((SHIPPED_FOLDER / "phototaxis.py").read_text())
    (tmp_path / "tank.toml").write_text(THYMIO.replace("mass_kg = 0.2", "mass_kg = 99.0"))
    path = tmp_path / "mixed.argos"
    tank = '<vs:object id="o" vs:tag="9" vs:model="tank">'
    body = '<body position="0,0,0" orientation="0,0,0" /></vs:object></arena>'
    path.write_text(text.replace("</arena>", tank + body))
    with pytest.raises(ConfigError, match=r"epuck has 0\.15 kg in this arena, and tank 99 kg"):
        load(str(path))


def test_a_height_that_beats_that_of_a_model_is_said(tmp_path: Path) -> None:
    text = (SHIPPED_FOLDER / "phototaxis.argos").read_text()
    (tmp_path / "phototaxis.py").write_text((SHIPPED_FOLDER / "phototaxis.py").read_text())
    (tmp_path / "tall.toml").write_text(
        THYMIO.replace("marker_height_m = 0.06", "marker_height_m = 0.3")
    )
    path = tmp_path / "tall.argos"
    path.write_text(text.replace("<e-puck", '<e-puck vs:model="tall"'))
    loaded = load(str(path))
    assert {loaded.marker_height_m(robot.model) for robot in loaded.robots} == {0.06}
    (said,) = [words for words in loaded.warnings if "vs:marker" in words]
    assert said.endswith("<vs:marker> height=0.06 counts for all; that of tall would be 0.3 m")
    assert not [words for words in load("phototaxis").warnings if "vs:marker" in words]
    path.write_text(path.read_text().replace('height="0.06"', ""))
    assert {load(str(path)).marker_height_m(robot.model) for robot in loaded.robots} == {0.3}
