"""A series of three runs with cameras, and robots in networks of their own, and what goes wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.cameras import NetworkCameras
from tests.system.floor import MS, Floor, Program, experiment
from tests.system.networks import HOST, Networks
from tests.vision.tracking.synthetic import Robot
from vsense.base.clock import host_ns

pytestmark = pytest.mark.system

TAGS = [700, 31, 1843]
LATE = 1843
LENGTH_S = 5
PLACES = [Robot(700, -0.2, 0.1, 0.5), Robot(31, 0.3, 0.1, 1.0), Robot(LATE, -0.15, -0.1, 0.0)]


@pytest.fixture
def networks() -> Iterator[Networks]:
    made = Networks(TAGS)
    yield made
    made.close()


@pytest.fixture
def floor(networks: Networks) -> Iterator[Floor]:
    made = Floor(TAGS)
    yield made
    made.close()


@pytest.fixture
def cameras() -> Iterator[NetworkCameras]:
    made = NetworkCameras(PLACES)
    yield made
    made.close()


def start(floor: Floor, cameras: NetworkCameras, folder: Path) -> tuple[Program, int]:
    """Starts the series; gives it and the port for robots."""
    file = experiment(folder, "<framework>", TAGS, LENGTH_S)
    words = ["run", str(file), "--tracking", *cameras.files(folder), "--runs", "3", "--json"]
    words += ["--start-after", "3", "--host", HOST, "--port", "0", "--record", "--record-images"]
    program = floor.program(*words, "--output", str(folder / "notes"))
    waiting = r"waiting for robots on .*, port (\d+)"
    floor.wait_for(program.heard(waiting), "its port")
    found = re.search(waiting, program.said)
    assert found is not None
    return program, int(found[1])


def test_a_series_goes_on_whatever_happens(
    floor: Floor, networks: Networks, cameras: NetworkCameras, tmp_path: Path
) -> None:
    program, port = start(floor, cameras, tmp_path)
    for tag in (700, 31):
        floor.connect(tag, port, HOST, networks.command(tag))
    floor.wait_for(lambda: floor.moving(700, 31), "the first run, of two")
    assert f"starting without all robots; not connected: {LATE}" in program.said
    floor.connect(LATE, port, HOST, networks.command(LATE))
    floor.wait_for(lambda: floor.moving(LATE), "the third robot")

    floor.wait_for(program.heard("run 2, seed 2"), "the second run")
    floor.wait_for(floor.moving, "its motion")
    cameras.off.add("b")
    floor.wait_for(program.heard("camera b: is gone: "), "word of the camera")
    floor.live_for(300 * MS)
    assert floor.moving(), "the other camera's robots, and those held in memory, go on"
    cameras.off.clear()
    floor.wait_for(program.heard("camera b: is back"), "the camera")

    floor.wait_for(program.heard("run 3, seed 3"), "the third run")
    floor.wait_for(floor.moving, "its motion")
    networks.cut(31)
    floor.wait_for(lambda: floor.resting(31), "rest of the robot without a network")
    floor.wait_for(program.heard(r"robot 31: .*lost|nothing heard"), "word of it")
    assert floor.moving(700, LATE), "the others go on"
    networks.restore(31)
    back_ns = host_ns()
    floor.wait_for(lambda: floor.moving(31), "its return")
    print(f"it drives {(host_ns() - back_ns) / MS:.0f} ms after the network is back")

    floor.wait_for(lambda: program.ended, "the end")
    assert program.process.returncode == 0 and floor.resting()
    series = json.loads(program.printed)
    assert series == json.loads((tmp_path / "notes" / "series.json").read_text())
    runs = series["runs"]
    assert [(run["run"], run["seed"], run["ended"]) for run in runs] == [
        (1, 1, "time"), (2, 2, "time"), (3, 3, "time"),
    ]  # fmt: skip
    assert [run["missing_at_start"] for run in runs] == [[f"epuck_{LATE}_0"], [], []]
    lived = [run["timesteps"] + run["late_timesteps"] for run in runs]
    assert all(count >= 10 * LENGTH_S for count in lived) and all(r["timesteps"] > 25 for r in runs)
    assert runs[2]["link"]["reconnects"] <= 1, (
        "after a short time the session goes on, else a new one"
    )
    for number in (1, 2, 3):
        left = {path.name for path in (tmp_path / "notes" / f"run-{number}").iterdir()}
        assert left == {"summary.json", "timesteps.csv", "wander.png", "wander.mcap"}
    again = floor.program("replay", str(tmp_path / "notes/run-2/wander.mcap"), "--retrack")
    floor.wait_for(lambda: again.ended, "the tracker's second look")
    compared = re.match(r"(\d+) timesteps compared, \1 the same in every bit\n", again.printed)
    assert compared and int(compared[1]) > 25, again.printed + again.said
