"""The page of a real lab: 15 emulated robots, seen and steered in a real browser."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.monitor.ui.browser import Page
from tests.monitor.ui.conftest import Open
from tests.monitor.ui.portrait import PLACES, SPARE, HeldLab, press, state
from vsense.base.clock import host_ns
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.monitor.recording.reader import open_recording
from vsense.run.runs_csv import read_runs

pytestmark = pytest.mark.system

LIMIT_MS = 450.0
ROBOTS = 15
PATIENCE_S = 60


def rest_ms(lab: HeldLab, pressed_ns: int) -> float:
    """How long after a press the last robot's motors had speed 0 [ms]."""
    rows = read_actuations(lab.directory / "actuations.bin")
    found = []
    for robot in range(ROBOTS):
        own = rows[rows["robot"] == robot]
        turning = (own["left_steps_s"] != 0) | (own["right_steps_s"] != 0)
        before = own[own["time_ns"] <= pressed_ns]
        assert len(before), "it was driven before"
        after = own[(own["time_ns"] > pressed_ns) & ~turning]
        found.append((after["time_ns"][0] - pressed_ns) / 1e6)
    return max(found)


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[HeldLab]:
    made = HeldLab(tmp_path / "run")
    yield made
    made.close()


def drive(page: Page) -> None:
    """Waits until most robots have driven on for a second; some may stand in the cone."""
    now = page.value("vsense.store.run.timestep")
    page.until(f"vsense.store.run.timestep > {now} + 10")
    page.until("vsense.store.robots.left_steps_s.filter(speed => speed !== 0).length > 7")


def change(page: Page) -> None:
    """Moves what pollutes, which the cameras see, and makes a sensor noisy."""
    for said in (
        {"kind": "move", "name": "polluter_52447_0", "x_m": 0.4, "y_m": 0.3},
        {"kind": "set", "controller": "wanderer", "name": "pollutant", "setting": "noise_level",
         "value": 0.4},
    ):  # fmt: skip
        page.value(f"vsense.connection.say({json.dumps({'change': said})})")
    page.until("vsense.store.settled === 2 && vsense.store.settings.sensors[0].noise_level === 0.4")
    column = "vsense.store.arena.robots"
    row = f"{column}.tag.indexOf(52447)"
    page.until(f"Math.hypot({column}.x_m[{row}] - 0.4, {column}.y_m[{row}] - 0.3) < 0.01")


def put_spare_in(page: Page) -> int:
    """Has the spare play the first robot's part; gives whose part it is."""
    part = int(page.value("vsense.store.experiment.robots[0].tag"))
    page.value(f"vsense.choice.choose({part})")
    page.until("!document.querySelector('#replace').hidden")
    assert page.text("#replace_by") == f"robot {SPARE}"
    page.click("#replace_do")
    page.until(f"document.querySelector('#robot_name').textContent === 'Robot {SPARE}'")
    page.until(f"vsense.store.robot({SPARE})?.connected && vsense.store.robot({SPARE}).seen")
    page.until(f"!vsense.store.robot({part})")
    return part


def sensed_again(path: Path) -> dict[str, int]:
    """What `vsense replay --resense` says."""
    words = [sys.executable, "-m", "vsense", "replay", str(path), "--resense", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, int] = json.loads(done.stdout)
    return found


def test_a_lab_is_steered_from_its_page(lab: HeldLab, opened: Open) -> None:
    page = opened(lab.url())
    state(page, "ready")
    press(page, "start", "running")
    page.until(f"vsense.arena.drawn.robots.length === {ROBOTS} + 1")
    places = page.value(PLACES)
    drive(page)
    assert page.value(PLACES) != places, "they move"
    paused_ns = press(page, "pause", "paused")
    page.until("vsense.store.robots.left_steps_s.every(speed => speed === 0)")
    press(page, "start", "running")
    page.go(lab.url())
    page.until("window.vsense?.store.arena && vsense.store.run")
    state(page, "running")
    page.until(f"vsense.arena.drawn.robots.length === {ROBOTS} + 1")
    # Who comes late has the run's charts from its beginning.
    page.until("vsense.store.measures.get('robots_in_cone')?.times[0] === 0")
    change(page)
    drive(page)
    emergency_ns = host_ns()
    page.key("Escape")
    state(page, "emergency")
    assert "EMERGENCY STOP" in page.text("#banner")
    press(page, "reset", "ready")
    assert "run 2" in page.text("#what")
    part = put_spare_in(page)
    press(page, "start", "running")
    drive(page)
    reset_ns = press(page, "reset", "ready")
    press(page, "start", "running")
    drive(page)
    stopped_ns = press(page, "stop", "ended")
    lab.process.send_signal(signal.SIGINT)
    assert lab.end() == 0, lab.said
    said = "".join(lab.said)
    took = {
        name: rest_ms(lab, pressed_ns)
        for name, pressed_ns in {
            "pause": paused_ns, "emergency": emergency_ns, "reset": reset_ns, "stop": stopped_ns,
        }.items()
    }  # fmt: skip
    print("speed 0 after [ms]:", took)
    assert all(ms <= LIMIT_MS for ms in took.values()), took
    runs = json.loads((lab.directory / "series.json").read_text())["runs"]
    assert [run["run"] for run in runs] == [1, 2, 3] and all(run["timesteps"] > 10 for run in runs)
    for number in (1, 2, 3):
        assert (lab.directory / f"run-{number}" / "pollutant.mcap").stat().st_size > 10_000
    orders = [
        sensed_again(lab.directory / f"run-{n}" / "pollutant.mcap")["orders"] for n in (1, 2, 3)
    ]
    assert orders == [2, 0, 0], "all readings are the same again, in every bit"
    assert said.count("viewer 1 (127.0.0.1): run 1 is paused") == 1
    assert "the next run has seed 2: the robots stay where they stand" in said
    assert f"robot {SPARE} takes the role of {part}" in said
    rows = read_runs(lab.directory / "runs.csv")
    assert [part in row.tags for row in rows] == [True, False, False]
    assert [SPARE in row.tags for row in rows] == [False, True, True]
    assert rows[0].uids[1:] == rows[1].uids[1:] and rows[0].uids[0] != rows[1].uids[0]
    first = runs[1]["parts"][0]
    assert (first["part"], first["tag"], first["uid"]) == (part, SPARE, rows[1].uids[0])
    with open_recording(lab.directory / "run-2" / "pollutant.mcap") as recording:
        told = [message.data for message in recording.messages({"/parts"})]
    assert told[0]["tag"][0] == part, "it waited for its start when the spare came"
    assert told[-1]["part"][0] == part and told[-1]["uid"][0] == first["uid"]
