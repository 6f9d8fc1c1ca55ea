"""Page, recordings and ports: refused before anything is made or started."""

from __future__ import annotations

import importlib.util
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import require_tool
from vsense import cli


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing lies in the present folder, and nothing comes into it."""
    require_tool("cc", "build-essential")
    monkeypatch.chdir(tmp_path)
    yield
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def taken() -> Iterator[str]:
    """A port that another program has."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield str(server.getsockname()[1])


@pytest.mark.parametrize("option", ["--web", "--port", "--legacy-port"])
def test_a_port_that_is_taken(option: str, taken: str, capsys) -> None:
    ports = {"--port": "0", option: taken}
    line = [word for pair in ports.items() for word in pair]
    assert cli.main(["lab", "pollutant", *line]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert f"port {taken} on 127.0.0.1" in said


def test_one_port_for_two(capsys) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
    assert cli.main(["lab", "pollutant", "--port", port, "--web", port]) == 2
    assert f"--web: {port} is a port for robots, too" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--record", "--record-images"])
def test_recordings_without_their_library(option: str, monkeypatch, capsys) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert cli.main(["lab", "pollutant", "--port", "0", option]) == 2
    assert "recordings need the Python package mcap" in capsys.readouterr().err
