"""The errors that a user can meet; each carries one clear line and an exit code."""

from __future__ import annotations


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
