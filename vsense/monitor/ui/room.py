"""The control room of one process: bus, watchers, recordings, keyboard and control socket.

Simulations, the lab, runs with robots and tracking use it; what differs between them is given to
it once, when it opens: `RoomCallbacks`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from vsense.base.arena import Frame
from vsense.base.clock import host_ns
from vsense.base.errors import UsageError, VsenseError
from vsense.base.files import free_bytes
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Console, Level
from vsense.base.writing import HUNG_S, BackgroundWriter
from vsense.monitor import recording
from vsense.monitor.recording.form import Data
from vsense.monitor.ui import keyboard
from vsense.monitor.ui._foxglove_server import check_foxglove
from vsense.monitor.ui._ros2_publisher import check_ros2
from vsense.monitor.ui._watchers import (
    WatchedBus,
    WatchOptions,
    page_access,
    start_watchers,
    wanted_watchers,
)
from vsense.monitor.ui.control_socket import (
    ControlSocket,
    ControlSocketError,
    HandOver,
    refuse_handover,
)
from vsense.monitor.ui.publisher import PreviewEncoder, Publisher
from vsense.monitor.ui.recorders import Recorders
from vsense.robots.link.status import RobotStatus
from vsense.run.changes import Ask
from vsense.run.environment import Environment
from vsense.run.orders import Give, Order, OrderError, OrderKind
from vsense.run.runtime import Step


@dataclass(frozen=True, slots=True)
class RoomOptions(WatchOptions):
    """How the runs of one process are seen, steered and kept.

    Attributes:
        hold: every run waits for a START, and after the last one the process goes on, to look and
            to begin another.
        runs: how many there are in a series.
        record: every run is recorded from its beginning.
        record_images: recordings hold the cameras' pictures, too.
        locked: nobody may change the world while it runs.
        series: which run of a series by plan it is; None: of none.
    """

    hold: bool = False
    runs: int = 1
    record: bool = False
    record_images: bool = False
    locked: bool = False
    series: Data | None = None

    def check(self, *ports: int | None) -> None:
        """Refuses what page, Foxglove and recordings lack, before anything is made or started.

        `ports` are those of robots.

        Raises:
            UsageError: a library is missing, or two are to have one port.
            VsenseError: the page's files cannot be used, or another program has a port.
        """
        if self.record or self.record_images:
            recording.require()
        check_ros2(self.ros2)
        check_foxglove(self.foxglove, (*ports, None if self.web is None else self.web.port))
        if self.web is None:
            return
        page_access(self.web)
        if self.web.port and self.web.port in ports:
            raise UsageError(
                f"--web: {self.web.port} is a port for robots, too: give the page another, such as"
                f" --web {self.web.port + 1}"
            )


@dataclass(frozen=True, slots=True)
class RoomCallbacks:
    """What orders do in a process, and what it says of its runs; any thread calls them.

    Attributes:
        give: carries orders out.
        status: the answer to `vsense control status`; None: no terminal finds this process.
        hand_over: ends the process for somebody who wants its robots.
        ask: takes changes of the world; None: there can be none.
        time_s: since the run's beginning; None: before it.
        kind: of the control socket, in its name.
        keys: what the terminal's keys do, in words; "": they do nothing.
        publisher: makes the messages of runs in a virtual world; None: somebody else does.
    """

    give: Give
    status: Callable[[], Data] | None = None
    hand_over: HandOver = refuse_handover
    ask: Ask | None = None
    time_s: Callable[[], float | None] = lambda: None
    kind: str = ""
    keys: str = ""
    publisher: Publisher | None = None


class ControlRoom:
    """Shows and steers the runs of one process; a context that leaves no thread and no socket.

    `bus` takes all messages; for `holds` and `locked` see `RoomOptions`.
    """

    def __init__(self, options: RoomOptions, console: Console) -> None:
        """Opens nothing yet; messages on the console are published in the room, too.

        Raises as `wanted_watchers`.
        """
        self._watchers = wanted_watchers(options)
        self.bus = MessageBus()
        self.holds, self.locked = options.hold, options.locked
        self._options = options
        self.console = console
        self._directory = Path()
        self._stack = ExitStack()
        self.recorders = Recorders(
            self.bus,
            options.record or options.record_images,
            options.record_images,
            self._trouble,
            console.say,
        )
        self._callbacks: RoomCallbacks | None = None
        self._preview = PreviewEncoder(self.bus)
        self._stack.callback(self._preview.close)
        self._failed = False
        # Its log says when a disk does not answer.
        self._disk = BackgroundWriter("", lambda text: None)
        self._disk_free_bytes: int | None = None
        self._stack.callback(self._disk.close, wait_s=HUNG_S)
        console.repeat_to(self._publish_event)

    def __enter__(self) -> ControlRoom:
        return self

    def __exit__(self, *exception: object) -> None:
        self.recorders.end_run()
        self._stack.close()

    def open(self, callbacks: RoomCallbacks) -> None:
        """Opens watchers, control socket and keyboard; VsenseError if one cannot be served."""
        self._callbacks, console = callbacks, self.console
        console.write_aside()
        give = self._give_from_page(callbacks.give)
        runs = WatchedBus(self.bus, give, console, callbacks.ask)
        start_watchers(self._stack, self._watchers, runs)
        if callbacks.status is not None:
            self._open_socket(callbacks.status, callbacks)
        if callbacks.keys and keyboard.usable():
            self._stack.callback(keyboard.Keyboard(callbacks.give, console.say).close)
            console.say(callbacks.keys)

    def _open_socket(self, status: Callable[[], Data], callbacks: RoomCallbacks) -> None:
        try:
            socket = ControlSocket(status, callbacks.give, callbacks.kind, callbacks.hand_over)
        except ControlSocketError as error:
            self.console.say(f"`vsense control` will not find this process: {error}")
            return
        self._stack.callback(socket.close)
        if socket.alone:
            self.console.say(f"the lab's others cannot steer this process: {socket.alone}")

    def _give_from_page(self, give: Give) -> Give:
        """Takes pages' orders: where nothing may be changed there, nobody is put in either."""

        def give_unless_locked(order: Order) -> str:
            if self.locked and order.kind is OrderKind.REPLACE:
                raise OrderError(
                    "this run is locked (--locked): a robot is put in from the terminal, with"
                    f" vsense control replace {order.pair[0]}={order.pair[1]}"
                )
            return give(order)

        return give_unless_locked

    @property
    def is_watched(self) -> bool:
        """Whether a page or another watcher is asked for."""
        return bool(self._watchers)

    def recast(self, environment: Environment) -> None:
        """Goes on between runs with other robots in the parts."""
        self._publisher.recast(environment)

    def begin_run(self, environment: Environment, directory: Path) -> None:
        """Prepares for a run. What cannot be recorded is reported, and the run goes on."""
        self._publisher.begin_run(environment)
        self.keep_in(directory)
        self.recorders.begin_run(directory / f"{environment.experiment.name}.mcap")

    def keep_in(self, directory: Path) -> None:
        """The files of the run go into this folder."""
        self._directory = directory

    def update(self, step: Step | None, robots: Mapping[int, RobotStatus]) -> None:
        """Publishes the state of the run; see `Publisher.update`.

        An internal fault in it is reported once and ends the publishing, not the run.
        """
        if self._failed:
            return
        try:
            self._publisher.update(step, robots)
            if step is not None:
                self.show(step.frames)
        except Exception as error:
            self._failed = True
            self._trouble(f"the page and the recording get nothing any more: {error!r}")

    def judge(self, facts: Mapping[str, str]) -> None:
        """Publishes the verdict on the run that is over, and says why it is invalid, if it is;
        `facts` as summaries have them."""
        if not self._failed:
            self._publisher.judge(facts)
        if facts["why"]:
            self._trouble(f"this run is invalid: {facts['why']}")

    def show(self, frames: Sequence[Frame]) -> None:
        """Publishes small pictures of what cameras see, where somebody looks at them."""
        self._preview.offer(frames)

    def status_data(self, name: str, command: str, run: Data) -> Data:
        """What every process says to `vsense control status`; `run` is its message /run."""
        series = self._options.series
        return {
            "name": name,
            "command": command,
            "process": os.getpid(),
            "directory": str(self._directory),
            "run": run,
            **({} if series is None else {"series": series}),
        }

    def run_data(self) -> Data:
        """What the room knows of the message /run."""
        return {
            "runs": self._options.runs,
            "text": self.console.newest,
            "recording": self.recorders.state(),
            "disk_free_bytes": self._free_bytes(),
        }

    def _free_bytes(self) -> int | None:
        """What the disk said last: one that hangs does not answer."""
        if self._disk.idle:
            self._disk.do(self._measure_disk)
        return self._disk_free_bytes

    def _measure_disk(self) -> None:
        self._disk_free_bytes = free_bytes(self._directory)

    def fail(self, error: VsenseError) -> None:
        """Publishes why a run ends before its time: page and recording have it, too."""
        self._publish_event(str(error), "trouble")

    @property
    def _publisher(self) -> Publisher:
        assert self._callbacks is not None and self._callbacks.publisher is not None
        return self._callbacks.publisher

    def _trouble(self, text: str) -> None:
        self.console.say(text, "trouble")

    def _publish_event(self, text: str, level: Level) -> None:
        time_s = None if self._callbacks is None else self._callbacks.time_s()
        self.bus.event(text, level, host_ns(), time_s)
