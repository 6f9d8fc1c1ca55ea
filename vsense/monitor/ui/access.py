"""Access control: the Host and Origin of every request, and the token that it carries.

A page that other machines may open has two tokens: one to look, one to control.
"""

from __future__ import annotations

import hmac
import ipaddress
import os
import secrets
import socket
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from urllib.parse import urlsplit

from vsense.base import sharing
from vsense.base.errors import ConfigError, VsenseError
from vsense.base.files import check_private, open_bytes, read_open
from vsense.monitor.foxglove import FOXGLOVE_PORT

TOKEN_BYTES = 16
"""128 bits cannot be guessed."""
MIN_LENGTH = 8
"""Of a token that a person made up."""
_NAMES = ("look", "control")


class Rights(Enum):
    """What a viewer of the page may do."""

    NONE = "none"
    LOOK = "look"
    CONTROL = "control"


@dataclass(frozen=True, slots=True)
class WebAddress:
    """Where the page is served, and how.

    Attributes:
        host, port: the interface's address, and the port; 0 takes any free one.
        tokens: a file with the two tokens, see `read_tokens`; None: they are drawn.
        certificate, key: files for HTTPS; without a key the certificate's file has it. Without both
            a certificate is made where other machines may open the page.
        insecure: other machines may open it with plain HTTP.
    """

    host: str
    port: int
    tokens: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    insecure: bool = False


@dataclass(frozen=True, slots=True)
class FoxgloveAddress:
    """Where Foxglove is served: the interface's address and the port, 0 for any free one."""

    host: str = "127.0.0.1"
    port: int = FOXGLOVE_PORT

    def warnings(self) -> list[str]:
        """What people should know of who can look."""
        if is_loopback(self.host):
            return []
        return [
            f"Foxglove: any machine that reaches {self.host} can look: there are no tokens, and"
            " nothing is encrypted"
        ]


@dataclass(frozen=True, slots=True)
class Tokens:
    """What a viewer has to show: `look` to look, `control` to look and to give orders."""

    look: str = field(repr=False)
    control: str = field(repr=False)

    def rights(self, token: str) -> Rights:
        """The rights of a token; takes equally long for every wrong one."""
        shown = token.encode(errors="replace")
        control = hmac.compare_digest(shown, self.control.encode())
        look = hmac.compare_digest(shown, self.look.encode())
        if control:
            return Rights.CONTROL
        return Rights.LOOK if look else Rights.NONE


def make_tokens() -> Tokens:
    """Draws two tokens."""
    return Tokens(secrets.token_urlsafe(TOKEN_BYTES), secrets.token_urlsafe(TOKEN_BYTES))


PRIVATE_MODE = 0o750
"""Of a file with tokens or the page's key, the bits of its mode that it may have: nobody but the
owner changes it, and a group may read it."""


def read_tokens(path: Path) -> Tokens:
    """Reads tokens from a file of two lines, `look=...` and `control=...`; # begins a comment.

    Raises:
        VsenseError: the file cannot be read, or a token is missing.
        ConfigError: a line is something else; the message names it.
    """
    try:
        with open_bytes(path) as file:
            lines = read_open(file, path).decode().splitlines()
            check_private(file, path, "the tokens", PRIVATE_MODE)
    except OSError as error:
        raise VsenseError(f"{path}: cannot read the tokens: {error.strerror}") from error
    except UnicodeError as error:
        raise VsenseError(f"{path}: cannot read the tokens: not a text file") from error
    tokens: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if text and not text.startswith("#"):
            name, token = _token(text, str(path), number)
            if name in tokens:
                raise ConfigError(str(path), number, f"a second '{name}=' line")
            tokens[name] = token
    for name in _NAMES:
        if name not in tokens:
            raise VsenseError(f"{path}: no line '{name}=...': both tokens are needed")
    if tokens["look"] == tokens["control"]:
        raise VsenseError(
            f"{path}: look and control are the same token: users who only look would control"
        )
    return Tokens(tokens["look"], tokens["control"])


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


LOCAL_NAMES = frozenset({"localhost", "localhost.localdomain", "ip6-localhost"})


class Forbidden(Exception):
    """A request that is refused; the text says why, for people."""


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a server that listens there."""
    address = _address(host)
    return host.lower() in LOCAL_NAMES if address is None else address.is_loopback


class AccessControl:
    """Decides about requests to a server that listens on `host`, as it was configured.

    Viewers must show one of `tokens`; None admits all that pass the other checks. `secure`: it
    speaks HTTPS.
    """

    def __init__(self, host: str, port: int, tokens: Tokens | None, secure: bool) -> None:
        self._host = host.lower()
        self.tokens = tokens
        # A proxy before a server that speaks HTTP may speak HTTPS.
        self._schemes = ("https",) if secure else ("http", "https")
        self._local = is_loopback(host)
        # Cookies do not depend on ports: two servers on one machine must not share one.
        self.cookie = f"vsense_{port}"

    def check_host(self, headers: Mapping[str, str]) -> None:
        """Raises Forbidden for a Host that is not this server: a foreign name is an attack.

        Addresses cannot be rebound as names can, so any is accepted where other machines may come.
        """
        name = _name(headers.get("Host", ""))
        is_accepted = name == self._host or is_loopback(name)
        if not self._local and not is_accepted:
            is_accepted = _address(name) is not None or name in _own_names()
        if not is_accepted:
            raise Forbidden(
                f"this server is not '{name}': open it by the address that vsense printed"
            )

    def check_origin(self, headers: Mapping[str, str], needed: bool) -> None:
        """Raises Forbidden for other pages; where `needed`, for a request without Origin, too."""
        origin = headers.get("Origin")
        if origin is None and not needed:
            return
        if origin is None:
            raise Forbidden("a WebSocket needs an Origin header that names this server")
        try:
            parts = urlsplit(origin)
            same = parts.netloc.lower() == headers.get("Host", "").lower()
        except ValueError:
            same = False
        if not same or parts.scheme not in self._schemes:
            raise Forbidden(f"the page '{origin:.80}' may not talk to this server")

    def check_account(self, peer: tuple[str, int], server: tuple[str, int]) -> None:
        """Raises Forbidden for a page without tokens that another account of this machine opens.

        `peer` and `server` are the two ends of its connection. Control is this account's, root's,
        and that of the lab's members.
        """
        if self.tokens is not None:
            return
        uid = account_of(peer, server)
        if uid is None or (uid not in (0, os.getuid()) and not sharing.is_fellow(uid)):
            who = "an account that is not known" if uid is None else sharing.user_name(uid)
            raise Forbidden(
                f"this page is {sharing.user_name()}'s, and not for {who}: with"
                " --web-tokens FILE users with a token may come in"
            )

    def rights(self, token: str | None, cookies: Mapping[str, str]) -> Rights:
        """The rights of a request, by the token in its address or else by that in its cookies."""
        if self.tokens is None:
            return Rights.CONTROL
        return self.tokens.rights(cookies.get(self.cookie, "") if token is None else token)


def account_of(peer: tuple[str, int], server: tuple[str, int]) -> int | None:
    """The account whose program has the other end of a connection on this machine.

    Source: Linux, Documentation/networking/proc_net_tcp.rst: addresses are words of 32 bits in
    the machine's byte order. None: the connection is not there any more.
    """
    wanted = {(_in_kernel(*peer, mapped), _in_kernel(*server, mapped)) for mapped in (False, True)}
    for table in ("tcp", "tcp6"):
        try:
            rows = Path(f"/proc/net/{table}").read_text(encoding="utf-8").splitlines()[1:]
        except OSError:
            continue
        for row in rows:
            words = row.split()
            if (words[1], words[2]) in wanted:
                return int(words[7])
    return None


def _in_kernel(host: str, port: int, mapped: bool) -> str:
    """An address and port as /proc/net has them; `mapped`: an IPv4 address as one of IPv6."""
    address = ipaddress.ip_address(host.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped is not None:
        address = address.ipv4_mapped
    data = address.packed
    if mapped and len(data) == 4:
        data = bytes(10) + b"\xff\xff" + data
    words = struct.unpack(f"={len(data) // 4}I", data)
    return f"{''.join(f'{word:08X}' for word in words)}:{port:04X}"


def _name(host: str) -> str:
    """The name or address in a Host header, without port and brackets."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return None


def own_address() -> str:
    """This machine's address for others; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


def _own_names() -> set[str]:
    """This machine's names, without a lookup."""
    own = socket.gethostname().lower()
    return {own, own.partition(".")[0], f"{own.partition('.')[0]}.local"}
