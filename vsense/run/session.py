"""One run with real robots: the arena state's source, the world and the link to the robots."""

from __future__ import annotations

import threading
from contextlib import ExitStack

from vsense.config.specs import Experiment
from vsense.console import Console
from vsense.environment import Environment
from vsense.link.server import LinkEvent, VirtualSensorServer
from vsense.link.table import Table
from vsense.link.wire import GoodbyeCause
from vsense.room.facts import Scene
from vsense.room.room import Room
from vsense.run.control import Control
from vsense.run.runner import Runner
from vsense.run.serving import make_server
from vsense.run.sources import SteadySource, open_source
from vsense.runtime import Runtime
from vsense.tracking.troubles import Troubles


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
        room: Room,
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

    def _scene(self) -> Scene:
        experiment = self.experiment
        text = experiment.path.read_text(encoding="utf-8", errors="replace")
        own = self.source.own
        views = () if own is None else own.session.views
        trackers = {view.camera.id: view.tracker.id for view in views}
        cameras = [view.camera for view in views]
        troubles = Troubles() if own is None else own.troubles
        return Scene("run", text, self.environment.blind, cameras, trackers, troubles)

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
