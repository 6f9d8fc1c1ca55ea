"""The errors that a user can meet; each carries one clear line and an exit code."""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

EXTRAS = {
    "aiohttp": "web",
    "anywidget": "notebook",
    "argcomplete": "completion",
    "cryptography": "https",
    "cyclonedds": "ros2",
    "distributed": "cluster",
    "foxglove": "foxglove",
    "lupa": "lua",
    "matplotlib": "report",
    "mcap": "record",
    "motioncapture": "mocap",
    "optuna": "optimize",
    "pandas": "tables",
    "pettingzoo": "learn",
    "pyarrow": "tables",
    "rosbags": "rosbag",
    "scipy": "report",
    "serial": "thymio",
    "thymiodirect": "thymio",
    "zenoh": "nodes",
    "ziglang": "robot",
    "zstandard": "record",
}
"""The optional Python packages, and the extra of vsense that installs each."""


class VsenseError(Exception):
    """Something a user can mend; `str()` is the whole message.

    `exit_code` is the command's: 1 failed, 2 wrong usage or input.
    """

    exit_code = 1


class GrabberError(VsenseError):
    """No picture came in time, or none will come."""


class NoMorePictures(GrabberError):
    """A recording has ended."""


class UsageError(VsenseError):
    """A wrong argument or name on the command line."""

    exit_code = 2


class Interrupted(Exception):
    """The user has ended the runs."""


class CutShort(KeyboardInterrupt):
    """A signal has ended the command before it did anything; `exit_code` says which.

    No VsenseError: what says that something has failed must not say so of this.
    """

    def __init__(self, exit_code: int) -> None:
        super().__init__(exit_code)
        self.exit_code = exit_code


class NeverReturned(VsenseError):
    """Users' code that a signal had to end; `exit_code` says which."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class ConfigError(VsenseError):
    """A configuration file, as the user named it, that is wrong in a line, counted from 1."""

    exit_code = 2

    def __init__(self, file: str, line: int, message: str) -> None:
        super().__init__(f"{file}:{line}: {message}")
        self.file = file
        self.line = line
        self.message = message


_LISTED = 120
_ALIKE, _VERY_ALIKE = 0.6, 0.75
_BEGUN = 3
"""So many letters of a name say which one is meant."""


def _begins(name: str, other: str) -> bool:
    return name.startswith(other) or other.startswith(name)


def _meant(name: str, choices: Iterable[str], most: int, alike: float) -> str:
    """Asks whether one of at most so many names that are alike is meant; "": none is."""
    import difflib  # for errors only: no command waits for it

    return _asked(difflib.get_close_matches(name, sorted(set(choices)), most, alike))


def _asked(names: Sequence[str]) -> str:
    return f"is {' or '.join(map(repr, names))} meant?" if names else ""


def likely(missing: str, present: Iterable[str]) -> str:
    """Points to a present name that looks like a misspelling of the missing one."""
    asked = _meant(missing, present, 1, _VERY_ALIKE)
    return f" ({asked})" if asked else ""


def instead(name: str, choices: Iterable[str], say: str = "there are") -> str:
    """Says what may be meant by a name that is not known: the nearest few, or some of all."""
    names = sorted(set(choices))
    # `simulate` for `sim`, `for` for `foraging`: what the one has begun, the other goes on with.
    begun = [n for n in names if min(len(n), len(name)) >= _BEGUN and _begins(n, name)]
    asked = _meant(name, names, 3, _ALIKE) or _asked(begun[:3])
    if asked:
        return asked
    more = f" and {len(names) - _LISTED} others" if len(names) > _LISTED else ""
    return f"{say}: {', '.join(names[:_LISTED]) or 'none'}{more}"


@contextmanager
def failing_as(
    kind: type[VsenseError], what: str, damage: tuple[type[Exception], ...] = ()
) -> Iterator[None]:
    """Raises `kind` in place of an OSError or of `damage`: `what` failed, and the reason."""
    try:
        yield
    except OSError as error:
        raise kind(f"{what}: {error.strerror or error}") from None
    except damage as error:
        words = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise kind(f"{what}: {words}") from None


def pip_line(package: str) -> str:
    """The command that installs an optional package, and what else its extra has.

    It names the packages and not the extra: so it is the same for a checkout, a wheel and an index.
    """
    from importlib import metadata  # takes as long to load as all else that a command begins with

    extra = f"extra == '{EXTRAS[package]}'"
    wanted = [package]
    with suppress(metadata.PackageNotFoundError):
        pairs = (line.partition(";") for line in metadata.requires("vsense") or ())
        wanted = [name.strip() for name, _, on in pairs if on.strip().replace('"', "'") == extra]
    return f"{_pip()} install {' '.join(map(_quoted, wanted or [package]))}"


def _pip() -> str:
    """The pip of this Python: its name, where that is the one that a shell would find."""
    beside = Path(sys.executable).with_name("pip")
    return "pip" if shutil.which("pip") == str(beside) else f"{sys.executable} -m pip"


def _quoted(requirement: str) -> str:
    """A requirement as a word of a shell."""
    return f"'{requirement}'" if re.search(r"[<>\[]", requirement) else requirement


def require(who: str, *packages: str) -> None:
    """Raises UsageError unless `packages`, keys of `EXTRAS`, are installed; they are not imported.

    The message begins with `who`, such as "recordings need", and says how to install one.
    """
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise UsageError(_missing(who, package))


def lacking(who: str, error: ModuleNotFoundError) -> ModuleNotFoundError:
    """Names, as `require` does, the optional package that an import lacks; else gives `error`."""
    package = error.name or ""
    if package not in EXTRAS:
        return error
    return ModuleNotFoundError(_missing(who, package), name=package)


def _missing(who: str, package: str) -> str:
    return f"{who} the Python package {package}: {pip_line(package)}"
