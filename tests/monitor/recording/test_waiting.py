"""The queue: messages before pictures, bounds of both, and what it says of what it left out."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.monitor.recording.conftest import picture
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording._waiting import Waiting, WaitingBounds, WaitingItem, WaitingPicture

BOUNDS = WaitingBounds(message_bytes=10, picture_bytes=10, message_ns=100, picture_ns=50)


def message(number: int) -> Message:
    return Message("/run", number, {})


def image(number: int) -> WaitingPicture:
    return WaitingPicture(picture(number), number, number, 1)


def everything(waiting: Waiting) -> list[WaitingItem]:
    found = []
    while (item := waiting.pop(0.0)) is not None:
        found.append(item)
    return found


def test_messages_come_first_and_all_in_their_order() -> None:
    waiting = Waiting(BOUNDS)
    pictures, messages = [image(1), image(2)], [message(3), message(4)]
    assert waiting.put(pictures, [1, 1], 0)
    for each in messages:
        assert waiting.put([each], [1], 0)
    assert everything(waiting) == [*messages, *pictures]
    assert waiting.pop(0.001) is None


def test_what_goes_with_pictures_waits_with_them() -> None:
    waiting = Waiting(BOUNDS)
    memory, first = message(1), image(2)
    waiting.put([memory, first], [1, 1], 0)
    waiting.put([message(3)], [1], 0)
    assert everything(waiting) == [message(3), memory, first]


def test_each_kind_has_its_own_bounds() -> None:
    waiting = Waiting(BOUNDS)
    assert waiting.put([image(1)], [10], 0)
    assert not waiting.put([image(2), image(3)], [1, 1], 10)
    assert waiting.put([message(4)], [10], 10)
    assert not waiting.put([message(5)], [1], 20)
    assert waiting.lost == 3
    taken = everything(waiting)
    assert len(taken) == 2
    assert waiting.put([image(6)], [1], 30)
    assert not waiting.put([image(7)], [1], 81), "the oldest has waited for too long"
    waiting.put([message(8)], [1], 40)
    waiting.end(90)
    gaps = [i.data for i in everything(waiting) if isinstance(i, Message) and i.topic == "/gap"]
    assert gaps == [
        {"from_ns": 20, "to_ns": 20, "messages": 1, "pictures": 0, "why": Waiting.KEEP_UP},
        {"from_ns": 10, "to_ns": 10, "messages": 0, "pictures": 2, "why": Waiting.KEEP_UP},
        {"from_ns": 81, "to_ns": 81, "messages": 0, "pictures": 1, "why": Waiting.KEEP_UP},
    ]


def test_what_is_abandoned_is_lost() -> None:
    waiting = Waiting(BOUNDS)
    waiting.put([message(1)], [1], 0)
    waiting.put([image(1)], [1], 0)
    waiting.abandon()
    assert waiting.lost == 2 and waiting.pop(0.0) is None
    assert waiting.put([message(1)], [10], 0)


def test_a_fault_of_ours_ends_the_recording_and_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus, told = MessageBus(), list[Message]()
    bus.join(told.append, lambda topic: topic == "/event")
    recorder = Recorder(bus, tmp_path / "run.mcap")
    monkeypatch.setattr(recorder, "_add", None)
    bus.publish(Message("/arena", 1, {}))
    end_s = time.monotonic() + 20
    while not told and time.monotonic() < end_s:
        time.sleep(0.01)
    recorder.close()
    assert "recording has failed" in told[0].data["text"] and told[0].data["level"] == "trouble"
    state = recorder.state()
    assert not state["on"] and "recording has failed" in state["trouble"]
