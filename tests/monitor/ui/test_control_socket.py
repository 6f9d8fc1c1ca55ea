"""A terminal's way to a running experiment, over a real socket."""

from __future__ import annotations

import errno
import json
import os
import pwd
import socket
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from vsense import cli
from vsense.base.errors import UsageError
from vsense.monitor.ui import control_client as terminal
from vsense.monitor.ui import control_socket
from vsense.monitor.ui.control_socket import (
    TERMINAL_TIMEOUT_S,
    TRACKER_SUFFIX,
    ControlSocket,
    ControlSocketError,
    folder,
)
from vsense.run.orders import Order, OrderError, OrderKind

STATUS = {
    "name": "wander", "command": "lab", "port": 4050, "directory": "/runs/x", "run": {
        "run": 2, "state": "paused", "time_s": 12.3, "length_s": 60.0, "timestep": 123, "late": 1,
        "rate_hz": 10.0, "latency_ms": {"p50": 15.6, "p99": 20.1}, "silent_s": 0.0,
    },
    "robots": {
        "name": ["epuck_23", "epuck_24"], "tag": [23, 24], "version": ["0.1.0", ""],
        "controller": ["pollutant", ""], "hash": ["0123456789ab", ""],
        "expected": ["wanderer", "wanderer"], "authenticated": [True, None],
        "connected": [True, False], "sessions": [1, 0], "heard_ms": [12.0, None],
        "signal_dbm": [-61, None], "pose_age_ms": [40.0, None],
        "battery_mv": [3700, None], "battery_low": [False, None],
        "base_errors": [0, None], "state": ["run", "idle"], "trouble": ["", "not connected"],
    },
}  # fmt: skip


class Desk:
    """Takes orders; refuses to start."""

    def __init__(self) -> None:
        self.orders: list[Order] = []

    def give(self, order: Order) -> str:
        if order.kind == OrderKind.START:
            raise OrderError("run 2 is going on already")
        self.orders.append(order)
        return f"done: {order.kind.value}"


@pytest.fixture
def desk() -> Desk:
    return Desk()


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "vsense"


@pytest.fixture
def bell(place: Path, desk: Desk) -> Iterator[ControlSocket]:
    made = ControlSocket(lambda: STATUS, desk.give)
    yield made
    made.close()


def test_an_order_reaches_the_desk_and_says_who_gave_it(
    bell: ControlSocket, desk: Desk, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["pause"]) == 0
    assert cli.main(["stop", "--emergency", "--process", str(os.getpid())]) == 0
    assert [order.kind for order in desk.orders] == [OrderKind.PAUSE, OrderKind.EMERGENCY]
    assert desk.orders[0].by == f"{pwd.getpwuid(os.getuid()).pw_name} (terminal)"
    assert capsys.readouterr().out == "done: pause\ndone: emergency\n"


def test_a_refusal_is_one_line_and_exit_code_1(
    bell: ControlSocket, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["start"]) == 1
    assert capsys.readouterr().err == "vsense: run 2 is going on already\n"


def test_a_lab_folder_that_breaks_holds_up_no_emergency_stop(
    bell: ControlSocket, desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its disk fails between two looks at it."""
    usual, broken = Path.glob, Path("/broken/lab")

    def glob(place: Path, pattern: str) -> Iterator[Path]:
        if place == broken:
            raise OSError(errno.ESTALE, "Stale file handle")
        return iter(list(usual(place, pattern)))

    places = terminal.folders()[0]
    monkeypatch.setattr(terminal, "folders", lambda: ([broken, *places], []))
    monkeypatch.setattr(Path, "glob", glob)
    assert cli.main(["stop", "--emergency"]) == 0
    assert cli.main(["stop", "--emergency", "--all"]) == 1, "there may be others that move"
    assert [order.kind for order in desk.orders] == [OrderKind.EMERGENCY] * 2


def test_what_talks_without_end_is_not_heard_to_the_end(place: Path) -> None:
    place.mkdir(mode=0o700)
    path = place / "1.sock"
    with socket.create_server(str(path), family=socket.AF_UNIX) as server:

        def talk() -> None:
            line, _ = server.accept()
            with line, suppress(OSError):
                while True:
                    line.sendall(b" " * 65536)

        threading.Thread(target=talk, daemon=True).start()
        with pytest.raises(ValueError, match="its answer has no end"):
            terminal.exchange(path, b"{}\n")


def test_a_link_in_a_sockets_place_opens_no_file(tmp_path: Path) -> None:
    """A member of the lab may put one there between two steps of ours."""
    (tmp_path / "mine").touch(0o600)
    (tmp_path / "1.new").symlink_to(tmp_path / "mine")
    with pytest.raises(OSError, match="is not the socket"):
        control_socket._set_mode(tmp_path / "1.new", 0o660)
    assert stat.S_IMODE((tmp_path / "mine").stat().st_mode) == 0o600


def test_the_status_shows_the_run_and_its_robots(
    bell: ControlSocket, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["status"]) == 0
    said = capsys.readouterr().out
    now = "run 2 is paused, 12.3 of 60 s, timestep 123, 1 late; 10.0 Hz, capture to sent 16 ms"
    assert said.startswith(f"wander: {now}\n")
    rows = said.splitlines()[3:]
    assert rows[0].split() == ["epuck_23", "23", "0.1.0", "pollutant", "0123456789ab", "12", "ms",
                               "-61", "dBm", "40", "ms", "3.70", "V", "0", "run"]  # fmt: skip
    assert rows[1].split() == ["epuck_24", "24", "-", "-", "never", "-", "-", "-", "-", "not",
                               "connected"]  # fmt: skip
    assert cli.main(["robot", "status", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == STATUS["robots"]


def test_a_reader_that_has_left_ends_nothing(
    bell: ControlSocket, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in `vsense control status | head`."""
    for words in (["status"], ["robot", "status"], ["pause", "--json"], ["stop", "--all"]):
        reader, writer = os.pipe()
        os.close(reader)
        with open(writer, "w") as left, monkeypatch.context() as patched:
            patched.setattr(sys, "stdout", left)
            assert cli.main(words) == 0
        assert capsys.readouterr().err == ""


@pytest.mark.parametrize("kind", ["", TRACKER_SUFFIX])
def test_a_process_that_says_nonsense_is_named_by_its_number(place: Path, kind: str) -> None:
    folder()
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(place / f"7{kind}.sock"))
        other.listen()

        def answer() -> None:
            with other.accept()[0] as line:
                line.recv(4096)
                line.sendall(b"[1]\n")

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        with pytest.raises(terminal.TerminalError, match=r"^process 7 does not answer: its answer"):
            terminal.ask({"ask": "status"}, 7)
        thread.join()


def test_without_an_experiment_it_says_so(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["status"]) == 2
    assert "no experiment runs on this machine" in capsys.readouterr().err
    assert cli.main(["pause", "--process", "12345"]) == 2
    assert "process 12345 runs no experiment; " in capsys.readouterr().err


def test_what_a_killed_process_left_is_cleared_away(place: Path, bell: ControlSocket) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(place / "99999.sock"))
    assert terminal.ask({"ask": "status"})["name"] == "wander"
    assert not (place / "99999.sock").exists()


def test_of_several_one_must_be_named(place: Path, bell: ControlSocket) -> None:
    """Each with its experiment, port and folder, as far as it answers."""
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(place / "7.sock"))
        other.listen()
        own = rf"{os.getpid()} +wander +vsense lab +robots' port 4050 +run 2 paused, 12 s +/runs/x"
        silent = r"7 +does not answer"
        with pytest.raises(UsageError, match=rf"(?s){silent}\n +{own}\nsay which with --process"):
            terminal.ask({"ask": "status"})
        assert terminal.ask({"ask": "status"}, os.getpid())["name"] == "wander"


@pytest.mark.parametrize(
    "line", [b"", b"\n", b"{}", b"[1]", b'{"order": "dance"}', b'{"order": "pause", "value": "x"}',
             b"\xff\xfe", b"{" * 5000,
             b"[" * 4000, b'{"order": "pause", "value": 1e999}', b'{"order": "pause", "value": 1'
             + b"0" * 400 + b"}"]
)  # fmt: skip
def test_nonsense_is_answered_and_harms_nobody(
    bell: ControlSocket, desk: Desk, line: bytes
) -> None:
    with socket.socket(socket.AF_UNIX) as visitor:
        visitor.settimeout(10)
        visitor.connect(str(bell.path))
        visitor.sendall(line + b"\n")
        assert b"neither a question nor an order" in visitor.recv(4096)
    assert desk.orders == []
    assert terminal.ask({"ask": "status"})["name"] == "wander"


def test_whoever_says_nothing_keeps_nobody_waiting(bell: ControlSocket) -> None:
    assert TERMINAL_TIMEOUT_S > 0
    with socket.socket(socket.AF_UNIX) as silent:
        silent.connect(str(bell.path))
        assert terminal.ask({"ask": "status"})["name"] == "wander"


def test_the_folder_is_for_this_user_alone(place: Path, bell: ControlSocket) -> None:
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    place.chmod(0o755)
    with pytest.raises(ControlSocketError, match="others may enter it"):
        folder()
    place.chmod(0o700)


def test_a_folder_of_another_account_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """HOME may still be that of who has called sudo."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "vsense").mkdir(mode=0o700)
    monkeypatch.setattr(os, "getuid", lambda: (tmp_path / "vsense").stat().st_uid + 1)
    with pytest.raises(ControlSocketError, match="another account's: set XDG_RUNTIME_DIR"):
        folder()


def test_the_socket_goes_with_the_process(place: Path, desk: Desk) -> None:
    bell = ControlSocket(lambda: STATUS, desk.give)
    assert bell.path.exists()
    bell.close()
    assert not bell.path.exists()


def test_all_of_several_are_stopped_and_named(
    place: Path, bell: ControlSocket, desk: Desk, capsys: pytest.CaptureFixture[str]
) -> None:
    """The experiment of this process, one that refuses, and the socket of a killed one."""
    other = place / "1.sock"
    with socket.socket(socket.AF_UNIX) as listening, socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(place / "2.sock"))
        listening.bind(str(other))
        listening.listen()
        answer = b'{"error": "the robots cannot be told"}\n'
        idle = b'{"error": "cannot stop: run 1 is not running"}\n'

        def refuse() -> None:
            for said in (answer, answer, idle, idle):
                line, _ = listening.accept()
                with line:
                    line.recv(4096)
                    line.sendall(said)

        thread = threading.Thread(target=refuse, daemon=True)
        thread.start()
        assert cli.main(["stop", "--emergency", "--all"]) == 1
        said = capsys.readouterr().out.splitlines()
        assert cli.main(["stop", "--all"]) == 0, "nothing of it moves"
        thread.join()
    row = capsys.readouterr().out.splitlines()[0]
    assert row.endswith("nothing to stop: cannot stop: run 1 is not running")
    desk.orders.pop()
    assert [order.kind for order in desk.orders] == [OrderKind.EMERGENCY]
    assert said[0].split()[0] == "1" and said[0].endswith("NOT STOPPED: the robots cannot be told")
    assert " ".join(said[1].split()) == (
        f"{os.getpid()} wander vsense lab robots' port 4050 done: emergency"
    )
    other.unlink()
    assert len(said) == 2 and cli.main(["stop", "--all", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {str(os.getpid()): {"text": "done: stop"}}
    assert cli.main(["stop", "--all", "--process", "1"]) == 2


def test_an_emergency_stop_is_that_of_all_that_this_account_runs(
    place: Path,
    bell: ControlSocket,
    desk: Desk,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of two labs both stop, without a question which is meant; another member's does not."""
    lines: list[bytes] = []
    with socket.create_server(str(place / "1.sock"), family=socket.AF_UNIX) as second:

        def answer() -> None:
            with suppress(OSError):
                while True:
                    line, _ = second.accept()
                    with line:
                        lines.append(line.recv(4096))
                        line.sendall(b'{"text": "stopped"}\n')

        threading.Thread(target=answer, daemon=True).start()
        assert cli.main(["stop", "--emergency"]) == 0
        rows = [row.split() for row in capsys.readouterr().out.splitlines()]
        assert [row[0] for row in rows] == ["1", str(os.getpid())]
        assert json.loads(lines[0])["order"] == "emergency"
        assert [order.kind for order in desk.orders] == [OrderKind.EMERGENCY]
        monkeypatch.setattr(terminal, "_is_own", lambda path: path.name != "1.sock")
        lines.clear()
        assert cli.main(["stop", "--emergency"]) == 0
        assert capsys.readouterr().out == "done: emergency\n" and lines == []
        second.shutdown(socket.SHUT_RDWR)


@pytest.mark.parametrize("said", [b"[" * 100_000, b"{}", b'{"text": 1}', b'{"error": []}', b"7"])
def test_nonsense_in_a_stop_hides_no_other_answer(
    place: Path, bell: ControlSocket, said: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(str(place / "1.sock"), family=socket.AF_UNIX) as other:

        def answer() -> None:
            with suppress(OSError):
                while True:
                    line, _ = other.accept()
                    with line:
                        line.recv(4096)
                        line.sendall(said)

        threading.Thread(target=answer, daemon=True).start()
        assert cli.main(["stop", "--emergency", "--all"]) == 1
        rows = capsys.readouterr().out.splitlines()
        assert "NOT STOPPED: does not answer: its answer makes no sense" in rows[0]
        assert rows[1].endswith("done: emergency")
        other.shutdown(socket.SHUT_RDWR)


def test_without_a_session_the_folder_is_where_nobody_else_may_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    session = tmp_path / "session"
    usual = os.lstat
    monkeypatch.setattr(
        os, "lstat", lambda path: usual(session if path == f"/run/user/{os.getuid()}" else path)
    )
    assert folder() == tmp_path / ".cache" / "vsense" / f"run-{socket.gethostname()}"
    session.mkdir()
    assert control_socket._place() == Path(f"/run/user/{os.getuid()}/vsense")


def test_where_nothing_runs_nothing_is_stopped(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["stop", "--emergency", "--all"]) == 2
    assert "no experiment runs on this machine" in capsys.readouterr().err


def test_a_tracker_is_found_where_no_experiment_runs_and_is_never_in_its_way(
    place: Path, desk: Desk, capsys: pytest.CaptureFixture[str]
) -> None:
    """An emergency stop must not have to choose between who moves robots and who does not."""
    rows = {"tag": [7], "x_m": [0.5], "y_m": [-1.0], "yaw_rad": [0.1], "seen": [True]}
    made = {"on": True, "file": "/runs/y/run-1/lab.mcap", "bytes": 3_000_000, "trouble": "No space"}
    run = {**STATUS["run"], "late": None, "recording": made}
    tracked = {"name": "lab", "command": "track", "directory": None, "run": run, "robots": rows}
    tracker = ControlSocket(lambda: tracked, desk.give, TRACKER_SUFFIX)
    assert cli.main(["status"]) == 0
    shown = capsys.readouterr().out
    assert "lab: run 2 is paused" in shown and "late" not in shown
    assert "recording to /runs/y/run-1/lab.mcap, 3.0 MB" in shown
    assert "recording in trouble: No space" in shown
    assert shown.splitlines()[-1].split() == ["7", "0.500", "-1.000", "0.10", "yes"]
    assert cli.main(["robot", "status"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].split()[0] == "7"
    experiment = ControlSocket(lambda: STATUS, desk.give)
    assert terminal.ask({"ask": "status"})["name"] == "wander"
    assert cli.main(["stop", "--emergency"]) == 0
    assert cli.main(["stop", "--process", str(os.getpid())]) == 0
    assert cli.main(["stop", "--emergency", "--all"]) == 0
    assert [order.kind for order in desk.orders] == [
        *(OrderKind.EMERGENCY, OrderKind.STOP, OrderKind.EMERGENCY)
    ]
    experiment.close()
    tracker.close()
    assert cli.main(["status"]) == 2
