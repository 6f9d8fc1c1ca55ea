"""Servers and robots that are closed after the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.robots.link.arena_rig import Told
from tests.robots.link.rig import Clock, Frozen, Robot, Server


@pytest.fixture
def clock() -> Clock:
    """Real time, which the test can put forward."""
    return Clock()


@pytest.fixture
def told() -> Told:
    """The lines for a person."""
    return Told()


@pytest.fixture
def server(clock: Clock) -> Iterator[Server]:
    """A server that lives in real time."""
    made = Server(clock)
    yield made
    made.close()


@pytest.fixture
def frozen() -> Frozen:
    """Time that passes only when the test says so."""
    return Frozen()


@pytest.fixture
def still(frozen: Frozen) -> Iterator[Server]:
    """A server whose time stands still: nothing leaves it but what the test causes."""
    made = Server(frozen)
    yield made
    made.close()


@pytest.fixture
def robot() -> Iterator[Callable[..., Robot]]:
    """Makes robots."""
    made: list[Robot] = []

    def make(server: Server, tag: int = 1, uid: bytes | None = None, keyed: bool = True) -> Robot:
        made.append(Robot(server, tag, uid, keyed))
        return made[-1]

    yield make
    for one in made:
        one.close()
