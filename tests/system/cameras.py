"""Cameras on the network, each of which can be switched off and on again."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.monitor.recording.pictures import experiment_text, one_tracker, resources_text
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family

PERIOD_S = 0.05
SIZE_PX = (480, 360)


class NetworkCameras(ThreadingHTTPServer):
    """Two cameras side by side that see robots which never move.

    Attributes:
        off: ids of those that are switched off.
    """

    daemon_threads = True

    def __init__(self, robots: Sequence[Robot]) -> None:
        super().__init__(("127.0.0.1", 0), Page)
        self.cameras = [
            Camera.looking_down(name, x_m, 0.0, 2.4, 1100.0, SIZE_PX)
            for name, x_m in (("a", -0.2), ("b", 0.2))
        ]
        family = load_family("arrow4x4")
        self.pictures = {
            c.id: bytes(cv2.imencode(".jpg", render(c, family, robots, Look()))[1])
            for c in self.cameras
        }
        self.heights_m = dict.fromkeys((robot.tag for robot in robots), HEIGHT_M)
        self.off: set[str] = set()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def files(self, folder: Path) -> tuple[str, str]:
        """Writes the two files of a tracking session with both."""
        trackers = one_tracker(self.cameras, "arrow4x4", self.heights_m)
        text = resources_text(self.cameras, trackers)
        (folder / "cameras").mkdir()
        for camera in self.cameras:
            (folder / "cameras" / f"{camera.id}.json").write_text(camera.to_json())
            url = f"http://127.0.0.1:{self.server_address[1]}/{camera.id}"
            pictures = f'type="directory" path="pictures/{camera.id}"'
            times = f'\n             timestamps="pictures/{camera.id}/timestamps.csv"'
            assert pictures in text and times in text
            text = text.replace(pictures, f'type="camera" device="{url}"').replace(times, "")
        (folder / "resources.xml").write_text(text)
        (folder / "experiment.xml").write_text(experiment_text(self.cameras, trackers))
        return str(folder / "resources.xml"), str(folder / "experiment.xml")

    def close(self) -> None:
        """Ends both."""
        self.off.update(camera.id for camera in self.cameras)
        self.shutdown()
        self.server_close()


class Page(BaseHTTPRequestHandler):
    """A stream of pictures, until the camera is switched off or nobody looks any more."""

    server: NetworkCameras

    def do_GET(self) -> None:
        name = self.path.strip("/")
        if name in self.server.off:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        data = self.server.pictures[name]
        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
        try:
            while name not in self.server.off:
                self.wfile.write(head.encode() + data + b"\r\n")
                threading.Event().wait(PERIOD_S)
        except OSError:
            return

    def log_message(self, format: str, *args: object) -> None:
        """Says nothing: its words would stand between the test's."""
