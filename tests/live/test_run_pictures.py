"""Which pictures of an arena tracking server are kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from vsense.arena import Frame
from vsense.live.runs import RunPictures
from vsense.recording.pictures import PictureRecordingError

FRAMES = [Frame("top", np.zeros((2, 2), np.uint8), 0, 0, 0)]


class Recorder:
    """Stands in for the disk."""

    def __init__(self, fails: bool = False) -> None:
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
    """Begins recordings."""

    def __init__(self, fails: bool = False) -> None:
        self.begun: list[Recorder] = []
        self._fails = fails

    def __call__(self) -> Recorder:
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
    assert said == ["1 written", "the disk was too slow: 4 timesteps were not recorded"]
