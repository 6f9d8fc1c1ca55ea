"""`--foxglove` of the commands that have a control room: served, and over with the run."""

from __future__ import annotations

import re
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.floor import Floor, Program, experiment

pytestmark = pytest.mark.system

TAGS = [23, 24]
SERVED = r"Foxglove: ws://127\.0\.0\.1:(\d+);"


@pytest.fixture
def floor() -> Iterator[Floor]:
    made = Floor(TAGS)
    yield made
    made.close()


def serves(floor: Floor, program: Program) -> None:
    """Waits until it says where, and that somebody listens there."""
    floor.wait_for(lambda: program.heard(SERVED)() or program.ended, "where Foxglove is served")
    found = re.search(SERVED, program.said)
    assert found is not None, program.said
    socket.create_connection(("127.0.0.1", int(found[1])), 5.0).close()


@pytest.mark.paced
def test_a_lab_is_served(floor: Floor, tmp_path: Path) -> None:
    words = ["--foxglove", "0", "--port", "0", "--robots", "2", "--output", str(tmp_path / "run")]
    program = floor.program("lab", "phototaxis", "--duration", "1", *words)
    serves(floor, program)
    floor.wait_for(lambda: program.ended, "its end")
    assert program.process.returncode == 0 and "Traceback" not in program.said, program.said


@pytest.mark.paced
def test_a_run_is_served(floor: Floor, tmp_path: Path) -> None:
    file = experiment(tmp_path, "<framework>", TAGS, 60)
    words = ["--foxglove", "0", "--port", "0", "--output", str(tmp_path / "notes")]
    program = floor.program("run", str(file), "--tracker", "lines:0", *words)
    serves(floor, program)
    program.tell(signal.SIGINT)
    floor.wait_for(lambda: program.ended, "its end")
    assert program.process.returncode == 130 and "Traceback" not in program.said, program.said


@pytest.mark.quick
def test_one_port_for_two_is_refused_before_anything_begins(floor: Floor, tmp_path: Path) -> None:
    words = ["--foxglove", "4051", "--port", "4051", "--output", str(tmp_path / "run")]
    program = floor.program("lab", "phototaxis", *words)
    floor.wait_for(lambda: program.ended, "its end")
    assert program.process.returncode == 2 and "--foxglove: 4051 is a port" in program.said
    assert not (tmp_path / "run").exists()
