"""Claims: what files say of runs, what was computed again for each, and whether it is the same.

A package's claims are its tables, poses, readings and figures. A benchmark's result is a package
whose claims are its missions, runs, scores and figures (`vsense.studies.benchmark._checking`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal

from vsense.base.errors import VsenseError
from vsense.studies.packages._comparing import DAMAGED_FILE

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
