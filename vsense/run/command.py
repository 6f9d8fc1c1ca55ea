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
from vsense.run import directory as run_directory
from vsense.run import figures
from vsense.run.attendance import Attendance, shorten
from vsense.run.diary import Diary
from vsense.run.figures import Figures, Moment
from vsense.run.portrait import Portrait
from vsense.run.session import RunSession
from vsense.run.sources import require_source
from vsense.runtime import Step


class RunError(VsenseError):
    """The run cannot begin."""


def run(options: argparse.Namespace) -> int:
    """Runs an experiment with real robots and reports about it.

    Returns:
        0, or 130 after Ctrl-C or SIGTERM: what was measured until then is reported all the same.

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
    with Diary(directory) as diary, interruption() as interrupted:
        for warning in experiment.warnings:
            diary.say(f"vsense: {warning}")
        return Command(options, experiment, seed, directory, diary, interrupted).run()


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
        interrupted: threading.Event,
    ) -> None:
        """Prepares a run.

        Args:
            options: the command line.
            experiment: what to run.
            seed: seed of everything that is drawn.
            directory: run directory, exists.
            diary: where to say what happens.
            interrupted: set by whoever wants the run to end early.
        """
        self._options = options
        self._experiment = experiment
        self._seed = seed
        self._directory = directory
        self._diary = diary
        self._interrupted = interrupted
        self._figures = Figures(experiment)
        self._portrait = Portrait(experiment)
        self._failure: VsenseError | None = None
        self._results: dict[str, float] = {}

    def run(self) -> int:
        """Waits, lives the run and reports; see `run`."""
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
            _legacy_port(options.legacy_port, port),
        )
        with session:
            self._announce(session, host)
            attendance = self._wait(session)
            if self._interrupted.is_set():
                diary.end_progress()
                diary.say("vsense: interrupted before the run: nothing was measured")
                return INTERRUPTED
            self._live(session)
            diary.end_progress()
            self._report(session, attendance)
        if self._failure is not None:
            raise self._failure
        return INTERRUPTED if self._interrupted.is_set() else 0

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

    def _wait(self, session: RunSession) -> Attendance:
        """Waits until all are there, or for as long as the command line says.

        Raises:
            VsenseError: something has failed, or not one robot is there.
        """
        limit_s = self._options.start_after
        attendance = session.runner.wait(limit_s)
        if attendance.complete or self._interrupted.is_set():
            return attendance
        if not set(self._names()) - set(attendance.missing):
            raise RunError(f"no robot is there after {limit_s:g} s; {attendance.complaint()}")
        self._diary.say(
            f"starting after {limit_s:g} s without {shorten(attendance.missing)};"
            f" {attendance.complaint()}"
        )
        return attendance

    def _names(self) -> list[str]:
        return [robot.id for robot in self._experiment.robots]

    def _live(self, session: RunSession) -> None:
        """Lives the run to its end; a failure is kept for after the report."""
        self._diary.say("all robots start")
        acts = (self._timesteps, RunSession.stop, self._end_world)
        for act in acts:
            try:
                act(session)
            except VsenseError as error:
                self._failure = self._failure or error

    def _timesteps(self, session: RunSession) -> None:
        for step in session.runner.timesteps():
            robots = session.server.robots()
            moment = self._figures.observe(step, robots)
            self._portrait.look(step.run_timestep, session.environment.world, robots)
            self._diary.timestep(step, moment.connected, moment.seen, moment.stale)
            lost = [status.name for status in robots.values() if not status.connected]
            self._diary.progress(self._line(step, moment, lost))

    def _end_world(self, session: RunSession) -> None:
        self._results = session.environment.end()

    def _line(self, step: Step, moment: Moment, lost: list[str]) -> str:
        """The live line."""
        experiment = self._experiment
        length = f"/{experiment.length_s:g}" if experiment.length_s else ""
        robots = len(experiment.robots)
        without = f" (not {shorten(lost)})" if lost else ""
        return (
            f"{step.run_timestep * experiment.timestep_s:5.1f}{length} s"
            f"  timestep {step.run_timestep}"
            f"  robots {moment.connected}/{robots}{without}  seen {moment.seen}/{robots}"
            f"  stale {moment.stale}"
            f"  capture to sent {(step.sent_ns - step.capture_ns) / 1e6:.0f} ms"
        )

    def _report(self, session: RunSession, attendance: Attendance) -> None:
        """Measures, writes and prints.

        Raises:
            DirectoryError: a file or standard output cannot be written.
        """
        if not self._figures.timesteps:
            self._diary.say("vsense: the run ended before its first timestep: nothing was measured")
            return
        summary: dict[str, Any] = {
            "experiment": self._experiment.name,
            "seed": self._seed,
            "blind": bool(self._options.blind),
            "robots": len(self._experiment.robots),
            "source": session.source.figures(),
            **self._figures.summary(session.runner, attendance, self._results),
        }
        run_directory.write_summary(self._directory, summary, self._options.json)
        self._diary.say(figures.table(summary))
        self._draw(session)

    def _draw(self, session: RunSession) -> None:
        """Draws the picture of the run.

        Raises:
            DirectoryError: it cannot be written.
        """
        name = self._experiment.name
        path = self._directory / f"{name}.png"
        heading = f"{name}{', blind' if self._options.blind else ''}"
        count = len(self._experiment.robots)
        subtitle = f"{count} robots, seed {self._seed}; arena states from {session.source.name}"
        if self._portrait.draw(path, session.environment.world, heading, subtitle):
            self._diary.say(f"picture: {path}")
