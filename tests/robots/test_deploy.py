"""`vsense robot deploy`: lists of robots, what travels, and what boards make of it.

The `ssh` in these tests runs what it is told in a folder that stands for the board, with the
board's own `systemctl` and `id`.
"""

from __future__ import annotations

import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Queue
from types import SimpleNamespace

import pytest

from tests.conftest import require_tool
from tests.rigs.places import ROOT
from tests.rigs.processes import is_alive
from tests.robots import rosters
from tests.robots.rosters import FAKE_DAEMON, deploy, write_program
from vsense import cli
from vsense.commands._rosters import board_of
from vsense.config import roster
from vsense.config.experiment import load
from vsense.config.placement import settle
from vsense.modes.lab._microcontrollers import Microcontrollers
from vsense.robots import deploying
from vsense.robots.link.keys import INSECURE
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import LinkEvent
from vsense.robots.sources import ProgramSources
from vsense.run.environment import Environment
from vsense.run.robots import make_server

WALK = ROOT / "tests" / "system" / "walk.cpp"


def line(fifo: int) -> int:
    """The next number that somebody writes to a pipe."""
    assert select.select([fifo], [], [], 30)[0], "waited in vain for a process"
    return int(os.read(fifo, 100))


def systemd(boards: Path, name: str) -> Path:
    """A board with systemd."""
    (boards / name / "run" / "systemd" / "system").mkdir(parents=True)
    return boards / name


def test_every_robot_gets_its_own_settings(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    left, right = systemd(boards, "root@left"), systemd(boards, "pi@right")
    lines = "root@left tag=23\npi@right tag=24 base=york:/dev/i2c-12 port=4060\n"
    assert deploy(tmp_path, lines) == 0
    assert "host = 10.0.0.1\nport = 4050\nbase = argos:/dev/ttyS0\ntag = 23\n" in (
        (left / "etc/vsensed.conf").read_text()
    )
    assert "host = 10.0.0.1\nport = 4060\nbase = york:/dev/i2c-12\ntag = 24\n" in (
        (right / "etc/vsensed.conf").read_text()
    )
    installed = left / "usr/local/bin/vsensed"
    assert installed.read_bytes() == (tmp_path / "vsensed").read_bytes()
    assert installed.stat().st_mode & 0o777 == 0o755
    calls = (left / "systemctl").read_text().splitlines()
    assert calls == ["daemon-reload", "-q enable vsensed", "stop vsensed", "start vsensed"]
    unit = (left / "etc/systemd/system/vsensed.service").read_text()
    assert "ExecStart=/usr/local/bin/vsensed --config /etc/vsensed.conf\n" in unit
    out = capsys.readouterr().out.splitlines()
    version = "vsensed 9.9, controller test 0123456789ab"
    assert out[1] == f"root@left  23   ok  systemd: {version}"
    assert not list(left.rglob("*.new")), "nothing half-made is left behind"


def test_one_that_fails_keeps_nobody_else_from_working(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    systemd(boards, "good")
    assert deploy(tmp_path, "off tag=1\ngood tag=2\nuser tag=3\n", "--json") == 1
    facts = {row["robot"]: row for row in json.loads(capsys.readouterr().out)}
    assert facts["good"]["ok"]
    assert facts["off"]["text"] == "ssh: connect to host off port 22: No route to host"


@pytest.mark.parametrize("words", [["--check"], ["--rollback"]])
def test_a_dry_run_says_what_would_be_sent_and_reaches_nobody(
    words: list[str], boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = systemd(boards, "board")
    assert deploy(tmp_path, "board tag=7 port=4060\nother tag=8\n", "--dry", *words) == 0
    out = capsys.readouterr().out
    assert "nothing was sent (--dry)" in out and not list(boards.glob("*.told"))
    assert not (board / "etc").exists()
    assert cli.main(["robot", "deploy", "--host", "10.0.0.1", "--base", "argos:/dev/ttyS0",
                     "--insecure", "--dry", "--json", *words]) == 0  # fmt: skip
    first, second = json.loads(capsys.readouterr().out)
    assert (first["robot"], first["tag"], second["tag"]) == ("board", 7, 8)
    if "--rollback" in words:
        assert "the one before" in out and "those before\n" in out and first["settings"] is None
        return
    # It is what the board then has, in every word.
    assert deploy(tmp_path, "board tag=7 port=4060\nother tag=8\n", *words) == 0
    sent = (board / "etc" / "vsensed.conf").read_text().splitlines()[1:]
    assert sent == [f"{name} = {value}" for name, value in first["settings"].items()]
    assert first["vsensed_bytes"] == (board / "usr/local/bin/vsensed").stat().st_size


def test_a_new_experiment_is_brought_to_as_many_robots_as_there_are(
    boards: Path, natively: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["new", "first"]) == 0
    assert cli.main(["robot", "init", "root@192.168.1.30-31"]) == 0
    words = ["--experiment", "first", "--host", "10.0.0.1", "--base", "argos:/dev/ttyS0"]
    words = ["robot", "deploy", *words, "--insecure", "--target", "host", "--dry", "--json"]
    assert cli.main(words) == 2, "its file has ten robots"
    capsys.readouterr()
    assert cli.main([*words, "--robots", "2"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [row["robot"] for row in facts] == ["root@192.168.1.30", "root@192.168.1.31"]
    assert all(row["vsensed_bytes"] > 10_000 and not row["key"] for row in facts)


def test_who_is_not_root_is_told_so(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_program(boards / "pi@board" / "bin" / "id", "echo 1000")
    assert deploy(tmp_path, "pi@board tag=1\n") == 1
    assert "needs root: log in as root, or give --sudo" in capsys.readouterr().out
    assert not (boards / "pi@board" / "etc").exists()
    write_program(boards / "bin" / "sudo", 'shift; PATH="$BOARDS/bin:$PATH" exec "$@"')
    systemd(boards, "pi@board")
    assert deploy(tmp_path, "pi@board tag=1\n", "--sudo") == 0


def test_a_binary_for_another_board_replaces_nothing(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = systemd(boards, "board")
    write_program(board / "usr/local/bin/vsensed", "echo the old one")
    write_program(tmp_path / "vsensed", "kill -ILL $$")
    assert deploy(tmp_path, "board tag=1\n") == 1
    assert "this board cannot run it: built for another target?" in capsys.readouterr().out
    assert "the old one" in (board / "usr/local/bin/vsensed").read_text()


@pytest.mark.parametrize("words", [(), ("--check",)])
def test_settings_that_the_daemon_refuses_replace_nothing(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    """It would end at every start, and the service start it again for ever."""
    board = systemd(boards, "a")
    assert deploy(tmp_path, "a tag=1 watchdog=/dev/watchdog\n") == 0
    before = {p: p.read_bytes() for p in board.rglob("*") if p.is_file()}
    (tmp_path / "vsensed").write_text((tmp_path / "vsensed").read_text() + "# another one\n")
    capsys.readouterr()
    assert deploy(tmp_path, "a tag=1 watchdog=/dev/none\n", *words) == 1
    said = "its settings cannot be used: watchdog: no such device"
    assert said in capsys.readouterr().out
    assert {p: p.read_bytes() for p in board.rglob("*") if p.is_file()} == before


def test_check_tells_what_is_wrong_and_starts_all_the_same(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    systemd(boards, "well")
    sick = systemd(boards, "ill")
    (sick / "sick").touch()
    assert deploy(tmp_path, "well tag=1\nill tag=2\n", "--check") == 1
    out = capsys.readouterr().out
    assert "base     BAD  no answer" in out
    assert (sick / "systemctl").read_text().endswith("stop vsensed\nstart vsensed\n")
    assert "tag = 2" in (sick / "checked").read_text()


def test_init_script_starts_stops_and_starts_again(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = boards / "old"
    environment = {**os.environ, "VSENSED_ROOT": str(board)}
    script = board / "etc/init.d/vsensed"

    def call(word: str) -> int:
        return subprocess.run([script, word], env=environment, timeout=30).returncode

    board.mkdir()
    os.mkfifo(board / "started")
    started = os.open(board / "started", os.O_RDWR)
    try:
        assert deploy(tmp_path, "old tag=1\n") == 0
        first = line(started)
        assert call("status") == 0
        os.kill(first, signal.SIGKILL)
        second = line(started)
        assert second != first, "it is started again when it dies"
        assert deploy(tmp_path, "old tag=1\n") == 0
        third = line(started)
        assert third != second and not is_alive(second)
    finally:
        call("stop")
        os.close(started)
    assert call("status") != 0
    assert "init: vsensed 9.9" in capsys.readouterr().out


def settings(board: Path) -> dict[str, str]:
    text = (board / "etc/vsensed.conf").read_text()
    pairs = (row.split(" = ") for row in text.splitlines() if " = " in row)
    return dict(pairs)


def test_copied_cards_get_an_id_of_their_own(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Their settings came with the card; nothing but the list tells them apart."""
    lines = "".join(f"clone{n} tag={n}\n" for n in range(3)) + "other tag=9\n"
    for n in range(3):
        (systemd(boards, f"clone{n}") / "uid").write_text("c" * 32)
    (systemd(boards, "other") / "uid").write_text("d" * 32)
    assert deploy(tmp_path, lines, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    uids = [row["uid"] for row in facts]
    assert len(set(uids)) == 4 and uids[3] == "d" * 32 and "c" * 32 not in uids
    assert all("it has one of its own now" in row["text"] for row in facts[:3])
    assert [settings(boards / f"clone{n}")["uid"] for n in range(3)] == uids[:3]
    assert [settings(boards / f"clone{n}")["tag"] for n in range(3)] == ["0", "1", "2"]
    assert "uid" not in settings(boards / "other")
    started = (boards / "clone0" / "systemctl").read_text().splitlines()
    assert started[-2:] == ["stop vsensed", "start vsensed"], "it runs with its new id"
    # What was given stays, also with the next daemon.
    (tmp_path / "vsensed").write_text((tmp_path / "vsensed").read_text() + "# newer\n")
    assert deploy(tmp_path, lines, "--json") == 0
    assert [row["uid"] for row in json.loads(capsys.readouterr().out)] == uids
    # And is found again if that card is copied.
    shutil.copy(boards / "clone0/etc/vsensed.conf", boards / "other/etc/vsensed.conf")
    assert deploy(tmp_path, lines, "--json") == 0
    after = [row["uid"] for row in json.loads(capsys.readouterr().out)]
    assert len(set(after)) == 4 and after[1:3] == uids[1:3]


def test_rollback_brings_the_last_daemon_and_its_settings_back(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = systemd(boards, "board")
    binary = board / "usr/local/bin/vsensed"
    assert deploy(tmp_path, "board tag=1\n", "--rollback") == 1
    assert "has no earlier daemon to go back to" in capsys.readouterr().out
    assert deploy(tmp_path, "board tag=1\n") == 0
    first = binary.read_bytes()
    write_program(tmp_path / "vsensed", FAKE_DAEMON.replace("9.9", "10.0"))
    for _ in range(2):  # the same once more is no other daemon
        assert deploy(tmp_path, "board tag=2\n") == 0
    second = binary.read_bytes()
    assert second != first and settings(board)["tag"] == "2"
    for content, tag, version in ((first, "1", "9.9"), (second, "2", "10.0")):
        capsys.readouterr()
        # Neither a daemon nor its settings are needed for that.
        rosters.write(tmp_path, "board tag=1\n")
        assert cli.main(["robot", "deploy", "--rollback"]) == 0
        assert f"systemd: vsensed {version}," in capsys.readouterr().out
        assert binary.read_bytes() == content and settings(board)["tag"] == tag
        assert binary.stat().st_mode & 0o777 == 0o755


def test_a_controller_alone_is_replaced(
    boards: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def build(controller: ProgramSources, target: str, output: Path) -> SimpleNamespace:
        name = controller.sources[0].name
        write_program(output, FAKE_DAEMON.replace("test", f"{name}-{target}"))
        return SimpleNamespace(path=output)

    monkeypatch.setattr("vsense.commands.robot.boards.build", build)
    rosters.write(tmp_path, "board tag=1\n")
    (tmp_path / "mine.c").write_text("")
    words = ["robot", "deploy", "--controller", "mine.c"]
    board = systemd(boards, "board")
    assert cli.main(words) == 1
    assert "has no settings yet: deploy to it once" in capsys.readouterr().out
    assert deploy(tmp_path, "board tag=7 name=seven\n") == 0
    before = {p: p.read_bytes() for p in board.rglob("etc/**/*") if p.is_file()}
    assert cli.main([*words, "--target", "pi-puck"]) == 0
    assert "controller mine.c-pi-puck 0123456789ab" in capsys.readouterr().out
    assert {p: p.read_bytes() for p in before} == before
    assert "mine.c" in (board / "usr/local/bin/vsensed").read_text()
    walk = ["--controller", "walk", "--sources", f"walk={WALK}", "--include", "."]
    (tmp_path / "pace.h").write_text("#define WALK_CM_S 4.0\n")
    assert cli.main([*words[:2], *walk, "--label", "walk_controller"]) == 0
    assert "controller walk.cpp-epuck 0123456789ab" in capsys.readouterr().out
    assert cli.main([*words, "--rollback"]) == 2
    assert "--controller and --rollback: expected one of them" in capsys.readouterr().err


@pytest.fixture
def host() -> Iterator[tuple[VirtualSensorServer, int, Callable[..., LinkEvent]]]:
    """The server of a mixed swarm, its port, and what waits for an event of a kind and a tag."""
    experiment = settle(load("predator_prey"), 1)
    events: Queue[LinkEvent] = Queue()
    tables = Environment(experiment, 1).tables
    server = make_server(experiment, tables, ("127.0.0.1", 0), 1, INSECURE, events.put)

    known: dict[tuple[str, int | None], LinkEvent] = {}

    def wait(kind: str, tag: int) -> LinkEvent:
        while (kind, tag) not in known:
            event = events.get(timeout=60)
            known[event.kind, event.tag] = event
        return known[kind, tag]

    yield server, server.start(), wait
    server.close()


def test_an_experiment_brings_each_robot_its_own_program(
    boards: Path, natively: None, tmp_path: Path, host, capsys: pytest.CaptureFixture[str]
) -> None:
    """Real daemons on two boards with different bases; then one gets the other's program."""
    require_tool("cc", "build-essential")
    server, port, wait = host
    bases = Microcontrollers(["argos", "asercom"])
    predator, prey = 31, 7488
    lines = f"left tag={predator} base={bases.bases[0]}\nright tag={prey} base={bases.bases[1]}\n"
    words = ["--host", "127.0.0.1", "--port", str(port), "--target", "host"]
    for board in ("left", "right"):
        (boards / board).mkdir(parents=True)
    try:
        assert deploy(tmp_path, lines, *words, "--experiment", "predator_prey") == 0
        out = capsys.readouterr().out.splitlines()
        assert "controller predator " in out[1] and "controller prey " in out[2]
        assert "controller predator" in wait("connected", predator).text
        assert "controller prey" in wait("connected", prey).text
        assert {r.controller for r in server.robots().values()} == {"predator", "prey", ""}
        shutil.copy(boards / "left/usr/local/bin/vsensed", tmp_path / "vsensed")
        assert deploy(tmp_path, lines.splitlines()[1], *words, "--force") == 0
        both = r": robot 7488 runs 'predator' \(\w+\), the file says 'prey' \(\w+\)"
        assert re.search(both, wait("refused", prey).text)
        words += ["--experiment", "predator_prey"]
        assert deploy(tmp_path, "right tag=5 spare=true\n", *words) == 2
        assert "has no part for 5: --replace TAG=5 brings one's; its" in capsys.readouterr().err
        line = f"right tag=5 base={bases.bases[1]} spare=true\n"
        assert deploy(tmp_path, line, *words, "--replace", f"{prey}=5", "--force") == 0
        assert "controller prey " in capsys.readouterr().out
    finally:
        bases.close()


# Documentation/networking/proc_net_tcp.rst of Linux: addresses in the processor's order of bytes,
# ports in hexadecimal, the state behind them: 01 is ESTABLISHED, 02 SYN_SENT.
TCP = "   0: 0A01000A:C350 0100000A:{port} {state} 00000000:00000000 00:00000000 00000000     0\n"


# journalctl(1): short-iso begins with the date of ISO 8601.
JOURNAL = """\
2026-11-23T09:01:02+0100 epuck vsensed[7]: vsensed 1: connected: 5 sensors, 0 actuators
2026-11-24T14:02:33+0100 epuck vsensed[7]: vsensed 1: connected: 5 sensors, 0 actuators
2026-11-24T14:02:34+0100 epuck vsensed[7]: vsensed 1: wheels free"""


@pytest.mark.parametrize(
    ("port", "state", "busy"),
    [("0FD2", "01", True), ("0FD2", "02", False), ("0FD3", "01", False), ("0016", "01", False)],
)
def test_a_robot_in_an_experiment_is_left_alone(
    boards: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    port: str,
    state: str,
    busy: bool,
) -> None:
    board = systemd(boards, "board")
    write_program(boards / "bin" / "journalctl", f"echo '{JOURNAL}'")
    assert deploy(tmp_path, "board tag=1\n") == 0
    (board / "proc/net").mkdir(parents=True)
    head = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid\n"
    (board / "proc/net/tcp").write_text(head + TCP.format(port=port, state=state))
    for words in (["--rollback"], []):
        calls = len((board / "systemctl").read_text().splitlines())
        assert deploy(tmp_path, "board tag=2\n", *words) == (1 if busy or words else 0)
        if busy:
            text = (
                "robot 1 is in use by 10.0.0.1 since 2026-11-24 14:02: end that run there, or give"
            )
            assert text in capsys.readouterr().out
            assert settings(board)["tag"] == "1"
            assert len((board / "systemctl").read_text().splitlines()) == calls
    assert deploy(tmp_path, "board tag=2\n", "--force") == 0
    assert settings(board)["tag"] == "2"


# What OpenSSH 9.2 writes: sshconnect.c, kex.c and sshkey.c of its source.
NO_HOST_KEY = (
    "Unable to negotiate with 10.0.0.7 port 22: no matching host key type found. Their offer:"
    " ssh-rsa,ssh-dss"
)


@pytest.mark.parametrize(
    ("said", "way_out"),
    [
        ("Host key verification failed.", "--ssh-option StrictHostKeyChecking=accept-new"),
        (
            NO_HOST_KEY,
            "--ssh-option HostKeyAlgorithms=+ssh-rsa,ssh-dss"
            " --ssh-option PubkeyAcceptedAlgorithms=+ssh-rsa,ssh-dss",
        ),
        (
            NO_HOST_KEY.replace("host key type", "key exchange method").replace(
                "ssh-rsa,ssh-dss", "diffie-hellman-group1-sha1"
            ),
            "--ssh-option KexAlgorithms=+diffie-hellman-group1-sha1",
        ),
        (NO_HOST_KEY.replace("host key type", "cipher"), "--ssh-option Ciphers=+ssh-rsa"),
        (NO_HOST_KEY.replace("host key type", "MAC"), "--ssh-option MACs=+ssh-rsa"),
        (
            "@ WARNING: REMOTE HOST IDENTIFICATION HAS CHANGED! @\nHost key verification failed.",
            "ssh-keygen -R board",
        ),
        ("Bad server host key: Invalid key length", "--ssh-option RequiredRSASize=1024"),
        ("pi@board: Permission denied (publickey).", "ssh-copy-id pi@board"),
    ],
)
def test_what_ssh_refuses_comes_with_the_way_out(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], said: str, way_out: str
) -> None:
    write_program(tmp_path / "path" / "ssh", f"cat <<'END' >&2\n{said}\nEND\nexit 255")
    assert deploy(tmp_path, "pi@board tag=1\n") == 1
    out = capsys.readouterr().out
    assert f"FAILED  {said.splitlines()[-1]}: " in out and way_out in out


def test_ssh_is_told_the_options(boards: Path, tmp_path: Path) -> None:
    write_program(tmp_path / "path" / "ssh", 'echo "$@" >>"$BOARDS/ssh"; exit 255')
    words = ["--ssh-option", "HostKeyAlgorithms=+ssh-rsa", "--ssh-option", "MACs=+hmac-md5"]
    words += ["--roster", "robots.toml", "--service", "init", "--binary", "vsensed"]
    assert deploy(tmp_path, "board tag=1\n", *words) == 1
    expected = "-o HostKeyAlgorithms=+ssh-rsa -o MACs=+hmac-md5 board d=$(mktemp"
    assert expected in (boards / "ssh").read_text()


def init_board(boards: Path, name: str) -> tuple[Path, Callable[[str], int]]:
    """A board without systemd, and its init script."""
    board = boards / name
    board.mkdir()
    script = board / "etc/init.d/vsensed"
    environment = {**os.environ, "VSENSED_ROOT": str(board)}
    return (
        board,
        lambda word: subprocess.run([script, word], env=environment, timeout=30).returncode,
    )


def test_init_script_leaves_the_owner_of_a_stale_pid_alone(boards: Path, tmp_path: Path) -> None:
    board, call = init_board(boards, "old")
    assert deploy(tmp_path, "old tag=1\n") == 0
    call("stop")
    # After a power failure: whoever has these numbers now, even with such a name.
    bystanders = [
        subprocess.Popen(["sleep", "600"]),
        subprocess.Popen(["sh", "-c", "sleep 600; : vsensed"], start_new_session=True),
    ]
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        for name, one in zip(("loop", "loop.child"), bystanders):
            birth = Path(f"/proc/{one.pid}/stat").read_text().rsplit(")", 1)[1].split()[19]
            for content in (f"{one.pid}\n", f"{one.pid} {boot} 1\n", f"{one.pid} other {birth}\n"):
                (board / f"var/run/vsensed.{name}").write_text(content)
                assert call("status") != 0
                call("stop")
                assert is_alive(one.pid)
                assert not (board / f"var/run/vsensed.{name}").exists()
    finally:
        for one in bystanders:
            os.kill(one.pid, signal.SIGKILL) if one is bystanders[0] else os.killpg(one.pid, 9)
            one.wait()


def text_of(path: Path) -> str:
    """What a file holds; nothing while it is not there."""
    try:
        return path.read_text()
    except FileNotFoundError:
        return ""


def test_log_of_the_init_script_is_bounded(boards: Path, tmp_path: Path) -> None:
    board, call = init_board(boards, "old")
    write_program(
        tmp_path / "vsensed",
        FAKE_DAEMON.replace("exec sleep", "seq -f 'line %.0f' 5000 >&2; exec sleep"),
    )
    try:
        assert deploy(tmp_path, "old tag=1\n") == 0
        log = board / "var/log/vsensed.log"
        end = time.monotonic() + 30
        # Between one log and the next there is none for a moment.
        while "line 5000" not in text_of(log) and time.monotonic() < end:
            select.select([], [], [], 0.02)
        logs = [log.read_text(), log.with_suffix(".log.1").read_text()]
        assert logs[0].endswith("line 5000\n") and logs[1].startswith("line 4401\n")
        assert sum(text.count("\n") for text in logs) <= 800
    finally:
        call("stop")


def test_unit_never_gives_up() -> None:
    unit = deploying.service_files()["vsensed.service"].decode()
    sections = dict(re.findall(r"^\[(\w+)\]\n(.*?)(?=^\[|\Z)", unit, re.M | re.S))
    # systemd.unit(5): "set to 0 to disable any kind of rate limiting"; before version 230 the
    # setting had another name and place (its NEWS file).
    assert "StartLimitIntervalSec=0\n" in sections["Unit"]
    assert (
        "StartLimitInterval=0\n" in sections["Service"] and "Restart=always" in sections["Service"]
    )


def test_ctrl_c_ends_all_connections(boards: Path, tmp_path: Path) -> None:
    rosters.write(tmp_path, "slow tag=1\n")
    os.mkfifo(boards / "slow.pid")
    slow = os.open(boards / "slow.pid", os.O_RDWR)
    shutil.copy2("/bin/true", tmp_path / "real")
    words = ["--host", "10.0.0.1", "--base", "argos:x"]
    words += ["--binary", "real", "--insecure"]
    process = subprocess.Popen(
        [sys.executable, "-m", "vsense", "robot", "deploy", *words],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(cli.__file__).parent.parent)},
        # Whoever starts the tests in the background has them ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    ssh = line(slow)
    os.close(slow)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130 and said.endswith("vsense: interrupted\n")
    assert not is_alive(ssh)


def test_what_is_known_of_a_robot_goes_into_its_settings(tmp_path: Path) -> None:
    spans = "80:1500,81:1400,82:1450,83:1500,84:1500,85:1500,86:1500,87:1500"
    own = "tag=1 name=left battery_stop_mv=3400 watchdog=/dev/watchdog run_host=10.0.0.9"
    path = rosters.write(tmp_path, f"a {own}\n")
    path.write_text(
        f"{path.read_text()}[robot.calibration]\nwheel_ratio = 1.004\naxle_length_mm = 53.4\n"
        f'proximity_scale = "{spans}"\nwhen = 2026-11-23\n'
    )
    lab = roster.read(path)
    lines = deploying.settings_text(board_of(lab, lab.robots[0]).settings).splitlines()
    assert set(lines[1:]) == {
        "tag = 1",
        "name = left",
        "host = 10.0.0.9",
        "battery-stop-mv = 3400",
        "watchdog = /dev/watchdog",
        "wheel-ratio = 1.004",
        "axle-length = 53.4",
        f"proximity-scale = {spans}",
    }


def test_robots_that_are_out_of_order_are_left_out_unless_they_are_named(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b"):
        systemd(boards, name)
    lines = "a tag=1 spare=true\nb tag=2 out_of_order=no~wheel\n"
    assert deploy(tmp_path, lines) == 0
    said = capsys.readouterr()
    assert "robot 2 is left out: out of order: no wheel (--tags 2 brings it in)" in said.err
    assert [row.split()[:2] for row in said.out.splitlines()[1:]] == [["a", "1"]]
    assert deploy(tmp_path, lines, "--tags", "2") == 0
    assert [row.split()[:2] for row in capsys.readouterr().out.splitlines()[1:]] == [["b", "2"]]
    assert deploy(tmp_path, lines, "--tags", "3") == 2
    assert "--tags 3: robots.toml has 1, 2" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--base", "x"], "robots.toml:1: no host for this robot: add run_host = "),
        (["--host", "h", "--base", "x"], "--host: expected a numeric IPv4 address, got 'h'"),
        (["--host", "10.0.0.1"], "robots.toml:1: no base for this robot"),
        (["--host", "10.0.0.1", "--base", "x", "--port", "0"], "--port: expected 1 to 65535"),
        (["--host", "10.0.0.1", "--base", "x", "--binary", "no"], "make it with: vsense robot"),
        (["--host", "10.0.0.1", "--base", "x", "--binary", "robots.toml"], "is no program"),
    ],
)
def test_what_is_missing_is_told_before_anything_is_sent(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    text: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    rosters.write(tmp_path, "a tag=1\n")
    shutil.copy2("/bin/true", tmp_path / "vsensed")
    assert cli.main(["robot", "deploy", *words]) == 2
    assert text in capsys.readouterr().err


def test_no_ssh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy2("/bin/true", tmp_path / "vsensed")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert deploy(tmp_path, "a tag=1\n") == 1
    assert "apt install openssh-client" in capsys.readouterr().err


def test_power_saving_is_turned_off_and_stays_off(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With iw (its power_save command), else iwconfig(8); a board with neither is told, no more."""
    new, old, bare = (systemd(boards, name) for name in ("new", "old", "bare"))
    systemd(boards, "cable")
    for board in (new, old, bare):
        (board / "sys/class/net/wlan97/wireless").mkdir(parents=True)
    (new / "sys/class/net/wlan97/phy80211").mkdir()
    (new / "etc/NetworkManager/conf.d").mkdir(parents=True)
    write_program(new / "bin/iw", 'echo "$@" >>"$VSENSED_ROOT/asked"')
    write_program(old / "bin/iw", "exit 237")  # a driver without nl80211
    write_program(old / "bin/iwconfig", 'echo "$@" >>"$VSENSED_ROOT/asked"')
    assert deploy(tmp_path, "new tag=1\nold tag=2\nbare tag=3\ncable tag=4\n", "--json") == 0
    told = {row["robot"]: row for row in json.loads(capsys.readouterr().out)}
    assert (new / "asked").read_text() == "dev wlan97 set power_save off\n"
    assert (old / "asked").read_text() == "wlan97 power off\n"
    for name in ("new", "old"):
        assert "radio: power saving of wlan97 is off" in told[name]["details"]
        assert "power saving" not in told[name]["text"]
    assert told["bare"]["ok"] and "power saving of wlan97 stays as it is" in told["bare"]["text"]
    assert "radio: this board has no Wi-Fi" in told["cable"]["details"]
    # NetworkManager.conf(5) and nm-settings(5): 2 disables it at every connection.
    kept = new / "etc/NetworkManager/conf.d/vsensed-powersave.conf"
    assert kept.read_text() == "[connection]\nwifi.powersave = 2\n"
    unit = (new / "etc/systemd/system/vsensed.service").read_text()
    assert "ExecStartPre=-/bin/sh /usr/local/sbin/vsensed-radio\n" in unit
    assert (new / "usr/local/sbin/vsensed-radio").stat().st_mode & 0o777 == 0o755
