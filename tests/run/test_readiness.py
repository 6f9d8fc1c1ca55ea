"""Who is there, by name."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from vsense.robots.link._roster import OLDER
from vsense.run.robots import Readiness, shorten

ROBOTS = {30: "epuck_30_1", 4: "epuck_4_2", 17: "epuck_17_3"}
OBJECTS = {99: "polluter_99_0"}
tags = st.sets(st.sampled_from([*ROBOTS, *OBJECTS, 5]))


@given(tags, tags)
def test_everybody_is_there_or_named(connected: set[int], seen: set[int]) -> None:
    found = Readiness.of(ROBOTS, OBJECTS, connected, seen)
    assert found.absent == tuple(n for t, n in ROBOTS.items() if t not in connected)
    assert found.unseen == tuple(n for t, n in (ROBOTS | OBJECTS).items() if t not in seen)
    everybody = connected >= ROBOTS.keys() and seen >= (ROBOTS | OBJECTS).keys()
    assert found.complete == everybody == (found.missing_text() == "")
    assert set(found.missing) == {*found.absent, *found.unseen}
    assert len(found.missing) == len(set(found.missing))


def test_the_words_name_who_is_missing_in_which_way() -> None:
    found = Readiness.of(ROBOTS, OBJECTS, {4, 17}, {30, 17, 4})
    assert found.progress() == (
        "2 of 3 robots connected (not 30), 3 of 4 markers seen (not polluter_99_0)"
    )
    assert found.progress(watched=False) == ("2 of 3 robots connected (not 30), no arena state yet")
    assert found.missing_text() == "not connected: 30; not seen: polluter_99_0"
    assert Readiness.of(ROBOTS, {}, set(ROBOTS), set(ROBOTS)).progress() == (
        "3 of 3 robots connected, 3 of 3 markers seen"
    )


def test_who_was_turned_away_is_not_only_absent() -> None:
    refused = {30: OLDER, 4: "", 99: "has no key"}
    found = Readiness.of(ROBOTS, OBJECTS, {4}, set(ROBOTS | OBJECTS), refused)
    assert found.missing_text() == (
        "not connected: 17; turned away: robot 30 runs an older vsensed: bring it this"
        " one with 'vsense robot deploy'"
    )
    assert found.progress(False).startswith("1 of 3 robots connected (not 17; robot 30: ")
    only = Readiness.of(ROBOTS, {}, {4, 17}, set(ROBOTS), refused)
    assert only.progress(False) == (
        "2 of 3 robots connected (robot 30: deploy), no arena state yet"
    )
    other = Readiness.of(ROBOTS, {}, {4, 17}, set(ROBOTS), {30: "runs 'a', expected 'b'"})
    assert "(robot 30: turned away)" in other.progress()
    there = Readiness.of(ROBOTS, OBJECTS, set(ROBOTS), set(ROBOTS | OBJECTS), refused)
    assert there.complete and there.missing_text() == "", "whoever else was turned away"


def test_many_names_are_cut_short() -> None:
    assert shorten(map(str, range(6))) == "0, 1, 2, 3, 4, 5"
    assert shorten(map(str, range(20))) == "0, 1, 2, 3, 4, 5 and 14 more"
