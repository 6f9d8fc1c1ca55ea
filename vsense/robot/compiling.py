"""Runs C compilers over the robots' sources: this machine's, or one for a robot's processor."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from vsense.errors import VsenseError

CFLAGS = ("-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O2", "-ffunction-sections", "-fdata-sections")

LIBRARIES = ("-Wl,--gc-sections", "-Wl,--as-needed", "-lm")
"""What only the host uses of the C library is left out. The daemon needs libc alone; a user's
controller may want sines, and only then gets libm."""

HASH_DIGITS = 12
"""Of a controller's hash so many are told: enough to tell any two apart."""

APT_LINE = "sudo apt install build-essential python3-dev python3-venv"


class BuildError(VsenseError):
    """The robots' code cannot be built here."""


@dataclass(frozen=True, slots=True)
class Toolchain:
    """A C compiler and its flags for a target.

    Attributes:
        command: the words that start it.
        flags: what it is told beside `CFLAGS`, and after them.
        environment: variables that it needs beside the caller's own.
    """

    command: tuple[str, ...]
    flags: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)

    def run(self, arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
        """Runs it; in a session of its own, since Ctrl-C is for the caller to handle."""
        return subprocess.run(
            [*self.command, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="surrogateescape",
            start_new_session=True,
            env={**os.environ, **self.environment},
        )

    def version(self) -> str:
        """What it says about itself: a newer one makes other programs of the same source."""
        return self.run(["--version"]).stdout


@dataclass(frozen=True, slots=True)
class Sources:
    """What is compiled together.

    Attributes:
        own: files that come with vsense.
        controller: the controller's file.
        includes: folders of headers.
    """

    own: Sequence[Path]
    controller: Path
    includes: Sequence[Path]

    def compile(self, toolchain: Toolchain, arguments: Sequence[str]) -> str:
        """Runs the compiler with our flags and these arguments; gives what it prints.

        Raises:
            BuildError: it refuses a source; the message says which.
        """
        folders = [f"-I{folder}" for folder in self.includes]
        result = toolchain.run([*CFLAGS, *toolchain.flags, *folders, *arguments])
        if result.returncode != 0:
            said = result.stderr.strip()
            raise BuildError(f"{self._blame(said)}:\n{said}")
        return result.stdout

    def link(self, toolchain: Toolchain, target: Path, flags: Sequence[str] = ()) -> None:
        """Compiles and links everything in one go and moves it into place whole, stripped.

        Raises:
            BuildError: the compiler refuses a source, or the folder cannot be written.
        """
        names = map(str, (*self.own, self.controller))
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, made = tempfile.mkstemp(prefix=f"{target.name}.", dir=target.parent)
        except OSError as error:
            raise BuildError(f"cannot build in {target.parent}: {error.strerror}") from error
        os.close(handle)
        try:
            self.compile(toolchain, [*flags, "-s", "-o", made, *names, *LIBRARIES])
            os.chmod(made, 0o755)
            os.replace(made, target)
        except IsADirectoryError as error:
            Path(made).unlink(missing_ok=True)
            raise BuildError(f"cannot write {target}: it is a folder") from error
        except BaseException:
            Path(made).unlink(missing_ok=True)
            raise

    def link_daemon(self, toolchain: Toolchain, target: Path) -> str:
        """Links a daemon that tells which controller it has; gives the controller's hash.

        Raises:
            BuildError: see `link`; or a header is missing.
        """
        digest = self.controller_hash(toolchain)
        self.link(toolchain, target, [f'-DVSENSED_CONTROLLER_HASH="{digest}"'])
        return digest

    def controller_hash(self, toolchain: Toolchain) -> str:
        """Hash of the controller's source and of every header that it does not share with all.

        It says which controller runs on a robot: the same file gives the same one on any machine.

        Raises:
            BuildError: a header is missing.
        """
        shared = {folder.resolve() for folder in self.includes}
        own = [p for p in self.dependencies(toolchain) if p.resolve().parent not in shared]
        if self.controller not in own:
            own.insert(0, self.controller)
        digest = hashlib.sha256()
        for path in own:
            digest.update(os.fsencode(path.name) + b"\0" + path.read_bytes() + b"\0")
        return digest.hexdigest()[:HASH_DIGITS]

    def dependencies(self, toolchain: Toolchain) -> list[Path]:
        """The controller's source and every header that it includes, but for the system's.

        Raises:
            BuildError: the compiler does not find one of them.
        """
        rule = self.compile(toolchain, ["-MM", "-MT", "it", str(self.controller)])
        # A rule for make: its lines end in a backslash, and blanks in names have one before them.
        names = re.findall(r"(?:\\[ #]|\S)+", rule.replace("\\\n", " ").removeprefix("it:"))
        return [Path(re.sub(r"\\([ #])", r"\1", name).replace("$$", "$")) for name in names]

    def _blame(self, said: str) -> str:
        """Says which source the compiler's words are about; a linker's words name no line."""

        def is_named(path: Path) -> bool:
            return re.search(rf"(?:^|from ){re.escape(str(path))}:\d", said, re.M) is not None

        shipped = [str(path) for path in self.own if is_named(path)]
        if shipped:
            return f"a source of vsensed itself does not build: {', '.join(shipped)}"
        if is_named(self.controller):
            return f"the controller {self.controller} does not build"
        return f"vsensed with the controller {self.controller} does not build"


def native() -> Toolchain:
    """The compiler for this machine: `$CC` or `cc`.

    Raises:
        BuildError: it is not there; the message holds the line that installs one.
    """
    command = os.environ.get("CC", "cc").split() or ["cc"]
    if shutil.which(command[0]) is None:
        raise BuildError(f"no C compiler '{command[0]}'; install one with: {APT_LINE}")
    return Toolchain(tuple(command))
