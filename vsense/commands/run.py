"""`vsense run`: an experiment with real robots."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError, failing_as
from vsense.base.terminal import interruption, print_data
from vsense.commands import arguments, experiments, hardware, homes
from vsense.config.framework import LINES_PORT
from vsense.config.specs import Experiment, JsonLinesTracker, Stage, TrackerAddress
from vsense.modes.live.run import OneRun
from vsense.modes.live.session import PATIENCE_S, RunSession, RunSetup
from vsense.modes.live.sources import require_source
from vsense.monitor.ui.room import ControlRoom
from vsense.robots.link.keys import LinkTrust
from vsense.run import directory as run_directory
from vsense.run.directory import RunLog
from vsense.run.leases import RobotLeases
from vsense.run.robots import Readiness
from vsense.run.runs_csv import RunRows
from vsense.run.several import Series
from vsense.studies.packages import origin
from vsense.vision.calibration.checked import told_of

DESCRIPTION = (
    "Runs an experiment with real robots. The arena state comes from cameras of your own"
    " (--tracking), or from the tracker that the experiment's <framework> names: one that speaks"
    " the original protocol (ats_host, ats_port) or any other one (<vs:tracker format='lines' />)."
    " All robots that are connected and seen start on one signal. Where arena states stay out the"
    " robots stand still until they are back; whoever drops out may come back at any time. The run"
    " ends after its length, or with Ctrl-C."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    experiments.add_experiment(parser, Stage.RUN)
    experiments.add_settings(parser)
    add_ends(parser)
    experiments.add_legacy_port(parser)
    text = "start after S s at the latest, without whoever is missing (default: wait for all)"
    arguments.option(parser, "--start-after", arguments.seconds, "S", text)
    text = (
        "serve the devices of ARGoS's elements, such as <epuck_ground>, from the virtual world, as"
        " in the lab; the ring of proximity sensors stays the robots' own"
    )
    arguments.flag(parser, "--virtual-devices", text)
    arguments.option(
        parser, "-o --output", Path, "DIR", "folder for notes and figures (default: runs/...)"
    )
    experiments.add_room(parser)


def add_ends(parser: argparse.ArgumentParser) -> None:
    """Declares where the arena state comes from, and where the robots connect to."""
    eyes = parser.add_mutually_exclusive_group()
    eyes.add_argument(
        "--tracking",
        nargs=2,
        metavar=("RESOURCES", "SESSION"),
        help="track with these two files of `vsense track`: cameras, or recordings in their place",
    )
    text = (
        "use this tracker, whatever the file names: ADDRESS:PORT speaks the original protocol;"
        f" lines (port {LINES_PORT}) or lines:PORT is one that connects to this machine and writes"
        " lines, such as that of `vsense robot emulate`"
    )
    arguments.option(eyes, "--tracker", arguments.tracker, "WHERE", text)
    text = "interface that robots connect to, 0.0.0.0: all (default: the file's vss_host)"
    arguments.option(parser, "--host", str, "ADDRESS", text)
    text = "TCP and UDP port; 0 takes a free one (default: the file's vss_port)"
    arguments.option(parser, "--port", arguments.port, "P", text)
    experiments.add_trust(parser)


def run(options: argparse.Namespace) -> int:
    """Runs an experiment with real robots and reports about every run, also after a failure.

    Returns:
        0, or 130 after Ctrl-C, 143 after SIGTERM in a run: what was measured until then is
        reported all the same.
    """
    opened = experiments.open_experiment(options)
    if opened is None:
        return 0
    opened = replace(opened, markers=hardware.markers_of(options))
    opened = with_tracker(opened, options.tracker)
    require_source(opened, options.tracking)
    trust = experiments.trust_of(options)
    host = opened.host if options.host is None else options.host
    port = opened.port if options.port is None else options.port
    with experiments.lease_robots(options, opened, host) as leases:
        experiments.check_doors(options, host, port)
        return _run_leased(options, opened, (host, port), trust, leases)


def _run_leased(
    options: argparse.Namespace,
    opened: Experiment,
    address: tuple[str, int],
    trust: LinkTrust,
    leases: RobotLeases | None,
) -> int:
    """As `run`, with the robots that nobody else has."""
    experiment, seed, directory = experiments.prepare(options, opened, real=False)
    with failing_as(run_directory.DirectoryError, f"cannot write to {directory}"):
        (directory / experiment.path.name).write_bytes(experiment.path.read_bytes())
    with (
        RunLog(directory) as log,
        interruption() as interrupted,
        ControlRoom(experiments.room_of(options), log) as room,
    ):
        experiments.say_warnings(log, experiment)
        origin.keep(directory, "run", [experiment], log.say, others=options.tracking or ())
        made = experiments.made_of(options, experiment, seed)
        setup = RunSetup(
            *(experiment, seed, options.blind, address, trust, log, interrupted, room, made),
            homes.starts_of(options, opened),
            options.battery,
            (lambda tags: None) if leases is None else leases.take,
        )
        series = Series(directory, options.runs, room.holds, interrupted)
        rows = RunRows(directory, "run", dict(options.set))
        return RunCommand(options, setup, directory, log, series, rows).run()


def with_tracker(experiment: Experiment, where: tuple[str, int] | None) -> Experiment:
    """The experiment with the tracker of `--tracker`, None: its own."""
    if where is None:
        return experiment
    (host, port), named = where, experiment.tracker
    if not host:
        lines = JsonLinesTracker("127.0.0.1", LINES_PORT, 0)
        lines = named if isinstance(named, JsonLinesTracker) else lines
        return replace(experiment, tracker=replace(lines, port=port or lines.port))
    original = TrackerAddress(host, port, (0.0, 0.0), 0.0, 0)
    original = named if isinstance(named, TrackerAddress) else original
    return replace(experiment, tracker=replace(original, host=host, port=port))


@dataclass(frozen=True, slots=True)
class RunCommand:
    """One call of the command, until all its runs are reported; `directory` is that of all runs."""

    options: argparse.Namespace
    setup: RunSetup
    directory: Path
    log: RunLog
    series: Series
    rows: RunRows

    def run(self) -> int:
        """Carries out all runs; see `run`."""
        options, setup = self.options, self.setup
        session = RunSession(setup, options.tracking, options.legacy_port)
        summaries: list[dict[str, Any]] = []
        failure: VsenseError | None = None
        with session:
            self._announce(session)
            try:
                while self._one_run(session, summaries) and self.series.goes_on(session.runner):
                    session.next_run()
            except VsenseError as error:
                failure = error
        self.log.end_progress()
        if summaries and not self.series.several and options.json:
            print_data(json.dumps(summaries[0], indent=2))
        self.series.write_summary(setup.experiment.name, summaries, options.json)
        if failure is not None:
            raise failure
        return self.setup.interrupted.code if self.series.was_broken(session.runner.control) else 0

    def _one_run(self, session: RunSession, summaries: list[dict[str, Any]]) -> bool:
        """Waits, carries out a run and reports; False if the wait was interrupted."""
        number = session.runner.control.run
        directory = self.series.directory(number)
        self.setup.room.begin_run(session.environment, directory)
        readiness = self._wait(session, number)
        session.home()
        if self.setup.interrupted.is_set():
            self.log.end_progress()
            self.log.say("vsense: interrupted before the run: nothing was measured")
            return False
        one = OneRun(session, directory, readiness, self.log)
        self.rows.begin(number)
        one.run()
        self.setup.room.recorders.end_run()
        summary = one.report()
        if summary is not None:
            summaries.append(summary)
            if lacks := self.rows.add(summary, summary["ended"], session.experiment):
                self.log.say(lacks, "trouble")
        if one.failure is not None:
            raise one.failure
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
        experiments.say_trust(setup.trust, lambda text: say(text, "warning"))
        experiments.say_legacy_port(session.server, say)
        experiments.say_doubts(session.doubts(), self.log)
        if host.startswith("127.") or host == "localhost":
            say("only robots on this machine reach that address; for others: --host 0.0.0.0")

    def _wait(self, session: RunSession, number: int) -> Readiness:
        """Waits until all are there, for the time that is set, or until a START.

        Raises as `ExperimentSession.wait_for_some`.
        """
        if number > 1:
            self.log.say(f"run {number}, seed {session.environment.seed}")
        limit_s = self.options.start_after
        if limit_s is None and number > 1:
            limit_s = PATIENCE_S
        return session.wait_for_some(limit_s)
