"""Controllers in Python: the same bits as in C, and what their mistakes cost."""

from __future__ import annotations

import csv
import itertools
import json
import re
import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import vsense
from tests.rigs.places import DATA, ROOT
from vsense import cli
from vsense.base.interruption import ALARM_S, interruption
from vsense.config.experiment import load
from vsense.config.experiments.start import start_controller
from vsense.config.specs import Stage
from vsense.robots import build
from vsense.run import remote
from vsense.run.programs import told_programs

SHIPPED = ROOT / "vsense" / "config" / "experiments"
MOTH = (DATA / "python" / "moth.py").read_text()
MOTHS = (DATA / "python" / "moths.py").read_text()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in which the experiment's loop functions lie."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loops.py").write_bytes((SHIPPED / "phototaxis.py").read_bytes())
    return tmp_path


def experiment(folder: Path, code: str, name: str = "mine") -> Path:
    """Phototaxis with a controller in Python."""
    (folder / f"{name}.py").write_text(code)
    text = (SHIPPED / "phototaxis.argos").read_text()
    text = text.replace('library="phototaxis"', f'library="{name}.py"')
    path = folder / f"{name}.argos"
    path.write_text(text.replace('library="phototaxis.py"', 'library="loops.py"'))
    return path


def simulate(*words: object) -> int:
    return cli.main(["sim", *map(str, words)])


@pytest.mark.parametrize("code", [MOTH, MOTHS], ids=["one robot", "all robots"])
def test_a_controller_in_python_does_what_the_same_does_in_c(folder: Path, code: str) -> None:
    short = ("--duration", 30, "--seed", 5)
    assert simulate(experiment(folder, code), *short, "--output", "python") == 0
    assert simulate("phototaxis", *short, "--output", "c") == 0
    with np.load("python/trajectory.npz") as ours, np.load("c/trajectory.npz") as theirs:
        assert np.ptp(ours["poses"][:, :, 0], axis=0).min() > 0.1 and ours["leds"].any()
        for name in ("poses", "leds", "tags"):
            assert np.array_equal(ours[name], theirs[name]), name


@pytest.mark.parametrize("number", [0, 1])
def test_the_controllers_of_the_page_run(folder: Path, number: int) -> None:
    page = (ROOT / "vsense" / "EXTENDING.md").read_text()
    section = page.partition("## A controller in Python")[2].partition("\n## ")[0]
    code = re.findall(r"```python\n(.*?)```", section, re.S)[number]
    path = experiment(folder, code)
    assert simulate(path, "--duration", 20, "--lenient", "-o", "out") == 0
    with np.load("out/trajectory.npz") as run:
        assert run["leds"].any() and np.ptp(run["poses"][:, :, 0], axis=0).min() > 0.1


def failing(condition: str) -> str:
    """A controller that divides by zero where a condition holds."""
    line = f"        1 / (not ({condition}))\n"
    return MOTH.replace("        light, values =", f"{line}        light, values =")


def test_a_robot_whose_controller_fails_stands_and_the_others_go_on(folder: Path) -> None:
    path = experiment(folder, failing("robot.tag == 1843 and self.resting"))
    assert simulate(path, "--duration", 40, "--output", "out") == 1
    summary = json.loads(Path("out/summary.json").read_text())
    line = 1 + path.with_suffix(".py").read_text().splitlines().index(
        "        1 / (not (robot.tag == 1843 and self.resting))"
    )
    words = f"(mine.py:{line}: ZeroDivisionError: division by zero)"
    assert summary["why"] == f"failed in mid-run: robot 1843's controller {words}"
    with open("out/events.csv") as file:
        (event,) = [row for row in csv.DictReader(file) if "has failed" in row["text"]]
    assert "robot 1843" in event["text"] and words[1:-1] in event["text"]
    with np.load("out/trajectory.npz") as run:
        row = run["tags"].tolist().index(1843)
        since = int(float(event["time_s"]) / 0.1) + 2
        moved = np.ptp(run["poses"][since:, :, :2], axis=0).max(axis=1)
        assert moved[row] < 0.05 and (np.delete(moved, row) > 0.05).all()
        assert not run["leds"][since:, row].any()


def test_a_campaign_does_not_repeat_what_would_fail_again(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = experiment(folder, failing("robot.tag == 31"))
    assert simulate(path, "--duration", 2, "--runs", 2, "--jobs", 1, "-o", "runs.csv") == 1
    assert "would fail again" in capsys.readouterr().err
    with open("runs.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == ["void"] * 2


SWARM = "class SwarmController:\n    def __init__(self, swarm): pass\n    def step(self, swarm):"
MISTAKES = [
    ("def step(:", 1, "SyntaxError"),
    ("import nothing_such", 1, "ModuleNotFoundError"),
    ("x = 1", 1, "neither of the classes"),
    ("class Controler: pass", 1, "'Controler' meant"),
    (MOTH + MOTHS, 1, "both of the classes"),
    (MOTH.replace("def step(", "def stpe("), 10, "no method step (is 'stpe' meant?)"),
    ("class Controller:\n    def __init__(self): pass\n    def step(self, robot): pass", 2,
     "__init__ takes self and the robot"),
    ("class Controller:\n    def __init__(self, robot): 1 / 0\n    def step(self, robot): pass", 2,
     "ZeroDivisionError"),
    (f"{SWARM} swarm.set_wheels([1, 2], 0)", 3, "one number, or 15"),
    (f"{SWARM} swarm.set_wheels(float('nan'), 0)", 3, "not finite"),
    (f"{SWARM} swarm.actuator('x').set(1, 7)", 3, "number 7 of an actuator that has 1"),
    (f"{SWARM} swarm.set_leds(1.5)", 3, "1.5: expected LEDs, whole numbers of 0 to 1023"),
    (f"{SWARM} swarm.set_leds(1024)", 3, "1024: expected LEDs"),
    (f"{SWARM} swarm.set_leds_of(0, -1)", 3, "-1: expected LEDs, a whole number of 0 to 1023"),
    (f"{SWARM} swarm.set_leds_of(0, swarm.tags[0] > 0)", 3, "expected LEDs, a whole number"),
    (f"{SWARM} swarm.log(0, 7); raise SystemExit(3)", 3, "SystemExit: 3"),
    (f"{SWARM} swarm.log(int(swarm.tags[0]) + 50, 'x')", 3, "in swarm.tags, 0 to 14"),
    (f"{SWARM} swarm.sensor('proximity').values[0] = 1", 3, "read-only"),
]  # fmt: skip


@pytest.mark.parametrize(("code", "line", "words"), MISTAKES)
def test_a_mistake_ends_the_run_with_file_and_line(
    folder: Path, code: str, line: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert simulate(experiment(folder, code), "--duration", 2, "--lenient", "-o", "out") == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"mine.py:{line}: " in last and words in last and "Traceback" not in last


def test_a_reading_that_is_kept_stays_as_it_was() -> None:
    experiment = vsense.load("phototaxis", duration_s=2).experiment
    with vsense.SteppedSimulation(experiment, 1) as sim:
        light, kept = sim.swarm.sensor("light"), []
        while not sim.done:
            sim.swarm.set_wheels(500, -500)
            kept.append(light.values)
            sim.step()
    assert all((now != before).any() for before, now in itertools.pairwise(kept[5:]))
    assert light.values.shape == (15, 8), "the robots stay as long as somebody reads them"


def test_loop_functions_are_no_controller(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    loops = (SHIPPED / "phototaxis.py").read_text()
    assert simulate(experiment(folder, loops), "--duration", 2, "-o", "out") == 1
    assert "it has loop functions (reset, pre_step" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("code", "settings", "words"),
    [
        (MOTH, "moth.enough=-1", "'-1', expected a number of 0 or more"),
        (MOTH, "moth.enuff=1", "reads no parameter 'enuff'; there are: enough, least"),
        (MOTH.replace('"light"', '"ligth"'), "", "'ligth', which nobody offers; is 'light' meant"),
    ],
)
def test_what_nobody_offers_is_refused_before_the_run(
    folder: Path, code: str, settings: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--set", settings] if settings else []
    assert simulate(experiment(folder, code), *given) == 2
    assert words in capsys.readouterr().err


def test_an_edited_file_is_tried_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--set", "moth.enough=1", "--duration", 1, "-o", "out")
    assert simulate(experiment(folder, MOTH), *words) == 0
    other = MOTH.replace('robot.param("enough", 8.0, least=0)', "8.0")
    assert simulate(experiment(folder, other), *words) == 2
    assert "reads no parameter 'enough'; there are: least" in capsys.readouterr().err


@pytest.mark.paced
@pytest.mark.system
def test_real_daemons_do_what_the_file_says(folder: Path) -> None:
    words = "self.steps > 15 and robot.tag == 1843"
    code = failing(words).replace("        1 / ", "        self.steps += 1\n        1 / ")
    path = experiment(folder, code.replace("self.resting = False", "self.resting = self.steps = 0"))
    assert cli.main(["lab", str(path), "--robots", "3", "--duration", "5", "-o", "out"]) == 1
    summary = json.loads(Path("out/summary.json").read_text())
    assert "failed in mid-run: robot 1843's controller (mine.py:" in summary["why"]
    assert [part["controller"] for part in summary["parts"]] == [build.REMOTE] * 3
    heads = {}
    for tag in (31, 1843, 4334):
        rows = [line.split() for line in Path(f"out/robots/{tag}.trace").read_text().splitlines()]
        steps = [row for row in rows if row[0] == "step"]
        wheels = [(int(r[r.index("left") + 1]), int(r[r.index("right") + 1])) for r in steps]
        heads[tag] = [any(pair) for pair in wheels]
    assert all(sum(moves) > 20 for tag, moves in heads.items() if tag != 1843)
    assert any(heads[1843][:15]) and not any(heads[1843][-20:])


@pytest.mark.paced
@pytest.mark.system
def test_an_endless_loop_costs_its_own_robot_in_the_lab(folder: Path) -> None:
    code = MOTH.replace(
        "        light, values =", "        self.wait(robot)\n        light, values ="
    )
    code += "\n    def wait(self, robot):\n        while robot.tag == 31:\n            pass\n"
    path = experiment(folder, code)
    assert cli.main(["lab", str(path), "--robots", "2", "--duration", "6", "-o", "out"]) == 1
    summary = json.loads(Path("out/summary.json").read_text())
    assert "robot 31's controller (mine.py:" in summary["why"]
    assert "TimeoutError: did not return within 3 s" in summary["why"]
    assert "1843's controller" not in summary["why"]


def test_robots_are_built_with_what_the_host_drives(folder: Path) -> None:
    program = load(str(experiment(folder, MOTH)), stage=Stage.RUN).controllers[0].program
    (told,) = told_programs(load(str(folder / "mine.argos"), stage=Stage.RUN)).values()
    assert told.name == build.REMOTE and len(told.hash) == 12
    sources = build.source_tree().daemon(build.on_robots(program)).program.sources
    assert [path.name for path in sources] == ["remote.c"]


@pytest.mark.parametrize(
    ("known", "stale", "values", "resting", "green"),
    [
        (False, False, (0, 255, 0, 255), True, False),
        (True, True, (0, 0, 0, 255), True, True),
        (True, True, (0, 255, 0, 255), False, False),
        (True, False, (99, 201, 99, 255), False, True),
        (True, False, (100, 201, 99, 255), False, False),
        (True, False, (99, 200, 99, 255), True, False),
        (True, False, (99, 201, 100, 255), True, False),
    ],
)
def test_the_controller_of_new_knows_green(
    known: bool, stale: bool, values: tuple[int, ...], resting: bool, green: bool
) -> None:
    controller = start_controller.Controller.__new__(start_controller.Controller)
    controller.floor = SimpleNamespace(known=known, stale=stale, values=values)  # type: ignore[assignment]
    controller.resting = resting
    assert controller.is_on_green() is green


def test_a_signal_in_a_step_changes_nothing_of_its_limit(monkeypatch) -> None:
    monkeypatch.setattr("vsense.base.interruption._newest", None)  # those that follow have time

    class Nothing:
        @staticmethod
        def parts() -> list[object]:
            return []

    with interruption():
        with remote._limited(Nothing()):  # type: ignore[arg-type]
            signal.raise_signal(signal.SIGTERM)
            assert signal.getitimer(signal.ITIMER_REAL)[0] > 2.0
        assert signal.getitimer(signal.ITIMER_REAL)[1] == pytest.approx(ALARM_S)
