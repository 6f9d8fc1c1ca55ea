"""The recording of a simulated run: every message, written in the simulation's own thread.

A simulation has no real time to keep: it waits for the disk, and nothing is lost. So it needs none
of the queues of `vsense.monitor.recording._recorder`, and a recording is the same however fast the
disk is. Times are those of the simulation's clock.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError, failing_as
from vsense.base.message_bus import Listener, Message, MessageBus
from vsense.monitor.foxglove.channels import Channels
from vsense.monitor.recording import form
from vsense.monitor.recording.writer import FLUSH_S, RecordingWriter, gap_message


class SimRecorder:
    """One recording of one simulated run; for one thread.

    What the disk does not take ends the recording, not the run: `trouble` says why.

    Args:
        bus: what it carries is recorded.
        path: of a new file.
        begin_ns: the simulation's clock when it begins.

    Raises:
        RecordingError: the file cannot be made, or there is one already.
    """

    def __init__(self, bus: MessageBus, path: Path, begin_ns: int) -> None:
        self.path, self.trouble = path, ""
        self._bus = bus
        utc_shift_ns = time.time_ns() - begin_ns
        self._writer = RecordingWriter(path, begin_ns, utc_shift_ns)
        self._channels = Channels(utc_shift_ns)
        self._flushed_s, self._lost = time.monotonic(), 0
        self._newest_ns, self._off_since_ns = begin_ns, -1
        self._recorded_ns = 0
        self._listener: Listener | None = None
        self.switch(True)

    def switch(self, on: bool) -> None:
        """Switches it on or off; the recording says what is missing."""
        listener = self._listener
        if on and listener is None and not self.trouble:
            # Publishers repeat for a new listener what changes rarely.
            self._listener = self._bus.join(self.receive, form.is_recorded)
        elif not on and listener is not None:
            self._bus.leave(listener)
            self._listener, self._off_since_ns = None, self._newest_ns

    def receive(self, message: Message) -> None:
        """Writes a message of the bus."""
        try:
            if self._off_since_ns >= 0:
                now_ns, since_ns = message.time_ns, self._off_since_ns
                self._off_since_ns = -1
                why = "recording was switched off"
                self._writer.add(gap_message(now_ns, since_ns, now_ns, (0, 0), why))
            elif message.time_ns > self._newest_ns:
                self._recorded_ns += message.time_ns - self._newest_ns
            self._writer.add(message)
            for derived in self._channels.convert(message):
                self._writer.add_derived(derived)
            self._newest_ns = message.time_ns
            if self._writer.is_full or time.monotonic() - self._flushed_s >= FLUSH_S:
                self._writer.flush()
                self._flushed_s = time.monotonic()
        except OSError as error:
            self._fail(str(error.strerror))
        except (TypeError, ValueError, RecursionError):
            self._lost += 1

    def state(self) -> dict[str, Any]:
        """The "recording" of the message `/run`."""
        return {
            "on": self._listener is not None,
            "file": str(self.path),
            "bytes": self._writer.bytes,
            "lost_messages": self._lost,
            "trouble": self.trouble or None,
        }

    def close(self) -> dict[str, Any]:
        """Writes what waits, and the index; gives `file`, `bytes`, `seconds`, `trouble` or ""."""
        self.switch(False)
        try:
            self._writer.close()
        except OSError as error:
            self._fail(str(error.strerror))
        return {
            "file": str(self.path),
            "bytes": self._writer.bytes,
            "seconds": self._recorded_ns / 1e9,
            "trouble": self.trouble,
        }

    def _fail(self, why: str) -> None:
        self.trouble = f"{self.path} cannot be written: {why}; what was written until then is there"
        self.switch(False)


def clear(path: Path) -> None:
    """Removes the recording of a run that is done again; VsenseError if that is not possible."""
    with failing_as(VsenseError, f"{path}: cannot be removed"), suppress(FileNotFoundError):
        path.unlink()
