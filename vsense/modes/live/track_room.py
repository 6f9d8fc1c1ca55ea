"""The control room of `vsense camera track`: shows cameras and states, and steers what is kept.

The thesis's Viewer (2.3.1). `vsense camera show` shows its pictures here, too, without runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import vsense
from vsense.base.arena import ArenaState, Frame
from vsense.base.clock import host_ns
from vsense.base.files import free_bytes
from vsense.base.sharing import user_name
from vsense.modes.live._runs import Runs
from vsense.monitor.recording.form import Data, ExperimentMessage, RunMessage
from vsense.monitor.ui import keyboard, messages
from vsense.monitor.ui.control_socket import TRACKER_SUFFIX
from vsense.monitor.ui.publisher import SECOND_NS, Rates, silence_s
from vsense.monitor.ui.room import ControlRoom, RoomCallbacks
from vsense.monitor.ui.tables import CameraTable
from vsense.run.orders import Order, OrderError
from vsense.vision.calibration.checked import of_tracking
from vsense.vision.cameras.grabber import Troubles
from vsense.vision.tracking.opening import masks_px
from vsense.vision.tracking.specs import TrackingSession
from vsense.world.robot_models import EPUCK

VIEW_MARGIN_M = 0.3
"""What is shown around the cameras' places: no file says how large the arena is."""

USUAL_NAMES = ("experiment", "resources", "session")
"""Files with these names say nothing; their folder's name does."""


def name_of(session: TrackingSession) -> str:
    """What people call a session: its file's name, or that of its folder."""
    path = Path(session.file)
    return (path.stem if path.stem not in USUAL_NAMES else path.resolve().parent.name) or path.stem


class TrackRoom:
    """Shows a tracking session in a control room.

    Args:
        room: where it is shown.
        troubles: the cameras'.
        runs: what orders steer; None: nothing runs, cameras are only looked through.
        has_keys: the terminal's keys give orders, too.
        dated: capture times are the host clock's, so that latencies are known.
    """

    def __init__(
        self,
        room: ControlRoom,
        session: TrackingSession,
        troubles: Troubles,
        runs: Runs | None = None,
        has_keys: bool = False,
        dated: bool = True,
    ) -> None:
        self._room, self._bus = room, room.bus
        self._session = session
        self._board = CameraTable([view.camera for view in session.views], troubles)
        self._rates = Rates()
        self._joined, self._due_ns = -1, 0
        self._published: object = None
        self._state: ArenaState | None = None
        self._heard_ns: int | None = None
        self._runs, self._dated, self._has_keys = runs, dated, has_keys

    def open(self) -> None:
        """Opens the room; VsenseError if it cannot be served."""
        runs, keys = self._runs, keyboard.TRACKING_HELP if self._has_keys else ""
        if runs is None:
            self._room.open(RoomCallbacks(refuse))
        else:
            give = runs.control.give
            self._room.open(RoomCallbacks(give, self.status, kind=TRACKER_SUFFIX, keys=keys))

    def update(self, state: ArenaState, frames: Sequence[Frame]) -> None:
        """Publishes what is new after a timestep; messages are made only if they are wanted."""
        now_ns, runs = host_ns(), self._runs
        self._state, self._heard_ns = state, now_ns
        self._board.see(frames)
        self._rates.add(state.capture_ns, now_ns)
        timestep = runs.counts.timestep if runs is not None and runs.running else -1
        self.rest()
        self._bus.notify(
            "/arena", state.capture_ns, lambda: {**state.data(), "run_timestep": timestep}
        )
        self._room.show(frames)

    def rest(self) -> None:
        """Publishes what is not a timestep's: how cameras and runs are."""
        now_ns = host_ns()
        if self._joined != self._bus.joined:
            self._joined, self._due_ns = self._bus.joined, 0
            self._bus.notify("/experiment", now_ns, self._facts)
        due = now_ns >= self._due_ns
        if due:
            self._due_ns = now_ns + SECOND_NS
            self._bus.notify("/cameras", now_ns, lambda: self._board.data(now_ns))
        runs = self._runs
        key = None if runs is None else (runs.control.state, runs.control.run, runs.control.by)
        if due or key != self._published:
            self._published = key
            self._bus.notify("/run", now_ns, self._run)

    def status(self) -> dict[str, Any]:
        """The answer to `vsense control status`; any thread."""
        state, directory = self._state, None if self._runs is None else self._runs.directory
        return {
            **self._room.status_data(name_of(self._session), "track", self._run()),
            "directory": None if directory is None else str(directory),
            "robots": {
                name: [] if state is None else state.robots[name].tolist()
                for name in ("tag", "x_m", "y_m", "yaw_rad", "seen")
            },
        }

    def _run(self) -> Data:
        runs, state, now_ns = self._runs, self._state, host_ns()
        silent_ns = 0 if self._heard_ns is None else now_ns - self._heard_ns
        common = {"late": None, "silent_s": silence_s(silent_ns), **self._rates.data()}
        if not self._dated:
            common["latency_ms"] = None
        if runs is None:
            timestep = -1 if state is None else state.timestep
            return RunMessage(state="running", timestep=timestep, **common).data()
        recording = runs.recording()
        file = recording["file"]
        folder = Path.cwd() if file is None else Path(file).parent
        return RunMessage(
            state=runs.control.state.value,
            run=runs.control.run,
            by=runs.control.by,
            can=[kind.value for kind in runs.control.can],
            timestep=runs.counts.timestep,
            time_s=round(runs.counts.time_ns / 1e9, 3),
            **self._room.run_data()
            | {"runs": None, "recording": recording, "disk_free_bytes": free_bytes(folder)},
            **common,
        ).data()

    def _facts(self) -> Data:
        session = self._session
        cameras = [view.camera for view in session.views]
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
            cameras=messages.cameras(cameras, trackers, masks_px(session)),
            calibration=of_tracking(session),
            body_radius_m=EPUCK.radius_m,
            body_height_m=EPUCK.height_m,
        ).data()


def refuse(order: Order) -> str:
    """Raises OrderError for every order: there is nothing to steer."""
    raise OrderError(f"{order.kind.value}: nothing runs here, cameras are only looked through")


def _extent(session: TrackingSession) -> tuple[tuple[float, float], tuple[float, float]]:
    """Centre and size [m] of the floor that the cameras see."""
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)])
    seen = [
        view.camera.to_plane(corners * (view.camera.width_px - 1, view.camera.height_px - 1), 0.0)
        for view in session.views
    ]
    low, high = np.min(np.concatenate(seen), axis=0), np.max(np.concatenate(seen), axis=0)
    (x_m, y_m), (width_m, height_m) = (low + high) / 2.0, high - low + VIEW_MARGIN_M
    return (_cm(x_m), _cm(y_m)), (_cm(width_m), _cm(height_m))


def _cm(length_m: float) -> float:
    """Rounds to what a person reads."""
    return round(float(length_m), 2)
