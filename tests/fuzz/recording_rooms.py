"""Rooms of recordings: whole files with damaged bytes, and sound files that say untrue things."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from random import Random

from tests.fuzz import mutate
from tests.monitor.recording.conftest import record
from tests.studies.report.runs import messages as made_messages
from vsense.base.errors import VsenseError
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording._player import Player
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording.export import export_csv
from vsense.monitor.recording.reader import open_recording
from vsense.run.orders import Order, OrderKind
from vsense.studies.report._findings import as_json, read_findings

BEGIN_NS = 5_000_000_000


@dataclass(frozen=True, slots=True)
class RecordingScene:
    """A short recording, as bytes and as messages, and a folder for changed ones."""

    folder: Path
    data: bytes
    messages: list[Message]


def prepare(folder: Path) -> RecordingScene:
    """Records a run that is made by hand."""
    path = record(folder / "whole.mcap", made_messages())
    with open_recording(path) as recording:
        messages = list(recording.messages())
    return RecordingScene(folder, path.read_bytes(), messages)


def _use(random: Random, path: Path, folder: Path) -> None:
    """Everything that reads a recording reads it."""
    with open_recording(path) as recording:
        kind = random.randrange(4)
        if kind == 0:
            target = folder / "csv"
            target.mkdir(exist_ok=True)
            export_csv(recording, target)
            for made in target.iterdir():
                made.unlink()
        elif kind == 1:
            _play(random, recording)
        elif kind == 2:
            recording.newest({"/world", "/run"}, before_s=random.choice((None, 0.0, 1.0)))
            assert recording.duration_s >= 0.0
            sum(1 for _ in recording.messages(start_s=random.choice((0.0, 0.5, 1e6))))
    if kind == 3:
        as_json(read_findings(path))


def _play(random: Random, recording: object) -> None:
    now = [0]
    player = Player(recording, MessageBus(), lambda: now[0])  # type: ignore[arg-type]
    orders = (OrderKind.PLAY, OrderKind.PAUSE, OrderKind.SPEED, OrderKind.SEEK)
    for _ in range(6):
        with contextlib.suppress(VsenseError):
            player.give(Order(random.choice(orders), "fuzz", random.choice((0.0, 1.0, 2.0, 1e9))))
        player.step()
        now[0] += random.randrange(10**9)


def damaged(random: Random, scene: RecordingScene) -> None:
    """Damaged bytes."""
    path = scene.folder / "damaged.mcap"
    path.write_bytes(mutate.raw(random, scene.data))
    _use(random, path, scene.folder)


def untrue(random: Random, scene: RecordingScene) -> None:
    """A sound file whose messages are not what was recorded."""
    path = scene.folder / "untrue.mcap"
    path.unlink(missing_ok=True)
    bus = MessageBus()
    recorder = Recorder(bus, path, pictures=False, clock=lambda: BEGIN_NS)
    some = random.sample(scene.messages, min(len(scene.messages), 30))
    for message in sorted(some, key=lambda message: message.time_ns):
        data, time_ns = message.data, message.time_ns
        if random.random() < 0.2:
            changed = mutate.value(random, dict(data))
            data = changed if isinstance(changed, dict) else {}
        if random.random() < 0.02:
            time_ns = random.choice((0, -1, 2**62, time_ns + 10**15))
        bus.publish(Message(message.topic, time_ns, data, message.blob))
    recorder.close()
    _use(random, path, scene.folder)
