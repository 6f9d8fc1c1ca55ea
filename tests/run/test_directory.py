"""Run directories and what is written into them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from vsense.run import directory
from vsense.run.directory import DirectoryError


def test_every_run_gets_a_directory_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    made = [directory.make(None, "swarm", 7) for _ in range(3)]
    assert len(set(made)) == 3
    assert all(
        p.is_dir() and p.parent == tmp_path / "runs" and "swarm-seed7" in p.name for p in made
    )


def test_an_earlier_run_is_never_written_over(tmp_path: Path) -> None:
    made = directory.make(tmp_path / "a" / "b", "swarm", 7)
    assert directory.make(made, "swarm", 8) == made, "an empty one may be used"
    directory.write_summary(made, {"robots": 3}, on_stdout=False)
    with pytest.raises(DirectoryError, match="empty:"):
        directory.make(made, "swarm", 7)


def test_what_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DirectoryError, match="Not a directory"):
        directory.make(tmp_path / "file" / "run", "swarm", 7)
    with pytest.raises(DirectoryError, match=r"summary\.json: No such file"):
        directory.write_summary(tmp_path / "gone", {}, on_stdout=False)


def test_a_disk_that_was_taken_away_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`runs` is a link to it, which exists: it was tried again for ever."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").symlink_to(tmp_path / "stick")
    with pytest.raises(directory.UnusableDirectory, match=r"cannot write to runs/.*: No such file"):
        directory.make(None, "swarm", 7)


def test_the_summary_is_the_same_on_standard_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory.write_summary(tmp_path, {"robots": 3}, on_stdout=True)
    printed = capsys.readouterr().out
    assert (
        json.loads(printed) == {"robots": 3} == json.loads((tmp_path / "summary.json").read_text())
    )
