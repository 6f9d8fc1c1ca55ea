"""The grabber of the lab: starts the camera process and hands out its pictures."""

from __future__ import annotations

import json
import os
import select
import time
from collections import deque
from contextlib import suppress

from vsense.base.arena import Frame
from vsense.base.clock import host_ns, real_s
from vsense.base.errors import GrabberError
from vsense.base.processes import describe_exit, end, start_module
from vsense.base.shared import FrameBank
from vsense.modes.lab._bodies import Body
from vsense.modes.lab._camera_spec import Exposure, LabCameraSpec
from vsense.modes.lab._optics import EXPOSURE_NS
from vsense.modes.lab.truth import TruthReader
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import CameraEvent

SCENE_TIMEOUT_S = 20.0
"""The scene of four cameras must be built within this time, that of more in so much more."""

_LEAD_NS = 50_000_000
_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(1 << 24), "MALLOC_TRIM_THRESHOLD_": str(1 << 27)}
"""The C library keeps what large arrays have left. By its own rules it gives each back at once, and
a third of the scene's time goes into pages that are cleared anew; the process grows no larger."""


class LabGrabber:
    """Rendered cameras behind the seam of `vsense.vision.cameras.grabber.Grabber`.

    Attributes:
        cameras: in the order of the pictures.
        exposure: that of the timestep that `next` gave last, or None.
        timesteps: None: their number is not known.
        missed: timesteps that `next` left out because a newer one was there already.
    """

    timesteps: int | None = None

    def __init__(self, spec: LabCameraSpec) -> None:
        """Starts the camera process; raises LabError where there is no memory for the pictures."""
        self.cameras: list[Camera] = list(spec.cameras)
        self.exposure: Exposure | None = None
        self.missed = 0
        self._truth = spec.truth
        self._started = False
        self._lines: deque[bytes] = deque()
        self._rest = b""
        self._bank = FrameBank.make(spec.shape)
        self._process, self._stdin, self._stdout = start_module(
            "vsense.modes.lab._cameras", env={**os.environ, **_MEMORY}
        )
        self._send(f'{{"bank": {json.dumps(self._bank.name)}, "spec": {spec.to_json()}}}')

    @property
    def pid(self) -> int:
        """The camera process."""
        return self._process.pid

    def start(self, epoch_ns: int | None = None) -> None:
        """Waits for the scene and sets the time of timestep 0.

        Args:
            epoch_ns: middle of the first exposure on the monotonic clock. Without it that is
                soon, half an exposure after a tick of the physics: exposures of 10 ms then end
                with a tick, and the pictures need not wait for the next.

        Raises:
            GrabberError: the process ended, or the scene was not built in `SCENE_TIMEOUT_S`.
        """
        self._line(SCENE_TIMEOUT_S * max(1.0, len(self.cameras) / 4.0))
        if epoch_ns is None:
            truth = TruthReader(self._truth)
            epoch_ns = (truth.newest_ns() or host_ns()) + _LEAD_NS + EXPOSURE_NS // 2
            truth.close()
        self._send(json.dumps({"epoch_ns": epoch_ns}))
        self._started = True

    def dress(self, row: int, body: Body) -> None:
        """Has the body of a row of the truth ring look otherwise from now on.

        Raises:
            GrabberError: the process has ended.
        """
        self._send(json.dumps({"row": row, "body": body.message()}))

    def next(self, timeout_s: float) -> list[Frame]:
        """Waits for the newest timestep's pictures, in the order of the cameras.

        The first call starts the cameras unless `start` has. The pictures are the shared memory
        itself; see `Grabber.next`.

        Raises:
            GrabberError: no picture came in `timeout_s`, or there will be no more.
        """
        if not self._started:
            self.start()
        exposure = self._newest(timeout_s)
        while (images := self._bank.lend(exposure.slot, exposure.timestep)) is None:
            # It has been drawn over: a newer one comes.
            self.missed += 1
            exposure = self._newest(timeout_s)
        self.exposure = exposure
        return [
            Frame(camera.id, image, exposure.timestep, exposure.capture_ns, exposure.ready_ns)
            for camera, image in zip(self.cameras, images)
        ]

    def events(self) -> list[CameraEvent]:
        """Always empty: cameras of the lab do not come and go."""
        return []

    def close(self) -> None:
        """Ends the camera process, whose log is complete then; can be called again."""
        with suppress(BrokenPipeError):
            self._stdin.close()
        if not self._started:
            self._process.terminate()  # it builds its scene, and reads nothing meanwhile
        end(self._process)
        self._stdout.close()
        self._bank.close()

    def _newest(self, timeout_s: float) -> Exposure:
        """Waits for the newest timestep; counts those that it leaves out."""
        line = self._line(timeout_s)
        self.missed += len(self._lines)
        while self._lines:
            line = self._lines.popleft()
        return Exposure(**json.loads(line))

    def _send(self, line: str) -> None:
        try:
            self._stdin.write(line.encode() + b"\n")
            self._stdin.flush()
        except BrokenPipeError:
            raise self._ended() from None

    def _line(self, timeout_s: float) -> bytes:
        """The process's oldest line that was not read yet; all later ones are read, too."""
        deadline_s = time.monotonic() + real_s(timeout_s)
        descriptor = self._stdout.fileno()
        while True:
            left_s = 0.0 if self._lines else max(0.0, deadline_s - time.monotonic())
            ready = select.select([descriptor], [], [], left_s)[0]
            received = os.read(descriptor, 65536) if ready else b""
            if received:
                *lines, self._rest = (self._rest + received).split(b"\n")
                self._lines.extend(lines)
            elif self._lines:
                return self._lines.popleft()
            elif ready:
                raise self._ended()
            else:
                raise GrabberError(
                    f"no pictures from the lab's {len(self.cameras)} cameras in {timeout_s:g} s;"
                    " a machine that is too slow for them may keep up with --pace 0.2"
                )

    def _ended(self) -> GrabberError:
        code = self._process.wait()
        if code == 0:
            return GrabberError("the lab's cameras have taken their last picture")
        said = "; what it said stands above" if code > 0 else ""
        return GrabberError(f"the process of the lab's cameras {describe_exit(code)}{said}")
