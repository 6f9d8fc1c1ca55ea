"""Who may come in: the Host and Origin of every request, and the token that it carries."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Mapping
from urllib.parse import urlsplit

from vsense.web.tokens import Rights, Tokens

LOCAL_NAMES = frozenset({"localhost", "localhost.localdomain", "ip6-localhost"})


class Stranger(Exception):
    """A request that is refused; the text says why, for people."""


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a server that listens there."""
    address = _address(host)
    return host.lower() in LOCAL_NAMES if address is None else address.is_loopback


class Gate:
    """Decides about requests; holds no state of its own."""

    def __init__(self, host: str, port: int, tokens: Tokens | None) -> None:
        """Prepares it.

        Args:
            host: what the server listens on, as it was configured.
            port: the port.
            tokens: what viewers must show; None lets everybody in who passes the other checks.
        """
        self._host = host.lower()
        self._tokens = tokens
        self._local = is_loopback(host)
        # Cookies know no ports: two servers on one machine must not share one.
        self.cookie = f"vsense_{port}"

    @property
    def needs_token(self) -> bool:
        """Whether viewers must show a token."""
        return self._tokens is not None

    def check_host(self, headers: Mapping[str, str]) -> None:
        """Refuses names that are not this server's: a foreign name that leads here is an attack.

        Addresses cannot be rebound as names can, so any is good where other machines may come.

        Raises:
            Stranger: the Host header names something else.
        """
        name = _name(headers.get("Host", ""))
        known = name == self._host or is_loopback(name)
        if not self._local and not known:
            known = _address(name) is not None or name in _own_names()
        if not known:
            raise Stranger(
                f"this server is not '{name}': open it by the address that vsense printed"
            )

    def check_origin(self, headers: Mapping[str, str], needed: bool) -> None:
        """Refuses what a page from elsewhere sends.

        Args:
            headers: of the request.
            needed: whether a request without Origin is refused, too.

        Raises:
            Stranger: the request comes from another page.
        """
        origin = headers.get("Origin")
        if origin is None and not needed:
            return
        if origin is None:
            raise Stranger("a WebSocket needs an Origin header that names this server")
        try:
            parts = urlsplit(origin)
            same = parts.netloc.lower() == headers.get("Host", "").lower()
        except ValueError:
            same = False
        if not same or parts.scheme not in ("http", "https"):
            raise Stranger(f"the page '{origin:.80}' may not talk to this server")

    def rights(self, token: str | None, cookies: Mapping[str, str]) -> Rights:
        """What a request may do.

        Args:
            token: the one in its address, None without.
            cookies: those it brings; a token in the address goes before them.
        """
        if self._tokens is None:
            return Rights.CONTROL
        return self._tokens.rights(cookies.get(self.cookie, "") if token is None else token)


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


def _own_names() -> set[str]:
    """What this machine calls itself; nobody is asked for it."""
    own = socket.gethostname().lower()
    return {own, own.partition(".")[0], f"{own.partition('.')[0]}.local"}
