"""Orders of page, terminal and keyboard, carried out by `Control`.

This module needs nothing of vsense but its errors: `vsense stop --emergency` works while the
compiled libraries are being built anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from vsense.errors import VsenseError


class OrderError(VsenseError):
    """An order that cannot be carried out now; one line that says why."""


class OrderKind(str, Enum):
    """What can be ordered. A replay knows PLAY, SPEED and SEEK, a simulation STEP and SPEED."""

    START = "start"
    PAUSE = "pause"
    STOP = "stop"
    RESET = "reset"
    EMERGENCY = "emergency"
    RECORD = "record"
    PLAY = "play"
    SPEED = "speed"
    SEEK = "seek"
    STEP = "step"


@dataclass(frozen=True, slots=True)
class Order:
    """One press of a button.

    Attributes:
        by: who, for people: "viewer 2 (10.0.0.7)", "terminal", "keyboard".
        value: RECORD, PLAY: 1 on, 0 off; SPEED: times real time, of a simulation 0:
            as fast as it goes; SEEK: [s] since the beginning.
    """

    kind: OrderKind
    by: str
    value: float = 0.0


Give = Callable[[Order], str]
"""Carries an order out, from any thread and without waiting; gives one line that says what happens
now. Raises OrderError where it cannot be."""
