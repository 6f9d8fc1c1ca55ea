"""Whether a robot is there, and whether UDP reaches it: judged from times alone.

Two kinds of silence look alike at first: a robot that is gone, and one whose datagrams are
blocked. The second is told from the first by what still comes over TCP; and a robot that has
just been welcomed may spend a whole second on trying UDP before TCP says anything.
"""

from __future__ import annotations

from vsense.link.peer import Peer
from vsense.link.status import EventKind

SILENCE_NS = 1_000_000_000
"""A robot that was not heard for this long is lost, and its tag is free for another one."""

Change = tuple[EventKind, str]
"""What has changed, and how to say it."""


class Presence:
    """What is known of one robot's being there, over all its sessions.

    Attributes:
        since_ns: when the newest session opened, host's clock; None before the first.
        heard_ns: when the newest valid packet came, same clock.
        lost: the open session has fallen silent, and that was told.
        left: the robot said goodbye after its newest session.
    """

    def __init__(self) -> None:
        self.since_ns: int | None = None
        self.heard_ns: int | None = None
        self.lost = False
        self.left = False
        self._udp = True

    def open(self, now_ns: int) -> None:
        """A session opens."""
        self.since_ns = self.heard_ns = now_ns
        self.lost = self.left = False
        self._udp = True

    def holds(self, now_ns: int) -> bool:
        """Whether the robot holds its tag against others: it was just heard and did not leave."""
        return not self.left and self._recent(now_ns)

    def hear(self, peer: Peer, now_ns: int) -> list[Change]:
        """A packet of the open session was accepted."""
        self.heard_ns = now_ns
        changes: list[Change] = [("back", "heard again")] if self.lost else []
        self.lost = False
        return changes + self._watch_udp(peer, now_ns)

    def tick(self, peer: Peer, now_ns: int) -> list[Change]:
        """Time has passed in the open session."""
        if self.lost:
            return []
        changes = self._watch_udp(peer, now_ns)
        if now_ns - self._counted_from_ns(peer) >= SILENCE_NS:
            self.lost = True
            changes.append(("lost", "nothing heard for 1 s"))
        return changes

    def _recent(self, now_ns: int) -> bool:
        return self.heard_ns is not None and now_ns - self.heard_ns < SILENCE_NS

    def _counted_from_ns(self, peer: Peer) -> int:
        """Since when silence counts: the first second belongs to the attempt at UDP."""
        assert self.heard_ns is not None and self.since_ns is not None
        if peer.udp_heard:
            return self.heard_ns
        return max(self.heard_ns, self.since_ns + SILENCE_NS)

    def _watch_udp(self, peer: Peer, now_ns: int) -> list[Change]:
        udp = not peer.over_tcp(now_ns)
        if udp == self._udp:
            return []
        if not udp and peer.udp_heard and not self._recent(now_ns):
            return []  # silent on every way: that is another matter
        self._udp = udp
        if udp:
            return [("udp_back", "UDP works again")]
        who = "no UDP from it" if peer.udp_silent(now_ns) else "it hears no UDP from us"
        return [("no_udp", f"{who} for 1 s: state goes over TCP")]
