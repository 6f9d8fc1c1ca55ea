"""What goes wrong with one of four cameras is told, the others go on, and all are there again.

One session goes through all of it: nothing is started anew in between.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.gige.faults import FAULTS, VICTIM, Fault
from tests.gige.network import CAMERAS, SIZE, GigeCameras
from tests.gige.watch import Watch

NAME = CAMERAS[VICTIM].id
OTHERS = [camera.id for camera in CAMERAS if camera.id != NAME]


@pytest.fixture(scope="module")
def at_work(rig: GigeCameras, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watch]:
    """A watch on four cameras."""
    rig.start()
    made = Watch(rig, tmp_path_factory.mktemp("session"), **SIZE)
    yield made
    made.close()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_told_survived_and_over(rig: GigeCameras, at_work: Watch, fault: Fault) -> None:
    at_work.all_deliver()
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
