"""Files as ARGoS's and the original's users write them: they load, or say what is missing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.rigs.places import DATA
from vsense.base.errors import ConfigError
from vsense.config.experiment import load, read
from vsense.config.placement import settle
from vsense.config.specs import Experiment, TrackerAddress
from vsense.world.entities import Light

ARGOS = DATA / "argos"

FILES = {
    "custom_distributions": (
        55,
        "<arena>: holds no real robot, expected <e-puck>; it has <light> ",
    ),
    "eyebot_flocking": (
        45,
        "this file has 10 <eye-bot>: driven here are e-pucks, foot-bots, Khepera IVs and ",
    ),
}
"""Those that are refused: in which line, and how the words begin."""

LOADED = {
    "diffusion_1": 1, "diffusion_10": 10, "epuck_obstacleavoidance": 50, "eyebot_circle": 1,
    "flocking": 10, "foraging": 20, "gripping": 1, "id": 10, "manualcontrol": 10,
    "multiple_engines": 100, "synchronization": 16, "trajectory": 10,
}  # fmt: skip
"""How many robots the others have: foot-bots but for the one's with the e-puck."""

AS_EPUCKS = {
    "custom_distributions": None,
    "diffusion_1": 1, "diffusion_10": 10, "eyebot_circle": None, "eyebot_flocking": 10,
    "flocking": 10, "foraging": 20, "gripping": 1, "id": 10, "manualcontrol": 10,
    "multiple_engines": 100, "synchronization": 16, "trajectory": 10,
}  # fmt: skip
"""How many robots the file has once they are called e-pucks; None: it is not only about them."""

EXACT = (
    "19: <epuck_obstacleavoidance_controller> library: 'build/controllers/epuck_obstacleavoidance/"
    "libepuck_obstaclea...' is C++ for ARGoS: its port 'epuck_obstacleavoidance' is run instead",
    "62: <entity> vs:tags is missing: 'fb0' to 'fb49' wear 55508, ",
    "76: <box> is virtual, and no virtual sensor is there to feel it; vs:physical='true' says",
    "89: <cylinder> is virtual, and no virtual sensor is there to feel it; ",
    "110: <visualization> is not supported: vsense draws its own pictures",
)

THESIS = """<?xml version="1.0" ?>
<argos-configuration>
  <framework ats_host="164.15.10.153" ats_port="4040" vss_port="4050">
    <system threads="0" />
    <experiment length="120" ticks_per_second="10" random_seed="124" vss_host="10.0.1.194"
                vss_port="4050" />
  </framework>
  <controllers>
    <cleaning_controller id="clean" library="build/controllers/libcleaning.so">
      <actuators>
        <epuck_wheels implementation="default" />
        <epuck_base_leds implementation="default" medium="leds" />
      </actuators>
      <sensors>
        <epuck_proximity implementation="default" show_rays="true" calibrated="true" />
        <virtual_ground_sensor implementation="default" />
        <virtual_rgb_ground_sensor implementation="default" />
        <virtual_light_sensor implementation="default" show_rays="true" />
        <virtual_pollutant_sensor implementation="default" direction_angle="0" wide_angle="90"
                                  max_distance="1.0" pollutant_entity="epuck_22_1" />
      </sensors>
      <params stop_probability="0.3" />
    </cleaning_controller>
  </controllers>
  <arena size="5,5,1" center="0,0,0.5">
    <light id="light" position="0,0,10" orientation="0,0,0" color="yellow" intensity="5"
           medium="leds" />
    <e-puck id="epuck_22_1"><body position="0,0,0" orientation="0,0,0" /></e-puck>
    <e-puck id="epuck_23_30">
      <body position="1,0,0" orientation="0,0,0" /><controller config="clean" />
    </e-puck>
  </arena>
  <physics_engines><dynamics2d id="dyn2d" /></physics_engines>
  <media><led id="leds" /></media>
</argos-configuration>
"""
"""Chapters 3 to 5: addresses on <framework>, names with tag and robot, the sensors' attributes."""

ORIGINAL = (
    THESIS.replace(' ats_host="164.15.10.153" ats_port="4040" vss_port="4050"', "")
    .replace('"virtual_ground_sensor', '"virtual_ground_sensor')
    .replace(
        "<virtual_ground_sensor ",
        '<virtual_ground_sensor sensor_model_file="" real_experiment="true" ',
    )
    .replace(
        '<dynamics2d id="dyn2d" />',
        '<iridia_tracking_system id="its" translate_x="7.5" translate_y="2.5"'
        ' its_host="164.15.10.153" its_port="4040" />',
    )
)
"""The original's code: addresses on its physics engine, and attributes of its sensors."""


def loaded(text: str) -> Experiment:
    return read(text.encode(), "x.argos", Path("x.argos"))


def test_the_table_holds_every_file() -> None:
    assert sorted(FILES | LOADED) == sorted(path.stem for path in ARGOS.glob("*.argos"))
    assert {*AS_EPUCKS, "epuck_obstacleavoidance"} == {*FILES, *LOADED}


@pytest.mark.parametrize("name", sorted(FILES))
def test_a_file_of_argos_says_what_is_missing(name: str) -> None:
    line, words = FILES[name]
    with pytest.raises(ConfigError) as caught:
        load(ARGOS / f"{name}.argos")
    assert caught.value.line == line
    assert caught.value.message.startswith(words)


@pytest.mark.parametrize("name", sorted(LOADED))
def test_a_file_of_argos_loads_with_its_own_robots(name: str) -> None:
    robots = load(ARGOS / f"{name}.argos").robots
    assert len(robots) == LOADED[name]
    kind = "epuck" if name.startswith("epuck") else "footbot"
    assert {robot.model.name for robot in robots} == {kind}


THYMIO = """<argos-configuration>
  <framework><experiment length="@LENGTH@" ticks_per_second="10" /></framework>
  <controllers><lua_controller id="c" /></controllers>
  <arena size="2, 2, 1" center="0, 0, 0.5">
    <box id="wall" size="9,9,9" movable=false><body position="9,9,9" orientation="0,0,0" /></box>
    <distribute>
      <position method="uniform" min="-1,-1,0" max="1,1,0" />
      <orientation method="constant" values="0,0,0" />
      <entity quantity="QUANTITY" max_trials="9">
        <Thymio id="t"><controller config="c" /></Thymio>
      </entity>
    </distribute>
  </arena>
</argos-configuration>
"""


@pytest.mark.parametrize(("quantity", "many"), [("20", "20 <Thymio>"), ("@N@", "<Thymio> robots")])
def test_other_robots_are_named_before_anything_else_can_fail(
    quantity: str, many: str, tmp_path: Path
) -> None:
    """The length is a template's, the box lies outside: neither is what its user has to know."""
    path = tmp_path / "thymio.argos"
    path.write_text(THYMIO.replace("QUANTITY", quantity))
    with pytest.raises(ConfigError, match=f"this file has {many}: driven") as caught:
        load(path)
    assert caught.value.line == 10


def test_other_robots_beside_e_pucks_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "mixed.argos"
    text = (ARGOS / "epuck_obstacleavoidance.argos").read_text()
    crowd = THYMIO[THYMIO.index("    <distribute>") : THYMIO.index("  </arena>")]
    more = crowd.replace("QUANTITY", "3") + '<Thymio id="t9"><controller config="c" /></Thymio>'
    path.write_text(text.replace("</arena>", more + "</arena>"))
    mixed = load(path)
    assert len(mixed.robots) == 50
    left_out = [words for words in mixed.warnings if "driven here are e-pucks" in words]
    assert len(left_out) == 2 and all("<Thymio>" in words for words in left_out)


def test_the_e_puck_example_says_what_happens_instead() -> None:
    experiment = load(ARGOS / "epuck_obstacleavoidance.argos")
    said = [warning.partition(".argos:")[2] for warning in experiment.warnings]
    assert len(said) == len(EXACT)
    for warning, start in zip(said, EXACT):
        assert warning.startswith(start)
    assert experiment.controllers[0].library == "epuck_obstacleavoidance"
    assert experiment.controllers[0].params == {"velocity": "5"}
    assert [robot.id for robot in experiment.robots[:2]] == ["fb0", "fb1"]
    assert len({robot.tag for robot in experiment.robots}) == 50
    settled = settle(experiment, experiment.seed)
    assert [entity.id for entity in settled.entities[4:]] == [
        *(f"b{i}" for i in range(5)), *(f"c{i}" for i in range(5)),
    ]  # fmt: skip
    with pytest.raises(ConfigError, match=r"ARGoS.*--strict.* 4 "):
        experiment.refuse_warnings()


@pytest.mark.parametrize("name", sorted(name for name, n in AS_EPUCKS.items() if n))
def test_with_e_pucks_every_file_of_argos_loads(name: str) -> None:
    text = (ARGOS / f"{name}.argos").read_text()
    text = re.sub(r"(</?)(foot|eye)-bot\b", r"\1e-puck", text)
    experiment = loaded(text)
    assert len(experiment.robots) == AS_EPUCKS[name]
    assert experiment.controllers[0].library == "stand_still"
    (cpp,) = [w for w in experiment.warnings if "is C++ for ARGoS" in w]
    assert "its sources are not found: the robots stand still; --sources " in cpp
    settled = settle(experiment, 3)
    assert all(robot.pose is not None for robot in settled.robots)
    assert all(re.match(r"x\.argos:[0-9]+: <[a-z0-9_-]+> ", w) for w in experiment.warnings)


def test_robots_that_share_no_controller_have_their_own() -> None:
    text = (ARGOS / "eyebot_circle.argos").read_text()
    experiment = loaded(re.sub(r"(</?)(foot|eye)-bot\b", r"\1e-puck", text))
    assert [(c.id, experiment.driven_by(c)) for c in experiment.controllers] == [
        ("fcc", ("fb",)),
        ("ecc", ("eb",)),
    ]


@pytest.mark.parametrize(("text", "origin_m"), [(THESIS, (0.0, 0.0)), (ORIGINAL, (7.5, 2.5))])
def test_the_examples_of_the_thesis_and_of_its_code_load(
    text: str, origin_m: tuple[float, float]
) -> None:
    experiment = loaded(text)
    assert (experiment.host, experiment.port) == ("10.0.1.194", 4050)
    tracker = experiment.tracker
    assert isinstance(tracker, TrackerAddress)
    assert (tracker.host, tracker.port, tracker.origin_m) == ("164.15.10.153", 4040, origin_m)
    assert [robot.id for robot in experiment.robots] == ["epuck_23_30"]
    assert [thing.id for thing in experiment.objects] == ["epuck_22_1"]
    assert experiment.sources[0].tag == 22
    assert [m.sensor.name for m in experiment.controllers[0].sensors] == [
        "ground", "rgb_ground", "light", "pollutant",
    ]  # fmt: skip
    (light,) = (e for e in experiment.entities if isinstance(e, Light))
    assert light.position_m == (0.0, 0.0, 10.0)
    missing = [w for w in experiment.warnings if "is C++" in w]
    assert len(missing) == 1
    others = [w for w in experiment.warnings if w not in missing]
    assert all("is not used:" in warning for warning in others)
    assert len(others) == (1 if text == THESIS else 3)


def test_a_lua_controller_without_a_script_stands_and_a_port_is_taken(tmp_path: Path) -> None:
    lua = THESIS.replace("cleaning_controller", "lua_controller").replace(
        ' library="build/controllers/libcleaning.so"', ""
    )
    (warning,) = [w for w in loaded(lua).warnings if "script" in w]
    assert warning.startswith("x.argos:9: <lua_controller> has no <params script=...>")
    assert loaded(lua).controllers[0].library == "stand_still"
    (tmp_path / "cleaning.c").touch()
    ported = read(THESIS.encode(), "x.argos", tmp_path / "x.argos")
    assert ported.controllers[0].library == "cleaning.c"


def test_loop_functions_in_c_plus_plus_are_replaced_by_their_port(tmp_path: Path) -> None:
    element = '<loop_functions library="build/libdoors" label="doors"><a b="1" /></loop_functions>'
    text = THESIS.replace("<arena", f"{element}<arena")
    assert loaded(text).loop_functions is None
    (tmp_path / "doors.py").touch()
    experiment = read(text.encode(), "x.argos", tmp_path / "x.argos")
    assert experiment.loop_functions is not None
    assert experiment.loop_functions.path == tmp_path / "doors.py"
    assert experiment.loop_functions.params == {"a.b": "1"}
    assert any("its port 'doors.py' is called instead" in w for w in experiment.warnings)
