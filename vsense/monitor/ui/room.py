"""The control room of one process: bus, page, recorder, keyboard and control socket."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base import errors
from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Console, Level
from vsense.monitor.recording.form import Data
from vsense.monitor.ui import keyboard
from vsense.monitor.ui.access import FoxgloveAddress, Tokens, WebAddress, is_loopback, read_tokens
from vsense.monitor.ui.certificate import PageTls, tls_of
from vsense.monitor.ui.control_socket import ControlSocket, ControlSocketError
from vsense.monitor.ui.foxglove_server import serve_foxglove
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.monitor.ui.publisher import PreviewEncoder, Publisher
from vsense.monitor.ui.recorders import Recorders
from vsense.robots.link import descriptors
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import RobotStatus
from vsense.run.changes import Ask
from vsense.run.control import DURING, Control
from vsense.run.environment import Environment
from vsense.run.orders import Give, Order, OrderError, OrderKind
from vsense.run.overload import Alarm
from vsense.run.runtime import Runtime, Step

if TYPE_CHECKING:
    from vsense.monitor.ui.server import WebServer


@dataclass(frozen=True, slots=True)
class RoomOptions:
    """How the runs of one process are seen, steered and kept.

    Attributes:
        hold: every run waits for a START, and after the last one the process goes on, to look and
            to begin another.
        runs: how many there are in a series.
        record: every run is recorded from its beginning.
        record_images: recordings hold the cameras' pictures, too.
        locked: nobody may change the world while it runs.
        web: where the page is served, None: nowhere.
        foxglove: where Foxglove is served, None: nowhere.
        series: which run of a series by plan it is; None: of none.
        tokens: of the page, where its file has none; None: they are drawn.
    """

    hold: bool = False
    runs: int = 1
    record: bool = False
    record_images: bool = False
    locked: bool = False
    web: WebAddress | None = None
    foxglove: FoxgloveAddress | None = None
    series: Data | None = None
    tokens: Tokens | None = None


@dataclass(frozen=True, slots=True)
class PageAccess:
    """A page's address, and what its files hold: who may come in, and how it is encrypted.

    Attributes:
        web: where it is served.
        tokens: of the file; None: the server draws them.
        tls: None for plain HTTP.
    """

    web: WebAddress
    tokens: Tokens | None
    tls: PageTls | None

    def warnings(self) -> list[str]:
        """What people should know of how the page is encrypted."""
        if self.tls is None and not is_loopback(self.web.host):
            return [
                "not encrypted: the page's tokens go over plain HTTP; whoever hears one can use it"
            ]
        if self.tls is None or not self.tls.fingerprint:
            return []
        return [
            "the page's certificate was made here: browsers warn; accept it once, where its SHA-256"
            f" fingerprint is {self.tls.fingerprint}"
        ]


def page_access(web: WebAddress) -> PageAccess:
    """Reads what a page needs, before anything is started.

    Raises:
        VsenseError: a library for the page is missing, or the files for it cannot be used.
    """
    errors.require("the page needs", "aiohttp")
    return PageAccess(web, None if web.tokens is None else read_tokens(web.tokens), tls_of(web))


def make_server(
    access: PageAccess,
    bus: MessageBus,
    give: Give,
    tell: Callable[[str], None],
    ask: Ask | None = None,
) -> WebServer:
    """Makes the page's server, which does not serve yet.

    `give` carries out its buttons' orders; `tell` takes a line about strangers, from any thread;
    `ask` takes changes of the world, None: there can be none.
    """
    from vsense.monitor.ui.server import WebServer

    context = None if access.tls is None else access.tls.context
    web = access.web
    return WebServer(bus, give, web.host, web.port, access.tokens, tell, context, ask)


def open_web(
    access: PageAccess,
    bus: MessageBus,
    give: Give,
    tell: Callable[[str], None],
    ask: Ask | None = None,
) -> tuple[WebServer, list[str]]:
    """Serves the page; gives the server, which the caller closes, and lines for people.

    As `make_server`; VsenseError if the port is taken.
    """
    server = make_server(access, bus, give, tell, ask)
    found = server.start()
    lines = [f"control room: {found.control}"]
    if found.look != found.control:
        lines.append(f"control room, to look only: {found.look}")
    return server, [*lines, *access.warnings()]


class ControlRoom:
    """Shows and steers the runs of one process; a context that leaves no thread and no socket.

    `bus` takes all messages; for `holds` see `RoomOptions.hold`. `doubts` says how other machines
    could move robots without showing who they are, `alarms` what is wrong with the run now,
    `spares` who may be put in for a robot; `leave` ends the process in order, as Ctrl-C does.
    """

    def __init__(self, options: RoomOptions, console: Console) -> None:
        """Opens nothing yet; messages on the console are published in the room, too.

        Raises as `page_access`.
        """
        self._access = None if options.web is None else page_access(options.web)
        if self._access is not None and self._access.tokens is None:
            self._access = replace(self._access, tokens=options.tokens)
        self.bus = MessageBus()
        self.holds, self.locked = options.hold, options.locked
        self.doubts: Sequence[str] = ()
        self.alarms: Callable[[], Sequence[Alarm]] = tuple
        self.spares: Callable[[], list[int]] = list
        self.leave: Callable[[], None] = lambda: None
        self._options = options
        self._console = console
        self._directory = Path()
        self._stack = ExitStack()
        self.recorders = Recorders(
            *(self.bus, options.record or options.record_images, options.record_images),
            *(self._trouble, console.say),
        )
        self._failed = False
        console.also = self._tell_event

    def __enter__(self) -> ControlRoom:
        return self

    def __exit__(self, *exception: object) -> None:
        self.recorders.end_run()
        self._stack.close()

    def open(
        self,
        facts: ExperimentFacts,
        environment: Environment,
        server: VirtualSensorServer,
        runtime: Runtime,
        control: Control,
    ) -> None:
        """Opens page, control socket and keyboard; VsenseError if the page cannot be served."""
        self._facts, self._server = facts, server
        others, changes = self._others, runtime.changes
        self._publisher = Publisher(
            *(self.bus, facts, environment, runtime, control, others), changes=changes
        )
        control.record = self.recorders.switch
        self._preview = PreviewEncoder(self.bus)
        self._stack.callback(self._preview.close)
        self._open_doors(control, None if changes is None else changes.ask)

    def _open_doors(self, control: Control, ask: Ask | None) -> None:
        if shortage := descriptors.shortage():
            self._warn(shortage)
        if self._access is not None:
            give = self._give_from_page(control)
            server, lines = open_web(self._access, self.bus, give, self._warn, ask)
            self._stack.callback(server.close)
            for line in lines:
                # With its tokens: neither the pages nor the log may have them.
                self._console.whisper(line)
        serve_foxglove(self._stack, self.bus, self._options.foxglove, self._console)
        try:
            bell = ControlSocket(self.status, control.give, hand_over=partial(self._leave, control))
            self._stack.callback(bell.close)
            if bell.alone:
                self._console.say(f"the lab's others cannot steer this run: {bell.alone}")
        except ControlSocketError as error:
            self._console.say(f"vsense status and its like will not find this run: {error}")
        if keyboard.usable():
            self._stack.callback(keyboard.Keyboard(control.give, self._console.say).close)
            self._console.say(keyboard.HELP)

    def _give_from_page(self, control: Control) -> Give:
        """Takes pages' orders: where nothing may be changed there, nobody is put in either."""

        def give(order: Order) -> str:
            if self.locked and order.kind is OrderKind.REPLACE:
                raise OrderError(
                    "this run is locked (--locked): a robot is put in from the terminal, with"
                    f" vsense replace {order.pair[0]}={order.pair[1]}"
                )
            return control.give(order)

        return give

    def recast(self, environment: Environment) -> None:
        """Goes on between runs with other robots in the parts."""
        self._publisher.recast(environment)

    def begin_run(self, environment: Environment, directory: Path) -> None:
        """Prepares for a run. What cannot be recorded is reported, and the run goes on."""
        self._directory = directory
        self._publisher.begin_run(environment)
        self.recorders.begin_run(directory / f"{environment.experiment.name}.mcap")

    def update(self, step: Step | None, robots: Mapping[int, RobotStatus]) -> None:
        """Publishes the state of the run; see `Publisher.update`.

        An internal fault in it is reported once and ends the publishing, not the run.
        """
        if self._failed:
            return
        try:
            self._publisher.update(step, robots)
            if step is not None:
                self._preview.offer(step.frames)
        except Exception as error:
            self._failed = True
            self._trouble(f"the page and the recording are told nothing any more: {error!r}")

    def status(self) -> Data:
        """The answer to `vsense status`; any thread."""
        publisher = self._publisher
        return {
            "name": publisher.environment.experiment.name,
            "command": self._facts.command,
            "process": os.getpid(),
            "directory": str(self._directory),
            "port": self._server.port,
            "run": publisher.run_data(),
            **({} if self._options.series is None else {"series": self._options.series}),
            "robots": publisher.robots_data(self._server.robots()),
        }

    def _leave(self, control: Control, by: str, force: bool) -> str:
        """Ends the process, so that its robots are free; see `HandOver` of the control socket."""
        if control.state in DURING:
            if not force:
                now = self._publisher.run_data()
                raise OrderError(
                    f"run {now['run']} is {control.state.value}, {now['time_s']:.0f} s:"
                    " with --force it ends"
                )
            control.give(Order(OrderKind.STOP, by))
        self._warn(f"{by} takes the robots over: vsense ends")
        self.leave()
        return "gives its robots back, and ends"

    def _others(self) -> Data:
        try:
            free = shutil.disk_usage(self._directory).free
        except OSError:
            free = None
        return {
            "runs": self._options.runs,
            "text": self._console.newest,
            "recording": self.recorders.state(),
            "disk_free_bytes": free,
            "doubts": list(self.doubts),
            "alarms": [asdict(alarm) for alarm in self.alarms()],
            "spares": [] if self.locked else self.spares(),
        }

    def fail(self, error: VsenseError) -> None:
        """Publishes why a run ends before its time: page and recording have it, too."""
        self._tell_event(str(error), "trouble")

    def _warn(self, text: str) -> None:
        self._console.say(text, "warning")

    def _trouble(self, text: str) -> None:
        self._console.say(text, "trouble")

    def _tell_event(self, text: str, level: Level) -> None:
        publisher = getattr(self, "_publisher", None)
        time_s = None if publisher is None else publisher.time_s
        self.bus.event(text, level, host_ns(), time_s)
