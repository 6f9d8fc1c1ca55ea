"""Quick questions to a GigE camera, which need neither Aravis nor control of the camera.

Aravis asks for seconds where nobody answers, and cameras are opened one after the other.
"""

from __future__ import annotations

import socket
import struct

PORT = 3956
CONTROL = 0x0A00
"""The register that tells who controls the camera. Source: GigE Vision 2.0, CCP."""
IN_CONTROL = 0b11
"""Its bits for exclusive access and for control."""

HELD = "another program controls it, or did until seconds ago"

_VERSION = 0x0000
_ASK_AGAIN = 3
_WAIT_S = 0.15
_ANSWER_BYTES = 12


def answers(address: str) -> bool:
    """Whether a GigE camera answers at an address; asks some times, for half a second in all."""
    return _read(address, _VERSION) is not None


def controlled(address: str) -> bool:
    """Whether a program controls the GigE camera at an address.

    Cameras may take this question for a sign of life of that program: who waits for a dead one to
    be forgotten must not ask all the time.
    """
    answer = _read(address, CONTROL) or b""
    # A camera that refuses to say is there all the same: opening it will tell more.
    return len(answer) >= _ANSWER_BYTES and bool(answer[_ANSWER_BYTES - 1] & IN_CONTROL)


def _read(address: str, register: int) -> bytes | None:
    """Asks for a register, which everybody may read; None: nobody answers."""
    question = struct.pack(">BBHHHI", 0x42, 0x01, 0x0080, 4, 1, register)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.settimeout(_WAIT_S)
        for _ in range(_ASK_AGAIN):
            try:
                line.connect((address, PORT))
                line.send(question)
                return line.recv(64)
            except OSError:
                # Nobody answers, or the system knows that nobody is there.
                continue
    return None
