"""What a recording says, in numbers: of the run, of each robot, and of all trouble."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import Gap, Recording, open_recording
from vsense.studies.report._flow import SILENCE_LIMIT_NS, Interval, LinkHealth
from vsense.studies.report._gather import Gatherer, RobotTrack, gather


@dataclass(frozen=True, slots=True)
class RobotRow:
    """One robot in a run, from its `RobotTrack` and `LinkHealth`; None is unknown.

    `seen` and `connected` are shares of the arena states and of the messages, 0..1; `speed_m_s` is
    the mean while it was seen.
    """

    tag: int
    name: str
    controller: str | None
    distance_m: float
    speed_m_s: float | None
    seen: float
    longest_unseen_s: float
    connected: float | None
    losses: int | None
    stops: Mapping[str, int]
    battery_mv: float | None
    base_errors: float | None
    signal_dbm: float | None = None
    silent_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Incident:
    """Something that went wrong, in s since the run's beginning; `to_s` None: until the end."""

    kind: str
    from_s: float
    to_s: float | None
    text: str


@dataclass(frozen=True, slots=True)
class Findings:
    """What a recording says. Times are in s since the run began (`zero_ns`, capture time).

    Attributes:
        version: the vsense that wrote it.
        begun: when the recording began, UTC.
        complete: it was ended in order.
        damaged: parts that could not be read.
        lacking: what the recording lacks, in sentences.
        duration_s: of the recording.
        zero_ns: when the run began; without a run, the first arena state or the recording.
        run_s: length of the run as far as it is recorded.
        incidents: gaps, silences, lost links, cameras in trouble, by time.
    """

    path: Path
    version: str
    begun: datetime | None
    complete: bool
    damaged: int
    lacking: Sequence[str]
    duration_s: float
    zero_ns: int
    run_s: float
    gathered: Gatherer
    robots: Sequence[RobotRow]
    incidents: Sequence[Incident]

    @property
    def label(self) -> str:
        """The run's name, for headings."""
        facts = self.gathered.facts
        words = [facts.name or self.path.stem]
        if facts.kind:
            words.append(facts.kind)
        if facts.blind:
            words.append("without virtual sensors")
        if facts.seed is not None:
            words.append(f"seed {facts.seed}")
        return ", ".join(words)

    @property
    def part(self) -> str:
        """Which part of the recording is shown, in words."""
        ran = self.gathered.ran
        return f"the run ({self.run_s:.1f} s)" if ran else "the whole recording (it holds no run)"

    def times_s(self, times_ns: array[int]) -> Floats:
        """Times of the host's clock as s since the run began, (n,)."""
        return (np.array(times_ns, np.int64) - self.zero_ns) / 1e9

    @property
    def latency(self) -> dict[str, float]:
        """Latency's median, p95, p99, mean and greatest [ms]; empty: unknown."""
        values = np.array(self.gathered.latency_ms)
        if not len(values):
            return {}
        p50, p95, p99 = (float(value) for value in np.percentile(values, (50, 95, 99)))
        mean, most = float(values.mean()), float(values.max())
        return {"p50_ms": p50, "p95_ms": p95, "p99_ms": p99, "mean_ms": mean, "max_ms": most}

    @property
    def measures(self) -> dict[str, dict[str, float]]:
        """Each measure's last value, and its mean, least and greatest over the run."""
        return {
            name: {
                "end": values[-1],
                "mean": float(np.mean(values)),
                "min": min(values),
                "max": max(values),
            }
            for name, (_, values) in self.gathered.measures.items()
        }

    @property
    def lacks(self) -> list[str]:
        """What the recording does not hold, in words."""
        gathered = self.gathered
        has = {
            "arena states (/arena)": gathered.flow.lived,
            "measures (/signals)": gathered.measures,
            "the robots' links (/robots)": gathered.links.of,
            "readings (/readings)": gathered.latency_ns or gathered.facts.simulated,
            "the world (/world)": gathered.world,
        }
        return [words for words, value in has.items() if not value]

    @property
    def only_tracked(self) -> str:
        """What a recording of `vsense camera track` cannot show, in words; "": another one."""
        if self.gathered.facts.command != "track":
            return ""
        return f"robots were only tracked (vsense camera track): no {', no '.join(self.lacks)}"


def read_findings(path: Path, progress: Callable[[float], None] = lambda share: None) -> Findings:
    """Reads a recording; `progress` takes now and then which share of it was read, 0..1.

    RecordingError if it cannot be read, or holds nothing.
    """
    with open_recording(path) as recording:
        whole_s = max(recording.duration_s, 1e-9)
        gathered = gather(recording, lambda read_s: progress(min(max(read_s / whole_s, 0.0), 1.0)))
        if not (gathered.flow.lived or gathered.measures or gathered.links.of or gathered.events):
            raise RecordingError(
                f"{path}: holds nothing that a report could show; expected arena states, measures,"
                " robots or events"
            )
        flow = gathered.flow
        zero_ns = recording.begin_ns if flow.begin_ns is None else flow.begin_ns
        return Findings(
            path=path,
            version=recording.version,
            begun=_utc(recording.begin_ns + recording.utc_shift_ns),
            complete=recording.complete,
            damaged=len(recording.damaged),
            lacking=recording.lacks(),
            duration_s=recording.duration_s,
            zero_ns=zero_ns,
            # The last timestep has a duration, too.
            run_s=(flow.end_ns - zero_ns) / 1e9 + gathered.facts.timestep_s if flow.lived else 0.0,
            gathered=gathered,
            robots=[_row(gathered, tag) for tag in sorted(_tags(gathered))],
            incidents=_incidents(recording, gathered, zero_ns),
        )


def _utc(time_ns: int) -> datetime | None:
    try:
        return datetime.fromtimestamp(time_ns // 1_000_000_000, timezone.utc)
    except (ValueError, OverflowError, OSError):
        return None


def _tags(gathered: Gatherer) -> set[int]:
    return {*gathered.facts.robots, *gathered.tracks.of, *gathered.links.of}


def _row(gathered: Gatherer, tag: int) -> RobotRow:
    track, health = (
        gathered.tracks.of.get(tag, RobotTrack()),
        gathered.links.of.get(tag, LinkHealth()),
    )
    reported = health.reports > 0
    return RobotRow(
        tag=tag,
        name=gathered.facts.robots.get(tag, str(tag)),
        controller=gathered.facts.controllers.get(tag),
        distance_m=track.distance_m,
        speed_m_s=track.distance_m / track.followed_s if track.followed_s > 0.0 else None,
        seen=track.seen / max(gathered.tracks.states, 1),
        longest_unseen_s=track.longest_unseen_s,
        connected=health.connected / health.reports if reported else None,
        losses=health.losses if reported else None,
        stops=dict(health.stops),
        battery_mv=health.battery_mv,
        base_errors=health.base_errors,
        signal_dbm=health.signal_dbm,
        silent_ms=health.silent_ms,
    )


def _incidents(recording: Recording, gathered: Gatherer, zero_ns: int) -> list[Incident]:
    intervals = []
    for gap in recording.gaps:
        text = f"{gap.messages} messages, {gap.pictures} pictures: {gap.why}"
        intervals.append(("not recorded", Interval(text, gap.from_ns, gap.to_ns)))
    for interval in gathered.flow.intervals:
        if not any(_overlap(gap, interval.from_ns, interval.to_ns) for gap in recording.gaps):
            intervals.append(("silence", interval))
    end_ns = recording.begin_ns + round(1e9 * recording.duration_s)
    newest_ns = gathered.flow.newest_ns
    over = gathered.state in ("ended", "emergency")
    if gathered.flow.lived and not over and end_ns - newest_ns > 2 * SILENCE_LIMIT_NS:
        words = "no arena state until the recording's end"
        intervals.append(("silence", Interval(words, newest_ns)))
    intervals += [("no link", interval) for interval in gathered.links.losses]
    intervals += [("camera", interval) for interval in gathered.cameras.intervals]
    incidents = []
    for kind, interval in sorted(intervals, key=lambda pair: pair[1].from_ns):
        to_s = None if interval.to_ns is None else (interval.to_ns - zero_ns) / 1e9
        incidents.append(Incident(kind, (interval.from_ns - zero_ns) / 1e9, to_s, interval.what))
    return incidents


def _overlap(gap: Gap, from_ns: int, to_ns: int | None) -> bool:
    return gap.from_ns <= (gap.to_ns if to_ns is None else to_ns) and gap.to_ns >= from_ns


def as_json(findings: Findings) -> dict[str, Any]:
    """The figures of one recording for `--json`; times in s since the run began."""
    gathered, facts = findings.gathered, findings.gathered.facts
    return {
        "file": str(findings.path),
        "experiment": facts.name,
        "kind": facts.kind,
        "seed": facts.seed,
        "blind": facts.blind,
        "calibration": facts.calibration or None,
        "version": findings.version,
        "begun_utc": None if findings.begun is None else findings.begun.isoformat(),
        "complete": findings.complete,
        "damaged_parts": findings.damaged,
        "lacking": list(findings.lacking),
        "odd_messages": gathered.odd,
        "changes": gathered.changes,
        "lacks": findings.lacks,
        "duration_s": findings.duration_s,
        "has_run": gathered.ran,
        "run_s": findings.run_s,
        "timesteps": gathered.flow.lived,
        "missed_timesteps": gathered.flow.missed,
        "late_timesteps": gathered.late,
        "measures": findings.measures,
        "latency": findings.latency or None,
        "robots": [
            {name: getattr(row, name) for name in RobotRow.__slots__} for row in findings.robots
        ],
        "cameras": {
            name: {"rate_hz": total / count, "dropped": gathered.cameras.dropped.get(name)}
            for name, (total, count) in gathered.cameras.rates_hz.items()
        },
        "amiss": [
            {name: getattr(incident, name) for name in Incident.__slots__}
            for incident in findings.incidents
        ],
        "events": len(gathered.events) + gathered.more_events,
    }
