"""Drivers: programs of any language that turn a robot's wheels for its daemon (`robot/DRIVERS.md`).

A roster names one by `base = "exec:COMMAND"`. Words of COMMAND that are files beside the roster, or
shipped drivers, are files of the driver: `deploy` brings them to the robot. A driver in Python may
be named alone, by its file or as a shipped one: "exec:mine.py /dev/ttyUSB0", "exec:epuck /dev/x".
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vsense.base.errors import UsageError, failing_as
from vsense.base.processes import python_file
from vsense.robots.build import source_tree

KIND = "exec:"
"""What a `--base` with a driver begins with."""

HELPER = "vsense_driver.py"
"""The one file that a driver in Python needs, beside itself."""

PLACE = "/usr/local/lib/vsense"
"""Where drivers are on a robot's board."""

_IN_DAEMONS = b"exec:COMMAND"
"""What the help of a daemon says that can have a driver."""


@dataclass(frozen=True, slots=True)
class Driver:
    """A robot's driver.

    Attributes:
        words: of its command; a file of its own is a path.
    """

    words: tuple[str | Path, ...]

    @classmethod
    def of(cls, base: str, beside: Path) -> Driver | None:
        """Reads a `--base`; None: it is another one. `beside`: the folder of its files.

        UsageError: it names no command.
        """
        if not base.startswith(KIND):
            return None
        command, *more = base.removeprefix(KIND).split() or [""]
        if not command:
            raise UsageError(f"base {base!r}: expected a command, such as exec:mine.py")
        first = _file(command, beside) or _file(f"{command}.py", beside)
        return cls((first or command, *(_file(word, beside) or word for word in more)))

    def on_board(self) -> tuple[str, dict[str, bytes]]:
        """The `--base` on a robot's board, and the files that it needs there, by their names.

        Raises:
            UsageError: a file cannot be read.
        """
        paths = [word for word in self.words if isinstance(word, Path)]
        if any(path.suffix == ".py" for path in paths):
            paths.append(source_tree().drivers / HELPER)
        files = {}
        for path in paths:
            with failing_as(UsageError, f"cannot read {path}"):
                files[path.name] = path.read_bytes()
        return self._base(lambda path: f"{PLACE}/{path.name}", "python3"), files

    def here(self) -> str:
        """The `--base` on this machine, where the file that one in Python needs is elsewhere."""
        base, drivers = self._base(str, python_file(Path())[0]), source_tree().drivers
        first = self.words[0]
        if not isinstance(first, Path) or first.suffix != ".py" or first.parent == drivers:
            return base
        return base.replace(KIND, f"{KIND}env PYTHONPATH={shlex.quote(str(drivers))} ", 1)

    def _base(self, place: Callable[[Path], str], python: str) -> str:
        words = [place(word) if isinstance(word, Path) else word for word in self.words]
        first = self.words[0]
        if isinstance(first, Path) and first.suffix == ".py":
            words.insert(0, python)
        return f"{KIND}{shlex.join(words)}"


def _file(word: str, beside: Path) -> Path | None:
    """The file of that name beside the roster, or among the shipped drivers."""
    for folder in (beside, source_tree().drivers):
        if "/" not in word and os.path.isfile(path := folder / word):
            return path.resolve()
    return None


def check_daemon(binary: bytes, robot: str) -> None:
    """Raises UsageError where a daemon cannot have a driver, which a robot's base is."""
    if _IN_DAEMONS not in binary:
        raise UsageError(
            f"{robot}: its base is a driver, and this vsensed has none: one for --target epuck has"
            " no room for it; build for pi-puck or aarch64"
        )
