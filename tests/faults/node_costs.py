"""What cameras on several computers cost: `scripts/bench nodes --costs`.

Pictures are played by real nodes on this machine, beside the same pictures played in the tracker's
own process. What is larger than two cores carry is played by nodes without pictures, which say rows
that were made beforehand.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from tests.rigs.nodes import RunningNode, central_file
from tests.rigs.places import ROOT
from tests.rigs.playing_node import LoopPlayer
from tests.rigs.processes import free_port
from vsense.base.arena import DETECTION, UNLISTED, Found
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError
from vsense.config import tracking_session
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family, ranked_tags
from vsense.vision.tracking import opening
from vsense.vision.tracking._node_rows import SeenPicture, SeenRows, decode_expectation, encode_rows
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.node_session import NodeNetwork, node_key, open_network, reply
from vsense.vision.tracking.opening import open_tracking
from vsense.vision.tracking.recorded_tracker import seen_by

PERIOD_NS = 100_000_000
PROGRAM = ("-m", "tests.rigs.playing_node")
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
SETTLE, TIMESTEPS = 20, 100


def drawn(folder: Path, copies: int) -> Path:
    """Four ceiling cameras of two megapixels above 20 robots, so many times each."""
    experiment = folder / "twenty.argos"
    tags = " ".join(map(str, ranked_tags(load_family("arrow4x4"), 20)))
    text = (ROOT / "vsense/config/experiments/pollutant.argos").read_text()
    robots = f'quantity="20" max_trials="1000" vs:tags="{tags}"'
    experiment.write_text(
        re.sub(r'quantity="15"\s+max_trials="1000"\s+vs:tags="[^"]*"', robots, text)
    )
    words = [sys.executable, "-m", "vsense", "camera", "render"]
    words += [str(experiment), str(folder / "rec")]
    subprocess.run([*words, "--frames", "12", "--format", "pgm"], check=True, capture_output=True)
    tree = ElementTree.parse(folder / "rec" / "resources.xml")
    root = tree.getroot()
    grabbers, cameras = root.find("grabbers"), root.find("cameras")
    assert grabbers is not None and cameras is not None
    files = {str(c.get("id")): folder / "rec" / str(c.get("calibration")) for c in cameras}
    grabbers.clear()
    cameras.clear()
    for copy in range(copies):
        for id, file in files.items():
            name, pictures = f"{id}_{copy}", folder / "rec" / "pictures" / id
            words = {"id": name, "type": "camera", "device": str(pictures)}
            ElementTree.SubElement(grabbers, "grabber", words)
            ElementTree.SubElement(cameras, "camera", {"id": name, "calibration": str(file)})
    path = folder / "resources.xml"
    tree.write(path)
    return path


def measured(tracking: CameraTracking) -> dict[str, float]:
    """Lets it track; how long after their pictures states are there, and what that takes [ms]."""
    late, whole, cameras = [], 0, len(tracking.tracker.cameras)
    for step in range(SETTLE + TIMESTEPS):
        if step == SETTLE:
            begun_s, wall_s = time.process_time(), time.monotonic()
            before = counts(tracking)
        try:
            state, frames = tracking.next(1.0)
        except GrabberError:
            continue
        if step >= SETTLE:
            late.append(1e-6 * (host_ns() - state.capture_ns))
            whole += len(frames) == cameras
        tracking.check_cameras()
    took_s, wall_s = time.process_time() - begun_s, time.monotonic() - wall_s
    after = counts(tracking)
    return {
        "p50_ms": float(np.median(late)),
        "p90_ms": float(np.percentile(late, 90)),
        "whole": whole / TIMESTEPS,
        "tracker_ms": 1e3 * took_s / TIMESTEPS,
        "robots": len(state.robots),
        **{name: (after[name] - before[name]) / wall_s for name in after},
    }


def counts(tracking: CameraTracking) -> dict[str, int]:
    """Messages and bytes of all nodes."""
    links = [] if tracking.nodes is None else list(tracking.nodes.links.values())
    names = ("messages", "bytes from it", "bytes to it")
    return {name: sum(link.counts[name] for link in links) for name in names if links}


def processor_s(pid: int) -> float:
    """Processor time of a process until now."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return TICK_S * (int(fields[11]) + int(fields[12]))


def here(resources: Path) -> dict[str, float]:
    """All cameras in the tracker's own process."""

    def play(_: Any, grabbers: Any, *__: Any) -> LoopPlayer:
        folders = {camera: Path(spec.source) for camera, spec in grabbers.items()}
        return LoopPlayer(folders, PERIOD_NS, True)

    real, opening.live_grabber = opening.live_grabber, play  # type: ignore[assignment]
    try:
        tracking = open_tracking(tracking_session.load_whole(resources), host_ns, print)
    finally:
        opening.live_grabber = real
    try:
        return measured(tracking)
    finally:
        tracking.close()


def on_nodes(resources: Path, names: Sequence[str]) -> dict[str, float]:
    """The same cameras on so many nodes."""
    where = f"tcp/127.0.0.1:{free_port()}"
    central = central_file(resources, where, names, "node")
    words = ("--keep", "--period", str(1e-9 * PERIOD_NS))
    with ExitStack() as stack:
        nodes = []
        for name in names:
            nodes.append(RunningNode(name, resources, where, *words, program=PROGRAM))
            stack.callback(nodes[-1].stop)
        tracking = open_tracking(tracking_session.load_whole(central), host_ns, lambda text: None)
        stack.callback(tracking.close)
        cameras = len(tracking.tracker.cameras)
        while len(tracking.tracker.markers) < cameras:
            try:
                tracking.next(1.0)
            except GrabberError:
                continue
        begun_s, wall_s = [processor_s(n.process.pid) for n in nodes], time.monotonic()
        report = measured(tracking)
        took_s = sum(processor_s(n.process.pid) for n in nodes) - sum(begun_s)
        pictures = cameras * (time.monotonic() - wall_s) / (1e-9 * PERIOD_NS)
        return {**report, "node_ms_per_picture": 1e3 * took_s / pictures}


class GhostNodes:
    """Nodes without pictures: they say the same rows every period, dated by now."""

    def __init__(self, where: str, names: Sequence[str], robots: np.ndarray) -> None:
        """Takes (n, 3) robots: tag, x and y [m]."""
        self._zenoh = open_network(NodeNetwork(connect=(where,)))
        self._robots, self._served = robots, dict[str, tuple[int, list[Found]]]()
        self._heard: dict[str, tuple[int, int]] = {}
        self._ended = threading.Event()
        self._declared = []
        for name in names:
            key = node_key("arena", name, "open")
            self._declared.append(self._zenoh.declare_queryable(key, self._open(name)))
            key = node_key("arena", name, "expect")
            self._declared.append(self._zenoh.declare_subscriber(key, self._expect(name)))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _open(self, name: str) -> Callable[[Any], None]:
        def answer(query: Any) -> None:
            setup = json.loads(query.payload.to_bytes())
            cameras, _, _ = seen_by(setup["tracking"])
            self._served[name] = setup["session"], [self._found(camera) for camera in cameras]
            reply(query, b"{}")

        return answer

    def _expect(self, name: str) -> Callable[[Any], None]:
        def take(sample: Any) -> None:
            expectation = decode_expectation(sample.payload.to_bytes())
            self._heard[name] = expectation.sent_ns, host_ns()

        return take

    def _found(self, camera: Camera) -> Found:
        height = np.full(len(self._robots), 0.06)
        px = camera.project(np.column_stack((self._robots[:, 1:], height)))
        seen = ((px > 0) & (px < (camera.width_px - 1, camera.height_px - 1))).all(axis=1)
        rows = np.zeros(int(seen.sum()), dtype=DETECTION)
        rows["tag"], rows["x_px"], rows["y_px"] = self._robots[seen, 0], *px[seen].T
        rows["covariance"], rows["margin"] = np.diag((1e-8, 1e-8, 1e-6)), 9.0
        rows["read"] = rows["legible"] = True
        return Found(rows, False, np.zeros(0, dtype=UNLISTED))

    def _run(self) -> None:
        turn = host_ns() // PERIOD_NS
        while not self._ended.is_set():
            turn += 1
            self._ended.wait(max(1e-9 * (turn * PERIOD_NS - host_ns()), 0.0))
            for name, (session, founds) in list(self._served.items()):
                now_ns, due_ns = host_ns(), turn * PERIOD_NS
                echo_ns, came_ns = self._heard.get(name, (0, now_ns))
                pictures = [SeenPicture(n, due_ns, f) for n, f in enumerate(founds)]
                seen = SeenRows(session, turn, now_ns, echo_ns, now_ns - came_ns, pictures)
                self._zenoh.put(node_key("arena", name, "rows"), encode_rows(seen), express=True)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._zenoh.close()


PER_NODE = 4


def ghosts(folder: Path, side: int, robots: int) -> dict[str, float]:
    """So many times so many cameras in a square, four to a node, above a grid of robots."""
    folder.mkdir(exist_ok=True)
    apart_x, apart_y = 1.1, 0.8
    places = [(apart_x * column, apart_y * row) for row in range(side) for column in range(side)]
    cameras = [
        Camera.looking_down(f"cam_{n}", x, y, 2.4, 2950.0, (1620, 1220))
        for n, (x, y) in enumerate(places)
    ]
    across = int(np.ceil(np.sqrt(robots)))
    grid = [(n % across, n // across) for n in range(robots)]
    width_m, height_m = apart_x * (side - 1) + 0.8, apart_y * (side - 1) + 0.6
    rows = [
        (tag, width_m * (x + 0.5) / across - 0.4, height_m * (y + 0.5) / across - 0.3)
        for tag, (x, y) in enumerate(grid, 100)
    ]
    for camera in cameras:
        (folder / f"{camera.id}.json").write_text(camera.to_json())
    grabbers = "".join(f'<grabber id="{c.id}" type="camera" device="-" />' for c in cameras)
    described = "".join(f'<camera id="{c.id}" calibration="{c.id}.json" />' for c in cameras)
    tracker = f'<tracker id="t" family="arrow4x4" tags="100-{99 + robots}" />'
    (folder / "resources.xml").write_text(
        f"<arena_tracking_system><grabbers>{grabbers}</grabbers><trackers>{tracker}</trackers>"
        f"<cameras>{described}</cameras></arena_tracking_system>"
    )
    names = [f"ghost_{n}" for n in range(-(-len(cameras) // PER_NODE))]
    where = f"tcp/127.0.0.1:{free_port()}"
    central = central_file(folder / "resources.xml", where, names, "node")
    (folder / "ghosts.json").write_text(json.dumps([where, names, rows]))
    words = [sys.executable, "-m", "tests.faults.node_costs", str(folder / "ghosts.json")]
    with ExitStack() as stack:
        process = subprocess.Popen(words)
        stack.callback(process.wait)
        stack.callback(process.terminate)
        tracking = open_tracking(tracking_session.load_whole(central), host_ns, lambda text: None)
        stack.callback(tracking.close)
        until_s = time.monotonic() + 30.0
        while len(tracking.tracker.markers) < len(cameras) and time.monotonic() < until_s:
            try:
                tracking.next(1.0)
            except GrabberError:
                continue
        return {**measured(tracking), "cameras": len(cameras), "nodes": len(names)}


def run(folder: Path) -> dict[str, Any]:
    """Measures all of it."""
    four, sixteen = folder / "four", folder / "sixteen"
    four.mkdir()
    sixteen.mkdir()
    resources = drawn(four, 1)
    report: dict[str, Any] = {
        "4 cameras here": here(resources),
        "4 cameras on 1 node": on_nodes(resources, ("west",)),
        "4 cameras on 4 nodes": on_nodes(resources, ("west", "east", "north", "south")),
    }
    report["16 cameras on 4 nodes"] = on_nodes(
        drawn(sixteen, 4), ("west", "east", "north", "south")
    )
    shutil.rmtree(four)
    shutil.rmtree(sixteen)
    for side, robots in ((2, 20), (4, 100), (7, 500), (10, 1000)):
        name = f"{side * side} cameras without pictures, {robots} robots"
        report[name] = ghosts(folder / str(side), side, robots)
    return report


if __name__ == "__main__":
    where_to, all_names, all_robots = json.loads(Path(sys.argv[1]).read_text())
    running = GhostNodes(where_to, all_names, np.array(all_robots, dtype=np.float64))
    threading.Event().wait()
