"""The tracking server's side of one conversation, without its socket: commands in, states out."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vsense.arena import ArenaState
from vsense.link.arena_wire import COMMAND_SIZE, END, Command, encode_state
from vsense.link.streams import Outbox

Locate = Callable[[NDArray[np.void]], NDArray[np.float64]]
"""Gives for (n,) POSE the (n, 3) poses in pictures: x and y in px, the angle in degrees."""

WRONG_MAX = 8
"""Unknown commands until the peer is taken to be something else than a client."""
WAITING_MAX = 64
"""Answers that may wait for a client that asks without reading."""


class ArenaSession:
    """One client: what it has asked for, and what still has to be sent to it.

    Attributes:
        outbox: what is still to be written.
        running: between START_EXPERIMENT and STOP_EXPERIMENT.
        timestep: of the run, from 1; 0 outside of one and before its first state.
        superseded: states of this run that were replaced by a newer one before they could leave.
        refused: why the conversation must end, "" while it can go on.
    """

    def __init__(self, locate: Locate, tell: Callable[[str], None]) -> None:
        """Begins a conversation.

        Args:
            locate: gives robots' poses in the pictures.
            tell: takes a line for a person.
        """
        self.outbox = Outbox()
        self.running = False
        self.timestep = 0
        self.superseded = 0
        self.refused = ""
        self._locate = locate
        self._tell = tell
        self._bytes = bytearray()
        self._asked = 0
        self._wrong = 0
        self._answers = 0
        self._first: int | None = None

    def receive(self, data: bytes, newest: ArenaState | None) -> None:
        """Takes bytes of the client in.

        Args:
            data: the bytes, chunked as they came.
            newest: what ONE_SHOT is answered with; None before the first arena state.
        """
        self._bytes += data
        while len(self._bytes) >= COMMAND_SIZE and not self.refused:
            (number,) = struct.unpack_from(">I", self._bytes)
            del self._bytes[:COMMAND_SIZE]
            self._obey(number, newest)

    def publish(self, state: ArenaState) -> None:
        """Answers what waits for a state, and in a run adds this one to the stream."""
        if self.running:
            if self._first is None:
                self._first = state.timestep
            self.timestep = state.timestep - self._first + 1
        while self._asked:
            self._asked -= 1
            self._answer(state)
        if self.running:
            self.superseded += self.outbox.put_state(self._encode(state))

    def end_run(self) -> None:
        """Ends a run from the server's side; nothing happens outside of one.

        Length 0 leaves here only: the original's client takes it for the end of the experiment
        and would end its next one if it followed STOP_EXPERIMENT.
        """
        if self.running:
            self._stop()
            self.outbox.put(END)

    def _obey(self, number: int, newest: ArenaState | None) -> None:
        if number == Command.ONE_SHOT:
            self._one_shot(newest)
        elif number == Command.START_EXPERIMENT:
            if self.running:
                self._tell("START_EXPERIMENT in a run: the run goes on")
                return
            self.running, self.timestep, self._first, self.superseded = True, 0, None, 0
            self._tell("the run has started")
        elif number == Command.STOP_EXPERIMENT:
            if self.running:
                self._stop()
        else:
            self._wrong += 1
            self._tell(f"command {number} is not known, expected 0, 1 or 2; it is ignored")
            if self._wrong >= WRONG_MAX:
                self.refused = "sends too many unknown commands to be a client"

    def _one_shot(self, newest: ArenaState | None) -> None:
        if not self.outbox:
            self._answers = 0
        if self._asked + self._answers >= WAITING_MAX:
            self.refused = "asks for states and does not read them"
        elif newest is None:
            self._asked += 1
        else:
            self._answer(newest)

    def _answer(self, state: ArenaState) -> None:
        self._answers += 1
        self.outbox.put(self._encode(state))

    def _stop(self) -> None:
        lost = f", {self.superseded} of them too fast for the client" if self.superseded else ""
        self._tell(f"the run has ended after {self.timestep} timesteps{lost}")
        self.running, self.timestep = False, 0
        self.outbox.drop_state()

    def _encode(self, state: ArenaState) -> bytes:
        return encode_state(self.timestep, state.robots, self._locate(state.robots))
