"""`vsense run` rehearsed: emulated robots and their tracker in one process, the run in another."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from vsense.lab.microcontrollers import read_actuations

pytestmark = pytest.mark.system
VSENSE = (sys.executable, "-m", "vsense")


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def test_a_run_is_rehearsed_with_emulated_robots(tmp_path: Path) -> None:
    port, lines = free_port(), free_port()
    said = tmp_path / "said"
    command = [*VSENSE, "robot", "emulate", "2", "--insecure", "--port", str(port)]
    command += ["--radio", "31=-84,5.5", "--radio", "1843=-61,54,saves"]
    with said.open("w") as file:
        robots = subprocess.Popen(
            [*command, "--tracker-port", str(lines), "-o", str(tmp_path / "robots")],
            stderr=file,
            stdout=subprocess.DEVNULL,
        )
    try:
        link = [*VSENSE, "robot", "link", "31,1843", "--for", "1.5", "--json"]
        measured = subprocess.run(
            [*link, "--insecure", "--port", str(port)], capture_output=True, text=True, timeout=60
        )
        stood = read_actuations(tmp_path / "robots" / "actuations.bin")
        run = [*VSENSE, "run", "foraging", "--tracker", f"lines:{lines}", "--port", str(port)]
        run += ["--robots", "2", "--insecure", "--duration", "3", "--json", "--home"]
        done = subprocess.run(
            [*run, "-o", str(tmp_path / "run")], capture_output=True, text=True, timeout=60
        )
    finally:
        robots.send_signal(signal.SIGINT)
        assert robots.wait(20) == 130, said.read_text()
    check_links(measured, stood)
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


def check_links(measured: subprocess.CompletedProcess[str], stood: NDArray[np.void]) -> None:
    """The real daemons tell of the radios that they were given, and made steps without a move."""
    told = json.loads(measured.stdout)
    # How fast this machine is, is not the question.
    assert measured.returncode == int(not told["holds"]), measured.stderr
    weak, asleep = told["robots"]
    assert (weak["signal_dbm"], weak["bit_rate_mbit_s"], weak["power_saving"]) == (-84, 5.5, False)
    assert "-84 dBm is weak" in weak["advice"]
    assert (asleep["weakest_dbm"], asleep["retries"], asleep["power_saving"]) == (-61, 0, True)
    assert asleep["advice"] == "power saving is on: vsense robot deploy turns it off"
    for one in (weak, asleep):
        assert one["packets"] > 10 and one["round_trip_p50_ms"] > 0.0
        assert one["late"] is not None, "control steps were made"
    assert not stood["left_steps_s"].any() and not stood["right_steps_s"].any()


def test_more_robots_than_there_are(tmp_path: Path) -> None:
    command = [*VSENSE, "robot", "emulate", "99", "--insecure", "-o", str(tmp_path / "robots")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "vsense: 99 robots: foraging.argos has 15\n"
