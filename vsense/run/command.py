"""The command `vsense run`: an experiment with real robots."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

from vsense.config.opening import choose_seed, open_experiment
from vsense.config.placement import settle
from vsense.config.specs import Experiment
from vsense.config.subset import first_robots
from vsense.errors import UsageError, VsenseError
from vsense.interruption import INTERRUPTED, interruption
from vsense.link.legacy import MixedServer
from vsense.room.room import Room
from vsense.run import directory as run_directory
from vsense.run.attendance import Attendance, shorten
from vsense.run.diary import Diary
from vsense.run.directory import SERIES
from vsense.run.one_run import OneRun
from vsense.run.series import Series
from vsense.run.session import RunSession
from vsense.run.sources import require_source


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
    experiment = open_experiment(options)
    if experiment is None:
        return 0
    experiment = first_robots(experiment, options.robots)
    seed = choose_seed(options, experiment)
    experiment = settle(experiment, seed, real=False)
    require_source(experiment, options.tracking)
    directory = run_directory.make(options.output, experiment.name, seed)
    keep_file(experiment, directory)
    with Diary(directory) as diary, interruption() as interrupted, Room(options, diary) as room:
        for warning in experiment.warnings:
            diary.say(f"vsense: {warning}")
        return Command(options, experiment, seed, directory, diary, room, interrupted).run()


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


class Command:
    """One call of the command, from the roll call to the last word."""

    def __init__(
        self,
        options: argparse.Namespace,
        experiment: Experiment,
        seed: int,
        directory: Path,
        diary: Diary,
        room: Room,
        interrupted: threading.Event,
    ) -> None:
        """Prepares the runs.

        Args:
            options: the command line.
            experiment: what to run.
            seed: seed of everything that is drawn in the first run.
            directory: of all runs, exists.
            diary: where to say what happens.
            room: where it is seen and steered.
            interrupted: set by whoever wants it to end early.
        """
        self._options = options
        self._experiment = experiment
        self._seed = seed
        self._directory = directory
        self._diary = diary
        self._room = room
        self._interrupted = interrupted
        self._series = Series(directory, options.runs, room.holds, interrupted)

    def run(self) -> int:
        """Lives all runs; see `run`."""
        options, experiment, diary = self._options, self._experiment, self._diary
        host = experiment.host if options.host is None else options.host
        port = experiment.port if options.port is None else options.port
        session = RunSession(
            experiment,
            self._seed,
            options.blind,
            (host, port),
            options.tracking,
            diary,
            self._interrupted,
            self._room,
            _legacy_port(options.legacy_port, port),
        )
        summaries: list[dict[str, Any]] = []
        failure: VsenseError | None = None
        with session:
            self._announce(session, host)
            try:
                while self._one_run(session, summaries) and self._series.goes_on(session.runner):
                    session.next_run()
            except VsenseError as error:
                failure = error
        diary.end_progress()
        self._tell(summaries)
        if failure is not None:
            raise failure
        return INTERRUPTED if self._series.was_broken(session.runner.control) else 0

    def _tell(self, summaries: list[dict[str, Any]]) -> None:
        """Writes and prints the figures of all runs."""
        options = self._options
        if summaries and not self._series.several:
            run_directory.print_summary(summaries[0], options.json)
        if self._series.several:
            figures = {"experiment": self._experiment.name, "runs": summaries}
            run_directory.write_summary(self._directory, figures, options.json, SERIES)

    def _one_run(self, session: RunSession, summaries: list[dict[str, Any]]) -> bool:
        """Waits, lives a run and reports.

        Returns:
            Whether it came to its end.

        Raises:
            VsenseError: something has failed; what was measured until then is reported first.
        """
        number = session.runner.control.run
        directory = self._series.directory(number)
        self._room.begin_run(session.environment, directory)
        attendance = self._wait(session, number)
        if self._interrupted.is_set():
            self._diary.end_progress()
            self._diary.say("vsense: interrupted before the run: nothing was measured")
            return False
        try:
            self._diary.begin_run(directory)
        except run_directory.DirectoryError as error:
            self._diary.say(f"no table of this run's timesteps: {error}", "trouble")
        one = OneRun(session, directory, attendance, self._diary)
        one.live()
        self._room.end_run()
        summary = one.report()
        if summary is not None:
            summaries.append(summary)
        if one.failure is not None:
            raise one.failure
        return True

    def _announce(self, session: RunSession, host: str) -> None:
        experiment, say = self._experiment, self._diary.say
        length = f"{experiment.length_s:g} s" if experiment.length_s else "until Ctrl-C"
        say(
            f"{experiment.name}: {len(experiment.robots)} robots, seed {self._seed}, {length};"
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

    def _wait(self, session: RunSession, number: int) -> Attendance:
        """Waits until all are there, for as long as is said, or until somebody starts.

        Raises:
            VsenseError: something has failed, or not one robot is there.
        """
        if number > 1:
            self._diary.say(f"run {number}, seed {session.environment.seed}")
        limit_s = self._series.patience_s(number, self._options.start_after)
        attendance = session.runner.wait(limit_s)
        if attendance.complete or self._interrupted.is_set():
            return attendance
        if not set(self._names()) - set(attendance.missing):
            raise RunError(f"no robot is there; {attendance.complaint()}")
        self._diary.say(
            f"starting without {shorten(attendance.missing)}; {attendance.complaint()}", "warning"
        )
        return attendance

    def _names(self) -> list[str]:
        return [robot.id for robot in self._experiment.robots]
