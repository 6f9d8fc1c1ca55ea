"""The real daemon on every kind of base: it drives, stops, and lives through what goes wrong."""

from __future__ import annotations

import math
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

from tests.robots.conftest import QUICKLY, ROOT, Builder
from tests.robots.rig import (
    CLEAN,
    MS,
    POLLUTED,
    TAG,
    BareRobot,
    Host,
    Rig,
    live_until,
    own_of,
)
from tests.robots.stopping import SILENCE_NS, still_within
from vsense.base.clock import host_ns
from vsense.base.native import ffi, lib
from vsense.modes.lab._air import Air
from vsense.modes.lab.hardware import BASE_KINDS
from vsense.robots.link.wire import Wanted
from vsense.run.remote import REMOTE_TABLE

RING = 0xFF
"""For a second and third daemon: the sanitizers see the same code in the first one."""

ON_I2C = ("gctronic", "york")
Rigs = Callable[..., Rig]


@pytest.fixture(params=BASE_KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    """Every kind of base."""
    found: str = request.param
    return found


def native(test: Callable[..., None]) -> Callable[..., None]:
    """Of bases that open their device themselves."""
    return pytest.mark.parametrize("kind", [k for k in BASE_KINDS if k not in ("exec", "wifi")])(
        test
    )


@pytest.fixture
def rig(rigs: Rigs, kind: str) -> Rig:
    """A rig with a daemon that was just started, on any kind of base."""
    one = rigs(kind=kind)
    one.start()
    return one


def test_it_drives_cleans_and_ends(rig: Rig) -> None:
    rig.run()
    rig.host.pollutant = POLLUTED
    rig.wait_for(lambda: not rig.moving and rig.applied[-1].leds == RING, "cleaning")
    rig.host.pollutant = CLEAN
    rig.wait_for(lambda: rig.moving and rig.applied[-1].leds == 0, "motion again")
    last = rig.host.last
    assert (last.battery_low, last.base_errors, last.guard_restarts) == (
        255 if rig.link.program.kind.prefix in ("fw_gctronic", "fw_york") else 0,
        0,
        0,
    )
    rig.daemon.process.terminate()
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert rig.daemon.process.returncode == 0
    assert not rig.moving and rig.applied[-1].leds == 0


def test_its_own_sensors_reach_the_controller(rig: Rig) -> None:
    rig.run()
    rig.wait_for(lambda: rig.applied[-1].left_steps_s == rig.applied[-1].right_steps_s != 0, "walk")
    rig.link.program.proximity[0] = 3000
    rig.wait_for(lambda: rig.applied[-1].left_steps_s < 0 < rig.applied[-1].right_steps_s, "turn")


def test_silent_host(rig: Rig) -> None:
    def fail() -> int:
        rig.host.silent = True
        return 0

    def mend() -> None:
        rig.host.silent = False

    still_within(rig, SILENCE_NS, fail, mend)


def test_a_killed_daemons_successor_finds_the_base(rig: Rig) -> None:
    """Both processes at once, in the middle of whatever they did: nobody stops the wheels."""
    for _ in range(2):
        rig.run()
        guard = rig.daemon.guard
        assert guard is not None
        rig.daemon.process.send_signal(signal.SIGSTOP)
        os.kill(guard, signal.SIGKILL)
        rig.daemon.process.kill()
        rig.wait_for(lambda: rig.daemon.process.poll() is not None, "its death")
        rig.host.drop()
        rig.start()


def faults_of(rig: Rig) -> list[Callable[[], None]]:
    """Everything that can go wrong on the rig's line, once each."""

    def on_line(direction: str, what: str) -> Callable[[], None]:
        def fail() -> None:
            setattr(getattr(rig.link.program.state.uart, direction).faults, what, 7)

        return fail

    def on_bus(what: str) -> Callable[[], None]:
        def fail() -> None:
            setattr(rig.link.wires.faults, what, 3)

        return fail

    if isinstance(rig.link, Air):
        return [rig.link.break_off, lambda: rig.link.garble(b"\x07")]
    if rig.link.program.kind.byte_ns:
        ways = [(d, w) for d in ("rx", "tx") for w in ("lose", "flip", "twice")]
        return [on_line(direction, what) for direction, what in ways]
    return [on_bus(what) for what in ("refuse", "flip_write", "flip_read")]


def reset(rig: Rig) -> None:
    """The microcontroller is reset, as at power on: twice, where that is what it does."""
    program = rig.link.program
    more = (1,) if program.kind.prefix == "fw_asercom" else ()
    getattr(lib, f"{program.kind.prefix}_reset")(program.state, *more, host_ns() // 1000)
    rig.base.wake()


def test_it_goes_on_after_every_fault(rig: Rig) -> None:
    rig.run()
    for fail in [*faults_of(rig), lambda: reset(rig)]:
        fail()
        rig.live_for(300 * MS)
        rig.host.pollutant = POLLUTED
        rig.wait_for(lambda: not rig.moving and rig.applied[-1].leds == RING, "cleaning")
        rig.host.pollutant = CLEAN
        rig.wait_for(lambda: rig.moving, "motion again")
    assert rig.host.last.guard_restarts == 0
    rig.host.say(Wanted.STOP)
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.live_for(200 * MS)
    assert not rig.moving


@pytest.mark.parametrize("name", ON_I2C)
def test_a_stuck_bus_is_told_and_found_again(rigs: Rigs, name: str) -> None:
    rig = rigs(kind=name)
    rig.start()
    rig.run()
    rig.link.wires.stuck = 1
    rig.wait_for(lambda: rig.host.last.base_errors > 2, "errors that are told")
    assert rig.daemon.process.poll() is None and rig.host.last.guard_restarts == 0
    rig.link.wires.stuck = 0
    rig.wait_for(lambda: rig.host.last.left_steps_s != 0 and rig.moving, "motion again")


@native
def test_only_one_daemon_has_the_base(rig: Rig) -> None:
    rig.run()
    second = rig.begin(*rig.words(tag=str(TAG + 1)))
    rig.wait_for(lambda: second.process.poll() is not None, "the end of the second one")
    text = f"cannot open the base {rig.device}: another process holds the device"
    rig.wait_for(lambda: text in second.said, "its reason")
    assert rig.moving


@native
def test_a_base_that_is_gone_ends_the_daemon(rig: Rig) -> None:
    rig.run()
    rig.unplug()
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert rig.daemon.process.returncode == 1
    rig.wait_for(lambda: "the base is gone" in rig.daemon.said, "its reason")


def test_a_wrong_mode_is_told(rigs: Rigs) -> None:
    rig = rigs(kind="asercom", options=",mode=bluetooth")
    rig.start()
    text = "base: it answers as with its selector at 10: expected mode=extension"
    rig.wait_for(lambda: text in rig.daemon.said, "what is wrong")
    rig.live_for(500 * MS)
    assert rig.daemon.said.count(text) == 1, "the same thing once"


@pytest.fixture
def talking(talker: Path, request: pytest.FixtureRequest) -> Iterator[Rig]:
    """A rig whose robot has both boards on the bus of its base."""
    one = Rig(talker, kind=request.param, options=",ground,rab,rab_bytes=4")
    one.start()
    yield one
    one.close()


@pytest.mark.parametrize("talking", ON_I2C, indirect=True)
def test_boards_reach_the_controller_and_the_others(talking: Rig) -> None:
    rig = talking
    rig.run()
    rig.wait_for(lambda: rig.applied[-1].leds == 0b11, "the floor, and the wheels' way")
    rig.link.ground.ground[0] = 100
    rig.wait_for(lambda: rig.applied[-1].leds == 0b10, "the dark floor")
    for number in range(1, 5):
        message = {"data": [number, 0, 0, 0], "bearing_e4rad": -9000, "range_raw": 600}
        lib.fw_rab_hear(rig.link.rab, ffi.new("struct epuck_rab_message *", message))
        rig.wait_for(lambda n=number: rig.applied[-1].leds >> 3 == n, "the message")
        assert rig.link.rab.sent_number & ~0xFF == 0xAB00
        rig.wait_for(lambda n=number: rig.link.rab.sent_number == 0xAB00 + n, "what is said")
    rig.host.say(Wanted.STOP)
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.live_for(50 * MS)
    sent = rig.link.rab.sent
    rig.live_for(300 * MS)
    assert rig.link.rab.sent == sent, "outside a run it says nothing"


def test_iridias_leds_and_a_gyroscope(talker: Path) -> None:
    rig = Rig(talker, kind="york", options=",rgb,imu")

    def back() -> list[int]:
        assert not any(map(any, rig.link.rgb.rgb[0:2]))
        return list(rig.link.rgb.rgb[2])

    rig.start()
    rig.run()
    rig.wait_for(lambda: back() == [1, 2, 3], "its colour")
    writes = rig.link.rgb.writes
    rig.live_for(500 * MS)
    assert rig.link.rgb.writes == writes, "only another colour is written"
    rig.link.imu.rates[0] = 7511  # 1 rad/s are 7509.87
    rig.wait_for(lambda: rig.applied[-1].leds & lib.EPUCK_ARGOS_LED_FRONT, "the gyroscope")
    rig.wait_for(lambda: back() == [255, 2, 3], "another colour")
    rig.host.say(Wanted.STOP)
    rig.wait_for(lambda: back() == [0, 0, 0], "the dark at the end of a run")
    rig.run()
    rig.wait_for(lambda: back() == [255, 2, 3], "its colour again")
    rig.daemon.process.kill()
    rig.wait_for(lambda: back() == [0, 0, 0], "the dark behind a daemon that was killed")
    rig.host.drop()
    rig.start()
    rig.run()
    rig.wait_for(lambda: back() == [255, 2, 3], "its colour again")
    rig.daemon.process.terminate()
    rig.wait_for(lambda: back() == [0, 0, 0], "the dark at the end")
    rig.close()


def test_a_robot_that_its_host_drives(tmp_path: Path, build: Builder) -> None:
    program = build(tmp_path / "vsensed", ROOT / "robot" / "controllers" / "remote.c", *QUICKLY)
    rig = Rig(program, kind="york", options=",ground,rab,rab_bytes=4,rgb,imu")
    rig.host.table, rig.host.params = REMOTE_TABLE, ""
    colours = [0, 0, 0, 40, 50, 60, 300, 20, 30, 0, 0, 0]
    command = [300, -200, 0b101, *colours, 2, 7, 0xAB, 0, 0]
    rig.host.pollutant = np.array(command, "<i2").tobytes()
    rig.start()
    rig.run()
    told = attrgetter("left_steps_s", "right_steps_s", "leds")
    rig.wait_for(lambda: told(rig.applied[-1]) == (300, -200, 0b101), "the host's command")
    rig.wait_for(
        lambda: list(map(list, rig.link.rgb.rgb))[1:] == [[40, 50, 60], [255, 20, 30]], "colours"
    )
    rig.wait_for(lambda: rig.link.rab.sent_number == 0xAB07, "what is said")
    rig.link.program.proximity[0] = 3000
    rig.link.ground.ground[0] = 100
    rig.link.imu.rates[0] = 7511  # 1 rad/s are 7509.87
    message = {"data": [9, 8, 7, 6], "bearing_e4rad": -9000, "range_raw": 600}
    lib.fw_rab_hear(rig.link.rab, ffi.new("struct epuck_rab_message *", message))
    for name, value in (
        *(("range_and_bearing", 1.0), ("proximity", 3000.0), ("gyroscope", 1.0)),
        ("ground", 100 / lib.EPUCK_GROUND_MAX),
    ):
        near = pytest.approx(value, abs=1e-3)
        rig.wait_for(lambda n=name, near=near: own_of(rig).get(n, [-1.0])[0] == near, name)

    def on_its_way() -> bool:
        left_cm, right_cm = own_of(rig).get("wheels", (0.0, 0.0))
        return bool(left_cm > 0.1 and right_cm == pytest.approx(-left_cm * 2 / 3, abs=0.2))

    rig.wait_for(on_its_way, "its wheels' way")
    assert not own_of(rig).keys() & {"accelerometer", "microphones", "distance"}
    rig.host.frozen = True
    rig.wait_for(lambda: not rig.moving and rig.applied[-1].leds == 0, "an old command")
    rig.wait_for(lambda: not any(map(any, rig.link.rgb.rgb)), "the dark")
    assert "nobody offers" not in rig.daemon.said
    rig.close()


def test_a_turning_robots_gyroscope(rigs: Rigs) -> None:
    rig = rigs(kind="york", options=",imu")
    rig.start()
    rig.run()
    rig.link.program.proximity[0] = 3000
    rig.wait_for(lambda: rig.applied[-1].left_steps_s < 0 < rig.applied[-1].right_steps_s, "turn")

    def digits() -> float:
        last = rig.applied[-1]
        rad_s = (last.right_steps_s - last.left_steps_s) * 0.128805 / 53
        return rad_s / math.radians(250 / 32768)

    rig.wait_for(lambda: abs(rig.link.imu.rates[2] - digits()) < 100 < digits(), "its rate")


def test_rgb_leds_and_imu_that_are_missing_are_told(talker: Path) -> None:
    rig = Rig(talker, kind="york", options=",rgb,imu")
    rig.link.rgb.device.address = rig.link.imu.device.address = 0x7F
    rig.start()
    for words in ("the RGB LEDs do not answer", "the IMU does not answer"):
        rig.wait_for(lambda w=words: f"base: {w}" in rig.daemon.said, words)
    rig.close()


def test_accelerometer_and_microphones_reach_the_controller(talker: Path) -> None:
    rig = Rig(talker, kind="argos")
    rig.start()
    rig.run()
    rig.wait_for(lambda: rig.applied[-1].leds == lib.EPUCK_ARGOS_LED_BODY, "gravity and silence")
    for i in range(3):
        rig.link.program.state.body.inputs.acceleration[i] = 0
    rig.wait_for(lambda: rig.applied[-1].leds == 0, "a firmware that does not read it")
    rig.close()


def test_a_board_that_is_missing_is_told(talker: Path) -> None:
    rig = Rig(talker, kind="gctronic", options=",ground,rab")
    rig.link.ground.device.address = 0x7F
    rig.start()
    rig.wait_for(lambda: "base: the ground sensors do not answer" in rig.daemon.said, "the talk")
    rig.daemon.process.terminate()
    rig.wait_for(lambda: rig.daemon.process.poll() == 0, "the end of the daemon")
    check = rig.begin("--check", *rig.words())
    rig.wait_for(lambda: check.process.poll() is not None, "the end of the check", 60)
    assert "BAD  the ground sensors do not answer: is it plugged in" in check.printed
    rig.close()


def test_a_base_that_is_no_e_puck_is_one_file_and_one_line(tmp_path: Path, build: Builder) -> None:
    table = (ROOT / "robot" / "base.c").read_text()
    assert table.count("    LINE(york)      \\\n") == 1
    more = tmp_path / "base.c"
    more.write_text(table.replace("    LINE(york) ", "    LINE(bare)      \\\n    LINE(york) "))
    bare = Path(__file__).parent / "base_bare.c"
    source = tmp_path / "drive.c"
    source.write_text(
        '#include "controller.h"\n'
        "static void init(void *state, struct vs_robot *robot)\n"
        '{ *(int *)state = vs_robot_sensor(robot, "proximity"); }\n'
        "static void step(void *state, struct vs_robot *robot)\n"
        "{ vs_robot_set_wheels(robot, 900, vs_robot_read(robot, *(int *)state).known);\n"
        "  vs_robot_set_leds(robot, 4); }\n"
        'const struct vs_controller vs_controller = {"drive", sizeof(int), init, step, NULL};\n'
    )
    instead = {"base.c": more, "base_bare.c": bare}
    program = build(tmp_path / "vsensed", source, *QUICKLY, instead=instead)
    robot, host = BareRobot(), Host()
    words = ["--host", "127.0.0.1", "--port", str(host.port), "--tag", str(TAG), "--insecure"]
    process = subprocess.Popen(
        [program, *words, "--base", f"bare:{robot.device}"], stderr=subprocess.PIPE
    )
    try:
        host.wanted = Wanted.RUN
        live_until(lambda: robot.state == (400, 0, 1), robot, host)
        assert host.last.base_errors == 0
        host.wanted = Wanted.STOP
        live_until(lambda: robot.state == (0, 0, 0), robot, host)
        process.terminate()
        live_until(lambda: process.poll() is not None, robot, host)
        assert process.returncode == 0
        assert process.stderr is not None
        said = process.stderr.read().decode()
        assert "controller 'drive': nobody offers the sensor 'proximity'" in said
    finally:
        process.kill()
        process.communicate()
        robot.close()
        host.close()
