"""The lab's cameras on the network, above robots that are emulated elsewhere.

`vsense camera pretend` is what stands in for a lab's cameras at a desk: grabber, tracker and
calibration are those of real ones. Where robots are is heard as lines of a tracker
(`vsense/robots/link/TRACKERS.md`), such as those of `vsense robot emulate`. Each camera sends its
pictures by HTTP to this machine only, as a stream of raw frames (yuv4mpeg(5)), which FFmpeg opens
as it does that of a real one: two processors have no time for JPEGs of four cameras.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Condition, Event

import numpy as np

from vsense.base.arena import ArenaState, Floats, Image
from vsense.base.clock import host_ns
from vsense.config.specs import Experiment
from vsense.modes.lab._camera_spec import spec_for
from vsense.modes.lab._renderer import Studio
from vsense.robots.link.network import listen
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.lines import TRACKER_SILENCE_NS, ArenaListener
from vsense.vision.cameras.discovery import RATE_HZ, URL, Details, FoundCamera

HOST = "127.0.0.1"
_AWAY_M = 1e4
"""Bodies of which nothing is heard are there, out of all pictures."""
_PATIENCE_S = 2.0
"""A sender looks so often whether it is to end."""
_READ_S = 10.0
"""It waits so long for a reader that takes nothing."""


class _Pictures(ThreadingHTTPServer):
    """Sends the newest picture of each camera to whoever asks for it, as it comes."""

    daemon_threads = True

    def __init__(self, port: int, names: Sequence[str]) -> None:
        taken, self.port = listen(HOST, port)
        super().__init__((HOST, self.port), _Stream, bind_and_activate=False)
        self.socket.close()
        self.socket = taken
        self.names = tuple(names)
        self.open = True
        self._changed = Condition()
        self._number, self._images = 0, np.empty((0, 0, 0), np.uint8)

    def show(self, images: Image) -> None:
        """Sends pictures (cameras, h, w) from now on; they are copied."""
        with self._changed:
            self._number, self._images = self._number + 1, images.copy()
            self._changed.notify_all()

    def after(self, number: int, camera: int) -> tuple[int, Image | None]:
        """Waits for a picture of a camera after the one of a number; None: there is none yet."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > number, _PATIENCE_S)
            return self._number, self._images[camera] if self._number > number else None


class _Stream(BaseHTTPRequestHandler):
    """One camera's pictures, until nobody looks any more."""

    timeout = _READ_S
    server: _Pictures

    def do_GET(self) -> None:
        """Sends them; 404 for another path."""
        name = self.path.strip("/")
        if name not in self.server.names:
            expected = ", ".join(self.server.names)
            self.send_error(HTTPStatus.NOT_FOUND, explain=f"the cameras are {expected}")
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "video/x-yuv4mpeg")
        self.end_headers()
        try:
            self._send(self.server.names.index(name))
        except OSError:  # nobody looks any more
            return

    def _send(self, camera: int) -> None:
        number = 0
        while self.server.open:
            before = number
            number, image = self.server.after(before, camera)
            if image is None:
                continue
            if not before:
                height, width = image.shape
                head = f"YUV4MPEG2 W{width} H{height} F{RATE_HZ:g}:1 Ip A1:1 Cmono\n"
                self.wfile.write(head.encode())
            self.wfile.write(b"FRAME\n")
            self.wfile.write(image.data)

    def log_message(self, format: str, *args: object) -> None:
        """Says nothing: the terminal has a line of its own."""


class NetworkCameras:
    """Cameras that are rendered and sent; a context that leaves no socket and no thread.

    Attributes:
        found: they, as `vsense camera list` knows a camera.
        lines_port: where a tracker's lines come in.
    """

    def __init__(
        self,
        experiment: Experiment,
        seed: int,
        port: int,
        lines_port: int,
        say: Callable[[str], None],
    ) -> None:
        """Builds the scene, which takes a second or two.

        Args:
            experiment: is settled; they see its arena, walls, robots and objects.
            seed: of the floor, its dirt and its light, and of the pictures' noise.
            port, lines_port: of cameras and tracker; 0 takes any that is free.
            say: takes what happens to the tracker's connection.

        Raises:
            TooLargeArena: it takes too many cameras.
            LinkError: a port is taken.
        """
        spec = spec_for(experiment, "", seed, Path())
        self._rows = {tag: row for row, tag in enumerate(experiment.tags.values())}
        self._images = np.zeros(spec.shape, np.uint8)
        self._lines = ArenaListener(HOST, lines_port, list(self._rows), say)
        self.lines_port = self._lines.port
        names = [camera.id for camera in spec.cameras]
        try:
            self._pictures = _Pictures(port, names)
        except LinkError:
            self._lines.close()
            raise
        url = f"http://{HOST}:{self._pictures.port}"
        details = Details(size_px=(spec.shape[2], spec.shape[1]))
        self.found = [
            FoundCamera(f"{url}/{name}", URL, url, "rendered", details=details, name=name)
            for name in names
        ]
        self._studio = Studio(spec)
        self._thread = threading.Thread(target=self._pictures.serve_forever, daemon=True)

    def __enter__(self) -> NetworkCameras:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._pictures.open = False
        self._pictures.shutdown()
        self._pictures.server_close()
        self._lines.close()

    def run(self, interrupted: Event, progress: Callable[[str], None]) -> None:
        """Takes pictures until it is interrupted: of each state that comes, or of an empty floor.

        A state is drawn until a newer one is there, for a second at most.
        """
        state, timestep = None, 0
        while not interrupted.is_set():
            timestep += 1
            self._studio.prepare(timestep, self._images)
            state = self._next(state)
            poses = self._poses(state)
            dark = np.zeros(len(self._rows), np.uint16)
            self._studio.expose(timestep, poses[np.newaxis], dark, self._images)
            self._pictures.show(self._images)
            heard = "no tracker writes"
            if state is not None:
                heard = f"{len(state.robots)} of {len(poses)} bodies"
            progress(f"{timestep} pictures of {len(self.found)} cameras  {heard}")

    def _next(self, last: ArenaState | None) -> ArenaState | None:
        """The next state; the last one where none comes in time, None where that is too old."""
        try:
            return self._lines.next(1.0 / RATE_HZ)[0]
        except LinkError:
            is_new = last is not None and host_ns() - last.capture_ns < TRACKER_SILENCE_NS
            return last if is_new else None

    def _poses(self, state: ArenaState | None) -> Floats:
        """Where all bodies are, (n, 3): x [m], y [m], yaw [rad]."""
        poses = np.full((len(self._rows), 3), _AWAY_M)
        for pose in () if state is None else state.robots:
            poses[self._rows[int(pose["tag"])]] = pose["x_m"], pose["y_m"], pose["yaw_rad"]
        return poses
