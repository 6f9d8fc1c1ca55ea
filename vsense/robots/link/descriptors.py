"""File descriptors: how many this process may have, and who may use how many of them.

Every connection needs one. Those of robots and of the process itself are kept free; what servers
give to strangers and pages is limited so that the sum of all stays below the rest.
"""

from __future__ import annotations

import resource

MOST = 65_536
"""No higher limit is asked for: programs that close every descriptor that they could have, among
those that this one starts, take long with the billion that some systems allow."""

ROBOTS = 100
"""Kept for robots."""

OWN = 96
"""Kept for cameras, recordings, logs and pipes."""

STRANGERS = 512
"""More than what all ports together give to strangers and to pages, where nothing is scarce."""

LEAST = 4
"""Places that every port has, however low the limit is."""

PAUSE_S = 0.25
"""After an accept that failed for want of descriptors the next one is tried this much later: the
listener would be ready for ever."""


def raise_limit() -> int:
    """Raises the limit of this process as far as it may; gives it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST if hard == resource.RLIM_INFINITY else min(hard, MOST)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return limit()


def limit() -> int:
    """How many descriptors this process may have."""
    soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return MOST if soft == resource.RLIM_INFINITY else soft


def places(wanted: int) -> int:
    """How many of the `wanted` connections a port may give to strangers or pages.

    All of them, unless the limit is low: then their share, and at least `LEAST`.
    """
    share = (limit() - ROBOTS - OWN) / STRANGERS
    return wanted if share >= 1.0 else max(min(LEAST, wanted), int(wanted * share))


def shortage() -> str:
    """What to say where the limit is low, "" where it is not."""
    if places(STRANGERS) == STRANGERS:
        return ""
    return (
        f"this process may open {limit()} files only: fewer pages and unknown peers at a time;"
        f" 'ulimit -n {ROBOTS + OWN + STRANGERS}' mends that"
    )
