"""Markers that are covered for long are told, once, and when they can be read again; no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, cell_corners, lay_over, render
from vsense.base.arena import Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily, choose_tags, load_family
from vsense.vision.tracking._marker_watch import UNREAD_S, MarkerWatch
from vsense.vision.tracking.arena_tracker import ArenaTracker

CAMERA = Camera.looking_down("a", 0.0, 0.0, 2.43, 1400.0, (560, 420))
PERIOD_S, TIMESTEPS = 0.25, 40
"""10 s, with four pictures a second."""
FAMILIES = ["arrow4x4", "arrow4x4-thesis", "apriltag_36h11", "aruco_4x4_50"]
PLAIN = Look(litter=0)
HOMES = [(-0.25, -0.15), (0.05, -0.15), (-0.25, 0.15), (0.05, 0.15)]

Family = MarkerFamily | SquareFamily
Touch = Callable[[float, np.ndarray, list[Robot]], None]
"""What becomes of a picture: when [s], (h, w) uint8, what is in it."""


@cache
def tags_of(family: Family) -> list[int]:
    is_arrow = isinstance(family, MarkerFamily)
    return choose_tags(family, 4, 2.2, seed=14) if is_arrow else [3, 23, 28, 41]


def driving(family: Family, time_s: float) -> list[Robot]:
    """Returns four robots; each drives to and fro at 4 cm/s, and stands while it is exposed."""
    way = 0.04 * (5.0 - abs(time_s - 5.0)) - 0.1
    return [
        Robot(tag, x + way * np.cos(k), y + way * np.sin(k), float(k))
        for k, (tag, (x, y)) in enumerate(zip(tags_of(family), HOMES))
    ]


def watch(
    family: Family,
    touch: Touch,
    look: Callable[[float], Look] = lambda time_s: PLAIN,
    robots: Callable[[float], list[Robot]] | None = None,
    roster: list[int] | None = None,
) -> list[tuple[float, str]]:
    """Returns what is told of the robots' markers, and when [s]."""
    heights_m = dict.fromkeys(roster or tags_of(family), HEIGHT_M)
    tracker = ArenaTracker.for_family([CAMERA], family, heights_m, open_roster=False)
    watching = MarkerWatch(tracker.cameras, tracker.heights_m)
    told = []
    for timestep in range(TIMESTEPS):
        time_s = PERIOD_S * timestep
        there = driving(family, time_s) if robots is None else robots(time_s)
        picture = render(CAMERA, family, there, look(time_s), seed=timestep)
        touch(time_s, picture, there)
        frame = Frame("a", picture, timestep, round(1e9 * (1.0 + time_s)), 0)
        tracker.update([frame])
        told += [(time_s, line) for line in watching.update([frame], tracker.markers)]
    tracker.close()
    return told


def tape(picture: np.ndarray, family: Family, robot: Robot, share: float, shade: int) -> None:
    """Sticks something over a share of a marker's cells, from their rear."""
    (rear, right), (front, left) = cell_corners(family)
    front = rear + share * (front - rear)
    lay_over(picture, CAMERA, robot, ((rear, right), (front, left)), shade)


def nothing(time_s: float, picture: np.ndarray, robots: list[Robot]) -> None:
    """Leaves the picture as it is."""


@pytest.mark.parametrize(
    ("name", "shade"),
    [
        ("arrow4x4", 35),
        ("apriltag_36h11", 190),
        *(
            pytest.param(name, shade, marks=pytest.mark.campaign)
            for name in FAMILIES
            for shade in (35, 190)
            if (name, shade) not in (("arrow4x4", 35), ("apriltag_36h11", 190))
        ),
    ],
)
def test_a_covered_marker_is_told_once_and_when_it_can_be_read_again(name: str, shade: int) -> None:
    family = load_family(name)
    tag = tags_of(family)[1]

    def cover(time_s: float, picture: np.ndarray, robots: list[Robot]) -> None:
        if 1.0 <= time_s < 8.0:
            tape(picture, family, robots[1], 0.5, shade)

    (first_s, first), (second_s, second) = watch(family, cover)
    assert first.startswith(f"robot {tag}'s marker is damaged or covered")
    assert 1.0 + UNREAD_S <= first_s <= 1.0 + UNREAD_S + 1.0
    assert second == f"robot {tag}'s marker can be read again" and 8.0 < second_s < 9.5


@pytest.mark.parametrize(
    "name", ["arrow4x4", pytest.param("apriltag_36h11", marks=pytest.mark.campaign)]
)
def test_what_is_covered_for_a_moment_is_not_told(name: str) -> None:
    family = load_family(name)

    def cover(time_s: float, picture: np.ndarray, robots: list[Robot]) -> None:
        if 1.0 <= time_s < 5.0:
            tape(picture, family, robots[1], 0.5, 190)

    assert watch(family, cover) == []


@pytest.mark.parametrize(("shown", "told"), [((0, 2, 3, 5, 6), 2), ((0, 3, 6), 0)])
def test_a_covered_marker_is_told_where_it_is_seen_twice_a_second(
    shown: tuple[int, ...], told: int
) -> None:
    """In 5 or in 3 pictures of two seconds, which have 8."""
    family = load_family("arrow4x4")

    def some(time_s: float) -> list[Robot]:
        robots = driving(family, time_s)
        is_shown = time_s < 1.0 or time_s >= 8.0 or round(time_s / PERIOD_S) % 8 in shown
        return robots if is_shown else [robots[0], *robots[2:]]

    def cover(time_s: float, picture: np.ndarray, robots: list[Robot]) -> None:
        if 1.0 <= time_s < 8.0 and len(robots) == 4:
            tape(picture, family, robots[1], 0.5, 35)

    assert len(watch(family, cover, robots=some)) == told


@pytest.mark.parametrize(
    ("name", "hard"),
    [
        ("arrow4x4", "blurred"),
        ("apriltag_36h11", "glaring"),
        *(
            pytest.param(name, hard, marks=pytest.mark.campaign)
            for name in FAMILIES
            for hard in ("blurred", "noisy", "glaring")
            if (name, hard) not in (("arrow4x4", "blurred"), ("apriltag_36h11", "glaring"))
        ),
    ],
)
def test_pictures_in_which_nothing_is_covered_accuse_nobody(name: str, hard: str) -> None:
    """Blurred so that hardly a marker can be read; a glare passes over one robot."""
    family = load_family(name)
    looks = {
        "blurred": replace(PLAIN, psf_px=3.0),
        "noisy": replace(PLAIN, noise=15.0),
    }

    def shine(time_s: float, picture: np.ndarray, robots: list[Robot]) -> None:
        if hard == "glaring" and 2.0 <= time_s < 6.0:
            at = CAMERA.project(np.array([robots[1].x_m, robots[1].y_m, HEIGHT_M]))
            cv2.circle(picture, tuple(np.rint(at).astype(int).tolist()), 9, 255, -1)

    assert watch(family, shine, lambda time_s: looks.get(hard, PLAIN)) == []


@pytest.mark.parametrize(
    "name", ["arrow4x4", pytest.param("apriltag_36h11", marks=pytest.mark.campaign)]
)
def test_robots_at_the_border_are_not_told(name: str) -> None:
    family = load_family(name)
    tag = tags_of(family)[0]

    def leaving(time_s: float) -> list[Robot]:
        x_m = min(0.2 + 0.04 * time_s, 0.47)
        return [Robot(tag, x_m, 0.0, 0.3), *driving(family, time_s)[2:]]

    assert watch(family, nothing, robots=leaving) == []


@pytest.mark.parametrize(
    "name", ["arrow4x4", pytest.param("apriltag_36h11", marks=pytest.mark.campaign)]
)
def test_a_stranger_is_not_taken_for_a_robot_that_has_left(name: str) -> None:
    family = load_family(name)
    first, *others = tags_of(family)

    def exchanged(time_s: float) -> list[Robot]:
        there = driving(family, time_s)
        if time_s < 2.0:
            return there[:1]
        return [] if time_s < 3.2 else [replace(there[0], tag=others[0])]

    told = watch(family, nothing, robots=exchanged, roster=[first])
    assert [line for _, line in told if line.startswith("robot")] == []
    # An arrow is told as what it is; a square without a word of the roster may be anything.
    assert len(told) == isinstance(family, MarkerFamily)


def test_a_marker_that_never_had_a_name_is_told_once_with_its_place() -> None:
    family = load_family("arrow4x4")
    at = driving(family, 0.0)[1]
    still = lambda time_s: [at, *driving(family, time_s)[2:]]  # noqa: E731

    def cover(time_s: float, picture: np.ndarray, robots: list[Robot]) -> None:
        tape(picture, family, robots[0], 0.5, 35)

    ((when_s, line),) = watch(family, cover, robots=still)
    assert UNREAD_S <= when_s <= UNREAD_S + 1.0
    assert line == (
        f"a marker at ({at.x_m:.2f}, {at.y_m:.2f}) m has no name: it is seen, but can not be read,"
        " or its tag is not on the roster"
    )
