"""Where a user's program crashed: its file and line, from a note that the dying process leaves.

The program has its lines (`native().debug`); `addr2line`, which comes with compilers, reads them.
"""

from __future__ import annotations

import mmap
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from vsense.base.files import log_ends
from vsense.base.native import kernel_ffi, kernels
from vsense.robots._cache import cache_directory

_LINES = "addr2line"
_PLACE = re.compile(r"(.*[^?]):([0-9]+)(?: \(.*\))?")
_FRAME = re.compile(r"^(\S+)\(\w*\+(0x[0-9a-f]+)\) ?\[0x", re.M)
_ADVICE = "; with addr2line it is known where: sudo apt install binutils"


class CrashNote:
    """What a process notes when it crashes.

    It is made before the fork, and both processes share its memory.
    """

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, kernel_ffi.sizeof("struct vs_crash"))
        self._crash = kernel_ffi.from_buffer("struct vs_crash *", self._memory)
        self._folder = kernel_ffi.new("char[]", os.fsencode(f"{cache_directory()}/"))

    def watch(self) -> None:
        """Has this process note its crash. Raises BuildError: see `cache_directory`."""
        kernels.vs_crash_watch(self._crash, self._folder)

    def words(self) -> str:
        """Says where the other process crashed, after words that say that it did.

        "" where that was not in a user's program, or nothing is known of it.
        """
        count = self._crash.count
        if not count:
            return ""
        path = os.fsdecode(kernel_ffi.string(self._crash.path))
        return _line(path, [self._crash.offset[place] for place in range(count)])


def words_of_log(log: Path, program: Path) -> str:
    """The same of a daemon of the lab that was killed, from what robot/lab/crash.c has written."""
    rows = _FRAME.findall(log_ends(log))
    # The third crashed, after the handler's; calls return to the address behind them.
    own = [int(at, 16) - (n != 2) for n, (path, at) in enumerate(rows) if path == str(program)]
    return _line(str(program), own) if own else ""


def _line(path: str, offsets: Sequence[int]) -> str:
    """The innermost of these places that is in a user's file, as words."""
    if shutil.which(_LINES) is None:
        return _ADVICE
    said = subprocess.run(
        [_LINES, "-e", path, *(f"{offset:#x}" for offset in offsets)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        start_new_session=True,
    ).stdout
    # Innermost first; what comes with vsense has no lines, since it calls or is called.
    places = [match for line in said.splitlines() if (match := _PLACE.fullmatch(line))]
    return f" at {Path(places[0][1]).name}:{places[0][2]}" if places else ""
