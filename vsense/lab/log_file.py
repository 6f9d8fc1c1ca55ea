"""Files that grow while a run goes on, and whose end is not the run's."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from vsense.lab.shared import file_errors


class LogFile:
    """Grows by whole records; where the disk is full it ends, is told, and the run goes on."""

    def __init__(self, path: Path) -> None:
        """Begins a new file; raises LabError where it cannot be written."""
        self._path = path
        self._length = 0
        with file_errors(path):
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
            self._descriptor: int | None = os.open(path, flags, 0o644)

    def append(self, records: bytes | bytearray) -> None:
        """Adds whole records, or none of them."""
        if self._descriptor is None:
            return
        view = memoryview(records)
        try:
            while view:
                view = view[os.write(self._descriptor, view) :]
        except OSError as error:
            with suppress(OSError):  # at worst half a record stays, which readers leave out
                os.ftruncate(self._descriptor, self._length)
            self.close()
            words = "it ends here, and the run goes on"
            print(f"{self._path}: {error.strerror}: {words}", file=sys.stderr, flush=True)
        else:
            self._length += len(records)

    def close(self) -> None:
        """Ends the file; can be called again."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
