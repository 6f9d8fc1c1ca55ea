"""What goes wrong with one of four cameras is told, the others go on, and all are there again."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.gige.faults import FAULTS, VICTIM, Fault, hold
from tests.gige.network import CAMERAS, RATE_HZ, SIZE_PX, GigeCameras
from tests.gige.watch import Watch

SIZE = {"width": SIZE_PX[0], "height": SIZE_PX[1]}
NAME = CAMERAS[VICTIM].id
OTHERS = [camera.id for camera in CAMERAS if camera.id != NAME]


@pytest.fixture
def at_work(rig: GigeCameras, watch: Callable[..., Watch]) -> Watch:
    """A watch on four cameras which all deliver."""
    rig.start()
    made = watch(**SIZE)
    made.all_deliver()
    return made


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_told_survived_and_over(rig: GigeCameras, at_work: Watch, fault: Fault) -> None:
    before = len(at_work.events)
    fault.begin(rig)
    at_work.until(lambda: at_work.told(NAME, fault.kind, before), fault.kind)
    event = at_work.told(NAME, fault.kind, before)
    assert event is not None and fault.text in event.text
    at_work.delivered(*OTHERS, count=max(fault.lasts, 3))
    during = len(at_work.events)
    fault.mend(rig)
    if fault.after is not None:
        after = fault.after
        at_work.until(lambda: at_work.told(NAME, after, during), after)
    at_work.all_deliver()
    assert {event.camera for event in at_work.events[before:]} == {NAME}, "the others are well"


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
        assert "Aravis-Fake-S0" in event.text and "Aravis-Fake-S1" in event.text
        assert f"address {rig.address(VICTIM)}" in event.text
        mine.delivered(*(camera for camera in OTHERS if camera != CAMERAS[0].id))
    finally:
        rig.own_address(0)
    mine.all_deliver()


def test_all_expose_together_when_told_so(rig: GigeCameras, watch: Callable[..., Watch]) -> None:
    """Cameras that run freely expose when they like."""
    rig.start()
    free = watch(**SIZE)
    free.until(lambda: len(free.spreads_ms) >= 3 * RATE_HZ, "timesteps of four")
    free.close()
    together = watch(**SIZE, trigger="software")
    together.until(lambda: len(together.spreads_ms) >= 3 * RATE_HZ, "timesteps of four")
    middle = [sorted(w.spreads_ms)[len(w.spreads_ms) // 2] for w in (free, together)]
    print("ms from the first to the last capture of a timestep, freely and together:", middle)
    # The simulators look for a trigger every 10 ms.
    assert middle[1] < middle[0] / 3
    assert rig.registers(VICTIM)["trigger_mode"] == 1
