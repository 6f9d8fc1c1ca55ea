"""Foxglove's server, heard by a client of its protocol: to look only, and never in the way."""

from __future__ import annotations

import asyncio
import importlib.util
import io
import json
import os
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from tests.monitor.foxglove import sdk, told
from tests.monitor.foxglove.told import AT_NS
from tests.monitor.recording.conftest import picture, record
from vsense.base.clock import host_ns
from vsense.base.errors import UsageError, VsenseError
from vsense.base.message_bus import Message, MessageBus
from vsense.base.terminal import Console
from vsense.monitor.foxglove.channels import LASTING
from vsense.monitor.recording import form
from vsense.monitor.recording._player import Player
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ui._foxglove_server import FoxgloveServer, check_foxglove
from vsense.monitor.ui.access import FoxgloveAddress
from vsense.robots.link import network
from vsense.run.orders import Order, OrderKind

PROTOCOL = "foxglove.sdk.v1"
HERE = FoxgloveAddress("127.0.0.1", 0)
PATIENCE_S = 20.0


class Client:
    """A client of the protocol: subscribes to channels, and keeps what comes."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.subscribed: dict[int, str] = {}
        self.messages: list[tuple[str, int, Any]] = []
        self.states: list[tuple[int, int, float, bool]] = []
        self.times: list[int] = []
        self.statuses: list[str] = []

    async def subscribe(self, *topics: str) -> None:
        rows = []
        for topic in topics:
            await self.until(lambda topic=topic: topic in self.channels)
            number = len(self.subscribed) + 1
            self.subscribed[number] = topic
            rows.append({"id": number, "channelId": self.channels[topic]["id"]})
        await self.socket.send_json({"op": "subscribe", "subscriptions": rows})

    async def until(self, there: Callable[[], Any]) -> Any:
        """Hears until something is there."""
        end_s = time.monotonic() + PATIENCE_S
        while not (found := there()):
            assert time.monotonic() < end_s, "it never came"
            try:
                self._take(await self.socket.receive(0.5))
            except asyncio.TimeoutError:
                continue
        return found

    async def newest(self, topic: str) -> Any:
        """Waits for a message of a topic."""
        await self.until(lambda: any(one[0] == topic for one in self.messages))
        return [data for name, _, data in self.messages if name == topic][-1]

    def _take(self, frame: aiohttp.WSMessage) -> None:
        if frame.type == aiohttp.WSMsgType.TEXT:
            data = json.loads(frame.data)
            if data["op"] == "advertise":
                self.channels |= {one["topic"]: one for one in data["channels"]}
            elif data["op"] == "serverInfo":
                self.info = data
            elif data["op"] == "status":
                self.statuses.append(data["message"])
        elif frame.type == aiohttp.WSMsgType.BINARY:
            self._take_binary(frame.data)
        else:
            raise AssertionError(f"closed: {frame}")

    def _take_binary(self, data: bytes) -> None:
        if data[0] == 1:  # message data: subscription, log time, payload
            number, log_ns = struct.unpack_from("<IQ", data, 1)
            self.messages.append((self.subscribed[number], log_ns, json.loads(data[13:])))
        elif data[0] == 2:  # time
            self.times.append(*struct.unpack_from("<Q", data, 1))
        elif data[0] == 5:  # playback state: status, time, speed, did seek
            self.states.append(struct.unpack_from("<BQf?", data, 1))

    async def playback(self, playing: bool, seek_ns: int | None = None) -> None:
        """Asks for a replay's state: command, speed 1, seek, id of the request."""
        head = struct.pack("<BBf?Q", 3, not playing, 1.0, seek_ns is not None, seek_ns or 0)
        await self.socket.send_bytes(head + struct.pack("<I", 1) + b"7")


def look(port: int, talk: Callable[[Client], Any]) -> Client:
    """Connects and talks."""

    async def run() -> Client:
        url = f"ws://127.0.0.1:{port}"
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(url, protocols=[PROTOCOL]) as socket,
        ):
            assert socket.protocol == PROTOCOL
            client = Client(socket)
            await talk(client)
            return client

    return asyncio.run(run())


class Served:
    """A bus that is served, and what was said."""

    def __init__(self, stack: ExitStack, **options: Any) -> None:
        self.bus, self._said = MessageBus(), io.StringIO()
        self.server = FoxgloveServer(self.bus, HERE, Console(self._said), **options)
        self.server.start()
        self.lines = self._said.getvalue().splitlines()
        stack.callback(self.server.close)

    @property
    def said(self) -> list[str]:
        """What was said since it began."""
        return self._said.getvalue().splitlines()[len(self.lines) :]

    def tell(self, *topics: str) -> None:
        for message in told.everything():
            if message.topic in topics and self.bus.wants(message.topic):
                now = Message(message.topic, host_ns(), message.data, message.blob)
                self.bus.publish(now)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as held:
        yield held


def test_a_run_schema_by_schema(stack: ExitStack) -> None:
    served = Served(stack)
    assert served.lines == [
        f"Foxglove: ws://127.0.0.1:{served.server.port};"
        " its layout: vsense docs --path foxglove-layout.json"
    ]
    # Nobody looks: of what comes each timestep nothing is made.
    time.sleep(0.3)
    assert [t for t in ("/arena", "/picture/cam", "/robots") if served.bus.wants(t)] == []
    served.tell("/experiment", "/world", "/event")
    ours = ["/arena", "/signals", "/robots", "/picture/cam", "/fields"]

    async def talk(client: Client) -> None:
        def fields_are_known() -> bool:
            served.tell("/fields")
            return "/field/scent" in client.channels

        await client.until(fields_are_known)
        await client.subscribe(*client.channels)

        def all_came() -> bool:
            served.tell(*ours)
            return {one[0] for one in client.messages} >= client.channels.keys() - silent

        told_here = {message.topic for message in told.everything()}
        silent = {*form.RUN_TOPICS} - told_here
        await client.until(all_came)

    client = look(served.server.port, talk)
    assert client.info["capabilities"] == [], "to look only"
    for topic, _, data in client.messages:
        channel = client.channels[topic]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        kind = sdk.KINDS.get(channel["schemaName"])
        if kind is not None:
            data = {name: value for name, value in data.items() if name != "vsense"}
            assert sdk.make(kind, data).encode(), topic
    log_ns = next(log for topic, log, _ in client.messages if topic == "/arena")
    assert abs(log_ns - time.time_ns()) < 60e9, "times are UTC"
    assert served.said == []


def test_nothing_can_be_said_to_it(stack: ExitStack) -> None:
    served = Served(stack)

    async def talk(client: Client) -> None:
        channel = {"id": 1, "topic": "/world", "encoding": "json", "schemaName": ""}
        await client.socket.send_json({"op": "advertise", "channels": [channel]})
        await client.until(lambda: client.statuses)
        await client.playback(True)
        await client.until(lambda: len(client.statuses) > 1)

    client = look(served.server.port, talk)
    assert "clientPublish" in client.statuses[0] and "playback" in client.statuses[1]


def test_other_protocols_are_refused(stack: ExitStack) -> None:
    served = Served(stack)

    async def knock() -> int:
        url = f"ws://127.0.0.1:{served.server.port}"
        async with aiohttp.ClientSession() as session:
            with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
                await session.ws_connect(url, protocols=["chat"])
            return caught.value.status

    assert asyncio.run(knock()) == 400


def test_whoever_never_reads_is_in_nobodys_way(stack: ExitStack) -> None:
    served = Served(stack)
    served.tell("/experiment", "/world")
    noise = os.urandom(200_000).hex()

    async def talk(client: Client) -> None:
        await client.subscribe("/arena")
        await client.until(lambda: served.bus.wants("/arena"))
        for number in range(300):
            data = {**told.arena(), "noise": noise}
            served.bus.publish(Message("/arena", AT_NS + number, data))
        assert len(served.server._process._waiting) <= 1, "of a topic the newest waits"

    look(served.server.port, talk)

    async def comes_later(client: Client) -> None:
        await client.subscribe("/tf_static")
        await client.newest("/tf_static")

    look(served.server.port, comes_later)
    assert served.said == []


def test_its_end_is_told_and_the_run_goes_on(stack: ExitStack) -> None:
    served = Served(stack)
    served.server._process._process.kill()
    end_s = time.monotonic() + PATIENCE_S
    while not served.said and time.monotonic() < end_s:
        served.tell("/event")
        time.sleep(0.02)
    assert len(served.said) == 1 and "the run goes on" in served.said[0]
    assert not served.bus.wants("/event")
    served.server.close()
    assert served.server._process._process.poll() is not None


def test_what_lacks_is_said_before(stack: ExitStack, monkeypatch: pytest.MonkeyPatch) -> None:
    taken, port = network.listen("127.0.0.1", 0)
    stack.callback(taken.close)
    with pytest.raises(VsenseError, match=str(port)):
        check_foxglove(FoxgloveAddress("127.0.0.1", port))
    with pytest.raises(UsageError, match=r"4050 is a port for robots or the page.*4051"):
        check_foxglove(FoxgloveAddress("127.0.0.1", 4050), (4050, None, 8080))
    with pytest.raises(VsenseError):
        check_foxglove(FoxgloveAddress("no.such.host.invalid", 0))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"--foxglove needs the Python package foxglove: .*-sdk"):
        check_foxglove(HERE)
    check_foxglove(None)


def test_others_are_warned() -> None:
    assert HERE.warnings() == [] and FoxgloveAddress("::1", 1).warnings() == []
    assert "no tokens" in FoxgloveAddress("0.0.0.0", 8765).warnings()[0]


def steps_of(client: Client) -> list[int]:
    """The timesteps of the arena states that came."""
    return [data["timestep"] for topic, _, data in client.messages if topic == "/arena"]


@pytest.mark.paced
def test_a_replay_is_steered(stack: ExitStack, tmp_path: Path) -> None:
    begin_ns, step_ns = 5_000_000_000, 100_000_000
    first = [Message("/experiment", begin_ns, told.experiment())]
    steps = [
        Message("/arena", begin_ns + n * step_ns, {**told.arena(), "timestep": n})
        for n in range(50)
    ]
    file = record(tmp_path / "run.mcap", first + steps, [picture(0, "cam")])
    recording = stack.enter_context(open_recording(file))
    bus, said = MessageBus(), io.StringIO()
    player = Player(recording, bus)
    server = FoxgloveServer(bus, HERE, Console(said), recording=recording, give=player.give)
    server.start()
    stack.callback(server.close)
    player.start()
    stack.callback(player.close)
    player.give(Order(OrderKind.PLAY, "test", 1.0))
    utc_ns = recording.begin_ns + recording.utc_shift_ns

    async def talk(client: Client) -> None:
        await client.until(lambda: "/picture/cam" in client.channels)
        assert client.info["capabilities"] == ["time", "playbackControl"]
        there_ns = utc_ns + 30 * step_ns
        await client.playback(False, there_ns)
        await client.until(lambda: any(one[1] == there_ns and one[3] for one in client.states))
        # It stands still, and whoever begins to look is shown it none the less.
        await client.subscribe("/arena", "/tf", "/picture/cam")
        await client.newest("/picture/cam")
        assert (await client.newest("/arena"))["timestep"] == 30
        await client.newest("/tf")
        assert [log for topic, log, _ in client.messages if topic == "/tf"][-1] == there_ns
        await client.playback(False, utc_ns + 10 * step_ns)
        await client.until(lambda: steps_of(client)[-1] == 10)
        await client.playback(True)
        await client.until(lambda: steps_of(client)[-1] > 12)
        later = steps_of(client)
        later = later[later.index(10) :]
        assert later == sorted(later), "it plays forwards"
        assert client.times[-1] >= utc_ns + 10 * step_ns

    look(server.port, talk)
    assert len(said.getvalue().splitlines()) == 1 and server._wanted >= LASTING
