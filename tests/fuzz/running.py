"""Runs the cases of a Python room: each is made from a seed and its number alone, so that one that
finds something can be made again. What no refusal explains, what hangs, and what takes memory
without end is a finding."""

from __future__ import annotations

import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from random import Random
from types import FrameType

from tests.fuzz.c_targets import Outcome
from tests.fuzz.rooms import ROOMS, Room, Scene

LONGEST_S = 2.0
"""A case that takes longer of the processor hangs ..."""
WAITING_S = 20.0
"""... and one that takes longer in all: the machine may do something else meanwhile."""
MOST_KB = 256 << 10
"""By which one case may raise the peak of the memory."""
_FINDINGS_MAX = 20
"""Of different kinds; then the run ends."""


class Hangs(BaseException):
    """Not an Exception: nobody may catch it by chance."""


_ALARMS = signal.SIGALRM, signal.SIGPROF


def _alarm(number: int, frame: FrameType | None) -> None:
    raise Hangs


def _peak_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def random_of(name: str, seed: int, case: int) -> Random:
    """The source of everything in a case."""
    return Random(f"{name}/{seed}/{case}")


def try_case(room: Room, scene: Scene, random: Random) -> str:
    """Runs one case; gives what was found, "" for nothing."""
    before_kb = _peak_kb()
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    signal.setitimer(signal.ITIMER_REAL, WAITING_S)
    try:
        room.case(random, scene)
    except room.refusals:
        pass
    except Hangs:
        where = traceback.format_exc(limit=-3)
        return f"hangs for {LONGEST_S:g} s of the processor, or {WAITING_S:g} s\n{where}"
    except Exception:
        return traceback.format_exc(limit=-4)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    grown_kb = _peak_kb() - before_kb
    return f"takes {grown_kb >> 10} MB\n" if grown_kb > MOST_KB else ""


def _kind(found: str) -> str:
    """Findings of one kind end at the same line with the same error."""
    lines = found.strip().splitlines()
    places = [line for line in lines if line.lstrip().startswith("File ")]
    return f"{lines[-1].split(':')[0]} {places[-1] if places else ''}"


def run_room(
    name: str, seed: int, first: int, runs: int | None, seconds: float | None, loud: bool = False
) -> Outcome:
    """Runs cases from `first` on, so many or for so long; `loud` shows whole tracebacks."""
    room = ROOMS[name]
    before = [signal.signal(number, _alarm) for number in _ALARMS]
    began_s = time.monotonic()
    kinds: dict[str, str] = {}
    done = 0
    with tempfile.TemporaryDirectory(prefix="vsense-fuzz-", dir=_memory()) as folder:
        scene = room.prepare(Path(folder))
        while len(kinds) < _FINDINGS_MAX and (runs is None or done < runs):
            if seconds is not None and time.monotonic() - began_s > seconds:
                break
            case = first + done
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = try_case(room, scene, random_of(name, seed, case))
            done += 1
            if found and _kind(found) not in kinds:
                again = f"scripts/bench fuzz --seed {seed} --case {case} {name}"
                kinds[_kind(found)] = f"{again}: {found.strip().splitlines()[-1][:200]}"
                if loud:
                    print(found, file=sys.stderr)
    for number, handler in zip(_ALARMS, before):
        signal.signal(number, handler)
    return Outcome(name, done, time.monotonic() - began_s, None, tuple(kinds.values()))


def _memory() -> str | None:
    """Where files cost no disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
