"""kill -9 at any moment: the file opens, and no more than the last second is missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader

from tests.monitor.recording.dying_writers import SAID
from tests.rigs.places import ROOT
from vsense.monitor.recording.reader import open_recording

KILLS = 50
SECOND_NS = 1_000_000_000


def test_fifty_kills_lose_at_most_the_last_second(tmp_path: Path) -> None:
    script = [
        sys.executable,
        "-m",
        "tests.monitor.recording.dying_writers",
        str(tmp_path),
        str(KILLS),
        "1",
    ]
    subprocess.run(script, check=True, cwd=ROOT)
    kept = 0
    for number in range(KILLS):
        path = tmp_path / f"{number}.mcap"
        said = tmp_path / f"{number}.said"
        published, last_ns = SAID.unpack(said.read_bytes()) if said.exists() else (0, 0)
        if not path.exists():
            assert published == 0, "a file is there before anything is published"
            continue
        with open_recording(path) as recording:
            assert not recording.complete
            assert recording.gaps == []
            arenas = list(recording.messages({"/arena"}))
            assert [m.data["n"] for m in arenas] == list(range(len(arenas)))
            newest_ns = arenas[-1].time_ns if arenas else recording.begin_ns
            assert published == 0 or last_ns - newest_ns <= SECOND_NS, number
            pictures = list(recording.messages(lambda topic: topic.startswith("/picture/")))
            assert len(pictures) >= len(arenas) // 10 - 1
            assert not recording.damaged
        assert mcap_messages(path) == len(arenas) + len(pictures)
        kept += len(arenas)
    assert kept > 20 * KILLS, "most of them lived long enough to tell something"


def mcap_messages(path: Path) -> int:
    """How many messages the reader of `mcap` finds before the file breaks off."""
    count = 0
    with path.open("rb") as file:
        try:
            for record in StreamReader(file, validate_crcs=True).records:
                assert not isinstance(record, Chunk)
                count += isinstance(record, Message)
        except (McapError, ValueError):
            pass
    return count
