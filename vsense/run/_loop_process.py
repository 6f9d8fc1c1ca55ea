"""Loop functions in C++ in a process of their own, which may crash or hang.

`python -m vsense.run._loop_process LIBRARY IN OUT` answers calls on two descriptors. A call is its
text's length and the count of its numbers, both uint32, then the text and the numbers (float64); an
answer is the lengths of text and colours, and these. It ends with its input.
"""

from __future__ import annotations

import codecs
import os
import select
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.base.processes import python_module
from vsense.base.writing import descriptor_of, write
from vsense.robots.loop_library import Colors, CxxLoopError, LoopLibrary

CALL_LIMIT_S = 2.0
"""A function that is called in every timestep must return within this time. Robots have stopped
long before: their readings age."""

BEGIN_LIMIT_S = 30.0
"""Whatever is called before or after the run may take longer: it reads files, and writes them."""

_QUICK = ("PreStep", "PostStep", "IsExperimentFinished", "GetFloorColor")
_SIZES = struct.Struct("=II")


class LoopProcess:
    """The process, and its end of the line; a `LoopCaller`."""

    address = None

    def __init__(self, library: Path) -> None:
        """Starts it."""
        talk = descriptor_of(sys.stderr)
        theirs_in, self._calls = os.pipe()
        self._answers, theirs_out = os.pipe()
        try:
            self._process = subprocess.Popen(
                [
                    *python_module("vsense.run._loop_process"),
                    *(str(library), str(theirs_in), str(theirs_out)),
                ],
                stdin=subprocess.DEVNULL,
                # What loop functions print is talk.
                stdout=subprocess.DEVNULL if talk is None else talk,
                pass_fds=[theirs_in, theirs_out],
                start_new_session=True,
            )
        finally:
            os.close(theirs_in)
            os.close(theirs_out)
        self._open = True

    def __del__(self) -> None:
        self.close()

    def call(
        self, function: str, lines: Sequence[str], numbers: NDArray[np.float64]
    ) -> tuple[str, Colors]:
        """See `LoopCaller`."""
        if not self._open:
            raise CxxLoopError(f"{function}: their process has ended")
        text = "\n".join((function, *lines)).encode()
        row = np.ascontiguousarray(numbers, dtype=np.float64).reshape(-1)
        limit_s = CALL_LIMIT_S if function in _QUICK else BEGIN_LIMIT_S
        try:
            _write(self._calls, _SIZES.pack(len(text), len(row)) + text + row.tobytes())
            said, colors = _SIZES.unpack(self._read(_SIZES.size, function, limit_s))
            answer = self._read(said, function, limit_s)
            return answer.decode(errors="replace"), np.frombuffer(
                self._read(colors, function, limit_s), dtype=np.uint8
            )
        except BrokenPipeError:
            raise self._crashed(function) from None

    def close(self) -> None:
        """Ends the process."""
        if not getattr(self, "_open", False):
            return
        self._open = False
        os.close(self._calls)
        os.close(self._answers)
        try:
            self._process.wait(CALL_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _read(self, size: int, function: str, limit_s: float) -> bytes:
        """Reads so many bytes; `limit_s` is the longest silence."""
        data = bytearray()
        while len(data) < size:
            if not select.select([self._answers], [], [], limit_s)[0]:
                self._process.kill()
                self.close()
                raise CxxLoopError(f"{function} did not return within {limit_s:g} s")
            part = os.read(self._answers, size - len(data))
            if not part:
                raise self._crashed(function)
            data += part
        return bytes(data)

    def _crashed(self, function: str) -> CxxLoopError:
        """Says in words how the process ended."""
        code = self._process.wait()
        self.close()
        if code < 0:
            return CxxLoopError(f"{function} was killed by {signal.Signals(-code).name}")
        return CxxLoopError(f"{function} ended the process with exit code {code}")


def _write(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


def _read_all(descriptor: int, size: int) -> bytes:
    """Reads so many bytes, fewer where the input ends."""
    data = bytearray()
    while len(data) < size:
        part = os.read(descriptor, size - len(data))
        if not part:
            break
        data += part
    return bytes(data)


def answer(library: Path, source: int, target: int) -> None:
    """Answers calls until there are none."""
    loop = LoopLibrary(library)
    while len(head := _read_all(source, _SIZES.size)) == _SIZES.size:
        size, count = _SIZES.unpack(head)
        function, *lines = _read_all(source, size).decode().split("\n")
        numbers = np.frombuffer(_read_all(source, 8 * count), dtype=np.float64)
        said, colors = loop.call(function, lines, numbers)
        text = said.encode()
        _write(target, _SIZES.pack(len(text), len(colors)) + text + colors.tobytes())


@contextmanager
def talk_aside() -> Iterator[None]:
    """Has a thread pass on what is printed, so that nobody waits for who reads it."""
    talk = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="replace")
    before = [os.dup(number) for number in (1, 2)]
    source, target = os.pipe()
    decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def pass_on() -> None:
        with suppress(OSError):  # who read it has gone
            while data := os.read(source, 1 << 16):
                write(talk, decoder.decode(data))
        while os.read(source, 1 << 16):
            pass  # nobody waits for a pipe that is not read

    thread = threading.Thread(target=pass_on, daemon=True)
    thread.start()
    for number in (1, 2):
        os.dup2(target, number)
    os.close(target)
    try:
        yield
    finally:
        # What the library has kept back until the end goes there directly.
        for number, descriptor in zip((1, 2), before):
            os.dup2(descriptor, number)
        thread.join(CALL_LIMIT_S / 4)


if __name__ == "__main__":
    with suppress(BrokenPipeError), talk_aside():
        answer(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
