"""The control room of `vsense track`: shows cameras and arena states; nothing can be steered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

import vsense
from vsense.arena import ArenaState, Frame, arena_data
from vsense.cameras.grabber import Troubles
from vsense.clock import host_ns
from vsense.message_bus import MessageBus
from vsense.recording.form import Data, ExperimentMessage, RunMessage
from vsense.run.orders import Order, OrderError
from vsense.terminal import Console, Level
from vsense.tracking.specs import TrackingSession
from vsense.ui import messages
from vsense.ui.access import WebAddress
from vsense.ui.publisher import SECOND_NS, WINDOW, PreviewEncoder, Rates
from vsense.ui.room import open_web, page_access
from vsense.ui.tables import CameraTable
from vsense.world.entities import BODY_RADIUS_M

MARGIN_M = 0.3
"""What is shown around the cameras' places: no file says how large the arena is."""


class TrackRoom:
    """Shows a tracking session; a context that leaves no thread and no socket behind."""

    def __init__(
        self,
        web: WebAddress | None,
        session: TrackingSession,
        troubles: Troubles,
        console: Console,
        clock: Callable[[], int] = host_ns,
    ) -> None:
        """Opens the page at `web`, if it is not None; `troubles` are those of the cameras.

        Raises:
            VsenseError: the port is taken, or a library is missing.
        """
        self._bus = MessageBus()
        self._session = session
        self._clock = clock
        self._board = CameraTable([view.camera for view in session.views], troubles)
        self._rates = Rates(WINDOW)
        self._joined, self._due_ns, self._timestep = -1, 0, -1
        self._stack = ExitStack()
        self._preview: PreviewEncoder | None = None
        if web is None:
            return
        server, lines = open_web(
            page_access(web), self._bus, refuse, lambda text: console.say(text, "warning")
        )
        self._stack.callback(server.close)
        self._preview = PreviewEncoder(self._bus)
        self._stack.callback(self._preview.close)
        for line in lines:
            console.say(line)
        console.also = self._tell_event

    def __enter__(self) -> TrackRoom:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def update(self, state: ArenaState, frames: Sequence[Frame]) -> None:
        """Publishes what is new after a timestep; messages are made only if they are wanted."""
        if self._preview is None:
            return
        now_ns, self._timestep = self._clock(), state.timestep
        self._board.see(frames)
        self._rates.add(state.capture_ns, now_ns)
        if self._joined != self._bus.joined:
            self._joined, self._due_ns = self._bus.joined, 0
            self._bus.notify("/experiment", now_ns, self._facts)
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + SECOND_NS
            self._bus.notify("/cameras", now_ns, lambda: self._board.data(now_ns))
            self._bus.notify("/run", now_ns, self._run)
        self._bus.notify(
            "/arena", state.capture_ns, lambda: {**arena_data(state), "run_timestep": -1}
        )
        self._preview.offer(frames)

    def _tell_event(self, text: str, level: Level) -> None:
        self._bus.event(text, level, self._clock())

    def _run(self) -> Data:
        return RunMessage(
            state="running", timestep=self._timestep, late=0, silent_s=0.0, **self._rates.data()
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
            name=Path(session.file).stem,
            blind=False,
            version=vsense.__version__,
            arena={"size_m": [*size_m, 1.0], "centre_m": [*centre_m, 0.5]},
            robots=[{"tag": t, "name": str(t), "height_m": h} for t, h in heights_m],
            cameras=messages.cameras(found, trackers),
            body_radius_m=BODY_RADIUS_M,
        ).data()


def refuse(order: Order) -> str:
    """Raises OrderError for every order: there is nothing to steer."""
    raise OrderError(f"{order.kind.value}: nothing runs here, robots are only tracked")


def _extent(session: TrackingSession) -> tuple[tuple[float, float], tuple[float, float]]:
    """Centre and size [m] of the floor that the cameras see."""
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)])
    seen = [
        view.camera.to_plane(corners * (view.camera.width_px - 1, view.camera.height_px - 1), 0.0)
        for view in session.views
    ]
    low, high = np.min(np.concatenate(seen), axis=0), np.max(np.concatenate(seen), axis=0)
    (x_m, y_m), (width_m, height_m) = (low + high) / 2.0, high - low + MARGIN_M
    return (float(x_m), float(y_m)), (float(width_m), float(height_m))
