"""`vsense run` rehearsed: emulated robots and their tracker in one process, the run in another."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.system
VSENSE = (sys.executable, "-m", "vsense")


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def test_a_run_is_rehearsed_with_emulated_robots(tmp_path: Path) -> None:
    port, lines = free_port(), free_port()
    said = tmp_path / "said"
    command = [*VSENSE, "robot", "emulate", "2", "--insecure", "--port", str(port)]
    with said.open("w") as file:
        robots = subprocess.Popen(
            [*command, "--tracker-port", str(lines), "-o", str(tmp_path / "robots")],
            stderr=file,
            stdout=subprocess.DEVNULL,
        )
    try:
        run = [*VSENSE, "run", "foraging", "--tracker", f"lines:{lines}", "--port", str(port)]
        run += ["--robots", "2", "--insecure", "--duration", "3", "--json", "--home"]
        done = subprocess.run(
            [*run, "-o", str(tmp_path / "run")], capture_output=True, text=True, timeout=60
        )
    finally:
        robots.send_signal(signal.SIGINT)
        assert robots.wait(20) == 130, said.read_text()
    assert done.returncode == 0, done.stderr
    assert "2 of 2 robots stand at their starts after" in done.stderr
    summary = json.loads(done.stdout)
    assert summary["arena"]["seen_mean"] == 2.0
    assert [robot["connected_share"] for robot in summary["per_robot"]] == [1.0, 1.0]
    text = said.read_text()
    command_told = re.search(r"in another terminal: (vsense run .*)", text)
    assert command_told is not None
    assert command_told[1] == (
        f"vsense run foraging --tracker lines:{lines} --port {port} --robots 2 --insecure"
    )
    assert (tmp_path / "robots" / "actuations.bin").stat().st_size > 0, "wheels were moved"
    scripts = sorted((tmp_path / "robots" / "robots").glob("*.sh"))
    tags = [script.stem for script in scripts]
    alive = subprocess.run(["pgrep", "-f", str(tmp_path)], capture_output=True, text=True).stdout
    assert len(tags) == 2 and alive == "", "no daemon is left"


def test_more_robots_than_there_are(tmp_path: Path) -> None:
    command = [*VSENSE, "robot", "emulate", "99", "--insecure", "-o", str(tmp_path / "robots")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "vsense: 99 robots: foraging.argos has 15\n"
