"""Cameras of several computers: their files, and the programs that look at their pictures."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np

from tests.rigs.processes import Program
from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, NoMorePictures
from vsense.config import tracking_session
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.opening import open_tracking


def central_file(
    resources: Path, where: str, nodes: Sequence[str], kind: str, rate_hz: float = 10.0
) -> Path:
    """Writes beside a resources file that of a tracker whose grabbers these nodes have in turn.

    `where` is the address where it listens, `kind` the type of its grabbers.
    """
    tree = ElementTree.parse(resources)
    grabbers = tree.getroot().find("grabbers")
    assert grabbers is not None
    for number, grabber in enumerate(grabbers):
        id = grabber.get("id", "")
        grabber.attrib.clear()
        node = nodes[number * len(nodes) // len(grabbers)]
        grabber.attrib.update(id=id, type=kind, node=node)
        if kind == "node":
            grabber.set("frame_rate", f"{rate_hz:g}")
    tree.getroot().insert(1, ElementTree.Element("nodes", listen=where))
    path = resources.with_name("central.xml")
    tree.write(path)
    return path


PERIOD_NS = 100_000_000
PATIENCE_S = 60.0
SIZE = (600, 480)
CAMERAS = [
    Camera.looking_down(f"cam_{n}", x, 0.0, 2.4, 1600.0, SIZE)
    for n, x in enumerate((-0.9, -0.3, 0.3, 0.9))
]
"""Each sees robots of its own, and one that a neighbour sees, too."""
PICTURES = 6


def draw(folder: Path) -> Path:
    """Draws what the cameras see of ten robots that drive about; returns the resources file."""
    family, generator = load_family("arrow4x4"), np.random.default_rng(1)
    tags = [31, 700, 1843, 4334, 7167, 7488, 10_084, 12_689, 13_103, 16_011]
    for camera in CAMERAS:
        (folder / camera.id).mkdir()
        (folder / f"{camera.id}.json").write_text(camera.to_json())
        for k in range(PICTURES):
            way = 0.012 * k
            robots = [
                Robot(tag, -1.08 + 0.24 * n, 0.12 * (-1) ** n - 0.08 + way, 1.57)
                for n, tag in enumerate(tags)
            ]
            image = render(camera, family, robots, Look(litter=5, noise=0.0), 1, 0.06)
            noisy = np.clip(image + generator.normal(0.0, 2.0, image.shape), 0, 255)
            cv2.imwrite(str(folder / camera.id / f"{k:03}.pgm"), noisy.astype(np.uint8))
    parts = {
        "grabbers": "".join(
            f'<grabber id="{c.id}" type="camera" device="{folder / c.id}" />' for c in CAMERAS
        ),
        "trackers": f'<tracker id="t" family="arrow4x4" tags="{" ".join(map(str, tags))}" />',
        "cameras": "".join(f'<camera id="{c.id}" calibration="{c.id}.json" />' for c in CAMERAS),
    }
    body = "".join(f"<{name}>{text}</{name}>" for name, text in parts.items())
    path = folder / "resources.xml"
    path.write_text(f"<arena_tracking_system>{body}</arena_tracking_system>")
    return path


@dataclass(frozen=True)
class Step:
    """A timestep of the tracker; `done_ns` is when its state was there."""

    done_ns: int
    capture_ns: int
    captures_ns: dict[str, int]
    seen: frozenset[int]
    bounds_ns: dict[str, int]


class Watched:
    """The tracker on a thread, and all that it says and sees.

    Attributes:
        steps: Its timesteps.
        said: Its lines, and when they were said.
    """

    def __init__(self, central: Path) -> None:
        self.steps: list[Step] = []
        self.said: list[tuple[int, str]] = []
        session = tracking_session.load_whole(central)
        say = lambda text: self.said.append((host_ns(), text))  # noqa: E731
        self.tracking: CameraTracking = open_tracking(session, host_ns, say)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                state, frames = self.tracking.next(0.2)
            except GrabberError:
                frames = ()
            if frames:
                captures_ns = {frame.camera: frame.capture_ns for frame in frames}
                seen = frozenset(state.robots["tag"][state.robots["seen"]].tolist())
                done_ns, nodes = host_ns(), self.tracking.nodes
                links = {} if nodes is None else nodes.links
                known = {n: link.clock.estimate(done_ns) for n, link in links.items()}
                bounds_ns = {n: e[1] for n, e in known.items() if e is not None}
                step = Step(done_ns, state.capture_ns, captures_ns, seen, bounds_ns)
                self.steps.append(step)
            self.tracking.check_cameras()

    def wait(self, wanted: Callable[[], bool], what: str) -> int:
        """Waits for something; returns when it was."""
        until_s = time.monotonic() + PATIENCE_S
        while not wanted():
            assert time.monotonic() < until_s, (what, self.said[-9:], self.steps[-3:])
            time.sleep(0.005)
        return host_ns()

    def wait_whole(self, cameras: int, steps: int = 5) -> int:
        """Waits for timesteps in a row with pictures of all cameras."""

        def whole() -> bool:
            last = self.steps[-steps:]
            return len(last) == steps and all(len(s.captures_ns) == cameras for s in last)

        return self.wait(whole, f"{cameras} cameras")

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.tracking.close()


class RunningNode(Program):
    """`vsense camera node`, or what stands in for it."""

    def __init__(
        self,
        name: str,
        resources: Path,
        where: str,
        *words: str,
        inside: Sequence[str] = (),
        program: Sequence[str] = ("-m", "vsense", "camera", "node"),
    ) -> None:
        """Starts it; `inside` begins its command line, for another network."""
        options = (str(resources), "--connect", where, "--name", name, *words)
        super().__init__([*inside, sys.executable, *program, *options])
        self.name = name

    def stop(self) -> int:
        """Ends it as Ctrl-C does, if it has not ended; its exit code."""
        if self.process.poll() is None:
            self.process.terminate()
        return self.end()


def all_of(state: ArenaState) -> tuple[object, ...]:
    """Every bit of a state."""
    names = ("timestep", "capture_ns", "detected", "unnamed", "duplicates", "joined", "cameras")
    arrays = (state.robots, state.sightings, state.images)
    return (*(getattr(state, name) for name in names), *(array.tobytes() for array in arrays))


def tracked(resources: Path, experiment: Path | None, told: list[str]) -> list[tuple[object, ...]]:
    """Tracks a recording to its end: every bit of each state, and of what was found for it."""
    if experiment is None:
        session = tracking_session.load_whole(resources)
    else:
        session = tracking_session.load(resources, experiment)
    tracking = open_tracking(session, host_ns, told.append)
    try:
        return list(_states(tracking))
    finally:
        tracking.check_cameras()
        tracking.close()


def _states(tracking: CameraTracking) -> list[tuple[object, ...]]:
    states = []
    while True:
        try:
            state, _ = tracking.next(30.0)
        except NoMorePictures:
            return states
        markers = sorted(tracking.tracker.markers.items())
        found = [(camera, np.asarray(rows).tobytes()) for camera, rows in markers]
        states.append((*all_of(state), found, tracking.tracker.overflowed))
