"""Strangers on a port: how many may be connected, and how little is told of them.

A stranger is a peer that has not shown yet who it is. Every port has its own limits, so that a
flood on one costs the others nothing. Whoever has waited longest makes way for a newcomer: real
peers say who they are at once, and are strangers for milliseconds only. What strangers do is told
in one line, and then only counted.

Every connection needs a file descriptor. Those of robots and of the process itself are kept free;
what servers give to strangers and pages is limited so that the sum of all stays below the rest.
"""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Callable, Hashable, Iterator
from typing import Generic, TypeVar

SUMMARY_PERIOD_NS = 10_000_000_000
"""What is counted is told once in this time."""

LINES_MAX = 20
"""Different lines that are told of peers that may be strangers, before they are only counted."""

ADDRESSES_MAX = 256
"""Different addresses that are counted in a period; those of more are not told apart."""

DELAY_MAX_S = 2.0
"""Nobody waits longer for the turn of a request, however many have come before."""

PREFIX_BITS = 64
"""One host of IPv6 has all addresses that begin with the same bits."""

PlaceHolder = TypeVar("PlaceHolder", bound=Hashable)


class StrangerLog:
    """Tells what strangers do on one port; its methods are for one thread.

    Args:
        port: its name for people, such as "port 4050".
        say: takes a line for a person; must not wait.
    """

    def __init__(self, port: str, say: Callable[[str], None]) -> None:
        self._port = port
        self._say = say
        self._until_ns = self._lines = 0
        self._reported: set[str] = set()
        self._deeds: Counter[str] = Counter()
        self._origins: Counter[str] = Counter()

    def note(self, origin: str, deed: str, now_ns: int) -> None:
        """A stranger from an address did something, at a time of the host's monotonic clock.

        `deed` is one of a few fixed phrases, never a text of the stranger's.
        """
        self.tick(now_ns)
        if deed in self._reported:
            self.count(origin, deed, now_ns)
            return
        self._begin(now_ns)
        self._reported.add(deed)
        self._say(f"{self._port}: {origin}: {deed}")

    def say(self, origin: str, text: str, deed: str, now_ns: int) -> None:
        """Tells something in its own words, `LINES_MAX` times in a period; then it is counted."""
        self.tick(now_ns)
        if self._lines >= LINES_MAX:
            self.count(origin, deed, now_ns)
            return
        self._begin(now_ns)
        self._lines += 1
        self._say(text)

    def count(self, origin: str, deed: str, now_ns: int) -> None:
        """As `note`, of something that was told already, in other words perhaps."""
        self.tick(now_ns)
        self._begin(now_ns)
        self._deeds[deed] += 1
        if origin in self._origins or len(self._origins) < ADDRESSES_MAX:
            self._origins[origin] += 1

    def tick(self, now_ns: int) -> None:
        """Tells what was counted, where a period is over; to be called every second or so."""
        if not self._until_ns or now_ns < self._until_ns:
            return
        if not self._deeds:
            self._reported.clear()
            self._until_ns = self._lines = 0
            return
        deeds = ", ".join(f"{deed} ({count})" for deed, count in self._deeds.most_common())
        self._say(
            f"{self._port}: {self._deeds.total()} more from {self._sources()} in the last"
            f" {SUMMARY_PERIOD_NS // 10**9} s: {deeds}"
        )
        self._deeds.clear()
        self._origins.clear()
        self._until_ns = now_ns + SUMMARY_PERIOD_NS

    def _begin(self, now_ns: int) -> None:
        self._until_ns = self._until_ns or now_ns + SUMMARY_PERIOD_NS

    def _sources(self) -> str:
        (origin, _), more = self._origins.most_common(1)[0], len(self._origins) - 1
        if not more:
            return origin
        return f"{origin} and {more} other address{'es' if more > 1 else ''}"


class PortPlaces(Generic[PlaceHolder]):
    """The places of a port: limited in all and for each owner, usually an address.

    Args:
        most: places in all.
        most_each: of one owner.
    """

    def __init__(self, most: int, most_each: int) -> None:
        self._most, self._most_each = most, min(most, most_each)
        self._owners: dict[PlaceHolder, Hashable] = {}
        self._counts: Counter[Hashable] = Counter()

    def __len__(self) -> int:
        return len(self._owners)

    def __iter__(self) -> Iterator[PlaceHolder]:
        """All that have a place, who has waited longest first."""
        return iter(list(self._owners))

    def __contains__(self, item: PlaceHolder) -> bool:
        return item in self._owners

    def add(self, item: PlaceHolder, owner: Hashable) -> PlaceHolder | None:
        """Gives a place; returns who has lost its own to it, if anybody has.

        It is the one that has waited longest: of the same owner, or if all places are taken, of the
        owner that has most of them.
        """
        loser = None
        if self._counts[owner] >= self._most_each:
            loser = self._oldest(owner)
        elif len(self._owners) >= self._most:
            loser = self._oldest(self._counts.most_common(1)[0][0])
        if loser is not None:
            self.remove(loser)
        self._owners[item] = owner
        self._counts[owner] += 1
        return loser

    def renew(self, item: PlaceHolder) -> None:
        """Counts one that has a place as the newest."""
        if item in self._owners:
            self._owners[item] = self._owners.pop(item)

    def remove(self, item: PlaceHolder) -> None:
        """Frees a place; nothing happens where it has none."""
        if item not in self._owners:
            return
        owner = self._owners.pop(item)
        self._counts[owner] -= 1
        if not self._counts[owner]:
            del self._counts[owner]

    def _oldest(self, owner: Hashable) -> PlaceHolder:
        return next(item for item, other in self._owners.items() if other == owner)


class RateLimit:
    """How often each owner may ask for something: `burst` times at once, then `rate_hz`."""

    def __init__(self, rate_hz: float, burst: int) -> None:
        self._period_s = 1.0 / rate_hz
        self._burst_s = burst / rate_hz
        self._until_s: dict[Hashable, float] = {}

    def delay_s(self, owner: Hashable, now_s: float) -> float:
        """Counts one more; gives how long it has to wait."""
        if len(self._until_s) >= ADDRESSES_MAX:
            self._until_s = {key: until for key, until in self._until_s.items() if until > now_s}
        until_s = max(self._until_s.get(owner, 0.0), now_s) + self._period_s
        until_s = min(until_s, now_s + self._burst_s + DELAY_MAX_S)
        self._until_s[owner] = until_s
        return max(until_s - self._burst_s - now_s, 0.0)


def owner_of(address: str) -> str:
    """Whom an address counts for: one of IPv6 for its network, as each host has many."""
    import ipaddress  # no command that has no port waits for it

    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(ip, ipaddress.IPv4Address):
        return str(ip)
    if ip.ipv4_mapped is not None:
        return str(ip.ipv4_mapped)
    return str(ipaddress.ip_network((ip, PREFIX_BITS), strict=False))


MAX_DESCRIPTORS = 65_536
"""No higher limit is asked for: programs that close every descriptor that they could have, among
those that this one starts, take long with the billion that some systems allow."""

ROBOT_DESCRIPTORS = 100
"""Kept for robots."""

OWN_DESCRIPTORS = 96
"""Kept for cameras, recordings, logs and pipes."""

STRANGER_DESCRIPTORS = 512
"""More than what all ports together give to strangers and to pages, where nothing is scarce."""

MIN_PLACES = 4
"""Places that every port has, however low the limit is."""

PAUSE_S = 0.25
"""After an accept that failed for want of descriptors the next one is tried this much later: the
listener would be ready for ever."""


def raise_limit() -> int:
    """Raises the limit of this process as far as it may; gives it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, MAX_DESCRIPTORS)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return limit()


def limit() -> int:
    """How many descriptors this process may have."""
    soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return MAX_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft


def places(wanted: int) -> int:
    """How many of the `wanted` connections a port may give to strangers or pages.

    All of them, unless the limit is low: then their share, and at least `MIN_PLACES`.
    """
    share = (limit() - ROBOT_DESCRIPTORS - OWN_DESCRIPTORS) / STRANGER_DESCRIPTORS
    return wanted if share >= 1.0 else max(min(MIN_PLACES, wanted), int(wanted * share))


def shortage() -> str:
    """What to say where the limit is low, "" where it is not."""
    if places(STRANGER_DESCRIPTORS) == STRANGER_DESCRIPTORS:
        return ""
    return (
        f"this process may open {limit()} files only: fewer pages and unknown peers at a time;"
        f" 'ulimit -n {ROBOT_DESCRIPTORS + OWN_DESCRIPTORS + STRANGER_DESCRIPTORS}' mends that"
    )
