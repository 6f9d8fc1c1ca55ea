"""Loop functions in C++ for ARGoS: what they see, what they change, and what they may not break."""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.conftest import require_tool
from vsense.base.arena import ArenaState
from vsense.base.errors import VsenseError
from vsense.base.interruption import Interruption
from vsense.config.experiment import load
from vsense.config.specs import Experiment, Stage
from vsense.modes.sim._simulation import Simulation
from vsense.modes.sim.engine import Engine
from vsense.modes.sim.job import Job, Setup, Sweep
from vsense.modes.sim.outcome import Task, libraries_of
from vsense.modes.sim.watch import simulate_all
from vsense.robots import build
from vsense.robots.sources import CodeOptions, ProgramSources
from vsense.run import _loop_process
from vsense.run._loop_kernel import FloorPainter, LoopFloor
from vsense.run.cxx_loop import CxxLoopFunctions
from vsense.run.environment import Environment
from vsense.run.programs import shared_objects
from vsense.studies.series import campaign
from vsense.studies.series.campaign import Campaign
from vsense.world.entities import Box, Led, Light

HERE = Path(__file__).parent / "argos"
States = Callable[..., ArenaState]
TAGS = "one", "two", "six"


@pytest.fixture(scope="module")
def folder(shared_cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The mission, which is built once."""
    require_tool("c++", "build-essential")
    made = tmp_path_factory.mktemp("mission")
    for name in ("mission.cpp", "mission.argos"):
        shutil.copy2(HERE / name, made / name)
    return made


@pytest.fixture
def mission(folder: Path) -> Callable[..., Path]:
    def make(**params: str) -> Path:
        text = (folder / "mission.argos").read_text()
        words = " ".join(f'{key}="{value}"' for key, value in params.items())
        path = folder / f"mission-{'-'.join(params.values())}.argos"
        path.write_text(text.replace('edge="0.0" end="0"', words))
        return path

    return make


def simulated(path: Path, seed: int = 7) -> Simulation:
    experiment = load(path, stage=Stage.SIM)
    return Simulation(experiment, shared_objects(experiment), seed)


def places(experiment: Experiment) -> dict[int, tuple[float, float, float]]:
    return {robot.tag: tuple(robot.pose or (0, 0, 0)) for robot in experiment.robots}  # type: ignore[misc]


def test_a_simulation_goes_as_they_say(mission: Callable[..., Path]) -> None:
    run = simulated(mission(edge="0.0"))
    world = run.environment.world
    assert isinstance(added := world.entities["added"], Box)
    assert (added.position_m, added.size_m) == ((0.3, 0.5, 0.0), (0.2, 0.1, 0.3))
    assert added.yaw_rad == pytest.approx(np.pi / 4)
    assert {"there", "post", "lamp"} < world.entities.keys()
    assert world.floor.sample([(1e-9, 0.3), (-1e-9, 0.3)]).tolist() == [
        [0, 0, 0, 255],
        [10, 20, 30, 255],
    ]
    measures = run.run()
    poses = run.record.poses
    assert np.abs(poses[0, :, :2]).max() < 0.21, "Init has placed them"
    apart = poses[0, :, None, :2] - poses[0, None, :, :2]
    assert (np.hypot(*apart.T) + np.eye(3)).min() >= 0.07
    # The edge lies at 0 in the first four timesteps, and at 0.3, where nobody is, in the others.
    assert measures == {
        "objective": 4.0 * (poses[0, :, 0] > 0).sum(),
        "Score": 4.0 * (poses[0, :, 0] > 0).sum() + 0.5,
    }
    assert [text.removeprefix("loop functions: ") for _, text in run.record.events] == [
        "from -1.2,-1.2,0 to 1.2,1.2,1 1 floor 11 LEDs",
        "arena 2.4,2.4,1 seed 7 length 20 tick 0.1",
        "first step\rfinished at 1",  # it is a text, not the word with which they end a run
        "Score = " + f"{measures['Score']:g}",
        "the end is near",
        "destroyed",
    ]


def test_what_stands_and_shines_changes(mission: Callable[..., Path]) -> None:
    run = simulated(mission(edge="0.0"))
    world = run.environment.world
    # Who has looked once is shown the last floor, when the functions are there no longer.
    assert world.floor.picture(48) is not None
    run.run()
    assert isinstance(moved := world.entities["added"], Box)
    assert (moved.position_m, moved.yaw_rad) == ((0.6, 0.6, 0.0), 0.0)
    assert moved.physical, "what stands in ARGoS's arena is solid"
    assert moved.leds == (Led((0.1, 0.0, 0.2), (0, 255, 0)),)
    assert "post" not in world.entities
    assert isinstance(lamp := world.entities["lamp"], Light)
    assert (lamp.intensity, lamp.color, lamp.position_m) == (1.25, (0, 0, 255), (0.0, 0.0, 0.5))
    image = world.floor.picture(48)
    assert image is not None
    columns = (image == 0).all(axis=(0, 2))
    # 48 pixels over 2.4 m: the edge at 0.3 m is that of pixel 30.
    assert columns.tolist() == [False] * 30 + [True] * 18
    assert image.shape == (48, 48, 3)


RESTLESS = r"""
#include "controller.h"

struct restless { int ground, leds, steps; };

static void init(void *state, struct vs_robot *robot)
{
    struct restless *s = state;

    s->ground = vs_robot_sensor(robot, "ground");
    s->leds = vs_robot_actuator(robot, "rgb_leds");
}

static void step(void *state, struct vs_robot *robot)
{
    struct restless *s = state;
    double floor[3] = {0.0, 0.0, 0.0};
    int i;

    vs_robot_values(robot, s->ground, floor, 3);
    vs_robot_set_wheels(robot, 200 + (int)(4000.0 * floor[0]), 300 - (int)(4000.0 * floor[2]));
    for (i = 0; i < 9; i++)
        vs_robot_actuate(robot, s->leds, i, s->steps / 6 % 3 == 1 && i % 3 > 0 ? 255 : 0);
    s->steps++;
}

const struct vs_controller vs_controller = {"restless", sizeof(struct restless), init, step};
"""


def test_a_timestep_in_c_calls_them_as_one_in_python(
    mission: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They move robots and things, log, look at LEDs, change the floor, and end the run."""
    path = mission(restless="true", end="18")
    path.with_name("restless.c").write_text(RESTLESS)
    devices = (
        ("<sensors />", '<sensors><epuck_ground implementation="rot_z_only" /></sensors>'),
        ("<actuators />", '<actuators><epuck_rgb_leds implementation="default" /></actuators>'),
        ('library="stand_still"', 'library="restless.c"'),
    )
    text = path.read_text()
    for old, new in devices:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    outcomes, calls = [], list[str]()
    heard = CxxLoopFunctions.heard

    def counted(loop: CxxLoopFunctions, world: Any, function: int, is_called: bool) -> int:
        calls.append(f"{function} {is_called}")
        return heard(loop, world, function, is_called)

    monkeypatch.setattr(CxxLoopFunctions, "heard", counted)
    for chained in (True, False):
        run = simulated(path)
        if not chained:
            monkeypatch.setattr(run, "_chained", lambda: None)
        measures = run.run()
        record = run.record
        assert (run.chain is not None) is chained
        outcomes.append((measures, record.events, record.poses.tobytes(), record.leds.tobytes()))
    assert outcomes[0] == outcomes[1]
    assert len(run.record.timesteps) == 18 and any("shines" in text for _, text in record.events)
    # Before the step a move; after it changed LEDs, a move or a word, and the end.
    assert set(calls) == {"0 True", "1 False", "1 True", "2 True"}


def test_leds_that_they_look_at_are_there_without_a_camera(mission: Callable[..., Path]) -> None:
    path = mission(edge="0.0")
    shining = path.with_name("shining.argos")
    leds = '<actuators><epuck_rgb_leds implementation="default" /></actuators>'
    shining.write_text(path.read_text().replace("<actuators />", leds))
    (controller,) = load(shining, stage=Stage.SIM).controllers
    assert [mounted.actuator.name for mounted in controller.actuators] == ["rgb_leds"]
    unseen = shining.read_text().replace('library="build/libmission.so"', 'library="gone.so"')
    shining.write_text(unseen.replace('label="mission"', 'label="gone"'))
    (controller,) = load(shining, stage=Stage.SIM).controllers
    assert controller.actuators == ()


def test_robots_drive_against_what_they_added(mission: Callable[..., Path]) -> None:
    run = simulated(mission(edge="0.0"))
    rows = run._physics.near.cdata
    assert (rows.boxes, rows.bodies) == (2, 4), "there and added; three robots and the post"
    for timestep in range(6):
        run.step(timestep)
    rows = run._physics.near.cdata
    assert (rows.boxes, rows.bodies) == (2, 3)


def test_an_arena_of_blocks_has_its_place_and_colours(mission: Callable[..., Path]) -> None:
    """Source: arena_entity.cpp and wall_entity.cpp of argos3-arena at 480285b: a hexagon of walls
    of two blocks of 0.5 m, whose middles are at 0.5 m / tan(30 degrees) from its own."""
    run = simulated(mission(edges="6"))
    blocks = [e for e in run.environment.world.boxes() if e.id.startswith("walls.")]
    assert len(blocks) == 12
    assert "loop functions: 14 blocks" in [
        f"loop functions: {text}" for text in run.environment.said()
    ]
    inner_m = 0.5 / np.tan(np.pi / 6)
    first, red = blocks[0], blocks[2]
    assert first.id == "walls.wall_0.block_1"
    assert first.position_m == pytest.approx((inner_m, -0.25, 0.0))
    assert abs(first.yaw_rad) == pytest.approx(np.pi)
    assert red.id == "walls.wall_1.block_1"
    sine, cosine = np.sin(np.pi / 3), np.cos(np.pi / 3)
    place = inner_m * cosine + 0.25 * sine, inner_m * sine - 0.25 * cosine
    assert red.position_m[:2] == pytest.approx(place)
    assert [led.offset_m for led in red.leds] == [
        pytest.approx((0.0075, -0.125, 0.067)),
        pytest.approx((0.0075, 0.125, 0.067)),
    ]
    assert {led.color for led in red.leds} == {(255, 0, 0)}
    assert {led.color for e in blocks if e is not red for led in e.leds} == {(0, 0, 255)}
    across = [e for e in run.environment.world.boxes() if e.id.startswith("across.")]
    away = 0.125 * np.sin(np.pi / 4)
    assert [e.id for e in across] == ["across.block_1", "across.block_2"]
    assert across[0].position_m[:2] == pytest.approx((0.2 - away, 0.1 + away))
    assert across[1].position_m[:2] == pytest.approx((0.2 + away, 0.1 - away))
    assert {led.color for e in across for led in e.leds} == {(0, 255, 0)}
    assert len(across[0].leds) == 2 and across[0].yaw_rad == pytest.approx(np.pi / 4)
    assert run._physics.near.cdata.boxes == 16, "they are solid: with them there and added"
    run.run()
    assert [e.id for e in run.environment.world.boxes()] == ["there", "added"], "all removed"


def test_a_seed_repeats_a_run(mission: Callable[..., Path]) -> None:
    path = mission(edge="0.0")
    poses = []
    for seed in (1, 1, 2):
        run = simulated(path, seed)
        run.run()
        poses.append(run.record.poses)
    assert (poses[0] == poses[1]).all()
    assert (poses[0] != poses[2]).any()


@pytest.mark.parametrize("end", ["0", "8"])
def test_timesteps_in_c_are_the_same(
    mission: Callable[..., Path], end: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = []
    for chained in (True, False):
        with monkeypatch.context() as patch:
            if not chained:
                patch.setattr(Simulation, "_chained", lambda run: None)
            run = simulated(mission(edge="0.0", end=end))
            measures = run.run()
            assert (run.chain is not None) == chained
            poses = run.record.poses.tobytes(), run.record.leds.tobytes()
            runs.append((poses, measures, run.record.events, dict(run.environment.world.entities)))
    assert runs[0] == runs[1]


def test_a_picture_asks_for_the_middles_of_its_pixels() -> None:
    asked = []

    def ask(points_m: NDArray[np.float64]) -> NDArray[np.uint8]:
        asked.append(points_m.copy())
        return np.zeros((len(points_m), 3), np.uint8)

    painter = FloorPainter(ask, None)
    floor = LoopFloor(None, (2.0, 1.0), (0.3, -0.4), painter=painter, pixels_per_m=2.0)
    image = floor.picture(100)
    assert image is not None and image.shape == (2, 4, 3)
    middles = [(x, y) for y in (-0.15, -0.65) for x in (-0.45, 0.05, 0.55, 1.05)]
    assert np.vstack(asked) == pytest.approx(np.array(middles))


def test_a_picture_of_the_floor_is_no_part_of_a_run(mission: Callable[..., Path]) -> None:
    """GetFloorColor says something in timestep 9, wherever it is asked."""
    runs = []
    for is_watched in (True, False):
        run = simulated(mission(restless="true", end="18"))
        pictures: list[NDArray[np.uint8] | None] = []
        if is_watched:
            floor = run.environment.world.floor
            run.observe = lambda _, to=pictures, ask=floor.picture: to.append(ask(16))
        run.run()
        assert len(pictures) == (18 if is_watched else 0)
        rows = [image[0].tolist() for image in pictures if image is not None]
        colors = {tuple(color) for row in rows for color in row}
        assert colors == ({(0, 0, 0), (10, 20, 30)} if is_watched else set())
        runs.append((run.record.poses.tobytes(), run.record.events))
    assert runs[0] == runs[1]


def test_they_end_a_run(mission: Callable[..., Path]) -> None:
    run = simulated(mission(edge="0.0", end="8"))
    run.run()
    assert len(run.record.timesteps) == len(run.record.poses) == 8


@pytest.mark.parametrize("where", ["Init", "PreStep", "PostExperiment", "GetFloorColor"])
def test_what_they_throw_names_the_function(mission: Callable[..., Path], where: str) -> None:
    path = mission(fails_in=where, how="throw")
    with pytest.raises(
        VsenseError, match=rf"'mission' \(mission\.cpp\): in {where}: thrown in {where}"
    ):
        run = simulated(path)
        run.environment.world.floor.sample([(0.0, 0.0)])
        run.run()


@pytest.mark.parametrize("chained", [True, False])
def test_a_floor_that_throws_ends_the_run(
    mission: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, chained: bool
) -> None:
    """Where the ground sensor asks in C, and where in Python."""
    path = mission(fails_in="GetFloorColor", how="throw", fails_from="9")
    ground = '<sensors><epuck_ground implementation="rot_z_only" /></sensors>'
    path.write_text(path.read_text().replace("<sensors />", ground))
    run = simulated(path)
    if not chained:
        monkeypatch.setattr(run, "_chained", lambda: None)
    with pytest.raises(VsenseError, match=r"^loop functions 'mission'.*: thrown in GetFloorColor$"):
        run.run()
    assert (run.chain is not None, len(run.record.timesteps)) == (chained, 8)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("controller", "apart from loop functions"),
        ("robot", 'AddEntity: "another".*<distribute>'),
    ],
)
def test_what_cannot_be_had_is_said(mission: Callable[..., Path], how: str, words: str) -> None:
    with pytest.raises(VsenseError, match=words):
        simulated(mission(fails_in="PreStep", how=how)).run()


@pytest.mark.parametrize(
    ("where", "how", "words"),
    [
        (
            "PostStep",
            "crash",
            r"timestep 0 \(t = 0 s\):.*'mission' \(.*mission\.cpp\): PostStep.*SIGSEGV",
        ),
        ("Init", "crash", "Init.*SIGSEGV"),
        ("PreStep", "hang", r"timestep 0.*PreStep.*0\.5 s"),
        ("PostStep@8", "crash", r"timestep 7 \(t = 0\.7 s\):.*: PostStep.*SIGSEGV"),
        ("GetFloorColor@6", "crash", r"timestep 5 \(t = 0\.5 s\):.*: GetFloorColor.*SIGSEGV"),
        ("IsExperimentFinished@6", "hang", r"timestep 5.*: IsExperimentFinished.*0\.5 s"),
        ("PostExperiment", "throw", "PostExperiment:.*PostExperiment"),
    ],
)
def test_a_simulations_end_names_the_function(
    mission: Callable[..., Path], tmp_path: Path, where: str, how: str, words: str
) -> None:
    """From the second timestep on it is C that calls them."""
    where, _, begin = where.partition("@")
    path = mission(fails_in=where, how=how, fails_from=begin or "0")
    sensors = '<sensors><epuck_ground implementation="rot_z_only" /></sensors>'
    path.write_text(path.read_text().replace("<sensors />", sensors))
    setup = Setup(str(path), 1.0)
    experiment = setup.load()
    libraries = {name: str(made) for name, made in shared_objects(experiment).items()}
    task = Task(Job(setup, 1, libraries, str(tmp_path)), experiment)
    going = simulate_all([task], 1, threading.Event(), lambda workers: None, 0.5)
    with pytest.raises(VsenseError, match=words) as failure:
        list(going)
    *_, (time_s, *last) = csv.reader((tmp_path / "events.csv").open())
    assert last == ["trouble", "", str(failure.value)]
    # The end throws when all is done: nothing of the run is lost.
    done = len(np.load(tmp_path / "trajectory.npz")["time_s"]) if how == "throw" else 0
    at_s = (int(begin) - 1) / 10 if begin else 0.0
    assert (float(time_s), done) == ((1.0, 10) if how == "throw" else (at_s, 0))


def test_real_robots_stay_where_they_are(mission: Callable[..., Path], state: States) -> None:
    experiment = load(mission(edge="0.0"))
    here = Environment(experiment, 7)
    assert here.moved() == {}
    told = [text for text in here.said() if "real robots" in text]
    assert told == [
        "real robots stay where they are: MoveEntity of robots by the loop functions is passed over"
    ]
    assert not here.world.entities["added"].physical  # type: ignore[union-attr]
    poses = places(experiment)
    tags = sorted(poses)
    here.step(state({**poses, tags[0]: (0.5, 0.0, 0.0)}, 100_000_000), 0, {})
    here.world.led_colors[1, 10] = 0, 255, 255
    here.step(state({**poses, tags[0]: (0.5, 0.0, 0.0)}, 200_000_000), 1, {})
    assert "two_2_r shines at 2" in here.said()
    here.world.led_colors[1, 10] = 0
    here.step(state(poses, 300_000_000), 2, {})
    assert not any("shines" in text for text in here.said())
    assert here.end()["objective"] == 2.0, "one robot was right of the edge, in two timesteps"


def test_a_reset_calls_theirs(mission: Callable[..., Path], state: States) -> None:
    experiment = load(mission(edge="0.0"))
    here = Environment(experiment, 7)
    poses = {tag: (0.5, 0.3 * n, 0.0) for n, tag in enumerate(places(experiment))}
    for timestep in range(5):
        here.step(state(poses, (timestep + 1) * 100_000_000), timestep, {})
    assert "post" not in here.world.entities
    here.reset()
    assert "reset" in here.said()
    entities = here.world.entities
    assert isinstance(added := entities["added"], Box)
    assert isinstance(lamp := entities["lamp"], Light)
    assert (added.position_m, lamp.color) == ((0.3, 0.5, 0.0), (255, 255, 0))
    here.step(state(poses, 900_000_000), 0, {})
    assert here.end()["objective"] == 3.0
    assert here.following().seed == 8


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("crash", r"PostStep was killed by SIGSEGV"),
        ("hang", r"PostStep did not return within 0\.3 s"),
        ("throw", r"in PostStep: thrown in PostStep"),
    ],
)
def test_a_process_of_their_own_may_break(
    mission: Callable[..., Path],
    state: States,
    monkeypatch: pytest.MonkeyPatch,
    how: str,
    words: str,
) -> None:
    monkeypatch.setattr(_loop_process, "CALL_LIMIT_S", 0.3)
    experiment = load(mission(fails_in="PostStep", how=how))
    here = Environment(experiment, 7)
    here.world.floor.picture(100)
    with pytest.raises(VsenseError, match=rf"loop functions 'mission' \(mission\.cpp\): {words}"):
        here.step(state(places(experiment), 100_000_000), 0, {})
    # The world is there for the recording's end, and its floor for whoever draws it.
    assert here.end() == {}
    assert here.world.floor.sample([(0.5, 0.0)]).tolist() == [[0, 0, 0, 255]]


def test_sources_that_are_not_found_are_told(folder: Path, tmp_path: Path) -> None:
    text = (folder / "mission.argos").read_text()
    (tmp_path / "alone.argos").write_text(text)
    experiment = load(tmp_path / "alone.argos")
    assert experiment.loop_functions is None
    assert any(
        "alone.argos:14" in words and "--sources mission=FILES" in words
        for words in experiment.warnings
    )
    code = CodeOptions({"mission": [str(folder / "mission.cpp")]}, ())
    found = load(tmp_path / "alone.argos", code=code).loop_functions
    assert found is not None
    assert found.path == folder / "mission.cpp"


CASTING = """#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/core/simulator/loop_functions.h>
// No use: e.GetController()
struct CMine : argos::CCI_Controller { void ControlStep(); int value; };
class CCasts : public argos::CLoopFunctions {
    void PostStep() {
        argos::CControllableEntity entity(NULL, "a");
        entity.SetEnabled(dynamic_cast<CMine &>(
            entity.GetController()).value > 0);
    }
};
REGISTER_LOOP_FUNCTIONS(CCasts, "casts")
"""


def test_a_cast_to_a_controllers_class_is_told_with_its_line(folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "casts.cpp"
    source.write_text(CASTING)
    with pytest.raises(VsenseError) as told:
        build.loop_functions(ProgramSources((source,), (tmp_path,)))
    first, use, *_ = str(told.value).splitlines()
    assert "use the class of a controller" in first and "#ifndef VSENSE" in first
    assert use == f"{source}:9: GetController():"
    assert "undefined reference" in str(told.value)


def test_an_unknown_label_lists_those_there_are(mission: Callable[..., Path]) -> None:
    path = mission(edge="0.0")
    path.write_text(path.read_text().replace('label="mission"', 'label="another"'))
    options: dict[str, Any] = {
        "code": CodeOptions({"mission": [str(path.with_name("mission.cpp"))]})
    }
    experiment = load(path, stage=Stage.SIM, **options)
    with pytest.raises(VsenseError, match="'another', expected: 'mission'"):
        Simulation(experiment, shared_objects(experiment), 1)


def test_every_run_of_a_campaign_knows_the_sources_and_others_make_another_campaign(
    mission: Callable[..., Path], folder: Path
) -> None:
    path = mission(edge="0.0")
    # TinyXML takes this comment, Python's parser does not.
    path.write_text(path.read_text() + "<!-- one -- two -->")
    code = CodeOptions(includes=(str(folder),))
    setup, table = Setup(str(path), code=code), folder / "r.csv"
    made = Campaign(Sweep.of([], 2, None), setup, table, table.with_suffix(".png"))
    plan, known = campaign.prepare(made)
    (planned,) = known.values()
    assert made.setup_of(planned) == setup
    job = Job(setup, 1, libraries_of(planned.experiment))
    task = Task(job, planned.experiment)
    with ThreadPoolExecutor(1) as threads:
        found = list(Engine("it", threads).simulate([task], Interruption(), lambda _: None))
    ((_, here),) = simulate_all([task], 1, threading.Event(), lambda _: None)
    assert found[0][1]["events"] == here["events"] != []
    assert campaign.prepare(made)[0].name == plan.name
    source = folder / "mission.cpp"
    source.write_text(f"{source.read_text()}// edited\n")
    assert campaign.prepare(made)[0].name != plan.name


KINDS = """
#include <argos3/core/simulator/loop_functions.h>
#include <argos3/plugins/robots/e-puck/simulator/epuck_entity.h>
#include <argos3/plugins/robots/foot-bot/simulator/footbot_entity.h>
#include <argos3/plugins/robots/pi-puck/simulator/pipuck_entity.h>

using namespace argos;

class CKinds : public CLoopFunctions
{
    template <typename ROBOT> void Tell(const std::string &type)
    {
        for (auto &each : GetSpace().GetEntitiesByType(type)) {
            ROBOT &robot = *any_cast<ROBOT *>(each.second);
            LOG << type << " " << each.first << " " << robot.GetLEDEquippedEntity().GetLEDs().size()
                << " at " << robot.GetEmbodiedEntity().GetOriginAnchor().Position << std::endl;
        }
    }

public:
    void Init(TConfigurationNode &) override
    {
        Tell<CEPuckEntity>("epuck");
        Tell<CFootBotEntity>("foot-bot");
        Tell<CPiPuckEntity>("pipuck");
    }
    CColor GetFloorColor(const CVector2 &) override { return CColor::WHITE; }
};

REGISTER_LOOP_FUNCTIONS(CKinds, "kinds")
"""


def test_they_find_each_kind_of_robot(shared_cache: Path, tmp_path: Path) -> None:
    require_tool("c++", "build-essential")
    (tmp_path / "kinds.cpp").write_text(KINDS)
    robots = (("e-puck", "e", "0,0"), ("foot-bot", "f", "0.5,0"), ("pipuck", "p", "0,0.5"))
    placed = "".join(
        f'<{kind} id="{name}"><body position="{place},0" orientation="0,0,0" />'
        f'<controller config="{name}" /></{kind}>'
        for kind, name, place in robots
    )
    controllers = "".join(f'<c id="{name}" library="stand_still" />' for _, name, _ in robots)
    (tmp_path / "kinds.argos").write_text(f"""<argos-configuration>
<framework><experiment length="1" ticks_per_second="10" random_seed="7" /></framework>
<controllers>{controllers}</controllers>
<loop_functions library="build/libkinds.so" label="kinds" />
<arena size="3,3,1" center="0,0,0.5">{placed}</arena>
<physics_engines><dynamics2d id="d" /></physics_engines></argos-configuration>""")
    said = simulated(tmp_path / "kinds.argos").environment.said()
    assert [line for line in said if " at " in line] == [
        "epuck e 11 at 0,0,0",
        "foot-bot f 13 at 0.5,0,0",
        "pipuck p 10 at 0,0.5,0",
    ]


TALKS = """
import os, sys
from vsense.run._loop_process import talk_aside
before = os.fstat(1).st_ino
with talk_aside():
    for number in range(3000):
        os.write(1 + number % 2, f"{number:99}\\n".encode())
    open(sys.argv[1], "w").close()
assert os.fstat(1).st_ino == before
"""


@pytest.mark.parametrize("is_read", [True, False])
def test_what_it_prints_waits_for_no_reader(tmp_path: Path, is_read: bool) -> None:
    command = [sys.executable, "-c", TALKS, str(tmp_path / "returned")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert process.stdout is not None
    try:
        said = process.stdout.read() if is_read else b""
        for _ in range(600):
            if (tmp_path / "returned").exists():
                break
            time.sleep(0.05)
        assert (tmp_path / "returned").exists()
        if is_read:
            assert [int(line) for line in said.splitlines()] == list(range(3000))
            assert process.wait(30.0) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
