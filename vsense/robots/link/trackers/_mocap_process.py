"""The process that asks a motion capture system where its rigid bodies are.

`python -m vsense.robots.link.trackers._mocap_process` has one argument, JSON: `type` and `settings`
of `motioncapture.connect`, `bodies` (tags by names), `up`, and `socket`, the number of a descriptor
that it has got. It writes lines there as TRACKERS.md has them; what a person should know goes to
its standard output, a line each.

It is a process of its own because the library waits in C for servers that may never answer, with
Python held meanwhile, writes what it likes to standard output, and may crash on a damaged packet.
Where it waits for longer than `SILENT_S`, the kernel ends the process, and it is started anew.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import socket
import sys
from collections.abc import Callable, Iterable, Mapping
from itertools import count
from typing import Any, NamedTuple

from vsense.base.clock import host_ns

ENDED = "ended: "
"""A line that begins so says why it has."""
SILENT_S = 3.0
"""Without a frame for so long the server is asked again."""
STALE_NS = 500_000_000
"""A pose that repeats to the last bit for so long is no measurement: its body is not seen."""
_MOST_NOTES = 8
_LEAST, _MOST = 1e-6, 1e6
"""Of a quaternion's largest part: of others the squares are no numbers, or zero."""
_FAR_M, _HIGH_M, _STEEP = 100.0, 1.0, 0.8
"""What is farther off was told in mm. What looks steeper (a sine) has no heading on the floor; that
and a body that is so high or low say that another axis points up."""

BodyPose = tuple[float, float, float, float, float, float, float]
"""x, y, z [m] and the quaternion x, y, z, w of a rigid body."""


class RigidBodies:
    """Makes reports of rigid bodies: each is a robot with a tag, or nobody.

    Args:
        tags: by the bodies' names.
        up: the axis of the system's frame that points up, "y" or "z".
        repeats: poses may repeat for ever, as those of the mock system do.
        say: takes a line for people.
    """

    def __init__(
        self, tags: Mapping[str, int], up: str, repeats: bool, say: Callable[[str], None]
    ) -> None:
        self._tags, self._up, self._repeats, self._say = tags, up, repeats, say
        self._last: dict[str, tuple[BodyPose, int]] = {}
        self._noted: set[str] = set()

    def robots(self, seen: Iterable[tuple[str, BodyPose]], now_ns: int) -> list[dict[str, Any]]:
        """The robots of a frame, as lines have them, in any order of the bodies."""
        robots = list[dict[str, Any]]()
        for name, pose in seen:
            if name not in self._tags:
                self._note(name, "has no robot: left out")
            elif not all(map(math.isfinite, pose)) or not _LEAST < max(map(abs, pose[3:])) < _MOST:
                self._note(name, "has a pose that is no number: it counts as unseen")
            elif self._is_new(name, pose, now_ns):
                self._place(name, on_floor(pose, self._up), robots)
            else:
                self._note(name, f"repeats its pose for {STALE_NS / 1e9:g} s: it counts as unseen")
        return robots

    def _place(self, name: str, place: Place, robots: list[dict[str, Any]]) -> None:
        far_m = max(abs(place.x_m), abs(place.y_m))
        if far_m > _FAR_M:
            self._note(name, f"is {far_m:.0f} m away, expected metres: it counts as unseen")
            return
        if abs(place.height_m) > _HIGH_M:
            self._note(
                name, f"is {place.height_m:+.1f} m above the floor: is up={self._up!r} true?"
            )
        if abs(place.steepness) > _STEEP:
            self._note(name, f"looks up or down: it counts as unseen; is up={self._up!r} true?")
            return
        row = {"tag": self._tags[name], "x_m": place.x_m, "y_m": place.y_m}
        robots.append(row | {"yaw_rad": place.yaw_rad})

    def _is_new(self, name: str, pose: BodyPose, now_ns: int) -> bool:
        last, since_ns = self._last.get(name, (None, now_ns))
        if pose != last:
            self._last[name] = pose, now_ns
            return True
        return self._repeats or now_ns - since_ns < STALE_NS

    def _note(self, name: str, words: str) -> None:
        text = f"rigid body {name[:40]!r} {words}"
        if text not in self._noted and len(self._noted) < _MOST_NOTES:
            self._noted.add(text)
            self._say(text)


class Place(NamedTuple):
    """A body in a frame whose z points up; `steepness` is the sine of how far it looks upward."""

    x_m: float
    y_m: float
    yaw_rad: float
    height_m: float
    steepness: float


def on_floor(pose: BodyPose, up: str) -> Place:
    """Place and heading in a frame whose z points up, of a body that looks along its x.

    Where y points up, z points to the viewer, as Motive has it.
    """
    x_m, y_m, z_m, x, y, z, w = pose
    length = x * x + y * y + z * z + w * w
    ahead_x = 1.0 - 2.0 * (y * y + z * z) / length
    ahead_y = 2.0 * (x * y + w * z) / length
    ahead_z = 2.0 * (x * z - w * y) / length
    if up == "y":
        return Place(x_m, -z_m, math.atan2(-ahead_z, ahead_x), y_m, ahead_y)
    return Place(x_m, y_m, math.atan2(ahead_y, ahead_x), z_m, ahead_z)


def poses_of(bodies: Mapping[str, Any]) -> Iterable[tuple[str, BodyPose]]:
    """Names and poses of the library's rigid bodies."""
    for name, body in bodies.items():
        turn = body.rotation
        x, y, z = map(float, body.position)
        yield name, (x, y, z, float(turn.x), float(turn.y), float(turn.z), float(turn.w))


def main() -> int:
    """Runs the process until its connection ends, or the system is silent."""
    order = json.loads(sys.argv[1])
    # The library writes to both, a line for every packet.
    told, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)

    def say(text: str) -> None:
        with contextlib.suppress(BrokenPipeError):
            os.write(told, text.encode(errors="replace") + b"\n")

    try:
        import motioncapture

        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, SILENT_S)
        system = motioncapture.connect(order["type"], order["settings"])
        bodies = RigidBodies(order["bodies"], order["up"], order["type"] == "mock", say)
        with socket.socket(fileno=order["socket"]) as link:
            for timestep in count():
                system.waitForNextFrame()
                signal.setitimer(signal.ITIMER_REAL, SILENT_S)
                now_ns = host_ns()
                robots = bodies.robots(poses_of(system.rigidBodies), now_ns)
                line = {"timestep": timestep, "capture_ns": now_ns, "robots": robots}
                link.sendall(json.dumps(line).encode() + b"\n")
    except (BrokenPipeError, ConnectionError):
        return 0
    except Exception as error:  # whatever the library raises; it is told, and this process ends
        say(ENDED + (str(error)[:200] or type(error).__name__))
    return 1


if __name__ == "__main__":
    sys.exit(main())
