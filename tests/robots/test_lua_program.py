"""Controllers in Lua: they read and set what they do in ARGoS, and what their mistakes cost."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.rigs.places import DATA
from tests.world.sensors.scenes import arena_state
from vsense import cli
from vsense.base.errors import VsenseError
from vsense.config.experiment import load
from vsense.config.specs import Stage
from vsense.modes.sim.fingerprint import named_files
from vsense.robots.link.wire import Wanted
from vsense.run.environment import Environment
from vsense.run.programs import Programs, shared_objects
from vsense.studies.series._simulated import programs_of

RECORDED = DATA / "argos-lua"
STEP_NS = 100_000_000
GREY = 102
"""ARGoS's GRAY40, of floor.cpp."""

Steps = list[dict[str, list[list[float]]]]
"""By step, and by name, the lines that compare.lua has written."""


def read(path: Path) -> Steps:
    steps: Steps = []
    for name, *numbers in map(str.split, path.read_text().splitlines()):
        if name == "step":
            steps.append(defaultdict(list))
        steps[-1][name].append([float(number) for number in numbers])
    return steps


def written(file: Path) -> None:
    """The experiment in a folder of its own, with the floor as a picture."""
    white = np.full((2, 2), 255, np.uint8)
    white[0, 1] = white[1, 0] = GREY
    cv2.imwrite("floor.png", white)
    text = (RECORDED / file.name).read_text()
    text = text.replace('source="loop_functions" pixels_per_meter="10"',
                        'source="image" path="floor.png"')  # fmt: skip
    lines = [line for line in text.splitlines() if "<loop_functions" not in line]
    file.write_text("\n".join(lines))
    shutil.copy(RECORDED / "compare.lua", ".")
    Path("out").mkdir()


@pytest.mark.parametrize("kind", ["own", "any", "foot", "pi"])
def test_scripts_read_and_set_what_they_do_in_argos(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written(Path(f"{kind}.argos"))
    experiment = load(Path(f"{kind}.argos"), stage=Stage.SIM)
    tags = {robot.tag: robot.id for robot in experiment.robots}
    recorded = {name: read(RECORDED / f"{name}.txt") for name in tags.values()}
    environment = Environment(experiment, 1)
    controllers = dict.fromkeys(tags, experiment.controllers[0].id)
    libraries, tables = shared_objects(experiment), environment.tables
    programs = Programs(experiment, controllers, libraries, tables, 1)
    ring = np.zeros((len(tags), 8), np.int16)
    reports: dict[int, bytes] = {}
    for step in range(len(recorded[f"{kind}0"])):
        poses = {tag: tuple(recorded[name][step]["step"][0][1:]) for tag, name in tags.items()}
        state = arena_state(poses, (step + 1) * STEP_NS)
        readings = environment.step(state, step, reports)
        times_ns = state.capture_ns, state.capture_ns
        programs.step(Wanted.RUN, 0, step, times_ns, readings, ring)
        reports = programs.reports()
    programs.end()
    for name, theirs in recorded.items():
        ours = read(Path("out") / f"{name}.txt")
        assert len(ours) == len(theirs) == 60
        for step, (our, their) in enumerate(zip(ours, theirs)):
            assert our.keys() == their.keys(), (name, step)
            for key, lines in their.items():
                # Virtual readings travel in single precision.
                assert np.allclose(our[key], lines, rtol=1e-7, atol=1e-6), (name, step, key)


MINE = """
function init() n = 0 end
function step()
   n = n + 1
   robot.wheels.set_velocity(tonumber(robot.params.speed), 4)
end
function reset() end
""".lstrip()
ELEMENTS = {
    "actuators": '<differential_steering implementation="default" />',
    "sensors": '<proximity implementation="default" />',
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def mine(script: str, attributes: str = 'script="mine.lua" speed="5"', **elements: str) -> Path:
    """An experiment of 4 robots with a script."""
    Path("mine.lua").write_text(script)
    parts = "".join(f"<{k}>{v}</{k}>" for k, v in {**ELEMENTS, **elements}.items())
    controller = f'<lua_controller id="mine">{parts}<params {attributes} /></lua_controller>'
    Path("mine.argos").write_text(f"""<argos-configuration>
<framework><experiment length="6" ticks_per_second="10" random_seed="7" /></framework>
<controllers>{controller}</controllers>
<arena size="3, 3, 1" center="0,0,0.5"><distribute>
<position method="grid" center="0,0,0" distances="0.8,0.8,0" layout="2,2,1" />
<orientation method="constant" values="0,0,0" />
<entity quantity="4" max_trials="100"><e-puck id="e"><controller config="mine" /></e-puck></entity>
</distribute></arena>
<physics_engines><dynamics2d id="d" /></physics_engines></argos-configuration>""")
    return Path("mine.argos")


def simulate(*words: object) -> int:
    return cli.main(["sim", "mine.argos", *map(str, words), "--output", "out"])


FAILURES = [
    ("nothing.value = 1", "mine.lua:5: attempt to index a nil value (global 'nothing')"),
    ("pcall(function() while true do end end)", "mine.lua:5: did not return within 3 s"),
    ("robot.wheels.set_velocity(1)", "mine.lua:5: robot.wheels.set_velocity() expects 2 arguments"),
    (
        "robot.wheels.set_velocity(0 / 0, 1)",
        "mine.lua:5: robot.wheels.set_velocity(): a speed is no number (nan)",
    ),
    ("os.exit()", "mine.lua:5: os.exit() would end the program that runs all robots"),
    ("error({})", "(error object is a table value)"),
]


@pytest.mark.parametrize(("mistake", "words"), FAILURES, ids=[m for m, _ in FAILURES])
def test_a_robot_whose_script_fails_stands_and_the_others_go_on(
    mistake: str, words: str, folder: Path
) -> None:
    lines = MINE.splitlines()
    lines.insert(4, f'   if n == 20 and robot.id == "e1" then {mistake} end')
    mine("\n".join(lines))
    assert simulate() == 1
    summary = json.loads(Path("out/summary.json").read_text())
    (tag,) = (r.tag for r in load(Path("mine.argos")).robots if r.id == "e1")
    assert summary["why"] == f"failed in mid-run: robot {tag}'s controller ({words})"
    with np.load("out/trajectory.npz") as run:
        row = run["tags"].tolist().index(tag)
        moved = np.ptp(run["poses"][25:, :, :2], axis=0).max(axis=1)
        assert moved[row] < 1e-6 and (np.delete(moved, row) > 0.05).all()
        assert np.ptp(run["poses"][:20, row, :2], axis=0).max() > 0.05


MISTAKES = [
    (MINE.replace("step()", "Step()"), 2, "has no function step(); is 'Step' meant?"),
    (MINE.replace("step()", "poststep()"), 2, "has no function step(); is 'poststep' meant?"),
    (MINE.replace("reset()", "Reset()"), 6, "has no function reset(); is 'Reset' meant?"),
    ("function step() end", 1, "has no function init(); its functions are: step"),
    (MINE.replace("function step", "functio step"), 2, "syntax error near 'step'"),
    (MINE.replace("n = 0", "n = robot.x.y"), 1, "attempt to index a nil value (field 'x')"),
    (f"{MINE}require('nothing')", 7, "module 'nothing' not found"),
    (f"{MINE}require('here')", 7, "module 'here' not found"),
]


@pytest.mark.parametrize(("script", "line", "words"), MISTAKES, ids=[w for *_, w in MISTAKES])
def test_a_mistake_of_all_robots_ends_the_run_with_file_and_line(
    script: str,
    line: int,
    words: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    mine(script)
    Path("elsewhere").mkdir()
    Path("elsewhere/here.lua").write_text("return {}")
    monkeypatch.chdir("elsewhere")
    assert cli.main(["sim", "../mine.argos", "--duration", "4", "--output", "out"]) == 1
    assert f"mine.lua:{line}: {words}" in capsys.readouterr().err


def test_scripts_find_what_lies_beside_them_their_parameters_and_their_random_numbers(
    folder: Path,
) -> None:
    Path("beside.lua").write_text("return {words = 'from beside'}")
    script = MINE.replace(
        "n = 0 end",
        "n = 0\\n   log(require('beside').words, ' ', robot.params.speed * 2, ' ', true)\\n"
        "   log(math.pow(2, 5) + math.log10(100))\\n"
        "   logerr(robot.id, ' ', robot.random.uniform(3, 4), ' ', vector2(3, 4):length()) end",
    ).replace("\\n", "\n")
    for output in ("once", "again"):
        mine(script)
        assert cli.main(["sim", "mine.argos", "--duration", "1", "--output", output]) == 0
    once, again = (Path(f"{o}/events.csv").read_text() for o in ("once", "again"))
    assert once == again and once.count("from beside 10 1") == 4 and once.count(": 34") == 4
    assert {file.name for file in named_files(Path("mine.argos"))} >= {"mine.lua", "beside.lua"}
    drawn = re.findall(r"e\d (3\.\d+) 5", once)
    assert len(set(drawn)) == 4


def test_rows_of_a_series_name_the_script_by_its_own_digest(folder: Path) -> None:
    mine(MINE)
    built = shared_objects(load("mine.argos"))
    digest = hashlib.sha256(Path("mine.lua").read_bytes()).hexdigest()
    assert programs_of({k: str(path) for k, path in built.items()}) == [f"mine={digest[:12]}"]


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ('script="nine.lua"', "there is no file 'nine.lua'"),
        ('script="mine.argos"', "'mine.argos' is no .lua file"),
    ],
)
def test_a_wrong_script_is_told_with_the_line_of_the_experiment(
    attributes: str, words: str, folder: Path
) -> None:
    path = mine(MINE, attributes)
    with pytest.raises(VsenseError, match=re.escape(words)) as caught:
        load(path)
    assert str(caught.value).startswith("mine.argos:3: ")


@pytest.mark.paced
@pytest.mark.system
def test_real_daemons_do_what_the_script_says_also_in_anothers_role(folder: Path) -> None:
    lines = MINE.splitlines()
    lines.insert(4, '   if n == 15 and robot.id == "e1" then nothing.value = 1 end')
    path = mine("\n".join(lines))
    tags = {robot.id: robot.tag for robot in load(path).robots}
    rows = [f'[[robot]]\ntag = {tag}\nhost = "root@{tag}"' for tag in tags.values()]
    Path("swarm.toml").write_text("\n".join([*rows, rows[0].replace(str(tags["e0"]), "99")]))
    words = ["--roster", "swarm.toml", "--replace", f"{tags['e0']}=99", "--duration", "4"]
    assert cli.main(["lab", "mine.argos", "--port", "0", *words, "--output", "out"]) == 1
    summary = json.loads(Path("out/summary.json").read_text())
    why = "mine.lua:5: attempt to index a nil value (global 'nothing')"
    assert f"robot {tags['e1']}'s controller ({why})" in summary["why"]
    for tag in (99, tags["e1"], tags["e2"], tags["e3"]):
        trace = [line.split() for line in Path(f"out/robots/{tag}.trace").read_text().splitlines()]
        steps = [row for row in trace if row[0] == "step"]
        wheels = [(int(r[r.index("left") + 1]), int(r[r.index("right") + 1])) for r in steps]
        assert (388, 311) in wheels[:15], "5 and 4 cm/s"
        assert wheels[-1] == ((0, 0) if tag == tags["e1"] else (388, 311))
