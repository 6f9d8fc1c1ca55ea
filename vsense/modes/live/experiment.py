"""Experiments with real robots: one run after the other, each reported when it is over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense.base.errors import VsenseError, failing_as
from vsense.base.interruption import interruption
from vsense.config.experiment import first_robots
from vsense.config.roster_fields import MarkerOffset
from vsense.config.specs import Experiment
from vsense.modes import origin
from vsense.modes._several import Series
from vsense.modes.live._talk import told_of
from vsense.modes.live.opening import (
    StagedOptions,
    check_ports,
    lease_robots,
    require_source,
    say_link,
    say_trust,
    trust_of,
    with_tracker,
)
from vsense.modes.live.run import OneRun
from vsense.modes.live.session import ROBOT_WAIT_S, RunSession, RunSetup
from vsense.modes.options import say_warnings
from vsense.monitor.ui.room import ControlRoom
from vsense.robots.link.keys import LinkTrust
from vsense.run import directory as run_directory
from vsense.run.directory import RunLog
from vsense.run.leases import RobotLeases
from vsense.run.link_check import RunLinkCheck
from vsense.run.robots import Readiness
from vsense.run.runs_csv import RunRows
from vsense.run.verdict import exit_code


@dataclass(frozen=True, slots=True)
class RealOptions(StagedOptions):
    """How an experiment runs with real robots.

    Attributes:
        markers: by tag, where markers sit on their robots.
        start_after: a run starts after so long [s], without whoever is missing; None: with all.
    """

    markers: Mapping[int, MarkerOffset] = field(default_factory=dict)
    start_after: float | None = None


def run(options: RealOptions) -> int:
    """Runs an experiment with real robots and reports about every run, also after a failure.

    Returns:
        0, or 130 after Ctrl-C, 143 after SIGTERM in a run: what was measured until then is
        reported all the same.

    Raises:
        UsageError: something is missing or does not go together, before anything is started.
        VsenseError: robots, ports, keys or files cannot be had, or a run has failed.
    """
    opened = replace(options.experiment.load(), markers=options.markers)
    link = options.link
    opened = with_tracker(opened, link.tracker)
    require_source(opened, link.tracking)
    trust = trust_of(link.key, link.insecure)
    tags = [robot.tag for robot in first_robots(opened, options.experiment.robots).robots]
    with lease_robots(tags, "run", opened.name, link.address(opened)[0]) as leases:
        check_ports(options.room, link, opened)
        return _run_leased(options, opened, trust, leases)


def _run_leased(
    options: RealOptions,
    opened: Experiment,
    trust: LinkTrust,
    leases: RobotLeases | None,
) -> int:
    """As `run`, with the robots that nobody else has."""
    asked = options.experiment
    experiment, seed, directory = asked.prepare(opened, real=False)
    with failing_as(run_directory.DirectoryError, f"cannot write to {directory}"):
        (directory / experiment.path.name).write_bytes(experiment.path.read_bytes())
    with (
        RunLog(directory) as log,
        interruption() as interrupted,
        ControlRoom(options.room, log) as room,
    ):
        say_warnings(experiment, log)
        origin.keep(directory, "run", [experiment], log.say, more_files=options.link.tracking or ())
        setup = RunSetup(
            experiment,
            seed,
            asked.blind,
            options.link.address(opened),
            trust,
            log,
            interrupted,
            room,
            asked.made_of(experiment, seed),
            options.starts_of(opened),
            options.battery,
            (lambda tags: None) if leases is None else leases.take,
            options.link.other_programs,
        )
        name, runs = experiment.name, options.room.runs
        series = Series(name, directory, runs, room.holds, interrupted, log.say)
        rows = RunRows(directory, "run", dict(asked.settings))
        return _RealRuns(options, setup, directory, log, series, rows).run()


@dataclass(frozen=True, slots=True)
class _RealRuns:
    """All runs until they are reported; `directory` is that of all."""

    options: RealOptions
    setup: RunSetup
    directory: Path
    log: RunLog
    series: Series
    rows: RunRows

    def run(self) -> int:
        """Carries out all runs; see `run`."""
        options, setup = self.options, self.setup
        session = RunSession(setup, options.link.tracking, options.link.legacy_port)
        unmeasured = list[str]()
        failure: VsenseError | None = None
        with session:
            self._announce(session)
            try:
                while self._carry_out(session, unmeasured):
                    if not self.series.goes_on(session.runner):
                        break
                    session.next_run()
            except VsenseError as error:
                failure = error
        self.log.end_progress()
        self.series.end(failure, options.json)
        broken = self.series.was_broken(session.runner.control)
        code = exit_code(self.series.summaries, unmeasured)
        return setup.interrupted.code if broken else code

    def _carry_out(self, session: RunSession, unmeasured: list[str]) -> bool:
        """Waits, carries out a run and reports; False if the wait was interrupted."""
        number = session.runner.control.run
        directory = self.series.directory(number)
        self.setup.room.begin_run(session.environment, directory)
        span_s = self.options.link.link_check if number == 1 else 0.0
        dt_s = session.experiment.timestep_s
        check = RunLinkCheck(session.server, span_s, dt_s, self.log.say)
        readiness = self._wait(session, number, check)
        session.home()
        if self.setup.interrupted.is_set():
            self.log.end_progress()
            self.log.say("vsense: interrupted before the run: nothing was measured")
            return False
        run = OneRun(session, directory, readiness, self.log, check)
        self.rows.begin(number)
        run.run()
        self.setup.room.recorders.end_run()
        summary = run.report()
        if summary is None:
            unmeasured.append(session.runner.ended)
        else:
            self.series.add(summary)
            if lacks := self.rows.add(summary, session.experiment):
                self.log.say(lacks, "trouble")
        if run.failure is not None:
            raise run.failure
        return True

    def _announce(self, session: RunSession) -> None:
        setup, say = self.setup, self.log.say
        experiment, host = setup.experiment, setup.address[0]
        length = f"{experiment.length_s:g} s" if experiment.length_s else "until Ctrl-C"
        say(
            f"{experiment.name}: {len(experiment.robots)} robots, seed {setup.seed}, {length};"
            f" notes in {self.directory}"
        )
        say(f"arena states come from {session.source.name}")
        if session.source.own is not None and (text := told_of(session.source.own.session)):
            say(text)
        say(
            f"waiting for robots on {host}, port {session.port}:"
            f" vsensed --host ADDRESS --port {session.port} --tag TAG --base BASE"
            f" {'--insecure' if setup.trust.keys is None else '--key FILE'}"
        )
        say_trust(setup.trust, lambda text: say(text, "warning"))
        say_link(session.server, session.doubts(), self.log)
        if host.startswith("127.") or host == "localhost":
            say("only robots on this machine reach that address; for others: --host 0.0.0.0")

    def _wait(self, session: RunSession, number: int, check: RunLinkCheck) -> Readiness:
        """Waits until all are there, for the time that is set, or until a START; makes a `check`.

        Raises as `ExperimentSession.wait_for_some`.
        """
        if number > 1:
            self.log.say(f"run {number}, seed {session.environment.seed}")
        limit_s = self.options.start_after
        if limit_s is None and number > 1:
            limit_s = ROBOT_WAIT_S
        readiness = session.wait_for_some(limit_s, check)
        if check.cut_short:
            self.log.say("the check of the links has not come to its end: nothing is kept of it")
        return readiness
