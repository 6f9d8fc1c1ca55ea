"""Settings from outside: what a campaign changes in a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from vsense.base.errors import ConfigError, UsageError
from vsense.config.specs import Experiment
from vsense.world.entities import Light

Read = Callable[..., Experiment]

SECOND = """
    <other_controller id="unused" library="mine.c">
      <sensors><virtual_ground_sensor /></sensors>
    </other_controller>
  </controllers>"""


def test_a_device_a_kind_of_device_and_all_of_them(read_full: Read, full: str) -> None:
    one = read_full(full, {"virtual_ground_sensor.noise_level": "0.3"})
    noises = {m.sensor.name: m.quality.noise_level for m in one.controllers[0].sensors}
    assert noises["ground"] == 0.3
    assert noises["light"] == 0.0
    every = read_full(full, {"sensor.noise": "0.25"})
    assert {m.quality.noise_level for m in every.controllers[0].sensors} == {0.25}
    assert [m.quality.noise_level for m in every.controllers[0].actuators] == [0.1, 0.0, 0.0, 0.0]
    assert {
        m.quality.noise_level
        for m in read_full(full, {"actuator.noise": "0.2"}).controllers[0].actuators
    } == {0.2}


def test_the_prefix_of_our_namespace_may_be_left_out(read_full: Read, full: str) -> None:
    for key in ("sensor.vs:bias", "sensor.bias"):
        assert {m.quality.bias for m in read_full(full, {key: "0.5"}).controllers[0].sensors} == {
            0.5
        }
    for key in ("vs:marker.height", "marker.height"):
        assert read_full(full, {key: "0.07"}).marker.height_m == 0.07


@pytest.mark.parametrize("key", ["params.alpha", "mine.alpha", "my_controller.params.alpha"])
def test_a_controller_is_told_its_parameters(read_full: Read, full: str, key: str) -> None:
    assert read_full(full, {key: "7"}).controllers[0].params["alpha"] == "7"


def test_a_controller_may_be_named_by_its_library(read_full: Read, full: str) -> None:
    text = full.replace('library="mine.c"', 'library="pollutant"')
    assert read_full(text, {"pollutant.alpha": "7"}).controllers[0].params["alpha"] == "7"


def test_a_library_may_be_named_with_folder_and_suffix(read_full: Read, full: str) -> None:
    text = full.replace('"mine"', '"it"').replace('library="mine.c"', 'library="./mine.c"')
    for library in ("mine", "./mine.c"):
        assert read_full(text, {f"{library}.alpha": "7"}).controllers[0].params["alpha"] == "7"
    with pytest.raises(UsageError, match=r"'mne'.*x\.argos.*'mine'"):
        read_full(text, {"mne.alpha": "7"})


def test_of_a_program_for_argos_only_what_its_sources_name_is_added(
    read_full: Read, full: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.cpp"
    path.write_text(
        'GetNodeAttribute(t_node, "alpha", a);\nGetNodeAttribute(t_node, "velocity", v);\n'
        'REGISTER_CONTROLLER(CMine, "my_controller")\n'
    )
    text = full.replace('library="mine.c"', f'library="{path}"')
    assert read_full(text, {"mine.velocity": "7"}).controllers[0].params["velocity"] == "7"
    with pytest.raises(ConfigError, match=r"velocty \(.*'velocity'"):
        read_full(text, {"mine.velocty": "7"})


def test_parameters_that_the_file_does_not_name_are_added(read_full: Read, full: str) -> None:
    params = (
        read_full(full, {"mine.wheels.speed": "9", "mine.arm.reach": "2"}).controllers[0].params
    )
    assert params == {"alpha": "0.5", "wheels.speed": "9", "arm.reach": "2"}
    text = full.replace('<params alpha="0.5"><wheels speed="3" /></params>', "")
    assert read_full(text, {"mine.beta": "1"}).controllers[0].params == {"beta": "1"}


def test_anything_may_be_named_by_its_id_and_from_outside_inwards(
    read_full: Read, full: str
) -> None:
    experiment = read_full(
        full,
        {
            "gate.body.position": "0.9,0.4,0",
            "sun.intensity": "9",
            "trail.evaporation": "0.5",
            "experiment.random_seed": "99",
            "loop_functions.door": "left",
            "distribute.entity.max_trials": "42",
        },
    )
    assert experiment.seed == 99
    assert next(e.intensity for e in experiment.entities if isinstance(e, Light)) == 9.0
    assert experiment.fields[0].evaporation_per_s == 0.5
    assert experiment.loop_functions is not None
    assert experiment.loop_functions.params["door"] == "left"
    gate = next(e for e in experiment.entities if e.id == "gate")
    assert getattr(gate, "position_m", None) == (0.9, 0.4, 0.0)
    assert experiment.robots[-1].distribution is not None
    assert experiment.robots[-1].distribution.max_trials == 42


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("sensr", "sensor"), ("acuator", "actuator"), ("gat", "gate"), ("mne", "mine"),
        ("virtual_ligth_sensor", "virtual_light_sensor"),
    ],
)  # fmt: skip
def test_a_setting_of_nothing_tells_what_may_be_meant(
    read_full: Read, full: str, wrong: str, meant: str
) -> None:
    with pytest.raises(UsageError, match=rf"there is no '{wrong}' in x\.argos; is .*'{meant}'"):
        read_full(full, {f"{wrong}.intensity": "1"})


def test_a_setting_that_fits_nothing_lists_what_there_is(read_full: Read, full: str) -> None:
    with pytest.raises(UsageError, match=r"'moon'.*x\.argos.*[0-9]+"):
        read_full(full, {"moon.intensity": "1"})
    with pytest.raises(UsageError, match=r"'sun'.*<body>"):
        read_full(full, {"sun.body.position": "0,0,0"})
    for wrong in ("sensor", ".noise", "sensor.", ""):
        with pytest.raises(UsageError, match=r"ELEMENT\.attribute"):
            read_full(full, {wrong: "1"})


def test_a_setting_is_checked_as_the_file_is(read_full: Read, full: str) -> None:
    outside = r"intensity \(set from outside the file\): "
    with pytest.raises(ConfigError, match=rf"x\.argos:51: <light> {outside}'nan' is not a number"):
        read_full(full, {"sun.intensity": "nan"})
    with pytest.raises(ConfigError, match=r"colour \(.*attribute"):
        read_full(full, {"sun.colour": "red"})


def test_what_is_not_in_use_cannot_be_set(read_full: Read, full: str) -> None:
    text = full.replace("</controllers>", SECOND)
    with pytest.raises(UsageError, match=r"'unused\.alpha': <params>.*x\.argos:\d+"):
        read_full(text, {"unused.alpha": "1"})
    # Of several that are meant one in use is enough.
    noises = {
        m.quality.noise_level
        for m in read_full(text, {"sensor.noise": "0.5"}).controllers[0].sensors
    }
    assert noises == {0.5}
