"""When a run does not count: criteria that are written down before the first run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from vsense.run.robots import shorten


@dataclass(frozen=True, slots=True)
class VoidCriteria:
    """What makes a run void; None and False: that does not.

    Attributes:
        lost_s: a robot was not seen, or had no link, for longer than this.
        moved_mm: somebody moved a robot by more than this: it stood, or jumped.
        late: more than this share of the timesteps was late or left out, 0..1.
        ended_early: the run ended before its length was over.
        away_from_start: a robot that plays did not reach its start.
    """

    lost_s: float | None = None
    moved_mm: float | None = None
    late: float | None = None
    ended_early: bool = True
    away_from_start: bool = True

    def in_words(self) -> list[str]:
        """The criteria for people, one line each."""
        told = {
            f"a robot is lost for {self.lost_s or 0:g} s": self.lost_s is not None,
            f"a robot is moved by hand by {self.moved_mm or 0:g} mm": self.moved_mm is not None,
            f"more than {100 * (self.late or 0):g} % of the timesteps are late": self.late
            is not None,
            "it ends before its time": self.ended_early,
            "a robot does not reach its start": self.away_from_start,
        }
        return [words for words, holds in told.items() if holds]


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a run has shown, for its verdict.

    Attributes:
        ended: why it ended; "time": its length was over.
        late: share of timesteps that were late or left out; None: not known.
        lost_s: by robot's name, the longest time that it was lost.
        moved_mm: by robot's name, the farthest that somebody moved it.
        away: names of robots that were not at their starts, with why.
        measured: it had a timestep at least.
    """

    ended: str = "time"
    late: float | None = None
    lost_s: Mapping[str, float] = field(default_factory=dict)
    moved_mm: Mapping[str, float] = field(default_factory=dict)
    away: tuple[str, ...] = ()
    measured: bool = True


def why_void(criteria: VoidCriteria, evidence: Evidence) -> str:
    """Why a run does not count, in words; "": it does."""
    reasons = []
    if criteria.ended_early and evidence.ended != "time":
        reasons.append(f"{evidence.ended or 'failed'} before its end")
    elif not evidence.measured:
        reasons.append(f"nothing was measured: {evidence.ended or 'failed'}")
    if criteria.away_from_start and evidence.away:
        reasons.append(f"not at the start: {shorten(list(evidence.away))}")
    if (limit_s := criteria.lost_s) is not None:
        lost = [f"{n} lost for {s:.1f} s" for n, s in evidence.lost_s.items() if s > limit_s]
        reasons += [shorten(lost)] if lost else []
    if (limit_mm := criteria.moved_mm) is not None:
        moved = [
            f"{n} moved by {mm:.0f} mm" for n, mm in evidence.moved_mm.items() if mm > limit_mm
        ]
        reasons += [f"{shorten(moved)} by hand"] if moved else []
    if criteria.late is not None and (evidence.late or 0.0) > criteria.late:
        reasons.append(f"{100 * (evidence.late or 0.0):.1f} % of the timesteps late")
    return "; ".join(reasons)
