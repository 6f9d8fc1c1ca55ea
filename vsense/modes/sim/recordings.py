"""The recordings of a campaign's runs: a folder beside its table, a file for each run."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError, failing_as
from vsense.base.terminal import Console
from vsense.modes.sim.outcome import Task
from vsense.monitor.recording import SUFFIX, megabytes

_MOST_LETTERS = 120
"""Of a file's name, which the settings are in."""


def recordings_of(table: Path) -> Path:
    """The folder of the recordings of a campaign whose table is `table`."""
    return table.with_name(f"{table.stem}-recordings")


def recording_of(folder: Path, number: int, settings: Mapping[str, str], seed: int) -> Path:
    """The recording of a run; `number` is that of its combination of settings, from 1."""
    words = ",".join(f"{key}={value}" for key, value in settings.items())
    safe = re.sub(r"[^A-Za-z0-9_.=,+-]+", "_", words)[:_MOST_LETTERS]
    before = f"{number:02d}-{safe}-" if settings else ""
    return folder / f"{before}seed{seed}{SUFFIX}"


class CampaignRecordings:
    """Says where recordings are, and what they cost: after the first one, and at the end.

    VsenseError if the folder cannot be made.
    """

    def __init__(self, folder: Path, todo: Sequence[Task], count: int, console: Console) -> None:
        """`todo` are the runs that are done now, of `count` that the campaign has."""
        self._folder, self._todo, self._console = folder, len(todo), console
        self._done = self._bytes = self._troubles = 0
        with failing_as(VsenseError, f"{folder}: cannot be written"):
            folder.mkdir(parents=True, exist_ok=True)
        there = sum(1 for _ in folder.glob(f"*{SUFFIX}"))
        if there < count - len(todo):
            lacking = count - len(todo) - there
            console.say(f"{lacking} runs that are there already have no recording, and get none")
        if todo:
            console.say(f"recording to {folder}, a file for each run")

    def add(self, made: Mapping[str, Any]) -> None:
        """A run is done, with what became of its recording."""
        self._done, self._bytes = self._done + 1, self._bytes + made["bytes"]
        if made["trouble"]:
            self._troubles += 1
            if self._troubles == 1:
                self._say(f"vsense: a recording is not whole: {made['trouble']}")
        if self._done == 1 and self._todo > 1:
            self._foretell(made["bytes"])

    def _foretell(self, size: int) -> None:
        whole = size * self._todo
        with failing_as(VsenseError, f"{self._folder}: cannot be read"):
            free = shutil.disk_usage(self._folder).free
        words = f"{megabytes(size)} a run, about {megabytes(whole)} for all {self._todo}"
        self._say(f"recordings: {words}; {megabytes(free)} are free on the disk")
        if whole > free:
            self._say("vsense: the disk is too small for all recordings: the rows go on without")

    def say(self) -> None:
        """All runs are done."""
        if self._done:
            words = f"{self._done} recordings, {megabytes(self._bytes)}"
            self._console.say(f"recordings: {self._folder}, {words}")
        if self._troubles:
            self._console.say(f"vsense: {self._troubles} of them are not whole", "trouble")

    def _say(self, text: str) -> None:
        self._console.end_progress()
        self._console.say(text)
