"""Who serves the devices that a controller declares: as files of ARGoS write them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.rigs.probe import CONSTANT, FOLLOWS, OWN, probe
from vsense.base.errors import ConfigError, UsageError
from vsense.config.description import describe
from vsense.config.experiment import load, read
from vsense.config.placement import settle
from vsense.config.specs import ControllerSpec, Experiment, Stage
from vsense.modes.lab import _physics_process, _physics_spec
from vsense.run.environment import Environment
from vsense.run.remote import OwnDevices
from vsense.world.entities import Box, Led
from vsense.world.physics.motion import NoisyWheels
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.omnidirectional_camera import OmnidirectionalCamera
from vsense.world.sensors.range_and_bearing import RangeAndBearingSensor

FILE = Path(__file__).parent / "every_device.argos"
TEXT = FILE.read_text()

Read = Callable[..., Experiment]


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> Read:
    folder = tmp_path_factory.mktemp("devices")

    def read_it(text: str = TEXT, stage: Stage = Stage.SIM, virtual: bool = False) -> Experiment:
        return read(text.encode(), "x.argos", folder / "x.argos", None, None, stage, virtual)

    return read_it


def served(controller: ControllerSpec) -> dict[str, str]:
    return {f"{d.section} {d.element}": d.server for d in controller.devices}


def names(controller: ControllerSpec) -> list[str]:
    mounted = [m.sensor.name for m in controller.sensors]
    return [*mounted, *(m.actuator.name for m in controller.actuators)]


def test_a_probe_finds_every_device_served() -> None:
    verdicts = probe(load(FILE, stage=Stage.SIM))
    assert len(verdicts) == 22
    found = {f"{v.controller} {v.device.section} {v.device.element}": v.found for v in verdicts}
    own = {
        "mine sensors epuck_encoder", "mine actuators epuck_wheels",
        "any sensors differential_steering", "any actuators differential_steering",
    }  # fmt: skip
    constant = {"mine sensors epuck_battery", "any sensors battery"}
    for name, verdict in found.items():
        expected = OWN if name in own else CONSTANT if name in constant else FOLLOWS
        assert verdict == expected, name


def test_in_simulation_all_are_virtual_under_the_robots_own_names(loaded: Read) -> None:
    mine, other = loaded().controllers
    assert names(mine) == [
        "proximity", "light", "ground", "range_and_bearing", "omnidirectional_camera", "battery",
        "gps", "rgb_leds", "base_leds", "message",
    ]  # fmt: skip
    assert names(other) == [
        "proximity", "light", "ground", "range_and_bearing", "omnidirectional_camera", "battery",
        "leds", "message",
    ]  # fmt: skip
    text = describe(loaded())
    for words in (
        "sensor       <epuck_ground>: virtual, as 'ground', noise_level 0.05\n",
        "sensor       <epuck_encoder>: the robot's own 'wheels'\n",
        "actuator     <epuck_wheels>: the robot's own 'wheels', noise_std_dev 0.05\n",
        "sensor       <epuck_range_and_bearing>: virtual, as 'range_and_bearing',"
        " loss_probability 0.5\n",
    ):
        assert words in text, text
    warned = "\n".join(loaded().warnings)
    assert "<epuck_ground> noise_std_dev is not used: this device has no such noise" in warned
    assert "<epuck_range_and_bearing> nois_std_deviation is not known here" in warned


def test_in_the_lab_ring_battery_and_wheels_are_the_robots(loaded: Read) -> None:
    mine = loaded(stage=Stage.LAB).controllers[0]
    assert "proximity" not in names(mine) and "battery" not in names(mine)
    assert {"light", "ground", "rgb_leds", "message"} < set(names(mine))
    assert mine.wheel_noise == loaded().controllers[0].wheel_noise
    warned = "\n".join(loaded(stage=Stage.LAB).warnings)
    assert "<epuck_proximity> noise_level is not used: the real one's own noise" in warned
    assert "<epuck_wheels>" not in warned


def test_real_robots_serve_them_unless_told_otherwise(loaded: Read) -> None:
    experiment = loaded(stage=Stage.RUN)
    mine = experiment.controllers[0]
    assert names(mine) == []
    assert served(mine)["sensors epuck_light"] == "the robot's own 'light'"
    warned = "\n".join(experiment.warnings)
    assert mine.wheel_noise is None
    for words in (
        "<epuck_wheels> noise_std_dev is not used: the real one's own noise",
        "<epuck_ground> is the robot's own, where it has that board; vs:virtual='true' or",
        "<epuck_omnidirectional_camera> is not supported: the robots have none; vs:virtual='true'",
    ):
        assert words in warned
    everything = loaded(stage=Stage.RUN, virtual=True)
    in_the_lab = loaded(stage=Stage.LAB).controllers
    assert [names(c) for c in everything.controllers] == [names(c) for c in in_the_lab]
    ours = TEXT.replace("<argos-configuration", '<argos-configuration xmlns:vs="urn:vsense:1"')
    ours = ours.replace('nois_std_deviation="1.5"', "")
    ours = ours.replace("<epuck_ground", '<epuck_ground vs:virtual="true"')
    ours = ours.replace("<epuck_proximity", '<epuck_proximity vs:virtual="true"')
    assert names(loaded(ours, Stage.RUN).controllers[0]) == ["proximity", "ground"]
    ours = ours.replace("<epuck_light", '<epuck_light vs:virtual="false"')
    assert "light" not in names(loaded(ours).controllers[0])


def test_a_controller_for_the_robots_keeps_their_ring_where_nothing_asks_for_noise(
    loaded: Read,
) -> None:
    text = TEXT.replace("build/libmine.so", "phototaxis")
    assert "proximity" in names(loaded(text).controllers[0])
    start = text.index("<epuck_proximity")
    quiet = text[:start] + text[start:].replace(' noise_level="0.05"', "", 1)
    controller = loaded(quiet).controllers[0]
    assert "proximity" not in names(controller)
    assert served(controller)["sensors epuck_proximity"] == "the robot's own 'proximity'"


def test_leds_are_virtual_only_where_a_camera_sees_them(loaded: Read) -> None:
    text = TEXT
    for camera in ("epuck_omnidirectional_camera", "colored_blob_omnidirectional_camera"):
        start = text.index(f"<{camera}")
        text = text[:start] + text[text.index("/>", start) + 2 :]
    controller = loaded(text).controllers[0]
    assert "rgb_leds" not in names(controller)
    assert served(controller)["actuators epuck_rgb_leds"] == "the robot's own 'LEDs'"


def test_an_explicit_virtual_device_of_that_name_serves_the_element(loaded: Read) -> None:
    text = TEXT.replace("<epuck_battery", "<virtual_ground_sensor /><epuck_battery", 1)
    experiment = loaded(text)
    line = text[: text.index("<virtual_ground_sensor")].count("\n") + 1
    assert served(experiment.controllers[0])["sensors epuck_ground"] == (
        f"what line {line} mounts as 'ground'"
    )
    assert f"<epuck_ground> is not supported: line {line} serves 'ground' already" in "\n".join(
        experiment.warnings
    )


def test_what_the_robots_say_of_their_devices_counts(loaded: Read) -> None:
    mine, other = loaded().controllers
    camera = next(m.sensor for m in mine.sensors if m.sensor.name == "omnidirectional_camera")
    assert isinstance(camera, OmnidirectionalCamera) and not camera.square
    # argos3-epuck 66cb8d9, epuck_omnidirectional_camera_sensor.cpp line 187
    assert camera.reach_m == pytest.approx(0.122 * math.tan(math.radians(75.0)))
    ear = next(m.sensor for m in other.sensors if m.sensor.name == "range_and_bearing")
    assert isinstance(ear, RangeAndBearingSensor)
    assert ear.data_size == 3 and not ear.speaking_only and ear.reach.height_m is None
    text = TEXT.replace('rab_data_size="3"', 'rab_data_size="20"')
    warned = "\n".join(loaded(text).warnings)
    assert "<e-puck> rab_data_size is 20: messages of <range_and_bearing> end at 16" in warned
    text = TEXT.replace('<e-puck id="ep"', '<e-puck id="ep" rab_data_size="20"')
    assert "\n".join(loaded(text).warnings).count("rab_data_size is 20") == 1


def test_boxes_have_leds(loaded: Read) -> None:
    shelf = loaded().entities[1]
    assert isinstance(shelf, Box) and shelf.leds == (Led((0.0, 0.0, 0.101), (0, 255, 0)),)
    with pytest.raises(ConfigError, match="<led> color: 'nocolor'"):
        loaded(TEXT.replace('color="green"', 'color="nocolor"'))


def test_the_labs_wheels_have_it_too(loaded: Read, tmp_path: Path) -> None:
    experiment = settle(loaded(stage=Stage.LAB), 1)
    told = _physics_process._spec(experiment, "truth", 1, tmp_path / "log")
    told["bases"] = ["argos"] * len(experiment.robots)
    spec = _physics_spec.PhysicsSpec.parse(json.dumps(told).encode())
    assert NoisyWheels(spec.wheels, 1).of_robot(1, 400, 400) != (400, 400)
    quiet = NoisyWheels([None, *spec.wheels[1:]], 1)
    assert quiet.of_robot(0, 400, -300) == (400, -300)
    told["wheels"] = [{"relative": 1}]
    with pytest.raises(UsageError, match=r"spec: wheels:.*4"):
        _physics_spec.PhysicsSpec.parse(json.dumps(told).encode())


def test_wheels_come_out_as_in_argos(loaded: Read) -> None:
    mine, other = loaded().controllers
    told = np.full((1, 2), 400, dtype=np.int16)
    wheels = NoisyWheels([mine.wheel_noise], 1)
    driven = np.concatenate([wheels.apply(told) for _ in range(4000)]).astype(np.float64)
    # v + v N(0, 0.05): argos3-epuck 66cb8d9, epuck_wheels_default_actuator.cpp line 92
    assert driven.mean() == pytest.approx(400.0, abs=4.0 * 20.0 / math.sqrt(8000))
    assert driven.std() == pytest.approx(20.0, rel=0.05)
    assert (wheels.apply(np.zeros((1, 2), dtype=np.int16)) == 0).all()
    many = NoisyWheels([other.wheel_noise] * 2000, 1)
    # N(1, 0.1) (v + N(0, 1 mm/s)): argos3 421bd76, differential_steering_default_actuator.cpp
    speeds = many.apply(np.full((2000, 2), 400, dtype=np.int16)).astype(np.float64)
    assert speeds.std() == pytest.approx(math.hypot(40.0, 0.001 / EPUCK.step_m), rel=0.05)
    assert (many.apply(np.zeros((2000, 2), dtype=np.int16)) == 0).all()


FOOT_BOTS = """<argos-configuration>
<framework><experiment length="1" ticks_per_second="10" random_seed="1" /></framework>
<controllers><c id="c" library="stand_still"><actuators>
<differential_steering implementation="default" /><leds implementation="default" medium="leds" />
<range_and_bearing implementation="default" /><footbot_turret implementation="default" />
</actuators><sensors>
<footbot_proximity implementation="default" /><footbot_light implementation="rot_z_only" />
<footbot_motor_ground implementation="rot_z_only" />
<footbot_base_ground implementation="rot_z_only" />
<range_and_bearing implementation="medium" medium="rab" />CAMERA
<positioning implementation="default" /></sensors></c></controllers>
<arena size="9,9,1" center="0,0,0.5"><distribute>
<position method="grid" center="0,0,0" distances="0.5,0.5,0" layout="5,8,1" />
<orientation method="constant" values="0,0,0" />
<entity quantity="40" max_trials="1"><foot-bot id="fb"><controller config="c" /></foot-bot></entity>
</distribute></arena>
<physics_engines><dynamics2d id="d" /></physics_engines>
<media><led id="leds" /><range_and_bearing id="rab" /></media></argos-configuration>"""
CAMERA = (
    '<colored_blob_omnidirectional_camera implementation="rot_z_only" medium="leds" '
    'noise_std_dev="0.1" />'
)


@pytest.mark.parametrize(
    ("robot", "device", "words"),
    [
        ("foot-bot", "epuck_proximity", "reads 8 sensors.*footbot has 24: expected <proximity>"),
        ("foot-bot", "epuck_light", "reads 8 sensors.*footbot has 24: expected <light>"),
        ("pipuck", "footbot_proximity", "pipuck has rangefinders: expected <pipuck_rangefinders>"),
        ("e-puck", "kheperaiv_proximity", "other angles.*epuck has: expected <proximity>"),
        ("kheperaiv", "epuck_proximity", "other angles.*kheperaiv has: expected <proximity>"),
        ("kheperaiv", "footbot_light", "other angles.*kheperaiv has: expected <light>"),
    ],
)
def test_an_element_for_other_sensors_than_a_model_has_is_refused(
    loaded: Read, robot: str, device: str, words: str
) -> None:
    """A controller would read the first eight of 24, distances for proximity, or an e-puck's
    sensors for those of a Khepera IV, which look elsewhere."""
    text = FOOT_BOTS.replace("CAMERA", "").replace("foot-bot", robot)
    text = re.sub("<footbot_(proximity|light) [^>]*>", "", text)
    text = text.replace(
        "<sensors>", f'<sensors><{device} implementation="default" noise_level="0.1" />'
    )
    with pytest.raises(ConfigError, match=words):
        loaded(text, Stage.SIM)


@pytest.mark.parametrize("stage", [Stage.SIM, Stage.LAB])
def test_a_foot_bots_devices_are_virtual_and_fit_one_datagram(loaded: Read, stage: Stage) -> None:
    """In the lab also beside a robot's own, which hosted controllers get with them."""
    for camera, least in (("", 14), (CAMERA, 7)):
        experiment = loaded(FOOT_BOTS.replace("CAMERA", camera), stage)
        (controller,) = experiment.controllers
        if stage is Stage.LAB:
            least //= 2
            OwnDevices(Environment(experiment, 1).tables["c"], [1], experiment.timestep_ns)
        layouts = {m.sensor.name: m.sensor.layout for m in controller.sensors}
        lists = {name: layouts.pop(name) for name in ("range_and_bearing",)}
        if camera:
            lists["omnidirectional_camera"] = layouts.pop("omnidirectional_camera")
            assert "leds" in names(controller)
        assert layouts == {
            "proximity": "24*f4", "light": "24*f4", "ground": "4*f4", "base_ground": "8*f4",
            "gps": "3*f4",
        }  # fmt: skip
        places = (int(lists["range_and_bearing"].partition("*")[0]) - 1) // 12
        assert places >= least
        assert served(controller)["actuators footbot_turret"] == "nothing serves it"
