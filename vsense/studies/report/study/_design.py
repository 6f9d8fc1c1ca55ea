"""What is compared with what: conditions side by side, and which of their runs are pairs."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, instead
from vsense.run.runs_csv import COLUMNS, MODES, RunRow
from vsense.studies.report import BY

APART = ("experiment", "mode", "condition")
"""Runs that differ in one of these are never pooled."""
_SHOWN = ("series", "duration_s", "robots", "tags", "uids", "versions")
"""Columns whose values are told where runs that are compared differ in them."""
_LIGHT = 1.1
"""Runs are told to be lighter than others where each is so many times as light as any of those."""
_NO_GROUPS = ("run", "duration_s", "batteries_v", "late", "verdict", "why", "began")
"""Columns that no runs are grouped by."""

BlockKey = tuple[str, ...]
"""What the runs of a pair, or of a block of several conditions, have in common."""


@dataclass(frozen=True, slots=True)
class Arm:
    """The runs of one condition: those that count, and void ones, which never do."""

    label: str
    runs: Sequence[RunRow]
    voids: Sequence[RunRow]

    def values(self, measure: str) -> Floats:
        """A measure of the runs that have it, (n,)."""
        numbers = (run.measures.get(measure) for run in self.runs)
        return np.array([value for value in numbers if value is not None and math.isfinite(value)])


@dataclass(frozen=True, slots=True)
class Study:
    """Conditions that are compared with each other.

    Attributes:
        where: what all runs have in common, by column of `APART`.
        by: columns that tell the arms apart.
        arms: one at least, each with a run, be it a void one.
        keyed: the columns that make runs pairs; (): they are independent.
        why_independent: "" for pairs.
    """

    where: Mapping[str, str]
    by: Sequence[str]
    arms: Sequence[Arm]
    keyed: Sequence[str] = ()
    why_independent: str = ""

    @property
    def title(self) -> str:
        """What is compared, in words."""
        return ", ".join(word for word in self.where.values() if word) or "all runs"

    @property
    def measures(self) -> list[str]:
        """The measures of its valid runs that have a value, in the order of the columns."""
        names = (n for arm in self.arms for run in arm.runs for n, v in run.measures.items())
        return [n for n in dict.fromkeys(names) if any(len(arm.values(n)) for arm in self.arms)]

    def blocks(self, measure: str, arms: Sequence[Arm]) -> tuple[Floats, int]:
        """The values of complete blocks of some arms, (blocks, arms), and how many are not."""
        tables = []
        for arm in arms:
            values = ((self.key(run), run.measures.get(measure)) for run in arm.runs)
            tables.append({k: v for k, v in values if v is not None and math.isfinite(v)})
        # Blocks that are void in one condition are incomplete as well.
        rows = (run for arm in arms for run in (*arm.runs, *arm.voids))
        keys = list(dict.fromkeys(map(self.key, rows)))
        complete = [[t[key] for t in tables] for key in keys if all(key in t for t in tables)]
        return np.array(complete, np.float64).reshape(-1, len(arms)), len(keys) - len(complete)

    def key(self, run: RunRow) -> BlockKey:
        """What the run has in common with its pairs."""
        return tuple(str(getattr(run, name)) for name in self.keyed)

    def differences(self) -> list[tuple[str, list[str]]]:
        """Columns in which runs differ beside what is compared, and their values in each arm."""
        differing = []
        for name in _SHOWN:
            values = [_values_of(name, arm.runs) for arm in self.arms]
            different = {text for texts in values for text in texts}
            if name not in self.by and len(different) > 1:
                differing.append((name, [_shortened(texts) for texts in values]))
        if "tags" in dict(differing):  # other robots have other uids
            differing = [row for row in differing if row[0] != "uids"]
        return differing + self._light()

    def _light(self) -> list[tuple[str, list[str]]]:
        """The light of the arms, where that of one is apart from another's."""
        levels = [[r.light_level for r in a.runs if r.light_level is not None] for a in self.arms]
        measured = [row for row in levels if row]
        if not measured or max(map(min, measured)) <= _LIGHT * min(map(max, measured)):
            return []
        levels_by_arm = [list(dict.fromkeys(f"{level:g}" for level in row)) for row in levels]
        return [("light_level", [_shortened(texts) for texts in levels_by_arm])]


def studies(
    rows: Sequence[RunRow], by: Sequence[str] = BY, independent: bool = False
) -> list[Study]:
    """Sorts runs into studies and their conditions.

    Args:
        by: columns whose values are compared; in all others of `APART` runs of a study agree.
        independent: starts that are the same make no pairs.

    Raises:
        UsageError: `by` names what is no column, or none that groups runs.
    """
    for name in by:
        if name not in COLUMNS or name in _NO_GROUPS:
            columns = [column for column in COLUMNS if column not in _NO_GROUPS]
            raise UsageError(f"--by {name}: no column that groups runs; {instead(name, columns)}")
    apart = [name for name in APART if name not in by]
    sorted_: dict[BlockKey, dict[BlockKey, list[RunRow]]] = {}
    for row in rows:
        place, arm = (tuple(_text(getattr(row, n)) for n in names) for names in (apart, by))
        sorted_.setdefault(place, {}).setdefault(arm, []).append(row)
    result = []
    for place, members in sorted(sorted_.items(), key=lambda item: _natural(item[0])):
        arms = [
            Arm(
                ", ".join(word or "unknown" for word in words),
                [run for run in members[words] if run.valid],
                [run for run in members[words] if not run.valid],
            )
            for words in sorted(members, key=_natural)
        ]
        keyed, why = ((), "as was asked for") if independent else _keyed(arms, by)
        result.append(Study(dict(zip(apart, place)), by, arms, keyed, why))
    return result


def _keyed(arms: Sequence[Arm], by: Sequence[str]) -> tuple[Sequence[str], str]:
    """The columns that make runs pairs, or why there are none."""
    if len(arms) < 2:
        return (), ""
    names = [name for name in ("block", "start", "repetition") if name not in by]
    runs = [run for arm in arms for run in arm.runs]
    if not all(any(getattr(run, name) for name in names) for run in runs):
        return (), "not every run names its block, start or repetition"
    # Plans number their starts alike: where all conditions have runs of a series, it counts, too.
    series = [{run.series for run in arm.runs} for arm in arms]
    if "series" not in by and all(value == series[0] for value in series):
        names = ["series", *names]
    keys = [[tuple(getattr(run, n) for n in names) for run in arm.runs] for arm in arms]
    if any(len(set(arm_keys)) < len(arm_keys) for arm_keys in keys):
        return (), "several runs of a condition have the same block, start and repetition"
    shared = set.intersection(*map(set, keys))
    if 2 * len(shared) < max(map(len, keys)):
        return (), f"only {len(shared)} blocks have a run of every condition, fewer than half"
    return names, ""


def _values_of(name: str, runs: Iterable[RunRow]) -> list[str]:
    return list(dict.fromkeys(_text(getattr(run, name)) for run in runs))


def _shortened(texts: Sequence[str]) -> str:
    values = sorted((text or "unknown" for text in texts), key=_digits)
    if len(values) <= 3:
        return ", ".join(values) or "no valid run"
    return f"{len(values)} values, {values[0]} … {values[-1]}"


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:g}"
    return " ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def _natural(words: Sequence[str]) -> list[object]:
    """Sorts as people do: modes as they come to be, sighted before blind, 2 before 10."""
    first = (*MODES, "sighted", "blind")
    return [(first.index(w) if w in first else len(first), _digits(w)) for w in words]


def _digits(text: str) -> list[tuple[bool, float, str]]:
    parts = (part for part in re.split(r"(-?\d+(?:\.\d+)?)", text) if part)
    return [
        (True, 0.0, part) if not _is_number(part) else (False, float(part), "") for part in parts
    ]


def _is_number(text: str) -> bool:
    return re.fullmatch(r"-?\d+(?:\.\d+)?", text) is not None
