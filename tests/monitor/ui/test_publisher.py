"""What is told of a run: to those who look, as JSON has it, and nothing to nobody."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.run.stage import status
from tests.world.sensors.scenes import arena_state
from vsense.base.arena import ArenaState, Frame
from vsense.base.message_bus import Message, MessageBus
from vsense.config.casting import Casting
from vsense.config.experiment import SHIPPED_FOLDER, load
from vsense.config.roster import read as read_roster
from vsense.monitor.ui import messages
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.publisher import PreviewEncoder, Publisher
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import ReadingValues, StopCause, Telemetry, Wanted
from vsense.run.alarms import Alarm
from vsense.run.control import Control
from vsense.run.environment import Environment
from vsense.run.orders import Order, OrderKind
from vsense.run.runtime import Step
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import CameraEvent, Troubles

MS = 1_000_000
S = 1_000_000_000
SHIPPED = ["aggregation", "foraging", "labyrinth", "phototaxis", "pollutant", "pollutant-cleaning",
           "pollutant-moving"]  # fmt: skip
CAMERA = Camera.looking_down("cam", 0.0, 0.0, 2.0, 300.0, (400, 300))


class Room:
    """A publisher with a stand-in for the runtime, and somebody who looks."""

    def __init__(self, name: str = "pollutant", *topics: str) -> None:
        self.environment = Environment(load(name), seed=1)
        self.tags = [robot.tag for robot in self.environment.experiment.robots]
        self.bus, self.now_ns, self.timestep = MessageBus(), 1000 * S, 100
        self.told: list[Message] = []
        self.topics = set(topics)
        self.robots_now: dict[int, RobotStatus] = {t: status(t, f"epuck_{t}") for t in self.tags}
        self.readings: dict[int, ReadingValues] = {}
        self.control = Control(lambda wanted: None, lambda text: None)
        self.troubles, self.alarms = Troubles(), list[Alarm]()
        trackers = {"cam": "arrows"}
        scene = ExperimentFacts(
            *("lab", "<file/>", False, [CAMERA], trackers, self.troubles), user="anna"
        )
        self.publisher = Publisher(
            self.bus, scene, self.environment, self, self.control,  # type: ignore[arg-type]
            lambda: {"runs": 1, "text": "", "recording": None, "disk_free_bytes": 1},
            lambda: self.now_ns, alarms=lambda: self.alarms,
        )  # fmt: skip

    def join(self) -> None:
        wants: Callable[[str], bool] = lambda topic: not self.topics or topic in self.topics  # noqa: E731
        self.bus.join(self.told.append, wants)

    def state(self) -> ArenaState:
        places = {tag: (0.1 * n - 0.7, 0.2, 0.0) for n, tag in enumerate(self.tags)}
        things = {t.tag: (0.0, 0.0, 0.0) for t in self.environment.experiment.objects}
        return arena_state({**places, **things}, self.now_ns - 20 * MS)

    def step(self, run_timestep: int = -1) -> None:
        """Lives one timestep and has it told."""
        self.timestep += 1
        state = self.state()
        self.readings = self.environment.step(state, run_timestep, {})
        capture_ns = self.now_ns - 20 * MS
        image = np.full((300, 400), 90, np.uint8)
        frames = [Frame("cam", image, self.timestep, capture_ns, self.now_ns)]
        times = (capture_ns, self.now_ns - 9 * MS, self.now_ns - 5 * MS, self.now_ns)
        step = Step(self.timestep, run_timestep, *times, state, frames)
        self.publisher.update(step, self.robots_now)
        self.now_ns += 100 * MS

    def of(self, topic: str) -> list[Any]:
        return [message.data for message in self.told if message.topic == topic]


@pytest.mark.parametrize("name", SHIPPED)
def test_everything_is_json_of_finite_numbers(name: str) -> None:
    room = Room(name)
    room.join()
    for run_timestep in (-1, 0, 1):
        room.step(run_timestep)
    topics = {message.topic for message in room.told}
    wanted = {"/experiment", "/run", "/arena", "/world", "/signals", "/readings", "/robots"}
    assert wanted | {"/cameras"} <= topics
    for message in room.told:
        text = json.dumps(dict(message.data), allow_nan=False)
        assert json.loads(text) == message.data, "lists, not arrays or tuples"
    columns = room.of("/robots")[-1]
    assert {len(column) for column in columns.values()} == {len(room.tags)}


def test_an_alarm_is_published_in_its_timestep_and_so_is_its_end() -> None:
    room = Room("pollutant", "/run")
    room.join()
    room.step(0)
    room.alarms.append(Alarm("disobeys", "robot 31 does NOT stop: lift it", "0.30 s ago"))
    room.step(1)
    assert [run["alarms"] for run in room.of("/run")] == [
        [],
        [{"kind": "disobeys", "text": "robot 31 does NOT stop: lift it", "cause": "0.30 s ago"}],
    ]
    room.alarms[0] = Alarm("disobeys", "robot 31 does NOT stop: lift it", "0.40 s ago")
    room.step(2)
    assert len(room.of("/run")) == 2, "once a second is enough for how long it lasts"
    room.alarms.clear()
    room.step(3)
    assert room.of("/run")[-1]["alarms"] == []


def test_for_nobody_nothing_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    room = Room()
    monkeypatch.setattr(ArenaState, "data", None)
    monkeypatch.setattr("vsense.monitor.ui.publisher.messages", None)
    for run_timestep in range(3):
        room.step(run_timestep)
    assert room.told == []


def test_a_newcomer_is_told_what_changes_rarely() -> None:
    room = Room()
    room.join()
    for _ in range(3):
        room.step()
    assert [len(room.of(topic)) for topic in ("/experiment", "/world", "/arena")] == [1, 1, 3]
    room.join()
    room.step()
    assert [len(room.of(topic)) for topic in ("/experiment", "/world", "/arena")] == [3, 3, 5]


def test_readings_of_one_robot_are_for_who_looks_at_it() -> None:
    room = Room("pollutant", "/readings/23")
    room.topics = {f"/readings/{room.tags[2]}"}
    room.join()
    room.step()
    (data,) = (message.data for message in room.told)
    assert data["tag"] == [room.tags[2]]
    sent = room.readings[room.tags[2]]
    assert data["captured_ns"] == [[when for _, when in sent]]
    assert data["values"] == [[np.frombuffer(value, "<f4").tolist() for value, _ in sent]]


def test_the_run_is_told_when_it_changes_and_once_per_second() -> None:
    room = Room("pollutant", "/run")
    room.join()
    for _ in range(10):
        room.step()
    assert [data["state"] for data in room.of("/run")] == ["waiting"]
    assert room.control.begin(lambda: None)
    room.step(0)
    now = room.of("/run")[-1]
    assert (now["state"], now["run"], now["timestep"], now["late"]) == ("running", 1, 0, 0)
    assert now["rate_hz"] == pytest.approx(10.0) and now["latency_ms"] == {"p50": 20.0, "p99": 20.0}
    room.step(4)
    room.control.give(Order(OrderKind.PAUSE, "Ann"))
    room.step()
    now = room.of("/run")[-1]
    assert (now["state"], now["by"], now["late"]) == ("paused", "Ann", 3), "three were missed"
    assert now["can"] == ["start", "stop", "reset", "emergency"]
    room.now_ns += 3 * S
    room.publisher.update(None, room.robots_now)
    assert room.of("/run")[-1]["silent_s"] == pytest.approx(3.1)
    room.step()
    room.now_ns += 2 * S  # robots are stopped meanwhile, and nobody looks at the arena
    room.publisher.judge({"verdict": "void", "why": "emergency"})
    assert room.of("/run")[-1]["silent_s"] == 0.0


SHOWN = (("state", "go"), ("n", 0.5), ("bad", float("nan")))


def test_trouble_is_told_in_words() -> None:
    room = Room("pollutant", "/robots")
    room.join()
    room.step()
    assert set(room.of("/robots")[-1]["trouble"]) == {""}
    first, second, third, fourth, fifth, sixth = room.tags[:6]
    heard = {"heard_ns": room.now_ns - 2 * S}
    base = Telemetry(state=Wanted.RUN, stop_cause=StopCause.BASE, base_errors=7, battery_mv=3700)
    room.robots_now |= {
        first: status(first, "a", connected=False, **heard),
        second: status(second, "b", telemetry=base),
        third: status(third, "c", telemetry=None, connected=False, heard_ns=None, sessions=0),
        fourth: status(fourth, "d", udp=False),
        fifth: status(fifth, "e", telemetry=Telemetry(battery_low=1, shown=SHOWN)),
        sixth: status(sixth, "f", telemetry=Telemetry(state=Wanted.HOME)),
    }
    room.step()
    rows = room.of("/robots")[-1]
    assert rows["trouble"][:6] == [
        "link lost for 2.0 s", "stopped: its base does not answer", "not connected",
        "no UDP: its readings come over TCP", "battery low", "",
    ]  # fmt: skip
    assert (rows["battery_mv"][1], rows["base_errors"][1], rows["state"][1]) == (3700, 7, "run")
    assert rows["state"][5] == "homing", "who is told to drive home may be far from it"
    assert rows["shown"][3:6] == [{}, {"state": "go", "n": 0.5, "bad": None}, {}]
    assert rows["battery_low"][5] is None and rows["heard_ms"][2] is None


def test_who_stands_alone_is_told_with_why() -> None:
    room = Room("pollutant", "/robots")
    room.join()
    first, second, third, fourth = room.tags[:4]
    held = {"telemetry": Telemetry(state=Wanted.PAUSE), "held": "outside of the fence"}
    room.robots_now |= {
        first: status(first, "a", **held),
        second: status(second, "b", **held, connected=False, heard_ns=room.now_ns - 2 * S),
        third: status(third, "c", **held, sessions=0),
        fourth: status(fourth, "d"),
    }
    room.step()
    rows = room.of("/robots")[-1]
    assert rows["held"][:4] == ["outside of the fence", "", "", ""], "the original's cannot pause"
    assert rows["trouble"][:2] == ["stands (outside of the fence)", "link lost for 2.0 s"]
    assert rows["state"][0] == "pause"


def test_a_camera_is_told_with_what_lasts_and_what_is_missing() -> None:
    room = Room("pollutant", "/cameras")
    room.join()
    for _ in range(11):
        room.step()
    (camera,) = room.of("/cameras")[-1]["cameras"]
    assert (camera["id"], camera["state"], camera["rate_hz"]) == ("cam", "ok", 10.0)
    room.troubles.lines([CameraEvent("cam", "moved", "has moved by 2 px")])
    for _ in range(10):
        room.step()
    assert room.of("/cameras")[-1]["cameras"][0]["text"] == "has moved by 2 px"
    room.troubles.lines([CameraEvent("cam", "steady", "is back in its place")])
    room.now_ns += 2 * S
    room.publisher.update(None, room.robots_now)
    (camera,) = room.of("/cameras")[-1]["cameras"]
    assert (camera["state"], camera["text"]) == ("lost", "no picture for 2.1 s")


def test_a_field_is_told_as_shares_of_its_peak() -> None:
    room = Room("foraging", "/fields")
    room.join()
    field = next(iter(room.environment.world.fields.values()))
    field.concentration[0, 1] = 8.0
    field.concentration[2, 0] = 4.0
    for _ in range(6):
        room.step()
    told = room.of("/fields")
    assert len(told) == 2, "twice per second"
    data = told[0]["fields"][0]
    levels = np.frombuffer(base64.b64decode(data["levels"]), np.uint8)
    levels = levels.reshape(data["rows"], data["columns"])
    assert (levels[0, 1], levels[2, 0], levels.sum()) == (255, 128, 383)
    assert (data["peak"], data["corner_m"]) == (8.0, field.corner_m.tolist())


def test_the_next_run_begins_at_nothing() -> None:
    room = Room("pollutant", "/experiment", "/run")
    room.join()
    room.control.begin(lambda: None)
    room.step(7)
    room.control.next_run()
    room.publisher.begin_run(Environment(load("pollutant"), seed=2))
    room.step()
    assert [data["seed"] for data in room.of("/experiment")] == [1, 2]
    assert {data["user"] for data in room.of("/experiment")} == {"anna"}, "whose run it is"
    now = room.of("/run")[-1]
    assert (now["run"], now["timestep"], now["late"], now["time_s"]) == (2, -1, 0, 0)


def test_pictures_are_made_for_who_looks_and_a_few_per_second() -> None:
    bus, told, wanted = MessageBus(), list[Message](), {"/picture/cam"}
    bus.join(told.append, wanted.__contains__)
    press = PreviewEncoder(bus)
    image = np.zeros((1200, 1600), np.uint8)
    taken = [0, 3, 5, 8, 10]
    try:
        for n in range(11):
            for camera in ("cam", "other"):
                press.offer([Frame(camera, image, n, n * 100 * MS, n * 100 * MS)])
            while len(told) < sum(t <= n for t in taken):
                time.sleep(0.001)
    finally:
        press.close()
    assert [message.data["timestep"] for message in told] == taken
    assert {message.topic for message in told} == {"/picture/cam"}
    data = told[0].data
    assert (data["width_px"], data["scale"], told[0].blob[:2]) == (1600, 0.4, b"\xff\xd8")


def test_the_fence_of_the_file_is_told_where_robots_stand_for_it(tmp_path: Path) -> None:
    path = tmp_path / "fenced.argos"
    fence = """<vs:geofence polygon="-1,-1 1,-1 1,1"><vs:forbidden polygon="0,0 0.5,0 0.5,0.5" />
      <vs:keep_off tag="52447" distance="0.5" /></vs:geofence></arena>"""
    path.write_text((SHIPPED_FOLDER / "pollutant.argos").read_text().replace("</arena>", fence))
    environment = Environment(load(str(path)), seed=1)
    facts = ExperimentFacts("run", "", False, [CAMERA], {}, Troubles())
    assert messages.experiment(facts, environment)["arena"]["fence"] == {
        "boundary": ((-1, -1), (1, -1), (1, 1)),
        "forbidden": [((0, 0), (0.5, 0), (0.5, 0.5))],
        "keep_off": [{"tag": 52447, "distance_m": 0.5}],
    }
    simulated = messages.experiment(replace(facts, command="sim"), environment)["arena"]
    unfenced = messages.experiment(facts, Environment(load("pollutant"), seed=1))["arena"]
    assert simulated == unfenced == {"size_m": [3, 2.4, 1], "centre_m": [0, 0, 0.5]}


def test_a_robot_that_the_runs_machine_drives_is_told(tmp_path: Path) -> None:
    roster = tmp_path / "robots.toml"
    tags = load("pollutant").tags.values()
    robots = [f"[[robot]]\ntag = {tag}\n" for tag in tags]
    robots[2] += 'base = "wifi:192.168.1.40"\n'
    roster.write_text("".join(robots))
    casting = Casting.of(read_roster(roster))
    assert Casting.read(asdict(casting)) == casting
    environment = Environment(load("pollutant", casting=casting), seed=1)
    facts = ExperimentFacts("run", "", False, [CAMERA], {}, Troubles())
    told = messages.experiment(facts, environment)["robots"]
    assert [robot["tag"] for robot in told if "driven_here" in robot] == list(casting.here)
    assert len(casting.here) == 1
    emulated = messages.experiment(replace(facts, command="lab"), environment)["robots"]
    assert not any("driven_here" in robot for robot in emulated)
