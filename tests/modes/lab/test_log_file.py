"""Files that grow while a run goes on: a full disk is their end and nobody else's."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rigs.places import ROOT
from vsense.base.shared import RETRY_APPENDS, LabError, LogFile

SCRIPT = """
import resource, sys
from pathlib import Path
from vsense.base.shared import LogFile
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
file = LogFile(Path(sys.argv[1]))
for number in range(20):
    file.append(bytes([number]) * 7)
file.close()
print("the run goes on")
"""


def test_what_is_added_is_there_while_it_is_open(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(b"of an earlier run")
    file = LogFile(path)
    assert path.read_bytes() == b""
    file.append(b"one")
    file.append(b"two")
    while path.read_bytes() != b"onetwo":  # a thread writes it
        assert b"onetwo".startswith(path.read_bytes())
    file.close()
    file.close()
    file.append(b"late")
    assert path.read_bytes() == b"onetwo"


def test_a_full_disk_cuts_it_after_a_whole_record_and_is_told_once(tmp_path: Path) -> None:
    path = tmp_path / "log"
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(path)], cwd=ROOT, capture_output=True, text=True
    )
    assert done.stdout == "the run goes on\n"
    words = "it lacks what comes now, and the run goes on"
    assert done.stderr == f"{path}: File too large: {words}\n"
    assert path.read_bytes() == b"".join(bytes([number]) * 7 for number in range(14))


def test_it_goes_on_when_there_is_room_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Otherwise a lab's later runs have no truth, though somebody has cleared the disk."""
    path, disk = tmp_path / "log", Disk()
    monkeypatch.setattr(os, "pwrite", disk.pwrite)
    file = LogFile(path, "truth log")
    file.append(b"one")
    for number in range(2 * RETRY_APPENDS):
        file.append(b"%02d" % number)
    file.close()
    later = b"".join(b"%02d" % number for number in range(RETRY_APPENDS, 2 * RETRY_APPENDS))
    assert path.read_bytes() == b"one" + later
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and "No space left" in said[0] and "goes on, and has a gap" in said[1]


class Disk:
    """One with room for 4 bytes, of which the last write takes what fits; then it is cleared."""

    def __init__(self) -> None:
        self.room, self._pwrite = 4, os.pwrite

    def pwrite(self, descriptor: int, data: memoryview, offset: int) -> int:
        if not self.room:
            self.room = 1000
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = self._pwrite(descriptor, data[: self.room], offset)
        self.room -= written
        return written


def test_one_that_cannot_be_begun_says_so(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="No such file or directory"):
        LogFile(tmp_path / "nowhere" / "log")
    assert os.listdir(tmp_path) == []
