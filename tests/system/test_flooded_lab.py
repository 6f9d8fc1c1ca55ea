"""A lab whose ports are flooded by strangers: the page and the robots do not notice."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import aiohttp
import pytest

from tests.rigs.processes import Lab, order
from tests.rigs.web import HALF, is_closed, talk
from vsense.monitor.ui import _web_listener
from vsense.robots.link._links import HELLO_NS, UNGREETED_MAX

pytestmark = pytest.mark.system

CROWD = 1000
TOKENS = "look=look-only-token\ncontrol=control-it-token\n"
LIMIT_S = max(_web_listener.REQUEST_S, _web_listener.KEEP_ALIVE_S, HELLO_NS / 1e9) + 5.0
DESCRIPTORS = 1024


@pytest.fixture
def room() -> Iterator[None]:
    """Room for the crowd's own sockets."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 4 * CROWD:
        pytest.skip(f"only {hard} descriptors here")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 4 * CROWD), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def start(folder: Path, tmp_path: Path) -> Lab:
    """A lab with a page that needs tokens, and with a usual limit of descriptors."""
    tokens = tmp_path / "tokens"
    tokens.touch(mode=0o600)
    tokens.write_text(TOKENS)
    words = ["--port", "0", "--robots", "2", "--duration", "600", "--hold", "--web", "0"]
    lab = Lab(folder, "pollutant", *words, "--web-tokens", str(tokens), "--record")
    lab.wait_for("ready to start")
    limit = (DESCRIPTORS, DESCRIPTORS)
    resource.prlimit(lab.process.pid, resource.RLIMIT_NOFILE, limit)
    return lab


def flood(port: int, sent: list[bytes]) -> list[socket.socket]:
    """A thousand connections that are not closed."""
    crowd = []
    for number in range(CROWD):
        crowd.append(socket.create_connection(("127.0.0.1", port), 10.0))
        if data := sent[number % len(sent)]:
            crowd[-1].sendall(data)
    return crowd


def descriptors(lab: Lab) -> int:
    return len(os.listdir(f"/proc/{lab.process.pid}/fd"))


def robots_port(lab: Lab) -> int:
    """Where the lab's robots connect to, by the script that starts one."""
    script = next((lab.directory / "robots").glob("*.sh")).read_text()
    return int(re.findall(r"--port'? '?(\d+)", script)[0])


def test_strangers_on_two_ports_cost_nobody_anything(tmp_path: Path, room: None) -> None:
    lab = start(tmp_path / "run", tmp_path)
    url = re.findall(r"http://\S+", lab.wait_for("control room: "))[0]
    base = url.partition("/?")[0]
    web = int(base.rpartition(":")[2])
    order("start", lab)
    lab.wait_for("picture to sent")
    before, said = descriptors(lab), len(lab.said)
    kept = f"GET /?token=look-only-token HTTP/1.1\r\nHost: 127.0.0.1:{web}\r\n\r\n".encode()
    begun_s = time.monotonic()
    crowd = flood(web, [b"", HALF, kept])
    crowd += flood(robots_port(lab), [b"", b"VS\3", bytes(40)])
    most = UNGREETED_MAX + _web_listener.UNVOUCHED_MAX + _web_listener.VOUCHED_MAX
    assert descriptors(lab) <= before + most

    tag = int(next((lab.directory / "robots").glob("*.sh")).stem)
    os.kill(lab.daemon(tag), signal.SIGKILL)
    told = lab.wait_for("was killed by SIGKILL .*the experiment goes on")
    again = subprocess.Popen(["sh", told.split("start it again with ")[1].strip()])
    try:
        lab.wait_for(rf"robot {tag}: .*connect")
        with urllib.request.urlopen(url, timeout=10.0) as answer:
            assert answer.status == 200

        async def stop(client: aiohttp.ClientSession) -> bool:
            headers = {"Cookie": f"vsense_{web}=control-it-token", "Origin": base}
            page = await client.ws_connect(f"{base}/ws", headers=headers, max_msg_size=0)
            await page.send_json({"order": "emergency"})
            while True:
                told = await page.receive()
                if told.type is aiohttp.WSMsgType.TEXT and '"/answer"' in told.data:
                    return bool(json.loads(told.data)[2]["ok"])

        assert talk(stop)
        lab.wait_for("EMERGENCY STOP")
        while not all(map(is_closed, crowd)):
            assert time.monotonic() - begun_s < LIMIT_S + 30.0
            time.sleep(0.1)
    finally:
        for sock in crowd:
            sock.close()
        again.terminate()
        again.wait()
        lab.process.terminate()
    lab.end()
    lines = "".join(lab.said)
    about = [line for line in lab.said[said:] if re.search(r"127\.0\.0\.1", line)]
    assert 2 <= len(about) < 20, lines
    assert "Traceback" not in lines and "Too many open files" not in lines
    assert "more from 127.0.0.1 in the last 10 s" in lines
