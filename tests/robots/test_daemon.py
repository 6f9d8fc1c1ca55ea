"""The real daemon on a real pseudo-terminal: what it does when all is well."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

import vsense
from tests.robots.rig import CLEAN, MS, POLLUTED, TAG, Rig, S, traced
from vsense.base.native import lib
from vsense.robots.link.wire import StopCause, Wanted

RING = 0xFF
GOOD = ["--host", "127.0.0.1", "--port", "4050", "--tag", "23", "--base", "argos:/dev/null"]


def ask(program: Path, *arguments: str) -> tuple[int, str, str]:
    done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=30)
    return done.returncode, done.stdout, done.stderr


def test_version_and_help(program: Path) -> None:
    status, out, _ = ask(program, "--version")
    assert (status, out) == (0, f"vsensed {vsense.__version__}, controller pollutant\n")
    status, out, _ = ask(program, "--help")
    assert status == 0
    assert "argos:DEVICE" in out and "Test aids:" in out


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (["--port", "70000"], "--port: expected a number from 0 to 65535, got '70000'"),
        (["--tag", "x"], "--tag: expected a number from 0 to 65535, got 'x'"),
        (
            ["--base", "yrok:/dev/null"],
            "KIND one of argos, asercom, gctronic, york, exec, wifi, got 'yrok:/dev/null'",
        ),
        (["--base", "argos:"], "got 'argos:'"),
        (["--uid", "12"], "--uid: expected 32 hexadecimal digits, got '12'"),
        (["--name", "n" * 32], "--name: expected 1 to 31 bytes of plain UTF-8"),
        (["--clock-drift-ppm", "nan"], "got 'nan'"),
        (["--clock-offset-ns", "1s"], "got '1s'"),
        (["--clock-permille", "0"], "--clock-permille: expected 1 to 1000, got '0'"),
        (
            ["--host", "10.0.0.1", "--clock-permille", "500"],
            "such robots stop late: expected --host 127.0.0.1, got '10.0.0.1'",
        ),
        (["--speed", "1"], "unknown option '--speed'"),
        (["--trace"], "--trace: expected a value after it"),
        (["--host", "localhost"], "expected a numeric IPv4 address, got 'localhost'"),
    ],
)
def test_bad_usage_is_one_clear_line(program: Path, change: list[str], text: str) -> None:
    status, out, said = ask(program, "--insecure", *GOOD, *change)
    assert (status, out) == (2, "")
    assert text in said and said.count("\n") == 1


def test_missing_option_is_named(program: Path) -> None:
    for at in range(0, len(GOOD), 2):
        status, _, said = ask(program, "--insecure", *GOOD[:at], *GOOD[at + 2 :])
        assert status == 2
        assert f"{GOOD[at]} is missing" in said


def test_device_that_is_not_there(program: Path) -> None:
    status, _, said = ask(program, "--insecure", *GOOD[:-1], "argos:/nowhere/ttyS0")
    assert status == 1
    assert "cannot open the base /nowhere/ttyS0: errno 2" in said


def test_greeting_telemetry_and_talk(rig: Rig) -> None:
    rig.run()
    hello = rig.host.hellos[0]
    assert (hello.tag, hello.name, hello.controller) == (TAG, "robot_23", "pollutant")
    assert (hello.version, hello.hash) == (vsense.__version__, "")
    assert len(hello.uid) == 16
    rig.wait_for(lambda: rig.host.last.left_steps_s != 0, "telemetry of the motion")
    last = rig.host.last
    assert (last.state, last.wanted, last.stop_cause) == (Wanted.RUN, Wanted.RUN, StopCause.NONE)
    assert (last.battery_low, last.base_errors, last.guard_restarts) == (0, 0, 0)
    assert last.control_step > 0
    assert rig.daemon.said.count("connected: 2 sensors") == 1
    assert rig.daemon.said.count("does not know 'magic': ignored") == 1
    said = [line for line in rig.daemon.said.splitlines() if "parameter" in line]
    assert [line.split(": ", 1)[1] for line in said] == [
        "controller 'pollutant': expected a number of 0 or more as parameter 'near_raw'",
        "controller 'pollutant' does not know the parameter 'stop_probabilty': ignored",
    ]


def test_virtual_sensor_decides_what_wheels_and_leds_do(rig: Rig) -> None:
    rig.run()
    rig.host.pollutant = POLLUTED
    rig.wait_for(lambda: not rig.moving and rig.applied[-1].leds == RING, "cleaning")
    rig.wait_for(lambda: rig.host.last.leds == RING, "telemetry of the LEDs")
    rig.host.pollutant = CLEAN
    rig.wait_for(lambda: rig.moving and rig.applied[-1].leds == 0, "motion again")


def test_real_sensor_decides_too(rig: Rig) -> None:
    rig.run()
    rig.wait_for(lambda: rig.applied[-1].left_steps_s == rig.applied[-1].right_steps_s != 0, "walk")
    rig.base.links[0].program.state.body.inputs.prox[0] = 3000
    rig.wait_for(lambda: rig.applied[-1].left_steps_s < 0 < rig.applied[-1].right_steps_s, "turn")


def test_what_was_measured_of_it_moves_thresholds_and_wheels(
    rigs: Callable[..., Rig],
) -> None:
    """The reading that the nominal robot avoids, 4000, is this one's for nothing near. Its wheels
    of 45 mm turn 41/45 as fast for the 621 steps/s that are 8 cm/s."""
    rig = rigs("--proximity-scale", "4000:4096", "--wheel-diameter", "45")
    rig.link.program.state.body.inputs.prox[0] = 4000
    rig.start()
    rig.run()
    outputs = rig.link.program.state.body.outputs
    rig.wait_for(lambda: outputs.left_steps_s == outputs.right_steps_s == 566, "its own speed")
    rig.link.program.state.body.inputs.prox[0] = 4096
    rig.wait_for(lambda: outputs.left_steps_s < 0 < outputs.right_steps_s, "a turn to the left")


def test_run_begins_with_the_named_timestep(rig: Rig) -> None:
    rig.wait_for(lambda: rig.host.connected, "a session")
    rig.host.from_timestep = 2**32 - 1
    rig.host.say(Wanted.RUN)
    rig.wait_for(lambda: rig.host.last.wanted == Wanted.RUN, "the echo")
    assert rig.host.last.state == Wanted.IDLE
    assert rig.host.last.stop_cause == StopCause.WANTED
    rig.live_for(300 * MS)
    assert not rig.moving
    rig.host.from_timestep = 0
    rig.wait_for(lambda: rig.moving, "motion")


@pytest.mark.parametrize(
    ("wanted", "leds"), [(Wanted.STOP, 0), (Wanted.IDLE, 0), (Wanted.PAUSE, RING)]
)
def test_every_other_wish_holds_the_wheels(rig: Rig, wanted: Wanted, leds: int) -> None:
    rig.run()
    rig.host.pollutant = POLLUTED
    rig.wait_for(lambda: rig.applied[-1].leds == RING, "cleaning")
    rig.host.wanted = wanted
    rig.wait_for(lambda: rig.host.last.state == wanted, "the echo")
    rig.wait_for(lambda: rig.host.last.leds == leds, "the LEDs")
    assert not rig.moving
    rig.host.pollutant = CLEAN
    rig.run()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_told_to_end_it_hands_the_base_back(rig: Rig, number: signal.Signals) -> None:
    rig.run()
    guard = rig.daemon.guard
    rig.daemon.process.send_signal(number)
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert rig.daemon.process.returncode == 0
    rig.wait_for(lambda: rig.host.goodbyes, "a goodbye")
    assert rig.host.goodbyes[0].text == "the daemon was asked to end"
    rig.wait_for(lambda: rig.base.links[0].program.state.state == lib.FW_ARGOS_WAKE, "'R'")
    assert not rig.moving
    assert not Path(f"/proc/{guard}").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_terminal_tells_both_processes(rig: Rig, number: signal.Signals) -> None:
    rig.run()
    guard = rig.daemon.guard
    assert guard is not None
    os.kill(guard, number)
    rig.daemon.process.send_signal(number)
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert rig.daemon.process.returncode == 0
    rig.wait_for(lambda: not rig.moving, "rest")
    assert not Path(f"/proc/{guard}").exists()


def test_ctrl_z_stops_the_wheels(rig: Rig) -> None:
    rig.run()
    guard = rig.daemon.guard
    assert guard is not None
    os.kill(guard, signal.SIGTSTP)
    rig.daemon.process.send_signal(signal.SIGTSTP)
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.daemon.process.send_signal(signal.SIGCONT)
    rig.run()
    assert rig.daemon.guard == guard, rig.daemon.said


def test_trace_names_its_columns_and_every_step(rigs: Callable[..., Rig], tmp_path: Path) -> None:
    path = tmp_path / "trace"
    rig = rigs("--trace", str(path))
    rig.start()
    rig.run()
    rig.wait_for(lambda: rig.host.last.control_step >= 5, "steps")
    header, *lines = path.read_text().splitlines()
    columns = header.removeprefix("# columns: ").split()
    for number, line in enumerate(lines, 1):
        words = line.split()
        assert words[::2] == columns
        row = dict(zip(words[::2], words[1::2]))
        assert int(row["step"]) == number
        # The header's capture is that of the newest value, cut to whole microseconds on the way.
        pollutant, magic = row["values"].split(",")
        value, times = pollutant.split("@")
        capture, age, stale = times.split(":")
        assert (value, magic) == ("pollutant=00000000", "magic=-")
        assert abs(int(row["age_ns"]) - int(age)) < 1000
        assert stale == row["stale"]
        assert 0 <= int(row["capture_ns"]) - int(capture) < 1000


@pytest.mark.parametrize(("offset_ns", "drift_ppm"), [(-(10**18), -100.0), (3600 * S, 100.0)])
def test_ages_are_right_within_their_bound_on_any_clock(
    rigs: Callable[..., Rig], tmp_path: Path, offset_ns: int, drift_ppm: float
) -> None:
    path = tmp_path / "trace"
    clock = ["--clock-offset-ns", str(offset_ns), "--clock-drift-ppm", str(drift_ppm)]
    rig = rigs("--trace", str(path), *clock)
    rig.start()
    rig.run()
    rig.wait_for(lambda: rig.host.last.control_step >= 10, "steps")
    for row in traced(path):
        host_ns = (int(row["now_ns"]) - offset_ns) * 1_000_000_000 // round(1e9 + drift_ppm * 1e3)
        true_ns = host_ns - int(row["capture_ns"])
        assert abs(int(row["age_ns"]) - true_ns) <= int(row["bound_ns"])


def test_pause_without_a_session_puts_the_leds_out(rig: Rig) -> None:
    rig.run()
    rig.host.pollutant = POLLUTED
    rig.wait_for(lambda: rig.applied[-1].leds == RING, "cleaning")
    rig.host.say(Wanted.PAUSE)
    rig.wait_for(lambda: rig.host.last.state == Wanted.PAUSE, "the pause")
    rig.host.refuse = True
    rig.host.drop()
    rig.wait_for(lambda: rig.applied[-1].leds == 0, "LEDs off")
