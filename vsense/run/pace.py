"""The timesteps of a run: which arena states begin one, and which number it has. Pure.

An experiment says how long its timesteps are; a tracker or a camera may be faster or slower, and
falls silent now and then. The number of a timestep therefore follows from the capture time: a
state too early for the next timestep is passed over, and a pause leaves timesteps out.
"""

from __future__ import annotations

FOLLOW = 100
"""The grid of the timesteps follows a tracker of nearly the same rate by up to one part in this
many, so that the two do not slip past each other for ever."""


class Pace:
    """Numbers capture times, from 0."""

    def __init__(self, timestep_ns: int) -> None:
        """Begins with the first capture time, whenever that is.

        Args:
            timestep_ns: length of a timestep.
        """
        self._timestep_ns = timestep_ns
        self._epoch_ns = 0
        self._newest = -1
        self._passed_over = False

    def timestep(self, capture_ns: int) -> int | None:
        """Gives the number of the timestep that a state captured then begins.

        Args:
            capture_ns: on a clock that never jumps.

        Returns:
            A number greater than all before; None where the newest timestep is not over yet.
        """
        if self._newest < 0:
            self._epoch_ns, self._newest = capture_ns, 0
            return 0
        span_ns = self._timestep_ns
        number = (capture_ns - self._epoch_ns + span_ns // 2) // span_ns
        if number <= self._newest:
            self._passed_over = True
            return None
        if not self._passed_over:
            # Of a faster tracker the first state in time is taken: it says nothing of its phase.
            late_ns = capture_ns - self._epoch_ns - number * span_ns
            self._epoch_ns += max(-span_ns // FOLLOW, min(late_ns, span_ns // FOLLOW))
        self._newest, self._passed_over = number, False
        return number
