"""`scripts/bench grabbing`: what a GigE camera's pictures cost on top of finding markers in them.

Without a camera Aravis' fake one on loopback sends them, a program of its own. Only the processor
time of this process, all of its threads, counts, per picture.
"""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

from tests.bench.frames import MARKER_M, Painter, cameras
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, VsenseError
from vsense.modes.lab._camera_spec import SIZE_PX
from vsense.vision.cameras._genicam import GenicamSource
from vsense.vision.cameras._live_grabber import LiveGrabber
from vsense.vision.cameras.source import Controls, GenicamSettings
from vsense.vision.markers.families import MarkerFamily, choose_tags, load_family
from vsense.vision.tracking._detector import make_detector

RATE_HZ = 10.0
PACKETS = (1500, 9000)
"""Bytes: Ethernet's own, and jumbo."""
TURN_S = 3.0
ROBOTS = 20
FAKE = "arv-fake-gv-camera-0.8"

_LOOPBACK = "127.0.0.1"
_FIRST_S = 10.0
_BLUR_MM = 2.2

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class GrabbingRow:
    """The cost of "detect", "grab" or "grab and detect".

    Attributes:
        packet_size: bytes of a packet; None: no network.
        cpu_ms: processor time per picture, the median of the turns.
        pictures: all of them together.
        damaged: pictures that came damaged.
        age_ms: from the arrival of a picture's first packet until `next` returned, median.
    """

    work: str
    packet_size: int | None
    cpu_ms: float
    pictures: int
    damaged: int
    age_ms: float | None


def run(rounds: int, device: str | None, say: Say) -> dict[str, Any]:
    """Runs the benchmark: in each round each kind of work has its turn.

    `device` is a GigE camera's address, id or serial number; None: the fake one.

    Returns:
        "rows", and of each packet size "on_top_ms": what grabbing adds to detecting.

    Raises:
        VsenseError: there is no camera.
    """
    rows = []
    with _camera(device) as address:
        detect = _detecting()
        for packet_size in PACKETS:
            say(f"{rounds} rounds with packets of {packet_size} bytes")
            rows += _turns(address, packet_size, rounds, detect)
    cpu = {(row.work, row.packet_size): row.cpu_ms for row in rows}
    on_top = {n: cpu["grab and detect", n] - cpu["detect", n] for n in PACKETS}
    return {
        "size_px": list(SIZE_PX),
        "rate_hz": RATE_HZ,
        "rows": [asdict(row) for row in rows],
        "on_top_ms": {str(n): round(ms, 3) for n, ms in on_top.items()},
    }


def table(report: dict[str, Any]) -> str:
    """The report as text."""
    lines = [
        f"{'work':16} {'packets':>8} {'CPU ms/picture':>15} {'pictures':>9} {'damaged':>8}"
        f" {'age ms':>7}"
    ]
    for row in report["rows"]:
        age = "-" if row["age_ms"] is None else f"{row['age_ms']:.1f}"
        lines.append(
            f"{row['work']:16} {row['packet_size']:>8} {row['cpu_ms']:>15.2f}"
            f" {row['pictures']:>9} {row['damaged']:>8} {age:>7}"
        )
    width, height = report["size_px"]
    lines += [
        f"grabbing a picture of {width} x {height} px costs {ms:.2f} ms on top, in packets of {n}"
        for n, ms in report["on_top_ms"].items()
    ]
    return "\n".join(lines)


@contextmanager
def _camera(device: str | None) -> Iterator[str]:
    """A camera's name; without one, starts the fake camera and ends it afterwards."""
    if device is not None:
        yield device
        return
    program = shutil.which(FAKE)
    if program is None:
        raise VsenseError(f"{FAKE} is not here: apt-get install aravis-tools, or give --device")
    fake = subprocess.Popen([program, "-i", _LOOPBACK], stderr=subprocess.DEVNULL)
    try:
        yield _LOOPBACK
    finally:
        fake.kill()
        fake.wait()


def _detecting() -> Callable[[], object]:
    """Makes what finds the markers in a rendered picture of a cluttered floor."""
    family = load_family("arrow4x4")
    assert isinstance(family, MarkerFamily)
    tags = tuple(choose_tags(family, ROBOTS, _BLUR_MM, seed=14))
    crowd = Painter("arrow4x4", "arrow4x4", tags, cameras(1, 1)).crowds(1)
    detector = make_detector(family, tags, MARKER_M)
    return lambda: detector.detect(crowd.images[0], crowd.cameras[0])


def _turns(
    address: str, packet_size: int, rounds: int, detect: Callable[[], object]
) -> list[GrabbingRow]:
    """Does all kinds of work in turn."""
    settings = GenicamSettings(Controls(SIZE_PX, RATE_HZ), packet_size=packet_size)
    ways = {"detect": (False, True), "grab": (True, False), "grab and detect": (True, True)}
    found: dict[str, list[tuple[float, int, int, list[float]]]] = {way: [] for way in ways}
    for _ in range(rounds):
        for way, (grabs, detects) in ways.items():
            grabber = None
            if grabs:
                source = GenicamSource(address, settings, host_ns)
                grabber = LiveGrabber({"camera": source}, {"camera": SIZE_PX}, host_ns)
            try:
                found[way].append(_turn(grabber, detect if detects else lambda: None))
            finally:
                if grabber is not None:
                    grabber.close()
    return [_row(way, packet_size, turns) for way, turns in found.items()]


def _turn(
    grabber: LiveGrabber | None, work: Callable[[], object]
) -> tuple[float, int, int, list[float]]:
    """Works for a while; returns CPU time per picture [ms], pictures, damaged ones, and ages."""
    if grabber is not None:
        grabber.next(_FIRST_S)
    work()
    pictures, ages_ms = round(TURN_S * RATE_HZ), []
    begun_ns = time.process_time_ns()
    due_ns = host_ns()
    for _ in range(pictures):
        if grabber is None:
            due_ns += round(1e9 / RATE_HZ)
            time.sleep(max(due_ns - host_ns(), 0) / 1e9)
        else:
            frame = grabber.next(_FIRST_S)[0]
            ages_ms.append((host_ns() - frame.capture_ns) / 1e6)
        work()
    cpu_ms = (time.process_time_ns() - begun_ns) / 1e6 / pictures
    events = [] if grabber is None else grabber.events()
    gone = [str(event) for event in events if event.kind == "gone"]
    if gone:
        raise GrabberError(gone[0])
    return cpu_ms, pictures, sum(event.kind == "damaged" for event in events), ages_ms


def _row(
    way: str, packet_size: int, turns: list[tuple[float, int, int, list[float]]]
) -> GrabbingRow:
    ages_ms = [ms for _, _, _, ages in turns for ms in ages]
    return GrabbingRow(
        work=way,
        packet_size=packet_size,
        cpu_ms=median(cpu for cpu, _, _, _ in turns),
        pictures=sum(pictures for _, pictures, _, _ in turns),
        damaged=sum(damaged for _, _, damaged, _ in turns),
        age_ms=median(ages_ms) if ages_ms else None,
    )
