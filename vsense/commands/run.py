"""`vsense run`: an experiment with real robots."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vsense.commands import arguments
from vsense.commands.arguments import open_run
from vsense.config.specs import Experiment
from vsense.errors import UsageError, VsenseError
from vsense.link.legacy.server import MixedServer
from vsense.live.run import OneRun
from vsense.live.session import RunSession, RunSetup
from vsense.live.sources import require_source
from vsense.run import directory as run_directory
from vsense.run.directory import RunLog
from vsense.run.robots import Readiness, shorten
from vsense.run.series import Series
from vsense.terminal import INTERRUPTED, interruption
from vsense.ui.room import ControlRoom

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
    arguments.add_experiment(parser)
    arguments.add_settings(parser)
    _add_ends(parser)
    parser.add_argument(
        "--start-after",
        type=arguments.seconds,
        metavar="S",
        help="start after S s at the latest, without whoever is missing (default: wait for all)",
    )
    _add_results(parser)
    arguments.add_room(parser)


def _add_ends(parser: argparse.ArgumentParser) -> None:
    """Declares where the arena state comes from, and where the robots connect to."""
    parser.add_argument(
        "--tracking",
        nargs=2,
        metavar=("RESOURCES", "SESSION"),
        help="track with these two files of `vsense track`: cameras, or recordings in their place",
    )
    parser.add_argument(
        "--host",
        metavar="ADDRESS",
        help="interface that robots connect to, 0.0.0.0: all (default: the file's vss_host)",
    )
    parser.add_argument(
        "--port",
        type=arguments.port,
        metavar="P",
        help="TCP and UDP port; 0 takes a free one (default: the file's vss_port)",
    )
    parser.add_argument(
        "--legacy-port",
        type=arguments.port,
        metavar="P",
        help="serve robots that still run the original's client, too, on this TCP port; 0 takes a"
        " free one (default: serve none)",
    )


def _add_results(parser: argparse.ArgumentParser) -> None:
    """Declares where the figures go."""
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="folder for notes and figures (default: runs/...)",
    )


class RunError(VsenseError):
    """The run cannot begin."""


def run(options: argparse.Namespace) -> int:
    """Runs an experiment with real robots, once or more often, and reports about every run.

    Returns:
        0, or 130 after Ctrl-C or SIGTERM in a run: what was measured until then is reported all
        the same.

    Raises:
        VsenseError: it cannot run, or something failed in mid-run; what was measured until then
            is reported first.
    """
    opened = open_run(options, real=False)
    if opened is None:
        return 0
    experiment, seed = opened
    require_source(experiment, options.tracking)
    directory = run_directory.make(options.output, experiment.name, seed)
    keep_file(experiment, directory)
    with (
        RunLog(directory) as diary,
        interruption() as interrupted,
        ControlRoom(options, diary) as room,
    ):
        for warning in experiment.warnings:
            diary.say(f"vsense: {warning}")
        host = experiment.host if options.host is None else options.host
        port = experiment.port if options.port is None else options.port
        setup = RunSetup(experiment, seed, options.blind, (host, port), diary, interrupted, room)
        return RunCommand(options, setup, directory, diary).run()


def keep_file(experiment: Experiment, directory: Path) -> None:
    """Keeps the experiment's file as it is now beside what the run leaves.

    Raises:
        DirectoryError: it cannot be written.
    """
    try:
        (directory / experiment.path.name).write_bytes(experiment.path.read_bytes())
    except OSError as error:
        text = f"cannot write to {directory}: {error.strerror}"
        raise run_directory.DirectoryError(text) from None


def _legacy_port(legacy_port: int | None, port: int) -> int | None:
    """Checks that the two kinds of robots have a port each.

    Raises:
        UsageError: they have not.
    """
    if legacy_port and legacy_port == port:
        raise UsageError(
            f"--legacy-port: {port} is the port for vsensed, too: give that another, such as"
            f" --port {port + 1}"
        )
    return legacy_port


class RunCommand:
    """One call of the command, from the roll call to the last word."""

    def __init__(
        self,
        options: argparse.Namespace,
        setup: RunSetup,
        directory: Path,
        diary: RunLog,
    ) -> None:
        """Prepares the runs.

        Args:
            options: the command line.
            setup: what the runs are made from.
            directory: of all runs, exists.
            diary: where to say what happens.
        """
        self._options = options
        self._setup = setup
        self._directory = directory
        self._diary = diary
        self._series = Series(directory, options.runs, setup.room.holds, setup.interrupted)

    def run(self) -> int:
        """Lives all runs; see `run`."""
        options, setup = self._options, self._setup
        legacy_port = _legacy_port(options.legacy_port, setup.address[1])
        session = RunSession(setup, options.tracking, legacy_port)
        summaries: list[dict[str, Any]] = []
        failure: VsenseError | None = None
        with session:
            self._announce(session)
            try:
                while self._one_run(session, summaries) and self._series.goes_on(session.runner):
                    session.next_run()
            except VsenseError as error:
                failure = error
        self._diary.end_progress()
        self._tell(summaries)
        if failure is not None:
            raise failure
        return INTERRUPTED if self._series.was_broken(session.runner.control) else 0

    def _tell(self, summaries: list[dict[str, Any]]) -> None:
        """Writes and prints the figures of all runs."""
        options = self._options
        if summaries and not self._series.several:
            run_directory.print_summary(summaries[0], options.json)
        self._series.write_summary(self._setup.experiment.name, summaries, options.json)

    def _one_run(self, session: RunSession, summaries: list[dict[str, Any]]) -> bool:
        """Waits, lives a run and reports.

        Returns:
            Whether it came to its end.

        Raises:
            VsenseError: something has failed; what was measured until then is reported first.
        """
        number = session.runner.control.run
        directory = self._series.directory(number)
        self._setup.room.begin_run(session.environment, directory)
        attendance = self._wait(session, number)
        if self._setup.interrupted.is_set():
            self._diary.end_progress()
            self._diary.say("vsense: interrupted before the run: nothing was measured")
            return False
        try:
            self._diary.begin_run(directory)
        except run_directory.DirectoryError as error:
            self._diary.say(f"no table of this run's timesteps: {error}", "trouble")
        one = OneRun(session, directory, attendance, self._diary)
        one.run()
        self._setup.room.end_run()
        summary = one.report()
        if summary is not None:
            summaries.append(summary)
        if one.failure is not None:
            raise one.failure
        return True

    def _announce(self, session: RunSession) -> None:
        setup, say = self._setup, self._diary.say
        experiment, host = setup.experiment, setup.address[0]
        length = f"{experiment.length_s:g} s" if experiment.length_s else "until Ctrl-C"
        say(
            f"{experiment.name}: {len(experiment.robots)} robots, seed {setup.seed}, {length};"
            f" notes in {self._directory}"
        )
        say(f"arena states come from {session.source.name}")
        say(
            f"waiting for robots on {host}, port {session.port}:"
            f" vsensed --host ADDRESS --port {session.port} --tag TAG --base BASE"
        )
        if isinstance(session.server, MixedServer):
            say(f"and with the original client on port {session.server.legacy_port}")
            for name in session.server.unknown:
                say(f"the original client does not know the sensor '{name}': not told to it")
        if host.startswith("127.") or host == "localhost":
            say("only robots on this machine reach that address; for others: --host 0.0.0.0")

    def _wait(self, session: RunSession, number: int) -> Readiness:
        """Waits until all are there, for as long as is said, or until somebody starts.

        Raises:
            VsenseError: something has failed, or not one robot is there.
        """
        if number > 1:
            self._diary.say(f"run {number}, seed {session.environment.seed}")
        limit_s = self._series.patience_s(number, self._options.start_after)
        attendance = session.runner.wait(limit_s)
        if attendance.complete or self._setup.interrupted.is_set():
            return attendance
        if not set(self._names()) - set(attendance.missing):
            raise RunError(f"no robot is there; {attendance.complaint()}")
        self._diary.say(
            f"starting without {shorten(attendance.missing)}; {attendance.complaint()}", "warning"
        )
        return attendance

    def _names(self) -> list[str]:
        return [robot.id for robot in self._setup.experiment.robots]
