"""The command `vsense replay`."""

from __future__ import annotations

import argparse
import json
import os
import signal
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.monitor.recording.conftest import BEGIN_NS, record
from tests.monitor.recording.scene import MADE, session_files, track
from vsense import cli
from vsense.base.interruption import interruption
from vsense.base.message_bus import Message
from vsense.base.terminal import Console
from vsense.commands import replay
from vsense.monitor.replay import ReplayOptions
from vsense.monitor.replay import replay as replay_recording
from vsense.monitor.ui import _watchers
from vsense.monitor.ui._watchers import WatchedBus
from vsense.monitor.ui.access import WebAddress
from vsense.run.orders import Order, OrderKind
from vsense.vision.tracking.arena_tracker import ArenaTracker


@dataclass
class Page:
    """Somebody at the page: waits for an arena state, then presses Ctrl-C in the terminal."""

    runs: WatchedBus
    closed: bool = False
    plays: list[bool] = field(default_factory=list)

    def start(self) -> None:
        self.runs.console.say(self.runs.title)
        self.runs.bus.join(self.receive, lambda topic: topic == "/arena")
        self.runs.bus.join(self.note, lambda topic: topic == "/run")

    def note(self, message: Message) -> None:
        self.plays.append(message.data["replay"]["playing"])

    def receive(self, message: Message) -> None:
        assert self.plays == [False], "it waits for somebody who presses play"
        assert self.runs.give(Order(OrderKind.PAUSE, "viewer 1")) == "paused"
        os.kill(os.getpid(), signal.SIGINT)

    def close(self) -> None:
        self.closed = True


def test_it_waits_for_play_and_ends_when_somebody_interrupts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    gap = {"from_ns": 0, "to_ns": 10**9, "messages": 2, "pictures": 13, "why": "the processor"}
    file = record(
        tmp_path / "run.mcap", [Message("/arena", BEGIN_NS, {}), Message("/gap", BEGIN_NS, gap)]
    )
    pages: list[Page] = []

    def make(runs: WatchedBus) -> Page:
        pages.append(Page(runs))
        return pages[0]

    monkeypatch.setattr(_watchers, "WATCHERS", (lambda options: make,))
    wanted = ReplayOptions(WebAddress("127.0.0.1", 8080), speed=2.0)
    with interruption() as interrupted:
        assert replay_recording(file, wanted, Console(), interrupted) is None
        assert interrupted.code == 130
    assert pages[0].closed
    said = capsys.readouterr().err
    assert "vsense: plays 0.0 s" in said
    assert "lacks 2 messages and 13 pictures of 1.0 s: the processor" in said


def test_it_tracks_again(
    lab: ArenaTracker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(track(tmp_path / "run.mcap", lab, MADE, 5))
    assert cli.main(["replay", file, "--retrack"]) == 0
    assert "19 timesteps compared, 19 the same in every bit" in capsys.readouterr().out
    files = list(map(str, session_files(tmp_path / "session")))
    other = ["--session", *files, "--set", "plan.warm=true", "--json"]
    assert cli.main(["replay", file, "--retrack", *other]) == 0
    compared = json.loads(capsys.readouterr().out)
    assert compared["timesteps"] == 19 and compared["position_m"] < 0.01
    assert compared["versions"] == {}


def test_wrong_use(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(record(tmp_path / "run.mcap", []))
    assert cli.main(["replay", file, "--set", "a.b=1"]) == 2
    assert cli.main(["replay", file, "--retrack"]) == 2
    assert cli.main(["replay", str(tmp_path / "nothing")]) == 2
    capsys.readouterr()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("8080", ("127.0.0.1", 8080)),
        ("0.0.0.0:1", ("0.0.0.0", 1)),
        ("[::1]:9", ("::1", 9)),
        (":7", ("127.0.0.1", 7)),
    ],
)
def test_addresses(text: str, expected: tuple[str, int]) -> None:
    parser = argparse.ArgumentParser()
    replay.add_arguments(parser)
    assert parser.parse_args(["file", "--web", text]).web == expected
    with pytest.raises(SystemExit):
        parser.parse_args(["file", "--web", f"{text}x"])
