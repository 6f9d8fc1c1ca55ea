"""`scripts/bench identity`: a long run of the arena tracker, of which every name is checked.

Robots drive, turn and spin below four overlapping cameras, now and then nearly touching. No time is
measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tests.bench.frames import FRAMES_PER_S, MARKER_M, MovingStudio, RenderedSwarm, cameras
from vsense.base.arena import ArenaState, Floats, Frame
from vsense.vision.markers.families import MarkerFamily, choose_tags, load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker

FAMILIES = ("arrow4x4", "arrow4x4-thesis")
ROBOTS = 20
MISNAMED_M = 0.035
"""A name farther than a robot's radius from that robot is wrong."""

_BLUR_MM = 2.2
_REACH_M = (2.0, 1.45)
_CENTRE_M = (1.0, 0.75)
_SEED = 5
_SAY_EVERY = 250


@dataclass(slots=True)
class IdentityScore:
    """Counts of one family's markers.

    Attributes:
        robot_frames: robots times timesteps.
        named: of these, those that the arena state has as seen at their true place.
        wrong_ids: robots that the arena state has as seen where they were not.
        swaps: of these, those at another robot's place.
        wrong_readings: wrong names in single pictures.
        joined: tags that joined the roster, by mistake.
        square_mm2: sum of the squared distances to the truth of those named.
    """

    family: str
    robot_frames: int = 0
    named: int = 0
    wrong_ids: int = 0
    swaps: int = 0
    wrong_readings: int = 0
    joined: int = 0
    square_mm2: float = 0.0

    def judge(self, state: ArenaState, truth: dict[int, Floats]) -> None:
        """Compares an arena state with where the robots are, x and y in m by tag."""
        self.robot_frames += len(truth)
        self.joined = len(state.joined)
        for row in state.robots[state.robots["seen"]]:
            place = np.array((row["x_m"], row["y_m"]))
            tag = int(row["tag"])
            error_m = float(np.hypot(*(place - truth[tag]))) if tag in truth else np.inf
            if error_m < MISNAMED_M:
                self.named += 1
                self.square_mm2 += 1e6 * error_m**2
            else:
                self.wrong_ids += 1
                self.swaps += any(np.hypot(*(place - p)) < MISNAMED_M for p in truth.values())
        for tag, x_m, y_m, _ in state.sightings.tolist():
            there = tag in truth and np.hypot(*(truth[tag] - (x_m, y_m))) < MISNAMED_M
            self.wrong_readings += not there

    def report(self) -> dict[str, Any]:
        """The figures, with `named_share` and `position_rms_mm`."""
        values = asdict(self)
        square = values.pop("square_mm2")
        share = self.named / max(self.robot_frames, 1)
        rms = float(np.sqrt(square / self.named)) if self.named else float("nan")
        return values | {"named_share": share, "position_rms_mm": rms}


def run(timesteps: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Runs the benchmark; its report has `rows`, an `IdentityScore` for each of `FAMILIES`."""
    return {"rows": [_follow(family, timesteps, say).report() for family in FAMILIES]}


def _follow(name: str, timesteps: int, say: Callable[[str], None]) -> IdentityScore:
    family = load_family(name)
    assert isinstance(family, MarkerFamily), "the shipped families are of arrows"
    tags = choose_tags(family, ROBOTS, _BLUR_MM, seed=14)
    rig = cameras(2, 2)
    tracker = ArenaTracker.for_family(rig, family, dict.fromkeys(tags, MARKER_M))
    score = IdentityScore(name)
    for timestep, (frames, poses) in enumerate(_shots(name, tags, timesteps)):
        if timestep % _SAY_EVERY == 0:
            say(f"{name}: timestep {timestep} of {timesteps}")
        score.judge(tracker.update(frames), dict(zip(tags, poses[:, :2], strict=True)))
    tracker.close()
    return score


def _shots(name: str, tags: list[int], timesteps: int) -> Iterator[tuple[list[Frame], Floats]]:
    """Each timestep's pictures, and the robots' poses in mid-exposure."""
    rig = cameras(2, 2)
    studio = MovingStudio(name, tags, rig, _SEED)
    swarm = RenderedSwarm(len(tags), _SEED, _REACH_M)
    centre = np.array((*_CENTRE_M, 0.0))
    for timestep in range(timesteps):
        poses = swarm.drive() + centre
        time_ns = round(1e9 * timestep / FRAMES_PER_S)
        frames = [
            Frame(camera.id, image, timestep, time_ns, time_ns)
            for camera, image in zip(rig, studio.expose(timestep, poses), strict=True)
        ]
        yield frames, poses


def table(report: dict[str, Any]) -> str:
    """The report as text."""
    return "\n".join(
        f"{row['family']}: {row['robot_frames']} robot-frames, {100.0 * row['named_share']:.4f} %"
        f" named, {row['wrong_ids']} wrong ids, {row['swaps']} of them swaps,"
        f" {row['wrong_readings']} wrong readings, {row['joined']} joined;"
        f" position rms {row['position_rms_mm']:.3f} mm"
        for row in report["rows"]
    )
