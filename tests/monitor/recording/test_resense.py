"""A run whose world was changed while it went on is the same run again, in every bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.run.changed_run import ChangedRun
from vsense.base.message_bus import Message
from vsense.monitor.recording import form
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.recording.resense import Resensing
from vsense.monitor.recording.writer import RecordingWriter

TIMESTEPS = 40


def changes(run: ChangedRun) -> dict[int, Callable[[], None]]:
    """A zone is dragged, a noise and a rate set, a robot added; one in the pause, one in vain."""
    sensor = {"kind": "set", "controller": "ant", "name": "rgb_ground"}
    return {
        6: lambda: run.ask(kind="move", name="nest", x_m=-0.5, y_m=0.0),
        9: lambda: run.ask(**sensor, setting="noise_std_dev", value=0.05),
        11: lambda: run.ask(kind="set", name="trail", setting="evaporation_per_s", value=0.5),
        15: lambda: run.ask(kind="move", name="food", x_m=0.3, y_m=0.1),
        20: lambda: run.ask(kind="move", name="nowhere", x_m=0.3, y_m=0.1),
        22: lambda: run.ask(**sensor, setting="latency", value=2),
        24: lambda: run.ask(kind="add", x_m=0.1, y_m=0.1),
        26: lambda: run.ask(**sensor, setting="latency", value=0),
    }


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a changed run."""
    path = tmp_path_factory.mktemp("resense") / "run.mcap"
    run = ChangedRun()
    recorder = Recorder(run.bus, path)
    run.live(TIMESTEPS, changes(run))
    recorder.close()
    assert [ok for _, ok in run.answers] == [True] * 4 + [False] + [True] * 3, run.answers
    return path


def edited(path: Path, into: Path, edit: Callable[[Message], Message | None]) -> Path:
    """A recording with other messages."""
    with open_recording(path) as whole:
        writer = RecordingWriter(into, whole.begin_ns, whole.utc_shift_ns)
        for message in map(edit, whole.messages()):
            if message is not None:
                writer.add(message)
        writer.close()
    return into


def sensed(path: Path) -> Any:
    with open_recording(path) as recording:
        sensing = Resensing(recording)
        list(sensing.timesteps())
    return sensing.comparison


def test_a_changed_run_is_the_same_again_in_every_bit(recorded: Path) -> None:
    found = sensed(recorded)
    # Of the timesteps of the pause, and of those until it goes on together, nothing is sensed.
    assert found.timesteps == TIMESTEPS - 4 - 2 and found.orders == 7
    assert found.readings > 1000 and found.different == 0 and found.first is None


@pytest.mark.parametrize("change", ["value", "x_m"])
def test_another_change_gives_other_readings_from_there_on(
    recorded: Path, tmp_path: Path, change: str
) -> None:
    done: list[int] = []

    def edit(message: Message) -> Message:
        if message.topic == form.ORDERS_TOPIC and change in message.data["change"] and not done:
            done.append(message.data["run_timestep"])
            other = {**message.data["change"], change: 0.07}
            return Message(message.topic, message.time_ns, {**message.data, "change": other})
        return message

    found = sensed(edited(recorded, tmp_path / "other.mcap", edit))
    assert found.first.run_timestep == done[0], "the change acts in its timestep"
    assert 0 < found.different < found.readings and "the first that differs" in found.lines()[1]


@pytest.mark.parametrize(
    "topic, number, says",
    [
        (form.DEEDS, 0, "does not begin with its run"),
        (form.DEEDS, 12, "lacks a timestep after 12"),
        ("/arena", 12, "lacks a timestep after 12"),
        (form.ORDERS_TOPIC, 1, "lacks a timestep after"),
        ("/experiment", 0, "does not begin with its run"),
    ],
)
def test_what_is_missing_is_said(
    recorded: Path, tmp_path: Path, topic: str, number: int, says: str
) -> None:
    left = [number]

    def edit(message: Message) -> Message | None:
        if message.topic == topic:
            left[0] -= 1
        return None if message.topic == topic and left[0] == -1 else message

    with pytest.raises(RecordingError, match=says):
        sensed(edited(recorded, tmp_path / "less.mcap", edit))


@pytest.mark.parametrize(("mode", "says"), [("live", "an older vsense"), ("sim", "a simulation")])
def test_what_cannot_be_sensed_again_says_why(
    recorded: Path, tmp_path: Path, mode: str, says: str
) -> None:
    def edit(message: Message) -> Message:
        if message.topic != "/experiment":
            return message
        old = {name: value for name, value in message.data.items() if name != "made"}
        return Message(message.topic, message.time_ns, {**old, "mode": mode})

    with pytest.raises(RecordingError, match=says):
        sensed(edited(recorded, tmp_path / "old.mcap", edit))


def test_damaged_deeds_are_one_line(recorded: Path, tmp_path: Path) -> None:
    def edit(message: Message) -> Message:
        if message.topic != form.DEEDS:
            return message
        return Message(message.topic, message.time_ns, {**message.data, "report": ["zz"]})

    with pytest.raises(RecordingError, match="cannot be sensed again"):
        sensed(edited(recorded, tmp_path / "bad.mcap", edit))


def test_more_robots_than_the_file_has_are_sensed_again(tmp_path: Path) -> None:
    path, run = tmp_path / "many.mcap", ChangedRun(robots=18)
    recorder = Recorder(run.bus, path)
    run.live(5, {})
    recorder.close()
    comparison = sensed(path)
    assert len(run.robots) == 18 and (comparison.timesteps, comparison.different) == (5, 0)


def test_the_command_says_that_all_is_the_same(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from vsense.cli import main

    assert main(["replay", str(recorded), "--resense"]) == 0
    assert "7 changes of the world" in capsys.readouterr().out
    assert main(["replay", str(recorded), "--resense", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["different"] == 0
    assert main(["replay", str(recorded), "--experiment", "x.argos"]) == 2
    gone = ["replay", str(recorded), "--resense", "--experiment", "nowhere/x.argos"]
    assert main(gone) == 2 and "cannot be read again" in capsys.readouterr().err
