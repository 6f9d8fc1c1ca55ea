"""One recording per run, whoever presses what and when."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ui.recorders import Recorders
from vsense.run.directory import LOG_TXT, RunLog

PATIENCE_S = 20.0


class Runs:
    """Recorders of runs that each tell one message with their number."""

    def __init__(self, folder: Path, wanted: bool) -> None:
        self.bus, self.troubles, self.said = MessageBus(), list[str](), list[str]()
        tell = self.troubles.append, self.said.append
        self.recorders = Recorders(self.bus, wanted, False, *tell)
        self._folder = folder

    def path(self, number: int) -> Path:
        return self._folder / f"run-{number}.mcap"

    def begin(self, number: int) -> None:
        self.recorders.begin_run(self.path(number))

    def tell(self, number: int) -> None:
        self.bus.publish(Message("/run", number, {"run": number}))

    def told(self, number: int) -> list[int]:
        """What a run's recording holds."""
        return [m.data["run"] for m in open_recording(self.path(number)).messages(["/run"])]


def wait_for(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def test_each_run_has_a_file_of_its_own(tmp_path: Path) -> None:
    runs = Runs(tmp_path, wanted=True)
    for number in (1, 2):
        runs.begin(number)
        runs.tell(number)
        runs.recorders.end_run()
    assert [runs.told(1), runs.told(2)] == [[1], [2]]
    begins, ends, made = runs.said[:3]
    assert begins == f"recording to {runs.path(1)}" and ends.endswith(str(runs.path(1)))
    assert made.startswith(f"recording: {runs.path(1)}, ") and made.endswith(" MB")


def test_what_is_pressed_between_runs_is_for_the_next_one(tmp_path: Path) -> None:
    runs = Runs(tmp_path, wanted=False)
    assert runs.recorders.switch(True) == "the next run is recorded"
    assert not runs.recorders.state()["on"]
    runs.begin(1)
    runs.tell(1)
    runs.recorders.end_run()
    assert runs.recorders.switch(False) == "the next run is not recorded"
    runs.begin(2)
    runs.tell(2)
    runs.recorders.end_run()
    assert runs.told(1) == [1] and not runs.path(2).exists()


def test_a_recording_begins_in_mid_run_and_ends_with_it(tmp_path: Path) -> None:
    runs = Runs(tmp_path, wanted=False)
    runs.begin(1)
    runs.tell(1)
    assert runs.recorders.switch(True) == f"recording to {runs.path(1)}"
    wait_for(lambda: runs.recorders.state()["on"])
    runs.tell(2)
    runs.begin(2)
    runs.tell(3)
    runs.recorders.end_run()
    assert [runs.told(1), runs.told(2)] == [[2], [3]]


def test_what_cannot_be_recorded_is_told_and_costs_no_run(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    runs = Runs(tmp_path / "file", wanted=True)
    runs.begin(1)
    runs.tell(1)
    runs.recorders.end_run()
    (trouble,) = runs.troubles
    assert trouble.startswith("run not recorded: ") and "run-1.mcap" in trouble
    assert not runs.recorders.state()["on"]


def test_a_secret_is_printed_and_neither_told_nor_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told: list[str] = []
    with RunLog(tmp_path) as log:
        log.repeat_to(lambda text, level: told.append(text))
        log.print_only("control room: http://x/?token=secret")
        log.say("all robots start")
    assert told == ["all robots start"]
    assert "secret" not in (tmp_path / LOG_TXT).read_text()
    assert "token=secret" in capsys.readouterr().err


def test_a_suspended_run_is_not_recorded_and_says_so(tmp_path: Path) -> None:
    runs = Runs(tmp_path, wanted=True)
    runs.begin(1)
    runs.tell(1)
    runs.recorders.suspend()
    assert not runs.recorders.state()["on"] and runs.recorders.wanted
    runs.tell(2)
    assert runs.recorders.switch(False) == "the run is not recorded when it goes on"
    runs.recorders.go_on()
    runs.tell(3)
    runs.recorders.suspend()
    assert runs.recorders.switch(True) == "the run is recorded when it goes on"
    runs.recorders.go_on()
    assert runs.recorders.state()["on"]
    runs.tell(4)
    made = runs.recorders.end_run()
    assert runs.told(1) == [1, 4] and made["bytes"] == runs.path(1).stat().st_size
    assert [gap.why for gap in open_recording(runs.path(1)).gaps] == ["recording was switched off"]
