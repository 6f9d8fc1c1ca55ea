"""Orders of page, terminal and keyboard, carried out by `Control`.

This module needs nothing of vsense but its errors: `vsense control stop --emergency` works while
the compiled libraries are being built anew.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from vsense.base.errors import VsenseError

T = TypeVar("T")


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
    REPLACE = "replace"


@dataclass(frozen=True, slots=True)
class Order:
    """One press of a button.

    Attributes:
        by: who, for people: "viewer 2 (10.0.0.7)", "terminal", "keyboard".
        value: RECORD, PLAY: 1 on, 0 off; SPEED: times real time, of a simulation 0:
            as fast as it goes; SEEK: [s] since the beginning.
        pair: of REPLACE: a tag, and that of the robot that plays in its place from now on.
    """

    kind: OrderKind
    by: str
    value: float = 0.0
    pair: tuple[int, int] = (0, 0)


def read_pair(said: object) -> tuple[int, int]:
    """Reads two tags, of whom and who, as JSON has them; ValueError where they are none."""
    tags = said if isinstance(said, list) and len(said) == 2 else [None]
    integers = [t for t in tags if isinstance(t, int) and not isinstance(t, bool)]
    if len(integers) != 2 or not all(0 <= tag < 1 << 16 for tag in integers):
        raise ValueError(f"pair is two tags, not {said!r:.40}")
    return integers[0], integers[1]


Give = Callable[[Order], str]
"""Carries an order out, from any thread and without waiting; gives one line that says what happens
now. Raises OrderError where it cannot be."""


class RequestQueue(Generic[T]):
    """What people ask for in their threads, until the thread of the timesteps takes it."""

    def __init__(self) -> None:
        self._pending: list[T] = []
        self._lock = threading.Lock()

    def put(self, request: T, check: Callable[[Sequence[T]], None]) -> None:
        """Takes a request, from any thread.

        `check` is given those that wait, and raises where this one cannot be; no other one comes in
        between.
        """
        with self._lock:
            check(self._pending)
            self._pending.append(request)

    def take(self, most: int | None = None) -> list[T]:
        """Gives the oldest ones that wait, at most so many."""
        if not self._pending:
            return []
        with self._lock:
            taken, self._pending = self._pending[:most], self._pending[len(self._pending[:most]) :]
        return taken
