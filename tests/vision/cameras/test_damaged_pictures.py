"""Damaged pictures by the hundred thousand: each is a picture or one clear error, never a crash."""

from __future__ import annotations

import itertools
import json
import random
import subprocess
import sys
import threading
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.rigs.places import ROOT
from tests.vision.cameras.damaging import damage
from vsense.vision.cameras._live_grabber import LiveGrabber
from vsense.vision.cameras._opencv_source import DeviceSource
from vsense.vision.cameras.picture import PictureError
from vsense.vision.cameras.source import Controls, Shot

SEED, COUNT, MOST = 7, 8_000, 100_000
GROWN_MB = 400
"""A picture may claim 50 million pixels; a progressive JPEG's colours take several bytes each."""


@pytest.mark.parametrize("count", [COUNT, pytest.param(MOST, marks=pytest.mark.campaign)])
def test_thousands_of_damaged_pictures_crash_nothing(tmp_path: Path, count: int) -> None:
    """In a process of its own: where that dies, the picture that it died of is kept."""
    box = tmp_path / "picture-in-hand"
    command = [
        sys.executable,
        "-m",
        "tests.vision.cameras.damaging",
        str(SEED),
        str(count),
        str(box),
    ]
    with (tmp_path / "stderr").open("w+") as talk:
        # Libraries write a line about every second picture: those go to a file.
        run = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=talk, text=True)
    if run.returncode != 0:
        last = (tmp_path / "stderr").read_text(errors="replace")[-2000:]
        head = box.read_bytes().partition(b"\n")[0].decode()
        raise AssertionError(f"ended with {run.returncode} at {head}, kept in {box}:\n{last}")
    came = json.loads(run.stdout)
    assert came["refused"] + came["read"] == count
    assert came["searched"] > count / 4, "enough of them come as far as the detector"
    assert came["found"] > count / 20, "and some still show the marker"
    assert came["grown_mb"] < GROWN_MB


SIZE = (64, 48)
PARTS, AT_ONCE = 400, 8
GOOD, LAST = 90, 200
"""Grey of the good pictures among the damaged ones, and of those after them."""


def jpeg(grey: int, size_px: tuple[int, int] = SIZE) -> bytes:
    return bytes(cv2.imencode(".jpg", np.full(size_px[::-1], grey, np.uint8))[1])


def part(number: int, whole: bytes) -> bytes:
    """A part of the stream: every second one is good, the others are damaged in some way."""
    chance = random.Random(number)
    data, length, before = whole, len(whole), b""
    if number % 2:
        way = number // 2 % 5
        if way == 0:
            data = whole[: chance.randrange(len(whole))]
        elif way == 1:
            data = damage(whole, whole, chance)
        elif way == 2:
            data = jpeg(30, (32, 24))
        elif way == 3:
            before = chance.randbytes(chance.randrange(200)).replace(b"-", b"+")
        length = len(data)
        if way == 4:
            # The next good part is lost with it where it is too long: that is the camera's fault.
            length += chance.choice((-len(whole) // 2, -1, 1, 40))
    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {length}\r\n\r\n"
    return before + head.encode() + data + b"\r\n"


class Faulty(ThreadingHTTPServer):
    """A camera that sends PARTS parts, the damaged ones among them, and good ones ever after.

    It hangs up after AT_ONCE parts: whoever lost the thread within them goes on behind them.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), FaultyStream)
        self.starts = itertools.count(0, AT_ONCE)
        self.ended = threading.Event()


class FaultyStream(BaseHTTPRequestHandler):
    server: Faulty

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        start = next(self.server.starts)
        try:
            # A whole one first: whoever opens a stream looks at its first picture.
            self.wfile.write(part(0, jpeg(GOOD)))
            for number in range(start, min(start + AT_ONCE, PARTS)):
                self.wfile.write(part(number, jpeg(GOOD)))
            while start >= PARTS and not self.server.ended.is_set():
                self.wfile.write(part(0, jpeg(LAST)))
        except OSError:
            return

    def log_message(self, format: str, *args: object) -> None:
        pass


class Counting(DeviceSource):
    """Counts what comes: pictures by their grey, and damaged ones by "damaged"."""

    def __init__(self, url: str) -> None:
        super().__init__(url, Controls())
        self.counts: Counter[int | str] = Counter()

    def read(self) -> Shot:
        try:
            shot = super().read()
        except PictureError:
            self.counts["damaged"] += 1
            raise
        if shot.image.shape == SIZE[::-1]:
            self.counts[round(float(shot.image.mean()))] += 1
        return shot


def test_a_stream_full_of_damage_goes_on_and_tells_it() -> None:
    server = Faulty()
    threading.Thread(target=server.serve_forever, daemon=True).start()
    source = Counting(f"http://127.0.0.1:{server.server_address[1]}/arena.mjpg")
    clock = itertools.count(1).__next__
    grabber = LiveGrabber({"a": source}, {"a": SIZE}, clock, retry_s=0.0)
    kinds: set[str] = set()
    try:
        grey = 0.0
        while abs(grey - LAST) > 3:
            grey = max(float(frame.image.mean()) for frame in grabber.next(30.0))
            kinds |= {event.kind for event in grabber.events()}
        assert source.counts[GOOD] > PARTS / 4
        assert source.counts["damaged"] > PARTS / 20
        assert {"damaged", "size", "gone", "back"} <= kinds
    finally:
        server.ended.set()
        grabber.close()
        server.shutdown()
        server.server_close()
