"""The server with real sockets: who may come in, what waits for a slow page, what is silent."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import re
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from tests.monitor.ui.conftest import Serve
from tests.monitor.ui.puppet import Puppet
from tests.rigs.web import TOKENS, hear, talk, ws
from vsense.base.errors import UsageError, VsenseError
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.ui import _sentences
from vsense.monitor.ui import _server as site
from vsense.monitor.ui._page_clients import LOOKING, Frames, WebClients
from vsense.monitor.ui._server import WebServer
from vsense.run.changes import ResultCallback
from vsense.run.changing import Change
from vsense.run.orders import Order, OrderError, OrderKind

PAGE = Path(site.__file__).parent / "page"


async def ready(condition: Callable[[], bool]) -> None:
    """Waits until something that other threads do has happened."""
    while not condition():
        await asyncio.sleep(0.005)


def status(url: str, **headers: str) -> tuple[int, str]:
    async def ask(client: aiohttp.ClientSession) -> tuple[int, str]:
        async with client.get(url, headers=headers) as answer:
            return answer.status, await answer.text()

    found: tuple[int, str] = talk(ask)
    return found


def refused(url: str, **options: Any) -> int:
    async def ask(client: aiohttp.ClientSession) -> int:
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            await ws(client, url, **options)
        return caught.value.status

    found: int = talk(ask)
    return found


# -- who may come in ------------------------------------------------------------------------


def test_on_this_machine_no_token_is_needed(served: Serve) -> None:
    _, _, url = served(paced=False)
    assert "token" not in url
    code, text = status(url)
    assert code == 200 and "<title>vsense</title>" in text


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""])
def test_a_foreign_name_that_leads_here_is_refused(served: Serve, host: str) -> None:
    _, _, url = served(paced=False)
    code, text = status(url, Host=host)
    assert code == 403 and "open it by the address" in text
    assert refused(url, headers={"Host": host}, origin=f"http://{host}") == 403


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:99", "127.9.9.9", "[::1]:7"])
def test_this_machine_has_several_names(served: Serve, host: str) -> None:
    _, _, url = served(paced=False)
    assert status(url, Host=host)[0] == 200


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "http://127.0.0.1:1", "file://", "http://[", None],
)
def test_a_page_from_elsewhere_is_refused(served: Serve, origin: str | None) -> None:
    puppet, _, url = served(paced=False)
    assert refused(url, origin=origin) == 403
    assert puppet.bus.joined <= 1


def test_a_foreign_page_cannot_even_get(served: Serve) -> None:
    _, _, url = served(paced=False)
    assert status(url, Origin="http://evil.example")[0] == 403


def test_what_every_answer_tells_the_browser(served: Serve) -> None:
    _, _, url = served(paced=False)

    async def ask(client: aiohttp.ClientSession) -> None:
        for path in ("", "main.js", "nothing"):
            async with client.get(url + path) as answer:
                assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
                assert answer.headers["X-Content-Type-Options"] == "nosniff"

    talk(ask)


@pytest.mark.parametrize("path", ["nothing.js", "..%2fserver.py", "%2e%2e/site.py", "index.html"])
def test_only_the_pages_files_are_served(served: Serve, path: str) -> None:
    _, _, url = served(paced=False)
    assert status(url + path)[0] == 404


@pytest.mark.parametrize("token", ["", "wrong", "to-look-onl", "ä€", "%ff"])
def test_a_wrong_token_is_refused_clearly(served: Serve, token: str) -> None:
    _, _, url = served(tokens=TOKENS, paced=False)
    base = url.split("?")[0]
    code, text = status(f"{base}?token={token}")
    assert code == 403 and "This token is not the right one" in text
    assert status(base)[0] == 403
    assert refused(base) == 403
    assert TOKENS.look not in text and TOKENS.control not in text


def test_a_token_becomes_a_cookie_that_scripts_cannot_read(served: Serve) -> None:
    _, server, url = served(tokens=TOKENS, paced=False)

    async def ask(client: aiohttp.ClientSession) -> str:
        async with client.get(url) as answer:
            assert answer.status == 200
            return answer.headers["Set-Cookie"]

    cookie = talk(ask)
    assert cookie.startswith(f"vsense_{server.port}={TOKENS.control}")
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    headers = {"Cookie": f"vsense_{server.port}={TOKENS.look}"}

    async def look(client: aiohttp.ClientSession) -> bool:
        socket = await ws(client, url, headers=headers)
        return bool((await hear(socket, "/you"))["control"])

    assert talk(look) is False


def test_a_looker_gives_no_orders(served: Serve) -> None:
    puppet, server, url = served(tokens=TOKENS, paced=False)
    headers = {"Cookie": f"vsense_{server.port}={TOKENS.look}"}

    async def press(client: aiohttp.ClientSession) -> Any:
        socket = await ws(client, url, headers=headers)
        await socket.send_json({"order": "start", "value": 0})
        return await hear(socket, "/answer")

    answer = talk(press)
    assert answer["ok"] is False and "looking only" in answer["text"]
    assert puppet.orders == []


def test_other_machines_always_need_tokens() -> None:
    server = WebServer(MessageBus(), lambda order: "", "0.0.0.0", 0)
    try:
        addresses = server.start()
        assert server.tokens is not None
        assert addresses.look.endswith(f"?token={server.tokens.look}")
        assert addresses.control.endswith(f"?token={server.tokens.control}")
        local = f"http://127.0.0.1:{server.port}/"
        assert status(local)[0] == 403
        assert status(local + f"?token={server.tokens.look}")[0] == 200
        assert status(local, Host="evil.example")[0] == 403
    finally:
        server.close()


# -- orders ---------------------------------------------------------------------------------


def test_two_people_press_start_and_the_second_is_told(served: Serve) -> None:
    puppet, _, url = served(paced=False)

    async def press(client: aiohttp.ClientSession) -> list[Any]:
        answers = []
        for _ in range(2):
            socket = await ws(client, url)
            await socket.send_json({"order": "start", "value": 0})
            answers.append(await hear(socket, "/answer"))
        return answers

    assert talk(press) == [
        {"text": "run 1 is running", "ok": True},
        {"text": "cannot start: the run is running", "ok": False},
    ]
    assert [order.by for order in puppet.orders] == ["viewer 1 (127.0.0.1)", "viewer 2 (127.0.0.1)"]


def test_everything_that_a_page_may_say_is_carried_out() -> None:
    clients = WebClients(MessageBus(), lambda order: "")
    assert clients._does.keys() == _sentences._READERS.keys()


@pytest.mark.parametrize(
    "sentence",
    [
        "", "{", "[]", "1", "null", '"start"', "{}", '{"order": "fly"}', '{"order": null}',
        '{"order": ["start"]}', '{"order": "seek", "value": "1"}',
        '{"order": "seek", "value": NaN}',
        '{"order": "seek", "value": 1e999}', '{"order": "seek", "value": true}', '{"look": "x"}',
        '{"look": -1}', '{"look": 1.5}', '{"refresh": 1}', '{"pictures": "cam1"}',
        '{"pictures": [1]}', '{"got": -1}', '{"got": "x"}', "[" * 5000,
        json.dumps({"pictures": ["x"] * 1000}), json.dumps({"pictures": ["x" * 1000]}),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_answered_and_the_page_stays(served: Serve, sentence: str) -> None:
    puppet, _, url = served(paced=False)

    async def say(client: aiohttp.ClientSession) -> None:
        socket = await ws(client, url)
        await socket.send_str(sentence)
        assert (await hear(socket, "/answer"))["ok"] is False
        await socket.send_bytes(b"\0\1")
        assert (await hear(socket, "/answer"))["ok"] is False
        await socket.send_json({"order": "start"})
        assert (await hear(socket, "/answer"))["ok"] is True

    talk(say)
    assert [order.kind for order in puppet.orders] == [OrderKind.START]


def test_an_order_error_is_the_answer() -> None:
    def give(order: Order) -> str:
        raise OrderError("not now")

    server = WebServer(MessageBus(), give, "127.0.0.1", 0)
    url = server.start().control

    async def press(client: aiohttp.ClientSession) -> Any:
        socket = await ws(client, url)
        await socket.send_json({"order": "emergency", "value": 1})
        return await hear(socket, "/answer")

    try:
        assert talk(press) == {"text": "not now", "ok": False}
    finally:
        server.close()


NOISE = {"kind": "set", "controller": "ant", "name": "light", "setting": "noise_level", "value": 1}


def test_changes_are_asked_for_by_those_who_may_control_only() -> None:
    asked: list[tuple[Change, str]] = []

    def ask(change: Change, by: str, answer: ResultCallback) -> None:
        if change.value == 2:
            raise OrderError("this run is locked")
        asked.append((change, by))
        threading.Thread(target=lambda: answer("done", True)).start()

    server = WebServer(MessageBus(), lambda order: "", "127.0.0.1", 0, TOKENS, ask=ask)
    found = server.start()

    async def say(client: aiohttp.ClientSession, url: str, said: object) -> Any:
        base, _, token = url.partition("/?")
        socket = await client.ws_connect(f"{base}/ws?{token}", headers={"Origin": base})
        await socket.send_json({"change": said})
        return await hear(socket, "/answer")

    def told(url: str, said: object) -> Any:
        return talk(lambda client: say(client, url, said))

    try:
        assert told(found.look, NOISE) == {"text": LOOKING, "ok": False, "change": True}
        assert asked == []
        assert told(found.control, NOISE) == {"text": "done", "ok": True, "change": True}
        assert told(found.control, {**NOISE, "value": 2})["text"] == "this run is locked"
        malformed: list[Any] = [
            {**NOISE, "value": float("nan")}, {**NOISE, "value": 1e12},
            {**NOISE, "value": "x" * 201}, "move", [[[[]]]],
        ]  # fmt: skip
        for said in malformed:
            answer = told(found.control, said)
            # As an order's it would confirm one that has no answer yet: an emergency stop.
            assert answer == {"text": answer["text"], "ok": False, "change": True}
    finally:
        server.close()
    ((change, by),) = asked
    assert change == Change.read(NOISE) and by.startswith("viewer 2 (127.0.0.1")


def test_where_no_world_runs_nothing_can_be_changed() -> None:
    server = WebServer(MessageBus(), lambda order: "", "127.0.0.1", 0)
    url = server.start().control

    async def say(client: aiohttp.ClientSession) -> Any:
        socket = await ws(client, url)
        await socket.send_json({"change": NOISE})
        return await hear(socket, "/answer")

    try:
        assert talk(say)["text"] == "nothing can be changed here: no world is running"
    finally:
        server.close()


# -- news -----------------------------------------------------------------------------------


def test_nobody_watching_costs_nothing(served: Serve) -> None:
    puppet, _, url = served(paced=False)
    topics = [
        "/experiment",
        "/run",
        "/arena",
        "/robots",
        "/picture/cam0",
        "/readings",
        "/readings/1",
    ]
    assert not any(puppet.bus.wants(topic) for topic in topics)

    async def come_and_go(client: aiohttp.ClientSession) -> None:
        socket = await ws(client, url)
        await hear(socket, "/you")
        assert puppet.bus.wants("/arena")
        assert not puppet.bus.wants("/picture/cam0") and not puppet.bus.wants("/readings/1")
        await socket.send_json({"look": 1})
        await socket.send_json({"pictures": ["cam0"]})
        await ready(lambda: puppet.bus.wants("/picture/cam0"))
        assert puppet.bus.wants("/readings/1") and not puppet.bus.wants("/readings/2")
        await socket.send_json({"refresh": False})
        await ready(lambda: not puppet.bus.wants("/arena"))
        assert not puppet.bus.wants("/picture/cam0") and not puppet.bus.wants("/readings/1")
        assert puppet.bus.wants("/run") and puppet.bus.wants("/event")
        joined = puppet.bus.joined
        await socket.send_json({"refresh": True})
        await ready(lambda: puppet.bus.joined > joined)
        assert puppet.bus.wants("/picture/cam0") and puppet.bus.wants("/readings/1")
        await socket.close()
        await ready(lambda: not puppet.bus.wants("/arena"))

    talk(come_and_go)
    assert not any(puppet.bus.wants(topic) for topic in topics)


def test_a_newcomer_gets_everything_and_the_last_events(served: Serve) -> None:
    puppet, _, url = served(paced=False)
    puppet.say("before anybody came")

    async def come(client: aiohttp.ClientSession) -> None:
        socket = await ws(client, url)
        assert (await hear(socket, "/event"))["text"] == "before anybody came"
        puppet.step()
        found = set()
        while not found >= {"/experiment", "/world", "/run", "/arena", "/signals", "/robots"}:
            found.add(json.loads(await socket.receive_str())[0])

    talk(come)


def test_pictures_come_as_bytes_with_a_head(served: Serve) -> None:
    puppet, _, url = served(paced=False)
    blob = bytes(range(256)) * 100

    async def come(client: aiohttp.ClientSession) -> bytes:
        socket = await ws(client, url)
        await socket.send_json({"pictures": ["cam ä"]})
        await ready(lambda: puppet.bus.wants("/picture/cam ä"))
        puppet.bus.publish(Message("/picture/cam ä", 7, {"camera": "cam ä"}, blob))
        while True:
            message = await socket.receive()
            if message.type is aiohttp.WSMsgType.BINARY:
                return bytes(message.data)

    frame = talk(come)
    length = int.from_bytes(frame[:4], "big")
    assert json.loads(frame[4 : 4 + length]) == ["/picture/cam ä", 7, {"camera": "cam ä"}]
    assert frame[4 + length :] == blob


def test_numbers_that_json_does_not_have_become_null(served: Serve) -> None:
    puppet, _, url = served(paced=False)

    async def come(client: aiohttp.ClientSession) -> Any:
        socket = await ws(client, url)
        await hear(socket, "/you")
        nan = float("nan")
        puppet.bus.publish(Message("/arena", 1, {"a": [nan, 1.5, (nan,)], "b": {"c": -1e999}}))
        return await hear(socket, "/arena")

    assert talk(come) == {"a": [None, 1.5, [None]], "b": {"c": None}}


def test_a_page_that_tells_what_it_got_is_never_far_behind(served: Serve) -> None:
    """Thousands of messages while the page sleeps: it then gets a few old ones and the newest."""
    puppet, _, url = served(paced=False)
    filling = "x" * 1000

    async def sleep(client: aiohttp.ClientSession) -> list[int]:
        socket = await ws(client, url)
        await socket.send_json({"got": 0})
        await socket.send_json({"look": 1})
        await ready(lambda: puppet.bus.wants("/readings/1"))
        for number in range(5000):
            puppet.bus.publish(Message("/arena", number, {"n": number, "f": filling}))
            if number % 50 == 0:
                await asyncio.sleep(0)
        puppet.bus.publish(Message("/run", 0, {"last": True}))
        numbers, frames = [], 0
        while True:
            told = json.loads(await socket.receive_str())
            frames += 1
            await socket.send_json({"got": frames})
            if told[0] == "/arena":
                numbers.append(told[2]["n"])
                if numbers[-1] == 4999:
                    return numbers

    numbers = talk(sleep)
    assert numbers == sorted(set(numbers))
    assert len(numbers) <= 60


def test_a_page_that_reads_nothing_holds_nobody_up(served: Serve) -> None:
    """20 000 messages of 50 kB pass a page that sleeps: neither memory nor time grows with them."""
    puppet, _, url = served(paced=False)
    big = {"f": "x" * 50_000}

    async def sleep(client: aiohttp.ClientSession) -> None:
        lazy = await ws(client, url)
        lazy._conn.transport.pause_reading()  # type: ignore[union-attr]
        await ready(lambda: puppet.bus.wants("/arena"))
        for number in range(20_000):
            puppet.bus.publish(Message("/arena", number, big))
            puppet.bus.publish(Message("/event", number, {"text": str(number), "by": None}))
        other = await ws(client, url)
        await other.send_json({"order": "start"})
        assert (await hear(other, "/answer"))["ok"]

    talk(sleep)
    assert puppet.state == "running"


def test_events_wait_in_a_line(served: Serve) -> None:
    puppet, _, url = served(paced=False)

    async def come(client: aiohttp.ClientSession) -> list[str]:
        socket = await ws(client, url)
        await hear(socket, "/you")
        for number in range(100):
            puppet.say(str(number))
        return [(await hear(socket, "/event"))["text"] for _ in range(100)]

    assert talk(come) == [str(number) for number in range(100)]


def test_everybody_learns_how_many_look(served: Serve) -> None:
    _, _, url = served(paced=False)

    async def come(client: aiohttp.ClientSession) -> list[Any]:
        first = await ws(client, url)
        told = [await hear(first, "/you")]
        second = await ws(client, url)
        told.append(await hear(first, "/you"))
        await second.close()
        return [*told, await hear(first, "/you")]

    assert [you["viewers"] for you in talk(come)] == [1, 2, 1]


def test_pages_that_vanish_are_silent(
    served: Serve, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """Connections cut in the middle of a picture, a handshake and a sentence."""
    puppet, server, url = served()
    base = url.rstrip("/")
    head = (
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nOrigin: {base}\r\n"
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    ).encode()
    ends = (head[:50], head, head + b"\x81\xfe\x00", head + b"\xff" * 20, b"\0\xff\r\n\r\n")
    with caplog.at_level(logging.WARNING):
        for sent in ends * 4:
            with socket.create_connection(("127.0.0.1", server.port)) as raw:
                raw.sendall(sent)
                if sent == head:
                    raw.recv(2000)
        joined = puppet.bus.joined

        async def after(client: aiohttp.ClientSession) -> None:
            other = await ws(client, url)
            await hear(other, "/arena")
            await ready(lambda: len(puppet.bus._listeners) == 2)

        talk(after)
    assert joined >= 1
    assert caplog.records == []
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_a_page_that_cannot_be_sent_to_is_closed_and_told(
    served: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would look alive, and never change."""
    puppet, _, url = served()
    events: list[Message] = []
    puppet.bus.join(events.append, lambda topic: topic == "/event")

    def failing(frames: object, message: Message) -> str:
        raise KeyError(message.topic)

    async def looking(client: aiohttp.ClientSession) -> None:
        page = await ws(client, url)
        await hear(page, "/arena")
        with monkeypatch.context() as patched:
            patched.setattr(Frames, "frame", failing)
            while not page.closed:
                await page.receive()
        await hear(await ws(client, url), "/arena")
        await ready(lambda: any("KeyError in" in str(event.data) for event in events))

    talk(looking)


def test_too_many_pages_are_told(served: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(site, "VIEWERS_MAX", 2)
    _, _, url = served(paced=False)

    async def come(client: aiohttp.ClientSession) -> int:
        opened = [await ws(client, url) for _ in range(2)]
        for one in opened:
            await hear(one, "/you")
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            await ws(client, url)
        return caught.value.status

    assert talk(come) == 503


# -- beginning and end ----------------------------------------------------------------------


def test_a_busy_port_is_one_clear_line(served: Serve) -> None:
    _, server, _ = served(paced=False)
    with pytest.raises(VsenseError) as caught:
        WebServer(MessageBus(), lambda order: "", "127.0.0.1", server.port).start()
    begins = f"web page: TCP port {server.port} on 127.0.0.1 is in use: process {os.getpid()} ("
    words = str(caught.value)
    assert words.startswith(begins)
    assert words.endswith(") runs there; stop it or choose another port") and "\n" not in words


@pytest.mark.parametrize(("host", "words"), [("192.0.2.7", "address"), ("no host!", "listen")])
def test_an_address_that_is_not_ours_is_one_clear_line(host: str, words: str) -> None:
    with pytest.raises(VsenseError, match=words):
        WebServer(MessageBus(), lambda order: "", host, 0).start()


@pytest.mark.parametrize("port", [-1, 65536])
def test_a_port_that_is_none(port: int) -> None:
    with pytest.raises(UsageError, match="0 to 65535"):
        WebServer(MessageBus(), lambda order: "", "127.0.0.1", port)


def test_close_sends_pages_away_and_frees_the_port(served: Serve) -> None:
    puppet, server, url = served()

    async def come(client: aiohttp.ClientSession) -> aiohttp.WSMsgType:
        socket = await ws(client, url)
        await hear(socket, "/arena")
        await asyncio.get_running_loop().run_in_executor(None, server.close)
        while True:
            message = await socket.receive()
            if message.type is not aiohttp.WSMsgType.TEXT:
                return message.type

    assert talk(come) in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
    server.close()
    assert not puppet.bus.wants("/arena") and not puppet.bus.wants("/event")
    assert "web" not in [thread.name for thread in threading.enumerate()]
    again = WebServer(puppet.bus, puppet.give, "127.0.0.1", server.port)
    again.start()
    again.close()


def test_close_without_start_is_fine() -> None:
    WebServer(MessageBus(), lambda order: "", "127.0.0.1", 0).close()


def test_the_run_goes_on_when_the_server_ends() -> None:
    puppet = Puppet()
    server = WebServer(puppet.bus, puppet.give, "127.0.0.1", 0)
    server.start()
    server.close()
    puppet.step()
    puppet.say("still here")


# -- the page's files -----------------------------------------------------------------------


def test_the_pages_files_are_one_idea_each() -> None:
    scripts = sorted(PAGE.glob("*.js"))
    assert len(scripts) > 10
    for path in scripts:
        assert len(path.read_text().splitlines()) <= 300, path.name


def test_nothing_is_loaded_from_elsewhere() -> None:
    for path in PAGE.iterdir():
        found = re.findall(r"https?://[^\s\"')]+", path.read_text())
        assert set(found) <= {"http://www.w3.org/2000/svg"}, path.name
        assert "innerHTML" not in path.read_text(), path.name


def test_every_module_that_is_imported_is_there() -> None:
    for path in PAGE.glob("*.js"):
        for name in re.findall(r'from "\./([^"]+)"', path.read_text()):
            assert (PAGE / name).is_file(), f"{path.name} imports {name}"
