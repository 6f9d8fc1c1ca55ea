"""Real GigE Vision cameras on a network: a namespace each, all on one bridge, as on a switch."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.conftest import require_library, require_tool
from tests.gige.gvcp import Reader
from tests.rigs.namespaces import FreeNet, Namespaces
from tests.rigs.places import ROOT
from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.monitor.recording.pictures import experiment_text, one_tracker, resources_text
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family

INTERFACE = "eth0"
FAMILY = "arrow4x4"
SIZE_PX = (640, 480)
SIZE = {"width": SIZE_PX[0], "height": SIZE_PX[1]}
"""As attributes of a grabber."""
MIDDLE_PX = (320, 240)
MIDDLE = {"width": 320, "height": 240, "offset_x": 160, "offset_y": 120}
"""The middle of the pictures: two of them fit into what a socket usually holds, 212,992 bytes."""
PLACES_M = ((-0.4, -0.3), (0.4, -0.3), (-0.4, 0.3), (0.4, 0.3))
CAMERAS, MIDDLES = (
    [Camera.looking_down(f"cam{n}", x, y, 2.4, 1100.0, px) for n, (x, y) in enumerate(PLACES_M)]
    for px in (SIZE_PX, MIDDLE_PX)
)
"""Their calibrations, for whole pictures and for the middles."""
RATE_HZ = 10
FIRST = 10
"""The last number of the first camera's address."""
PHASES_MS = (0, 13, 29, 41)
"""Cameras that run freely expose when they like."""


class GigeCameras:
    """Four cameras that look down on robots which never move, or the plain simulators.

    Attributes:
        cameras: their calibrations, the n-th of camera n.
        net: their network.
    """

    def __init__(self, folder: Path, robots: Sequence[Robot], jumbo: bool = False) -> None:
        """Builds the network and draws the pictures; starts no camera.

        Args:
            folder: for the pictures.
            robots: what the cameras see.
            jumbo: the network carries packets of 9000 bytes.
        """
        require_library("libaravis-0.8.so.0", "libaravis-0.8-0")
        self.cameras = CAMERAS
        self._robots = robots
        self._family = load_family(FAMILY)
        self._folder = folder
        self._running: dict[int, subprocess.Popen[str]] = {}
        self._free = FreeNet("10.214")
        numbers = {n: FIRST + n for n in range(len(CAMERAS))}
        self.net = Namespaces("vsg", self._free.net, INTERFACE, numbers)
        if jumbo:
            self.net.set_mtu(9000)
        for n, camera in enumerate(CAMERAS):
            np.save(self._picture(n), render(camera, self._family, list(robots), Look(), seed=n))

    def start(self, *numbers: int, words: Sequence[str] = ()) -> None:
        """Starts cameras that show their pictures, all four by default.

        Args:
            numbers: which; those that run are ended first.
            words: for `scene_camera`.
        """
        numbers = numbers or tuple(range(len(CAMERAS)))
        for number in numbers:
            self.kill(number)
            self._running[number] = self._scene_camera(number, words)
        for number in numbers:
            stdout = self._running[number].stdout
            assert stdout is not None
            assert stdout.readline() == "ready\n", f"camera {number} has not started"

    def start_plain(self, *numbers: int) -> None:
        """Starts Debian's simulators as they are, all four by default."""
        program = require_tool("arv-fake-gv-camera-0.8", "aravis-tools")
        numbers = numbers or tuple(range(len(CAMERAS)))
        for number in numbers:
            self.kill(number)
            words = [program, "-i", INTERFACE, "-s", self.serial(number)]
            self._running[number] = subprocess.Popen([*self.net.command(number), *words], text=True)
        for number in numbers:
            self.registers(number)

    def tell(self, number: int, line: str) -> None:
        """Has a camera obey a line."""
        process = self._running[number]
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(f"{line}\n")
        process.stdin.flush()
        assert process.stdout.readline() == "ok\n", f"camera {number} does not {line}"

    def registers(self, number: int) -> dict[str, int]:
        """What programs have set in a camera."""
        reader = Reader(self.address(number))
        try:
            return reader.all()
        finally:
            reader.close()

    def kill(self, number: int) -> None:
        """Ends a camera as a power cut does."""
        process = self._running.pop(number, None)
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    stream.close()

    def address(self, number: int) -> str:
        """A camera's IPv4 address."""
        return self.net.address(number)

    def serial(self, number: int) -> str:
        """A camera's serial number, which no camera of another test at work has."""
        return f"S{os.getpid()}-{number}"

    def same_address(self, first: int, second: int) -> None:
        """Starts the second camera again, with the first one's address."""
        self.kill(second)
        self.net.renumber(second, FIRST + first)
        self.start(second)

    def own_address(self, number: int) -> None:
        """Starts a camera again, with the address that is its own."""
        self.kill(number)
        self.net.renumber(number, FIRST + number)
        self.net.forget()
        self.start(number)

    def files(
        self,
        folder: Path,
        settings: Mapping[str, Any],
        features: Mapping[str, str] | None = None,
        cameras: Sequence[Camera] = CAMERAS,
    ) -> tuple[str, str]:
        """Writes the two files of a tracking session with all four.

        Args:
            folder: where to.
            settings: attributes of every <grabber>.
            features: of every grabber: names and values.
            cameras: their calibrations, for pictures as the settings have them.
        """
        heights_m = dict.fromkeys((robot.tag for robot in self._robots), HEIGHT_M)
        trackers = one_tracker(cameras, FAMILY, heights_m)
        text = resources_text(cameras, trackers)
        inside = "".join(
            f'\n      <feature name="{name}" value="{value}" />'
            for name, value in (features or {}).items()
        )
        (folder / "cameras").mkdir(exist_ok=True)
        for number, camera in enumerate(cameras):
            (folder / "cameras" / f"{camera.id}.json").write_text(camera.to_json())
            pictures = f'type="directory" path="pictures/{camera.id}"'
            times = f'\n             timestamps="pictures/{camera.id}/timestamps.csv" />'
            assert pictures + times in text
            mine = {"device": self.net.number(FIRST + number), "frame_rate": RATE_HZ, **settings}
            words = " ".join(f'{name}="{value}"' for name, value in mine.items())
            grabber = f'type="genicam" {words}>{inside}\n    </grabber>'
            text = text.replace(pictures + times, grabber)
        (folder / "resources.xml").write_text(text)
        (folder / "experiment.xml").write_text(experiment_text(cameras, trackers))
        return str(folder / "resources.xml"), str(folder / "experiment.xml")

    def close(self) -> None:
        """Ends the cameras and their network."""
        for number in list(self._running):
            self.kill(number)
        self.net.close()
        self._free.close()

    def _scene_camera(self, number: int, words: Sequence[str]) -> subprocess.Popen[str]:
        python = [sys.executable, "-m", "tests.gige.scene_camera", INTERFACE]
        what = [str(self._picture(number)), "--serial", self.serial(number)]
        when = ["--phase-ms", str(PHASES_MS[number])]
        return subprocess.Popen(
            [*self.net.command(number), *python, *what, *when, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )

    def _picture(self, number: int) -> Path:
        return self._folder / f"cam{number}.npy"
