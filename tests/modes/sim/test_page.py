"""A simulation that is watched, paced and recorded: the same run in every bit."""

from __future__ import annotations

import csv
import json
import random
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import require_tool
from tests.modes.sim.conftest import results_of, world_of
from vsense.base.errors import UsageError, VsenseError
from vsense.base.message_bus import Message, MessageBus
from vsense.base.terminal import Console
from vsense.cli import main
from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.modes.sim._recording import SimRecorder
from vsense.modes.sim._room import SimRoom, WatchedRuns
from vsense.modes.sim._simulation import EPOCH_NS, MAX_TIMESTEPS, WARM_UP_TIMESTEPS, Simulation
from vsense.modes.sim._worker import simulate
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task, libraries_of
from vsense.monitor.recording.form import ROBOT_COLUMNS, RecordingError
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ui.access import WebAddress
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.run.changing import Change, ChangeKind
from vsense.run.control import State
from vsense.run.orders import Order, OrderError, OrderKind
from vsense.run.programs import shared_objects
from vsense.studies.report._findings import read_findings

PATIENCE_S = 60.0


@pytest.fixture(autouse=True)
def compiler() -> None:
    require_tool("cc", "build-essential")


def simulation(experiment: Experiment) -> Simulation:
    return Simulation(experiment, shared_objects(experiment), 3)


@pytest.mark.parametrize("looks", [False, True])
def test_stretches_of_any_length_are_the_same_run(tmp_path: Path, looks: bool) -> None:
    experiment, draw = world_of(tmp_path), random.Random(1)
    whole, parts = simulation(experiment), simulation(experiment)
    asked: list[int] = []
    parts.gate = lambda run_timestep: asked.append(run_timestep) or draw.randint(1, 9)  # type: ignore[func-returns-value]
    seen: list[int] = []
    parts.observe = seen.append if looks else None
    assert whole.run() == parts.run()
    assert results_of(whole) == results_of(parts)
    assert len(asked) > 20 and asked == sorted(set(asked))
    assert seen == (list(range(len(parts.record.timesteps))) if looks else [])


def test_a_run_ends_where_its_gate_is_closed(tmp_path: Path) -> None:
    run = simulation(world_of(tmp_path))
    run.gate = lambda run_timestep: 0 if run_timestep >= 30 else 30 - run_timestep
    run.run()
    assert len(run.record.timesteps) == len(run.record.poses) == 30


def test_what_is_changed_between_two_timesteps_counts_in_c_as_in_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = world_of(tmp_path)

    def moved(far_m: float) -> tuple[object, ...]:
        run = simulation(experiment)

        def gate(run_timestep: int) -> int:
            if run_timestep < 60:
                return 60 - run_timestep
            if run_timestep == 60:
                world, light = run.environment.world, run.environment.world.lights()[0]
                world.move(light.id, light.position_m[0] + far_m, light.position_m[1])
            return MAX_TIMESTEPS

        run.gate = gate
        run.run()
        return results_of(run)

    in_c = moved(0.7)
    monkeypatch.setattr(Simulation, "_chained", lambda run: None)
    assert moved(0.7) == in_c
    assert moved(0.0)[0] != in_c[0], "the light matters"


def test_orders_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[tuple[int, str, Any]] = []
    with opened(load("foraging"), 7) as room:
        control = room.control
        send = lambda name, value: sent.append((control.run, name, value))  # noqa: E731
        monkeypatch.setattr(room, "_send", send)
        give = lambda kind, value=0.0: control.give(Order(kind, "viewer 1", value))  # noqa: E731
        for kind in (OrderKind.PAUSE, OrderKind.START, OrderKind.RECORD):
            with pytest.raises(OrderError, match=f"cannot {kind.value}: run 1 is not running"):
                give(kind)
        room.begin_run(tmp_path)
        assert sent.pop() == (1, "begin", (1.0, True, False)) and control.state is State.RUNNING
        for kind in (OrderKind.START, OrderKind.SEEK, OrderKind.PLAY, OrderKind.REPLACE):
            with pytest.raises(OrderError):
                give(kind)
        with pytest.raises(OrderError, match="no robot moves here"):
            give(OrderKind.EMERGENCY)
        for speed in (0.09, -1.0):
            with pytest.raises(OrderError, match=r"expected 0\.1 or more"):
                give(OrderKind.SPEED, speed)
        assert not sent and control.state is State.RUNNING
        assert give(OrderKind.SPEED, 0.0) == "as fast as it goes"
        assert give(OrderKind.STEP) == "one timestep" and control.state is State.PAUSED
        give(OrderKind.START)
        assert [(name, value) for _, name, value in sent] == [
            ("speed", float("inf")), ("step", 1), ("play", 1),
        ]  # fmt: skip
        assert give(OrderKind.STOP) == "run 1 is stopped" and control.state is State.RUNNING
        assert give(OrderKind.RESET) == "reset: run 2 waits for a start" and control.next_asked
        assert [order[:2] for order in sent[-2:]] == [(1, "stop")] * 2
        room.end_run()
        assert set(control.can) == {OrderKind.RESET, OrderKind.SPEED}
        room.next_run(8)
        room.begin_run(tmp_path)
        assert sent[-1] == (2, "begin", (float("inf"), False, False))
        assert control.state is State.PAUSED


@contextmanager
def opened(experiment: Experiment, seed: int, **options: bool) -> Iterator[SimRoom]:
    """A room for simulations."""
    shown = RoomOptions(WebAddress("127.0.0.1", 0), **options)  # type: ignore[arg-type]
    with (
        ControlRoom(shown, Console()) as control_room,
        SimRoom(control_room, experiment, seed) as room,
    ):
        yield room


class Viewer:
    """Watches a room's messages, and waits for what it shows."""

    def __init__(self, room: SimRoom) -> None:
        self.room, self.messages = room, list[Message]()
        self._news = threading.Condition()
        room.bus.join(self._receive, lambda topic: True)

    def _receive(self, message: Message) -> None:
        with self._news:
            self.messages.append(message)
            self._news.notify()

    def until(self, shown: Any) -> None:
        with self._news:
            assert self._news.wait_for(lambda: any(map(shown, self.messages)), PATIENCE_S)

    def give(self, kind: OrderKind, value: float = 0.0) -> None:
        self.room.control.give(Order(kind, "test", value))


def arena_of(timestep: int) -> Any:
    return lambda m: m.topic == "/arena" and m.data["run_timestep"] == timestep


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run with a recording and the same without."""
    require_tool("cc", "build-essential")
    folder = tmp_path_factory.mktemp("recorded")
    words = ["sim", "foraging", "--duration", "12", "--robots", "4", "--seed", "9"]
    assert main([*words, "-o", str(folder / "plain")]) == 0
    assert main([*words, "-o", str(folder / "kept"), "--record"]) == 0
    return folder / "plain", folder / "kept"


def test_a_page_that_pauses_steps_and_hurries_changes_nothing(
    recorded: tuple[Path, Path], tmp_path: Path
) -> None:
    setup = Setup("foraging", 12.0, 4)
    experiment, interrupted = setup.load(), threading.Event()
    libraries = libraries_of(experiment)
    with opened(experiment, 9, hold=True) as room:
        viewer = Viewer(room)

        def watch() -> None:
            viewer.until(arena_of(-1))
            viewer.give(OrderKind.STEP)
            viewer.until(arena_of(0))
            viewer.give(OrderKind.RECORD, 1.0)
            viewer.give(OrderKind.STEP)
            viewer.until(arena_of(1))
            viewer.give(OrderKind.SPEED, 0.0)
            viewer.give(OrderKind.START)

        watching = threading.Thread(target=watch)
        with WatchedRuns(room, interrupted) as runs:
            job = Job(setup, 9, libraries, str(tmp_path))
            room.begin_run(tmp_path)
            watching.start()
            result = runs.run(Task(job, experiment), lambda workers: None)
            watching.join()
            viewer.until(arena_of(119))
    assert not runs.cut
    expected = json.loads((recorded[0] / "summary.json").read_text())
    assert result["measures"] == expected["measures"]
    assert "swarm" not in expected, "there is no cone"
    for name in ("trajectory.npz", "events.csv", "shown.csv", "timesteps.csv", "measures.csv"):
        assert (tmp_path / name).read_bytes() == (recorded[0] / name).read_bytes(), name
    topics = {message.topic for message in viewer.messages}
    assert {"/experiment", "/run", "/arena", "/signals", "/readings", "/robots"} <= topics
    with open_recording(tmp_path / "foraging.mcap") as recording:
        timesteps = [m.data["run_timestep"] for m in recording.messages({"/arena"})]
    assert timesteps == list(range(1, 120)), "from the order on"


@pytest.mark.parametrize("locked", [False, True])
def test_the_world_is_changed_between_two_timesteps(tmp_path: Path, locked: bool) -> None:
    setup = Setup("foraging", 12.0, 2)
    experiment, interrupted = setup.load(), threading.Event()
    libraries = libraries_of(experiment)
    answers: list[tuple[str, bool]] = []
    with opened(experiment, 9, hold=True, locked=locked) as room:
        viewer = Viewer(room)
        change = Change(kind=ChangeKind.MOVE, name="nest", x_m=0.25, y_m=0.5)
        ask = lambda: room._ask(change, "viewer 1", lambda *said: answers.append(said))  # noqa: E731
        with pytest.raises(OrderError, match="nothing can be changed: run 1 is waiting"):
            ask()

        def watch() -> None:
            viewer.until(arena_of(-1))
            ask()
            viewer.give(OrderKind.RECORD, 1.0)
            viewer.give(OrderKind.STEP)
            viewer.until(arena_of(0))
            viewer.give(OrderKind.STOP)

        watching = threading.Thread(target=watch)
        with WatchedRuns(room, interrupted) as runs:
            room.begin_run(tmp_path)
            watching.start()
            runs.run(
                Task(Job(setup, 9, libraries, str(tmp_path)), experiment), lambda workers: None
            )
            watching.join()
    ((text, ok),) = answers
    orders = [m.data for m in viewer.messages if m.topic == "/orders"]
    worlds = [m.data for m in viewer.messages if m.topic == "/world"]
    (nest,) = [thing for thing in worlds[-1]["entities"] if thing["id"] == "nest"]
    if locked:
        assert not ok and "--locked" in text and orders == []
    else:
        assert ok and (nest["x_m"], nest["y_m"]) == (0.25, 0.5)
        assert [(told["by"], told["run_timestep"]) for told in orders] == [("viewer 1", 0)]


def test_recording_changes_no_result(recorded: tuple[Path, Path]) -> None:
    plain, kept = recorded
    assert {p.name for p in kept.iterdir()} - {p.name for p in plain.iterdir()} == {"foraging.mcap"}
    for path in plain.iterdir():
        if path.name != "summary.json":  # it says how fast it went
            assert path.read_bytes() == (kept / path.name).read_bytes(), path.name


def test_a_recording_holds_every_timestep_as_it_was(recorded: tuple[Path, Path]) -> None:
    _, kept = recorded
    run = np.load(kept / "trajectory.npz")
    measured = list(csv.DictReader((kept / "measures.csv").open()))
    with open_recording(kept / "foraging.mcap") as recording:
        assert recording.complete and not recording.gaps
        facts, places = recording.experiment, []
        told: dict[str, list[Message]] = {}
        for message in recording.messages():
            told.setdefault(message.topic, []).append(message)
    assert (facts["mode"], facts["command"], facts["seed"]) == ("sim", "sim", 9)
    for number, message in enumerate(told["/arena"]):
        assert message.data["run_timestep"] == number
        assert message.time_ns == EPOCH_NS + (number + WARM_UP_TIMESTEPS) * 100_000_000
        robots = message.data["robots"]
        order = [robots["tag"].index(tag) for tag in run["tags"].tolist()]
        places.append([[robots["x_m"][row], robots["y_m"][row]] for row in order])
    # The tracker's errors are far below a millimetre.
    assert np.abs(np.array(places) - run["poses"][:, :, :2]).max() < 5e-4
    assert len(told["/readings"]) == len(told["/robots"]) == 120
    assert {*ROBOT_COLUMNS, "actuators", "shown"} - {"held"} == {*told["/robots"][0].data}
    ends = [message.data["measures"] for message in told["/signals"]]
    rows = [{name: float(row[name]) for name in ends[0]} for row in measured]
    assert rows == ends and len(rows) == 120


def test_timesteps_of_a_simulation_have_what_it_has(recorded: tuple[Path, Path]) -> None:
    rows = list(csv.DictReader((recorded[1] / "timesteps.csv").open()))
    assert [int(row["run_timestep"]) for row in rows] == list(range(120))
    first = {**rows[0]}
    assert first.pop("capture_ns") == str(EPOCH_NS + WARM_UP_TIMESTEPS * 100_000_000)
    assert first == {
        "run_timestep": "0", "timestep": "3", "ready_ns": "", "arena_ns": "", "sent_ns": "",
        "connected": "", "seen": "4", "stale": "",
    }  # fmt: skip


def test_report_and_export_take_it(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    file = recorded[1] / "foraging.mcap"
    found = read_findings(file)
    assert found.label == "foraging, simulation, seed 9"
    assert found.gathered.ran and not found.incidents and not found.lacks and not found.latency
    assert main(["export", str(file), "--csv", "-o", str(tmp_path / "tables")]) == 0
    exported = list(csv.DictReader((tmp_path / "tables" / "measures.csv").open()))
    kept = list(csv.DictReader((recorded[1] / "measures.csv").open()))
    assert [float(row["items_home"]) for row in exported] == [
        float(row["items_home"]) for row in kept
    ]


def test_each_run_of_a_campaign_has_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sim", "foraging", "--duration", "1", "--robots", "2", "-j1"]
    sweep = ["--seeds", "7", "--set", "foraging.release=0,1"]
    table, plain = tmp_path / "r.csv", tmp_path / "plain.csv"
    assert main([*words, *sweep, "--record", "-o", str(table)]) == 0
    said = capsys.readouterr().err
    assert main([*words, *sweep, "-o", str(plain)]) == 0
    assert table.read_bytes() == plain.read_bytes()
    assert not (tmp_path / "plain-recordings").exists(), "nobody asked for them"
    names = [p.name for p in sorted((tmp_path / "r-recordings").iterdir())]
    assert names == ["01-foraging.release=0-seed7.mcap", "02-foraging.release=1-seed7.mcap"]
    assert "for all 2; " in said and "2 recordings, " in said


def test_a_full_disk_ends_the_recording_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = MessageBus()
    recorder = SimRecorder(bus, tmp_path / "run.mcap", EPOCH_NS)
    say = lambda n: bus.publish(Message("/run", EPOCH_NS + n, {"timestep": n}))  # noqa: E731
    say(1)
    recorder._writer.flush()

    def full() -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(recorder._writer, "flush", full)
        recorder._flushed_s = 0.0
        for number in range(2, 5):
            say(number)
    made = recorder.close()
    assert "No space left on device" in made["trouble"] and recorder.state()["on"] is False
    with open_recording(tmp_path / "run.mcap") as recording:
        assert next(m.data["timestep"] for m in recording.messages()) == 1


def test_a_picture_that_cannot_be_written_costs_neither_recording_nor_tables(
    tmp_path: Path,
) -> None:
    setup, file = Setup("foraging", 1.0, 2), tmp_path / "foraging.mcap"
    experiment = setup.load()
    libraries = libraries_of(experiment)
    (tmp_path / "foraging.png").mkdir()
    with pytest.raises(VsenseError, match="cannot be written"):
        simulate(Job(setup, 9, libraries, str(tmp_path), str(file)), experiment, None)
    with open_recording(file) as recording:
        assert recording.complete and not recording.gaps
    for name in ("timesteps.csv", "measures.csv"):
        assert len((tmp_path / name).read_text().splitlines()) == 11, name


def test_a_recording_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"mine")
    with pytest.raises(RecordingError, match="is there already"):
        SimRecorder(MessageBus(), tmp_path / "run.mcap", EPOCH_NS)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--web", "--runs", "2"], "one run only"),
        (["--hold"], "--hold: only with --web"),
        (["--speed", "2"], "vsense: --speed: only with --web"),
        (["--record", "--runs", "2", "--on", "tcp://10.0.0.1:1"], "on the workers' machines"),
    ],
)
def test_what_does_not_go_together(
    words: Sequence[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", "foraging", *words]) == UsageError.exit_code
    assert reason in capsys.readouterr().err
