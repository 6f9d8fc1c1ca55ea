"""A replay tells the same again: at its pace, from anywhere, to whoever comes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.monitor.recording.conftest import BEGIN_NS, picture, record
from vsense.base.message_bus import Listener, Message, MessageBus
from vsense.monitor.recording._player import Player
from vsense.monitor.recording.reader import Recording, open_recording
from vsense.run.orders import Order, OrderError, OrderKind

SECOND_NS = 1_000_000_000
READINGS = {"tag": [7, 23], "values": [[[1.0]], [[2.0]]], "captured_ns": [[5], [6]]}


class Replay:
    """A player whose time is in the test's hands, and somebody who looks."""

    def __init__(self, recording: Recording) -> None:
        self.now_ns = 77
        self.bus = MessageBus()
        self.recording = recording
        self.seen: list[Message] = []
        self.player = Player(recording, self.bus, lambda: self.now_ns)
        self.look()

    def look(self, wants: Callable[[str], bool] = lambda topic: True) -> Listener:
        return self.bus.join(self.seen.append, wants)

    def order(self, kind: OrderKind, value: float = 0.0) -> str:
        return self.player.give(Order(kind, "test", value))

    def live(self, seconds: float) -> list[Message]:
        """Lets time pass; gives what was told."""
        self.seen.clear()
        end_ns = self.now_ns + round(seconds * SECOND_NS)
        while True:
            wait_ns = self.player.step()
            if self.now_ns >= end_ns:
                return list(self.seen)
            self.now_ns = min(self.now_ns + wait_ns, end_ns)

    def state(self) -> tuple[bool, float]:
        """Whether it plays, and where [s], as the newest `/run` says."""
        messages = [*self.seen, *self.live(0.0)]
        newest = [m.data["replay"] for m in messages if m.topic == "/run"][-1]
        return newest["playing"], newest["position_s"]

    def arenas(self, seconds: float) -> list[int]:
        return [m.data["n"] for m in self.live(seconds) if m.topic == "/arena"]


@pytest.fixture
def replay(tmp_path: Path) -> Iterator[Replay]:
    """Ten seconds with ten arena states in each."""
    sent = [
        Message("/experiment", BEGIN_NS, {"mode": "live", "name": "x"}),
        Message("/run", BEGIN_NS, {"state": "running", "can": ["stop"]}),
        Message("/readings", BEGIN_NS, READINGS),
    ]
    sent += [Message("/arena", BEGIN_NS + n * SECOND_NS // 10, {"n": n}) for n in range(101)]
    sent.insert(50, Message("/event", sent[49].time_ns, {"text": "hello"}))
    gap = {"from_ns": 0, "to_ns": SECOND_NS, "messages": 1, "pictures": 0, "why": "the disk"}
    sent.append(Message("/gap", sent[-1].time_ns, gap))
    path = record(tmp_path / "run.mcap", sent, [picture(1), picture(2)])
    with open_recording(path) as recording:
        yield Replay(recording)


def test_it_begins_paused_and_ends_paused(replay: Replay) -> None:
    assert {m.topic for m in replay.live(5.0)} == {"/run"}
    assert replay.state() == (False, 0.0)
    assert replay.order(OrderKind.PLAY, 1) == "plays from 0.0 s"
    assert replay.arenas(20.0) == list(range(101))
    assert replay.state() == (False, 10.0)
    replay.order(OrderKind.PLAY, 1)
    assert replay.arenas(1.0) == list(range(11)), "from its end it plays from its beginning"


def test_it_keeps_pace_and_changes_it(replay: Replay) -> None:
    replay.order(OrderKind.PLAY, 1)
    assert replay.arenas(1.05) == list(range(11))
    replay.order(OrderKind.SPEED, 10)
    assert replay.arenas(0.1) == list(range(11, 21))
    replay.order(OrderKind.SPEED, 0.5)
    assert replay.arenas(1.0) == list(range(21, 26))
    replay.order(OrderKind.PAUSE)
    assert replay.arenas(3.0) == []
    replay.order(OrderKind.PLAY, 1)
    replay.order(OrderKind.PLAY, 0)
    assert replay.state() == (False, pytest.approx(2.55))


def test_a_seek_tells_what_was_current_there(replay: Replay) -> None:
    replay.live(0.0)
    assert replay.order(OrderKind.SEEK, 4.0) == "now at 4.0 s"
    told = {m.topic: m.data for m in replay.live(0.0)}
    assert told["/arena"] == {"n": 40}
    assert told["/experiment"] == {"mode": "replay", "name": "x"}
    assert told["/run"]["state"] == "running" and told["/run"]["can"][0] == "play"
    assert told["/run"]["replay"] == {
        "position_s": 4.0, "begin_s": 0.0, "duration_s": 10.0, "speed": 1.0, "playing": False,
        "pictures": True,
    }  # fmt: skip
    assert "/event" not in told and "/gap" not in told
    replay.order(OrderKind.PLAY, 1)
    assert replay.arenas(0.2) == [41, 42]
    replay.order(OrderKind.SEEK, -5.0)
    assert replay.arenas(0.15) == [0, 1]
    replay.order(OrderKind.SEEK, 1e9)
    assert replay.arenas(1.0) == [100]
    assert replay.state()[1] == 10.0


def test_events_come_once_and_gaps_as_events(replay: Replay) -> None:
    replay.order(OrderKind.PLAY, 1)
    texts = [m.data["text"] for m in replay.live(11.0) if m.topic == "/event"]
    assert texts == ["hello", "here 1.0 s are not recorded whole: the disk"]


def test_newcomers_hear_what_lasts(replay: Replay) -> None:
    replay.order(OrderKind.PLAY, 1)
    replay.live(3.0)
    replay.order(OrderKind.PAUSE)
    replay.live(0.1)
    assert [m.topic for m in replay.live(0.1)] == []
    replay.look()
    assert {"/experiment", "/arena", "/run"} <= {m.topic for m in replay.live(0.0)}


def test_readings_of_one_robot_are_cut_out_where_somebody_looks(replay: Replay) -> None:
    replay.order(OrderKind.PLAY, 1)
    (mine,) = (m.data for m in replay.live(0.1) if m.topic == "/readings/23")
    assert mine == {"tag": [23], "values": [[[2.0]]], "captured_ns": [[6]]}


def test_pictures_come_where_somebody_looks_and_not_too_many(replay: Replay) -> None:
    replay.order(OrderKind.PLAY, 1)
    # Recorded last, and both at the same moment.
    pictures = [m for m in replay.live(11.0) if m.topic == "/picture/left"]
    assert len(pictures) == 1 and pictures[0].blob.startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        (OrderKind.START, 0, "start: a replay can only play, pause, speed, seek"),
        (OrderKind.EMERGENCY, 0, "emergency: a replay can only"),
        (OrderKind.SPEED, 0, "speed: 0, expected 0.1 to 100"),
        (OrderKind.SPEED, float("nan"), "speed: nan, expected"),
        (OrderKind.SEEK, float("inf"), "seek: inf, expected seconds"),
    ],
)
def test_orders_that_a_replay_does_not_know(
    replay: Replay, kind: OrderKind, value: float, expected: str
) -> None:
    with pytest.raises(OrderError, match=expected):
        replay.order(kind, value)


def test_the_thread_plays_to_the_end(tmp_path: Path) -> None:
    sent = [Message("/arena", BEGIN_NS + n * 1_000_000, {"n": n}) for n in range(200)]
    path = record(tmp_path / "run.mcap", sent)
    bus, seen = MessageBus(), []
    with open_recording(path) as recording:
        player = Player(recording, bus)
        ended = threading.Event()

        def take(message: Message) -> None:
            if message.topic == "/arena":
                seen.append(message.data["n"])
            elif seen[-1:] == [199] and not message.data["replay"]["playing"]:
                ended.set()

        bus.join(take, lambda topic: topic in ("/arena", "/run"))
        player.start()
        player.give(Order(OrderKind.PLAY, "test", 1))
        assert ended.wait(30.0)
        player.close()
    assert seen == list(range(200))


def test_messages_that_were_written_late_do_not_hold_it_back(tmp_path: Path) -> None:
    """As pictures in a recording of a slow computer, whose encoder was seconds behind."""
    sent = [Message("/arena", BEGIN_NS + n * SECOND_NS // 10, {"n": n}) for n in range(101)]
    late = [Message("/cameras", BEGIN_NS + n * SECOND_NS // 10, {}) for n in range(0, 60, 2)]
    for place, message in enumerate(late):
        sent.insert(70 + 2 * place, message)
    with open_recording(record(tmp_path / "run.mcap", sent)) as recording:
        replay = Replay(recording)
        replay.order(OrderKind.PLAY, 1)
        assert replay.arenas(10.5) == list(range(101))
        assert replay.state() == (False, 10.0)


def test_it_begins_in_the_run_when_its_robots_are_known_and_with_its_verdict(
    tmp_path: Path,
) -> None:
    def at(seconds: float) -> int:
        return BEGIN_NS + round(seconds * SECOND_NS)

    sent = [Message("/experiment", at(0.0), {"name": "x"})]
    sent += [Message("/arena", at(n / 10), {"n": n}) for n in range(30)]
    sent.append(Message("/robots", at(1.0), {"trouble": ["not connected"]}))
    sent.append(Message("/run", at(1.5), {"state": "waiting"}))
    sent.append(Message("/run", at(3.0), {"state": "running"}))
    sent += [Message("/arena", at(n / 10), {"run_timestep": n - 31}) for n in range(30, 40)]
    sent.insert(-8, Message("/robots", at(3.15), {"trouble": [""]}))
    why = "robot 23 never came"
    sent.append(Message("/run", at(4.0), {"state": "ended", "verdict": "void", "why": why}))
    seen: dict[str, Message] = {}
    with open_recording(record(tmp_path / "run.mcap", sent)) as recording:
        assert recording.lacks() == [f"{recording.path}: its run is invalid: {why}"]
        bus, begun = MessageBus(), threading.Event()

        def take(message: Message) -> None:
            seen[message.topic] = message
            if {"/run", "/robots", "/arena"} <= seen.keys():
                begun.set()

        bus.join(take, lambda topic: True)
        player = Player(recording, bus)
        player.start()
        assert begun.wait(20)
        player.close()
    assert seen["/robots"].data["trouble"] == [""] and seen["/arena"].data["run_timestep"] == 0
    run = seen["/run"].data
    assert (run["state"], run["why"]) == ("running", why)
    assert not run["replay"]["playing"]
    assert run["replay"]["begin_s"] == run["replay"]["position_s"] == pytest.approx(3.15, abs=1e-3)


def test_the_measures_of_each_run_are_there_from_its_beginning(tmp_path: Path) -> None:
    cone = {"x_m": [0.0, 2.0, 2.0], "y_m": [0.0, -1.0, 1.0]}
    facts = {"mode": "live", "name": "x", "timestep_s": 0.1, "objects": [{"tag": 99}]}
    sent = [Message("/experiment", BEGIN_NS, facts)]
    for n in range(40):
        at_ns, run, timestep = BEGIN_NS + n * SECOND_NS // 10, 1 + n // 20, n % 20
        robots = {"tag": [7, 8, 99], "x_m": [n / 20, 1.0, 1.0], "y_m": [0.0, 3.0, 0.0]}
        signals = {"timestep": timestep, "time_s": timestep / 10, "measures": {"items": n}}
        sent += [
            Message("/run", at_ns, {"state": "running", "run": run}),
            Message("/robots", at_ns, {"tag": [7, 8], "leds": [255 * (n > 10), 0]}),
            Message("/arena", at_ns, {"robots": robots}),
            Message("/signals", at_ns, {**signals, "cones": [cone] if n else []}),
        ]
    sent.append(Message("/signals", sent[-1].time_ns, {"timestep": "damaged"}))
    histories: list[Message] = []
    with open_recording(record(tmp_path / "run.mcap", sent)) as recording:
        bus, arrived = MessageBus(), threading.Event()

        def take(message: Message) -> None:
            histories.append(message)
            arrived.set()

        bus.join(take, "/history".__eq__)
        player = Player(recording, bus)
        player.start()
        assert arrived.wait(20)
        arrived.clear()
        player.give(Order(OrderKind.SEEK, "test", 3.0))
        assert arrived.wait(20)
        player.close()
    first, second = (message.data for message in histories)
    assert (first["run"], second["run"]) == (1, 2)
    assert first["time_s"] == second["time_s"] == [n / 10 for n in range(20)]
    last = {name: column["last"] for name, column in first["measures"].items()}
    assert last["items"] == tuple(range(20))
    # Nobody knows before the first cone that there will be one; a thing in it is no robot.
    assert last["robots_in_cone"] == (None, *[1] * 19)
    assert last["lit_in_cone"] == (None, *[0] * 10, *[1] * 9)
    assert last["LEDs on"] == (*[0] * 11, *[1] * 9)
