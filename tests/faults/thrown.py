"""Throws an exception into one function of one thread of a command.

    python -m tests.faults.thrown --list FILE   -- sim pollutant ...
    python -m tests.faults.thrown --throw POINT -- sim pollutant ...

A *point* is a function of vsense that somebody else calls: one that was handed over to be called
later, or one that a thread's own function calls (what is raised where that begins nobody can
catch). `--list` runs the command and writes each with how often it was called since its run has
begun. `--throw THREAD|MODULE:FUNCTION|N` runs it and has the N-th call raise `Thrown` instead.
"""

from __future__ import annotations

import json
import linecache
import sys
import threading
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from tests.rigs.places import ROOT
from vsense import cli

OURS = str(ROOT / "vsense") + "/"
NAME = "Thrown"
"""Who reads this word knows what happened; texts of exceptions may be strangers', and are left out
where a stranger's packet led to them."""
THROWN = "thrown"
"""A file of the current folder that says that it was."""
BEGINNING = "vsense.base.interruption:interruption"
"""Entered where a run begins: what comes before has started nothing."""
_CALLS: Counter[str] = Counter()
_KNOWN: dict[tuple[CodeType, CodeType | None, int], str | None] = {}


class Thrown(RuntimeError):
    """What the rig throws: nothing in vsense expects it."""


def point_of(frame: FrameType) -> str | None:
    """MODULE:FUNCTION where somebody else calls it, else None."""
    caller = frame.f_back
    key = (frame.f_code, caller and caller.f_code, caller.f_lasti if caller else 0)
    if key not in _KNOWN:
        _KNOWN[key] = _point(frame, caller)
    return _KNOWN[key]


def _point(frame: FrameType, caller: FrameType | None) -> str | None:
    code = frame.f_code
    if not code.co_filename.startswith(OURS) or code.co_name.startswith(("<", "__")):
        return None
    if caller is not None and caller.f_code.co_filename == threading.__file__:
        return None
    above = caller and caller.f_back
    is_threads = above is not None and above.f_code.co_filename == threading.__file__
    if caller is not None and caller.f_code.co_filename.startswith(OURS) and not is_threads:
        # Somebody else's where the caller does not call it by its name.
        places = list(caller.f_code.co_positions())[caller.f_lasti // 2]
        lines = linecache.getlines(caller.f_code.co_filename)[(places[0] or 1) - 1 : places[1]]
        if code.co_name in "".join(lines):
            return None
    return f"{frame.f_globals.get('__name__')}:{code.co_qualname}"


def thread_name() -> str:
    """The thread's name without a number of its own."""
    return threading.current_thread().name.rstrip("0123456789").rstrip("_-") or "thread"


def watch(frame: FrameType, event: str, argument: Any) -> None:
    """Counts points; for all threads."""
    if event == "call" and (point := point_of(frame)):
        if point == BEGINNING and not any(BEGINNING in known for known in _CALLS):
            _CALLS.clear()
        _CALLS[f"{thread_name()}|{point}"] += 1


class Thrower:
    """Raises `Thrown` in the n-th call of a point, in threads of one name."""

    def __init__(self, spec: str) -> None:
        self._thread, self._point, number = spec.split("|")
        self._left = int(number)

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """For `sys.setprofile`: what it raises is raised where the function begins."""
        if self._left <= 0 or thread_name() != self._thread:
            sys.setprofile(None)
        elif event == "call" and point_of(frame) == self._point:
            self._left -= 1
            if self._left == 0:
                sys.setprofile(None)
                Path(THROWN).touch()
                raise Thrown(f"by the fault rig into {self._point}")


def main() -> int:
    """Runs the command; its exit code."""
    option, value, _, *words = sys.argv[1:]
    sys.argv = ["vsense", *words]
    hook = watch if option == "--list" else Thrower(value)
    threading.setprofile(hook)
    sys.setprofile(hook)
    try:
        return cli.main()
    finally:
        sys.setprofile(None)
        if option == "--list":
            Path(value).write_text(json.dumps(dict(_CALLS), indent=1))


if __name__ == "__main__":
    sys.exit(main())
