"""The errors that a user can meet; each carries one clear line and an exit code."""

from __future__ import annotations

import importlib.util

EXTRAS = {
    "aiohttp": "web",
    "matplotlib": "report",
    "mcap": "record",
    "ziglang": "robot",
    "zstandard": "record",
}
"""The optional Python packages, and the extra of vsense that installs each."""


class VsenseError(Exception):
    """Something a user can mend; `str()` is the whole message.

    Attributes:
        exit_code: what the command exits with: 1 failed, 2 wrong usage or input.
    """

    exit_code = 1


class UsageError(VsenseError):
    """A wrong argument or name on the command line."""

    exit_code = 2


class ConfigError(VsenseError):
    """A configuration file that cannot be used as it is.

    Attributes:
        file: the file as the user named it.
        line: line in that file, counted from 1.
        message: what was found there and what was expected.
    """

    exit_code = 2

    def __init__(self, file: str, line: int, message: str) -> None:
        super().__init__(f"{file}:{line}: {message}")
        self.file = file
        self.line = line
        self.message = message


def pip_line(package: str) -> str:
    """Returns the command that installs an optional package."""
    return f"pip install 'vsense[{EXTRAS[package]}]'"


def require(who: str, *packages: str) -> None:
    """Checks that optional packages are installed, before anything imports them.

    Args:
        who: begins the message, such as "recordings need".
        packages: keys of `EXTRAS`.

    Raises:
        UsageError: one is not installed; the message says how to install it.
    """
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise UsageError(f"{who} the Python package {package}: {pip_line(package)}")
