"""What this machine has and lacks, on a machine that is made to lack it."""

from __future__ import annotations

import grp
import importlib.util
import json
import socket
from pathlib import Path

import pytest

from vsense import cli
from vsense.base import errors
from vsense.robots import sources
from vsense.robots.link import keys
from vsense.tools.doctor import checks
from vsense.tools.doctor.checks import BROKEN, LACKS, OK, Finding, findings, table


def found(name: str) -> Finding:
    """What is found of a thing."""
    return next(one for one in findings() if one.name == name)


def test_a_compiler_that_is_not_there(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    lacking = found("C compiler")
    assert lacking.state == BROKEN and lacking.mend.startswith("sudo apt install build-essential")
    assert cli.main(["doctor"]) == 1
    shown = capsys.readouterr().out
    assert shown.index("needed, and not here:") < shown.index(f"\n      {lacking.mend}\n")
    assert shown.index(lacking.mend) < shown.index("\nhere:\n")
    assert shown.endswith("\nvsense cannot simulate here: see above\n")


def test_what_is_optional_stands_apart() -> None:
    few = [
        Finding("extra web", LACKS, "needed for the page", "pip install x"),
        Finding("a", OK, "b"),
    ]
    assert table(few)[1:] == [
        *("here:", "  a          b", "", "optional, and not here:"),
        *("  extra web  needed for the page", "      pip install x", ""),
        "vsense sim and vsense lab work",
    ]


def test_an_extra_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert found("extra record").state == OK
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert found("extra record") == Finding(
        *("extra record", LACKS, "needed for recordings (--record, replay, report, export)"),
        errors.pip_line("mcap"),
    )


def test_a_port_that_another_program_has(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        monkeypatch.setattr(checks, "PAGE_PORT", taken.getsockname()[1])
        assert found("page's port").state == LACKS


@pytest.mark.parametrize(("room", "state"), [(212_992, LACKS), (33_554_432, OK)])
def test_room_for_pictures_in_sockets(
    room: int, state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rmem_max").write_text(f"{room}\n")
    monkeypatch.setattr(checks, "_RMEM", tmp_path / "rmem_max")
    assert found("socket buffers").state == state


def test_a_key_that_others_can_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert found("swarm key").mend == "vsense robot keys --new-key"
    path = tmp_path / "vsense" / "swarm.key"
    path.parent.mkdir()
    keys.write(path, keys.make())
    path.chmod(0o644)
    assert found("swarm key").mend == f"chmod 640 {path}"
    path.chmod(0o640)
    assert found("swarm key").state == OK


def test_a_labs_folder_that_is_not_well_set_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    assert found("lab folder").state == OK and "none" in found("lab folder").text
    lab = tmp_path / "lab"
    monkeypatch.setenv("VSENSE_LAB", str(lab))
    lab.mkdir()
    lab.chmod(0o2775)
    assert found("lab folder").mend == f"sudo chmod 2770 {lab}"
    lab.chmod(0o2770)
    keys.write(lab / "swarm.key", keys.make().followed())
    group = grp.getgrgid(lab.stat().st_gid).gr_name
    assert found("lab folder").text.startswith(f"{lab}, group '{group}': ")
    assert keys.default_path() == lab / "swarm.key" and found("swarm key").state == OK
    notes = [one.text for one in checks.findings() if one.name == "swarm key"]
    assert notes[1:] == [
        "key 1 is still taken, and no robot is known to have it: if none has, vsense robot keys"
        " --forget 1"
    ]
    (lab / "robots.toml").touch(mode=0o644)
    lacking = [one for one in checks.findings() if one.name == "lab folder"][1:]
    assert [one.mend for one in lacking] == [f"sudo chmod o= {lab / 'robots.toml'}"]


def test_every_extra_is_for_something() -> None:
    from vsense.base.errors import EXTRAS

    assert checks._PURPOSES.keys() == set(EXTRAS.values())


def test_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(["doctor", "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told["versions"] == checks.versions()
    assert {one["state"] for one in told["findings"]} <= {OK, LACKS, BROKEN}


def test_the_commit_of_a_checkout_and_of_none(tmp_path: Path) -> None:
    assert sources.of_checkout(tmp_path) == ""
