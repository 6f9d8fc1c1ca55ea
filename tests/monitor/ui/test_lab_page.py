"""The page of a real lab: 15 emulated robots, seen and steered in a real browser."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.monitor.ui.browser import Page
from tests.monitor.ui.conftest import Open
from tests.monitor.ui.test_page import PLACES, state
from vsense.base.clock import host_ns
from vsense.modes.lab.microcontrollers import read_actuations
from vsense.monitor.recording.reader import open_recording
from vsense.run.runs_csv import read_runs

pytestmark = pytest.mark.system

LIMIT_MS = 450.0
URL = re.compile(r"control room: (http://\S+)")
ROBOTS = 15
SPARE = 37
PATIENCE_S = 60


class Lab:
    """`vsense lab` that waits for a start."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        roster = folder.parent / "robots.toml"
        roster.write_text(f"[[robot]]\ntag = {SPARE}\nspare = true\n")
        words = ["lab", "pollutant", "--port", "0", "--web", "0", "--hold", "--record"]
        words += ["--roster", str(roster)]
        self._said = (folder.parent / "said").open("w+")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vsense", *words, "--output", str(folder)],
            stdin=subprocess.DEVNULL, stdout=self._said, stderr=self._said,
        )  # fmt: skip

    @property
    def said(self) -> str:
        self._said.seek(0)
        return self._said.read()

    def url(self) -> str:
        """The page's address, once it is told."""
        end_s = time.monotonic() + PATIENCE_S
        while (found := URL.search(self.said)) is None:
            assert self.process.poll() is None and time.monotonic() < end_s, self.said
            time.sleep(0.05)
        return found[1]

    def end(self) -> int:
        """Ends it as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(PATIENCE_S)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._said.close()

    def rest_ms(self, pressed_ns: int) -> float:
        """How long after a press the last robot's motors had speed 0 [ms]."""
        rows = read_actuations(self.folder / "actuations.bin")
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
def lab(tmp_path: Path) -> Iterator[Lab]:
    made = Lab(tmp_path / "run")
    yield made
    made.close()


def press(page: Page, button: str, then: str) -> int:
    """Presses a button and waits for the state that follows; gives when it was pressed."""
    page.until(f"!document.querySelector('#{button}').disabled")
    now_ns = host_ns()
    page.click(f"#{button}")
    state(page, then)
    return now_ns


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
    page.until(f"document.querySelector('#robot_note').textContent === 'tag {SPARE}'")
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


def test_a_lab_is_steered_from_its_page(lab: Lab, opened: Open) -> None:
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
    assert lab.end() == 0, lab.said
    took = {
        name: lab.rest_ms(pressed_ns)
        for name, pressed_ns in {
            "pause": paused_ns, "emergency": emergency_ns, "reset": reset_ns, "stop": stopped_ns,
        }.items()
    }  # fmt: skip
    print("speed 0 after [ms]:", took)
    assert all(ms <= LIMIT_MS for ms in took.values()), took
    runs = json.loads((lab.folder / "series.json").read_text())["runs"]
    assert [run["run"] for run in runs] == [1, 2, 3] and all(run["timesteps"] > 10 for run in runs)
    for number in (1, 2, 3):
        assert (lab.folder / f"run-{number}" / "pollutant.mcap").stat().st_size > 10_000
    orders = [sensed_again(lab.folder / f"run-{n}" / "pollutant.mcap")["orders"] for n in (1, 2, 3)]
    assert orders == [2, 0, 0], "all readings are the same again, in every bit"
    assert lab.said.count("viewer 1 (127.0.0.1): run 1 is paused") == 1
    assert f"robot {SPARE} plays the part of {part} (" in lab.said
    rows = read_runs(lab.folder / "runs.csv")
    assert [part in row.tags for row in rows] == [True, False, False]
    assert [SPARE in row.tags for row in rows] == [False, True, True]
    assert rows[0].uids[1:] == rows[1].uids[1:] and rows[0].uids[0] != rows[1].uids[0]
    first = runs[1]["parts"][0]
    assert (first["part"], first["tag"], first["uid"]) == (part, SPARE, rows[1].uids[0])
    with open_recording(lab.folder / "run-2" / "pollutant.mcap") as recording:
        told = [message.data for message in recording.messages({"/parts"})]
    assert told[0]["tag"][0] == part, "it waited for its start when the spare came"
    assert told[-1]["part"][0] == part and told[-1]["uid"][0] == first["uid"]
