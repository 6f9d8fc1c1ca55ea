"""Robots are leased to one run: of two real processes one is refused, and a killed one has none."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from vsense import cli
from vsense.base.sharing import SharingError
from vsense.base.terminal import Console
from vsense.config.experiment import load
from vsense.modes.live._steering import RunSteering, SessionCallbacks
from vsense.modes.live.opening import lease_robots
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link.server import VirtualSensorServer
from vsense.run import leases
from vsense.run.control import Control, State
from vsense.run.environment import Environment
from vsense.run.leases import Lease, LeasedError, RobotLeases
from vsense.run.orders import Order, OrderError, OrderKind
from vsense.run.runtime import Runtime
from vsense.vision.cameras.grabber import Troubles

HOLDER = """
import sys, time
from pathlib import Path
from vsense.run.leases import RobotLeases
with RobotLeases(Path(sys.argv[1]), "run", "foraging") as held:
    held.take(map(int, sys.argv[2:]))
    print("has them", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    place = tmp_path / "vsense"
    place.mkdir(mode=0o700)
    return place


@pytest.fixture
def other(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that has robots 23 and 24."""
    words = [sys.executable, "-c", HOLDER, str(folder), "24", "23"]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "has them\n"
        yield process
        process.kill()


def test_a_second_run_is_refused_with_who_since_when_and_what(
    folder: Path, other: subprocess.Popen[str]
) -> None:
    mine = RobotLeases(folder, "run", "aggregation")
    whose = (
        rf"'s vsense run of foraging, process {other.pid} on {socket.gethostname()}, since \d\d:"
    )
    with pytest.raises(LeasedError, match=rf"^robots 23, 24 are in use: .*{whose}"):
        mine.take([22, 23, 24, 25])
    held = leases.holders(folder)
    assert sorted(held) == [23, 24], "of what it wanted it has nothing"
    assert {(one.process, one.experiment) for one in held.values()} == {(other.pid, "foraging")}
    with mine:
        mine.take([25])
        with pytest.raises(LeasedError, match=r"^robot 24 "):
            mine.take([24])


@pytest.mark.parametrize("how", [signal.SIGKILL, None])
def test_a_process_that_has_ended_has_no_lease(
    folder: Path, other: subprocess.Popen[str], how: signal.Signals | None
) -> None:
    """Killed, or at its end: what its files say counts for nothing."""
    if how is None:
        assert other.stdin is not None
        other.stdin.close()
    else:
        other.send_signal(how)
    other.wait()
    assert (folder / "robot-23.lease").exists()
    assert leases.holders(folder) == {}
    with RobotLeases(folder, "run", "next") as mine:
        mine.take([23, 24])
        said = json.loads((folder / "robot-23.lease").read_text())
        assert (said["process"], said["experiment"]) == (os.getpid(), "next")
    assert (folder / "robot-23.lease").read_text() == ""


def test_what_a_file_says_is_no_more_than_words(folder: Path, other: subprocess.Popen[str]) -> None:
    """A member may write there; the lock says which process it is."""
    for text in ("", "{", "[]", '{"process": 1}', '{"process": "x"}', "\xff" * 5000):
        (folder / "robot-24.lease").write_text(text)
        assert leases.holders(folder)[24].process == other.pid
    lease = {"user": "\x1b[31mroot", "process": other.pid, "host": "h", "command": "run",
             "experiment": "e\nf", "since": "2026-11-24 10:11:12"}  # fmt: skip
    (folder / "robot-24.lease").write_text(json.dumps(lease))
    told = str(leases.holders(folder)[24])
    assert told.startswith("\\x1b[31mroot's vsense run of e\\nf, process")
    assert told.endswith(("since 2026-11-24 10:11", "since 10:11"))


def test_links_and_other_names_are_no_leases(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("precious")
    (folder / "robot-7.lease").symlink_to(tmp_path / "mine")
    (folder / "robot-x.lease").write_text("")
    with pytest.raises(SharingError, match=r"robot-7\.lease: Too many levels"):
        RobotLeases(folder, "run", "e").take([6, 7])
    assert (tmp_path / "mine").read_text() == "precious"
    assert leases.holders(folder) == {}


def test_who_has_robots_is_listed_and_named_for_handing_over(
    folder: Path, other: subprocess.Popen[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["handover", "--list"]) == 0
    assert capsys.readouterr().out.startswith("robots 23, 24 are in use: ")
    assert cli.main(["handover", "7"]) == 2
    assert "nobody has them; there are:\nrobots 23, 24" in capsys.readouterr().err
    assert cli.main(["handover", "--process", "1"]) == 2
    assert "process 1 has no robots" in capsys.readouterr().err
    assert cli.main(["handover", "23"]) == 2, "it has no control socket"
    assert f"process {other.pid} runs no experiment" in capsys.readouterr().err
    other.kill()
    other.wait()
    assert cli.main(["handover"]) == 2
    assert "no run has robots here" in capsys.readouterr().err


def test_a_run_whose_robots_another_has_is_refused_before_its_port_is_open(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Robots that connect to this machine alone are emulated: everybody may have his own."""
    experiment = load("aggregation")
    tags = [robot.tag for robot in experiment.robots]
    first = min(tags)
    words = [sys.executable, "-c", HOLDER, str(folder), str(first)]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "has them\n"
        run = ["run", "aggregation", "--tracker", "lines", "--insecure", "--port", "0"]
        assert cli.main([*run, "--host", "0.0.0.0"]) == 1
        said = capsys.readouterr().err
        assert said.startswith(f"vsense: robot {first} is in use: ") and "foraging" in said
        calibrate = ["robot", "calibrate", "aggregation", "--tracking", "r.json", "s.json"]
        assert cli.main([*calibrate, "--insecure", "--host", "0.0.0.0"]) == 1
        assert capsys.readouterr().err == said, "what else moves real robots"
        with lease_robots(tags, "run", experiment.name, "127.0.0.1"):
            assert list(leases.holders(folder)) == [first]
        process.kill()
    with lease_robots(tags, "run", experiment.name, "0.0.0.0"):
        names = {path.stem for path in folder.iterdir() if path.read_text()}
        assert names == {f"robot-{robot.tag}" for robot in experiment.robots}


def test_a_run_that_is_going_on_is_handed_over_with_force_only() -> None:
    told: list[str] = []
    console = Console(io.StringIO())
    room = ControlRoom(RoomOptions(), console)
    control = Control(lambda wanted: told.append(wanted.name), told.append)
    steering = RunSteering(
        room,
        cast(ExperimentFacts, SimpleNamespace(cameras=(), troubles=Troubles())),
        Environment(load("foraging"), 1, False),
        cast(VirtualSensorServer, None),
        cast(Runtime, SimpleNamespace(changes=None)),
        control,
        SessionCallbacks((), tuple, list, lambda: told.append("left")),
    )
    control.begin(lambda: None)
    with pytest.raises(OrderError, match=r"^run 1 .*0 s.*--force"):
        steering.hand_over("ben (terminal)", False)
    assert told == [] and control.state == State.RUNNING
    steering.hand_over("ben (terminal)", True)
    assert told == ["STOP", "ben (terminal): run 1 is stopped", "left"]
    assert control.why == "stopped by ben (terminal)"
    with pytest.raises(OrderError, match=r"run 1 .*ben"):
        control.give(Order(OrderKind.STOP, "anna"))
    steering.hand_over("ben (terminal)", False)
    assert told[3:] == ["left"], "between two runs nothing moves"


def test_a_lease_of_another_day_tells_the_day() -> None:
    lease = Lease("anna", 7, "arena", "run", "foraging", "2020-01-02 03:04:05")
    assert str(lease) == "anna's vsense run of foraging, process 7 on arena, since 2020-01-02 03:04"
