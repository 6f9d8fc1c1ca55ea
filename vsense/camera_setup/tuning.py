"""`vsense cameras tune`: watches what exposure and gain make of a camera's pictures."""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack

from vsense.camera_setup import panel, sweep
from vsense.camera_setup.advice import ExposureReading, brightness, noise
from vsense.camera_setup.markers import MarkerFinder, PictureScale, known_scale
from vsense.camera_setup.opening import OpenCamera, choose, make, wanted_of
from vsense.camera_setup.panel import PanelView
from vsense.camera_setup.showing import WARM_UP
from vsense.cameras.camera import Camera as Calibration
from vsense.cameras.controls import EXPOSURE, GAIN
from vsense.cameras.grabber import GrabberError
from vsense.cameras.picture import Image
from vsense.config import resources as resources_file
from vsense.errors import UsageError
from vsense.markers.families import load_family
from vsense.terminal import INTERRUPTED, LiveBlock, interruption

PERIOD_NS = 500_000_000
"""A block is drawn so often."""
RETRY_S = 1.0


class Tuner:
    """Measures what a camera gives."""

    def __init__(
        self, camera: OpenCamera, options: argparse.Namespace, calibration: Calibration | None
    ) -> None:
        """Prepares to measure.

        Args:
            camera: an open camera.
            options: `family`, `speed`, `exposure`, `gain`, `px_per_m`, `height_m`, `focal_px`.
            calibration: the camera's, where there is one.

        Raises:
            FamilyError: there is no such marker family.
        """
        self.camera = camera
        self.family = load_family(options.family)
        self._speed_m_s: float = options.speed
        self._wanted: dict[str, float | None] = {EXPOSURE: options.exposure, GAIN: options.gain}
        self._scale = known_scale(options, calibration)
        self._finder = MarkerFinder(self.family, calibration, options.marker_height)

    @property
    def cell_m(self) -> float:
        """Side of a marker's cell."""
        return 1e-3 * float(self.family.cell_mm)

    @property
    def speed_m_s(self) -> float:
        """Speed of the robots."""
        return self._speed_m_s

    def view(self, first: Image, second: Image, rate_hz: float | None) -> PanelView:
        """Measures two pictures in a row; `rate_hz` is how fast they come."""
        found = self._finder.look(second)
        scale = self._scale
        if scale is None and self._finder.px_per_m is not None:
            scale = PictureScale(self._finder.px_per_m, "size of the markers")
        reading = ExposureReading(
            self._value(EXPOSURE),
            self._value(GAIN),
            brightness(second),
            noise(first, second),
            self._speed_m_s,
            scale,
            self.cell_m,
        )
        height, width = second.shape
        return PanelView(self.camera.id, (width, height), rate_hz, reading, self.family.name, found)

    def _value(self, name: str) -> float | None:
        """Gives what a camera says of itself, and else what it was asked for."""
        controls = self.camera.controls
        value = None if controls is None else controls.value(name)
        return self._wanted[name] if value is None else value


def run(options: argparse.Namespace) -> int:
    """Shows what a camera gives, until it is interrupted; once where nobody watches.

    Raises:
        UsageError: there is no such camera, or options contradict each other.
        VsenseError: it does not open, or there is no such marker family.
    """
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        calibration = calibration_of(options)
        camera = make(choose(options.id, wanted_of(options), options.resources))
        tuner = Tuner(camera, options, calibration)
        stack.callback(camera.source.close)
        for text in camera.open():
            print(f"vsense: {options.id}: {text}", file=sys.stderr)
        code = 0
        if options.sweep:
            code = 0 if sweep.run(tuner, interrupted, options.json) else 1
        else:
            _watch(tuner, interrupted, options.json)
        return INTERRUPTED if interrupted.is_set() else code


def calibration_of(options: argparse.Namespace) -> Calibration | None:
    """Gives the calibrated camera that --camera names.

    Raises:
        UsageError: there is none of that name.
        ConfigError: its file is wrong.
    """
    if options.camera is None:
        return None
    if options.resources is None:
        raise UsageError("--camera: expected --resources, the file that names the cameras")
    resources = resources_file.load(options.resources)
    if options.camera not in resources.cameras:
        known = ", ".join(resources.cameras) or "none"
        raise UsageError(f"no camera {options.camera!r} in {options.resources}: there are {known}")
    return resources_file.load_camera(resources, resources.cameras[options.camera])


def _watch(tuner: Tuner, interrupted: threading.Event, as_json: bool) -> None:
    """Draws a block again and again on a terminal, else one."""
    camera = tuner.camera
    if as_json or not sys.stdout.isatty():
        for _ in range(WARM_UP):
            camera.picture()
        view = tuner.view(camera.picture().image, camera.picture().image, None)
        if as_json:
            print(json.dumps(panel.facts(view), indent=2))
        else:
            print("\n".join(panel.lines(view, LiveBlock(sys.stdout).has_blocks)))
        return
    TuningBlock(tuner, interrupted, LiveBlock(sys.stdout)).live()


class TuningBlock:
    """A block on a terminal, drawn again and again."""

    def __init__(
        self,
        tuner: Tuner,
        interrupted: threading.Event,
        block: LiveBlock,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Prepares to draw."""
        self._tuner = tuner
        self._interrupted = interrupted
        self._block = block
        self._clock = clock

    def live(self) -> None:
        """Draws until it is interrupted; a camera that has gone is waited for."""
        last: list[str] = []
        while not self._interrupted.is_set():
            try:
                last = self._draw_next()
            except GrabberError as error:
                self._block.draw([*last, "", f"gone, trying again every {RETRY_S:g} s: {error}"])
                self._reopen()

    def _draw_next(self) -> list[str]:
        """Takes pictures for one period, and draws what they are like."""
        begun_ns, times_ns = self._clock(), list[int]()
        before, now = None, self._taken(times_ns)
        while before is None or self._clock() - begun_ns < PERIOD_NS:
            if self._interrupted.is_set():
                return []
            before, now = now, self._taken(times_ns)
        rate_hz = 1e9 * (len(times_ns) - 1) / max(times_ns[-1] - times_ns[0], 1)
        view = self._tuner.view(before, now, rate_hz)
        lines = panel.lines(view, self._block.has_blocks)
        self._block.draw([*lines, "", "Ctrl-C ends"])
        return lines

    def _taken(self, times_ns: list[int]) -> Image:
        """Takes a picture, and notes when it came."""
        shot = self._tuner.camera.picture()
        times_ns.append(self._clock() if shot.arrived_ns is None else shot.arrived_ns)
        return shot.image

    def _reopen(self) -> None:
        while not self._interrupted.wait(RETRY_S):
            try:
                self._tuner.camera.source.open()
                return
            except GrabberError:
                continue
