"""Network namespaces on one bridge: machines of their own, as far as the network can tell."""

from __future__ import annotations

import os
import socket
import subprocess
from collections.abc import Mapping

from tests.conftest import lack, require_tool


class FreeNet:
    """A net that no other test on this machine has, until it is closed.

    Attributes:
        net: The first three numbers of its addresses.
    """

    def __init__(self, first_two: str) -> None:
        """Finds one, such as 10.214.3 of 10.214.

        An abstract Unix socket is the mark that it is taken: the system takes it away with the
        process, and it is as wide as the network that the nets belong to.
        """
        ip = require_tool("ip", "iproute2")
        shown = subprocess.run([ip, "-4", "-o", "addr"], capture_output=True, text=True, check=True)
        self._mark = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        for number in range(1, 255):
            self.net = f"{first_two}.{number}"
            # A run that was killed leaves its bridge behind, but no mark.
            if f" {self.net}." not in shown.stdout and self._marked():
                return
        self._mark.close()
        raise AssertionError(f"no net of {first_two} is free")

    def close(self) -> None:
        """Lets others have it."""
        self._mark.close()

    def _marked(self) -> bool:
        try:
            self._mark.bind(f"\0vsense-test-{self.net}")
        except OSError:
            return False
        return True


class Namespaces:
    """Namespaces with an address each, on a bridge of the host.

    Attributes:
        host: The host's address.
    """

    def __init__(self, prefix: str, net: str, inside: str, numbers: Mapping[int, int]) -> None:
        """Makes them; skips the test (under CI: fails it) where that is not allowed.

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
        self._bridge = f"{prefix}{os.getpid()}"
        made = self._try("link", "add", self._bridge, "type", "bridge")
        if "not permitted" in made.stderr:
            lack(f"no network namespaces here: {made.stderr.strip()}")
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
