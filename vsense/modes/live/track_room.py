"""The control room of `vsense track`: shows cameras and arena states, and steers what is kept.

The thesis's Viewer (2.3.1). `vsense cameras show` shows its pictures here, too, without runs.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

import vsense
from vsense.base.arena import ArenaState, Frame, arena_data
from vsense.base.clock import host_ns
from vsense.base.message_bus import MessageBus
from vsense.base.sharing import user_name
from vsense.base.terminal import Console, Level
from vsense.modes.live.runs import Runs
from vsense.monitor.recording.form import Data, ExperimentMessage, RunMessage
from vsense.monitor.ui import keyboard, messages
from vsense.monitor.ui.access import FoxgloveAddress, WebAddress
from vsense.monitor.ui.control_socket import TRACKER, ControlSocket, ControlSocketError
from vsense.monitor.ui.foxglove_server import serve_foxglove
from vsense.monitor.ui.publisher import SECOND_NS, WINDOW, PreviewEncoder, Rates, silence_s
from vsense.monitor.ui.room import PageAccess, open_web, page_access
from vsense.monitor.ui.tables import CameraTable
from vsense.run.orders import Give, Order, OrderError
from vsense.vision.calibration.checked import of_tracking
from vsense.vision.cameras.grabber import Troubles
from vsense.vision.tracking.opening import masks_px
from vsense.vision.tracking.specs import TrackingSession
from vsense.world.entities import BODY_RADIUS_M

MARGIN_M = 0.3
"""What is shown around the cameras' places: no file says how large the arena is."""

USUAL_NAMES = ("experiment", "resources", "session")
"""Files with these names say nothing; their folder's name does."""


def name_of(session: TrackingSession) -> str:
    """What people call a session: its file's name, or that of its folder."""
    path = Path(session.file)
    return (path.stem if path.stem not in USUAL_NAMES else path.resolve().parent.name) or path.stem


class TrackRoom:
    """Shows a tracking session; a context that leaves no thread and no socket behind.

    `bus` takes all messages.
    """

    def __init__(
        self,
        web: WebAddress | None,
        session: TrackingSession,
        troubles: Troubles,
        console: Console,
        clock: Callable[[], int] = host_ns,
        bus: MessageBus | None = None,
        foxglove: FoxgloveAddress | None = None,
    ) -> None:
        """Shows it at `web` and to Foxglove, where these are not None; `troubles` are the cameras'.

        Its buttons do something as soon as `steer` was called. Raises as `page_access`.
        """
        self._access = None if web is None else page_access(web)
        self._foxglove = foxglove
        self._bus = bus or MessageBus()
        self._session = session
        self._clock = clock
        self._console = console
        self._board = CameraTable([view.camera for view in session.views], troubles)
        self._rates = Rates(WINDOW)
        self._joined, self._due_ns = -1, 0
        self._told: object = None
        self._state: ArenaState | None = None
        self._heard_ns: int | None = None
        self._dated = True
        self._runs: Runs | None = None
        self._give: Give = refuse
        self._stack = ExitStack()
        self._preview: PreviewEncoder | None = None
        console.also = self._tell_event

    def open(self) -> None:
        """Serves the page, and Foxglove; VsenseError if a port is taken."""
        if self._access is not None:
            self._serve_page(self._access)
        serve_foxglove(self._stack, self._bus, self._foxglove, self._console)
        if self._access is not None or self._foxglove is not None:
            self._preview = PreviewEncoder(self._bus)
            self._stack.callback(self._preview.close)

    def _serve_page(self, access: PageAccess) -> None:
        server, lines = open_web(
            access,
            self._bus,
            lambda order: self._give(order),
            lambda text: self._console.say(text, "warning"),
        )
        self._stack.callback(server.close)
        for line in lines:
            # With its tokens: neither the page's events nor a recording may have them.
            self._console.whisper(line)

    def steer(self, runs: Runs, keys: bool, dated: bool) -> None:
        """Has page, control socket and, with `keys`, the keyboard carry orders out.

        `dated`: capture times are the host clock's, so that latencies are known.
        """
        self._runs, self._give, self._dated = runs, runs.give, dated
        try:
            bell = ControlSocket(self.status, runs.give, TRACKER)
            self._stack.callback(bell.close)
            if bell.alone:
                self._console.say(f"the lab's others cannot steer this process: {bell.alone}")
        except ControlSocketError as error:
            self._console.say(f"vsense status and its like will not find this process: {error}")
        if keys and keyboard.usable():
            self._stack.callback(keyboard.Keyboard(runs.give, self._console.say).close)
            self._console.say(keyboard.TRACKING_HELP)

    def __enter__(self) -> TrackRoom:
        self.open()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def update(self, state: ArenaState, frames: Sequence[Frame]) -> None:
        """Publishes what is new after a timestep; messages are made only if they are wanted."""
        now_ns, runs = self._clock(), self._runs
        self._state, self._heard_ns = state, now_ns
        self._board.see(frames)
        self._rates.add(state.capture_ns, now_ns)
        timestep = runs.counts.timestep if runs is not None and runs.running else -1
        self.rest()
        self._bus.notify(
            "/arena", state.capture_ns, lambda: {**arena_data(state), "run_timestep": timestep}
        )
        if self._preview is not None:
            self._preview.offer(frames)

    def rest(self) -> None:
        """Publishes what is not a timestep's: how cameras and runs are."""
        now_ns = self._clock()
        if self._joined != self._bus.joined:
            self._joined, self._due_ns = self._bus.joined, 0
            self._bus.notify("/experiment", now_ns, self._facts)
        due = now_ns >= self._due_ns
        if due:
            self._due_ns = now_ns + SECOND_NS
            self._bus.notify("/cameras", now_ns, lambda: self._board.data(now_ns))
        runs = self._runs
        key = None if runs is None else (runs.control.state, runs.control.run, runs.control.by)
        if due or key != self._told:
            self._told = key
            self._bus.notify("/run", now_ns, self._run)

    def status(self) -> dict[str, Any]:
        """The answer to `vsense status`; any thread."""
        assert self._runs is not None, "the socket is opened by `steer`"
        state, directory = self._state, self._runs.directory
        return {
            "name": name_of(self._session),
            "command": "track",
            "process": os.getpid(),
            "directory": None if directory is None else str(directory),
            "run": self._run(),
            "robots": {
                name: [] if state is None else state.robots[name].tolist()
                for name in ("tag", "x_m", "y_m", "yaw_rad", "seen")
            },
        }

    def _tell_event(self, text: str, level: Level) -> None:
        self._bus.event(text, level, self._clock())

    def _run(self) -> Data:
        runs, state, now_ns = self._runs, self._state, self._clock()
        silent_ns = 0 if self._heard_ns is None else now_ns - self._heard_ns
        common = {"late": None, "silent_s": silence_s(silent_ns), **self._rates.data()}
        if not self._dated:
            common["latency_ms"] = None
        if runs is None:
            timestep = -1 if state is None else state.timestep
            return RunMessage(state="running", timestep=timestep, **common).data()
        return RunMessage(
            state=runs.control.state.value,
            run=runs.control.run,
            by=runs.control.by,
            can=runs.can,
            timestep=runs.counts.timestep,
            time_s=round(runs.counts.time_ns / 1e9, 3),
            text=self._console.newest,
            recording=runs.recording(),
            disk_free_bytes=_free_bytes(runs.recording()["file"]),
            **common,
        ).data()

    def _facts(self) -> Data:
        session = self._session
        found = [view.camera for view in session.views]
        trackers = {view.camera.id: view.tracker.id for view in session.views}
        heights_m = sorted(session.heights_m.items())
        centre_m, size_m = _extent(session)
        return ExperimentMessage(
            mode="track",
            command="track",
            user=user_name(),
            name=name_of(session),
            blind=None,
            version=vsense.__version__,
            arena={"size_m": [*size_m, 1.0], "centre_m": [*centre_m, 0.5]},
            robots=[{"tag": t, "name": str(t), "height_m": h} for t, h in heights_m],
            cameras=messages.cameras(found, trackers, masks_px(session)),
            calibration=of_tracking(session),
            body_radius_m=BODY_RADIUS_M,
        ).data()


def refuse(order: Order) -> str:
    """Raises OrderError for every order: there is nothing to steer."""
    raise OrderError(f"{order.kind.value}: nothing runs here, cameras are only looked through")


def _free_bytes(file: str | None) -> int | None:
    """What is left where recordings go."""
    try:
        return shutil.disk_usage(Path.cwd() if file is None else Path(file).parent).free
    except OSError:
        return None


def _extent(session: TrackingSession) -> tuple[tuple[float, float], tuple[float, float]]:
    """Centre and size [m] of the floor that the cameras see."""
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)])
    seen = [
        view.camera.to_plane(corners * (view.camera.width_px - 1, view.camera.height_px - 1), 0.0)
        for view in session.views
    ]
    low, high = np.min(np.concatenate(seen), axis=0), np.max(np.concatenate(seen), axis=0)
    (x_m, y_m), (width_m, height_m) = (low + high) / 2.0, high - low + MARGIN_M
    return (_cm(x_m), _cm(y_m)), (_cm(width_m), _cm(height_m))


def _cm(length_m: float) -> float:
    """Rounds to what a person reads."""
    return round(float(length_m), 2)
