"""Cameras that others hold, or that are mistaken for one another; and all of them in step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.gige.faults import VICTIM, hold
from tests.gige.network import CAMERAS, SIZE, GigeCameras
from tests.gige.watch import Watch

TIMESTEPS = 15
NAME = CAMERAS[VICTIM].id
OTHERS = [camera.id for camera in CAMERAS if camera.id != NAME]


@pytest.fixture
def watch(rig: GigeCameras, tmp_path: Path) -> Iterator[Callable[..., Watch]]:
    """Makes a watch on all four cameras; arguments are attributes of their grabbers."""
    made: list[Watch] = []

    def make(**settings: object) -> Watch:
        made.append(Watch(rig, tmp_path, **settings))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_a_camera_that_another_program_holds_is_taken_when_it_is_released(
    rig: GigeCameras, watch: Callable[..., Watch]
) -> None:
    rig.start()
    other = hold(rig)
    mine = watch(**SIZE)
    mine.until(lambda: mine.told(NAME, "gone"), "word of it")
    event = mine.told(NAME, "gone")
    assert event is not None and "another program controls it" in event.text
    mine.delivered(*OTHERS)
    assert mine.frames[NAME] == 0
    other.release()
    other.close()
    mine.until(lambda: mine.told(NAME, "back"), "its return")
    mine.all_deliver()


def test_two_cameras_with_one_address_are_both_named(
    rig: GigeCameras, watch: Callable[..., Watch]
) -> None:
    rig.start()
    rig.same_address(VICTIM, 0)
    try:
        mine = watch(**SIZE)
        mine.until(lambda: mine.told(NAME, "gone"), "word of it")
        event = mine.told(NAME, "gone")
        assert event is not None
        assert all(rig.serial(n) in event.text for n in (0, VICTIM))
        assert f"address {rig.address(VICTIM)}" in event.text
        mine.delivered(*(camera for camera in OTHERS if camera != CAMERAS[0].id))
    finally:
        rig.own_address(0)
    mine.all_deliver()


def test_all_expose_together_when_told_so(rig: GigeCameras, watch: Callable[..., Watch]) -> None:
    """Cameras that run freely expose when they like."""
    rig.start()
    free = watch(**SIZE)
    free.until(lambda: len(free.spreads_ms) >= TIMESTEPS, "timesteps of four")
    free.close()
    together = watch(**SIZE, trigger="software")
    together.until(lambda: len(together.spreads_ms) >= TIMESTEPS, "timesteps of four")
    middle = [sorted(w.spreads_ms)[len(w.spreads_ms) // 2] for w in (free, together)]
    print("ms from the first to the last capture of a timestep, freely and together:", middle)
    # The simulators look for a trigger every 10 ms.
    assert middle[1] < middle[0] / 3
    assert rig.registers(VICTIM)["trigger_mode"] == 1
