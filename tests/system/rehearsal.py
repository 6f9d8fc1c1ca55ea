"""Emulated robots and their tracker, for whoever rehearses `vsense run` with them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.rigs.processes import free_port

VSENSE = (sys.executable, "-m", "vsense")
TAGS = (31, 1843)


@dataclass(frozen=True)
class Stage:
    """Two emulated robots that wait for a host.

    Attributes:
        directory: what they leave.
        port, lines: where they look for a host, and where their tracker waits for one.
        prefix: what all commands begin with.
        said: where they tell what they do.
    """

    directory: Path
    port: int
    lines: int
    prefix: tuple[str, ...]
    said: Path

    def link(self, duration_s: float) -> subprocess.CompletedProcess[str]:
        """Measures their links."""
        tags = ",".join(map(str, TAGS))
        words = ("robot", "link", tags, "--for", str(duration_s), "--json", "--insecure")
        return self._vsense(*words, "--port", str(self.port))

    def run(self, *words: str, lines: int = 0) -> subprocess.CompletedProcess[str]:
        """A run of foraging with them; its tracker's `lines` come to another port than theirs."""
        ports = ("--tracker", f"lines:{lines or self.lines}", "--port", str(self.port))
        return self._vsense("run", "foraging", *ports, "--robots", "2", "--insecure", *words)

    def _vsense(self, *words: str) -> subprocess.CompletedProcess[str]:
        command = [*self.prefix, *VSENSE, *words]
        return subprocess.run(command, capture_output=True, text=True, timeout=60)


@contextmanager
def emulated(folder: Path, prefix: Sequence[str] = ()) -> Iterator[Stage]:
    """Robots with the radios of a weak and of a sleeping link; they end in order, or it fails."""
    ports = free_port(), free_port()
    stage = Stage(folder / "robots", *ports, tuple(prefix), folder / "said")
    command = [*prefix, *VSENSE, "robot", "emulate", "2", "--insecure", "--port", str(stage.port)]
    command += ["--radio", "31=-84,5.5", "--radio", "1843=-61,54,saves"]
    command += ["--tracker-port", str(stage.lines), "-o", str(stage.directory)]
    with stage.said.open("w") as file:
        robots = subprocess.Popen(
            command, stderr=file, stdout=subprocess.DEVNULL, start_new_session=True
        )
    try:
        yield stage
        # As a terminal does: what stands before the command, such as unshare, ends with it.
        os.killpg(robots.pid, signal.SIGINT)
        assert robots.wait(20) == 130, stage.said.read_text()
    finally:
        robots.kill()
        robots.wait()
