"""The process of the lab's cameras: one picture per camera and timestep, of the truth.

`python -m vsense.modes.lab._cameras` reads two lines of JSON from standard input, first
`{"bank": NAME, "spec": {...}}` with the frame bank and the `LabCameraSpec`. It builds the scene,
writes `{"ready": true}`, and reads `{"epoch_ns": ...}`. From then on it writes one line of JSON per
timestep, an `Exposure`. A line `{"row": 0, "body": {...}}` has the body of a row of the truth ring
look like this `Body` from the next timestep on. It ends when standard input ends, on SIGTERM, or
after the last timestep; its parent handles Ctrl-C.

Timestep k is triggered at epoch + k * timestep, the middle of its exposure. The empty arena is
drawn before that, the bodies when the exposure has ended and the truth of it is known. Timesteps
whose exposure has passed before the cameras are free again are left out.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import asdict
from typing import Any

import numpy as np

from vsense.base import clock
from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError
from vsense.base.shared import FrameBank, LabError
from vsense.base.terminal import Console
from vsense.modes.lab._bodies import Body
from vsense.modes.lab._camera_spec import Exposure, LabCameraSpec
from vsense.modes.lab._optics import EXPOSURE_NS, SAMPLES, sample_times_ns
from vsense.modes.lab._renderer import Studio
from vsense.modes.lab.truth import TruthLog, TruthReader
from vsense.world.entities import WorldError

PREPARE_NS = 15_000_000
"""Drawing the empty arena begins so long before the trigger."""

_TRUTH_POLL_NS = 500_000


class Input:
    """Standard input, read while nobody waits for it."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._lines: list[bytes] = []
        self._rest = b""

    def wait(self, until_ns: int) -> bool:
        """Waits until a time on the monotonic clock; False as soon as the input has ended."""
        while True:
            left_s = clock.real_s(max(0, until_ns - host_ns()) / 1e9)
            if not select.select([self._descriptor], [], [], left_s)[0]:
                return True
            if not (data := os.read(self._descriptor, 4096)):
                return False
            *lines, self._rest = (self._rest + data).split(b"\n")
            self._lines += lines

    def lines(self) -> list[bytes]:
        """The whole lines that have come since the last call."""
        lines, self._lines = self._lines, []
        return lines


class CameraProcess:
    """Draws the pictures of all timesteps into a frame bank."""

    def __init__(self, spec: LabCameraSpec, bank: FrameBank) -> None:
        """Builds the scene; raises VsenseError where the spec cannot be followed."""
        self._spec = spec
        self._bank = bank
        with ExitStack() as stack:
            self._truth = stack.enter_context(closing(TruthReader(spec.truth)))
            if self._truth.bodies != len(spec.bodies):
                raise LabError(
                    f"truth ring: {self._truth.bodies} bodies, the spec has {len(spec.bodies)}"
                )
            self._log = stack.enter_context(closing(TruthLog(spec.log, len(spec.bodies))))
            self._studio = Studio(spec)
            self._stack = stack.pop_all()

    def run(self, epoch_ns: int, stdin: Input) -> Iterator[Exposure]:
        """Takes pictures in real time until `stdin` ends or the last timestep is done."""
        timestep = 0
        while self._spec.frames is None or timestep < self._spec.frames:
            capture_ns = epoch_ns + timestep * self._spec.timestep_ns
            if not stdin.wait(capture_ns - PREPARE_NS):
                return
            for line in stdin.lines():
                self._dress(line)
            exposure = self._expose(timestep, capture_ns, stdin)
            if exposure is None:
                return
            yield exposure
            passed_ns = host_ns() - EXPOSURE_NS // 2 - epoch_ns
            timestep = max(timestep, passed_ns // self._spec.timestep_ns) + 1

    def close(self) -> None:
        """Ends the log, and releases the truth."""
        self._stack.close()

    def _dress(self, line: bytes) -> None:
        try:
            said = json.loads(line)
            self._studio.dress(int(said["row"]), Body.of(said["body"]))
        except (ValueError, KeyError, TypeError, IndexError, WorldError):
            raise LabError(f"cameras: {line[:80]!r} makes no sense") from None

    def _expose(self, timestep: int, capture_ns: int, stdin: Input) -> Exposure | None:
        """Takes one timestep's pictures; None where `stdin` ended first."""
        slot = self._bank.begin(timestep)
        images = self._bank.images[slot]
        moments = sample_times_ns(capture_ns, SAMPLES)
        self._studio.prepare(timestep, images)
        if not stdin.wait(capture_ns + EXPOSURE_NS // 2) or not self._know(moments[-1], stdin):
            return None
        known_ns = host_ns()
        truth = [self._truth.at(moment) for moment in moments]
        poses = np.stack([poses for poses, _ in truth])
        leds = truth[SAMPLES // 2][1]
        self._studio.expose(timestep, poses, leds, images)
        ready_ns = host_ns()
        render_ns = ready_ns - known_ns
        self._log.append(timestep, capture_ns, ready_ns, render_ns, poses[SAMPLES // 2], leds)
        return Exposure(timestep, slot, capture_ns, ready_ns)

    def _know(self, moment_ns: int, stdin: Input) -> bool:
        """Waits until the truth of a moment is known; False where `stdin` ended first."""
        while self._truth.newest_ns() < moment_ns:
            if not stdin.wait(host_ns() + _TRUTH_POLL_NS):
                return False
        return True


def _say(values: dict[str, Any]) -> None:
    os.write(sys.stdout.fileno(), json.dumps(values).encode() + b"\n")


def _work() -> None:
    """Follows the protocol on standard input and output; see the module."""
    first = sys.stdin.readline()
    if not first:
        return
    order = json.loads(first)
    spec = LabCameraSpec.from_json(json.dumps(order["spec"]))
    clock.slow(spec.permille)
    with (
        closing(FrameBank.open(order["bank"], spec.shape)) as bank,
        closing(CameraProcess(spec, bank)) as cameras,
    ):
        _say({"ready": True})
        second = sys.stdin.readline()
        if second:
            for exposure in cameras.run(json.loads(second)["epoch_ns"], Input(sys.stdin.fileno())):
                _say(asdict(exposure))


def main() -> int:
    """Runs the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(0))
    try:
        _work()
    except BrokenPipeError:
        return 0
    except VsenseError as error:
        Console().say(f"cameras: {error}")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
