"""Sources that fall silent, hurry, end or are closed."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from vsense.base.arena import POSE, ArenaState, Frame
from vsense.base.errors import ConfigError, GrabberError, NoMorePictures, UsageError, VsenseError
from vsense.config.experiment import load
from vsense.config.specs import JsonLinesTracker, MocapTracker, TrackerAddress
from vsense.modes.live._sources import SteadySource, open_source
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.client import TrackerEnded
from vsense.robots.link.trackers.mocap import MocapSystem

MS = 1_000_000
PATIENCE_S = 20.0


def state(capture_ns: int, timestep: int = 0) -> ArenaState:
    return ArenaState(timestep, capture_ns, np.zeros(0, POSE), 0)


class Script:
    """A source that gives what a list says: capture times, or errors to raise."""

    def __init__(self, *acts: int | Exception) -> None:
        self.acts = list(acts)
        self.calls: list[str] = []
        self.closed = threading.Event()

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        if not self.acts:
            assert self.closed.wait(PATIENCE_S)
            raise LinkError("the link is closed")
        act = self.acts.pop(0)
        if isinstance(act, Exception):
            raise act
        return state(act, timestep=4711), ()

    def start(self) -> None:
        self.calls.append("start")

    def stop(self) -> None:
        self.calls.append("stop")

    def check_cameras(self) -> None:
        self.calls.append("check")

    def close(self) -> None:
        self.calls.append("close")
        self.closed.set()


def steady(script: Script) -> SteadySource:
    return SteadySource("lines", "a script", script, 100 * MS, lambda: {"states": 3})


def test_silence_is_waited_out() -> None:
    script = Script(
        LinkError("nothing"), 0, GrabberError("nothing"), LinkError("nothing"), 700 * MS
    )
    source = steady(script)
    assert source.next(0.1)[0].timestep == 0
    assert source.next(0.1)[0].timestep == 7


def test_states_of_a_fast_tracker_are_passed_over() -> None:
    source = steady(Script(*(n * 20 * MS for n in range(21))))
    assert [source.next(0.1)[0].timestep for _ in range(5)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("end", [NoMorePictures("over"), TrackerEnded("over"), VsenseError("bad")])
def test_the_end_and_failures_get_through(end: VsenseError) -> None:
    with pytest.raises(type(end)) as caught:
        steady(Script(end)).next(0.1)
    assert caught.value is end


def test_closing_ends_a_wait() -> None:
    script = Script()
    source = steady(script)
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(source.next, 0.1)
        source.close()
        with pytest.raises(LinkError, match="closed"):
            coming.result(PATIENCE_S)
    source.start()
    source.stop()
    assert script.calls == ["close", "start", "stop"]
    assert source.figures() == {"kind": "lines", "name": "a script", "states": 3}


@pytest.fixture
def said() -> list[str]:
    return []


def test_the_experiment_names_the_tracker(said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = load("pollutant")
    lines = JsonLinesTracker("127.0.0.1", 0, 7)
    source = open_source(replace(experiment, tracker=lines), None, said.append)
    assert source.kind == "lines" and "lines to 127.0.0.1, port " in source.name
    assert source.figures()["bad_lines"] == 0
    source.close()
    address = TrackerAddress("127.0.0.1", 4040, (1.0, 2.0), 0.05, 7)
    source = open_source(replace(experiment, tracker=address), None, said.append)
    assert source.kind == "original" and source.name == "the tracker 127.0.0.1:4040"
    assert source.figures()["reconnects"] == 0
    source.close()


@pytest.mark.parametrize(
    ("tracker", "doubt"),
    [
        (JsonLinesTracker("127.0.0.1", 0, 7), ""),
        (
            JsonLinesTracker("0.0.0.0", 0, 7),
            r"port \d+ on 0.0.0.0: any program there moves every",
        ),
        (TrackerAddress("localhost", 4040, (0.0, 0.0), 0.0, 7), ""),
        (
            TrackerAddress("192.0.2.9", 4040, (0.0, 0.0), 0.0, 7),
            "the tracker 192.0.2.9:4040: any program that answers in its place moves every robot",
        ),
    ],
)
def test_a_tracker_that_others_could_be_is_named(
    said: list[str], tracker: JsonLinesTracker | TrackerAddress, doubt: str
) -> None:
    source = open_source(replace(load("pollutant"), tracker=tracker), None, said.append)
    assert re.match(doubt, source.doubt) if doubt else source.doubt == ""
    source.close()


def test_rigid_bodies_are_robots_of_the_experiment(said: list[str]) -> None:
    """By the roles' names, by tags, or by a table."""
    experiment = load("pollutant")
    first, second, third, *_ = experiment.robots
    poses = [(first.id, 0.1), (str(second.tag), 0.2), ("thumb", 0.3)]
    bodies = ";".join(f"{name}({x},0,0,1,0,0,0)" for name, x in poses)
    for table, expected in (
        ({}, {first.tag: 0.1, second.tag: 0.2}),
        ({"thumb": third.tag}, {third.tag: 0.3}),
    ):
        settings = {"hostname": "127.0.0.1", "rigid_bodies": bodies}
        tracker = MocapTracker(MocapSystem("mock", settings, table, "z"), 3)
        source = open_source(replace(experiment, tracker=tracker), None, said.append)
        with closing(source):
            state, _ = source.next(PATIENCE_S)
        seen = {int(r["tag"]): float(r["x_m"]) for r in state.robots}
        assert seen == pytest.approx(expected)
        assert source.kind == "mocap" and source.doubt == ""
    wrong = MocapTracker(replace(tracker.system, bodies={"thumb": 999}), 3)
    with pytest.raises(ConfigError, match=r"argos:3: <vs:tracker> bodies: 'thumb' has tag 999"):
        open_source(replace(experiment, tracker=wrong), None, said.append)


def test_without_any_the_user_is_told_what_to_do(said: list[str]) -> None:
    with pytest.raises(UsageError, match=r"names no tracker: give --tracking .*<vs:tracker"):
        open_source(load("pollutant"), None, said.append)
