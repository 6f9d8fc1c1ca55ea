"""A network of their own for some robots: a namespace each, all on one bridge, as on Wi-Fi."""

from __future__ import annotations

from tests.rigs.namespaces import Namespaces

NET = "10.213.77"
HOST = f"{NET}.1"


class Networks(Namespaces):
    """Namespaces with an address each; the host is at `HOST`."""

    def __init__(self, robots: list[int]) -> None:
        """Makes them; skips the test (under CI: fails it) where that is not allowed."""
        super().__init__("vsb", NET, "wlan0", {tag: 10 + n for n, tag in enumerate(robots)})

    def restore(self, tag: int) -> None:
        """Has a robot back on the air, with another address than before."""
        self.renumber(tag, self._numbers[tag] + 100)
        super().restore(tag)
