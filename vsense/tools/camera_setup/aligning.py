"""`vsense camera arena align`, from camera files and pictures or pixels to moved camera files.

The page with cameras' pictures, and arena corners to drag, is served to this machine only, at an
address that nobody guesses. It draws; what a click means is computed here.
"""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.errors import UsageError, VsenseError, failing_as
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data, printable_json
from vsense.vision.calibration import alignment
from vsense.vision.calibration.alignment import Alignment
from vsense.vision.calibration.frame import FrameShift
from vsense.vision.calibration.session import cameras_of
from vsense.vision.cameras.camera import Camera

HOST = "127.0.0.1"
_FILES = {
    "": ("index.html", "text/html; charset=utf-8"),
    "align.js": ("align.js", "text/javascript; charset=utf-8"),
    "align.css": ("align.css", "text/css; charset=utf-8"),
}
_MOST_BYTES = 65_536
_STEPS = 60
"""Pieces of each side of an outline that is drawn."""
_QUALITY = 88
_LOOK_S = 0.1


class AlignTask:
    """What the page asks for; any thread.

    Attributes:
        saved: what was found and written, None before.
    """

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        points_m: Mapping[str, Floats],
        outline_m: Floats,
        pictures: Mapping[str, Image],
        save: Callable[[Alignment], None],
    ) -> None:
        """Takes the cameras in use, where points are to be, and (n, 3) corners of what is drawn.

        `pictures` are (h, w) uint8 by camera; `save` writes what was found, and raises VsenseError.
        """
        self._cameras = {name: cameras[name] for name in pictures}
        self._points = points_m
        self._outline = outline_m
        self._pictures = pictures
        self._save = save
        self.saved: Alignment | None = None
        self._lock = threading.Lock()

    def start(self) -> dict[str, Any]:
        """What the page begins with."""
        cameras = [
            {"id": c.id, "width_px": c.width_px, "height_px": c.height_px}
            for c in self._cameras.values()
        ]
        return {"cameras": cameras, "points": list(self._points), **self._drawn(FrameShift())}

    def solve(self, clicks: Any) -> dict[str, Any]:
        """What clicks mean so far; with fewer than two points that is nothing yet."""
        sights = alignment.read_clicks(clicks, self._cameras, self._points)
        if len({sight.point for sight in sights}) < 2:
            return {"found": None, **self._drawn(FrameShift())}
        solution = alignment.solve(self._cameras, self._points, sights)
        return {"found": alignment.as_json(solution), **self._drawn(solution.shift)}

    def save(self, clicks: Any) -> dict[str, Any]:
        """Moves the frame; UsageError where that was done or there are too few clicks."""
        solution = alignment.solve(
            self._cameras, self._points, alignment.read_clicks(clicks, self._cameras, self._points)
        )
        with self._lock:
            if self.saved is not None:
                raise UsageError("this was saved already; start vsense camera arena align again")
            self._save(solution)
            self.saved = solution
        return {"saved": alignment.as_json(solution)}

    def picture(self, camera: str) -> bytes:
        """A camera's picture as a JPEG; KeyError where there is none."""
        quality = (cv2.IMWRITE_JPEG_QUALITY, _QUALITY)
        return cv2.imencode(".jpg", self._pictures[camera], quality)[1].tobytes()

    def _drawn(self, shift: FrameShift) -> dict[str, Any]:
        """Where the pictures show points and outline when the frame is moved."""
        moved = {name: shift.moved(camera) for name, camera in self._cameras.items()}
        places = np.array(list(self._points.values()))
        return {
            "expected": {
                name: [
                    [round(float(x), 2), round(float(y), 2)] if seen else None
                    for (x, y), seen in zip(*_seen(camera, places))
                ]
                for name, camera in moved.items()
            },
            "outline": {name: _lines(camera, self._outline) for name, camera in moved.items()},
        }


def _seen(camera: Camera, places: Floats) -> tuple[Floats, Sequence[bool]]:
    """Pixels (n, 2) of (n, 3) places, and whether the picture shows them."""
    ahead = (places - camera.position_m) @ np.reshape(camera.rotation, (3, 3))[2] > 0.0
    with np.errstate(all="ignore"):
        pixels = camera.project(places)
        seen = ahead & camera.contains(pixels)
        # Far out of sight a lens model folds back into the picture.
        back = camera.to_plane(pixels, places[:, 2])
        seen &= np.linalg.norm(back - places[:, :2], axis=1) < 1e-3
    return pixels, seen.tolist()


def _lines(camera: Camera, corners: Floats) -> list[list[list[float]]]:
    """The pieces of a closed outline that a picture shows."""
    share = np.linspace(0.0, 1.0, _STEPS, endpoint=False)[:, np.newaxis]
    sides = [end + share * (other - end) for end, other in zip(corners, np.roll(corners, -1, 0))]
    places = np.concatenate([*sides, corners[:1]])
    lines: list[list[list[float]]] = [[]]
    for (x, y), seen in zip(*_seen(camera, places)):
        if seen:
            lines[-1].append([round(float(x), 1), round(float(y), 1)])
        elif lines[-1]:
            lines.append([])
    return [line for line in lines if len(line) > 1]


class AlignServer(ThreadingHTTPServer):
    """Serves one task until it is saved or closed.

    `url` is where the page is; `finished` is set when something was saved.
    """

    daemon_threads = True

    def __init__(self, task: AlignTask, port: int) -> None:
        """Raises VsenseError where the port is taken."""
        self.task = task
        self.token = secrets.token_urlsafe(16)
        self.finished = threading.Event()
        with failing_as(VsenseError, f"--port {port}"):
            super().__init__((HOST, port), _Handler)
        self.url = f"http://{HOST}:{self.server_port}/{self.token}/"

    def serve_until(self, wait: Callable[[float], bool]) -> None:
        """Serves until something was saved, or `wait`, which waits so many s, gives True."""
        thread = threading.Thread(target=self.serve_forever, args=(0.1,), daemon=True)
        thread.start()
        while not self.finished.is_set() and not wait(_LOOK_S):
            pass
        self.shutdown()
        thread.join()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Passes over visitors that have gone."""


class _Handler(BaseHTTPRequestHandler):
    server: AlignServer
    timeout = 10.0

    def do_GET(self) -> None:
        """Files, pictures, and what the page begins with."""
        path = self._path()
        task = self.server.task
        if path is None:
            self._send(404, b"vsense camera arena align: not here", "text/plain")
        elif path in _FILES:
            name, kind = _FILES[path]
            file = resources.files("vsense.tools.camera_setup") / "align" / name
            self._send(200, file.read_bytes(), kind)
        elif path == "start.json":
            self._answer(task.start)
        else:
            try:
                number = int(path.removeprefix("picture/"))
                self._send(200, task.picture(task.start()["cameras"][number]["id"]), "image/jpeg")
            except (ValueError, IndexError):
                self._send(404, b"no such picture", "text/plain")

    def do_POST(self) -> None:
        """What clicks mean, and saving it."""
        path, task = self._path(), self.server.task
        length = self.headers.get("Content-Length", "")
        if path not in ("solve", "save") or not length.isdecimal() or len(length) > 6:
            self._send(404, b"not here", "text/plain")
            return
        if int(length) > _MOST_BYTES:
            self._send(413, b"too long", "text/plain")
            return
        try:
            clicks = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            self._send(400, b'{"error": "no JSON"}', "application/json")
            return
        self._answer(lambda: task.solve(clicks) if path == "solve" else task.save(clicks))
        if path == "save" and task.saved is not None:
            self.server.finished.set()

    def log_message(self, format: str, *args: Any) -> None:
        """Says nothing of requests."""

    def _path(self) -> str | None:
        """What is asked for behind the token; None without it, or under another host's name."""
        host = self.headers.get("Host", "")
        hosts = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        lead = f"/{self.server.token}/"
        if host not in hosts or not secrets.compare_digest(
            self.path[: len(lead)].encode(), lead.encode()
        ):
            return None
        return self.path[len(lead) :]

    def _answer(self, make: Callable[[], dict[str, Any]]) -> None:
        try:
            status, answer = 200, make()
        except VsenseError as error:
            status, answer = 400, {"error": str(error)}
        self._send(status, printable_json(json.dumps(answer)).encode(), "application/json")

    def _send(self, status: int, body: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Content-Security-Policy", "default-src 'self'; frame-ancestors 'none'")
        self.end_headers()
        self.wfile.write(body)


@dataclass(frozen=True, slots=True)
class AlignOptions:
    """How the frame is moved; see `vsense camera arena align -h`. `height` is in m."""

    cameras: Path
    points: Path | None
    height: float
    clicks: list[str]
    seen: Path | None
    pictures: list[Path] | None
    camera: str | None
    port: int
    dry: bool
    json: bool


def run(options: AlignOptions, corners_m: Sequence[Sequence[float]]) -> int:
    """Finds where the frame is to be, says what remains, and moves the camera files.

    `corners_m` are those of the experiment's arena. Returns 0, or 130 where the page was left.

    Raises:
        UsageError, ConfigError: options or files are wrong.
        VsenseError: the page cannot be served.
    """
    cameras = cameras_of("--cameras", options.cameras)
    points = alignment.points_of(corners_m, options.height, options.points)
    clicks = alignment.sights_of(options.clicks, options.seen, cameras, points)
    if not clicks:
        return _with_page(options, cameras, points, np.array(corners_m))
    solution = alignment.solve(cameras, points, clicks)
    _deliver(options, solution)
    _print(options, solution)
    return 0


def undo(folder: Path) -> int:
    """Puts camera files back as they were; returns 0."""
    for path in alignment.undo(folder):
        print_data(str(path))
    _say("the camera files are as they were before")
    return 0


def _with_page(
    options: AlignOptions,
    cameras: Mapping[str, Camera],
    points: Mapping[str, Floats],
    corners_m: Floats,
) -> int:
    """Serves the page until something was saved, or Ctrl-C."""
    if not options.pictures:
        raise UsageError(
            "expected --pictures, of all cameras at one moment (vsense camera shoot takes them),"
            " or --click, or --seen"
        )
    pictures = alignment.pictures_of(options.pictures, options.camera, cameras, options.cameras)
    outline = np.column_stack((corners_m, np.full(len(corners_m), options.height)))
    task = AlignTask(cameras, points, outline, pictures, lambda fit: _deliver(options, fit))
    with interruption() as interrupted, AlignServer(task, options.port) as server:
        _say(f"open {server.url} in a browser on this machine; Ctrl-C ends without a change")
        server.serve_until(interrupted.wait)
        if task.saved is None:
            _say("nothing was changed")
            return interrupted.code
    _print(options, task.saved)
    return 0


def _deliver(options: AlignOptions, solution: Alignment) -> None:
    """Says what was found, and moves the camera files unless that was not wanted."""
    for line in alignment.as_text(solution):
        _say(line)
    if options.dry:
        _say("nothing was changed (--dry)")
        return
    files = alignment.apply(options.cameras, solution)
    before = options.cameras / alignment.BEFORE_ALIGN
    _say(f"{len(files)} camera files moved; as they were: {before} (--undo puts them back)")
    stale = alignment.stale_check(options.cameras)
    if stale:
        _say(stale)


def _print(options: AlignOptions, found: Alignment) -> None:
    facts = json.dumps(alignment.as_json(found), indent=2) if options.json else ""
    print_data(facts or str(options.cameras))


def _say(text: str) -> None:
    Console().say(text)
