"""A network of their own for some robots: a namespace each, all on one bridge, as on Wi-Fi."""

from __future__ import annotations

import os
import subprocess

import pytest

from tests.conftest import require_tool

NET = "10.213.77"
HOST = f"{NET}.1"


class Networks:
    """Namespaces with an address each; the host is at `HOST`."""

    def __init__(self, robots: list[int]) -> None:
        """Makes them; skips the test where that is not allowed."""
        self._ip = require_tool("ip", "iproute2")
        self._bridge = f"vsb{os.getpid() % 100000}"
        self._spaces = {tag: f"{self._bridge}-{tag}" for tag in robots}
        self._numbers = {tag: 10 + n for n, tag in enumerate(robots)}
        made = subprocess.run(
            [self._ip, "link", "add", self._bridge, "type", "bridge"],
            capture_output=True,
            text=True,
        )
        if made.returncode != 0:
            pytest.skip(f"no network namespaces here: {made.stderr.strip()}")
        self._do("addr", "add", f"{HOST}/24", "dev", self._bridge)
        self._do("link", "set", self._bridge, "up")
        for tag in robots:
            self._make(tag)

    def command(self, tag: int) -> tuple[str, ...]:
        """What a program in a robot's network begins with."""
        return (self._ip, "netns", "exec", self._spaces[tag])

    def cut(self, tag: int) -> None:
        """Takes a robot off the air."""
        self._do("link", "set", self._outer(tag), "down")

    def restore(self, tag: int) -> None:
        """Has a robot back on the air, with another address than before."""
        inside = ("-n", self._spaces[tag])
        self._do(*inside, "addr", "flush", "dev", "wlan0")
        self._numbers[tag] += 100
        self._do(*inside, "addr", "add", f"{NET}.{self._numbers[tag]}/24", "dev", "wlan0")
        self._do("link", "set", self._outer(tag), "up")

    def close(self) -> None:
        """Takes everything away."""
        for space in self._spaces.values():
            subprocess.run([self._ip, "netns", "del", space], capture_output=True, check=False)
        subprocess.run([self._ip, "link", "del", self._bridge], capture_output=True, check=False)

    def _make(self, tag: int) -> None:
        space, outer = self._spaces[tag], self._outer(tag)
        self._do("netns", "add", space)
        self._do("link", "add", outer, "type", "veth", "peer", "name", "wlan0", "netns", space)
        self._do("link", "set", outer, "master", self._bridge, "up")
        self._do("-n", space, "addr", "add", f"{NET}.{self._numbers[tag]}/24", "dev", "wlan0")
        self._do("-n", space, "link", "set", "wlan0", "up")

    def _outer(self, tag: int) -> str:
        return f"vsv{self._numbers[tag] % 100}x{os.getpid() % 100000}"

    def _do(self, *words: str) -> None:
        done = subprocess.run([self._ip, *words], capture_output=True, text=True)
        assert done.returncode == 0, f"ip {' '.join(words)}: {done.stderr}"
