"""`vsense camera tune`: shows the effect of exposure and gain on a camera's pictures."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from vsense.base.arena import Image
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, LiveBlock, print_data
from vsense.config import resources as resources_file
from vsense.tools.camera_setup import _panel
from vsense.tools.camera_setup import _sweep as sweep
from vsense.tools.camera_setup._advice import PictureScale
from vsense.tools.camera_setup._panel import Tuner
from vsense.tools.camera_setup.files import choose
from vsense.tools.camera_setup.showing import WARM_UP
from vsense.vision.cameras.camera import Camera as Calibration
from vsense.vision.cameras.source import Controls
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.marker_finder import MarkerFinder
from vsense.vision.tracking.single_camera import OpenCamera, make

SPEED_M_S = 0.13
"""An e-puck's greatest speed. Source: reference/epuck.md."""


DRAW_PERIOD_NS = 500_000_000
"""Time between two drawings."""
RETRY_S = 1.0


@dataclass(frozen=True, slots=True)
class TuneOptions:
    """Which camera is tuned, and what the user knows of it; see `vsense camera tune -h`.

    `id`, `wanted` and `resources` are as in `choose`; `speed` [m/s] is the robots'; `height_m` is
    from the lens down to the markers, `marker_height` [m] from the floor up to them, for `camera`.
    `sweep`: exposures and gains are tried.
    """

    id: str
    wanted: Controls
    resources: str | None
    family: str
    speed: float
    px_per_m: float | None
    focal_px: float | None
    height_m: float | None
    camera: str | None
    marker_height: float
    sweep: bool = False
    json: bool = False


def known_scale(options: TuneOptions, calibration: Calibration | None) -> PictureScale | None:
    """Returns the scale of the options, if any; raises UsageError for half a pair."""
    if options.px_per_m is not None:
        return PictureScale(options.px_per_m, "--px-per-m")
    focal_px, away_m = options.focal_px, options.height_m
    if focal_px is not None and away_m is not None:
        # The camera is taken to look straight down.
        text = f"focal length {focal_px:g} px at {away_m:g} m"
        return PictureScale(focal_px / away_m, text)
    if focal_px is not None or away_m is not None:
        raise UsageError("expected --focal-px together with --height-m")
    if calibration is None:
        return None
    px_per_m = calibration.px_per_m(options.marker_height)
    return PictureScale(px_per_m, f"calibration of {calibration.id}")


def tuner_of(camera: OpenCamera, options: TuneOptions, calibration: Calibration | None) -> Tuner:
    """Takes an open camera, and its calibration where there is one; raises FamilyError."""
    family, scale = load_family(options.family), known_scale(options, calibration)
    finder = MarkerFinder(family, calibration, options.marker_height)
    return Tuner(camera, family, finder, options.speed, options.wanted, scale)


def run(options: TuneOptions) -> int:
    """Opens a camera and shows its measurements, or sweeps its exposures and gains.

    Returns:
        0, 1 where the camera is not as it was before, or 130 after Ctrl-C.

    Raises:
        UsageError: There is no such camera, or options contradict each other.
        VsenseError: It does not open, or there is no such marker family.
    """
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        calibration = calibration_of(options)
        camera = make(choose(options.id, options.wanted, options.resources), host_ns)
        tuner = tuner_of(camera, options, calibration)
        stack.callback(camera.source.close)
        for text in camera.open():
            Console().say(f"vsense: {options.id}: {text}")
        measure = sweep.run if options.sweep else watch
        is_back = measure(tuner, interrupted, options.json)
        if interrupted.is_set():
            return interrupted.code
        return 0 if is_back else 1


def calibration_of(options: TuneOptions) -> Calibration | None:
    """Returns the calibrated camera that --camera names; raises UsageError or ConfigError."""
    if options.camera is None:
        return None
    if options.resources is None:
        raise UsageError("--camera: expected --resources, the file that names the cameras")
    resources = resources_file.load(options.resources)
    if options.camera not in resources.cameras:
        ids = ", ".join(resources.cameras) or "none"
        raise UsageError(f"no camera {options.camera!r} in {options.resources}: there are {ids}")
    return resources_file.load_camera(resources, resources.cameras[options.camera])


def watch(tuner: Tuner, interrupted: threading.Event, as_json: bool) -> bool:
    """Draws a block repeatedly on a terminal, else once; changes nothing and returns True."""
    camera = tuner.camera
    if as_json or not sys.stdout.isatty():
        for _ in range(WARM_UP):
            camera.picture()
        view = tuner.view(camera.picture().image, camera.picture().image, None)
        if as_json:
            print_data(json.dumps(_panel.facts(view), indent=2))
        else:
            print_data("\n".join(_panel.lines(view, LiveBlock(sys.stdout).has_blocks)))
    else:
        TuningBlock(tuner, interrupted, LiveBlock(sys.stdout)).run()
    return True


class TuningBlock:
    """A block on a terminal that is drawn repeatedly."""

    def __init__(
        self,
        tuner: Tuner,
        interrupted: threading.Event,
        block: LiveBlock,
        clock: Callable[[], int] = host_ns,
    ) -> None:
        self._tuner = tuner
        self._interrupted = interrupted
        self._block = block
        self._clock = clock

    def run(self) -> None:
        """Draws until it is interrupted; waits for a camera that has gone."""
        last: list[str] = []
        while not self._interrupted.is_set():
            try:
                last = self._draw_next()
            except GrabberError as error:
                self._block.draw([*last, "", f"gone, trying again every {RETRY_S:g} s: {error}"])
                self._reopen()

    def _draw_next(self) -> list[str]:
        """Takes pictures for one period, and draws their measurements."""
        begun_ns, times_ns = self._clock(), list[int]()
        before, now = None, self._taken(times_ns)
        while before is None or self._clock() - begun_ns < DRAW_PERIOD_NS:
            if self._interrupted.is_set():
                return []
            before, now = now, self._taken(times_ns)
        rate_hz = 1e9 * (len(times_ns) - 1) / max(times_ns[-1] - times_ns[0], 1)
        view = self._tuner.view(before, now, rate_hz)
        lines = _panel.lines(view, self._block.has_blocks)
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
