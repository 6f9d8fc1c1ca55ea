"""The real daemon when the line loses a byte, nobody reads what it says, or the system fails it."""

from __future__ import annotations

import fcntl
import os
import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.rigs.processes import is_alive
from tests.robots.rig import MS, TABLE, Daemon, Rig, S, traced
from tests.robots.stopping import wait_said
from vsense.base.clock import host_ns
from vsense.modes.lab._links import Terminal
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import GoodbyeCause, Wanted

FRAME = 12
"""[byte] of a frame to the microcontroller."""

RESET_AT = 10
PHEROMONE = Table([*TABLE.entries, Entry(11, "pheromone", "u4", Direction.ACTUATOR)])


def lose_a_byte(rig: Rig, at: int, match: Callable[[bytes], bool]) -> list[bytes]:
    """Has the line swallow one byte of the first frame that matches; returns the frames cut."""
    cut: list[bytes] = []
    link = rig.base.links[0]
    assert isinstance(link, Terminal)

    def faulty(now_ns: int) -> None:
        data = os.read(link.master, 256)
        if len(data) == FRAME and not cut and match(data):
            cut.append(data)
            data = data[:at] + data[at + 1 :]
        link._waiting += data
        link._offer(now_ns)
        link._plan(now_ns)

    link.receive = faulty  # type: ignore[method-assign]
    return cut


def fill_stderr(daemon: Daemon) -> None:
    """Leaves no room in the pipe, and nobody reads it any more."""
    daemon.open = False
    end = os.open(f"/proc/{daemon.process.pid}/fd/2", os.O_WRONLY | os.O_NONBLOCK)
    for size in (4096, 1):
        try:
            while True:
                os.write(end, b"\n" * size)
        except BlockingIOError:
            pass
    os.close(end)


def stands(data: bytes) -> bool:
    return data[:4] == bytes(4)


@pytest.mark.parametrize("at", [0, 5, 11])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_stop_frame_that_lost_a_byte_is_sent_again(
    rig: Rig, number: signal.Signals, at: int
) -> None:
    rig.run()
    cut = lose_a_byte(rig, at, stands)
    guard = rig.daemon.guard
    rig.daemon.process.send_signal(number)
    rig.wait_for(lambda: cut and not rig.moving, "rest")
    if number != signal.SIGSTOP:
        rig.wait_for(lambda: not is_alive(guard), "the guard's end")
    assert not rig.moving


def test_reset_frame_that_lost_a_byte_moves_nothing(rig: Rig) -> None:
    rig.run()
    cut = lose_a_byte(rig, 0, lambda data: data[RESET_AT : RESET_AT + 1] == b"R")
    rig.daemon.process.terminate()
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert not rig.moving
    rig.wait_for(lambda: cut, "the reset")


def test_full_stderr_delays_no_stop(rig: Rig) -> None:
    rig.run()
    fill_stderr(rig.daemon)
    rig.host.say(Wanted.STOP)
    rig.wait_for(lambda: not rig.moving, "rest")
    heard = len(rig.host.telemetry)
    rig.wait_for(lambda: len(rig.host.telemetry) > heard + 5, "telemetry")
    rig.run()
    guard = rig.daemon.guard
    assert guard is not None
    os.kill(guard, signal.SIGKILL)
    rig.wait_for(lambda: rig.host.last.guard_restarts == 1, "another guard")
    rig.run()
    rig.daemon.open = True
    # The count comes with the next line that finds room: the first may still be dropped.
    for _ in range(5):
        rig.host.say(Wanted.STOP)
        rig.wait_for(lambda: not rig.moving, "rest")
        rig.run()
    assert "lines were dropped: nobody read them" in rig.daemon.said
    rig.daemon.process.terminate()
    rig.wait_for(lambda: rig.daemon.process.poll() == 0, "the end")


def test_full_trace_delays_nothing(rigs: Callable[..., Rig], tmp_path: Path) -> None:
    path = tmp_path / "trace"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    fcntl.fcntl(reader, 1031, 4096)  # F_SETPIPE_SZ
    rig = rigs("--trace", str(path))
    rig.start()
    rig.run()
    wait_said(rig, 1, "trace: steps are missing, its reader is too slow")
    rig.host.say(Wanted.STOP)
    rig.wait_for(lambda: not rig.moving, "rest")
    os.close(reader)


def test_a_trace_goes_on_when_it_can_be_written_again(
    rigs: Callable[..., Rig], tmp_path: Path
) -> None:
    """As when a full disk has been cleared; half a line of a broken pipe may stand before."""
    path = tmp_path / "trace"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    rig = rigs("--trace", str(path))
    rig.start()
    rig.run()
    os.close(reader)
    wait_said(rig, 1, "trace: steps are missing, errno 32")
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    rig.run()
    rig.wait_for(lambda: b"step " in os.read(reader, 1 << 16), "steps")
    os.close(reader)


def test_child_of_a_controller_holds_neither_guard_nor_base(probes: Callable[..., Rig]) -> None:
    rig = probes(params="child=1\n")
    guard = rig.daemon.guard
    rig.daemon.process.kill()
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.wait_for(lambda: not is_alive(guard), "the guard's end", 3)
    rig.host.params = ""
    rig.start()
    rig.run()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_controllers_helper_holds_nothing_and_goes_with_it(
    probes: Callable[..., Rig], number: signal.Signals
) -> None:
    """It became no other program: with base and sockets open, no other daemon came to the base."""
    rig = probes(params="helper=1\n")
    helper = int(re.findall(r"helper (\d+)", rig.daemon.said)[0])
    held = [os.readlink(path) for path in Path(f"/proc/{helper}/fd").iterdir()]
    assert rig.device not in held and not any(name.startswith("socket:") for name in held)
    assert "/dev/null" in held
    guard = rig.daemon.guard
    os.kill(rig.daemon.process.pid, number)
    rig.wait_for(lambda: not is_alive(helper), "the helper's end", 3)
    rig.wait_for(lambda: not is_alive(guard), "the guard's end", 3)
    rig.host.params = ""
    rig.start()
    rig.run()


def test_a_controllers_helper_that_is_asked_to_end_ends_alone(probes: Callable[..., Rig]) -> None:
    """It had the daemon's handlers, and told the daemon to end."""
    rig = probes(params="helper=1\n")
    helper = int(re.findall(r"helper (\d+)", rig.daemon.said)[0])
    os.kill(helper, signal.SIGTERM)
    rig.wait_for(lambda: Path(f"/proc/{helper}/status").read_text().count("(zombie)"), "its end", 3)
    rig.run()
    assert rig.daemon.process.poll() is None


def test_no_second_guard_can_be_forked(
    probes: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PROBE_FORKS", "1")
    rig = probes()
    guard = rig.daemon.guard
    assert guard is not None
    os.kill(guard, signal.SIGKILL)
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert rig.daemon.process.returncode == 1
    assert not rig.moving
    rig.wait_for(lambda: rig.host.goodbyes, "a goodbye")
    goodbye = rig.host.goodbyes[0]
    assert (goodbye.code, goodbye.text) == (GoodbyeCause.BASE, "no guard can be started")


def test_packet_that_comes_after_the_clock_was_read_spoils_no_age(
    probes: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PROBE_GAP", "1")
    path = tmp_path / "trace"
    rig = probes("--trace", str(path))
    rig.wait_for(lambda: rig.host.last.control_step >= 10, "steps")
    for row in traced(path):
        true_ns = int(row["now_ns"]) - int(row["capture_ns"])
        assert abs(int(row["age_ns"]) - true_ns) <= int(row["bound_ns"])


@pytest.mark.parametrize("has_raw", [True, False])
def test_ages_are_right_within_their_bound_while_ntp_slews_the_clock(
    probes: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, has_raw: bool
) -> None:
    monkeypatch.setenv("PROBE_SLEW", "80000")
    if not has_raw:
        monkeypatch.setenv("PROBE_NO_RAW", "1")
    path = tmp_path / "trace"
    rig = probes("--trace", str(path))
    rig.wait_for(lambda: rig.host.last.control_step >= 20, "steps")
    for row in traced(path):
        shown_ns = int(row["now_ns"])
        now_ns = shown_ns if has_raw else shown_ns * 100 // 108
        true_ns = now_ns - int(row["capture_ns"])
        assert abs(int(row["age_ns"]) - true_ns) <= int(row["bound_ns"])


def test_children_are_waited_for_whatever_the_parent_ignores(rigs: Callable[..., Rig]) -> None:
    rig = rigs()
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        daemon = rig.start()
    finally:
        signal.signal(signal.SIGCHLD, before)
    rig.run()
    status = Path(f"/proc/{daemon.process.pid}/status").read_text()
    ignored = int(status.split("SigIgn:")[1].split()[0], 16)
    assert not ignored >> (signal.SIGCHLD - 1) & 1


def test_robot_that_was_taken_over_stays_away(rig: Rig) -> None:
    rig.run()
    began_ns = host_ns()
    rig.host.goodbye(GoodbyeCause.TAKEN_OVER)
    wait_said(rig, 1, "another robot has the same uid")
    rig.wait_for(lambda: len(rig.host.hellos) == 2, "another greeting")
    assert host_ns() - began_ns >= 5 * S


def lived(rig: Rig) -> int:
    """Steps of the controller, as its LEDs show them."""
    rig.wait_for(lambda: rig.host.last.left_steps_s == 300, "telemetry of the motion")
    return rig.host.last.leds


def test_controller_goes_on_in_the_same_run_and_begins_anew_in_another(
    probes: Callable[..., Rig],
) -> None:
    rig = probes()
    rig.wait_for(lambda: lived(rig) > 12, "steps")
    rig.host.drop()
    rig.run()
    assert lived(rig) > 12
    for run, params in ((2, ""), (2, "speed_cm_s=3\n")):
        rig.host.run = run
        rig.host.params = params
        if params:
            rig.host.drop()
        rig.wait_for(lambda: rig.host.connected and 0 < rig.host.last.leds < 9, "a new life")
        rig.wait_for(lambda: lived(rig) > 12, "steps")
    assert rig.daemon.said.count("does not know 'magic': ignored") == 2


def test_actuators_live_as_long_as_their_run_and_table(probes: Callable[..., Rig]) -> None:
    rig = probes()
    rig.wait_for(lambda: rig.host.last.payload == bytes([5, 0, 0, 0]), "five drops")
    rig.host.drop()
    seen = len(rig.host.telemetry)
    rig.run()
    assert {t.payload for t in rig.host.telemetry[seen:]} == {bytes([5, 0, 0, 0])}
    rig.host.wanted = Wanted.IDLE
    rig.host.table = PHEROMONE
    rig.host.drop()
    seen = len(rig.host.telemetry)
    rig.wait_for(lambda: len(rig.host.telemetry) > seen + 5, "telemetry")
    rig.live_for(100 * MS)
    assert {t.payload for t in rig.host.telemetry[seen:]} == {bytes(4)}


def test_what_a_controller_shows_and_logs_reaches_the_host(probes: Callable[..., Rig]) -> None:
    rig = probes(params="talk=1\n")
    rig.wait_for(lambda: lived(rig) > 5, "steps")
    last = rig.host.last
    steps = dict(last.shown)["steps"]
    assert last.shown == (("steps", steps), ("state", "odd" if steps % 2 else "even"))
    said = {(t.log_number, t.log) for t in rig.host.telemetry} - {(0, "")}
    assert said == {(1, "step 1")}, "repeated as long as the host has not heard it"
    for number, line in ((1, (2, "step 2")), (2, (3, "step 3")), (3, (0, ""))):
        rig.host.log_heard = number
        rig.wait_for(lambda line=line: (rig.host.last.log_number, rig.host.last.log) == line, line)
    rig.host.drop()
    rig.run()
    assert rig.host.last.log_number == 0 and dict(rig.host.last.shown)["steps"] >= steps
    assert {hello.started for hello in rig.host.hellos} == {rig.host.hellos[0].started}
    assert len({hello.nonce for hello in rig.host.hellos}) == len(rig.host.hellos) >= 2


def test_daemon_without_a_network_stops_the_wheels_and_waits_for_one(
    rig: Rig, program: Path
) -> None:
    rig.run()
    driving, guard = rig.daemon, rig.daemon.guard
    assert guard is not None
    for process in (driving.process.pid, guard):
        os.kill(process, signal.SIGSTOP)
    for process in (driving.process.pid, guard):
        os.kill(process, signal.SIGKILL)
    rig.wait_for(lambda: not driving.open, "the end of both processes")
    assert rig.moving, "nobody is left who could stop the wheels"
    # The system refuses a connection to this address at once, as it does without any route.
    lost = ["--host", "255.255.255.255", "--port", "4050", "--tag", "23", "--insecure"]
    rig.daemons.append(Daemon(program, *lost, "--base", f"argos:{rig.device}"))
    rig.wait_for(lambda: not rig.moving, "standing wheels")
    rig.wait_for(lambda: "no way to 255.255.255.255:" in rig.daemon.said, "a word")
    rig.live_for(S)
    assert rig.daemon.process.poll() is None, "it waits for a network"
    assert rig.daemon.said.count("no way to") == 1
