"""One run with real robots: the arena state's source, the world and the link to the robots.

One run with real robots, from its first timestep to its report.
"""

from __future__ import annotations

import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from vsense.cameras.grabber import Troubles
from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.link.robots.server import LinkEvent, VirtualSensorServer
from vsense.link.robots.table import Table
from vsense.link.robots.wire import GoodbyeCause
from vsense.live.sources import SteadySource, open_source
from vsense.run import directory as run_directory
from vsense.run import figures
from vsense.run.control import Control
from vsense.run.directory import RunLog
from vsense.run.environment import Environment
from vsense.run.figures import Figures, TimestepSample
from vsense.run.portrait import Portrait
from vsense.run.robots import Readiness, make_server, shorten
from vsense.run.runner import Runner
from vsense.run.runtime import Runtime, Step
from vsense.terminal import Console
from vsense.ui.messages import ExperimentFacts
from vsense.ui.room import ControlRoom


class RunSession:
    """Everything of a run; a context that leaves no thread and no socket behind.

    Attributes:
        experiment: what is run.
        source: where the arena states come from.
        environment: the virtual world.
        server: the link to the robots.
        port: the port that robots connect to.
        runner: waits for the robots and lives the run.
    """

    def __init__(
        self,
        experiment: Experiment,
        seed: int,
        blind: bool,
        address: tuple[str, int],
        tracking: tuple[str, str] | None,
        console: Console,
        interrupted: threading.Event,
        room: ControlRoom,
        legacy_port: int | None = None,
    ) -> None:
        """Opens the source and the server; nobody is waited for yet.

        Args:
            experiment: what to run.
            seed: seed of everything that is drawn.
            blind: hold the virtual sensors at 0.
            address: interface and port for the robots.
            tracking: the files of a tracking session, or None; see `open_source`.
            console: where to say what happens.
            interrupted: set by whoever wants everything to end.
            room: where it is seen and steered.
            legacy_port: for robots with the original's client, or None.

        Raises:
            VsenseError: something cannot be used; nothing is left open.
        """
        self.experiment = experiment
        self._console, self._over = console, False
        self.environment = Environment(experiment, seed, blind)
        table = Table(self.environment.table_entries)
        self.server: VirtualSensorServer = make_server(
            experiment, table, address, seed, self._on_link_event, legacy_port
        )
        self._room = room
        self._open(tracking, interrupted)

    def _open(self, tracking: tuple[str, str] | None, interrupted: threading.Event) -> None:
        """Opens everything, or leaves nothing open."""
        experiment, console = self.experiment, self._console
        with ExitStack() as opened:
            self.source: SteadySource = open_source(experiment, tracking, self._tell)
            opened.callback(self.source.close)
            self.port = self.server.start()
            opened.callback(self._close_server)
            self._record_pictures()
            runtime = Runtime(self.source, self.environment, self.server)
            runtime.open()
            opened.callback(runtime.close)
            # Closed first of all: the thread that watches the arena waits in it.
            opened.callback(self.source.close)
            control = Control(self.server.command, console.say, self._room.holds, self._suspends())
            self.runner = Runner(
                experiment, runtime, self.server, console, interrupted, self._room.look, control
            )
            self._room.open(self._scene(), self.environment, self.server, runtime, control)
            self._stack = opened.pop_all()

    def _scene(self) -> ExperimentFacts:
        experiment = self.experiment
        text = experiment.path.read_text(encoding="utf-8", errors="replace")
        own = self.source.own
        views = () if own is None else own.session.views
        trackers = {view.camera.id: view.tracker.id for view in views}
        cameras = [view.camera for view in views]
        troubles = Troubles() if own is None else own.troubles
        return ExperimentFacts("run", text, self.environment.blind, cameras, trackers, troubles)

    def _suspends(self) -> bool:
        """Whether STOP only suspends a run (thesis, 2.3.1)."""
        own = self.source.own
        return own is not None and not own.session.record.change_root_directory_on_start

    def _record_pictures(self) -> None:
        """Has recordings hold what the tracker sees."""
        own, recorders = self.source.own, self._room.recorders
        if own is not None:
            recorders.watch_session(own.session, own.tracking)

    def next_run(self) -> None:
        """Goes back to before the start of the next run, whose seed is one more.

        Raises:
            VsenseError: its virtual world cannot be made, or the link has failed.
        """
        self.environment = self.environment.following()
        self.runner.next_run(self.environment)
        self._over = False

    def __enter__(self) -> RunSession:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def stop(self) -> None:
        """Stops all robots and waits for their last word; see `Runner.stop`.

        Raises:
            VsenseError: the link has failed.
        """
        # From here on silence is our own, and no news.
        self._over = True
        self.runner.stop()

    def _close_server(self) -> None:
        self._over = True
        self.server.close(GoodbyeCause.END, "the run has ended")

    def _on_link_event(self, event: LinkEvent) -> None:
        if not self._over:
            self._console.say(event.text)

    def _tell(self, text: str) -> None:
        if not self._over:
            self._console.say(text)


class OneRun:
    """Lives a run and tells of it.

    Attributes:
        failure: what has ended it before its time.
    """

    def __init__(
        self, session: RunSession, directory: Path, attendance: Readiness, diary: RunLog
    ) -> None:
        """Begins before the first timestep.

        Args:
            session: everything that runs; its robots have been waited for.
            directory: of this run, exists.
            attendance: who is there.
            diary: where to say what happens.
        """
        self.failure: VsenseError | None = None
        self._session = session
        self._experiment = session.experiment
        self._directory = directory
        self._attendance = attendance
        self._diary = diary
        self._figures = Figures(session.experiment)
        self._portrait = Portrait(session.experiment)
        self._results: dict[str, float] = {}

    def live(self) -> None:
        """Lives the run to its end; a failure is kept for after the report."""
        self._diary.say("all robots start")
        for act in (self._timesteps, self._session.stop, self._end_world):
            try:
                act()
            except VsenseError as error:
                self.failure = self.failure or error
        self._diary.end_progress()

    def _timesteps(self) -> None:
        session = self._session
        for step in session.runner.timesteps():
            robots = session.server.robots()
            moment = self._figures.observe(step, robots)
            self._portrait.look(step.run_timestep, session.environment.world, robots)
            self._diary.timestep(step, moment.connected, moment.seen, moment.stale)
            lost = [status.name for status in robots.values() if not status.connected]
            self._diary.progress(self._line(step, moment, lost))

    def _end_world(self) -> None:
        self._results = self._session.environment.end()

    def _line(self, step: Step, moment: TimestepSample, lost: list[str]) -> str:
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

    def report(self) -> dict[str, Any] | None:
        """Measures, writes, and tells.

        Returns:
            The figures; None where nothing was measured.
        """
        session, environment = self._session, self._session.environment
        if not self._figures.timesteps:
            self._diary.say("vsense: the run ended before its first timestep: nothing was measured")
            return None
        summary: dict[str, Any] = {
            "experiment": self._experiment.name,
            "run": session.runner.control.run,
            "seed": environment.seed,
            "blind": environment.blind,
            "robots": len(self._experiment.robots),
            "source": session.source.figures(),
            **self._figures.summary(session.runner, self._attendance, self._results),
        }
        self._diary.say(figures.table(summary))
        try:
            run_directory.write_summary(self._directory, summary, False)
            self._draw()
        except run_directory.DirectoryError as error:
            # A full disk costs this run's files, not the runs that follow.
            self._diary.say(f"the run's figures are not kept: {error}", "trouble")
        return summary

    def _draw(self) -> None:
        """Draws the picture of the run.

        Raises:
            DirectoryError: it cannot be written.
        """
        environment, name = self._session.environment, self._experiment.name
        path = self._directory / f"{name}.png"
        heading = f"{name}{', blind' if environment.blind else ''}"
        count = len(self._experiment.robots)
        source = self._session.source.name
        subtitle = f"{count} robots, seed {environment.seed}; arena states from {source}"
        if self._portrait.draw(path, environment.world, heading, subtitle):
            self._diary.say(f"picture: {path}")
