"""Network namespaces on one bridge: machines of their own, as far as the network can tell."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping

import pytest

from tests.conftest import require_tool


class Namespaces:
    """Namespaces with an address each, on a bridge of the host.

    Attributes:
        host: The host's address.
    """

    def __init__(self, prefix: str, net: str, inside: str, numbers: Mapping[int, int]) -> None:
        """Makes them; skips the test where that is not allowed.

        Args:
            prefix: Three letters that begin all names.
            net: The first three numbers of all addresses.
            inside: The interface's name in each namespace.
            numbers: The last number of the address of each member, by member.
        """
        self._ip = require_tool("ip", "iproute2")
        self.host = f"{net}.1"
        self._net, self._inside = net, inside
        self._numbers = dict(numbers)
        self._bridge = f"{prefix}{os.getpid() % 100000}"
        made = self._try("link", "add", self._bridge, "type", "bridge")
        if "not permitted" in made.stderr:
            pytest.skip(f"no network namespaces here: {made.stderr.strip()}")
        assert made.returncode == 0, made.stderr
        try:
            self._do("addr", "add", f"{self.host}/24", "brd", "+", "dev", self._bridge)
            self._do("link", "set", self._bridge, "up")
            for member in numbers:
                self._make(member)
        except AssertionError:
            self.close()
            raise

    def command(self, member: int) -> tuple[str, ...]:
        """What a program in a member's network begins with."""
        return (self._ip, "netns", "exec", self._space(member))

    def address(self, member: int) -> str:
        """A member's address."""
        return self.number(self._numbers[member])

    def number(self, number: int) -> str:
        """The address in this network that ends with a number."""
        return f"{self._net}.{number}"

    def cut(self, member: int) -> None:
        """Pulls a member's cable."""
        self._do("link", "set", self._outer(member), "down")

    def restore(self, member: int) -> None:
        """Plugs it in again."""
        self._do("link", "set", self._outer(member), "up")

    def renumber(self, member: int, number: int) -> None:
        """Gives a member another address, the last number of which this is."""
        inside = ("-n", self._space(member))
        self._numbers[member] = number
        self._do(*inside, "addr", "flush", "dev", self._inside)
        self._do(*inside, "addr", "add", *self._cidr(member), "dev", self._inside)

    def forget(self) -> None:
        """Has the host ask anew who has which address; by itself it does so after ten seconds."""
        self._do("neigh", "flush", "dev", self._bridge)

    def set_mtu(self, size_bytes: int) -> None:
        """Has all interfaces carry packets of up to this size."""
        for member in self._numbers:
            self._do("link", "set", self._outer(member), "mtu", str(size_bytes))
            inside = ("-n", self._space(member), "link", "set", self._inside)
            self._do(*inside, "mtu", str(size_bytes))

    def close(self) -> None:
        """Takes everything away."""
        for member in self._numbers:
            # A namespace ends some time after it was told to, and its cable with it.
            self._try("link", "del", self._outer(member))
            self._try("netns", "del", self._space(member))
        self._try("link", "del", self._bridge)

    def _make(self, member: int) -> None:
        space, outer = self._space(member), self._outer(member)
        inner = ("peer", "name", self._inside, "netns", space)
        self._do("netns", "add", space)
        self._do("link", "add", outer, "type", "veth", *inner)
        self._do("link", "set", outer, "master", self._bridge, "up")
        self._do("-n", space, "addr", "add", *self._cidr(member), "dev", self._inside)
        self._do("-n", space, "link", "set", self._inside, "up")

    def _cidr(self, member: int) -> tuple[str, ...]:
        """Without a broadcast address nobody there hears a camera being looked for."""
        return f"{self.address(member)}/24", "brd", "+"

    def _space(self, member: int) -> str:
        return f"{self._bridge}-{member}"

    def _outer(self, member: int) -> str:
        """The host's end of the cable; an interface's name holds 15 characters."""
        return f"{self._bridge}x{list(self._numbers).index(member)}"

    def _try(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([self._ip, *words], capture_output=True, text=True, check=False)

    def _do(self, *words: str) -> None:
        done = self._try(*words)
        assert done.returncode == 0, f"ip {' '.join(words)}: {done.stderr}"
