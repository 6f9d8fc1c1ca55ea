"""Whether a run counts: what was expected of it and what was there, and the verdict on that.

A run is valid only if it was the run that its file describes. One function decides, for all modes.

| in a run | it is |
| --- | --- |
| it ended before its length was over | invalid, unless a plan says otherwise |
| a robot was refused: it runs another program than the file's | invalid |
| that was taken by `--other-programs` | valid, with a note |
| a robot or a tagged object was never seen, a robot never came | invalid |
| a robot had readings that were fresh enough at no time | invalid |
| a controller was started again in mid-run, or has failed | invalid |
| a robot's own guard held its wheels for more than `LINK_S`: its base, its battery | invalid |
| no arena state came for more than `LINK_S` | invalid |
| a robot had no link for more than `LINK_S`, or a plan's `lost_s` | invalid |
| a robot did not reach its start before the run | invalid, unless a plan says otherwise |
| a robot rested because its battery was low | valid, with a note: nothing else is expected of it |
| a robot stood because no camera saw it, or for the fence | valid, with a note, unless a plan has a limit |
| more than `MOST_LATE` of its timesteps were left out | invalid, unless a plan has a limit of late ones |
| more than `MOST_LATE` of its timesteps were late | valid, with a note, unless a plan has a limit |
| logs that its figures are made of are not whole: the disk was full | invalid |
| a robot was moved by hand | valid, unless a plan has a limit |
| the check of its links has found a weak one | valid, with a note |
| somebody has changed its world by hand, a controller has complained | valid, with a note |
"""  # noqa: E501 (a table)

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from vsense.base.terminal import shorten

VALID, VOID = "valid", "void"
BROKEN = "failed"
"""Why a run has ended that something in it has ended."""
FAILED = "failed in mid-run"
"""How a reason begins where controllers have failed."""

LINK_S = 1.0
"""A link that is down, or wheels that are held, for a shorter time have changed no run."""

MOST_LATE = 0.1
"""Of its timesteps more may not be left out; where more are late, that is worth a word."""

_BY_PEOPLE = ("interrupted", "stopped by", "reset by", "emergency")
"""How the reasons begin for which people end runs."""


@dataclass(frozen=True, slots=True)
class VoidCriteria:
    """What makes a run invalid beside what always does; None and False: that does not.

    Attributes:
        lost_s: a robot was not seen, or had no link, for longer than this.
        moved_mm: somebody moved a robot by more than this: it stood, or jumped.
        fenced_s: a robot stood for the fence for longer than this.
        late: more than this share of the timesteps was late or left out, 0..1.
        ended_early: the run ended before its length was over.
        away_from_start: a robot that plays did not reach its start.
    """

    lost_s: float | None = None
    moved_mm: float | None = None
    fenced_s: float | None = None
    late: float | None = None
    ended_early: bool = True
    away_from_start: bool = True

    def in_words(self) -> list[str]:
        """The criteria for people, one line each."""
        sentences = {
            f"a robot is lost for {self.lost_s or 0:g} s": self.lost_s is not None,
            f"a robot is moved by hand by {self.moved_mm or 0:g} mm": self.moved_mm is not None,
            f"a robot stands for the fence for more than {self.fenced_s or 0:g} s": self.fenced_s
            is not None,
            f"more than {100 * (self.late or 0):g} % of the timesteps are late": self.late
            is not None,
            "it ends before its time": self.ended_early,
            "a robot does not reach its start": self.away_from_start,
        }
        return [words for words, holds in sentences.items() if holds]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotRecord:
    """What was there of one robot of the file; by default all that is expected.

    Attributes:
        name: what people call it, such as "robot 31".
        rests: it stood in the run because its battery was low.
        came, seen: it had a link, and a camera saw it, at some time.
        refused: why it was turned away, in words; "": it was not, or came later.
        other_program: which it ran in place of the file's, in words; "": the file's.
        acted: its readings were fresh enough to act on at some time, while it had a link.
        starts: its daemon was started so often in the run.
        held_s, held_by: so long its own guard held its wheels, and why the last time, in words.
        away: why it was not at its start when the run began; "": it was, or nobody looked.
        unlinked_s, lost_s: the longest time that it had no link; and was not seen, or had none.
        moved_mm: the farthest that somebody moved it.
        unseen_s, fenced_s: so long it stood because it was not seen, and for the fence.
    """

    name: str
    rests: bool = False
    came: bool = True
    seen: bool = True
    refused: str = ""
    other_program: str = ""
    acted: bool = True
    starts: int = 0
    held_s: float = 0.0
    held_by: str = ""
    away: str = ""
    unlinked_s: float = 0.0
    lost_s: float = 0.0
    moved_mm: float = 0.0
    unseen_s: float = 0.0
    fenced_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """What was there of a run; by default all that its file describes.

    Attributes:
        ended: why it ended; "time": its length was over; `BROKEN`: `failed` says why.
        endless: it has no length.
        timesteps: it had one at least.
        late: share of its timesteps that were late or left out, 0..1.
        left_out: share of those that were left out, 0..1.
        robots: those of the file.
        silent_s: the longest time without an arena state.
        unseen: names of tagged objects that were never seen.
        changes: so often somebody has changed the world while it ran.
        complaints: of controllers, in words.
        failed: which controllers have failed, whose robots stood from then on, and why.
        link_check: which links were weak before the run, in words.
        unlogged: what the logs lack that its figures are made of, in words.
    """

    ended: str = "time"
    endless: bool = False
    timesteps: bool = True
    late: float = 0.0
    left_out: float = 0.0
    robots: Sequence[RobotRecord] = ()
    silent_s: float = 0.0
    unseen: Sequence[str] = ()
    changes: int = 0
    complaints: Sequence[str] = ()
    failed: Sequence[str] = ()
    link_check: str = ""
    unlogged: Sequence[str] = ()

    def judge(self, criteria: VoidCriteria) -> RunVerdict:
        """The verdict on the run."""
        if not self.timesteps:
            words = shorten(self.failed) or self.ended or "failed"
            return RunVerdict(f"nothing was measured: {words}")
        reasons = []
        is_told = self.ended == BROKEN and self.failed
        if criteria.ended_early and self.ended != "time" and not self.endless and not is_told:
            reasons.append(f"{self.ended or BROKEN} before its end")
        reasons += filter(None, (rule(self, criteria) for rule in _RULES))
        notes = filter(None, (note(self, criteria) for note in _NOTES))
        return RunVerdict("; ".join(reasons), "; ".join(notes))


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """Whether a run counts.

    Attributes:
        why: it does not, in words; "": it does.
        note: what is worth a word all the same.
    """

    why: str = ""
    note: str = ""

    def facts(self) -> dict[str, str]:
        """As summaries and runs.csv have it."""
        return {"verdict": VOID if self.why else VALID, "why": self.why, "note": self.note}


def late_share(summary: Mapping[str, Any]) -> float | None:
    """The share of a summary's timesteps that were late or left out; None: there were none."""
    steps = summary["timesteps"] + summary["left_out_timesteps"]
    return summary["late_timesteps"] / steps if steps else None


def judged(summary: Mapping[str, Any], record: RunRecord, criteria: VoidCriteria) -> dict[str, Any]:
    """A summary with the verdict; how late its timesteps were is the summary's."""
    late, left_out = late_share(summary) or 0.0, summary["left_out_timesteps"]
    left_out /= max(summary["timesteps"] + left_out, 1)
    verdict = replace(record, late=late, left_out=left_out).judge(criteria)
    return {**summary, "ended": record.ended, **verdict.facts()}


def is_by_people(ended: str) -> bool:
    """Whether people have ended a run: they know, and look first."""
    return ended.startswith(_BY_PEOPLE)


def exit_code(summaries: Iterable[Mapping[str, Any]], unmeasured: Iterable[str] = ()) -> int:
    """1 where a run is invalid, unless only because people have ended it, else 0.

    `unmeasured` says why runs ended of which nothing was measured.
    """
    invalid = any(s["verdict"] == VOID and not _is_cut(s) for s in summaries)
    return int(invalid or not all(map(is_by_people, unmeasured)))


def _is_cut(summary: Mapping[str, Any]) -> bool:
    return is_by_people(summary["ended"]) and summary["why"].startswith(summary["ended"])


def table_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The rows of a table for people about the verdict."""
    rows = [("verdict", f"INVALID: {summary['why']}" if summary["why"] else "valid")]
    return [*rows, *([("note", summary["note"])] if summary["note"] else [])]


def _listed(robots: Iterable[RobotRecord], words: Callable[[RobotRecord], str]) -> str:
    """The first few of some robots, each in words; "": there are none."""
    return shorten([f"{robot.name} {words(robot)}" for robot in robots])


def _playing(record: RunRecord) -> list[RobotRecord]:
    return [robot for robot in record.robots if not robot.rests]


def _there(record: RunRecord) -> list[RobotRecord]:
    """Those that had a link: of others it is said that they never came, and nothing else."""
    return [robot for robot in _playing(record) if robot.came]


def _of_refused(record: RunRecord, criteria: VoidCriteria) -> str:
    refused = [r for r in _playing(record) if r.refused and not r.came]
    return _listed(refused, lambda robot: f"was refused: it {robot.refused}")


def _of_absent(record: RunRecord, criteria: VoidCriteria) -> str:
    absent = [r for r in _playing(record) if not r.came and not r.refused]
    return _listed(absent, lambda robot: "never came")


def _of_unseen(record: RunRecord, criteria: VoidCriteria) -> str:
    robots = [robot.name for robot in _there(record) if not robot.seen]
    names = [*robots, *record.unseen]
    return f"never seen: {shorten(names)}" if names else ""


def _of_readings(record: RunRecord, criteria: VoidCriteria) -> str:
    idle = [robot for robot in _there(record) if not robot.acted]
    return _listed(idle, lambda robot: "never had fresh readings")


def _of_controllers(record: RunRecord, criteria: VoidCriteria) -> str:
    again = [f"{robot.name}'s controller" for robot in _there(record) if robot.starts]
    return f"started again in mid-run: {shorten(again)}" if again else ""


def _of_failed(record: RunRecord, criteria: VoidCriteria) -> str:
    return f"{FAILED}: {shorten(record.failed)}" if record.failed else ""


def _of_held(record: RunRecord, criteria: VoidCriteria) -> str:
    held = [robot for robot in _there(record) if robot.held_s > LINK_S]
    return _listed(held, lambda r: f"held its wheels for {r.held_s:.1f} s ({r.held_by})")


def _of_silence(record: RunRecord, criteria: VoidCriteria) -> str:
    return f"no arena state for {record.silent_s:.1f} s" if record.silent_s > LINK_S else ""


def _of_starts(record: RunRecord, criteria: VoidCriteria) -> str:
    away = [f"{r.name} ({r.away})" for r in _playing(record) if r.away]
    return f"not at the start: {shorten(away)}" if away and criteria.away_from_start else ""


def _of_lost(record: RunRecord, criteria: VoidCriteria) -> str:
    limit_s = criteria.lost_s
    if limit_s is None:
        cut = [robot for robot in _there(record) if robot.unlinked_s > LINK_S]
        return _listed(cut, lambda robot: f"had no link for {robot.unlinked_s:.1f} s")
    lost = [robot for robot in _playing(record) if robot.lost_s > limit_s]
    return _listed(lost, lambda robot: f"lost for {robot.lost_s:.1f} s")


def _of_moved(record: RunRecord, criteria: VoidCriteria) -> str:
    limit_mm = criteria.moved_mm
    moved = [r for r in record.robots if limit_mm is not None and r.moved_mm > limit_mm]
    words = _listed(moved, lambda robot: f"moved by {robot.moved_mm:.0f} mm")
    return words and f"{words} by hand"


def _of_fence(record: RunRecord, criteria: VoidCriteria) -> str:
    limit_s = criteria.fenced_s
    fenced = [r for r in record.robots if limit_s is not None and r.fenced_s > limit_s]
    words = _listed(fenced, lambda robot: f"stood {robot.fenced_s:.1f} s")
    return words and f"{words} for the fence"


def _of_late(record: RunRecord, criteria: VoidCriteria) -> str:
    if criteria.late is None:
        share, most, words = record.left_out, MOST_LATE, "left out: too slow"
    else:
        share, most, words = record.late, criteria.late, "late"
    return f"{100 * share:.1f} % of the timesteps {words}" if share > most else ""


def _of_logs(record: RunRecord, criteria: VoidCriteria) -> str:
    lacking = shorten(record.unlogged)
    return lacking and f"its figures are not of all of it: its logs lack {lacking}"


_RULES: Sequence[Callable[[RunRecord, VoidCriteria], str]] = (
    _of_refused, _of_absent, _of_unseen, _of_readings, _of_controllers, _of_failed, _of_held,
    _of_silence, _of_starts, _of_lost, _of_moved, _of_fence, _of_late,
    _of_logs,
)  # fmt: skip


def _note_programs(record: RunRecord, criteria: VoidCriteria) -> str:
    others = [robot for robot in _there(record) if robot.other_program]
    return _listed(others, lambda robot: robot.other_program)


def _note_resting(record: RunRecord, criteria: VoidCriteria) -> str:
    return _listed((r for r in record.robots if r.rests), lambda r: "rested: its battery was low")


def _note_standing(record: RunRecord, criteria: VoidCriteria) -> str:
    unseen = [(r.name, r.unseen_s, "unseen") for r in record.robots if r.unseen_s]
    fenced = [(r.name, r.fenced_s, "for the fence") for r in record.robots if r.fenced_s]
    return "; ".join(f"{name} stood {s:.1f} s {why}" for name, s, why in (*unseen, *fenced))


def _note_links(record: RunRecord, criteria: VoidCriteria) -> str:
    most_s = LINK_S if criteria.lost_s is None else criteria.lost_s
    brief = [r for r in _there(record) if 0.0 < r.unlinked_s <= most_s]
    return _listed(brief, lambda robot: f"had no link for {robot.unlinked_s:.1f} s")


def _note_late(record: RunRecord, criteria: VoidCriteria) -> str:
    # Where they make the run invalid it has been said.
    noted = record.late > MOST_LATE and not _of_late(record, criteria)
    return f"{100 * record.late:.1f} % of the timesteps late" if noted else ""


def _note_changes(record: RunRecord, criteria: VoidCriteria) -> str:
    times = "once" if record.changes == 1 else f"{record.changes} times"
    return f"its world was changed {times} by hand" if record.changes else ""


def _note_complaints(record: RunRecord, criteria: VoidCriteria) -> str:
    return shorten(record.complaints)


def _note_check(record: RunRecord, criteria: VoidCriteria) -> str:
    return record.link_check


_NOTES: Sequence[Callable[[RunRecord, VoidCriteria], str]] = (
    _note_programs, _note_resting, _note_standing, _note_check, _note_links, _note_late,
    _note_changes, _note_complaints,
)  # fmt: skip
