"""Builds the robot daemon `vsensed` for this machine from the C sources that come with vsense.

A build lands in the user's cache directory under a name made of the hash of everything that
went into it, so a second start finds it and an edited controller is never mistaken for the old
one. An installed vsense carries one daemon ready made, with the shipped controller; a machine
without a compiler can run that.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from vsense.errors import UsageError, VsenseError

CFLAGS = (
    *("-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O2", "-ffunction-sections", "-fdata-sections"),
    "-DVS_NO_ATOMICS",
)
"""The worker is single-threaded: without atomics the same sources link on ARMv5, too."""

LIBRARIES = ("-Wl,--gc-sections", "-Wl,--as-needed", "-lm")
"""What only the host uses of the C library is left out. The daemon needs libc alone; a user's
controller may want sines, and only then gets libm."""

SHIPPED_CONTROLLER = "pollutant"

APT_LINE = "sudo apt install build-essential python3-dev python3-venv"


class BuildError(VsenseError):
    """The daemon cannot be built here."""


@dataclass(frozen=True, slots=True)
class SourceTree:
    """The folders `c_src/` and `robot/` as they lie in a checkout or in an installed package."""

    root: Path

    @property
    def prebuilt(self) -> Path:
        """Where an installed package carries its ready-made daemon."""
        return self.root / "bin" / "vsensed"

    def daemon_sources(self) -> list[Path]:
        """All C files of the daemon but its controller, in a fixed order."""
        return [
            p for folder in ("c_src", "robot") for p in sorted((self.root / folder).glob("*.c"))
        ]

    def headers(self) -> list[Path]:
        """All headers of the daemon, in a fixed order."""
        return [
            p for folder in ("c_src", "robot") for p in sorted((self.root / folder).glob("*.h"))
        ]

    def includes(self) -> list[str]:
        """The compiler's flags that make it find the headers."""
        return [f"-I{self.root / folder}" for folder in ("c_src", "robot")]

    def controllers(self) -> dict[str, Path]:
        """The shipped controllers by name."""
        return {p.stem: p for p in sorted((self.root / "robot" / "controllers").glob("*.c"))}

    def controller(self, name: str, beside: Path | None = None) -> Path:
        """Finds a controller's source.

        Args:
            name: a shipped controller's name, or the path of a `.c` file.
            beside: folder that a relative path is taken from.

        Raises:
            UsageError: there is no such controller.
        """
        shipped = self.controllers()
        if name in shipped:
            return shipped[name]
        path = (beside or Path()) / name
        if path.suffix == ".c" and path.is_file():
            return path.resolve()
        known = ", ".join(shipped)
        raise UsageError(
            f"no controller {name!r}: expected the path of a .c file or one of: {known}"
        )


def source_tree() -> SourceTree:
    """Finds the C sources: inside the installed package, or in the checkout around it.

    Raises:
        BuildError: neither is there.
    """
    package = Path(__file__).resolve().parent
    for root in (package / "_sources", package.parent):
        if (root / "robot" / "main.c").is_file():
            return SourceTree(root)
    raise BuildError(f"the daemon's C sources are missing from {package}: install vsense again")


def daemon(controller: str = SHIPPED_CONTROLLER, beside: Path | None = None) -> Path:
    """Gives the host's `vsensed` with this controller, building it where needed.

    Args:
        controller: a shipped controller's name or the path of a `.c` file.
        beside: folder that a relative path is taken from (the experiment file's).

    Returns:
        Path of the executable.

    Raises:
        UsageError: no such controller.
        BuildError: no compiler, a source that does not compile, or no cache directory.
    """
    tree = source_tree()
    source = tree.controller(controller, beside)
    if controller == SHIPPED_CONTROLLER and tree.prebuilt.is_file():
        return tree.prebuilt
    target = cache_directory() / _fingerprint(tree, source) / "vsensed"
    if not target.is_file():
        compile_daemon(tree, source, target)
    return target


def cache_directory() -> Path:
    """The folder for builds: `$XDG_CACHE_HOME/vsense`, by default `~/.cache/vsense`.

    Raises:
        BuildError: the user has no home directory.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    if base:
        return Path(base) / "vsense"
    try:
        return Path.home() / ".cache" / "vsense"
    except RuntimeError:
        raise BuildError(
            "no home directory to keep builds in: set XDG_CACHE_HOME to a folder"
        ) from None


def compiler() -> list[str]:
    """The C compiler: `$CC` or `cc`.

    Raises:
        BuildError: it is not there; the message holds the line that installs one.
    """
    command = os.environ.get("CC", "cc").split() or ["cc"]
    if shutil.which(command[0]) is None:
        raise BuildError(f"no C compiler '{command[0]}'; install one with: {APT_LINE}")
    return command


def compile_daemon(tree: SourceTree, controller: Path, target: Path) -> None:
    """Compiles and links `vsensed` in one go and moves it into place whole.

    Raises:
        BuildError: the compiler is missing or refuses a source, or the folder cannot be written.
    """
    sources = map(str, (*tree.daemon_sources(), controller))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix="vsensed.", dir=target.parent)
    except OSError as error:
        raise BuildError(f"cannot build in {target.parent}: {error.strerror}") from error
    os.close(handle)
    try:
        _compile(tree, controller, ["-s", "-o", name, *sources, *LIBRARIES])
        os.chmod(name, 0o755)
        os.replace(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _compile(tree: SourceTree, controller: Path, arguments: list[str]) -> str:
    """Runs the compiler with our flags and these arguments; gives what it prints.

    Raises:
        BuildError: the compiler is missing, or refuses a source; the message says which.
    """
    result = _run([*compiler(), *CFLAGS, *tree.includes(), *arguments])
    if result.returncode != 0:
        said = result.stderr.strip()
        raise BuildError(f"{_blame(tree, controller, said)}:\n{said}")
    return result.stdout


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Runs a compiler; in a session of its own, since Ctrl-C is for the caller to handle."""
    return subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="surrogateescape",
        start_new_session=True,
    )


def _blame(tree: SourceTree, controller: Path, said: str) -> str:
    """Says which source the compiler's words are about; a linker's words name no line of one."""

    def is_named(path: Path) -> bool:
        return re.search(rf"(?:^|from ){re.escape(str(path))}:\d", said, re.M) is not None

    shipped = [str(path) for path in tree.daemon_sources() if is_named(path)]
    if shipped:
        return f"a source of vsensed itself does not build: {', '.join(shipped)}"
    if is_named(controller):
        return f"the controller {controller} does not build"
    return f"vsensed with the controller {controller} does not build"


def _fingerprint(tree: SourceTree, controller: Path) -> str:
    """Hash of the compiler, the flags and every source and header that goes into a build."""
    command = compiler()
    version = _run([*command, "--version"]).stdout
    digest = hashlib.sha256(f"{command}{version}{CFLAGS}{LIBRARIES}".encode())
    own = _dependencies(tree, controller)
    for path in (*tree.daemon_sources(), *tree.headers(), *own):
        digest.update(os.fsencode(path.name) + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:24]


def _dependencies(tree: SourceTree, controller: Path) -> list[Path]:
    """The controller's source and every header that it includes, but for the system's.

    Raises:
        BuildError: no compiler, or it does not find one of them.
    """
    rule = _compile(tree, controller, ["-MM", "-MT", "it", str(controller)])
    # A rule for make: its lines end in a backslash, and blanks in names have one before them.
    names = re.findall(r"(?:\\[ #]|\S)+", rule.replace("\\\n", " ").removeprefix("it:"))
    return [Path(re.sub(r"\\([ #])", r"\1", name).replace("$$", "$")) for name in names]
