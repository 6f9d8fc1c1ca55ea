"""A lab that somebody attacks who hears every packet and forges any: keyed, and without keys."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.rigs.processes import Lab, free_port, order
from tests.system.attacker import Attacker, LoopbackAttacker
from vsense.base.clock import host_ns
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.monitor.recording.reader import open_recording

pytestmark = pytest.mark.system

ROBOTS = 4
ATTACK_S = 3.0
STOP_NS = 450_000_000


@pytest.fixture
def attacker() -> Iterator[LoopbackAttacker]:
    one = LoopbackAttacker(free_port())
    yield one
    one.close()


def start(folder: Path, attacker: Attacker, *more: str) -> Lab:
    """A lab whose robots run."""
    words = ["--port", str(attacker.port), "--robots", str(ROBOTS), "--duration", "30", "--hold"]
    lab = Lab(folder / "run", "pollutant", *words, *more)
    lab.wait_for("ready to start")
    order("start", lab)
    lab.wait_for("picture to sent")
    return lab


def rage(attacker: Attacker, seconds: float) -> None:
    """Everything at once, 20 times a second; from pauses of its own, as an attacker has them."""
    end_s, greetings = time.monotonic() + seconds, attacker.greet_again()
    sessions = [one for one in attacker.sessions.values() if one.state]
    while time.monotonic() < end_s:
        for one in sessions:
            for ahead in (1, 500, 10**6, 2**32):
                attacker.drive(one, ahead)
                attacker.deafen(one, ahead)
        attacker.replay(50)
        time.sleep(0.05)
    for sock in greetings:
        sock.close()


def longest_after(directory: Path, stopped_ns: int) -> int:
    """How long after a time any wheel was last told to turn [ns], 0: none was."""
    rows = read_actuations(directory / "actuations.bin")
    turning = rows[(rows["left_steps_s"] != 0) | (rows["right_steps_s"] != 0)]
    return max(int(turning["time_ns"].max()) - stopped_ns, 0) if len(turning) else 0


def test_with_keys_an_attack_changes_nothing(tmp_path: Path, attacker: Attacker) -> None:
    lab = start(tmp_path, attacker)
    rage(attacker, ATTACK_S)
    order("stop", lab, "--emergency")
    stopped_ns = host_ns()
    rage(attacker, ATTACK_S)
    lab.process.terminate()
    lab.end()
    said = "".join(lab.said)
    assert attacker.sent > 1000 and len(attacker.hellos) >= ROBOTS
    for word in ("LIFT", "obey", "reconnected", "new session", "lost", "heard", "renewed", "broke"):
        assert word not in said, said
    assert longest_after(lab.directory, stopped_ns) <= STOP_NS
    summary = json.loads((lab.directory / "run-1" / "summary.json").read_text())
    assert summary["link"]["reconnects"] == 0
    assert list(lab.directory.rglob("*.key")) == [], "its keys go with the lab"


def test_without_keys_the_host_says_what_happens(tmp_path: Path, attacker: Attacker) -> None:
    lab = start(tmp_path, attacker, "--insecure", "--record")
    lab.wait_for("robots without a key are taken")
    time.sleep(1.0)
    victim = next(one for one in attacker.sessions.values() if one.state and one.hello)
    ended = threading.Event()

    def drive() -> None:
        while not ended.wait(0.03):
            attacker.drive(victim, 200)

    driver = threading.Thread(target=drive)
    driver.start()
    try:
        order("stop", lab, "--emergency")
        lab.wait_for(r"ROBOT \S+ does NOT stop: LIFT IT \(told to stop .* s ago")
    finally:
        ended.set()
        driver.join()
    lab.wait_for("obeys again")
    lab.process.terminate()
    lab.end()
    with open_recording(next(lab.directory.rglob("*.mcap"))) as recording:
        told = [message.data for message in recording.messages({"/event"})]
    assert any("does NOT stop" in one["text"] and one["level"] == "trouble" for one in told)
