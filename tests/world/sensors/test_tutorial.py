"""The tutorials of world/sensors/README.md and EXTENDING.md, done exactly as they are written."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import vsense
from tests.conftest import require_tool
from tests.world.sensors.scenes import STEP_NS, arena_state
from vsense.config import devices
from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.robots import build
from vsense.robots.inprocess import CompiledProgram, ProgramSetup
from vsense.robots.link.wire import Wanted
from vsense.run.environment import Environment

EXTENDING = Path(vsense.__file__).parent / "EXTENDING.md"
README = Path(vsense.__file__).parent / "world" / "sensors" / "README.md"
FILE = re.compile(r"^`([\w.]+)`:\n\n```\w+\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TAGS = [31, 1843, 4334, 7167]
# Three within 0.3 m of each other, and one far away.
PLACES = {31: (0.0, 0.0, 0.0), 1843: (0.2, 0.0, 0.0), 4334: (0.1, 0.1, 0.0), 7167: (0.8, 0.8, 0.0)}


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    """The experiment of the tutorial, with all its files in one folder."""
    files = dict(FILE.findall(README.read_text(encoding="utf-8")))
    assert set(files) == {"crowd.py", "crowd.argos", "crowd.c"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    return load(tmp_path / "crowd.argos")


def test_the_sensor_has_under_30_lines_and_is_one_line_of_the_experiment() -> None:
    files = dict(FILE.findall(README.read_text(encoding="utf-8")))
    assert len(files["crowd.py"].splitlines()) < 30
    assert sum("crowd.py" in line for line in files["crowd.argos"].splitlines()) == 1


def test_nothing_of_it_is_passed_over(experiment: Experiment) -> None:
    assert experiment.warnings == ()
    assert [robot.tag for robot in experiment.robots] == TAGS
    (mounted,) = experiment.controllers[0].sensors
    assert (mounted.sensor.name, mounted.sensor.layout) == ("crowd", "u1")


def test_its_value_reaches_what_robots_are_sent(experiment: Experiment) -> None:
    environment = Environment(experiment, seed=1)
    readings = environment.step(arena_state(PLACES), 0, {})
    counts = [readings[tag][0] for tag in TAGS]
    assert counts == [
        (b"\x02", STEP_NS),
        (b"\x02", STEP_NS),
        (b"\x02", STEP_NS),
        (b"\x00", STEP_NS),
    ]


def test_its_value_reaches_the_controller(experiment: Experiment) -> None:
    require_tool("cc", "gcc")
    environment = Environment(experiment, seed=1)
    library = build.shared(experiment.controllers[0].library, experiment.path.parent)
    params = experiment.controllers[0].params_text
    robots = CompiledProgram(
        ProgramSetup(library, TAGS, environment.equipment[0].table, STEP_NS, 1, params)
    )
    own_proximity = np.zeros((4, 8), dtype=np.int16)
    for k in range(3):
        capture_ns = (k + 1) * STEP_NS
        readings = environment.step(arena_state(PLACES, capture_ns), k, {})
        times_ns = (capture_ns, capture_ns + 20_000_000)
        (own,) = readings.parts.values()
        robots.step(Wanted.RUN, 0, k, times_ns, own, own_proximity)
    assert robots.controller == "shy"
    assert (robots.leds & 0xFF).tolist() == [0xFF, 0xFF, 0xFF, 0]
    assert robots.wheels_steps_s.tolist() == [[400, 300]] * 4
    assert robots.complaints() == []


def test_the_settings_that_come_with_it(experiment: Experiment) -> None:
    experiment = load(experiment.path, settings={"sensor.noise": "1", "sensor.update": "change"})
    (mounted,) = experiment.controllers[0].sensors
    assert (mounted.quality.noise_level, mounted.updating.kind) == (1.0, "change")
    environment = Environment(experiment, seed=1)
    counts = set()
    for k in range(200):
        readings = environment.step(arena_state(PLACES, (k + 1) * STEP_NS), k, {})
        counts.add(readings[31][0][0][0])
    assert counts == {1, 2, 3}


def test_every_shipped_sensor_is_in_its_table_with_its_file() -> None:
    rows = re.findall(
        r"^\| `([\w:]+)` \|.*\[(\w+\.py)\]\((\w+\.py)\) \|$", README.read_text(), re.M
    )
    made = {
        element: factory.__module__.rpartition(".")[2] + ".py"
        for element, factory in devices.factories(devices.SENSORS).items()
    }
    assert {element: file for element, file, _ in rows} == made
    assert all(shown == linked for _, shown, linked in rows)


@pytest.mark.parametrize(
    ("heading", "names"),
    [
        ("An actuator", ["clicker.py", "clicks.argos", "meets.py"]),
        ("Loop functions", ["lamp.py", "lamp.argos"]),
    ],
)
def test_the_tutorials_of_extending_run(tmp_path: Path, heading: str, names: list[str]) -> None:
    section = EXTENDING.read_text().partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    files = dict(FILE.findall(section))
    assert list(files) == names
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    (file,) = tmp_path.glob("*.argos")
    assert load(file).warnings == ()
    run = vsense.load(file).simulate(seed=1, output=tmp_path / "out")
    assert run.valid
    if heading == "An actuator":
        clicks = run.measured["clicks"]
        assert clicks[0] == 0 and np.diff(clicks).min() == 0 and 10 < clicks[-1] < 200
    else:
        near = run.measured["near"]
        assert len(near) == 1200 and len(set(near)) > 2
        assert run.measures["near_mean"] == pytest.approx(near.mean())
