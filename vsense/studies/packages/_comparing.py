"""Claims: what files say of runs, what was computed again for each, and whether it is the same.

A package's claims are its tables, poses, readings and figures. A benchmark's result is a package
whose claims are its missions, runs, scores and figures (`vsense.studies.benchmark._checking`).

What compares what was packed with what was made again says in words what differs; "": nothing.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import VsenseError
from vsense.base.message_bus import DAMAGED, Message
from vsense.config.arena import floor_picture
from vsense.studies.packages._places import Scrubber
from vsense.studies.results import read_arrays

DAMAGED_FILE = (*DAMAGED, EOFError, OSError, MemoryError, cv2.error)
"""What reading a file raises that is not what its name says."""

_MOST_CELL = 40
_OF_THE_CLOCK = ("/run", "/experiment", "/event")
"""Topics of a simulated recording that tell of the command, not only of the run."""

ClaimVerdict = Literal["same", "differs", "cannot"]

SAME, DIFFERS, NOT_ALL = 0, 1, 3
"""Exit codes: all is the same; something differs; not all could be computed again."""

_LABELS = {"same": "same", "differs": "DIFFERS", "cannot": "cannot be made again"}


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim.

    Attributes:
        thing: such as "trails-sim/run-001: row of runs.csv".
        verdict: of `ClaimVerdict`.
        words: what was compared; or why it cannot be computed again.
        differences: where it differs and by how much, each in words.
    """

    thing: str
    verdict: ClaimVerdict
    words: str = ""
    differences: Sequence[str] = ()

    @property
    def explanation(self) -> str:
        """Its differences, or what was compared."""
        return "; ".join(self.differences) or self.words

    def __str__(self) -> str:
        explanation = f": {self.explanation}" if self.explanation else ""
        return f"{self.thing}: {_LABELS[self.verdict]}{explanation}"


@dataclass(slots=True)
class Claims:
    """All claims, in the order in which they were computed again.

    Attributes:
        notes: what explains differences, such as other versions.
    """

    claims: list[Claim] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def cannot(self, thing: str, why: str) -> None:
        """Adds a claim that cannot be computed again."""
        self.claims.append(Claim(thing, "cannot", why))

    def judge(self, thing: str, differences: Sequence[str] | str, words: str = "") -> None:
        """Adds a claim, which is the same where there are no differences."""
        texts = (differences,) if isinstance(differences, str) else tuple(differences)
        texts = tuple(filter(None, texts))
        self.claims.append(Claim(thing, "differs" if texts else "same", words, texts))

    @contextmanager
    def attempt(self, thing: str, public: Callable[[object], str] = str) -> Iterator[None]:
        """Adds a claim that cannot be computed again where the block fails.

        Args:
            public: gives the words of an error for people.
        """
        try:
            yield
        except (VsenseError, *DAMAGED_FILE) as error:
            self.cannot(thing, public(error))

    def of(self, verdict: ClaimVerdict) -> Sequence[Claim]:
        """Those of a verdict."""
        return [claim for claim in self.claims if claim.verdict == verdict]

    @property
    def exit_code(self) -> int:
        """The command's; see `SAME`. Of an empty package nothing is the same."""
        if self.of("differs"):
            return DIFFERS
        return NOT_ALL if self.of("cannot") or not self.claims else SAME

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        counts = {name: len(self.of(name)) for name in ("same", "differs", "cannot")}
        things = [
            {"thing": claim.thing, "verdict": claim.verdict, "words": claim.explanation}
            for claim in self.claims
        ]
        return {**counts, "notes": self.notes, "things": things}

    def lines(self) -> list[str]:
        """For people: what is not the same, each by itself, and how much is."""
        lines = [str(claim) for claim in self.claims if claim.verdict != "same"]
        lines += self.notes
        same, count = len(self.of("same")), len(self.claims)
        if same == count and count:
            return [*lines, f"all {count} things made again are the same in every bit"]
        return [*lines, f"{same} of {count} things are the same in every bit"]


def files(before: Path, now: Path, scrubber: Scrubber) -> str:
    """Compares two files by what they are; OSError if one cannot be read."""
    if not os.path.exists(now):
        return "it was not made"
    old, new = before.read_bytes(), now.read_bytes()
    if old == new:
        return ""
    kind = before.suffix
    try:
        if kind == ".csv":
            text = scrubber.text(new.decode(errors="replace"))
            return tables(old.decode(errors="replace"), text)
        if kind == ".npz":
            return arrays(before, now)
        if kind == ".png":
            return pictures(old, new)
    except (VsenseError, *DAMAGED_FILE) as error:
        return f"it is damaged: {error!r}"
    return f"other bytes ({len(old)} before, now {len(new)})"


def tables(before: str, now: str) -> str:
    """Compares two CSV texts cell by cell."""
    if before == now:
        return ""
    old, new = (list(csv.reader(io.StringIO(text))) for text in (before, now))
    head = old[0] if old else []
    count, first, most = 0, "", 0.0
    none: list[str] = []
    for line, (was, is_) in enumerate(zip_longest(old, new, fillvalue=none), 1):
        for column, (a, b) in enumerate(zip_longest(was, is_, fillvalue="")):
            if a != b:
                count += 1
                most = max(most, _apart(a, b))
                name = head[column] if column < len(head) else str(column + 1)
                first = first or f"line {line}, {name}: {shown(a)} before, now {shown(b)}"
    if not count:
        return "other bytes with the same cells"
    by = f", by up to {most:.6g}" if most else ""
    return f"{count} cells{by}; the first: {first}"


def arrays(before: Path, now: Path) -> str:
    """Compares two .npz files array by array; VsenseError: one is none."""
    old, new = read_arrays(before), read_arrays(now)
    if old.keys() != new.keys():
        return f"other arrays: {sorted(old.keys() ^ new.keys())}"
    differing = [words for name in old if (words := _array(name, old[name], new[name]))]
    return "; ".join(differing) or "other bytes with the same arrays"


def _array(name: str, old: NDArray[Any], new: NDArray[Any]) -> str:
    if old.shape != new.shape or old.dtype != new.dtype:
        return f"{name}: {old.dtype}{old.shape} before, now {new.dtype}{new.shape}"
    if old.tobytes() == new.tobytes():
        return ""
    other = old != new
    words = f"{name}: {int(other.sum())} of {old.size} numbers"
    first = int(np.argwhere(np.atleast_1d(other))[0][0])
    if old.dtype.kind == "f":
        words += f", by up to {float(np.nanmax(np.abs(old - new))):.3g}"
    return f"{words}, first in row {first}"


def pictures(before: bytes, now: bytes) -> str:
    """Compares two pictures pixel by pixel."""
    old, new = floor_picture(before), floor_picture(now)
    if old.shape != new.shape:
        return "a picture of another size"
    other = int((old != new).reshape(*old.shape[:2], -1).any(axis=2).sum())
    return f"{other} pixels" if other else ""


def recordings(before: Path, now: Path) -> str:
    """Compares two recordings of a simulation, message by message.

    Raises:
        RecordingError: one cannot be read.
    """
    from vsense.monitor.recording.reader import open_recording  # needs the extra `record`

    with open_recording(before) as old, open_recording(now) as new:
        pairs = zip_longest(_reported(old.messages()), _reported(new.messages()))
        for number, (was, is_) in enumerate(pairs):
            if was is None or is_ is None:
                return f"it has {'fewer' if is_ is None else 'more'} messages than {number}"
            if was.topic != is_.topic or was.time_ns != is_.time_ns:
                return f"message {number}: {was.topic} before, now {is_.topic}"
            if was.blob != is_.blob or _text(was) != _text(is_):
                when_s = (was.time_ns - old.begin_ns) / 1e9
                return f"{was.topic} {when_s:.3f} s after the beginning"
    return ""


def cells(before: dict[str, str], now: dict[str, str]) -> str:
    """Compares cells of a row by their columns; those of `now` only."""
    differing = [
        f"{name}: {shown(before.get(name, ''))} before, now {shown(value)}"
        f"{_by(before.get(name, ''), value)}"
        for name, value in now.items()
        if before.get(name, "") != value
    ]
    return "; ".join(differing)


def figures(name: str, before: Any, now: Any, share: float = 0.0) -> Iterator[str]:
    """Compares what JSON has, member by member; numbers may differ by a share of the greater."""
    if isinstance(now, Mapping) and isinstance(before, Mapping):
        for key in dict.fromkeys((*now, *before)):
            yield from figures(
                f"{name}.{key}" if name else key, before.get(key), now.get(key), share
            )
    elif isinstance(now, list) and isinstance(before, list) and len(now) == len(before):
        for number, (old, new) in enumerate(zip(before, now)):
            yield from figures(f"{name}[{number}]", old, new, share)
    elif not _equal(before, now, share):
        yield f"{name}: {shown(str(before))} before, now {shown(str(now))}"


def _equal(before: Any, now: Any, share: float) -> bool:
    if share and type(before) in (int, float) and type(now) in (int, float):
        return math.isclose(before, now, rel_tol=share, abs_tol=1e-9)
    return bool(before == now)


def shown(text: str) -> str:
    """A value that somebody has written, for a line of text."""
    cut = text if len(text) <= _MOST_CELL else f"{text[:_MOST_CELL]}..."
    return repr(cut) if not cut or not cut.isprintable() else cut


def _by(before: str, now: str) -> str:
    apart = _apart(before, now)
    return f" (by {apart:.6g})" if apart else ""


def _apart(before: str, now: str) -> float:
    try:
        apart = abs(float(before) - float(now))
    except ValueError:
        return 0.0
    return apart if math.isfinite(apart) else 0.0


def _reported(messages: Iterator[Message]) -> Iterator[Message]:
    return (message for message in messages if message.topic not in _OF_THE_CLOCK)


def _text(message: Message) -> str:
    # As text: 0.0 and -0.0 are equal, but not the same.
    return json.dumps(message.data, sort_keys=True)


def row_of(path: Path, number: int) -> dict[str, str]:
    """A row of a table by its columns; empty: there is none. Raises one of `DAMAGED`."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows: Sequence[dict[str, str]] = [row for row in csv.DictReader(file) if any(row.values())]
    cells = rows[number] if number < len(rows) else {}
    return {str(name): value or "" for name, value in cells.items() if name is not None}
