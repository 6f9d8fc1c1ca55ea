"""What must hold after every fault, and after every lab."""

from __future__ import annotations

import json
import re
import signal
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.faults.faults import Fault
from tests.faults.stage import Stage
from vsense.modes.lab import _air
from vsense.monitor.recording.reader import open_recording

STOP_NS = 450_000_000
AIR_NS = _air.LEAST_NS + _air.HELD_UP_NS + 7 * _air.MEAN_NS
"""What the lab's air adds to an order for a robot on Wi-Fi that has no board, but to one in a
thousand of those that it holds up; see `robot/DRIVERS.md`."""
BACK_NS = 2_000_000_000
ROUND_TRIPS = 4
LOST_NS = 1_000_000_000
END_S = 2.0
SAME_NS = 30_000_000

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143}


@dataclass
class Verdict:
    """What one fault did.

    Attributes:
        name: the fault's.
        stop_ns: how long the last of those robots that had to stop took.
        back_ns: how long the last robot took until it moved after the fault's end.
        broken: the invariants that did not hold, in words.
    """

    name: str
    stop_ns: int = 0
    back_ns: int = 0
    broken: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Window:
    """When a fault began and ended, until when it was watched, and what the lab had said before."""

    begun_ns: int
    ended_ns: int
    until_ns: int
    said: int


def judge(stage: Stage, fault: Fault, window: Window) -> Verdict:
    """Compares what the wheels did and what the host said with what the fault promises."""
    verdict = Verdict(fault.name)
    for place in stage.places:
        _judge_wheels(stage, fault, window, place, stage.rows(place), verdict)
    said = "".join(stage.lab.said[window.said :])
    if fault.says and not re.search(fault.says, said):
        verdict.broken.append(f"the host did not say {fault.says!r} but: {said!r}")
    if fault.silent and (found := re.search(f".*({fault.silent}).*", said)):
        verdict.broken.append(f"the host said {found[0]!r}")
    if "Traceback" in said or "a defect in vsense" in said:
        verdict.broken.append(f"the host said: {said}")
    return verdict


def _judge_wheels(
    stage: Stage, fault: Fault, window: Window, place: int, rows: NDArray[np.void], verdict: Verdict
) -> None:
    who, begun_ns, ended_ns = f"robot {stage.tags[place]}", window.begun_ns, window.ended_ns
    wheels = Wheels.of(rows)
    if strange := wheels.speeds(begun_ns) - stage.normal:
        verdict.broken.append(f"{who}: speeds {strange}, which its controller never sets")
    if place in fault.stops:
        stop_ns = wheels.since(False, ended_ns) - begun_ns
        verdict.stop_ns = max(verdict.stop_ns, stop_ns)
        if stop_ns > _limit_ns(stage, place):
            verdict.broken.append(f"{who}: stands {stop_ns / 1e6:.0f} ms after the beginning")
    if place in fault.spared and (stood_ns := wheels.first(False, begun_ns)) is not None:
        after_ms = (stood_ns - begun_ns) / 1e6
        verdict.broken.append(f"{who}: stands {after_ms:.0f} ms after what does not concern it")
    took_ns = max(wheels.since(True, window.until_ns) - ended_ns, 0)
    verdict.back_ns = max(verdict.back_ns, took_ns)
    if took_ns > BACK_NS + ROUND_TRIPS * fault.round_trip_s * 1e9 or not wheels.turning[-1]:
        verdict.broken.append(f"{who}: not back {took_ns / 1e9:.2f} s after the end")


def _limit_ns(stage: Stage, place: int) -> int:
    """After so long a robot stands whatever fails."""
    return STOP_NS + (AIR_NS if place in stage.on_air else 0)


@dataclass(frozen=True)
class Wheels:
    """What a robot's two wheels were told: from each time on, until the next one.

    Attributes:
        times_ns: (n,) host's clock, ascending.
        told: (n, 2) left and right [steps/s].
    """

    times_ns: NDArray[np.int64]
    told: NDArray[np.int64]

    @classmethod
    def of(cls, rows: NDArray[np.void]) -> Wheels:
        """Out of the microcontroller's log.

        Some are told wheel by wheel, and byte by byte: what lasts no longer than `SAME_NS` is
        on its way to what follows.
        """
        times_ns = rows["time_ns"].astype(np.int64)
        told = np.stack([rows["left_steps_s"], rows["right_steps_s"]], axis=1).astype(np.int64)
        lasting = np.diff(times_ns, append=2**62) > SAME_NS
        return cls(times_ns[lasting], told[lasting])

    @property
    def turning(self) -> NDArray[np.bool_]:
        """(n,) whether any of the two turns."""
        return self.told.any(axis=1)

    def _from(self, since_ns: int) -> int:
        """The row that holds at a time."""
        return max(int(np.searchsorted(self.times_ns, since_ns, "right")) - 1, 0)

    def speeds(self, since_ns: int) -> set[tuple[int, int]]:
        """All that they were told from a time on."""
        return {(left, right) for left, right in self.told[self._from(since_ns) :].tolist()}

    def first(self, turning: bool, since_ns: int) -> int | None:
        """When they turned, or stood, first from a time on; None: never."""
        start = self._from(since_ns)
        found = np.flatnonzero(self.turning[start:] == turning)
        return max(int(self.times_ns[start + found[0]]), since_ns) if len(found) else None

    def since(self, turning: bool, until_ns: int) -> int:
        """Since when they turned at a time, or stood; that time itself where they did not."""
        last = self._from(until_ns)
        if self.turning[last] != turning:
            return until_ns
        while last > 0 and self.turning[last - 1] == turning:
            last -= 1
        return int(self.times_ns[last])


def judge_recording(file: Path, until_ns: int, complete: bool, timesteps: int | None) -> list[str]:
    """Whether a recording goes on until a time on the host's clock, but for the last second.

    `timesteps`: of the run, by its own figures: it has them all; None: it left no figures.
    """
    broken = []
    with open_recording(file) as recording:
        states = [message.data for message in recording.messages({"/arena"})]
        if recording.complete != complete:
            broken.append(f"{file.name}: complete is {recording.complete}, expected {complete}")
    newest_ns = max((state["capture_ns"] for state in states), default=0)
    if until_ns - newest_ns > LOST_NS:
        broken.append(f"{file.name}: its last {(until_ns - newest_ns) / 1e9:.2f} s are missing")
    if timesteps is not None and len(states) < timesteps:
        broken.append(f"{file.name}: has {len(states)} of {timesteps} timesteps")
    return broken


def judge_end(
    stage: Stage, number: signal.Signals, code: int, took_s: float, logged: bool = True
) -> list[str]:
    """What a lab leaves that was ended by a signal: exit code, figures, nobody that runs.

    `logged`: the wheels' log goes on to the end, and they stand there.
    """
    broken = []
    if code != CODES[number]:
        broken.append(f"exit code {code} after {number.name}: {''.join(stage.lab.said[-3:])}")
    if took_s > END_S:
        broken.append(f"it ended {took_s:.1f} s after {number.name}")
    printed = "".join(stage.lab.printed)
    try:
        timesteps = json.loads(printed)["timesteps"]
    except (ValueError, KeyError):
        timesteps = 0
    if timesteps <= 0:
        broken.append(f"no figures: {printed[:80]!r}")
    broken += _judge_rest(stage)
    turning = [stage.tags[place] for place in stage.places if stage.newest(place) != (0, 0)]
    if logged and turning:
        broken.append(f"wheels turn at the end: {turning}")
    return broken


def _judge_rest(stage: Stage) -> list[str]:
    """Nobody runs any more."""
    broken = []
    for process in stage.restarted:
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            broken.append(f"a daemon that was started again still runs: {process.args!r}")
    if left := stage.lab.relatives():
        broken.append(f"still running: {left}")
    return broken


def judge_kill(stage: Stage, killed_ns: int) -> list[str]:
    """No wheel is told to turn any more soon after the host was killed."""
    rows = stage.rows()
    turn = (rows["left_steps_s"] != 0) | (rows["right_steps_s"] != 0)
    limits_ns = np.array([_limit_ns(stage, place) for place in stage.places])
    late = rows[turn & (rows["time_ns"] > killed_ns + limits_ns[rows["robot"]])]
    tags = sorted({stage.tags[place] for place in late["robot"].tolist()})
    return [f"wheels are told to turn long after the kill: {tags}"] if tags else []
