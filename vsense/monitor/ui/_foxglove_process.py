"""The process that serves Foxglove: takes our messages from its parent, and speaks the protocol.

`_foxglove_server.py` starts it as a `BusProcess`; the fields of a `FoxgloveSpec` come first. It
answers with its port, and sends ("wants", topics) when that changes, and ("orders", [(kind,
value)]) for a replay.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import foxglove
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)

from vsense.base.message_bus import Message
from vsense.monitor.foxglove import _schemas
from vsense.monitor.foxglove.channels import (
    FIELD_TOPIC,
    LASTING,
    PICTURE,
    Channels,
    schema_of,
    sources_of,
)
from vsense.monitor.recording import form
from vsense.monitor.ui._bus_process import ParentLink

MESSAGE_BACKLOG = 32
"""Messages that wait for one client; then its oldest go."""
_WAIT_S = 0.05
_JUMP_S = 1.0
"""A replay that is farther on than it can have played has jumped."""


@dataclass(frozen=True, slots=True)
class FoxgloveSpec:
    """What the process is to do.

    Attributes:
        host, port: where it listens; 0 takes any free port.
        utc_shift_ns: UTC less the clock of the messages.
        begin_ns, end_ns: of the recording that is played, UTC; None: this is no replay.
        steered: clients may play, pause and seek.
    """

    host: str
    port: int
    utc_shift_ns: int
    begin_ns: int | None = None
    end_ns: int | None = None
    steered: bool = False


class FoxgloveClients(ServerListener):
    """Hears clients, in the library's threads: who subscribes to what, and how a replay goes on."""

    def __init__(self, spec: FoxgloveSpec, link: ParentLink) -> None:
        self._spec = spec
        self._link = link
        self._new: set[int] = set()
        self._lock = threading.Lock()
        self.playing, self.speed, self.position_ns = False, 1.0, spec.begin_ns or 0

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Notes a channel that has a new subscriber, who knows nothing of it."""
        with self._lock:
            self._new.add(channel.id)

    def take_new(self) -> set[int]:
        """The channels that were subscribed to since the last call."""
        with self._lock:
            new, self._new = self._new, set()
        return new

    def on_playback_control_request(
        self, playback_control_request: PlaybackControlRequest
    ) -> PlaybackState:
        """Passes on what a client wants of the replay, and says what it will be."""
        asked = playback_control_request
        self.playing = asked.playback_command == PlaybackCommand.Play
        orders: list[tuple[str, float]] = []
        if asked.playback_speed > 0.0:
            self.speed = asked.playback_speed
            orders.append(("speed", self.speed))
        if asked.seek_time is not None and self._spec.begin_ns is not None:
            self.position_ns = asked.seek_time
            orders.append(("seek", (asked.seek_time - self._spec.begin_ns) / 1e9))
        orders.append(("play", float(self.playing)))
        self._link.send("orders", orders)
        return self.state(asked.seek_time is not None)

    def state(self, jumped: bool) -> PlaybackState:
        """Where the replay is; `jumped`: what clients have of another time is old."""
        ended = not self.playing and self.position_ns >= (self._spec.end_ns or 0)
        paused = PlaybackStatus.Ended if ended else PlaybackStatus.Paused
        status = PlaybackStatus.Playing if self.playing else paused
        return PlaybackState(status, self.position_ns, self.speed, jumped, None)


class FoxgloveService:
    """One server: channels, and the newest message of each for whoever comes later."""

    def __init__(self, spec: FoxgloveSpec, link: ParentLink) -> None:
        """Begins to listen; RuntimeError, OSError: it cannot."""
        self._spec, self._link = spec, link
        self._context = foxglove.Context()
        self._clients = FoxgloveClients(spec, link)
        replayed = spec.begin_ns is not None and spec.end_ns is not None
        self._is_replay = replayed
        self._server = foxglove.start_server(
            name="vsense",
            host=f"[{spec.host}]" if ":" in spec.host else spec.host,
            port=spec.port,
            context=self._context,
            server_listener=self._clients,
            capabilities=[Capability.Time] if replayed else [],
            playback_time_range=(
                (spec.begin_ns or 0, spec.end_ns or 0) if replayed and spec.steered else None
            ),
            message_backlog_size=MESSAGE_BACKLOG,
        )
        self.port = self._server.port
        self._channels: dict[str, foxglove.Channel] = {}
        self._latest: dict[str, tuple[int, bytes]] = {}
        self._derive = Channels(spec.utc_shift_ns, self._is_wanted)
        self._wanted: frozenset[str] = frozenset()
        self._clock_ns = 0
        for topic in form.RUN_TOPICS:
            self._open(topic, *form.schema(topic, False))
        self._open_derived()

    def serve(self) -> None:
        """Serves until the parent ends."""
        while True:
            for message in self._link.messages(_WAIT_S):
                self._take(message)
            self._send_to_newcomers()
            wanted = self._sources()
            if wanted != self._wanted:
                self._wanted = wanted
                self._link.send("wants", sorted(wanted))

    def _take(self, message: Message) -> None:
        """Passes on a message of ours, and what follows from it."""
        topic, data = message.topic, message.data
        if topic == "/run" and self._is_replay:
            self._follow(data.get("replay") or {})
        if topic == "/fields":
            for field in data["fields"]:
                self._open(f"{FIELD_TOPIC}{field['id']}", *_derived(FIELD_TOPIC))
        channel = self._channels.get(topic)
        utc_ns = max(message.time_ns + self._spec.utc_shift_ns, 0)
        if channel is not None and (topic in LASTING or channel.has_sinks()):
            self._log(topic, utc_ns, form.encode(message, self._spec.utc_shift_ns))
        for derived in self._derive.convert(message):
            self._open(derived.topic, *_derived(derived.topic))
            self._log(derived.topic, utc_ns, form.encode_data(derived.data))
        if topic == "/experiment":
            for camera in data.get("cameras") or ():
                name = f"{PICTURE}{camera['id']}"
                self._open(name, *form.schema(name, True))
            self._open_derived()

    def _follow(self, replay: dict[str, Any]) -> None:
        """Tells clients where the replay is, and when it plays, pauses or jumps."""
        clients, begin_ns = self._clients, self._spec.begin_ns or 0
        position_ns = begin_ns + round(1e9 * float(replay.get("position_s", 0.0)))
        playing, speed = bool(replay.get("playing")), float(replay.get("speed", 1.0))
        ahead_s = (position_ns - self._clock_ns) / 1e9
        jumped = ahead_s < 0.0 or ahead_s > _JUMP_S * max(speed, 1.0)
        changed = (clients.playing, clients.speed) != (playing, speed)
        clients.playing, clients.speed, clients.position_ns = playing, speed, position_ns
        if jumped:
            self._derive.forget()
            self._latest.clear()
            if not self._spec.steered and self._clock_ns:
                self._server.clear_session()
        if self._spec.steered and (changed or jumped):
            self._server.broadcast_playback_state(clients.state(jumped))
        if position_ns != self._clock_ns:
            self._clock_ns = position_ns
            self._server.broadcast_time(position_ns)

    def _open(self, topic: str, schema: str, text: bytes) -> None:
        """Makes a channel where there is none yet."""
        if topic not in self._channels:
            kind = foxglove.Schema(name=schema, encoding="jsonschema", data=text)
            self._channels[topic] = foxglove.Channel(
                topic, schema=kind, message_encoding="json", context=self._context
            )

    def _open_derived(self) -> None:
        for topic in self._derive.topics():
            self._open(topic, *_derived(topic))

    def _log(self, topic: str, utc_ns: int, data: bytes) -> None:
        self._latest[topic] = utc_ns, data
        self._channels[topic].log(data, log_time=utc_ns)

    def _send_to_newcomers(self) -> None:
        """Repeats the newest message of channels that somebody has just subscribed to."""
        new = self._clients.take_new()
        for topic, (utc_ns, data) in self._latest.items():
            if new and self._channels[topic].id() in new:
                self._channels[topic].log(data, log_time=utc_ns)

    def _is_wanted(self, topic: str) -> bool:
        """Whether a derived topic is to be made: somebody subscribes to it, or it comes rarely."""
        channel = self._channels.get(topic)
        return not sources_of(topic) or (channel is not None and channel.has_sinks())

    def _sources(self) -> frozenset[str]:
        """The topics of ours that somebody needs now."""
        topics = set(LASTING)
        for topic, channel in self._channels.items():
            if channel.has_sinks():
                topics |= {topic, *sources_of(topic)}
        if not any(topic.startswith(FIELD_TOPIC) for topic in self._channels):
            topics.add("/fields")  # to know which there are
        return frozenset(topics)


def _derived(topic: str) -> tuple[str, bytes]:
    """Name and text of a derived topic's schema."""
    name = schema_of(topic)
    return name, _schemas.text(name)


def main() -> None:
    """Serves what the parent says."""
    link = ParentLink()

    def serve(spec: dict[str, Any]) -> None:
        service = FoxgloveService(FoxgloveSpec(**spec), link)
        link.send("ready", service.port)
        service.serve()

    link.serve(serve)


if __name__ == "__main__":
    main()
