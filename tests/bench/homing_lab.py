"""The way home in the lab: `scripts/bench homing --lab` prints the table of `scripts/bench homing`.

Here cameras, tracker, network, host and daemons are the real ones. The robots are far from the
host: so many of their packets are lost (`tests/faults/relay.py`, which needs the right to make a
network of its own). Wheels and axles are not what they should be, one robot's daemon is killed as
the way home begins, and a hand is held over another one for a while. What is judged is the truth of
the lab's physics; all times are of the lab's clock.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tests.bench import homing as table
from tests.bench.homing import LOSS, UNSEEN_S, WHEELS, ContactTimes, HomingRow
from tests.faults.lab import FarSwarm
from tests.faults.relay import LOOP_NET, Relay, Weather
from tests.rigs.places import ROOT
from vsense.base import clock
from vsense.base.arena import ArenaState, Floats, Frame
from vsense.base.interruption import Interruption, interruption
from vsense.base.shared import LabError
from vsense.base.terminal import Console
from vsense.config import experiment as files
from vsense.config.placement import settle
from vsense.config.specs import Stage
from vsense.modes.lab import session as lab_session
from vsense.modes.lab._grabber import LabGrabber
from vsense.modes.lab.hardware import HardwareErrors, LabRobots, draw_all
from vsense.modes.lab.session import Session
from vsense.modes.live.session import RunSetup
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link.key_process import KeyProcess
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.table import Goal
from vsense.run.homing import starts
from vsense.run.homing._homing import Homing
from vsense.run.homing.robots import Trouble
from vsense.run.homing.starts import Starts
from vsense.run.runtime import Step
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.world.physics.motion import TICK_NS

EXPERIMENT = "aggregation"
HOST, PORT = f"{LOOP_NET}.1", 4050
SEEDS = 3
PACE = 0.25
READY_S = 60.0
ELSEWHERE = 1000
"""Robots stand where the experiment would put them with a seed that is so much larger."""
HAND_M = 0.06
"""Half the side of what is held over a robot."""
INSIDE = "VSENSE_HOMING_INSIDE"


class Hand:
    """A grabber in whose pictures something grey is held over a robot for a while.

    Attributes:
        begun_ns: from when its time counts; None: it is not there yet.
    """

    def __init__(self, grabber: LabGrabber, session: FarSession, row: int, height_m: float) -> None:
        self.begun_ns: int | None = None
        self._grabber, self._session, self._row, self._height_m = grabber, session, row, height_m

    def __getattr__(self, name: str) -> object:
        return getattr(self._grabber, name)

    def next(self, timeout_s: float) -> list[Frame]:
        """As `Grabber.next`; a picture in which the robot is hidden is a copy."""
        frames = self._grabber.next(timeout_s)
        since_s = 0.0 if self.begun_ns is None else (frames[0].capture_ns - self.begun_ns) / 1e9
        if self.begun_ns is None or not UNSEEN_S[0] <= since_s < UNSEEN_S[1]:
            return frames
        x_m, y_m, _ = self._session.true_poses(frames[0].capture_ns)[self._row]
        return [
            self._covered(frame, camera, (x_m, y_m))
            for frame, camera in zip(frames, self._grabber.cameras)
        ]

    def _covered(self, frame: Frame, camera: Camera, place: tuple[float, float]) -> Frame:
        corners = np.array(
            [
                (place[0] + i * HAND_M, place[1] + j * HAND_M, self._height_m)
                for i in (-1, 1)
                for j in (-1, 1)
            ]
        )
        seen = camera.project(corners)
        (left, top), (right, bottom) = np.rint(seen.min(axis=0)), np.rint(seen.max(axis=0))
        image = frame.image.copy()
        image[max(0, int(top)) : max(0, int(bottom)), max(0, int(left)) : max(0, int(right))] = 110
        return replace(frame, image=image)


class TimedHoming(Homing):
    """What each step cost [ms] is in `costs`."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.costs = list[float]()

    def step(self, state: ArenaState, troubles: Mapping[int, Trouble]) -> dict[int, Goal]:
        """See `Homing.step`."""
        began_s = time.thread_time()
        goals = super().step(state, troubles)
        self.costs.append((time.thread_time() - began_s) * 1e3)
        return goals


class FarSession(Session):
    """A lab in which one robot dies when the way home begins, and one is not seen for a while."""

    def __init__(self, setup: RunSetup, directory: Path, robots: LabRobots) -> None:
        super().__init__(setup, directory, "mixed", robots=robots)
        self.contacts: ContactTimes | None = None
        self._looked_ns = 0

    def true_poses(self, time_ns: int) -> Floats:
        """(n, 3) of all bodies at a moment."""
        return self._truth.at(time_ns)[0]

    def _track(self, grabber: LabGrabber) -> CameraTracking:
        self.hand = Hand(grabber, self, 0, self.experiment.marker.height_m)
        return super()._track(self.hand)  # type: ignore[arg-type]

    def _observe(self, step: Step | None, robots: Mapping[int, RobotStatus]) -> None:
        super()._observe(step, robots)
        if self.contacts is None:
            return
        newest_ns = self._truth.newest_ns()
        self._looked_ns = self._looked_ns or newest_ns - TICK_NS
        while self._looked_ns + TICK_NS <= newest_ns:
            self._looked_ns += TICK_NS
            try:
                self.contacts.tick(self.true_poses(self._looked_ns))
            except LabError:
                print(f"the truth was looked at too late: {self._looked_ns}", file=sys.stderr)

    def drive_home(self) -> tuple[Homing | None, Floats]:
        """Kills a robot and drives the others home; gives how it went, and all true poses."""
        dead = self.experiment.robots[-1].tag
        os.kill(self.swarm._processes[dead].pid, signal.SIGKILL)
        self.contacts = ContactTimes()
        self.hand.begun_ns = clock.host_ns()
        return self.home(), self.true_poses(self._truth.newest_ns())


def one_seed(
    seed: int, folder: Path, interrupted: Interruption, console: Console
) -> HomingRow | None:
    """Makes a lab, and drives its robots home; None: it was interrupted."""
    known = replace(files.load(EXPERIMENT, stage=Stage.LAB), host=HOST)
    tags = [robot.tag for robot in known.robots]
    robots = LabRobots(draw_all(tags, HardwareErrors(wheel=WHEELS, seed=seed)))
    directory = folder / f"seed-{seed}"
    directory.mkdir()
    with ControlRoom(RoomOptions(), console) as room:
        setup = RunSetup(
            *(settle(known, ELSEWHERE + seed), seed, False, (HOST, PORT)),
            *(LinkTrust(KeyProcess()), console, interrupted, room),
            starts=Starts(known),
        )
        session = FarSession(setup, directory, robots)
        with session:
            room.begin_run(session.environment, directory)
            readiness = session.wait_patiently(READY_S)
            if interrupted.is_set():
                return None
            if not readiness.complete:
                raise SystemExit(f"seed {seed}: {readiness.missing_text()}; see {directory}")
            homing, poses = session.drive_home()
    if interrupted.is_set():
        return None
    assert isinstance(homing, TimedHoming) and session.contacts is not None
    able = [row for row, tag in enumerate(tags) if tag != tags[-1]]
    homes = np.array([homing.robots[tags[row]].home for row in able])
    found = homes, poses[able], session.contacts, homing.costs
    return table.row_of(seed, homing.spent_s, *found)


def inside(options: argparse.Namespace) -> int:
    """All seeds, in a network of their own."""
    clock.slow(round(options.pace * 1000))
    FarSwarm.net = LOOP_NET
    lab_session.Swarm = FarSwarm  # type: ignore[misc]
    starts.Homing = TimedHoming  # type: ignore[misc]
    rows, console = list[HomingRow](), Console()
    relay, lost = Relay(PORT, options.first, LOOP_NET), Weather(loss=LOSS)
    relay.set(lost, lost, range(256))
    with interruption() as interrupted, TemporaryDirectory(prefix="vsense-homing-") as folder:
        for seed in range(options.first, options.first + options.seeds):
            row = one_seed(seed, Path(folder), interrupted, console)
            if row is None:
                break
            rows.append(row)
            console.say(table.told(row))
    relay.close()
    if not rows:
        return interrupted.code
    report = table.report_of(rows)
    print(json.dumps(report, indent=2) if options.json else table.table(report))
    return interrupted.code if interrupted.is_set() else 0


def main(words: list[str] | None = None) -> int:
    """Parses the command's words; begins anew in a network of its own."""
    parser = argparse.ArgumentParser(prog="scripts/bench homing --lab", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help="how many labs")
    parser.add_argument("--first", type=int, default=1, metavar="S", help="its seed")
    parser.add_argument("--pace", type=float, default=PACE, metavar="P", help="as of vsense lab")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    words = sys.argv[1:] if words is None else words
    options = parser.parse_args(words)
    if INSIDE in os.environ:
        return inside(options)
    command = ["unshare", "--net", sys.executable, "-m", "tests.bench.homing_lab", *words]
    environment = {**os.environ, INSIDE: "1", "PYTHONPATH": str(ROOT)}
    os.chdir(ROOT)
    try:
        os.execvpe(command[0], command, environment)
    except OSError as error:
        raise SystemExit(f"unshare (package util-linux): {error.strerror}") from None


if __name__ == "__main__":
    sys.exit(main())
