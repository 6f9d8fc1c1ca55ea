"""What was made anew, and whether it is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Verdict = Literal["same", "differs", "cannot"]

SAME, DIFFERS, NOT_ALL = 0, 1, 3
"""Exit codes: all is the same; something differs; not all could be made anew."""

_SAID = {"same": "same", "differs": "DIFFERS", "cannot": "cannot be made anew"}


@dataclass(frozen=True, slots=True)
class ReproducedThing:
    """One thing.

    Attributes:
        thing: such as "trails-sim/run-001: row of runs.csv".
        verdict: of `Verdict`.
        words: what differs, where and by how much; or why it cannot be made anew.
    """

    thing: str
    verdict: Verdict
    words: str = ""

    def __str__(self) -> str:
        return f"{self.thing}: {_SAID[self.verdict]}{f': {self.words}' if self.words else ''}"


@dataclass(slots=True)
class Reproduction:
    """All of a package, in the order in which it was made anew.

    Attributes:
        notes: what explains differences, such as other versions.
    """

    each: list[ReproducedThing] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def same(self, thing: str, words: str = "") -> None:
        """It is the same."""
        self.each.append(ReproducedThing(thing, "same", words))

    def differs(self, thing: str, words: str) -> None:
        """It is another one."""
        self.each.append(ReproducedThing(thing, "differs", words))

    def cannot(self, thing: str, why: str) -> None:
        """It cannot be made anew."""
        self.each.append(ReproducedThing(thing, "cannot", why))

    def judge(self, thing: str, difference: str, words: str = "") -> None:
        """It is the same where there is no difference; `words` then say of what."""
        if difference:
            self.differs(thing, difference)
        else:
            self.same(thing, words)

    def of(self, verdict: Verdict) -> Sequence[ReproducedThing]:
        """Those of a verdict."""
        return [one for one in self.each if one.verdict == verdict]

    @property
    def exit_code(self) -> int:
        """The command's; see `SAME`. Of an empty package nothing is the same."""
        if self.of("differs"):
            return DIFFERS
        return NOT_ALL if self.of("cannot") or not self.each else SAME

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        counts = {name: len(self.of(name)) for name in ("same", "differs", "cannot")}
        return {**counts, "notes": self.notes, "things": [asdict(one) for one in self.each]}

    def lines(self) -> list[str]:
        """For people: what is not the same, each by itself, and how much is."""
        lines = [str(one) for one in self.each if one.verdict != "same"]
        lines += self.notes
        same, of = len(self.of("same")), len(self.each)
        if same == of and of:
            return [*lines, f"all {of} things made anew are the same in every bit"]
        return [*lines, f"{same} of {of} things are the same in every bit"]
