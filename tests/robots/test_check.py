"""`vsensed --check`: what is well, what is not, and how to mend it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.robots.rig import Rig
from vsense.modes.lab._microcontrollers import Microcontrollers

Check = Callable[..., tuple[int, dict[str, str]]]


@pytest.fixture
def idle(rigs: Callable[..., Rig]) -> Rig:
    """A host and a base without a daemon."""
    return rigs()


@pytest.fixture
def check(idle: Rig) -> Check:
    """Runs the check; gives its exit code and what it says of each thing."""

    def run(**changes: str) -> tuple[int, dict[str, str]]:
        daemon = idle.begin("--check", *idle.words(**changes))
        idle.wait_for(lambda: daemon.process.poll() is not None, "the end of the check", 60)
        lines = daemon.printed.splitlines()
        return daemon.process.returncode, {line.split()[0]: line[9:] for line in lines}

    return run


def test_all_is_well(idle: Rig, check: Check) -> None:
    status, said = check()
    assert list(said) == ["clock", "key", "uid", "scales", "network", "host", "base", "guard"]
    assert said["network"] == "ok   this board is 127.0.0.1 on the way to 127.0.0.1"
    assert said["host"] == f"ok   127.0.0.1 answers on port {idle.host.port}"
    assert said["base"] == f"ok   argos on {idle.device} answers, wheels at 0"
    assert status == (0 if said["clock"].startswith("ok") else 1)
    assert not idle.host.connected, "nobody's session is taken"


@pytest.mark.paced
@pytest.mark.parametrize("kind", ["gctronic", "exec", "wifi", "thymio"])
def test_a_robot_that_is_new_turns_a_little_and_back(rigs: Callable[..., Rig], kind: str) -> None:
    if kind == "thymio":
        pytest.importorskip("thymiodirect", reason="pip install vsense[thymio]")
    rig = rigs(kind=kind)
    daemon = rig.begin("--check", "--wiggle", *rig.words())
    rig.wait_for(lambda: daemon.process.poll() is not None, "the end of the check", 60)
    lines = [line for line in daemon.printed.splitlines() if line.startswith("wiggle")]
    assert lines and lines[0].startswith("wiggle   ok   left wheel -"), daemon.printed + daemon.said
    speeds = [(a.left_steps_s, a.right_steps_s) for a in rig.applied]
    turns = [next(iter(pair)) for pair in dict.fromkeys(speeds) if any(pair)]
    assert len(turns) == 2 and turns[0] < 0 < turns[1] == -turns[0] and speeds[-1] == (0, 0)


def test_the_boards_watchdog_is_looked_for_but_not_started(idle: Rig, check: Check) -> None:
    _, said = check(watchdog="/dev/null")
    assert said["watchdog"] == "ok   /dev/null is there; whether it is free a start tells"
    status, said = check(watchdog="/nowhere/watchdog")
    assert said["watchdog"].startswith("BAD  /nowhere/watchdog: errno 2; load")
    assert status == 1


def test_an_empty_battery_and_a_full_one(idle: Rig, check: Check) -> None:
    """The pin is 1 while the battery is good (see tests/firmware/test_fw_argos.py)."""
    for battery_mv, words in ((3300, "BAD  argos on"), (4000, "ok   argos on")):
        idle.link.program.state.body.inputs.battery_mv = battery_mv
        _, said = check()
        assert said["base"].startswith(words)
        assert ("its battery is low: charge it" in said["base"]) == (battery_mv == 3300)


def test_what_was_measured_is_shown(idle: Rig, tmp_path: Path, check: Check) -> None:
    _, said = check()
    assert said["scales"] == "ok   none: sensors and wheels count as nominal"
    file = tmp_path / "robot.conf"
    file.write_text("wheel-ratio = 1.004\nproximity-scale = 80:1500\n")
    _, said = check(config=str(file))
    assert said["scales"] == "ok   proximity-scale 80:1500; wheel-ratio 1.004"


def test_a_daemon_finds_the_base_after_a_check(idle: Rig, check: Check) -> None:
    check()
    idle.start()
    idle.run()


def test_nobody_listens(idle: Rig, check: Check) -> None:
    idle.host.silent = True
    idle.host.close()
    _, said = check()
    text = f"127.0.0.1 is there; no experiment runs on its port {idle.host.port} now"
    assert said["host"] == f"ok   {text}"


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("localhost", "BAD  host: expected a numeric IPv4 address, got 'localhost'"),
        ("255.255.255.255", "BAD  no way to 255.255.255.255: errno 13; join"),
    ],
)
def test_no_way_to_the_host(check: Check, address: str, words: str) -> None:
    status, said = check(host=address)
    assert status == 1
    assert said["network"].startswith(words)
    assert "host" not in said and said["base"].startswith("ok")


def test_a_base_that_is_not_there(check: Check) -> None:
    status, said = check(base="argos:/nowhere/ttyS0")
    assert status == 1
    assert said["base"].startswith("BAD  cannot open /nowhere/ttyS0: errno 2;")


I2C_DEV = Path("/sys/class/i2c-dev")


@pytest.mark.parametrize(
    ("base", "device", "words"),
    [
        (
            "pipuck",
            "/dev/i2c-12",
            "dtoverlay=pi-puck in /boot/config.txt"
            if I2C_DEV.exists()
            else "i2c-dev is not loaded: modprobe i2c-dev",
        ),
        ("overo-omap,rab=/dev/i2c-3", "/dev/ttyO0", "/dev/ttyS0 until Linux 2.6.36 (--base overo)"),
        ("asercom:/dev/rfcomm9", "/dev/rfcomm9", "rfcomm bind"),
    ],
)
def test_a_module_or_an_overlay_is_missing(
    check: Check, base: str, device: str, words: str
) -> None:
    status, said = check(base=base)
    assert status == 1
    text = f"BAD  cannot open {device}: errno 2; "
    assert said["base"].startswith(text) and words in said["base"]


def test_a_base_that_is_silent(check: Check) -> None:
    other = Microcontrollers(["argos"])
    try:
        status, said = check(base=f"argos:{other.devices[0]}")
    finally:
        other.close()
    assert status == 1
    assert "the base does not answer; is the robot switched on" in said["base"]


def test_a_robot_that_runs_is_left_alone(idle: Rig, check: Check) -> None:
    idle.start()
    idle.run()
    status, said = check()
    assert status == 1
    assert "another vsensed has it: end that one first" in said["base"]
    idle.wait_for(lambda: idle.moving, "motion")
