"""Which pictures of an arena tracking server are kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from vsense.base.arena import Frame
from vsense.modes.live._runs import RunPictures
from vsense.monitor.recording.pictures import PictureRecordingError

FRAMES = [Frame("top", np.zeros((2, 2), np.uint8), 0, 0, 0)]


class Recorder:
    """Stands in for the disk."""

    directory, bytes = Path("/recordings/x"), 12

    def __init__(self, fails: bool = False) -> None:
        self.recorder = self
        self.written = 0
        self.dropped = 0
        self.closed = 0
        self._fails = fails

    def write(self, frames: Sequence[Frame]) -> None:
        if self._fails:
            raise PictureRecordingError("the disk is full")
        self.written += len(frames)

    def close(self) -> None:
        self.closed += 1

    def in_words(self) -> str:
        return f"{self.written} written"


class Disk:
    """Begins recordings; where it is `full` not even that."""

    def __init__(self, fails: bool = False) -> None:
        self.begun: list[Recorder] = []
        self.full = False
        self._fails = fails

    def __call__(self) -> Recorder:
        if self.full:
            raise PictureRecordingError("no space")
        self.begun.append(Recorder(self._fails))
        return self.begun[-1]


def live(pictures: RunPictures, story: str) -> None:
    """Lives timesteps: `r` in a run, `-` outside of one."""
    for letter in story:
        pictures.timestep(letter == "r", FRAMES)


@pytest.mark.parametrize(
    ("each_run", "story", "written", "closed"),
    [
        (True, "--rrr--rr-", [3, 2], [1, 1]),
        (False, "--rrr--rr-", [5], [0]),
        (True, "rr", [2], [0]),
        (True, "----", [], []),
    ],
)
def test_runs_are_recorded_and_nothing_else(
    each_run: bool, story: str, written: list[int], closed: list[int]
) -> None:
    disk, said = Disk(), []
    pictures = RunPictures(disk, each_run, said.append)
    live(pictures, story)
    assert [recorder.written for recorder in disk.begun] == written
    assert [recorder.closed for recorder in disk.begun] == closed
    pictures.close()
    assert all(recorder.closed == 1 for recorder in disk.begun)
    assert said == [f"{count} written" for count in written], "where it lies, and nothing else"


def test_a_disk_that_fails_ends_the_recording_only() -> None:
    disk, said = Disk(fails=True), []
    live(RunPictures(disk, True, said.append), "rrr-r")
    assert said == ["the disk is full; this run is not recorded", "0 written"] * 2
    assert [recorder.closed for recorder in disk.begun] == [1, 1]


def test_nothing_is_begun_where_no_pictures_are_wanted() -> None:
    live(RunPictures(lambda: None, True, print), "r-r-")


def test_what_a_slow_disk_left_out_is_said() -> None:
    disk, said = Disk(), []
    pictures = RunPictures(disk, True, said.append)
    live(pictures, "r")
    disk.begun[0].dropped = 4
    live(pictures, "-")
    assert said[0] == "1 written" and said[1].startswith("the pictures of 4 timesteps could not be")


def test_record_that_was_off_at_the_start_of_a_run_goes_on_in_it() -> None:
    disk = Disk()
    pictures = RunPictures(disk, True, print)
    pictures.begin_run()
    live(pictures, "rr")
    assert pictures.switch(False) == "pictures are not kept any more"
    live(pictures, "r-")
    pictures.begin_run()
    live(pictures, "r")
    assert len(disk.begun) == 1 and not pictures.state()["on"]
    assert pictures.switch(True) == "pictures are kept"
    live(pictures, "rrr")
    assert [recorder.written for recorder in disk.begun] == [2, 3] and pictures.state()["on"]


def test_what_has_failed_is_tried_again_where_somebody_wants_it() -> None:
    disk, said = Disk(), []
    pictures = RunPictures(disk, True, said.append)
    pictures.switch(False)
    pictures.begin_run()
    disk.full = True
    pictures.switch(True)
    live(pictures, "rrr")
    assert said == ["no space; this run is not recorded"]
    disk.full = False
    live(pictures, "rr")
    assert not disk.begun
    pictures.switch(True)
    live(pictures, "rr")
    assert [recorder.written for recorder in disk.begun] == [2]


def test_trouble_is_that_of_one_run_and_the_command_remembers_it() -> None:
    disk = Disk()
    pictures = RunPictures(disk, True, print)
    disk.full = True
    with pytest.raises(PictureRecordingError):
        pictures.begin_run()
    live(pictures, "r")
    assert pictures.end_run()["trouble"] == pictures.state()["trouble"] == "no space"
    disk.full = False
    pictures.begin_run()
    live(pictures, "r")
    assert pictures.state()["trouble"] is None and pictures.state()["on"]
    assert str(pictures.failure) == "no space", "for the exit code"
