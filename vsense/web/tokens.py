"""The two secrets of a page that other machines may open: one to look, one to control."""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from vsense.errors import ConfigError, VsenseError

TOKEN_BYTES = 16
"""128 bits: nobody finds one by trying."""
MIN_LENGTH = 8
"""Of a token that a person thought up."""
_NAMES = ("look", "control")


class Rights(Enum):
    """What somebody who opened the page may do."""

    NONE = "none"
    LOOK = "look"
    CONTROL = "control"


@dataclass(frozen=True, slots=True)
class Tokens:
    """What a viewer has to show.

    Attributes:
        look: lets look.
        control: lets look and press.
    """

    look: str = field(repr=False)
    control: str = field(repr=False)

    def rights(self, token: str) -> Rights:
        """What a token gives; takes equally long for every wrong one."""
        shown = token.encode(errors="replace")
        control = hmac.compare_digest(shown, self.control.encode())
        look = hmac.compare_digest(shown, self.look.encode())
        if control:
            return Rights.CONTROL
        return Rights.LOOK if look else Rights.NONE


def make_tokens() -> Tokens:
    """Draws two tokens that nobody guesses."""
    return Tokens(secrets.token_urlsafe(TOKEN_BYTES), secrets.token_urlsafe(TOKEN_BYTES))


def read_tokens(path: Path) -> Tokens:
    """Reads tokens from a file of two lines, `look=...` and `control=...`; # begins a comment.

    Raises:
        VsenseError: the file cannot be read, or a token is missing.
        ConfigError: a line is something else; the message names it.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise VsenseError(f"{path}: cannot read the tokens: {error.strerror}") from error
    except UnicodeError as error:
        raise VsenseError(f"{path}: cannot read the tokens: not a text file") from error
    found: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if text and not text.startswith("#"):
            name, token = _token(text, str(path), number)
            if name in found:
                raise ConfigError(str(path), number, f"a second '{name}=' line")
            found[name] = token
    for name in _NAMES:
        if name not in found:
            raise VsenseError(f"{path}: no line '{name}=...': both tokens are needed")
    if found["look"] == found["control"]:
        raise VsenseError(
            f"{path}: look and control are the same token: whoever looks would control"
        )
    return Tokens(found["look"], found["control"])


def _token(text: str, file: str, line: int) -> tuple[str, str]:
    """Splits one line; the token itself stays out of error messages."""
    name, equals, token = (part.strip() for part in text.partition("="))
    if not equals or name not in _NAMES:
        raise ConfigError(file, line, "expected 'look=...' or 'control=...'")
    plain = token.isascii() and token.isprintable() and not set(token) & set(' ";,\\')
    if len(token) < MIN_LENGTH or not plain:
        expected = f"at least {MIN_LENGTH} letters, digits or signs, without spaces, quotes, ; , \\"
        raise ConfigError(file, line, f"the {name} token is not usable: expected {expected}")
    return name, token
