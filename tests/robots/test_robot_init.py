"""`vsense robot init`: the roster from boards that answer, markers that are seen, or a number.

The `ssh` is that of `boards`: a folder for each board.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from vsense import cli
from vsense.commands import robot_init
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
    assert "root@off does not answer: ssh: connect to host root@off port 22: No route" in err
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
    assert (left.name, left.host) == ("left", "") and (right.name, right.host) == (
        "right",
        "pi@right",
    )
    before = (tmp_path / "lab.toml").read_bytes()
    assert init("--add", "right", "--roster", "lab.toml") == 2, "two of one name"
    assert "name right is that of the robot in line" in capsys.readouterr().err
    assert init("--add", "x", "a", "b", "--roster", "lab.toml") == 2
    assert "--add: 2 hosts are given: expected one at most" in capsys.readouterr().err
    assert (tmp_path / "lab.toml").read_bytes() == before


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
