"""Experiments in the lab: one run after the other, each reported when it is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vsense.base import clock
from vsense.base.errors import CutShort, UsageError, VsenseError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, spoken
from vsense.config.specs import Experiment
from vsense.modes import origin
from vsense.modes._several import Series
from vsense.modes.lab import _report, calibrated
from vsense.modes.lab._camera_spec import cameras_above
from vsense.modes.lab.calibrated import CalibratedRig
from vsense.modes.lab.hardware import EmulatedLab, report_all
from vsense.modes.lab.session import Session
from vsense.modes.live.opening import StagedOptions, check_ports, say_link, say_trust
from vsense.modes.live.session import RunSetup
from vsense.modes.options import say_warnings
from vsense.monitor.recording.measures import measures_of
from vsense.monitor.ui.publisher import leds_of
from vsense.monitor.ui.room import ControlRoom
from vsense.robots.link.key_process import KeyProcess
from vsense.robots.link.keys import INSECURE, LinkTrust
from vsense.run import directory as run_directory
from vsense.run.runs_csv import RunRows
from vsense.run.runtime import Step
from vsense.run.verdict import exit_code

COMPLAINTS_TIMESTEP = 10
"""By then every controller has begun and reported what it misses."""


@dataclass(frozen=True, slots=True)
class LabOptions(StagedOptions):
    """How an experiment runs in the lab.

    The robots' port, and whether they have keys, are the link's.

    Attributes:
        lab: what it is made of.
    """

    lab: EmulatedLab = field(default_factory=EmulatedLab)


def run(options: LabOptions) -> int:
    """Runs an experiment in the lab and reports about it, also after a failure.

    Returns:
        0, or 130 after Ctrl-C, 143 after SIGTERM: what was measured by then is reported, too.

    Raises:
        UsageError: something does not go together, before anything is started.
        VsenseError: the lab cannot be made, or has failed.
    """
    asked = options.experiment
    opened = asked.load()
    link = options.link.in_lab(opened)
    check_ports(options.room, link, opened)
    set_pace(options.lab.pace, opened.host)
    starts = options.starts_of(opened)
    experiment, seed, directory = asked.prepare(opened)
    console = Console()
    _warn(console, experiment, directory)
    with interruption() as interrupted, ControlRoom(options.room, console) as room:
        with interrupted.at_once():
            rig = calibrate_cameras(options.lab, experiment, seed, directory, console)
        if rig is not None:
            console.say(f"camera files and report: {directory / calibrated.CAMERAS_FOLDER}")
        robots = options.lab.robots(experiment)
        setup = RunSetup(
            experiment,
            seed,
            asked.blind,
            link.address(experiment),
            _trust(options, console),
            console,
            interrupted,
            room,
            asked.made_of(experiment, seed) | report_all(robots.hardware),
            starts,
            options.battery,
        )
        session = Session(setup, directory, options.lab, robots, rig, link.legacy_port)
        return _LabRuns.of(session, options).run(options.json)


@dataclass(frozen=True, slots=True)
class _LabRuns:
    """All runs of a lab.

    Attributes:
        unreported: why runs ended of which there are no figures, or what was lacking of these.
    """

    session: Session
    series: Series
    rows: RunRows
    unreported: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, session: Session, options: LabOptions) -> _LabRuns:
        """The runs of a lab that is not open yet."""
        setup, directory, runs = session.setup, session.directory, options.room.runs
        name, interrupted, say = setup.experiment.name, setup.interrupted, setup.console.say
        series = Series(name, directory, runs, setup.room.holds, interrupted, say)
        rows = RunRows(directory, "lab", dict(options.experiment.settings))
        return cls(session, series, rows)

    def run(self, on_stdout: bool) -> int:
        """Carries out all runs; gives the exit code. Raises as `run`."""
        session, setup, failure = self.session, self.session.setup, None
        with session:
            say_link(session.server, session.doubts(), setup.console)
            try:
                while (failure := self._carry_out()) is None and self._goes_on():
                    session.next_run()
            except VsenseError as error:
                setup.room.fail(error)
                failure = error
        setup.console.end_progress()
        with setup.interrupted.in_time():
            self.series.end(failure, on_stdout)
        broken = self.series.was_broken(session.runner.control)
        code = exit_code(self.series.summaries, self.unreported)
        return setup.interrupted.code if broken else code

    def _goes_on(self) -> bool:
        return self.series.goes_on(self.session.runner)

    def _carry_out(self) -> VsenseError | None:
        """Carries a run out and reports about it; returns what has failed in it."""
        session, room, console = self.session, self.session.setup.room, self.session.setup.console
        number, failure = session.runner.control.run, None
        directory = self.series.directory(number)
        room.begin_run(session.environment, directory)
        session.wait_until_ready()
        session.home()
        _announce(console, session, directory)
        self.rows.begin(number)
        try:
            session.run(directory, _progress(console, session))
        except VsenseError as error:
            room.fail(error)
            failure = error
        room.recorders.end_run()
        console.end_progress()
        try:
            with session.setup.interrupted.in_time():
                self._report()
        except CutShort:
            console.say(f"vsense: no time for the figures; the run's logs are in {directory}")
            if failure is not None:
                console.say(f"vsense: {failure}", "trouble")
            raise
        return failure

    def _report(self) -> None:
        """Reports about the newest run; what fails in that costs no other run."""
        say, notes = self.session.setup.console.say, self.session.notes
        assert notes is not None
        if not len(notes.figures.steps):
            say("vsense: the run ended before its first timestep: nothing was measured")
            self.unreported.append(notes.record.ended)
            return
        try:
            report_run(self.session, self._keep, say)
        except VsenseError as error:
            text = f"run {self.session.runner.control.run} is not reported as a whole: {error}"
            say(f"vsense: {text}", "trouble")
            self.unreported.append(text)

    def _keep(self, summary: dict[str, Any]) -> None:
        self.series.add(summary)
        if lacks := self.rows.add(summary, self.session.experiment):
            self.session.setup.console.say(lacks, "trouble")


def _trust(options: LabOptions, console: Console) -> LinkTrust:
    trust = INSECURE if options.link.insecure else LinkTrust(KeyProcess())
    say_trust(trust, console.say)
    return trust


def calibrate_cameras(
    lab: EmulatedLab, experiment: Experiment, seed: int, folder: Path, console: Console
) -> CalibratedRig | None:
    """Hangs and calibrates the cameras of all runs, and says how well they are known.

    None: they are known exactly. VsenseError: they cannot be calibrated.
    """
    if not lab.calibrate:
        return None
    ideal, height_m = cameras_above(experiment, lab.cameras), experiment.marker.height_m
    rig = calibrated.calibrate(ideal, experiment.arena, height_m, seed, folder, console.progress)
    console.end_progress()
    console.say(rig.in_words())
    return rig


def set_pace(pace: float, host: str) -> None:
    """Has all clocks go at a pace; UsageError where robots on other machines could come."""
    if pace != 1.0 and not host.startswith("127."):
        raise UsageError(
            "--pace: the robots of a slow lab are on this machine only: expected a vss_host of"
            f" 127.0.0.1, got {host}; --set experiment.vss_host=127.0.0.1"
        )
    clock.slow(round(pace * 1000))


def _warn(console: Console, experiment: Experiment, directory: Path) -> None:
    """Says what will not be as somebody may expect, and keeps what the runs are made from."""
    say_warnings(experiment, console)
    origin.keep(directory, "lab", [experiment], console.say)
    if experiment.tracker is not None:
        place = f"{experiment.file}:{experiment.tracker.line}"
        console.say(f"vsense: {place}: its tracker is left alone: the lab has its own cameras")


def _announce(console: Console, session: Session, directory: Path) -> None:
    experiment = session.experiment
    console.say(
        f"{experiment.name}: {len(experiment.robots)} robots, seed {session.environment.seed},"
        f" {experiment.length_s:g} s; logs in {directory}"
    )
    camera = session.cameras[0]
    if len(session.cameras) != 4:
        console.say(
            f"{len(session.cameras)} cameras, {camera.position_m[2]:.2f} m high, pictures of"
            f" {camera.width_px} x {camera.height_px} pixels"
        )
    if clock.pace() != 1.0:
        console.say(f"pace {clock.pace():g}: all times are of the lab's clock, which is so slow")


def _progress(console: Console, session: Session) -> Callable[[Step], None]:
    """Makes the function that updates the live line."""
    experiment = session.experiment
    length = f"/{experiment.length_s:g}" if experiment.length_s else ""

    def show(step: Step) -> None:
        if step.run_timestep == COMPLAINTS_TIMESTEP:
            for complaint in session.swarm.complaints():
                console.say(f"vsense: {complaint}")
        robots = session.runner.robots
        connected = sum(robot.connected for robot in robots.values())
        measures = measures_of(session.environment.world, robots, leds_of(robots))
        measured = "".join(f"  {spoken(name)} {value:.3g}" for name, value in measures.items())
        latency_ms = (step.sent_ns - step.ready_ns) / 1e6
        console.progress(
            f"{step.run_timestep * experiment.timestep_s:5.1f}{length} s"
            f"  timestep {step.run_timestep}  robots {connected}/{len(robots)}"
            f"{measured}  picture to sent {latency_ms:.0f} ms"
        )

    return show


def report_run(
    session: Session,
    keep: Callable[[dict[str, Any]], None],
    say: Callable[[str], None] = lambda text: None,
) -> None:
    """Measures the newest run, writes and says its figures.

    `keep` takes its summary, whatever the disk then takes of it.

    Raises:
        VsenseError: logs cannot be read, or a file cannot be written.
    """
    notes = session.notes
    assert notes is not None
    measured = _report.gather(session, notes)
    summary = _report.summarise(session, notes, measured)
    say(_report.table(summary))
    keep(summary)
    run_directory.write_summary(notes.directory, summary, False)
    if summary["unlogged_timesteps"]:
        say("no picture: the logs end before the run")
        return
    path = notes.directory / f"{session.experiment.name}.png"
    _report.draw(session, notes, measured, path)
    say(f"picture: {path}")
