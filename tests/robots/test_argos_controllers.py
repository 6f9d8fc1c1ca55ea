"""Controllers for ARGoS: found, built, told what the file says, and served with ARGoS's values."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bench.robot import HERE as BENCH
from tests.conftest import require_tool, require_zig
from vsense.base.errors import ConfigError, UsageError
from vsense.base.readings import SensorReadings
from vsense.base.xml.parsing import NAMESPACE
from vsense.config.experiment import load
from vsense.config.specs import Stage
from vsense.modes.sim._simulation import Simulation
from vsense.robots import _argos_code, _cmake, boards, build, finding
from vsense.robots.compiling import BuildError
from vsense.robots.inprocess import CompiledProgram, ControllerFailure, ProgramSetup
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import Wanted
from vsense.robots.python_swarm import Leds
from vsense.robots.sources import CodeOptions, ProgramSources
from vsense.run.programs import shared_objects
from vsense.world.robot_models import model_of

FOLDER = Path(__file__).parent / "argos" / "controllers"
READINGS = (FOLDER / "readings.cpp").resolve()
CATCHING = (FOLDER / "catching.cpp").resolve()
STEP_NS = 100_000_000
TAG = 23
ID = "epuck_23_30"

RING = (10.5884, 3.5999, 2.0, 1.2, 0.8571, 0.6667, 0.5806, 0.5247)
"""Parts of pi. Source: argos3-epuck 66cb8d9, ci_epuck_proximity_sensor.cpp lines 15-22."""
ANGLES = [math.pi / np.float32(part) for part in RING]


@pytest.fixture(scope="module", autouse=True)
def cache(shared_cache: Path) -> Path:
    """One cache for all: our part of the programs is compiled once."""
    require_tool("c++", "build-essential")
    return shared_cache


@pytest.fixture(scope="module")
def readings() -> Path:
    return build.shared(ProgramSources((READINGS,), (FOLDER,), "readings_controller"))


@pytest.fixture(scope="module")
def plain() -> Path:
    """The same without exceptions and types at run time, as a board has it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CXXFLAGS", "-fno-exceptions -fno-rtti")
        return build.shared(ProgramSources((READINGS,), (FOLDER,), "readings_controller"))


class Robot:
    """One robot, with sensors that the test serves."""

    def __init__(
        self,
        library: Path,
        file: Path,
        sensors: Mapping[str, Sequence[float]] | None = None,
        actuators: Mapping[str, int] | None = None,
        declared: tuple[str, str] = ("", ""),
        params: str = "",
        more: str = "",
    ) -> None:
        self.file = file.with_name(file.name + ID)
        self.sensors, self.actuators = dict(sensors or {}), dict(actuators or {})
        entries = [
            Entry(number, name, f"{len(values)}*f4")
            for number, (name, values) in enumerate(self.sensors.items())
        ]
        entries += [
            Entry(100 + number, name, f"{count}*u1", Direction.ACTUATOR)
            for number, (name, count) in enumerate(self.actuators.items())
        ]
        told = f"vs:sensors={declared[0]}\nvs:actuators={declared[1]}\n{more}<=params\n"
        told += f"@file={file}\n{params}>=\nvs:id={ID}\n"
        self.robots = CompiledProgram(
            ProgramSetup(library, [TAG], Table(entries), STEP_NS, 7, {TAG: told})
        )
        self.timestep = 0
        self.prox = [0] * 8

    def step(self) -> dict[str, list[list[float]]]:
        """A control step; gives what it has written, by name."""
        capture_ns = 10**9 + self.timestep * STEP_NS
        values = [np.float32(v).tobytes() for v in self.sensors.values()]
        block = np.frombuffer(b"".join(values), dtype=np.uint8).reshape(1, -1)
        captures_ns = np.full((1, len(values)), capture_ns)
        readings = SensorReadings([TAG], [len(value) for value in values], block, captures_ns)
        times_ns = capture_ns, capture_ns + 20_000_000
        prox = np.array([self.prox], dtype=np.int16)
        self.robots.step(Wanted.RUN, 0, self.timestep, times_ns, readings, prox)
        self.timestep += 1
        return self.written()

    def written(self) -> dict[str, list[list[float]]]:
        found: dict[str, list[list[float]]] = {}
        for line in self.file.read_text().splitlines() if self.file.exists() else []:
            name, *numbers = line.split()
            found.setdefault(name, []).append([float(n) for n in numbers])
        self.file.unlink(missing_ok=True)
        return found

    def said(self) -> dict[str, list[int]]:
        """What its virtual actuators say, by name."""
        report, at, found = self.robots.reports()[TAG], 0, {}
        for name, count in self.actuators.items():
            found[name] = list(report[at : at + count])
            at += count
        return found


def test_rings_are_counter_clockwise_and_parts_of_one(readings: Path, tmp_path: Path) -> None:
    raw = [4096.0, 0.0, 409.6, 0.0, 0.0, 0.0, 2048.0, 8000.0]  # ps0..ps7, clockwise
    names = "epuck_proximity epuck_light proximity light footbot_proximity footbot_light"
    served = {"proximity": raw, "light": [*raw, *range(8)]}
    robot = Robot(readings, tmp_path / "f", served, declared=(names, ""))
    found = robot.step()
    expected = [1.0, 0.5, 0.0, 0.0, 0.0, 0.1, 0.0, 1.0]
    for name in ("epuck_proximity", "epuck_light"):
        (values,) = found[name]
        assert values == pytest.approx(expected + ANGLES, abs=1e-6)
    for name in ("proximity", "light"):
        assert found[name] == [pytest.approx(expected, abs=1e-6)]
    (values,) = found["footbot_proximity"]
    # 24 even ones, from 7.5 degrees, signed: ci_footbot_proximity_sensor.cpp of argos3 421bd76.
    assert values[24:] == pytest.approx([*np.pi / 12 * (np.arange(12) + 0.5),
                                         *np.pi / 12 * (np.arange(12) - 11.5)])  # fmt: skip
    # At 7.5 degrees between the two that look ahead, at 17 and 343: both are 1.
    assert values[0] == pytest.approx(1.0) and values[23] == pytest.approx(1.0)
    # 37.5 degrees, between 17.0 (1.0) and 50.0 (0.5).
    assert values[2] == pytest.approx(1.0 - 0.5 * (37.5 - 17.0) / 33.0, abs=2e-3)


def test_the_robots_own_ring_reads_as_argoss_does(readings: Path, tmp_path: Path) -> None:
    """At each distance of Webots's table ARGoS's formula holds; with nothing near it is 0."""
    robot = Robot(readings, tmp_path / "f", declared=("epuck_proximity", ""))
    for raw, distance_m in ((1466, 0.01), (384, 0.02), (235, 0.03), (158, 0.04)):
        robot.prox = [raw] * 8
        (values,) = robot.step()["epuck_proximity"]
        formula = 298.701 * distance_m**2 - 36.8961 * distance_m + 1.08212
        assert values[:8] == pytest.approx([formula] * 8, abs=1e-3)
    for raw, expected in ((67, 0.0), (100, 0.0), (4095, 1.0)):
        robot.prox = [raw] * 8
        assert robot.step()["epuck_proximity"][0][:8] == [expected] * 8


FOOT_BOT = (
    "vs:ring=24\nvs:below=12\nvs:bases=8\nvs:lamps=13\nvs:axle_cm=14.0\nvs:two_radii_cm=17.0\n"
)
"""What the host says of a foot-bot, as `vsense.config._programs` does."""


def test_a_foot_bot_has_its_own(readings: Path, tmp_path: Path) -> None:
    """All 24, in ARGoS's order, and below the base black or white."""
    names = "footbot_proximity proximity footbot_motor_ground footbot_base_ground range_and_bearing"
    names += " footbot_encoder differential_steering"
    raw = [4096.0 * number / 24 for number in range(24)]
    served = {
        "proximity": raw,
        "ground": [0.1, 0.2, 0.3, 0.4],
        "base_ground": [0.1, 0.49, 0.5, 0.9, 0.0, 1.0, 0.2, 0.7],
        "range_and_bearing": [1.0, 20.0, 0.5, *[7.0] * 4],
    }
    said = {"leds": 39}
    robot = Robot(readings, tmp_path / "f", served, said, (names, "leds"), more=FOOT_BOT)
    found = robot.step()
    ring = pytest.approx([number / 24 for number in range(24)], abs=1e-6)
    assert found["footbot_proximity"][0][:24] == ring and found["proximity"] == [ring]
    below = [value for value, _ in found["footbot_motor_ground"]]
    assert below == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert [value for value, _ in found["footbot_base_ground"]] == [0, 0, 1, 1, 0, 1, 0, 1]
    assert found["range_and_bearing"][0][0] == 37.0
    assert found["footbot_encoder"] == [[0.0, 14.0]]
    assert found["differential_steering"][0][1] == 14.0
    for _ in range(4):
        robot.step()
    assert robot.said() == {"leds": [0] * 5 + [255] + [0] * 30 + [255, 0, 0]}
    # LED 1 of 12, at 45 degrees, is the first of the robot's own ring.
    assert robot.robots.leds.tolist() == [1 << 0]


def test_a_pi_puck_drives_in_m_s_and_measures_in_m(readings: Path, tmp_path: Path) -> None:
    names = "pipuck_rangefinders pipuck_ground pipuck_differential_drive"
    served = {"rangefinders": [0.01 * n for n in range(8)], "ground": [0.1, 0.2, 0.3]}
    more = "vs:axle_cm=5.65\n"
    declared = (names, "pipuck_differential_drive pipuck_leds")
    robot = Robot(readings, tmp_path / "f", served, declared=declared, more=more)
    found = robot.step()
    # Where they look: the lines of pipuck.toml, of which ARGoS's recordings hold the readings.
    lines = np.array(model_of("pipuck").infrared.lines_m)
    assert found["pipuck_rangefinders"] == [
        pytest.approx([n, 0.01 * n, *(line[2:] - line[:2])], abs=1e-6)
        for n, line in enumerate(lines)
    ]
    assert found["pipuck_ground"] == [pytest.approx([n, 0.1 * (n + 1)]) for n in range(3)]
    for _ in range(4):
        found = robot.step()
    assert robot.robots.wheels_steps_s.tolist() == [[round(5 * 77.64), round(-2.5 * 77.64)]]
    assert found["pipuck_differential_drive"] == [pytest.approx([0.05, -0.025], abs=2e-3)]
    assert robot.robots.leds.tolist() == [1 << 7 | Leds.BODY]


def test_ground_battery_and_wheels(readings: Path, tmp_path: Path) -> None:
    names = "epuck_ground ground footbot_motor_ground epuck_battery battery epuck_encoder"
    names += " differential_steering virtual_ground_sensor"
    served = {"ground": [0.1, 0.2, 0.3], "battery": [3800.0]}
    robot = Robot(readings, tmp_path / "f", served, declared=(names, "epuck_wheels"))
    found = robot.step()
    assert found["epuck_ground"] == [pytest.approx([0.1, 0.2, 0.3])]
    # Right, centre, left: epuck_entity.cpp of argos3 421bd76 lines 155-161.
    assert found["ground"] == found["virtual_ground_sensor"] == [pytest.approx([0.3, 0.2, 0.1])]
    # y is 1.16, 1.16, -1.16, -1.16 cm: ci_footbot_motor_ground_sensor.cpp.
    assert [value for value, _ in found["footbot_motor_ground"]] == pytest.approx(
        [0.1, 0.1, 0.3, 0.3]
    )
    assert found["epuck_battery"] == found["battery"] == [[pytest.approx(0.5)]]
    assert found["epuck_encoder"] == [[0.0, 0.0]]
    assert robot.robots.wheels_steps_s.tolist() == [[0, 0]], "not yet: three fresh timesteps"
    for _ in range(3):
        found = robot.step()
    assert robot.robots.wheels_steps_s.tolist() == [[round(5 * 77.64), round(-2.5 * 77.64)]]
    found = robot.step()
    # A tenth of a second of 5 and -2.5 cm/s, in whole steps of 0.0129 cm.
    assert found["epuck_encoder"] == [pytest.approx([0.5, -0.25], abs=0.014)]
    assert found["differential_steering"] == [pytest.approx([5.0, 5.3], abs=0.14)]


def test_neighbours_and_the_camera(readings: Path, tmp_path: Path) -> None:
    place = [12.5, -1.0, 1.0, 2.0, 3.0, 4.0]
    names = "epuck_range_and_bearing range_and_bearing epuck_omnidirectional_camera"
    served = {
        "range_and_bearing": [2.0, *place, 30.0, 2.0, *[255.0] * 4, *[0.0] * 6],
        "omnidirectional_camera": [1.0, 20.0, 0.5, 255.0, 128.0, 7.0, *[0.0] * 5],
    }
    robot = Robot(readings, tmp_path / "f", served, declared=(names, ""))
    found = robot.step()
    assert found["epuck_range_and_bearing"] == [[12.5, -1.0, 1.0, 4.0], [30.0, 2.0, 255.0, 255.0]]
    # Any robot's range is that between the centres; the e-puck's is 7 cm less, its two radii.
    assert found["range_and_bearing"] == [[19.5, -1.0, 4.0, 1.0], [37.0, 2.0, 4.0, 255.0]]
    assert found["epuck_omnidirectional_camera"] == [[1.0, 20.0, 0.5, 255.0, 7.0]]


def test_the_host_says_how_long_messages_are(readings: Path, tmp_path: Path) -> None:
    served = {"range_and_bearing": [2.0, 10.0, 0.0, 5.0, 20.0, 1.0, 6.0, 0.0, 0.0, 0.0]}
    names = ("epuck_range_and_bearing range_and_bearing", "range_and_bearing")
    more = "vs:heard_bytes=1\nvs:said_bytes=2\n"
    robot = Robot(readings, tmp_path / "f", served, {"message": 3}, names, more=more)
    found = robot.step()
    assert found["epuck_range_and_bearing"] == [[10.0, 0.0, 5.0, 0.0], [20.0, 1.0, 6.0, 0.0]]
    assert found["range_and_bearing"][1] == [27.0, 1.0, 1.0, 6.0]
    assert robot.said() == {"message": [2, 0, 77]}


def test_the_originals_virtual_sensors(readings: Path, tmp_path: Path) -> None:
    served = {
        "gps": [1.5, -0.25, 0.75],
        "destination": [0.5, 0.0, 0.0, 1.0, 2.0],
        "rgb_ground": [10.0, 20.0, 30.0, 255.0],
        "radiation": [4.0],
        "pollutant": [1.0],
        "black_white_location": [0.6, 0.8, -0.8, 0.5],
        "light": [5.0, *[0.0] * 7],
    }
    names = "gps_virtual_sensor destination_virtual_sensor virtual_rgb_ground_sensor positioning"
    names += " virtual_radiation_sensor virtual_pollutant_sensor virtual_light_sensor"
    names += " virtual_black_white_location_sensor"
    found = Robot(readings, tmp_path / "f", served, declared=(names, "")).step()
    assert found["gps_virtual_sensor"] == found["positioning"] == [[1.5, -0.25, 0.75]]
    assert found["destination_virtual_sensor"] == [[0.5]]
    assert found["virtual_rgb_ground_sensor"] == [[10.0, 20.0, 30.0]]
    assert found["virtual_radiation_sensor"] == [[4.0]]
    assert found["virtual_pollutant_sensor"] == [[1.0]]
    assert found["virtual_black_white_location_sensor"] == [pytest.approx([0.6, 0.5])]
    assert found["virtual_light_sensor"] == [[0.0] * 7 + [5.0]], "no converter's raw value"


def test_lights_and_messages_go_to_robot_and_host(readings: Path, tmp_path: Path) -> None:
    names = "epuck_base_leds epuck_rgb_leds epuck_range_and_bearing"
    said = {"base_leds": 8, "rgb_leds": 9, "message": 5}
    robot = Robot(readings, tmp_path / "f", {}, said, ("", names))
    for _ in range(4):
        robot.step()
    assert robot.said() == {
        "base_leds": [255, 0, 255, 0, 0, 0, 0, 0],
        "rgb_leds": [0, 255, 0, 0, 255, 0, 1, 2, 3],
        "message": [4, 9, 8, 7, 255],
    }
    # LED 2, on the left, is the robot's own 6: real_epuck_base_leds_actuator.cpp line 16.
    assert robot.robots.leds.tolist() == [1 << 0 | 1 << 6]
    ring = Robot(readings, tmp_path / "g", {}, {"leds": 33}, ("", "leds"))
    for _ in range(4):
        ring.step()
    assert ring.said() == {"leds": [0, 0, 0, 0, 0, 255, *[0] * 24, 255, 0, 0]}
    assert ring.robots.leds.tolist() == [1 << 7]


@pytest.mark.parametrize("build_of", ["readings", "plain"])
def test_init_begins_and_destroy_ends(
    build_of: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    library = request.getfixturevalue(build_of)
    points = "<=point\n@at=1,2\n>=\n<=other\n>=\n<=point\n@at=-3.5,4\n>=\n"
    robot = Robot(library, tmp_path / "f", params=points)
    found = robot.step()
    assert found["point"] == [[1.0, 2.0], [-3.5, 4.0]], "two elements of one name"
    assert found["unset"] == [[0.0] * 64], "new memory is zeros"
    assert robot.robots.logged() == [(TAG, f"logged: {ID} begins")]
    robot.step()
    robot.robots.end()
    assert robot.written() == {"destroyed": [[2.0]]}
    robot.robots.end()
    assert robot.written() == {}, "once"
    again = Robot(library, tmp_path / "f").step()
    assert again["random"] == found["random"], "the robot's seed decides"


@pytest.mark.parametrize("build_of", ["readings", "plain"])
@pytest.mark.parametrize(
    ("params", "declared", "words"),
    [
        ("@missing=epuck_light\n", "", "Unknown sensor type epuck_light requested in controller"),
        ("@missing=epuck_ground\n", "epuck_ground", "<epuck_ground> is of another class"),
        ("@missing=epuck_virtual\n", "epuck_virtual", "<epuck_virtual> is of another class"),
        ("@fail=so it does\n", "", "told to fail: so it does"),
        (f"@fail=so it does {'ü' * 300}!\n", "", f"told to fail: so it does {'ü' * 300}!"),
        ("@fail_in_step=0\n", "", "told to fail in step 0"),
        ("", "epuck_ground", "<epuck_ground> is not there: nobody offers 'ground' to this robot"),
    ],
)
def test_what_it_throws_ends_it_and_is_told(
    build_of: str,
    params: str,
    declared: str,
    words: str,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    library = request.getfixturevalue(build_of)
    robot = Robot(library, tmp_path / "f", declared=(declared, "epuck_wheels"), params=params)
    for _ in range(2):
        with pytest.raises(ControllerFailure, match=words.replace("(", r"\(")):
            robot.step()
        assert not robot.robots.wheels_steps_s.any()
    said = "".join(text.removeprefix("logged: ") for _, text in robot.robots.logged())
    assert "the controller cannot go on:" in said and words in said
    robot.written()
    with pytest.raises(ControllerFailure):
        robot.robots.end()
    assert robot.written() == {}, "nothing of it is called any more"


def test_a_controller_may_catch_and_do_without(tmp_path: Path) -> None:
    library = build.shared(ProgramSources((CATCHING,)))
    robot = Robot(library, tmp_path / "f", declared=("epuck_light", "epuck_wheels"))
    without = Robot(library, tmp_path / "f", declared=("", "epuck_wheels"))
    for _ in range(4):
        robot.step()
        without.step()
    assert robot.robots.wheels_steps_s[0, 0] == round(2 * 77.64)
    assert without.robots.wheels_steps_s[0, 0] == round(77.64)
    thrown = Robot(library, tmp_path / "f", declared=("", "epuck_wheels"), params="@code=3\n")
    with pytest.raises(ControllerFailure, match=r"threw something that is no std::exception"):
        thrown.step()


def test_one_library_may_hold_several(readings: Path, tmp_path: Path) -> None:
    other = build.shared(ProgramSources((READINGS,), (FOLDER,), "other_controller"))
    assert "other" in Robot(other, tmp_path / "f").step()
    assert finding.complete([CATCHING], "", None).label == "catching_controller"
    assert finding.complete([READINGS], "", None).label == ""
    for label in ("", "nobody"):
        unknown = build.shared(ProgramSources((READINGS,), (FOLDER,), label))
        with pytest.raises(ControllerFailure, match="'other_controller', 'readings_controller'"):
            Robot(unknown, tmp_path / "f").step()


def test_what_needs_no_exceptions_is_seen_in_code_only(tmp_path: Path) -> None:
    assert _argos_code.needs_runtime(ProgramSources((CATCHING,)))
    assert not _argos_code.needs_runtime(ProgramSources((READINGS,), (FOLDER,)))
    source, header = tmp_path / "a.cpp", tmp_path / "a.h"
    source.write_text('#include "a.h"\n// catch\n/* throw */ const char *a = "dynamic_cast";\n')
    header.write_text("")
    assert not _argos_code.needs_runtime(ProgramSources((source,)))
    header.write_text("inline int f() { try { return 1; } catch (...) { return 2; } }\n")
    assert _argos_code.needs_runtime(ProgramSources((source,)))


def test_a_controller_that_uses_the_simulator_is_told_with_its_line(tmp_path: Path) -> None:
    source = tmp_path / "a.cpp"
    source.write_text("\n#include <argos3/core/simulator/space/space.h>\n")
    told = _argos_code.explain_simulator(ProgramSources((source,)))
    assert "#ifndef VSENSE" in told
    assert told.splitlines()[1:] == [f"{source}:2: <argos3/core/simulator/space/space.h>"]
    assert _argos_code.explain_simulator(ProgramSources((READINGS,), (FOLDER,))) == ""


EXPERIMENT = """<argos-configuration xmlns:vs="NAMESPACE">
  <framework><experiment length="2" ticks_per_second="10" random_seed="1" /></framework>
  <controllers>
    <readings_controller id="c" library="build/controllers/libreadings.so">
      <actuators><epuck_wheels implementation="default" /></actuators>
      <sensors><epuck_ground implementation="rot_z_only" /></sensors>
      <params file="{file}" />
    </readings_controller>
  </controllers>
  <arena size="3,3,1" center="0,0,0">
    <e-puck id="epuck_1_30"><body position="0.5,0,0" orientation="90,0,0" />
      <controller config="c" /></e-puck>
    <e-puck id="epuck_2_31"><body position="-0.5,0,0" orientation="0,0,0" />
      <controller config="c" /></e-puck>
  </arena>
</argos-configuration>
"""


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository as ARGoS's users have it; gives the experiment's file."""
    shutil.copytree(FOLDER, tmp_path / "controllers" / "sense")
    (tmp_path / "CMakeLists.txt").write_text("project(mine)\nadd_subdirectory(controllers)\n")
    (tmp_path / "controllers" / "CMakeLists.txt").write_text(
        "set(SOURCES # a comment\n  sense/readings.h sense/readings.cpp)\n"
        "add_library(readings MODULE ${SOURCES})\n"
        "target_link_libraries(readings argos3core_simulator)\n"
    )
    file = tmp_path / "experiments" / "mine.argos"
    file.parent.mkdir()
    text = EXPERIMENT.replace("NAMESPACE", NAMESPACE)
    file.write_text(text.format(file=tmp_path / "out."))
    return file


def test_a_repositorys_experiment_runs_as_it_is(repository: Path) -> None:
    experiment = load(repository, stage=Stage.SIM)
    (controller,) = experiment.controllers
    assert controller.library == "build/controllers/libreadings.so"
    assert [path.name for path in controller.sources] == ["readings.cpp"]
    assert controller.params == {"file": str(repository.parents[1] / "out.")}
    assert not any("C++" in warning for warning in experiment.warnings)
    Simulation(experiment, shared_objects(experiment), 1).run()
    for robot in ("epuck_1_30", "epuck_2_31"):
        lines = (repository.parents[1] / f"out.{robot}").read_text().splitlines()
        assert sum(line.startswith("epuck_ground 1 1 1") for line in lines) == 20, "white floor"
        assert lines[-1] == "destroyed 20"


def test_cmake_says_what_a_name_is(repository: Path) -> None:
    """Of what only CMake can know there is nothing."""
    root = repository.parents[1]
    with (root / "CMakeLists.txt").open("a") as file:
        file.write(
            'add_definitions("-DBRANCH=\\"${GIT_BRANCH}\\"")\nadd_compile_definitions(N=3)\n'
        )
    source = root / "controllers" / "sense" / "readings.cpp"
    asserted = 'static_assert(sizeof(BRANCH) == 1 && N == 3, "as CMake says");\n'
    source.write_text(asserted + source.read_text())
    assert list(shared_objects(load(repository, stage=Stage.SIM))) == ["c"]


def test_a_command_is_read_however_deep_its_conditions_are(tmp_path: Path) -> None:
    (tmp_path / "a.c").touch()
    lines = (
        'if(NOT (A AND (B OR (C))))\n#[[ add_library(x b.c) ]]\nadd_library(m "a.c")\nadd_library('
    )
    (tmp_path / "CMakeLists.txt").write_text(lines)
    found = _cmake.read(tmp_path, [tmp_path / "CMakeLists.txt"])
    assert [*found.targets] == ["m"] and found.sources("m") == [tmp_path / "a.c"]


def found(file: Path, code: CodeOptions | None = None) -> list[str]:
    return [path.name for path in load(file, code=code).controllers[0].sources]


def test_sources_are_named_or_found_without_cmake(repository: Path) -> None:
    root = repository.parents[1]
    shutil.move(root / "controllers", root / "elsewhere")
    (root / "CMakeLists.txt").unlink()
    warnings = load(repository).warnings
    assert any("its sources are not found: the robots stand still" in w for w in warnings)
    code = CodeOptions.of([f"libreadings.so={root}/elsewhere/sense/r*.cpp"], [])
    assert found(repository, code) == ["readings.cpp"]
    for name in ("readings_controller", "c"):
        named = CodeOptions.of([f"{name}={root}/elsewhere/sense/readings.cpp"], [])
        assert found(repository, named) == ["readings.cpp"]
    of_repository = CodeOptions.of([f"readings={root}/elsewhere"], [])
    assert found(repository, of_repository) == ["readings.cpp"]
    text = repository.read_text()
    repository.write_text(text.replace("library=", 'vs:sources="../elsewhere/sense/*" library='))
    assert found(repository) == ["readings.cpp", "catching.cpp"]
    blank = shutil.copytree(root / "elsewhere" / "sense", root / "else [where]")
    sources = f"{blank}/readings.cpp, {blank}/catching.cpp"
    repository.write_text(text.replace("library=", f'vs:sources="{sources}" library='))
    assert found(repository) == ["readings.cpp", "catching.cpp"]
    nobody = text.replace("readings_controller", "nobody")
    repository.write_text(nobody.replace("library=", f'vs:sources="{sources}" library='))
    with pytest.raises(
        ConfigError, match=r"readings\.cpp.* names 'nobody'; there are: .*readings_"
    ):
        load(repository)
    repository.write_text(text)
    shutil.move(root / "elsewhere" / "sense", root / "controllers" / "readings")
    assert found(repository) == ["readings.cpp", "catching.cpp"], "a folder of the library's name"
    with pytest.raises(ConfigError, match=r"mine\.argos:4: .*nothing\.cpp: no C or C\+\+ file"):
        found(repository, CodeOptions.of(["readings=nothing.cpp"], []))
    with pytest.raises(UsageError, match=r"--sources raedings=.*: nothing .* is 'readings' meant"):
        found(repository, CodeOptions.of(["raedings=readings.cpp"], []))
    with pytest.raises(UsageError, match=r"--sources readings: expected NAME=FILE"):
        CodeOptions.of(["readings"], [])


def test_headers_of_another_repository_bring_its_sources(repository: Path, cache: Path) -> None:
    root = repository.parents[1]
    other = root / "library" / "src"
    other.mkdir(parents=True)
    (other / "helper.h").write_text("int Help();\n")
    (other / "helper.cpp").write_text('#include "helper.h"\nint Help() { return 1; }\n')
    source = root / "controllers" / "sense" / "readings.cpp"
    source.write_text("#include <argos3/own/helper.h>\nint help = Help();\n" + source.read_text())
    program = load(repository).controllers[0].program
    with pytest.raises(BuildError, match=r"readings\.cpp:1: <argos3/own/helper\.h>"):
        build.shared(program)
    code = CodeOptions.of([], [f"argos3/own={other}"])
    experiment = load(repository, code=code)
    assert [p.name for p in experiment.controllers[0].sources] == ["readings.cpp", "helper.cpp"]
    first = shared_objects(experiment)["c"]
    (other / "helper.h").write_text("int Help(); // changed\n")
    assert shared_objects(load(repository, code=code))["c"] != first


def test_an_error_names_the_users_file_and_line(repository: Path) -> None:
    source = repository.parents[1] / "controllers" / "sense" / "readings.cpp"
    source.write_text(source.read_text() + "int broken = ;\n")
    line = len(source.read_text().splitlines())
    with pytest.raises(BuildError, match=rf"readings\.cpp does not (.|\n)*readings\.cpp:{line}:"):
        shared_objects(load(repository))


def test_in_a_simulation_the_error_names_element_and_robot(repository: Path) -> None:
    text = repository.read_text().replace('<params file="', '<params missing="epuck_light" file="')
    repository.write_text(text)
    experiment = load(repository, stage=Stage.SIM)
    message = r"mine\.argos:4: <readings_controller> cannot go on, robot 'epuck_1_30': .*Unknown"
    with pytest.raises(Exception, match=message):
        Simulation(experiment, shared_objects(experiment), 1).run()


PLAIN = """
#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/plugins/robots/generic/control_interface/ci_differential_steering_actuator.h>

using namespace argos;

class CPlain : public CCI_Controller
{
public:
    virtual void Init(TConfigurationNode &)
    {
        m_pcWheels = GetActuator<CCI_DifferentialSteeringActuator>("differential_steering");
    }
    virtual void ControlStep() { m_pcWheels->SetLinearVelocity(1.0, 2.0); }

private:
    CCI_DifferentialSteeringActuator *m_pcWheels;
};

REGISTER_CONTROLLER(CPlain, "plain_controller")
"""


@pytest.mark.parametrize("name", ["plain", "catching"])
def test_on_the_oldest_board_it_lives_and_fails_in_order(name: str, tmp_path: Path) -> None:
    """Nobody declares wheels to it there: without exceptions and with them it is told so, and the
    daemon goes on."""
    qemu = require_tool("qemu-arm", "qemu-user")
    require_zig()
    source = tmp_path / "plain.cpp"
    source.write_text(PLAIN)
    program = ProgramSources((source,) if name == "plain" else (CATCHING,))
    assert _argos_code.needs_runtime(program) == (name == "catching")
    tree = build.source_tree()
    made = tree.daemon(program, plain=True)
    own = [path for path in made.own if path.name != "main.c"]
    steps = replace(made, own=[*own, BENCH / "robot_steps.c"], fast=())
    steps.link(boards.toolchain(boards.TARGETS["epuck"], build.cache_directory()), tmp_path / "s")
    command = [qemu, "-cpu", "arm926", tmp_path / "s", "live", "50"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout.strip()) == (0, "50"), done.stderr
    size = (tmp_path / "s").stat().st_size
    print(f"control steps for ARMv5 with the controller {name}: {size} bytes")
    assert size < (200_000 if name == "plain" else 400_000)
