"""`vsense robot init`: the roster from boards that answer, markers that are seen, or a number.

The `ssh` is that of `boards`: a folder for each board.
"""

from __future__ import annotations

import io
import json
import os
import select
import shlex
import time
import tty
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest

from scripts.site.blocks import blocks
from tests.rigs.places import ROOT
from tests.robots.rig import Rig
from vsense import cli
from vsense.commands import _first_contact, robot_init
from vsense.config import roster
from vsense.vision.markers.families import load_family, ranked_tags

APART = ranked_tags(load_family("arrow4x4"), 12)
CONF = "# Settings of vsensed\nhost = 10.0.0.1\nbase = pipuck,ground\ntag = 40\nname = blue\n"


def init(*words: str) -> int:
    return cli.main(["robot", "init", *words])


def tags(path: Path) -> list[int]:
    return [robot.tag for robot in roster.read(path).robots]


def has_settings(boards: Path, host: str, text: str = CONF) -> None:
    (boards / host / "etc").mkdir(parents=True)
    (boards / host / "etc" / "vsensed.conf").write_text(text)


def test_a_roster_without_boards_has_the_tags_of_experiments_without_any(boards, tmp_path) -> None:
    assert init("--robots", "4") == 0
    path = tmp_path / "robots.toml"
    assert tags(path) == APART[:4]
    # What is there stays as it is, with its comments; the tags go on.
    path.write_text(path.read_text().replace("[[robot]]", "[[robot]] # mine", 1))
    assert init("--robots", "6") == 0 and tags(path) == APART[:6]
    assert "[[robot]] # mine\n" in path.read_text()
    before = path.read_bytes()
    assert init("--robots", "6") == 0 and path.read_bytes() == before


def test_boards_that_answer_tell_their_settings(boards, tmp_path, capsys) -> None:
    has_settings(boards, "root@10.0.0.31")
    assert init("root@10.0.0.30-32", "root@off", "--json", "--base", "argos:/dev/ttyS0") == 0
    out, err = capsys.readouterr()
    new = json.loads(out)["new"]
    known = {"tag": 40, "host": "root@10.0.0.31", "name": "blue"}
    assert {k: v for k, v in new[1].items() if k in known} == known
    assert [row["tag"] for row in new] == [APART[0], 40, *APART[1:3]]
    # An option is for all new robots; of what a board says it is the newer word.
    assert {row["base"] for row in new} == {"argos:/dev/ttyS0"}
    # Who does not answer is in it all the same: it was named.
    assert "root@off does not answer, and is written in unasked: ssh: connect to host" in err
    read = roster.read(tmp_path / "robots.toml").robots
    assert [robot.host for robot in read[:3]] == [f"root@10.0.0.{n}" for n in (30, 31, 32)]
    assert init("root@10.0.0.31") == 0
    assert "root@10.0.0.31 is in the roster already" in capsys.readouterr().err


def test_of_neighbours_those_that_answer_are_taken(boards, tmp_path, monkeypatch, capsys) -> None:
    table = tmp_path / "arp"
    head = "IP address       HW type     Flags       HW address            Mask     Device\n"
    row = "{:17}0x1         {}         aa:aa:aa:aa:aa:aa     *        wlan0\n"
    rows = [("10.0.0.7", "0x2"), ("10.0.0.8", "0x0"), ("off", "0x2")]
    table.write_text(head + "".join(row.format(*cells) for cells in rows))
    monkeypatch.setattr(robot_init, "NEIGHBOURS", table)
    assert robot_init.neighbours() == ["10.0.0.7", "off"]
    assert init() == 0
    assert [robot.host for robot in roster.read(tmp_path / "robots.toml").robots] == [
        "root@10.0.0.7"
    ]
    assert "off" not in capsys.readouterr().err
    assert init() == 0, "nobody else is there, and the lab has robots"
    assert "no other board on this network answers ssh as root" in capsys.readouterr().err


def test_nothing_to_be_found_makes_no_file(boards, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(robot_init, "NEIGHBOURS", tmp_path / "none")
    assert init() == 1 and not (tmp_path / "robots.toml").exists()


def test_one_robot_is_added_by_name(boards, tmp_path, capsys) -> None:
    assert init("--add", "left", "--roster", "lab.toml") == 0
    assert init("--add", "right", "pi@right", "--roster", "lab.toml") == 0
    left, right = roster.read(tmp_path / "lab.toml").robots
    assert (left.name, left.host, right.name, right.host) == ("left", "", "right", "pi@right")
    before = (tmp_path / "lab.toml").read_bytes()
    assert init("--add", "right", "--roster", "lab.toml") == 2, "two of one name"
    assert "name right is that of the robot in line" in capsys.readouterr().err
    for more in (["a", "b"], ["--robots", "3"]):
        assert init("--add", "x", *more, "--roster", "lab.toml") == 2
        assert "--add adds one robot" in capsys.readouterr().err
    assert init("--add", "x", "pi@right", "--roster", "lab.toml") == 0
    assert "pi@right is in the roster already" in capsys.readouterr().err
    assert (tmp_path / "lab.toml").read_bytes() == before


def test_robots_of_a_rehearsal_are_given_their_boards(boards, tmp_path, capsys) -> None:
    path = tmp_path / "robots.toml"
    assert init("--robots", "3") == 0
    path.write_text(path.read_text().replace("[[robot]]", "[[robot]] # mine", 1))
    # A board that tells a tag is that robot; the others are the first ones.
    has_settings(boards, "root@b", CONF.replace("tag = 40", f"tag = {APART[0]}"))
    assert init("root@a", "root@b", "root@c", "root@d", "--base", "pipuck") == 0
    assert f"4 robots, 1 new: {APART[3]}, 3 have a host now" in capsys.readouterr().out
    robots = roster.read(path).robots
    assert [robot.tag for robot in robots] == APART[:4]
    assert [robot.host for robot in robots] == ["root@b", "root@a", "root@c", "root@d"]
    assert robots[0].name == "blue" and {robot.base for robot in robots} == {"pipuck"}
    assert "[[robot]] # mine" in path.read_text()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("tag = 5 # comment", "expected a whole number"),
        ("tag = 70000", "expected a whole number from 0 to 65535"),
        (f"tag = {'9' * 6000}", "expected a whole number"),
        ('name = a"b', "expected a text without blanks"),
        ("name = a\x1b[31mb", "expected text without control characters"),
        ("base = $(reboot)", "expected a base of vsensed"),
        ("uid = 12", "expected the 32 hexadecimal digits"),
        ("tag = 40", "root@good has it, too"),
        ("name = blue", "root@good has it, too"),
    ],
)
def test_what_a_board_says_of_itself_and_cannot_be_costs_that_setting_alone(
    line: str, why: str, boards, tmp_path, capsys
) -> None:
    has_settings(boards, "root@good")
    has_settings(boards, "root@odd", f"{line}\n")
    assert init("root@good", "root@odd", "root@fine") == 0
    err = capsys.readouterr().err
    assert f"root@odd: its {line.split()[0]} is left out" in err and why in err
    robots = roster.read(tmp_path / "robots.toml").robots
    assert [(robot.host, robot.tag) for robot in robots] == [
        ("root@good", 40),
        ("root@odd", APART[0]),
        ("root@fine", APART[1]),
    ]


def test_a_name_in_any_script_is_kept(boards, tmp_path) -> None:
    has_settings(boards, "root@odd", "name = 🤖é\n")
    assert init("root@odd") == 0
    assert roster.read(tmp_path / "robots.toml").robots[0].name == "🤖é"


@pytest.mark.parametrize("text", ["", "# none yet\n", '[defaults]\nbase = "pipuck"\n', "\r\n"])
def test_a_roster_that_names_no_robot_yet_is_extended(text: str, boards, tmp_path) -> None:
    path = tmp_path / "robots.toml"
    path.write_text(text)
    assert init("--robots", "2") == 0 and tags(path) == APART[:2]
    assert text.strip() in path.read_text()


def test_an_inline_array_is_refused_in_words(boards, tmp_path, capsys) -> None:
    path = tmp_path / "robots.toml"
    path.write_text("robot = [{tag = 1}]\n")
    assert init("--robots", "2") == 2
    assert "its robots are an inline array: write each as a table" in capsys.readouterr().err
    assert path.read_text() == "robot = [{tag = 1}]\n"


def test_two_that_begin_a_roster_at_once_lose_nothing(boards, tmp_path) -> None:
    with ThreadPoolExecutor(8) as pool:
        made = pool.map(
            lambda n: roster.extend(tmp_path / "robots.toml", [{"tag": n}], robot_init.HEAD),
            range(8),
        )
        assert len(list(made)) == 8
    assert sorted(tags(tmp_path / "robots.toml")) == list(range(8))


def test_more_robots_than_are_well_apart_wear_whatever_is_free(boards, tmp_path, capsys) -> None:
    assert init("--robots", "300") == 0
    assert len(set(tags(tmp_path / "robots.toml"))) == 300
    assert init("--robots", "60", "--family", "aruco_4x4_50", "--roster", "few.toml") == 2
    assert "the family aruco_4x4_50 has 50 markers" in capsys.readouterr().err
    assert not (tmp_path / "few.toml").exists()


@pytest.mark.parametrize("host", ["10.0.0.40-30", "10.0.0.1-256", "-o", "a b", "root@$(reboot)"])
def test_what_is_no_host_is_refused(host: str, boards, tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        init("--", host)
    assert ended.value.code == 2 and "expected" in capsys.readouterr().err
    assert not (tmp_path / "robots.toml").exists()


def test_markers_that_cameras_see_come_first(boards, tmp_path, capsys) -> None:
    frames = str(tmp_path / "frames")
    assert cli.main(["render", "foraging", frames, "--frames", "8", "--format", "pgm"]) == 0
    (tmp_path / "robots.toml").write_text("[[robot]]\ntag = 31\n")
    files = f"{frames}/resources.xml", f"{frames}/experiment.xml"
    assert init("--robots", "3", "--tracking", *files) == 0
    # Of foraging's robots, 31 is in the roster.
    assert tags(tmp_path / "robots.toml") == [31, 1843, 4334]
    err = capsys.readouterr().err
    assert "the cameras see 31 1843 4334" in err and "robot check EXPERIMENT --wiggle" in err


def test_cameras_that_give_no_picture_write_nothing(boards, tmp_path, monkeypatch, capsys) -> None:
    frames = str(tmp_path / "frames")
    assert cli.main(["render", "foraging", frames, "--frames", "1", "--format", "pgm"]) == 0
    monkeypatch.setattr(robot_init, "LOOK_NS", 0)
    files = f"{frames}/resources.xml", f"{frames}/experiment.xml"
    assert init("--robots", "3", "--tracking", *files) == 1
    assert "no camera gave a picture; nothing is written" in capsys.readouterr().err
    assert not (tmp_path / "robots.toml").exists()


class Terminal(io.StringIO):
    """Somebody who types these lines."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "robots.toml"


@contextmanager
def living(rig: Rig) -> Iterator[None]:
    """An emulated robot that lives by itself."""
    over = Event()

    def live() -> None:
        while not over.is_set():
            rig.live()

    thread = Thread(target=live)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_first_contact_with_a_robot_without_a_board(
    alone: Path, rigs: Callable[..., Rig], capsys: pytest.CaptureFixture[str]
) -> None:
    rig = rigs(kind="wifi")
    words = ("--add", "red", "--model", "epuck2", "--address", rig.device, "--tag", "23")
    with living(rig):
        assert init(*words, "--wiggle") == 0
    said = capsys.readouterr().err
    assert "robot 23 (red): wiggle   ok   left wheel -" in said
    assert 'in the experiment it is <e-puck vs:model="epuck2">' in said
    (robot,) = roster.read(alone).robots
    assert (robot.tag, robot.name, robot.base) == (23, "red", f"wifi:{rig.device}")
    assert robot.model == "epuck2"
    assert {a.left_steps_s for a in rig.applied} == {0, -200, 200}


def test_first_contact_asks_a_person(
    alone: Path, rigs: Callable[..., Rig], monkeypatch: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = rigs(kind="wifi")
    monkeypatch.setattr("sys.stdin", Terminal(f"epuck2\n{rig.device}\n\n"))
    with living(rig):
        assert init("--add", "red") == 0
    said = capsys.readouterr().err
    assert "Which robot is it: epuck, pipuck, epuck2," in said
    assert "Where is it: its own address on the Wi-Fi, such as 192.168.1.40: " in said
    assert f"Which marker does it wear [{APART[0]}]: " in said
    (robot,) = roster.read(alone).robots
    assert (robot.tag, robot.base) == (APART[0], f"wifi:{rig.device}")
    assert {a.left_steps_s for a in rig.applied} == {0}, "it was asked without moving"
    monkeypatch.setattr("sys.stdin", Terminal("\n"))
    assert init("--add", "blue") == 2, "an address has no usual one"
    assert len(roster.read(alone).robots) == 1


def test_first_contact_says_what_fails_and_keeps_what_was_told(
    alone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--add", "red", "--model", "epuck2", "--address", "127.0.0.1:9")
    assert init(*words) == 1
    assert "base     BAD  wifi on 127.0.0.1:9: nobody answers" in capsys.readouterr().err
    assert [robot.name for robot in roster.read(alone).robots] == ["red"]
    assert init("--model", "epuck2") == 2 and init("--wiggle", "--robots", "3") == 2
    assert "expected --add NAME, too" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("script", "code", "words"),
    [
        (r"printf '\n\377\nbase     ok   here\n'", 0, "base     ok   here"),
        ("exec sleep 60", 1, "BAD  the check has not ended within 0.5 s"),
    ],
)
def test_a_check_may_say_anything_or_nothing(
    script: str,
    code: int,
    words: str,
    alone: Path,
    tmp_path: Path,
    monkeypatch: Any,
    capsys: pytest.CaptureFixture[str],
) -> None:
    daemon = tmp_path / "daemon"
    daemon.write_text(f"#!/bin/sh\n{script}\n")
    daemon.chmod(0o755)
    monkeypatch.setattr(_first_contact.build, "daemon", lambda _: daemon)
    monkeypatch.setattr(_first_contact, "CHECK_S", 0.5)
    assert init("--add", "red", "--base", "exec:mine.py", "--tag", "1") == code
    assert f"robot 1 (red): {words}" in capsys.readouterr().err


PAGE = ROOT / "robot" / "WHICH_ROBOT.md"


class RoverFirmware(Thread):
    """The page's rover behind its cable: `speed LEFT RIGHT` in mm/s, two ticks a millimetre."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._line, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.device, self.over = os.ttyname(self._slave), False
        self.speeds = [(0, 0)]

    def run(self) -> None:
        ticks, since_s, data = [0.0, 0.0], time.monotonic(), b""
        while not self.over:
            if not select.select([self._line], [], [], 0.05)[0]:
                continue
            data += os.read(self._line, 4096)
            *lines, data = data.split(b"\n")
            for line in lines:
                now_s = time.monotonic()
                ticks = [t + 2 * v * (now_s - since_s) for t, v in zip(ticks, self.speeds[-1])]
                since_s = now_s
                left, right = map(int, line.split()[1:])
                self.speeds.append((left, right))
                os.write(self._line, b"ticks %d %d 7400\n" % (ticks[0], ticks[1]))
        os.close(self._line)
        os.close(self._slave)


def test_a_robot_of_ones_own_in_an_afternoon(
    alone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page, typed: its driver, model, experiment and commands; only the cable is emulated."""
    pytest.importorskip("serial", reason="pip install vsense[thymio]")
    section = PAGE.read_text().partition("\n## A robot of your own in an afternoon\n")[2]
    files = {block.file: block.text for block in blocks(section) if block.file}
    assert list(files) == ["rover.py", "rover.toml", "rover.argos", "wander.py"]
    for name, text in files.items():
        (alone.parent / name).write_text(text)
    shell = [command for block in blocks(section) for command in block.commands()]
    sim, lab, meet = (shlex.split(command)[1:] for command in shell)
    assert cli.main([*sim, "--duration", "5", "--output", "sim"]) == 0
    assert cli.main([*lab, "--duration", "5", "--port", "0", "--output", "lab"]) == 0
    rover = RoverFirmware()
    rover.start()
    try:
        assert cli.main([word.replace("/dev/ttyUSB0", rover.device) for word in meet]) == 0
    finally:
        rover.over = True
        rover.join()
    said = capsys.readouterr().err
    assert "robot 23 (rover): base     ok" in said and "robot 23 (rover): wiggle   ok" in said
    turned = [pair for pair in dict.fromkeys(rover.speeds) if any(pair)]
    # 200 steps of 0.129 mm a second, cut to whole millimetres
    assert turned == [(-25, 25), (25, -25)] and rover.speeds[-1] == (0, 0)


def test_a_robot_with_a_board_does_not_turn_from_here(
    boards: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert init("--add", "old", "--model", "epuck", "--address", "root@10.0.0.9") == 0
    (robot,) = roster.read(Path("robots.toml")).robots
    assert (robot.host, robot.base) == ("root@10.0.0.9", "")
    assert init("--add", "older", "root@10.0.0.10", "--wiggle") == 2
    assert "has a board, which drives it: vsense robot deploy first" in capsys.readouterr().err
