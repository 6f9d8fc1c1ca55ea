"""Throws into every callback of every thread of `sim`, `lab`, `run` and `replay` in turn.

`scripts/bench callbacks [MODE...] [--point TEXT]`. Each command runs once to see which functions
are called from elsewhere in which thread (`thrown.py`), and then once for each of them, with an
exception there. A page looks on, orders a pause and goes again. Promises:

* it goes on to its end, or ends in order: exit code 0, 1 or 130, before a deadline;
* who runs it reads what happened;
* no process is left, and a recording opens.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import aiohttp

from tests.faults.thrown import NAME, THROWN
from tests.rigs.places import ROOT
from tests.rigs.processes import Program, descendants, is_alive
from tests.rigs.web import talk, ws
from tests.system.rehearsal import emulated
from vsense.base.errors import VsenseError
from vsense.monitor.recording.reader import open_recording

ASK_S = 15.0
"""A command that serves a page until Ctrl-C is asked to end by then."""
DEADLINE_S = 60.0
WEB = ("--web", "127.0.0.1:0")
WORDS = {
    "sim": ("sim", "pollutant", "--speed", "5", "--duration", "20", *WEB, "--record"),
    "lab": ("lab", "foraging", "--robots", "2", "--duration", "5", *WEB, "--record"),
    "run": ("run", "foraging", "--robots", "2", "--insecure", "--duration", "5", *WEB, "--record"),
    "replay": ("replay", *WEB, "--speed", "2"),
}


class Visitor(threading.Thread):
    """A page that looks at everything, pauses, goes on, leaves and comes again, until the end."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True, name="visitor")
        self._url = url
        self.start()

    def run(self) -> None:
        """One visit after the other; what is thrown at the server may end it."""
        for orders in (("pause", "start"), ()):
            with suppress(aiohttp.ClientError, OSError, asyncio.TimeoutError):
                talk(lambda client, orders=orders: self._visit(client, orders))

    async def _visit(self, client: aiohttp.ClientSession, orders: Sequence[str]) -> None:
        socket = await ws(client, self._url)
        await socket.send_json({"pictures": ["cam1", "camera"]})
        for number in range(50):
            await socket.receive()
            if number == 5:
                await socket.send_json({"look": 31})
            if number in (10, 20) and orders:
                await socket.send_json({"order": orders[number // 20], "value": 0})
        await socket.close()


class Attempt:
    """One run of a command below the rig; what it says, and how it ends."""

    def __init__(self, folder: Path, words: Sequence[str], *options: str) -> None:
        command = [sys.executable, "-m", "tests.faults.thrown", *options, "--", *words]
        self._program = Program(command, folder, os.environ | {"PYTHONPATH": str(ROOT)})
        self.said = self._program.said
        self.code: int | None = None
        self.left: set[int] = set()
        try:
            self._watch(self._program.process)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(self._program.process.pid, signal.SIGKILL)
            self._program.end()

    def _watch(self, process: subprocess.Popen[str]) -> None:
        """Waits for the end; a page that stays open is ended as a user ends it."""
        family: set[int] = set()
        began_s = time.monotonic()
        asked = visited = False
        while (elapsed_s := time.monotonic() - began_s) < DEADLINE_S and self.code is None:
            family |= descendants(process.pid)
            with suppress(subprocess.TimeoutExpired):
                self.code = process.wait(0.2)
            if not visited and (page := re.search(r"control room: (http\S+)", self._text())):
                visited = True
                Visitor(page[1])
            if not asked and (elapsed_s > ASK_S or "Ctrl-C ends" in self._text()):
                asked = True
                process.send_signal(signal.SIGINT)
        time.sleep(0.3)
        self.left = {pid for pid in family if is_alive(pid)}

    def _text(self) -> str:
        return "".join(self.said)

    def broken(self, folder: Path) -> list[str]:
        """The promises that it broke."""
        if not (folder / THROWN).exists():
            return ["void: not called so often"]
        broken = []
        if self.code is None:
            broken.append(f"not ended after {DEADLINE_S:g} s")
        elif self.code not in (0, 1, 130):
            broken.append(f"exit code {self.code}")
        if NAME not in self._text():
            broken.append("not a word of it")
        if self.left:
            broken.append(f"left processes {sorted(self.left)}")
        for recording in folder.glob("out/*.mcap"):
            try:
                open_recording(recording)
            except VsenseError as error:
                broken.append(f"recording: {error}")
        return broken


@contextmanager
def prepared(mode: str, folder: Path) -> Iterator[list[str]]:
    """The command's words; what it needs is there."""
    words = list(WORDS[mode])
    if mode == "replay":
        made = [sys.executable, "-m", "vsense", "sim", "pollutant", "--duration", "20", "--record"]
        subprocess.run([*made, "-o", "before"], cwd=folder, check=True, capture_output=True)
        yield [*words, "before"]
    elif mode == "run":
        with emulated(folder) as robots:
            ports = ["--tracker", f"lines:{robots.lines}", "--port", str(robots.port)]
            yield [*words, *ports, "-o", "out"]
    else:
        yield [*words, "-o", "out"]


def points_of(mode: str, folder: Path) -> dict[str, int]:
    """The points of a command, with how often each is called."""
    with prepared(mode, folder) as words:
        Attempt(folder, words, "--list", str(folder / "points.json"))
    points: dict[str, int] = json.loads((folder / "points.json").read_text())
    return points


def try_point(mode: str, point: str, calls: int) -> tuple[list[str], list[str]]:
    """Throws at a point in the middle of its calls; the promises broken, and what was said."""
    with tempfile.TemporaryDirectory(prefix="vsense-callbacks-") as made:
        folder = Path(made)
        with prepared(mode, folder) as words:
            attempt = Attempt(folder, words, "--throw", f"{point}|{max(1, calls // 3)}")
            return attempt.broken(folder), attempt.said


def main() -> int:
    """Tries all points of the modes; 1 where a promise was broken."""
    parser = argparse.ArgumentParser(prog="scripts/bench callbacks", description=__doc__)
    parser.add_argument("modes", nargs="*", metavar="MODE", help=f"{', '.join(WORDS)} (all)")
    parser.add_argument("--point", default="", metavar="TEXT", help="only points with this text")
    options = parser.parse_args()
    if unknown := set(options.modes) - set(WORDS):
        parser.error(f"{', '.join(sorted(unknown))}: expected some of {', '.join(WORDS)}")
    failures = 0
    for mode in options.modes or WORDS:
        with tempfile.TemporaryDirectory(prefix="vsense-callbacks-") as made:
            points = points_of(mode, Path(made))
        for point, calls in points.items():
            if options.point not in point:
                continue
            broken, said = try_point(mode, point, calls)
            failures += bool(broken) and not broken[0].startswith("void")
            print(f"{mode:7} {point}: {'; '.join(broken) or 'held'}", flush=True)
            if broken:
                print("".join(f"        | {line}" for line in said[-12:]), flush=True)
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
