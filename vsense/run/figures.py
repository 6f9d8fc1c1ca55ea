"""A run timestep by timestep: its tables and figures, which `vsense run --json` prints."""

from __future__ import annotations

from array import array
from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Frame
from vsense.base.errors import VsenseError
from vsense.base.terminal import Console, figure, measure_rows
from vsense.base.writing import BackgroundWriter
from vsense.config.specs import Experiment
from vsense.robots.link.status import RadioStatus, RobotStatus
from vsense.robots.link.wire import StopCause
from vsense.run._witness import Witness
from vsense.run.directory import TIMESTEPS_CSV, DirectoryError, RunTables
from vsense.run.link_check import WEAK_DBM
from vsense.run.robots import Readiness
from vsense.run.runner import Runner
from vsense.run.runtime import Step
from vsense.run.verdict import RunRecord, is_by_people, table_rows
from vsense.world.world import World

_LIGHT_PX = 16
"""Every so many rows and columns tell how light a picture is: it must not cost time."""


@dataclass(slots=True)
class _Robot:
    """In how many timesteps of the run a robot was seen, connected, and held by old readings."""

    seen: int = 0
    connected: int = 0
    stale: int = 0
    sessions: int = 0
    battery_mv: int = 0
    silent_ns: int = 0
    signal_dbm: int | None = None
    saves_power: bool = False

    def add_radio(self, radio: RadioStatus) -> None:
        """Takes what the robot tells of its Wi-Fi."""
        if radio.signal_dbm is not None:
            self.signal_dbm = min(radio.signal_dbm, self.signal_dbm or 0)
        self.saves_power |= radio.power_saving is True


@dataclass(frozen=True, slots=True)
class TimestepSample:
    """How the robots are at one timestep: how many are connected, seen, and hold old readings."""

    connected: int
    seen: int
    stale: int


class StepTimes:
    """The numbers and times of a run's timesteps, 48 bytes each: a run may take days."""

    NAMES = ("timestep", "run_timestep", "capture_ns", "ready_ns", "arena_ns", "sent_ns")

    def __init__(self) -> None:
        self._numbers = array("q")

    def __len__(self) -> int:
        return len(self._numbers) // len(self.NAMES)

    def add(self, step: Step) -> None:
        """Adds a timestep."""
        self._numbers.extend(getattr(step, name) for name in self.NAMES)

    def columns(self) -> NDArray[np.int64]:
        """All so far: (6, n), a row for each of `NAMES`."""
        columns = np.array(self._numbers, np.int64).reshape(-1, len(self.NAMES)).T
        return np.asarray(columns)


class Figures:
    """Counts what happens in the timesteps of one run, in bounded memory per timestep.

    Attributes:
        steps: the timesteps that were counted.
        light_level: how light the first pictures were, see `light_of`; None: there were none.
        witness: has watched the robots.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._experiment = experiment
        self._dt_ns = experiment.timestep_ns
        self._robots = {robot.tag: _Robot() for robot in experiment.robots}
        names = {robot.tag: robot.id for robot in experiment.robots}
        objects = {thing.tag: thing.id for thing in experiment.objects}
        self.witness = Witness(names, objects, experiment.models)
        self._last_run_timestep = -1
        self.light_level: float | None = None
        self.steps = StepTimes()

    def carry_out(
        self, runner: Runner, world: World, directory: Path, console: Console
    ) -> Generator[tuple[Step, TimestepSample], None, None]:
        """Carries a run out; yields its timesteps, which are counted, and how the robots are.

        The tables go into `directory`. What the disk does not take is said, and costs no run.
        """
        trouble = lambda text: console.say(f"vsense: {text}", "trouble")  # noqa: E731
        tables: RunTables | None = None
        writer = BackgroundWriter(str(directory / TIMESTEPS_CSV), trouble)
        try:
            tables = RunTables(directory, self._experiment.timestep_s, trouble)
        except DirectoryError as error:
            console.say(f"no table of this run's timesteps: {error}", "trouble")
        try:
            for step in runner.timesteps():
                sample = self.observe(step, runner.robots)
                if tables is not None:
                    times_ns = step.capture_ns, step.ready_ns, step.arena_ns, step.sent_ns
                    counts = sample.connected, sample.seen, sample.stale
                    numbers = step.run_timestep, step.timestep
                    measures = dict(world.results)
                    writer.do(partial(tables.add, numbers, times_ns, counts, measures))
                yield step, sample
                # Lent pictures go back during a pause.
                del step
        finally:
            writer.close(None if tables is None else tables.close)

    def observe(self, step: Step, robots: Mapping[int, RobotStatus]) -> TimestepSample:
        """Counts a timestep; `robots` are the links' statuses by tag."""
        self._last_run_timestep = step.run_timestep
        if self.light_level is None and step.frames:
            self.light_level = light_of(step.frames)
        self.steps.add(step)
        self.witness.observe(step.state, robots, step.run_timestep * self._dt_ns)
        seen = set(step.state.robots["tag"][step.state.robots["seen"]].tolist())
        stale = 0
        for tag, counted in self._robots.items():
            status = robots[tag]
            counted.seen += tag in seen
            counted.connected += status.connected
            counted.sessions = status.sessions
            if status.heard_ns is not None:
                counted.silent_ns = max(counted.silent_ns, step.sent_ns - status.heard_ns)
            if status.telemetry is not None:
                counted.add_radio(RadioStatus.of(status.telemetry))
                held = status.connected and status.telemetry.stop_cause == StopCause.STALE
                counted.stale += held
                stale += held
                counted.battery_mv = status.telemetry.battery_mv
        return TimestepSample(
            connected=sum(robots[tag].connected for tag in self._robots),
            seen=len(seen & self._robots.keys()),
            stale=stale,
        )

    def record(
        self,
        runner: Runner,
        resting: Collection[str],
        away: Mapping[str, str],
        changes: int,
        failure: VsenseError | None = None,
    ) -> RunRecord:
        """What there was of a finished run.

        Args:
            resting: names of robots that were left out of it.
            away: by name, why robots were not at their starts.
            changes: so often somebody has changed its world.
            failure: what has ended it.
        """
        robots = []
        for tag, robot in self.witness.records.items():
            unseen_s, fenced_s = runner.standing.stood_s(tag)
            rests, why = robot.name in resting, away.get(robot.name, "")
            stood = replace(robot, unseen_s=unseen_s, fenced_s=fenced_s)
            robots.append(replace(stood, name=f"robot {tag}", rests=rests, away=why))
        wanted, late, left_out = self._counts(runner.ended)
        return RunRecord(
            ended=runner.ended if failure is None else str(failure),
            endless=not self._experiment.timesteps and is_by_people(runner.ended),
            timesteps=len(self.steps) > 0,
            late=late / max(wanted, 1),
            left_out=left_out / max(wanted, 1),
            robots=robots,
            silent_s=max((silence.duration_s for silence in runner.silences), default=0.0),
            unseen=self.witness.unseen,
            changes=changes,
        )

    def summary(
        self, runner: Runner, readiness: Readiness, results: Mapping[str, float]
    ) -> dict[str, Any]:
        """Gives all figures of a finished run under the names that scripts rely on.

        `readiness` says who was there when it began, `results` are the experiment's own.
        """
        timesteps = len(self.steps)
        wanted, late, left_out = self._counts(runner.ended)
        counts = list(self._robots.values())
        return {
            "ended": runner.ended,
            "timesteps": timesteps,
            "late_timesteps": late,
            "left_out_timesteps": left_out,
            "duration_s": round(wanted * self._dt_ns / 1e9, 3),
            "missing_at_start": list(readiness.missing),
            "light_level": self.light_level,
            "arena": {
                "seen_mean": _share(sum(c.seen for c in counts), timesteps),
                "silences": [
                    {"run_timestep": s.run_timestep, "duration_s": round(s.duration_s, 3)}
                    for s in runner.silences
                ],
            },
            "latency_ms": self._latencies(),
            "link": runner.link_figures(),
            "per_robot": [
                self._robot(robot.tag, robot.id, runner.standing.stood_s(robot.tag))
                for robot in self._experiment.robots
            ],
            "results": dict(results),
        }

    def _counts(self, ended: str) -> tuple[int, int, int]:
        """How many timesteps there should have been, how many of them were late or left out, and
        how many were left out."""
        wanted = self._experiment.timesteps if ended == "time" else self._last_run_timestep + 1
        capture_ns, _, _, sent_ns = self.steps.columns()[2:]
        left_out = wanted - len(self.steps)
        return wanted, int((sent_ns - capture_ns > self._dt_ns).sum()) + left_out, left_out

    def _robot(self, tag: int, name: str, stood_s: tuple[float, float]) -> dict[str, Any]:
        counted, timesteps = self._robots[tag], len(self.steps)
        return {
            "name": name,
            "tag": tag,
            "seen_share": _share(counted.seen, timesteps),
            "connected_share": _share(counted.connected, timesteps),
            "stale_share": _share(counted.stale, timesteps),
            "sessions": counted.sessions,
            "battery_mv": counted.battery_mv or None,
            "stood_unseen_s": round(stood_s[0], 3),
            "stood_fenced_s": round(stood_s[1], 3),
            "longest_silence_s": round(counted.silent_ns / 1e9, 3),
            "signal_dbm": counted.signal_dbm,
            "power_saving": counted.saves_power or None,
        }

    def _latencies(self) -> dict[str, dict[str, float | None]]:
        capture, ready, arena, sent = self.steps.columns()[2:]
        return {
            "capture_to_arena": _spread_ms(arena - capture),
            # Of another tracker the pictures are not known.
            "picture_to_arena": _spread_ms(
                (arena - ready)[: 0 if self.light_level is None else None]
            ),
            "arena_to_sent": _spread_ms(sent - arena),
            "capture_to_sent": _spread_ms(sent - capture),
        }


def light_of(frames: Sequence[Frame]) -> float:
    """The mean of pictures, 0 black to 1 white: with one exposure it tells the room's light."""
    step = slice(None, None, _LIGHT_PX)
    return round(float(np.mean([frame.image[step, step].mean() for frame in frames])) / 255.0, 4)


def _share(count: int, of: int) -> float | None:
    return round(count / of, 5) if of else None


def _spread_ms(spans_ns: NDArray[np.int64]) -> dict[str, float | None]:
    """Percentiles, in ms."""
    spans_ms = spans_ns / 1e6
    names = {"p50": 50, "p99": 99, "max": 100}
    return {
        name: round(float(np.percentile(spans_ms, q)), 3) if len(spans_ms) else None
        for name, q in names.items()
    }


def late_text(summary: Mapping[str, Any]) -> str:
    """How many timesteps were late, and how many were none at all."""
    left_out = summary["left_out_timesteps"]
    return f"{summary['late_timesteps'] - left_out} late, {left_out} left out"


def table(summary: Mapping[str, Any]) -> str:
    """The summary as a person reads it."""
    arena = summary["arena"]
    silences = [f"{s['duration_s']:.1f} s" for s in arena["silences"]]
    rows = [
        (
            "run",
            f"{summary['timesteps']} timesteps in {summary['duration_s']:g} s,"
            f" {late_text(summary)}; ended by: {summary['ended']}",
        ),
        *table_rows(summary),
        (
            "arena",
            f"{figure(arena['seen_mean'], '', 2)} of {summary['robots']} robots seen per timestep;"
            f" without any state: {', '.join(silences) or 'never'}",
        ),
        link_row(summary["link"]),
        *measure_rows(summary["results"]),
    ]
    lines = [f"{name:<10}{text}" for name, text in rows]
    lines.append(f"{'latency':<10}{'in ms':<32}{'p50':>10}{'p99':>10}{'max':>10}")
    for name, spread in summary["latency_ms"].items():
        figures = "".join(f"{figure(spread[key]):>10}" for key in ("p50", "p99", "max"))
        lines.append(f"{'':<10}{name.replace('_', ' '):<32}{figures}")
    lines.append(f"{'robots':<10}{'':<32}{'seen':>10}{'connected':>10}{'stale':>10}{'battery':>10}")
    for robot in summary["per_robot"]:
        shares = (robot[f"{key}_share"] for key in ("seen", "connected", "stale"))
        cells = "".join(f"{figure(share, ' %', scale=100.0):>10}" for share in shares)
        battery_mv = robot["battery_mv"]
        volts = "-" if battery_mv is None else f"{battery_mv / 1000.0:.2f} V"
        lines.append(f"{'':<10}{robot['tag']:<32}{cells}{volts:>10}")
    if worst := worst_links(summary["per_robot"]):
        lines.append(f"{'':<10}worst links: {'; '.join(worst)}")
    return "\n".join(lines)


QUIET_S = 0.2
"""A link is worth a word where nothing was heard for this long (telemetry comes each 75 ms), or its
signal was weaker than `WEAK_DBM` at some time."""

MOST_LINKS = 3


def worst_links(robots: Sequence[Mapping[str, Any]]) -> list[str]:
    """The robots of a summary whose links were the worst, and why; none where all were good."""
    bad = [(robot["longest_silence_s"], robot) for robot in robots]
    links = []
    for silent_s, robot in sorted(bad, key=lambda pair: pair[0], reverse=True):
        signal_dbm = robot["signal_dbm"]
        why = [f"silent for {silent_s:.2f} s"] if silent_s > QUIET_S else []
        why += [f"{signal_dbm} dBm"] if signal_dbm is not None and signal_dbm < WEAK_DBM else []
        why += ["power saving is on"] if robot["power_saving"] else []
        links += [f"{robot['name']} ({', '.join(why)})"] if why else []
    return links[:MOST_LINKS]


def link_row(link: Mapping[str, Any]) -> tuple[str, str]:
    """The line of a table about the datagrams."""
    text = (
        f"{link['received']} of {link['sent']} datagrams received,"
        f" {link['dropped']} dropped, {link['reconnects']} reconnects"
    )
    defects = link.get("defects")  # summaries of before have none
    return "link", text + (f", {defects} sessions ended by a defect in vsense" if defects else "")
