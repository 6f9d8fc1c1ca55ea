"""The daemon against the firmware that robots have, built from its authors' sources.

`scripts/bench firmware --source FOLDER` runs these; the sources are not part of vsense.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.robots.conftest import QUICKLY, ROOT, Builder
from tests.robots.firmware import real
from tests.robots.firmware.real import Firmware, FirmwareRig, RealFirmware
from tests.robots.rig import CLEAN, MS, POLLUTED, own_of
from tests.robots.stopping import SILENCE_NS
from vsense.robots.link.wire import StopCause, Wanted
from vsense.run.remote import REMOTE_TABLE

Rigs = Callable[[Path], FirmwareRig]

STEP_CM = 0.0128805
"""Of an e-puck's wheels: 1000 steps a turn of 128.8 mm."""


def test_registers_are_declared_as_sources_use_them() -> None:
    text = "#define LED0 _LATA6\nT2CONbits.TON = 1; T2CONbits.TCKPS = 0; TMR2 = _RF1;"
    assert real.registers([text, "_LATA6 = 1; I2CCON = I2C_ON;"]).splitlines() == [
        "int I2CCON;",
        "int TMR2;",
        "struct { unsigned _LATA6 : 1; unsigned _RF1 : 1; } pins;",
        "#define _LATA6 pins._LATA6",
        "#define _RF1 pins._RF1",
        "struct { int TCKPS, TON; } T2CONbits;",
        "#define I2C_ON 0xffff",
    ]


@pytest.fixture(scope="module")
def firmware() -> Firmware:
    """The one whose checkout was given."""
    firmware = real.firmware_of(Path(os.environ[real.SOURCE]))
    assert firmware is not None
    return firmware


@pytest.fixture(scope="module")
def compiled(firmware: Firmware, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """It as a program of this machine."""
    folder = tmp_path_factory.mktemp("firmware")
    return real.compiled(firmware, Path(os.environ[real.SOURCE]), folder)


@pytest.fixture
def rigs(firmware: Firmware, compiled: Path, tmp_path: Path) -> Iterator[Rigs]:
    """Makes a host and a robot with real firmware, without a daemon; of which program it is."""
    made: list[FirmwareRig] = []

    def make(program: Path) -> FirmwareRig:
        made.append(FirmwareRig(program, RealFirmware(firmware, compiled, tmp_path)))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def rig(rigs: Rigs, program: Path) -> FirmwareRig:
    """With the pollutant controller."""
    return rigs(program)


def check(rig: FirmwareRig) -> tuple[int, str]:
    """Exit code of `vsensed --check` and what it says of the base."""
    daemon = rig.begin("--check", *rig.words())
    rig.wait_for(lambda: daemon.process.poll() is not None, "the end of the check", 60)
    said = {line.split()[0]: line[9:] for line in daemon.printed.splitlines()}
    return daemon.process.returncode, said["base"]


@pytest.mark.campaign
def test_the_check_finds_it_and_reads_its_battery_pin(rig: FirmwareRig, firmware: Firmware) -> None:
    page = rig.firmware.page
    page["proximity"][:] = [-7, 0, 11, 500, 900, 3, 2, 1]
    assert check(rig)[1] == f"ok   {firmware.name} on {rig.device} answers, wheels at 0"
    if not firmware.has_battery_pin:
        return
    page["battery_good"] = 0
    code, said = check(rig)
    assert code == 1 and said.startswith(f"BAD  {firmware.name} on {rig.device}")
    assert "its battery is low: charge it" in said
    assert page["radio_inits"] == 0, "range and bearing was never set up"


@pytest.mark.campaign
@pytest.mark.parametrize("speed_cm_s", [8, 4])
def test_wheels_turn_as_commanded(rig: FirmwareRig, firmware: Firmware, speed_cm_s: int) -> None:
    """A step takes whole periods of its timer; its own motor library counts."""
    rig.host.params = f"speed_cm_s={speed_cm_s}\nstop_probability=0\n"
    rig.start()
    rig.run()
    rig.live_for(500 * MS)
    compared = 0
    while compared < 6:
        begun, _ = len(rig.host.telemetry), rig.is_held_up()
        rig.live_for(200 * MS)
        counted = rig.steps_s(400 * MS)
        rig.live_for(100 * MS)
        commands = {(t.left_steps_s, t.right_steps_s) for t in rig.host.telemetry[begun:]}
        if rig.is_held_up() or len(commands) > 1 or 0 in (command := commands.pop()):
            continue  # it turned in between
        compared += 1
        print(
            f"\n  commanded {command} steps/s, counted {counted[0]:.0f}, {counted[1]:.0f}",
            end="",
        )
        for steps_s, wheel in zip(counted, command, strict=True):
            assert steps_s == pytest.approx(firmware.steps_s(wheel), rel=firmware.spread)


@pytest.mark.campaign
def test_its_sensors_wheels_and_leds(
    rigs: Rigs, firmware: Firmware, build: Builder, tmp_path: Path
) -> None:
    """A robot that its host drives says what the real firmware has measured and done."""
    remote = build(tmp_path / "vsensed", ROOT / "robot" / "controllers" / "remote.c", *QUICKLY)
    rig = rigs(remote)
    page = rig.firmware.page
    page["proximity"][:] = [-7, 0, 11, 500, 900, 3, 2, 1]
    page["light"][:] = [4000, 3000, 2000, 1500, 1001, 3800, 3900, 4095]
    rig.host.table, rig.host.params = REMOTE_TABLE, ""
    commands = [(300, -200, 1 << led) for led in range(10)] + [(-400, 250, 0x355)]
    for left, right, leds in commands:
        rig.host.pollutant = np.array([left, right, leds, *[0] * 17], "<i2").tobytes()
        if not rig.daemons:
            rig.start()
            rig.run()
        rig.wait_for(lambda: page["leds"] == leds & firmware.leds, f"LEDs {leds:x}")  # noqa: B023
    rig.live_for(500 * MS)
    counted = rig.steps_s(1000 * MS)
    while rig.is_held_up():
        counted = rig.steps_s(1000 * MS)
    for steps_s, command in zip(counted, (left, right), strict=True):
        assert steps_s == pytest.approx(firmware.steps_s(command), rel=firmware.spread)
    own = own_of(rig)
    assert own["proximity"] == [0, 0, 11, 500, 900, 3, 2, 1]
    assert own["light"] == (firmware.dark - page["light"]).tolist(), "higher is brighter"
    if firmware.counts_steps:
        ways_cm = []
        for _ in range(2):  # of one process: on a busy machine a worker is replaced
            rig.host.pollutant = np.zeros(20, "<i2").tobytes()
            rig.wait_for(lambda: not rig.moving, "rest")
            rig.live_for(500 * MS)
            steps_cm = [page[side] * STEP_CM for side in ("left_steps", "right_steps")]
            ways_cm.append(np.subtract(own_of(rig)["wheels"], steps_cm))
            rig.host.pollutant = np.array([300, -200, *[0] * 18], "<i2").tobytes()
            rig.live_for(1500 * MS)
        assert ways_cm[1] == pytest.approx(ways_cm[0], abs=STEP_CM)


@pytest.mark.campaign
def test_the_ring_is_lit_in_pollution(rig: FirmwareRig) -> None:
    """It toggles LEDs by difference, and cannot be asked for their state."""
    rig.start()
    rig.run()
    for payload, ring in ((POLLUTED, 0xFF), (CLEAN, 0), (POLLUTED, 0xFF)):
        rig.host.pollutant = payload
        rig.wait_for(lambda: rig.firmware.page["leds"] == ring, f"LEDs {ring:x}")  # noqa: B023


@pytest.mark.campaign
def test_wheels_stand_when_the_host_falls_silent(rig: FirmwareRig) -> None:
    rig.start()
    took_ms = []
    for _ in range(5):
        rig.run()
        rig.live_for(500 * MS)
        rig.is_held_up()
        rig.host.silent = True
        rig.wait_for(lambda: not rig.moving, "rest")
        took_ns = int(rig.firmware.page["stepped_ns"]) - rig.host.fresh_ns
        if not rig.is_held_up():
            took_ms.append(took_ns // MS)
        rig.host.silent = False
    print("\n  last step of a motor after", took_ms, "ms", end="")
    assert took_ms and max(took_ms) <= SILENCE_NS // MS


@pytest.mark.campaign
def test_it_is_reset_in_mid_run_and_drives_on(rig: FirmwareRig) -> None:
    """It takes the next frame's bytes for its configuration, and may set up range and bearing."""
    page = rig.firmware.page
    rig.start()
    rig.run()
    for _ in range(5):
        rig.live_for(700 * MS)
        resets, errors = int(page["resets"]), rig.host.last.base_errors
        page["reset"] = 1
        rig.wait_for(lambda: page["resets"] > resets, "the reset")  # noqa: B023
        rig.wait_for(lambda: rig.host.last.base_errors > errors, "its report")  # noqa: B023
        rig.run()
        page["radio_sent"] = 0
        rig.live_for(300 * MS)
        assert page["radio_sent"] == 0, "range and bearing is off again"
    assert rig.host.last.stop_cause == StopCause.NONE


@pytest.mark.campaign
def test_a_daemon_that_is_killed_finds_it_again(rig: FirmwareRig) -> None:
    rig.start()
    rig.run()
    rig.daemon.close()
    rig.host.drop()
    rig.host.wanted = Wanted.IDLE
    rig.start()
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.run()
