"""One recording per run, whoever presses what and when."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.monitor.recording.conftest import picture
from vsense.base.arena import Frame
from vsense.base.message_bus import Message, MessageBus
from vsense.config.specs import MarkerSpec
from vsense.monitor.recording import _recorder
from vsense.monitor.recording._waiting import WaitingPicture
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ui.recorders import Recorders
from vsense.run.directory import LOG_TXT, RunLog
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker

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


class Tracking:
    """Cameras whose pictures the recorders get."""

    record: Callable[[list[Frame]], None]

    def __init__(self) -> None:
        camera = Camera.looking_down("left", 0.0, 0.0, 2.0, 100.0, (80, 60))
        self.tracker = ArenaTracker.for_family([camera], load_family("arrow4x4"), {31: 0.06})


@pytest.mark.parametrize("early", [True, False])
@pytest.mark.parametrize(("slow_s", "lab"), [(0.0, True), (0.1, True), (0.1, False)])
def test_before_a_run_its_pictures_are_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, slow_s: float, lab: bool, early: bool
) -> None:
    """Twenty pictures come in a second; where each takes 0.1 s, ten can be written."""
    encoded = _recorder._encoded

    def slow(item: WaitingPicture, topic: str) -> Message:
        time.sleep(slow_s)
        return encoded(item, topic)

    monkeypatch.setattr(_recorder, "_encoded", slow)
    runs, tracking = Runs(tmp_path, wanted=True), Tracking()
    runs.recorders = Recorders(runs.bus, True, True, runs.troubles.append, runs.said.append)
    if lab:
        marker = MarkerSpec("arrow4x4", 0.06, 1)
        runs.recorders.watch_family(marker, tracking, 0.05)  # type: ignore[arg-type]
    else:
        session = SimpleNamespace(record=SimpleNamespace(record_image=False))
        described = lambda session: {}  # noqa: E731
        monkeypatch.setattr("vsense.vision.tracking.recorded_tracker.of_session", described)
        runs.recorders.watch_session(session, tracking, timestep_s=0.05)  # type: ignore[arg-type]
    for number in range(2):
        if early is bool(number):
            runs.begin(1)
        tracking.record([picture(number)])
    (words,) = [text for text in runs.said if text.startswith("pictures: about ")]
    assert runs.said.index(words) < 2, "before anything of the run is there"
    if not slow_s:
        assert words.endswith("of 20 in a second this computer writes all")
    else:
        able, way = words.rpartition(" writes ")[2].split(": some will be left out; ")
        assert 0 < float(able) <= 11
        if lab:
            slower = float(way.removesuffix(" would do").removeprefix("--pace "))
            assert slower == pytest.approx(0.8 * float(able) / 20.0, abs=0.05)
        else:
            assert way == "fewer cameras would do"
    runs.recorders.end_run()
    tracking.tracker.close()
    assert [path.name for path in tmp_path.iterdir()] == ["run-1.mcap"], "nothing is left of it"
