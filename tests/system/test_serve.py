"""`vsense camera serve` on a drawn recording, with a client of the original system."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.robots.link.arena_rig import ONE_SHOT, START, STOP, OldClient, Told
from tests.system.recording import TAGS, make_recording
from tests.vision.tracking.synthetic import HEIGHT_M
from vsense.robots.link.trackers.lines import ArenaListener

pytestmark = pytest.mark.system

PATIENCE_S = 60
TIMESTEPS = 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    make_recording(folder, TIMESTEPS)
    return folder


def start(recording: Path, command: str, *arguments: str, **streams: int) -> subprocess.Popen:
    """Starts a command on the recording."""
    files = [str(recording / "resources.xml"), str(recording / "experiment.xml")]
    words = [sys.executable, "-m", "vsense", command, *files, *arguments]
    return subprocess.Popen(words, text=True, **streams)


class Server:
    """A running `vsense camera serve`."""

    def __init__(self, recording: Path) -> None:
        self.process = start(recording, "serve", "--port", "0", stderr=subprocess.PIPE)
        self.told = Told()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.told.wait("serving arena states")
        self.port = int(re.findall(r"on 127\.0\.0\.1, port (\d+)", self.told.lines[0])[0])
        self.told.wait("only programs on this machine reach that address")

    def _read(self) -> None:
        for line in self.process.stderr or ():
            self.told(line)

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        return code


@pytest.fixture
def server(recording: Path) -> Iterator[Server]:
    made = Server(recording)
    yield made
    made.process.kill()
    made.process.wait()


def robots(text: str) -> dict[int, list[float]]:
    """Returns by tag the six numbers of a state."""
    tokens = text.split(" ")[1:]
    rows = [[float(token) for token in tokens[at : at + 7]] for at in range(0, len(tokens), 7)]
    return {int(row[0]): row[1:] for row in rows}


def test_every_run_plays_the_recording_from_its_beginning(server: Server) -> None:
    client = OldClient(server.port)
    for run in (1, 2):
        client.send(ONE_SHOT)
        first = client.read()
        assert first is not None and first.startswith("0 ")
        assert robots(first)[31][3] == pytest.approx(0.0, abs=0.002)
        client.send(START)
        texts = [client.read() or "" for _ in range(TIMESTEPS + 3)]
        client.send(STOP)
        server.told.wait("the run has ended", run)
        states = dict(text.split(" ", 1) for text in texts)
        assert list(states) == [str(timestep) for timestep in range(1, TIMESTEPS + 4)]
        # Beyond the recording's end, too, until the client stops.
        assert len({states[str(k)] for k in range(TIMESTEPS, TIMESTEPS + 4)}) == 1
        last = robots(texts[-1])
        u_px, v_px, theta_deg, x_m, y_m, yaw_deg = last[31]
        assert (x_m, y_m) == pytest.approx((0.05, 0.1), abs=0.002)
        assert (theta_deg, yaw_deg) == pytest.approx((0.0, 0.0), abs=1.0)
        scale = 1600.0 / (2.4 - HEIGHT_M)
        assert (u_px, v_px) == pytest.approx((239.5 + 0.05 * scale, 179.5 - 0.1 * scale), abs=1.5)
        assert last[1843][5] == pytest.approx(90.0, abs=1.0)
    client.close()
    assert server.end() == 130


def test_a_run_that_is_stopped_starts_again_and_ctrl_c_ends_it(server: Server) -> None:
    client = OldClient(server.port)
    client.send(START)
    assert client.timestep() == 1
    client.send(STOP)
    server.told.wait("the run has ended")
    client.send(ONE_SHOT)
    while (step := client.timestep()) != 0:
        assert step <= TIMESTEPS
    client.close()
    following = OldClient(server.port)
    following.send(START)
    assert following.timestep() == 1
    assert server.end() == 130
    while following.read():
        pass
    following.close()


@pytest.mark.quick
def test_a_port_in_use_is_one_clear_line(recording: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        arguments = ("--host", "127.0.0.1", "--port", port)
        process = start(recording, "serve", *arguments, stderr=subprocess.PIPE)
        said = process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == 1
    assert said.count("\n") == 1 and f"TCP port {port} on 127.0.0.1 is in use" in said


def test_track_piped_into_the_json_lines_link_is_a_source(recording: Path) -> None:
    told = Told()
    listener = ArenaListener("127.0.0.1", 0, TAGS, told)
    with socket.create_connection(("127.0.0.1", listener.port)) as pipe:
        process = start(recording, "track", stdout=pipe.fileno(), stderr=subprocess.DEVNULL)
    states = [listener.next(PATIENCE_S)[0]]
    while states[-1].timestep < TIMESTEPS - 1:
        states.append(listener.next(PATIENCE_S)[0])
    assert process.wait(PATIENCE_S) == 0
    x_m = [float(state.robots["x_m"][0]) for state in states]
    assert x_m == sorted(x_m) and x_m[-1] == pytest.approx(0.05, abs=0.002)
    assert listener.counters.bad_lines == 0
    listener.close()
