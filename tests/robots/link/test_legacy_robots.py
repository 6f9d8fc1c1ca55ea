"""What robots with the original client are told, however slowly they take it."""

from __future__ import annotations

import contextlib
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.legacy_rig import ClosedError, Robot
from vsense.robots.link.legacy.protocol import (
    LegacyRobot,
    LegacySwarm,
    Translation,
    by_octet,
    translations,
)
from vsense.robots.link.status import LinkError
from vsense.robots.link.table import Direction, Entry

TRANSLATION = Translation([Entry(1, "pollutant", "f4"), Entry(2, "rgb_ground", "4*u1")])
CHOICES = [bytes([k, k, k]) for k in range(3)]


def life(data: bytes) -> Robot:
    """Has a robot live on these bytes."""
    robot, rest = Robot(), memoryview(data)

    def read(count: int) -> bytes:
        nonlocal rest
        if len(rest) < count:
            raise ClosedError
        got, rest = bytes(rest[:count]), rest[count:]
        return got

    with contextlib.suppress(ClosedError):
        robot.live(read)
    assert not len(rest) or robot.ended
    return robot


def take(robot: LegacyRobot, most: int = 10**6) -> bytes:
    """Takes up to so many bytes, as a kernel would."""
    data = b""
    while (chunk := robot.chunk()) and len(data) < most:
        part = chunk[: most - len(data)]
        robot.wrote(len(part))
        data += part
    return data


def test_table_start_changes_and_end() -> None:
    robot = LegacyRobot(23, "epuck_23_30", TRANSLATION.table)
    robot.sense({5: b"abc"})
    said = take(robot)
    assert said == TRANSLATION.table, "nothing but the table before the start"
    robot.start()
    said += take(robot)
    for payload in (b"abc", b"abc", b"abd"):
        robot.sense({5: payload})
        said += take(robot)
    robot.end()
    said += take(robot)
    robot.sense({5: b"xyz"})
    robot.start()
    assert take(robot) == b"", "nothing follows the end"
    learnt = life(said)
    assert learnt.started and learnt.ended
    assert learnt.updates == [{5: b"abc"}, {5: b"abd"}], "unchanged is not repeated"
    assert robot.updates == 2


@given(st.lists(st.tuples(st.sampled_from(CHOICES), st.integers(0, 30)), max_size=60))
def test_a_slow_robot_misses_some_but_ends_with_the_newest(steps: list[tuple[bytes, int]]) -> None:
    robot = LegacyRobot(23, "epuck_23_30", TRANSLATION.table)
    robot.start()
    said = b""
    for payload, room in steps:
        robot.sense({5: payload})
        said += take(robot, room)
        assert len(robot.chunk()) < 100, "nothing piles up"
    said += take(robot)
    learnt = life(said)
    told = [update[5] for update in learnt.updates]
    assert all(a != b for a, b in itertools.pairwise(told))
    assert told[-1:] == [payload for payload, _ in steps][-1:]


def test_who_comes_in_mid_run_is_told_everything_at_once() -> None:
    swarm = LegacySwarm({23: TRANSLATION}, {30: (23, "epuck_23_30")})
    swarm.start()
    swarm.sense(23, {5: b"abc", 7: bytes(12)})
    robot = swarm.join(30)
    assert robot is not None
    learnt = life(take(robot))
    assert learnt.started and learnt.updates == [{5: b"abc", 7: bytes(12)}]
    again = swarm.join(30)
    assert again is not None and not swarm.leave(30, robot)
    assert swarm.robots == {30: again} and swarm.leave(30, again) and swarm.robots == {}
    assert swarm.join(31) is None and swarm.why_not(31).endswith("is 31; expected: 30")


def test_of_a_mixed_swarm_those_come_whose_sensors_the_original_has() -> None:
    known, other = Entry(1, "gps", "3*f4"), Entry(1, "scent", "3*f4")
    light = Entry(2, "light", "4*f4", Direction.ACTUATOR)
    found = translations({23: [known, light], 24: [other, light], 25: [other, known]})
    assert set(found) == {23, 25} and found[23].table == found[25].table
    swarm = LegacySwarm(found, {30: (23, "a"), 31: (24, "b"), 32: (25, "c")})
    assert swarm.join(30) is not None and swarm.join(31) is None
    assert swarm.why_not(31) == "b has none of the virtual sensors that the original client knows"
    assert swarm.unknown == ("scent",)
    with pytest.raises(LinkError, match="sensors: scent"):
        translations({24: [other, light]})


def test_robots_are_known_by_the_last_octet() -> None:
    robots = {23: ("epuck_23_30", 30), 24: ("epuck_24_31", 31), 25: ("epuck_25_0", 0)}
    assert by_octet(robots) == {30: (23, "epuck_23_30"), 31: (24, "epuck_24_31")}
    with pytest.raises(LinkError, match=r"epuck_23_30.*other_9_30.*30"):
        by_octet({**robots, 9: ("other_9_30", 30)})
    with pytest.raises(LinkError, match=r"no robot's id ends with the last octet"):
        by_octet({25: ("epuck_25_0", 0), 26: ("epuck_26_255", 255)})
