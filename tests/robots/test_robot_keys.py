"""`vsense robot keys`: the swarm's keys, what travels to boards, and who has which."""

from __future__ import annotations

import argparse
import json
import re
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.robots import rosters
from tests.robots.rosters import deploy, write_program
from vsense import cli
from vsense.base.errors import ConfigError, UsageError, VsenseError
from vsense.base.sharing import NotMember
from vsense.commands import robot_emulate, robot_keys
from vsense.robots import key_holders
from vsense.robots.deploying import Outcome, Part, Plan, RobotHost
from vsense.robots.link import keys
from vsense.robots.link.keys import LinkTrust, SwarmKeys

FOUR = "root@a tag=1\nroot@b tag=2\nroot@c tag=3\nroot@d tag=4 uid=" + "7" * 32 + "\n"

KEYED_DAEMON = """
case "$1" in
    --version) echo "vsensed 9.9, controller test 0123456789ab" ;;
    --identify)
        key=$VSENSED_ROOT/etc/vsensed.key
        grep -q "^key = /etc/vsensed.key" "$3" || exit 2
        [ "$(stat -c %a "$key")" = 600 ] || exit 2
        echo "$(sed -n 's/^uid = //p' "$key") from the file of its key" ;;
    --config) exec sleep 600 ;;
esac
"""


@pytest.fixture
def file(tmp_path: Path, boards: Path) -> Path:
    write_program(tmp_path / "vsensed", KEYED_DAEMON)
    return tmp_path / "lab" / "swarm.key"


def ask(*words: str) -> int:
    return cli.main(["robot", "keys", *words])


def key_of(board: Path) -> dict[str, str]:
    """What a board's file of its key says."""
    file = board / "etc/vsensed.key"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    return dict(line.split(" = ") for line in file.read_text().splitlines())


def test_one_command_makes_the_first_key(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ask("--key", str(file)) == 2
    assert "no swarm key" in capsys.readouterr().err and not file.exists()
    assert ask("--key", str(file), "--new-key") == 0
    assert capsys.readouterr().out == f"{file} holds key 1; robots are brought key 1\n"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert len(keys.read(file).keys[1]) == 32


def test_each_robot_gets_its_own_and_keeps_its_uid(
    file: Path, boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask("--key", str(file), "--new-key")
    assert deploy(tmp_path, FOUR, "--key", str(file)) == 0
    swarm = keys.read(file)
    had = {name: key_of(boards / f"root@{name}") for name in "abcd"}
    assert (
        len({one["uid"] for one in had.values()}) == len({one["key"] for one in had.values()}) == 4
    )
    assert had["d"]["uid"] == "7" * 32
    for one in had.values():
        assert bytes.fromhex(one["key"]) == swarm.robot_key(bytes.fromhex(one["uid"]))
        settings = (boards / "root@d/etc/vsensed.conf").read_text()
        assert "key = /etc/vsensed.key" in settings and "uid" not in settings
    assert deploy(tmp_path, FOUR, "--key", str(file)) == 0
    assert {name: key_of(boards / f"root@{name}") for name in "abcd"} == had
    said = capsys.readouterr()
    told = "".join(path.read_text() for path in boards.glob("*.told"))
    for one in had.values():
        assert one["key"] not in said.out + said.err + told
        assert one["uid"] in (file.parent / "swarm.key.robots").read_text()


def test_a_new_key_names_whom_it_did_not_reach_and_locks_nobody_out(
    file: Path, boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask("--key", str(file), "--new-key")
    assert deploy(tmp_path, FOUR, "--key", str(file)) == 0
    before = {name: key_of(boards / f"root@{name}") for name in "ab"}
    rosters.write(tmp_path, "root@a tag=1\nroot@off tag=2\n")
    capsys.readouterr()
    assert ask("--key", str(file), "--new-key", "--roster", "robots.toml") == 1
    out = capsys.readouterr().out
    assert "holds key 1, 2; robots are brought key 2" in out
    assert "root@off, tag 2: ssh: connect to host root@off port 22: No route to host" in out
    for tag, name in ((2, "b"), (3, "c"), (4, "d")):
        assert f"robot {tag} (root@{name}) was not reached with key 2: the host still takes" in out
    swarm, now = keys.read(file), key_of(boards / "root@a")
    assert now["uid"] == before["a"]["uid"] and now["key"] != before["a"]["key"]
    assert bytes.fromhex(now["key"]) == swarm.robot_key(bytes.fromhex(now["uid"]), 2)
    uid = bytes.fromhex(before["b"]["uid"])
    roots = [(number, root) for number, root in LinkTrust(swarm).roots(uid) if number is not None]
    assert [number for number, _ in roots] == [2, 1]
    assert roots[1][1].hex() == before["b"]["key"]
    rosters.write(tmp_path, FOUR)
    assert ask("--key", str(file), "--roster", "robots.toml", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["newest"] == 2 and [robot["key"] for robot in facts["robots"]] == [2] * 4
    assert facts["forgotten"] == [1], "nobody has it any more"
    assert keys.read(file).keys.keys() == {2}
    assert ask("--key", str(file), "--forget", "2") == 2
    assert ask("--key", str(file), "--new-key") == 0
    capsys.readouterr()
    assert ask("--key", str(file), "--forget", "3") == 2
    # Another key 3 would pass for the one that robots were brought.
    assert "a key that another follows, there are: 2; the newest is 3" in capsys.readouterr().err
    assert keys.read(file).keys.keys() == {2, 3}
    assert ask("--key", str(file), "--forget", "2") == 0
    assert keys.read(file).keys.keys() == {3}
    write_program(boards / "bin" / "sudo", 'shift; PATH="$BOARDS/bin:$PATH" exec "$@"')
    words = ("--roster", "robots.toml", "--tags", "2", "--sudo", "--force")
    capsys.readouterr()
    assert ask("--key", str(file), *words, "--ssh-option", "Port=22", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert [robot["tag"] for robot in facts["robots"] if robot["key"] == 3] == [2]


def test_a_robot_that_was_away_is_renewed_by_the_next_deploy_of_anything(
    file: Path, boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As by `--controller`, which sends the daemon alone."""
    ask("--key", str(file), "--new-key")
    assert deploy(tmp_path, "root@a tag=1\nroot@b tag=2\n", "--key", str(file)) == 0
    before = key_of(boards / "root@b")
    rosters.write(tmp_path, "root@a tag=1\n")
    assert ask("--key", str(file), "--new-key", "--roster", "robots.toml") == 0
    assert "robot 2 (root@b) was not reached with key 2" in capsys.readouterr().out
    trust = key_holders.trust(key_holders.file_of(file), keys.read(file))
    assert trust.notes == (
        "key 1 is still taken: robots that key 2 has not reached yet have it: 2; bring it with"
        " vsense robot deploy",
    )
    reached, away = (bytes.fromhex(key_of(boards / f"root@{n}")["uid"]) for n in "ab")
    assert trust.is_former(reached, 1) and not trust.is_former(reached, 2)
    assert not trust.is_former(away, 1) and not trust.is_former(b"stranger", 1)
    assert not trust.is_former(reached, None), "without a key: another's to judge"
    plan = Plan(binaries={"root@b": (tmp_path / "vsensed").read_bytes()}, part=Part.DAEMON)
    options = argparse.Namespace(key=file)
    robots = [RobotHost("root@b", {"tag": "2"}, 1)]
    plan = robot_keys.renewing(plan, options, robots)
    swarm = keys.read(file)
    robot_keys.bring(plan, options, robots)
    now = key_of(boards / "root@b")
    assert now["uid"] == before["uid"] and now["key"] != before["key"]
    assert bytes.fromhex(now["key"]) == swarm.robot_key(away, 2)
    assert keys.read(file).keys.keys() == {2}
    assert "key 1 is forgotten: all robots have key 2" in capsys.readouterr().err
    assert robot_keys.renewing(Plan(part=Part.DAEMON), options, robots).keys is None


def test_a_board_that_is_called_otherwise_has_no_second_key(tmp_path: Path) -> None:
    """Its former name would hold up the end of the former key for ever."""
    file, uid = tmp_path / "swarm.key.robots", "5" * 32
    for name, tag, key in (("root@a", "1", 1), ("root@b", "2", 2)):
        robot = RobotHost(name, {"tag": tag}, 1)
        holders = key_holders.note(file, key, [Outcome(robot, True, "", uid=uid, keyed=True)])
    assert [(each.destination, each.key) for each in holders] == [("root@b", 2)]


def test_a_key_in_the_labs_folder_is_its_members(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One command for all; an account's own key goes on where the lab has none."""
    lab = tmp_path / "arena"
    lab.mkdir()
    lab.chmod(0o2770)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("VSENSE_LAB", str(lab))
    own = tmp_path / "config" / "vsense" / "swarm.key"
    keys.write(own, keys.make())
    assert keys.default_path() == own
    own.unlink()
    assert ask("--new-key") == 0
    with monkeypatch.context() as outside:

        def strange() -> None:
            raise NotMember("not his")

        outside.setattr("vsense.base.sharing.lab", strange)
        assert keys.default_path() == own, "who is in no group has what he had"
    for name in ("swarm.key", "swarm.key.robots"):
        assert stat.S_IMODE((lab / name).stat().st_mode) == 0o640
    keys.write(own, keys.make())
    assert keys.default_path() == lab / "swarm.key"


def test_a_board_without_a_key_is_not_given_one_alone(
    file: Path, boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rosters.write(tmp_path, "root@a tag=1\n")
    assert ask("--key", str(file), "--new-key", "--roster", "robots.toml") == 1
    assert "has no key yet: bring it one with vsense robot deploy" in capsys.readouterr().out
    assert not (boards / "root@a/etc/vsensed.key").exists()


def test_without_a_swarm_key_deploy_says_what_to_do(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    rosters.write(tmp_path, "root@a tag=1\n")
    words = ["--host", "10.0.0.1", "--base", "argos:/dev/ttyS0"]
    assert cli.main(["robot", "deploy", *words]) == 2
    assert "'vsense robot keys --new-key' makes it" in capsys.readouterr().err
    ask("--new-key")
    assert cli.main(["robot", "deploy", *words]) == 0
    assert (tmp_path / "config/vsense/swarm.key").exists()


@pytest.mark.parametrize("mode", [0o644, 0o660, 0o604, 0o700, 0o666])
def test_a_swarm_key_that_others_can_touch_is_refused(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "swarm.key"
    keys.write(file, keys.make())
    file.chmod(mode)
    with pytest.raises(VsenseError, match=f"mode {mode:04o}.*chmod 640"):
        keys.read(file)
    file.chmod(0o640)
    keys.write(file, keys.read(file).followed())
    assert stat.S_IMODE(file.stat().st_mode) == 0o640


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no key"),
        ("1 = ab\n", "expected a number that no other line has"),
        ("# two\n" + f"1 = {'a' * 64}\n" * 2, ":3: expected a number"),
        ("x" * 20_000, "at most 16384 bytes"),
        ("1 = " + "ä" * 64, "expected a text"),
    ],
)
def test_a_wrong_file_is_refused_without_its_words(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "swarm.key"
    file.write_text(text)
    file.chmod(0o600)
    with pytest.raises((VsenseError, ConfigError)) as caught:
        keys.read(file)
    assert words in str(caught.value) and "aaa" not in str(caught.value)


def test_a_folder_is_no_key(tmp_path: Path) -> None:
    with pytest.raises(VsenseError, match="is no file"):
        keys.read(tmp_path)
    with pytest.raises(VsenseError, match="No such file"):
        keys.read(tmp_path / "nowhere")


def test_keys_are_never_shown() -> None:
    swarm = SwarmKeys({1: b"secret" * 5 + b"!!"})
    assert "secret" not in repr(swarm) + str(swarm) + repr(LinkTrust(swarm))
    assert swarm.robot_key(bytes(16)).hex() == "06d08521cb6b33fe28846a13acd533a9"


def test_keys_that_members_make_at_once_are_all_kept(tmp_path: Path) -> None:
    path = tmp_path / "lab" / keys.KEY_FILE_NAME
    with ThreadPoolExecutor(8) as pool:
        newest = [made.newest for made in pool.map(keys.follow, [path] * 8)]
    assert sorted(newest) == sorted(keys.read(path).keys) == list(range(1, 9))


def test_a_board_that_says_anothers_uid_makes_nobody_a_clone(
    file: Path, tmp_path: Path, boards: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask("--key", str(file), "--new-key")
    assert deploy(tmp_path, FOUR, "--key", str(file)) == 0
    honest, liar = boards / "root@a", boards / "root@d"
    before = (key_of(honest), (honest / "etc/vsensed.conf").read_bytes())
    write_program(liar / "bin" / "sed", f"echo {before[0]['uid']}")
    capsys.readouterr()
    assert deploy(tmp_path, FOUR, "--key", str(file), "--json") == 1
    facts = {row["robot"]: row for row in json.loads(capsys.readouterr().out)}
    assert [name for name, row in facts.items() if not row["ok"]] == ["root@d"]
    assert f"its uid is {before[0]['uid']}; it was given {'7' * 32}" in facts["root@d"]["text"]
    assert (key_of(honest), (honest / "etc/vsensed.conf").read_bytes()) == before


def test_no_key_is_left_behind_where_a_board_refuses(
    file: Path, tmp_path: Path, boards: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask("--key", str(file), "--new-key")
    write_program(boards / "bin" / "sudo", "echo 'sudo: a password is required' >&2; exit 1")
    here = set(Path("/tmp").glob("vsensed.*"))
    assert deploy(tmp_path, "pi@a tag=1\n", "--key", str(file), "--sudo") == 1
    assert "a password is required" in capsys.readouterr().out
    assert set(Path("/tmp").glob("vsensed.*")) == here


def test_robots_whose_hosts_come_later_are_left_out(
    boards: Path, natively: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["new", "first"]) == 0
    common = ["--host", "10.0.0.1", "--base", "argos:/dev/ttyS0", "--insecure", "--target", "host"]
    words = ["robot", "deploy", *common, "--dry"]
    assert cli.main(["robot", "init", "--robots", "4"]) == 0
    assert cli.main([*words, "--rollback"]) == 2, "nobody can be reached"
    assert cli.main(["robot", "init", "root@192.168.1.30-31"]) == 0
    capsys.readouterr()
    for what in (["--experiment", "first", "--robots", "2"], ["--rollback"]):
        assert cli.main([*words, *what]) == 0
        said = capsys.readouterr()
        assert said.out.count("root@192.168.1.3") == 2
        assert re.search(
            r"^without a host in robots\.toml, and left out: \d+, \d+$", said.err, re.M
        )
    assert cli.main([*words, "--experiment", "first", "--robots", "3"]) == 2
    assert "no host for this robot" in capsys.readouterr().err


def test_emulated_robots_get_no_keys_where_that_is_asked(
    boards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Any] = []

    def start(*arguments: Any) -> None:
        given.append(arguments[6])
        raise UsageError("enough")

    monkeypatch.setattr(robot_emulate, "Rehearsal", start)
    key = ["--key", str(tmp_path / "swarm.key")]
    assert cli.main(["robot", "keys", *key, "--new-key"]) == 0
    for more in ([], ["--insecure"]):
        output = ["-o", str(tmp_path / f"logs{len(more)}")]
        assert cli.main(["robot", "emulate", "3", *key, *more, *output]) == 2
    assert given[0] is not None and given[1] is None
