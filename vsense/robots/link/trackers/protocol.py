"""The original tracking server's protocol: commands one way, arena states the other.

All integers are big-endian. A command is a u32. An arena state is a u32 length and that many
ASCII bytes, tokens separated by one blank:
`timestep {tag image_x image_y image_theta world_x world_y world_theta}*`, places in px and m,
angles in degrees. Length 0 ends a run.

Source: iridia.md section 1a (argos3-tycho, the client of the original system).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vsense.robots.link.status import LinkError

TRACKER_PORT = 4040
"""Of the original tracking server. Source: iridia.md section 1a."""

ROBOTS_MAX = 1024
"""Robots that a state from another tracker can hold."""
STATE_MAX = 262_144
"""Longest arena state taken from the wire: so many robots with 30 digits to a number."""

END = struct.pack(">I", 0)
"""The length that ends a run."""

COMMAND_SIZE = 4

_TOKENS = 7
_PLACE_MAX_M = 10_000.0
_TAG_MAX = 2**32 - 1
_LENGTH = struct.Struct(">I")


class TrackerCommand(IntEnum):
    """What a client can ask for."""

    START_EXPERIMENT = 0
    STOP_EXPERIMENT = 1
    ONE_SHOT = 2


@dataclass(frozen=True, slots=True)
class TrackerReport:
    """One robot as a tracker reports it: pose in the arena frame, heading in (-pi, pi]."""

    tag: int
    x_m: float
    y_m: float
    yaw_rad: float


def encode_command(command: TrackerCommand) -> bytes:
    """Returns a command's bytes."""
    return _LENGTH.pack(command)


def encode_state(
    timestep: int, robots: NDArray[np.void], image_poses: NDArray[np.float64]
) -> bytes:
    """Returns an arena state with its length.

    Args:
        timestep: of the run, 0 outside of one.
        robots: (n,) POSE; those that are not seen are left out, because the protocol has no way to
            say so.
        image_poses: (n, 3) x and y in px and the angle in degrees, in a picture of the robot.
    """
    tokens = [f"{timestep}"]
    for row, (u_px, v_px, theta_deg) in zip(robots, image_poses, strict=True):
        if row["seen"]:
            yaw_deg = math.degrees(row["yaw_rad"])
            tokens.append(
                f"{row['tag']} {u_px:.2f} {v_px:.2f} {theta_deg:.3f}"
                f" {row['x_m']:.5f} {row['y_m']:.5f} {yaw_deg:.3f}"
            )
    body = " ".join(tokens).encode("ascii")
    return _LENGTH.pack(len(body)) + body


def decode_state(body: bytes) -> tuple[int, list[TrackerReport]]:
    """Reads timestep and robots of an arena state without its length; a tag may be there twice.

    Raises:
        LinkError: it is no arena state; the message says which token is wrong.
    """
    tokens = body.decode("ascii", "replace").split(" ")
    if tokens[-1] == "":
        tokens.pop()
    if len(tokens) % _TOKENS != 1:
        raise LinkError(f"an arena state of {len(tokens)} tokens, expected 1 + 7 per robot")
    if len(tokens) > 1 + _TOKENS * ROBOTS_MAX:
        count = len(tokens) // _TOKENS
        raise LinkError(f"an arena state of {count} robots, expected at most {ROBOTS_MAX}")
    timestep = _integer(tokens[0], "timestep")
    robots = []
    for at in range(1, len(tokens), _TOKENS):
        # The coordinates in the tracker's pictures are not used.
        tag = _integer(tokens[at], "tag")
        x_m, y_m = (_real(tokens[at + k], "place", _PLACE_MAX_M) for k in (4, 5))
        turn = math.radians(_real(tokens[at + 6], "angle", 1e6))
        robots.append(TrackerReport(tag, x_m, y_m, math.pi - (math.pi - turn) % math.tau))
    return timestep, robots


def _integer(token: str, name: str) -> int:
    if not (token.isascii() and token.isdigit() and len(token) <= 10 and int(token) <= _TAG_MAX):
        raise LinkError(f"an arena state with {name} {token[:40]!r}, expected a whole number")
    return int(token)


def _real(token: str, name: str, most: float) -> float:
    try:
        value = float(token)
    except ValueError:
        value = math.nan
    if not abs(value) <= most:
        raise LinkError(f"an arena state with {name} {token[:40]!r}, expected a number")
    return value


class StateInbox:
    """Cuts received bytes into arena states, however the network chunked them."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, data: bytes) -> Iterable[bytes]:
        """Takes bytes in and gives the states that are whole now, without their length.

        An empty one is the end of a run.

        Raises:
            LinkError: a length that no arena state has; the stream is lost.
        """
        self._bytes += data
        states = []
        while len(self._bytes) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._bytes)
            if length > STATE_MAX:
                raise LinkError(f"an arena state of {length} bytes, expected at most {STATE_MAX}")
            if len(self._bytes) < _LENGTH.size + length:
                break
            states.append(bytes(self._bytes[_LENGTH.size : _LENGTH.size + length]))
            del self._bytes[: _LENGTH.size + length]
        return states
