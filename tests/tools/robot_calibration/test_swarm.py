"""Many robots at once, in the physics in C, seen and told with a delay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.tools.robot_calibration.arena import Arena
from vsense.tools.robot_calibration._routine import Moment


def test_robots_are_calibrated_at_once_and_touch_nobody() -> None:
    # Two stand 8 cm apart, two in each other's way.
    arena = Arena([(0.0, 0.0), (0.08, 0.0), (0.0, 0.4), (0.15, 0.4), (-0.6, 0.3)])
    swarm = arena.run()
    assert not swarm.failed
    for tag in arena.tags:
        arena.check(tag)
    assert arena.nearest_m > 0.0705


def test_who_does_not_do_as_told_is_named_and_the_others_go_on() -> None:
    arena = Arena([(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5), (-0.5, 0.0)])
    silent, unseen, held, lost, fine = arena.tags

    def change(tag: int, timestep: int, moment: Moment) -> Moment:
        if tag == silent:
            return Moment(moment.time_s, moment.pose, (0, 0), False)
        if tag == unseen or (tag == lost and timestep > 60):
            return Moment(moment.time_s, None, moment.motors, True)
        if tag == held:
            return Moment(moment.time_s, (0.0, 0.5, 1.0), moment.motors, True)
        return moment

    arena.change = change
    swarm = arena.run()
    arena.check(fine)
    assert set(swarm.fits) == {fine}
    words = {silent: "does not answer", unseen: "is not seen", lost: "was not seen for 1 s"}
    for tag, text in words.items():
        assert text in swarm.failed[tag]
    assert held in swarm.failed


def test_moments_in_which_a_robot_stands_are_left_out() -> None:
    arena = Arena([(0.0, 0.0)])
    tag = arena.tags[0]
    random, stood = np.random.default_rng(3), [0.0]

    def change(tag: int, timestep: int, moment: Moment) -> Moment:
        # Every now and then its clock gains on it: as if it had stood for a moment.
        stood[0] += 0.05 if random.random() < 0.05 else 0.0
        return Moment(moment.time_s + stood[0], moment.pose, moment.motors, True)

    arena.change = change
    arena.run()
    arena.check(tag)


def test_a_robot_without_room_waits_and_is_named_in_the_end() -> None:
    ring = [
        (0.075 * math.cos(k * math.pi / 3), 0.075 * math.sin(k * math.pi / 3)) for k in range(6)
    ]
    arena = Arena([(0.0, 0.0), *map(tuple, ring)])
    middle = arena.tags[0]
    # The others never move: nobody hears them.
    arena.change = lambda tag, timestep, moment: (
        moment if tag == middle else Moment(moment.time_s, moment.pose, (0, 0), False)
    )
    swarm = arena.run()
    assert "has no room" in swarm.failed[middle]
    assert set(swarm.failed) == set(arena.tags)


@pytest.mark.parametrize("lacks", [{"pose": None}, {"connected": False}])
def test_who_makes_room_unseen_or_unheard_does_not_drive_on(lacks: dict) -> None:
    """Two that stand close: one drives away before it turns."""
    arena = Arena([(0.0, 0.0), (0.085, 0.0)])

    def hide(tag: int, timestep: int, moment: Moment) -> Moment:
        away = arena.swarm.routines[tag].doing == "making room"
        return replace(moment, **lacks) if away else moment

    arena.change = hide
    failed = arena.run().failed.values()
    assert any("for 1 s while it was making room" in why for why in failed), failed
