"""Carries `vsense robot calibrate` and `robot check` out, and keeps what they found."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from vsense.base import clock
from vsense.base.arena import Point
from vsense.base.errors import CutShort, UsageError, VsenseError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, aligned, print_data
from vsense.config import roster
from vsense.config.roster import Roster
from vsense.config.specs import Experiment
from vsense.modes.lab.hardware import EmulatedLab, LabRobots, bases_of
from vsense.modes.lab.session import Session
from vsense.modes.live.session import ExperimentSession, RunSession, RunSetup
from vsense.monitor.ui.access import WebAddress
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link.keys import LinkTrust
from vsense.run import directory as run_directory
from vsense.run.control import State
from vsense.run.homing.floor import DrivingFloor
from vsense.tools.robot_calibration import _driving
from vsense.tools.robot_calibration import _results as results
from vsense.tools.robot_calibration._commanding import (
    CALIBRATE,
    GROUND,
    OWN_SENSORS,
    PROXIMITY,
    OwnReadings,
    WheelsWanted,
    commanded,
)
from vsense.tools.robot_calibration._driving import SwarmCalibration
from vsense.tools.robot_calibration._places import ground_places, spots
from vsense.tools.robot_calibration._results import RobotResult
from vsense.tools.robot_calibration._sensing import Sensing, unmeasured
from vsense.tools.robot_calibration._wiggle import Verdict, WiggleCheck, WiggledRobot, exchanged

CALIBRATION_FILE, CHECK_FILE = "calibration.json", "check.json"

ROBOTS_WAIT_S = 20.0
"""Robots are waited for so long; then it begins without those that are missing."""

GROUND_BASES = ("gctronic", "york", "thymio")
"""Bases of the lab whose robots tell what ground sensors read."""

BLACK_M = 0.05
"""Radius of the black disc that lies on the lab's floor."""


@dataclass(frozen=True, slots=True)
class MeasuringOptions:
    """Robots that are calibrated or checked, and how they are reached.

    Attributes:
        experiment: whose robots and walls; everything in it is placed.
        address: interface and port that robots connect to.
        tracking: the two files of the overhead cameras; None: the experiment names its tracker.
        lab: None: the robots are real.
        roster: what is known of them.
        wait_s: it begins after this time at the latest, without robots that are missing.
        output: folder for files, None: one in `runs/`.
    """

    experiment: Experiment
    seed: int
    address: tuple[str, int]
    trust: LinkTrust
    tracking: tuple[str, str] | None
    lab: EmulatedLab | None
    roster: Roster | None
    web: WebAddress | None
    wait_s: float
    output: Path | None
    as_json: bool

    def robots(self) -> LabRobots:
        """How the lab's robots differ; nothing is known of real ones."""
        return LabRobots() if self.lab is None else self.lab.robots(self.experiment)


@dataclass(frozen=True, slots=True)
class SensorOptions:
    """Which of the robots' own sensors are measured, and where; see `vsense robot calibrate -h`.

    Attributes:
        sensors: some of `KNOWN`.
        wall: id of the white wall; None: any that is near.
        white, black: where the floor is so [m]; None: where the experiment's floor is.
    """

    KNOWN: ClassVar = OWN_SENSORS

    sensors: tuple[str, ...] = ()
    wall: str | None = None
    white: Point | None = None
    black: Point | None = None


@contextmanager
def _session(
    options: MeasuringOptions, experiment: Experiment, directory: Path, robots: LabRobots
) -> Iterator[ExperimentSession]:
    """A session that is not open yet, with a control room."""
    console, lab = Console(), options.lab
    if lab is not None:
        clock.slow(round(lab.pace * 1000))
    room_options = RoomOptions(web=options.web)
    with interruption() as interrupted, ControlRoom(room_options, console) as room:
        setup = RunSetup(
            experiment=experiment,
            seed=options.seed,
            blind=False,
            address=options.address,
            trust=options.trust,
            console=console,
            interrupted=interrupted,
            room=room,
        )
        if lab is None:
            yield RunSession(setup, options.tracking, None)
        else:
            yield Session(setup, directory, lab, robots)


def _exit_code(session: ExperimentSession, succeeded: bool) -> int:
    """0; 1 without success; 130 after Ctrl-C, 143 after SIGTERM."""
    interrupted = session.setup.interrupted
    return interrupted.code if interrupted.is_set() else int(not succeeded)


def _say_interrupted(session: ExperimentSession) -> None:
    if session.setup.interrupted.is_set():
        session.setup.console.say("vsense: interrupted; what was found until then is kept")


def sensing_of(options: MeasuringOptions, asked: SensorOptions) -> Sensing | None:
    """What is measured and where; None: no sensors.

    Raises:
        UsageError: there is no such wall or place, or these options do not go together.
        ConfigError: the picture on the floor cannot be read.
    """
    experiment, sensors, lab = options.experiment, asked.sensors, options.lab
    places = {"wall": asked.wall, "white": asked.white, "black": asked.black}
    for name, place in places.items():
        needed = PROXIMITY if name == "wall" else GROUND
        if place is not None and needed not in sensors:
            raise UsageError(f"--{name} is for {needed} sensors: expected --sensors {needed}")
    if not sensors:
        return None
    if GROUND in sensors and lab is not None:
        types = [experiment.casting.type_of(robot.tag) for robot in experiment.robots]
        kinds = bases_of(lab.base, types)
        if not set(kinds) & {*GROUND_BASES}:
            raise UsageError(
                f"--lab with --base {kinds[0]}: its robots have no ground sensors; expected --base"
                f" {' or '.join(GROUND_BASES)}"
            )
    ground = ground_places(experiment, asked.white, asked.black) if GROUND in sensors else None
    rings = {r.model for r in experiment.robots if not unmeasured(r.model, PROXIMITY)}
    before = {model: spots(experiment, model, asked.wall) for model in rings}
    floor, readings = DrivingFloor.of(experiment), OwnReadings(sensors)
    return Sensing(floor, before if PROXIMITY in sensors else None, ground, readings)


def calibrate(options: MeasuringOptions, asked: SensorOptions = SensorOptions()) -> int:
    """Calibrates all robots that can be, and their sensors that are `asked` for.

    Returns:
        0; 1 where a robot was left out; 130 after Ctrl-C, 143 after SIGTERM.

    Raises:
        VsenseError: no robot is there, or something else than a robot has failed.
    """
    sensing, wheels = sensing_of(options, asked), WheelsWanted()
    experiment = commanded(
        options.experiment, wheels, None if sensing is None else sensing.readings
    )
    # Where markers sit is what is to be found.
    robots = replace(options.robots(), markers={})
    directory = run_directory.make(options.output, experiment.name, options.seed)
    if sensing is not None and sensing.ground is not None:
        robots = replace(robots, black=((*sensing.ground.black, BLACK_M),))
    with _session(options, experiment, directory, robots) as session:
        console = session.setup.console
        console.say(
            f"{len(experiment.robots)} robots with the controller '{CALIBRATE}', one after the"
            f" other where there is no room for all; files in {directory}"
        )
        with session:
            _wait(session, options.wait_s)
            swarm = _driving.drive(session, wheels, directory, console.progress, sensing)
        console.end_progress()
        calibrated = _results(options, session, swarm, robots)
        _say_interrupted(session)
        _keep_calibration(options, experiment, calibrated, directory, console)
        return _exit_code(session, all(robot.is_whole for robot in calibrated))


def _wait(session: ExperimentSession, limit_s: float) -> None:
    """Waits for robots; VsenseError where none is there, CutShort where a signal ends it."""
    readiness = session.wait_patiently(limit_s)
    if session.setup.interrupted.is_set():
        raise CutShort(session.setup.interrupted.code)
    if {robot.id for robot in session.experiment.robots} <= set(readiness.missing):
        # Without a tracker no timestep would ever come to leave them out.
        raise VsenseError(f"no robot can be calibrated: {readiness.missing_text()}")


def _results(
    options: MeasuringOptions,
    session: ExperimentSession,
    swarm: SwarmCalibration,
    robots: LabRobots,
) -> list[RobotResult]:
    ended = session.runner.ended
    cut = "it was interrupted"
    if ended not in ("time", "interrupted"):
        cut = f"the calibration ended before its time: {ended}"
        session.setup.console.say(cut, "warning")
    return [
        RobotResult(
            robot.tag,
            robot.id,
            swarm.fits.get(robot.tag),
            swarm.failed.get(robot.tag, cut),
            robots.hardware.get(robot.tag),
            None if options.roster is None else options.roster.get(robot.tag),
            *swarm.sensors_of(robot.tag, cut),
        )
        for robot in session.experiment.robots
    ]


def _keep_calibration(
    options: MeasuringOptions,
    experiment: Experiment,
    calibrated: list[RobotResult],
    directory: Path,
    console: Console,
) -> None:
    worst = results.worst(calibrated)
    summary: dict[str, Any] = {
        "experiment": experiment.name,
        "robots": [robot.as_json() for robot in calibrated],
        **({"worst_errors": worst} if worst else {}),
    }
    run_directory.write_summary(directory, summary, options.as_json, CALIBRATION_FILE)
    if not options.as_json:
        print_data(results.table(calibrated))
    if worst:
        console.say(_errors(worst))
    lab, fitted = options.roster, [robot for robot in calibrated if robot.fit is not None]
    if lab is None or not fitted:
        return
    today = time.strftime("%Y-%m-%d")
    listed = [robot for robot in fitted if lab.get(robot.tag) is not None]
    roster.update(lab.path, {robot.tag: robot.for_roster(today) for robot in listed})
    for robot in fitted:
        if robot not in listed:
            console.say(f"{lab.path} has no robot with tag {robot.tag}: not written", "warning")
    console.say(
        f"written to {lab.path}: {len(listed)} robots. Their markers count from the next run on;"
        f" 'vsense robot deploy' brings the wheels' factors and scales to the robots"
    )


def _errors(worst: Mapping[str, float]) -> str:
    return (
        f"largest errors: marker {worst['marker_mm']:.2f} mm, {worst['marker_deg']:.2f}"
        f" degrees; distance {100 * worst['distance']:.2f} %, turn {100 * worst['turn']:.2f} %"
    ) + "".join(
        f"; {name} {worst[f'{name}_low']:.1f} raw and {100 * worst[f'{name}_width']:.1f} %"
        for name in OWN_SENSORS
        if f"{name}_low" in worst
    )


def check(options: MeasuringOptions, wiggle: bool) -> int:
    """Looks who is there, and with `wiggle` whether each robot wears its own marker.

    Returns:
        0; 1 where one is not as it should be; 130 after Ctrl-C, 143 after SIGTERM.
    """
    experiment, robots = options.experiment, options.robots()
    directory = run_directory.make(options.output, f"{experiment.name}-check", options.seed)
    with _session(options, experiment, directory, robots) as session:
        checked = _check(session, directory, options.wait_s, wiggle)
        session.setup.console.end_progress()
        _keep_check(options, checked, directory, session.setup.console, wiggle)
        _say_interrupted(session)
        return _exit_code(session, all(robot.verdict is Verdict.OK for robot in checked))


def _check(
    session: ExperimentSession, directory: Path, wait_s: float, wiggle: bool
) -> Sequence[WiggledRobot]:
    console, names = session.setup.console, {r.tag: r.id for r in session.experiment.robots}
    turns = WiggleCheck(names)
    with session:
        session.setup.room.begin_run(session.environment, directory)
        try:
            readiness = session.wait_patiently(wait_s)
            if not readiness.complete:
                console.say(readiness.missing_text(), "warning")
            if not wiggle:
                away = dict.fromkeys(readiness.unseen, "is not seen")
                away |= dict.fromkeys(readiness.absent, "is not connected") | dict(readiness.away)
                return [
                    WiggledRobot(tag, name, why=away.get(name, ""), commanded=False)
                    for tag, name in names.items()
                ]
            console.say(f"{len(names)} robots turn one after the other: keep hands off")
            session.runner.home(turns)
        finally:
            session.stop()
            session.setup.room.recorders.end_run()
    control = session.runner.control
    stopped = control.why if control.state in (State.ENDED, State.EMERGENCY) else ""
    return turns.ended(stopped if stopped.startswith(("stop", "emerg")) else "was not reached")


def _keep_check(
    options: MeasuringOptions,
    checked: Sequence[WiggledRobot],
    directory: Path,
    console: Console,
    wiggle: bool,
) -> None:
    """Shows what was found and keeps it, and says what is to be changed."""
    pairs = exchanged(checked)
    summary: dict[str, Any] = {
        "experiment": options.experiment.name,
        "wiggled": wiggle,
        "robots": [_as_json(robot) for robot in checked],
        "exchanged": [list(pair) for pair in pairs],
    }
    run_directory.write_summary(directory, summary, options.as_json, CHECK_FILE)
    if not options.as_json:
        rows = [(str(r.tag), r.name, r.verdict.value, r.words) for r in checked]
        print_data("\n".join(aligned([("tag", "robot", "", ""), *rows])))
    for pair in pairs:
        console.say(swapped(pair, options.roster), "warning")
    good = sum(robot.verdict is Verdict.OK for robot in checked)
    console.say(f"{good} of {len(checked)} robots are as they should be; {directory / CHECK_FILE}")


def _as_json(robot: WiggledRobot) -> dict[str, Any]:
    moved_m = robot.moved_m
    return {
        "tag": robot.tag,
        "name": robot.name,
        "verdict": robot.verdict.value,
        "turned_deg": {
            str(marker): round(math.degrees(rad), 1) for marker, rad in robot.turned_rad.items()
        },
        "moved_mm": None if moved_m is None else round(1000.0 * moved_m, 1),
        "text": robot.words,
    }


def swapped(pair: tuple[int, int], lab: Roster | None) -> str:
    """What is to be done about two robots that wear each other's markers."""
    first, second = pair
    line = f"robots {first} and {second} wear each other's markers: exchange these"
    entries = [] if lab is None else [entry for tag in pair if (entry := lab.get(tag))]
    if lab is None or len(entries) < 2:
        return f"{line}, or their tags in the roster, and bring them there: vsense robot deploy"
    return (
        f"{line}, or their tags in {lab.path}: tag = {second} for the robot of line"
        f" {entries[0].line}, tag = {first} for that of line {entries[1].line}, and then"
        f" vsense robot deploy --tags {first},{second}"
    )
