"""Free-running cameras: synchronised, retried, told; a real stream over HTTP."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest

from vsense.base.errors import GrabberError
from vsense.vision.cameras._live_grabber import LiveGrabber
from vsense.vision.cameras._opencv_source import DeviceSource
from vsense.vision.cameras.picture import PictureError
from vsense.vision.cameras.source import Controls, Shot

SIZE = (64, 48)
PATIENCE_S = 30.0
"""No test waits this long: something else happens first."""


class Fake:
    """A camera that gives what a test hands it: a picture, or an error."""

    def __init__(self, refuses: list[str] = []) -> None:  # noqa: B006
        self.comes: queue.Queue[np.ndarray | Exception] = queue.Queue()
        self.opens: queue.Queue[Exception | None] = queue.Queue()
        self.refuses = refuses
        self.reading = threading.Semaphore(0)

    def open(self) -> list[str]:
        failure = self.opens.get()
        if failure is not None:
            raise failure
        return self.refuses

    def read(self) -> Shot:
        self.reading.release()
        thing = self.comes.get()
        if isinstance(thing, Exception):
            raise thing
        return Shot(thing)

    def close(self) -> None:
        pass

    def end(self) -> None:
        """Lets the thread go, wherever it waits."""
        for _ in range(3):
            self.opens.put(GrabberError("the end"))
            self.comes.put(GrabberError("the end"))


def picture(value: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    return np.full(size[::-1], value, np.uint8)


@contextmanager
def live(patience_s: float = PATIENCE_S, **cameras: Fake) -> Iterator[LiveGrabber]:
    clock = iter(range(1, 10_000)).__next__
    grabber = LiveGrabber(
        cameras, dict.fromkeys(cameras, SIZE), clock, patience_s=patience_s, retry_s=0.0
    )
    try:
        yield grabber
    finally:
        grabber._ended.set()
        for camera in cameras.values():
            camera.end()
        grabber.close()


def opened(camera: Fake) -> Fake:
    camera.opens.put(None)
    return camera


def wait_for_event(grabber: LiveGrabber, kind: str) -> str:
    """Waits until the grabber has something of this kind to tell."""
    told: list[str] = []
    with grabber._news:

        def come() -> bool:
            told.extend(str(e) for e in grabber._events if e.kind == kind)
            rest = [e for e in grabber._events if e.kind != kind]
            grabber._events.clear()
            grabber._events.extend(rest)
            return bool(told)

        assert grabber._news.wait_for(come, 10.0), kind
    return told[0]


def test_a_timestep_has_the_newest_picture_of_every_camera() -> None:
    a, b = opened(Fake()), opened(Fake())
    with live(a=a, b=b) as grabber:
        for value in (1, 2):
            a.comes.put(picture(value))
        for _ in range(3):
            a.reading.acquire()
        b.comes.put(picture(3))
        frames = grabber.next(10.0)
        assert [(f.camera, int(f.image[0, 0]), f.timestep) for f in frames] == [
            ("a", 2, 0), ("b", 3, 0),
        ]  # fmt: skip
        assert all(f.ready_ns >= f.capture_ns > 0 for f in frames)
        a.comes.put(picture(4))
        b.comes.put(picture(5))
        assert {f.timestep for f in grabber.next(10.0)} == {1}


def test_a_camera_that_disappears_is_told_and_comes_back_while_the_rest_goes_on() -> None:
    a, b = opened(Fake()), opened(Fake())
    with live(a=a, b=b) as grabber:
        b.reading.acquire()
        b.comes.put(GrabberError("unplugged"))
        assert "is gone: unplugged; trying again every 0 s" in wait_for_event(grabber, "gone")
        a.comes.put(picture(1))
        assert [f.camera for f in grabber.next(10.0)] == ["a"]
        b.opens.put(GrabberError("still not there"))
        b.opens.put(None)
        b.comes.put(picture(2))
        assert str(wait_for_event(grabber, "back")) == "camera b: is back"
        assert not [e for e in grabber.events() if e.kind == "gone"]
        a.comes.put(picture(2))
        assert [f.camera for f in grabber.next(10.0)] == ["a", "b"]


def test_damaged_pictures_and_wrong_sizes_are_left_out_and_told() -> None:
    a = opened(Fake(["does not take gain_raw 7"]))
    with live(a=a) as grabber:
        a.comes.put(PictureError("is no picture"))
        a.comes.put(picture(1, (10, 10)))
        a.comes.put(picture(2))
        assert [int(f.image[0, 0]) for f in grabber.next(10.0)] == [2]
        assert [str(e) for e in grabber.events()] == [
            "camera a: does not take gain_raw 7",
            "camera a: is no picture",
            "camera a: a picture of 10 x 10 px, its calibration is for 64 x 48",
            "camera a: has the size of its calibration again",
        ]


def test_silence_is_an_error() -> None:
    with live(a=Fake()) as grabber, pytest.raises(GrabberError, match="no camera"):
        grabber.next(0.001)


def test_a_closed_grabber_gives_nothing() -> None:
    a = opened(Fake())
    with live(a=a) as grabber:
        a.end()
        grabber.close()
        with pytest.raises(GrabberError):
            grabber.next(10.0)


class Stream(BaseHTTPRequestHandler):
    """A camera's web page: JPEG pictures one after another, until the test says stop."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        data = bytes(cv2.imencode(".jpg", picture(90))[1])
        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
        try:
            for _ in range(40):
                self.wfile.write(head.encode() + data + b"\r\n")
        except OSError:
            return

    def log_message(self, format: str, *args: object) -> None:
        pass


def test_a_camera_on_the_network_is_opened_read_lost_and_opened_again() -> None:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Stream)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_address[1]}/arena.mjpg"
    source = DeviceSource(url, Controls())
    try:
        for _ in range(2):
            assert source.open() == []
            pictures = 0
            with pytest.raises(GrabberError, match="no more pictures"):
                while True:
                    image = source.read().image
                    assert image.shape == SIZE[::-1] and abs(float(image.mean()) - 90) < 3
                    pictures += 1
            assert pictures >= 10
    finally:
        source.close()
        server.shutdown()
        server.server_close()


@pytest.mark.parametrize("device", ["/dev/video999", "63", "http://127.0.0.1:1/nothing", "nothing"])
def test_a_device_that_is_not_there_says_so(device: str) -> None:
    source = DeviceSource(device, Controls(SIZE, 10.0, 8000.0, 3.0))
    with pytest.raises(GrabberError, match="does not open"):
        source.open()
    with pytest.raises(GrabberError, match="is not open"):
        source.read()
    source.close()
