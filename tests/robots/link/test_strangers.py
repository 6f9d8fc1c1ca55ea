"""Strangers: their places, and how little is told of them."""

from __future__ import annotations

import resource

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.rig import S
from vsense.robots.link import strangers
from vsense.robots.link.strangers import (
    ADDRESSES_MAX,
    DELAY_MAX_S,
    PortPlaces,
    RateLimit,
    StrangerLog,
    owner_of,
)


def test_the_first_is_told_and_the_others_are_counted() -> None:
    told: list[str] = []
    log = StrangerLog("port 7", told.append)
    for number in range(813):
        log.note("10.0.0.9", "refused", S + number)
    assert told == ["port 7: 10.0.0.9: refused"]
    log.tick(11 * S)
    assert told[1:] == ["port 7: 812 more from 10.0.0.9 in the last 10 s: refused (812)"]


def test_every_kind_of_deed_is_told_once() -> None:
    told: list[str] = []
    log = StrangerLog("page", told.append)
    for _ in range(3):
        log.note("10.0.0.1", "silent", S)
        log.note("10.0.0.2", "not HTTP", S)
    log.note("10.0.0.2", "silent", S)
    assert told == ["page: 10.0.0.1: silent", "page: 10.0.0.2: not HTTP"]
    log.tick(11 * S)
    assert told[2] == (
        "page: 5 more from 10.0.0.2 and 1 other address in the last 10 s: silent (3), not HTTP (2)"
    )


def test_an_hour_of_flood_is_one_line_every_ten_seconds() -> None:
    told: list[str] = []
    log = StrangerLog("page", told.append)
    for second in range(3600):
        for number in range(20):
            log.note(f"10.0.{second % 250}.{number}", "silent", second * S)
    assert len(told) <= 361
    assert len(log._origins) <= ADDRESSES_MAX


def test_after_a_quiet_period_it_is_told_anew() -> None:
    told: list[str] = []
    log = StrangerLog("page", told.append)
    for second in (0, 100, 200):
        log.note("10.0.0.9", "silent", second * S)
    assert told == ["page: 10.0.0.9: silent"] * 3


def test_the_oldest_of_an_address_makes_way() -> None:
    places = PortPlaces[str](4, 2)
    assert [places.add(name, name[0]) for name in ("a1", "b1", "a2", "a3")] == [None] * 3 + ["a1"]
    places.renew("b1")
    assert list(places) == ["a2", "a3", "b1"]


def test_a_full_port_takes_from_whoever_has_most() -> None:
    places = PortPlaces[str](4, 3)
    for name in ("b1", "a1", "a2", "a3"):
        places.add(name, name[0])
    assert places.add("c1", "c") == "a1"
    assert places.add("d1", "d") == "a2"
    assert sorted(places) == ["a3", "b1", "c1", "d1"]


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 5), st.booleans()), max_size=200))
def test_the_limits_hold_whatever_comes_and_goes(steps: list[tuple[int, int, bool]]) -> None:
    places, owners = PortPlaces[int](8, 3), dict[int, int]()
    for item, owner, leaves in steps:
        if leaves or item in places:
            places.remove(item)
            owners.pop(item, None)
            continue
        loser = places.add(item, owner)
        owners.pop(loser if loser is not None else -1, None)
        owners[item] = owner
        assert set(places) == owners.keys() and len(places) <= 8
        assert max(list(owners.values()).count(one) for one in owners.values()) <= 3


def test_a_rate_is_kept_for_each_owner() -> None:
    limit, now_s, done = RateLimit(100.0, 50), 1.0, 0
    assert [limit.delay_s("a", now_s) for _ in range(50)] == pytest.approx([0.0] * 50, abs=1e-9)
    while now_s < 11.0:
        now_s += limit.delay_s("a", now_s)
        done += 1
    assert done == pytest.approx(1000, abs=2)
    assert limit.delay_s("b", now_s) == 0.0
    # A flood that nobody waited for keeps nobody out when it is over.
    assert max(limit.delay_s("c", now_s) for _ in range(10_000)) == pytest.approx(DELAY_MAX_S)
    for number in range(10_000):
        limit.delay_s(number, now_s + number)
    assert len(limit._until_s) <= ADDRESSES_MAX


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("10.0.0.1", "10.0.0.2", False),
        ("2001:db8:1:2::1", "2001:db8:1:2:ffff::9", True),
        ("2001:db8:1:2::1", "2001:db8:1:3::1", False),
        ("::ffff:10.0.0.1", "10.0.0.1", True),
        ("::ffff:10.0.0.1", "::ffff:10.0.0.2", False),
        ("fe80::1%eth0", "fe80::2%eth0", True),
        ("", "somebody", False),
    ],
)
def test_whom_an_address_counts_for(one: str, other: str, same: bool) -> None:
    assert (owner_of(one) == owner_of(other)) is same


def test_the_limit_of_descriptors_goes_up_to_the_hard_one(monkeypatch: pytest.MonkeyPatch) -> None:
    soft, hard = 1024, 4096

    def set_limit(which: int, limits: tuple[int, int]) -> None:
        nonlocal soft, hard
        assert which == resource.RLIMIT_NOFILE and limits[1] == hard
        assert hard == resource.RLIM_INFINITY or limits[0] <= hard
        soft, hard = limits

    monkeypatch.setattr(resource, "getrlimit", lambda which: (soft, hard))
    monkeypatch.setattr(resource, "setrlimit", set_limit)
    assert strangers.raise_limit() == 4096 == soft == hard
    soft, hard = 1024, resource.RLIM_INFINITY
    assert strangers.raise_limit() == 65_536
    soft = resource.RLIM_INFINITY
    assert strangers.raise_limit() == 65_536 and soft == resource.RLIM_INFINITY


@pytest.mark.parametrize(("limit", "places"), [(1024, 64), (708, 64), (452, 32), (256, 7), (64, 4)])
def test_low_limits_leave_robots_their_descriptors(
    monkeypatch: pytest.MonkeyPatch, limit: int, places: int
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit, limit))
    assert strangers.places(64) == places
    assert (f"may open {limit} files only" in strangers.shortage()) is (places < 64)
