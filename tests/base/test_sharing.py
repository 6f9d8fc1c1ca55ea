"""The lab's folder: which one is believed, who may enter, and what root is told to type."""

from __future__ import annotations

import grp
import json
import os
import pwd
import stat
from pathlib import Path

import pytest

from vsense import cli
from vsense.base import sharing
from vsense.base.sharing import NotMember, SharingError

ME = pwd.getpwuid(os.getuid()).pw_name


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A lab's folder of the group that this account has."""
    folder = tmp_path / "lab"
    folder.mkdir()
    folder.chmod(0o2770)
    monkeypatch.setenv("VSENSE_LAB", str(folder))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return folder


def test_a_folder_as_it_must_be_is_the_labs(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = sharing.lab()
    assert found == sharing.LabFolder(lab, os.getegid())
    assert found is not None and found.group == grp.getgrgid(os.getegid()).gr_name
    assert sharing.shares(lab) and not sharing.shares(lab.parent)
    assert ME in sharing.members(pwd.getpwuid(os.getuid()).pw_gid)
    monkeypatch.setenv("VSENSE_LAB", "")
    assert sharing.lab() is None and not sharing.shares(lab)


@pytest.mark.parametrize(
    ("mode", "words"),
    [(0o2777, "others may enter it .mode 2777."), (0o2775, "others may enter it"),
     (0o2771, "others may enter it"), (0o770, "its group must own what is in it"),
     (0o2750, "its group must own what is in it"), (0o3770, "its group must own what is in it")],
)  # fmt: skip
def test_another_mode_is_refused_with_what_mends_it(lab: Path, mode: int, words: str) -> None:
    lab.chmod(mode)
    with pytest.raises(SharingError, match=f"{lab}: {words}.*: sudo chmod 2770 {lab}"):
        sharing.lab()


def test_nobody_is_told_to_close_what_is_everybodys(lab: Path) -> None:
    lab.chmod(0o1777)
    with pytest.raises(SharingError, match="everybody's:"):
        sharing.lab()


def test_links_files_and_nothing_are_refused(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = lab.parent / "link"
    link.symlink_to(lab)
    (lab.parent / "file").write_text("")
    for name, words in (
        ("link", "no link"),
        ("file", "folder.*link"),
        ("gone", "not there"),
    ):
        monkeypatch.setenv("VSENSE_LAB", str(lab.parent / name))
        with pytest.raises(SharingError, match=words):
            sharing.lab()
    monkeypatch.setenv("VSENSE_LAB", "lab")
    with pytest.raises(SharingError, match=r"VSENSE_LAB=lab:.*/"):
        sharing.lab()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_somebody_elses_folder_is_refused(lab: Path) -> None:
    os.chown(lab, 65534, -1)
    with pytest.raises(SharingError, match=r"nobody.*chown root"):
        sharing.lab()


def test_who_is_in_no_such_group_is_told_which(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And who has joined it since he logged in, that this is all that is missing."""
    monkeypatch.setattr(os, "getuid", lambda: lab.stat().st_uid or 1)
    monkeypatch.setattr(os, "getegid", lambda: 4_000_000)
    monkeypatch.setattr(os, "getgroups", lambda: [4_000_001])
    monkeypatch.setattr(sharing, "user_name", lambda uid=None: "carl")
    group = grp.getgrgid(lab.stat().st_gid).gr_name
    with pytest.raises(NotMember, match=f"for group '{group}', and carl is not in it: sudo user"):
        sharing.lab()
    monkeypatch.setattr(os, "getgrouplist", lambda user, gid: [gid, lab.stat().st_gid])
    with pytest.raises(NotMember, match=r"carl.*login"):
        sharing.lab()


def test_a_shared_file_follows_no_link_and_has_its_mode(lab: Path) -> None:
    before = os.umask(0o077)
    try:
        os.close(sharing.write_shared(lab / "a", 0o660))
    finally:
        os.umask(before)
    assert stat.S_IMODE((lab / "a").stat().st_mode) == 0o660
    (lab / "b").symlink_to(lab / "a")
    os.mkfifo(lab / "c", 0o660)
    with pytest.raises(SharingError, match="b: Too many levels of symbolic links"):
        sharing.write_shared(lab / "b", 0o660)
    with pytest.raises(SharingError, match=r"c:.*plain file"):
        sharing.write_shared(lab / "c", 0o660)
    mine = lab.parent / "mine"
    mine.touch(0o600)
    os.link(mine, lab / "d")
    with pytest.raises(SharingError, match=r"d:.*name"):
        sharing.write_shared(lab / "d", 0o660)
    assert stat.S_IMODE(mine.stat().st_mode) == 0o600


def test_the_command_says_what_root_types(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sharing, "PLACE", lab.parent / "new")
    monkeypatch.delenv("VSENSE_LAB")
    assert cli.main(["share", "anna", "ben", "--group", "arena"]) == 1
    assert capsys.readouterr().out.splitlines()[1:] == [
        "    groupadd --force arena",
        "    usermod -aG arena anna",
        "    usermod -aG arena ben",
        f"    install -d -o root -g arena -m 2770 {lab.parent / 'new'}",
    ]
    with pytest.raises(SystemExit):
        cli.main(["share", "; rm -rf"])
    monkeypatch.setattr(sharing, "PLACE", lab)
    assert cli.main(["share"]) == 0
    out = capsys.readouterr().out
    assert f"{lab}: group '{grp.getgrgid(os.getegid()).gr_name}': " in out
    assert "no run has robots" in out
    assert cli.main(["share", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["folder"] == str(lab)
    lab.chmod(0o777)
    assert cli.main(["share"]) == 1 and "others may enter it" in capsys.readouterr().err
    monkeypatch.setenv("VSENSE_LAB", "")
    assert cli.main(["share"]) == 2 and "shares nothing" in capsys.readouterr().err
