"""A disk that is full in the middle of a run: the run goes on, and so does the recording later."""

from __future__ import annotations

import errno
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.monitor.recording.conftest import BEGIN_NS, picture
from tests.rigs.places import ROOT
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording import _recorder
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording._waiting import WaitingBounds, WaitingPicture
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.recording.writer import WholeFile


def record(how: str, path: Path, *more: str) -> dict[str, Any]:
    script = [sys.executable, "-m", "tests.monitor.recording.full_disk", how, str(path), *more]
    done = subprocess.run(script, check=True, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    return dict(json.loads(done.stdout))


def check(path: Path, told: dict[str, Any]) -> None:
    with open_recording(path) as recording:
        assert recording.complete
        numbers = [message.data["n"] for message in recording.messages({"/arena"})]
        missing = set(range(told["published"])) - set(numbers)
        assert numbers == sorted(numbers)
        (gap,) = recording.gaps
        # Of what came between, the line that the recording goes on may be lost, too.
        assert gap.messages == told["end"]["lost_messages"] >= len(missing) > 100
        assert gap.why == told["trouble"]
        assert gap.from_ns < gap.to_ns
        times = [message.time_ns for message in recording.messages({"/arena"})]
        assert not [t for t in times if gap.from_ns < t < gap.to_ns]
        assert told["events"] == ["trouble", "info"]
    assert told["end"]["trouble"] is None and told["end"]["bytes"] == path.stat().st_size


def test_files_bounded_by_the_kernel(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    told = record("limit", path)
    assert told["trouble"] == os.strerror(errno.EFBIG)
    assert told["full_bytes"] <= 100_000
    check(path, told)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MB; only root can have one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, stderr=subprocess.DEVNULL).returncode != 0:
        pytest.skip("only root can mount; the same is tested with files bounded by the kernel")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_small_disk(small_disk: Path) -> None:
    filler = small_disk / "filler"
    filler.write_bytes(bytes(900_000))
    told = record("disk", small_disk / "run.mcap", str(filler))
    assert told["trouble"] == os.strerror(errno.ENOSPC)
    check(small_disk / "run.mcap", told)


def test_a_disk_that_stays_full_leaves_a_recording_without_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = MessageBus()
    recorder = Recorder(bus, tmp_path / "run.mcap")
    bus.publish(Message("/run", 1, {}))
    whole = os.pwrite

    def full(fd: int, data: memoryview, at: int) -> int:
        if len(data) > 1:
            return whole(fd, data[: len(data) // 2], at)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", full)
    recorder.close()
    assert recorder.state()["trouble"] == os.strerror(errno.ENOSPC)
    with open_recording(tmp_path / "run.mcap") as recording:
        assert not recording.complete
        assert list(recording.messages()) == []


def test_what_is_written_by_half_is_taken_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = WholeFile(tmp_path / "file", b"head")

    def broken(fd: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fdatasync", broken)
        with pytest.raises(OSError, match=os.strerror(errno.EIO)):
            file.append(b"body")
    assert (tmp_path / "file").read_bytes() == b"head"
    file.append(b"soul")
    file.close()
    assert (tmp_path / "file").read_bytes() == b"headsoul"


def test_a_disk_that_hangs_holds_nobody_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hanging, go_on = threading.Event(), threading.Event()

    def hang(fd: int) -> None:
        hanging.set()
        assert go_on.wait(60.0)

    bus, now = MessageBus(), [BEGIN_NS]
    path = tmp_path / "run.mcap"
    recorder = Recorder(bus, path, pictures=True, clock=lambda: now[0])
    monkeypatch.setattr(os, "fdatasync", hang)
    bus.publish(Message("/run", now[0], {"n": 0}))
    assert hanging.wait(60.0)
    # The oldest that waits is a second older each time: first pictures are left out, then all.
    for second in range(1, 15):
        now[0] = BEGIN_NS + second * 1_000_000_000
        bus.publish(Message("/run", now[0], {"n": second}))
        recorder.pictures([picture(second)])
    go_on.set()
    recorder.close()
    with open_recording(path) as recording:
        assert [m.data["n"] for m in recording.messages({"/run"})] == list(range(12))
        seen = [m.data["timestep"] for m in recording.messages({"/picture/left"})]
        assert seen == [1, 2, 3, 4]
        gaps = {(gap.messages, gap.pictures) for gap in recording.gaps}
        assert gaps == {(3, 0), (0, 10)}
        whys = {re.sub(r"\d+ %", "", gap.why) for gap in recording.gaps}
    assert all("it spent  writing to the disk," in why for why in whys), whys
    assert re.search(r"spent \d+ % writing to the disk, ", recorder.state()["lost_why"])


def test_a_busy_processor_is_not_called_a_slow_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encode = _recorder._encoded

    def work(waiting: WaitingPicture, topic: str) -> Message:
        until_ns = time.thread_time_ns() + 50_000_000
        while time.thread_time_ns() < until_ns:
            pass
        return encode(waiting, topic)

    monkeypatch.setattr(_recorder, "_encoded", work)
    bounds = WaitingBounds(picture_bytes=100)
    recorder = Recorder(MessageBus(), tmp_path / "run.mcap", pictures=True, bounds=bounds)
    for number in range(100):
        recorder.pictures([picture(number)])
        if number % 10 == 0:
            time.sleep(0.06)
    recorder.close()
    why = recorder.state()["lost_why"]
    share = re.search(r"(\d+) % writing to the disk", why)
    assert share is not None and int(share[1]) < 50, why
