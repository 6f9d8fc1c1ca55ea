"""Files that grow while a run goes on: a full disk is their end and nobody else's."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rigs.places import ROOT
from vsense.base.shared import LabError, LogFile

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


def test_a_full_disk_ends_it_after_a_whole_record_and_is_told_once(tmp_path: Path) -> None:
    path = tmp_path / "log"
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(path)], cwd=ROOT, capture_output=True, text=True
    )
    assert done.stdout == "the run goes on\n"
    assert done.stderr == f"{path}: File too large: it ends here, and the run goes on\n"
    assert path.read_bytes() == b"".join(bytes([number]) * 7 for number in range(14))


def test_one_that_cannot_be_begun_says_so(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="No such file or directory"):
        LogFile(tmp_path / "nowhere" / "log")
    assert os.listdir(tmp_path) == []
