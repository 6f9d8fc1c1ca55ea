"""Cameras of several computers: their files, and the programs that look at their pictures."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from tests.rigs.processes import Program
from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns
from vsense.base.errors import NoMorePictures
from vsense.config import tracking_session
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


def tracked(resources: Path, experiment: Path, told: list[str]) -> list[tuple[object, ...]]:
    """Tracks a recording to its end: every bit of each state, and of what was found for it."""
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
