"""What goes wrong with a live camera, from a scripted one: told in time, survived, recovered from.

Faults that Aravis' fake camera can have are tested on it, in `tests/gige`.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from tests.rigs.scripted_camera import PERIOD_NS, SIZE, Script
from vsense.base.errors import GrabberError
from vsense.vision.cameras._live_camera import WHOLE
from vsense.vision.cameras._live_grabber import LiveGrabber
from vsense.vision.cameras.grabber import ENDS, Troubles
from vsense.vision.cameras.picture import PictureError
from vsense.vision.cameras.source import CAMERA_SILENCE_S, Shot

RATE_HZ = 10.0
SILENCE_NS = round(1e9 * CAMERA_SILENCE_S)
SOON = 3
"""Pictures within which a fault must be told."""
RECOVERED = 30
"""Pictures within which its end must be told: 3 s at 10 Hz."""


class Stage:
    """A camera with faults beside one without, in one grabber."""

    def __init__(self) -> None:
        self.bad, self.good = Script(), Script()
        self.grabber = LiveGrabber(
            {"bad": self.bad, "good": self.good},
            {"bad": SIZE, "good": SIZE},
            lambda: self.bad.now_ns,
            {"bad": RATE_HZ, "good": RATE_HZ},
            patience_s=0.001,
            retry_s=0.0,
        )
        self.told: list[tuple[str, str]] = []
        for camera in (self.bad, self.good):
            assert camera.waits.acquire(timeout=30.0)

    def step(self, thing: Shot | Exception | None = None) -> set[str]:
        """Lives one timestep; gives the cameras whose pictures it has."""
        if thing is not None:
            self.bad.give(thing)
        self.good.give(self.good.shot())
        cameras = {frame.camera for frame in self.grabber.next(30.0)}
        assert "good" in cameras
        events = self.grabber.events()
        assert not [event for event in events if event.camera == "good"]
        self.told += [(event.kind, event.text) for event in events]
        return cameras

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.told]

    def close(self) -> None:
        for camera in (self.bad, self.good):
            for _ in range(4):
                camera.comes.put(GrabberError("the end"))
        self.grabber.close()


@pytest.fixture
def stage() -> Iterator[Stage]:
    made = Stage()
    for _ in range(15):
        assert made.step(made.bad.shot()) == {"bad", "good"}
    assert made.told == []
    yield made
    made.close()


def same_stamp(camera: Script) -> Shot:
    """A driver that hands out one buffer again and again, while the camera's clock goes on."""
    stuck_ns = camera.stuck_ns = camera.stuck_ns or camera.stamp_ns
    shot = camera.shot()
    return Shot(shot.image, stuck_ns, shot.arrived_ns)


def wrong_size(camera: Script) -> Shot:
    camera.size = (32, 24)
    return camera.shot()


FAULTS = {
    "same stamp": (same_stamp, "frozen", "running"),
    "truncated": (lambda c: PictureError("a picture lacks packets"), "damaged", "whole"),
    "wrong size": (wrong_size, "size", "fits"),
    "too slow": (lambda c: c.shot(3 * PERIOD_NS), "slow", "prompt"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_told_within_three_pictures_and_its_end_when_it_is_over(
    stage: Stage, name: str
) -> None:
    bad, begins, ends = FAULTS[name]
    for _ in range(SOON):
        stage.step(bad(stage.bad))
    assert set(stage.kinds()) == {begins}
    for _ in range(20):
        stage.step(bad(stage.bad))
    # Damaged pictures are counted, all else is told once, however long it lasts.
    assert stage.kinds() == [begins] * (SOON + 20 if begins == "damaged" else 1)
    stage.bad.size = SIZE
    cameras = [stage.step(stage.bad.shot()) for _ in range(RECOVERED)]
    assert list(dict.fromkeys(stage.kinds())) == [begins, ends]
    assert cameras[-20:] == [{"bad", "good"}] * 20
    assert begins in ENDS[ends]


def test_a_clock_that_jumps_is_told_and_times_are_right_again(stage: Stage) -> None:
    for jump_ns in (10**10, -(10**11), 250_000_000, -70_000_000):
        stage.told.clear()
        stage.step(stage.bad.shot(stamp_ns=jump_ns))
        for _ in range(SOON - 1):
            stage.step(stage.bad.shot())
        assert stage.kinds() == ["clock"]
        for _ in range(5):
            shot = stage.bad.shot()
            stage.bad.give(shot)
            stage.good.give(stage.good.shot())
            frame = next(f for f in stage.grabber.next(30.0) if f.camera == "bad")
            assert frame.capture_ns == shot.arrived_ns


def test_a_camera_that_has_another_size_after_a_restart_is_opened_anew(stage: Stage) -> None:
    """Opening sets the size: the scripted camera has its own again afterwards."""
    stage.bad.size = (32, 24)
    for _ in range(SOON):
        stage.step(stage.bad.shot())
    assert stage.bad.opened == 2
    cameras = [stage.step(stage.bad.shot()) for _ in range(5)]
    assert cameras[-1] == {"bad", "good"}
    assert stage.kinds() == ["size", "fits"]


def test_a_camera_that_takes_long_to_close_delays_no_other(stage: Stage) -> None:
    stage.bad.closes = threading.Event()
    stage.bad.size = (32, 24)
    for _ in range(SOON - 1):
        stage.step(stage.bad.shot())
    stage.bad.comes.put(stage.bad.shot())
    for _ in range(20):
        assert stage.step() == {"good"}
    assert stage.bad.opened == 1
    stage.bad.closes.set()
    assert stage.bad.waits.acquire(timeout=30.0)
    assert stage.bad.opened == 2
    stage.step(stage.bad.shot())
    assert stage.kinds() == ["size", "fits"], "the time without it is not told as its absence"


def test_a_camera_that_froze_is_opened_anew_once(stage: Stage) -> None:
    for _ in range(20):
        stage.step(same_stamp(stage.bad))
    assert stage.bad.opened == 2
    assert stage.kinds() == ["frozen"]


def test_a_slow_camera_that_was_switched_off_and_on_is_prompt_again(stage: Stage) -> None:
    for _ in range(SOON + 1):
        stage.step(stage.bad.shot(3 * PERIOD_NS))
    stage.step(GrabberError("unplugged"))
    for _ in range(10):
        stage.step(stage.bad.shot())
    assert stage.kinds() == ["slow", "gone", "back", "prompt"]


def test_whatever_a_camera_raises_is_told_and_it_is_tried_again(stage: Stage) -> None:
    stage.step(ValueError("invalid literal for int()"))
    assert stage.told[0] == (
        "gone",
        "is gone: ValueError: invalid literal for int(); trying again every 0 s",
    )
    stage.step(stage.bad.shot())
    assert stage.kinds() == ["gone", "back"]
    assert stage.bad.opened == 2


def test_a_camera_that_does_not_take_its_size_is_not_opened_again_and_again(stage: Stage) -> None:
    for _ in range(40):
        stage.bad.size = (32, 24)
        stage.step(stage.bad.shot())
    assert stage.bad.opened == 2
    assert stage.kinds() == ["size"]


def test_a_camera_that_falls_silent_is_told_though_its_thread_waits(stage: Stage) -> None:
    for _ in range(SOON):
        stage.bad.wait(PERIOD_NS)
        stage.step()
    assert stage.kinds() == []
    stage.bad.wait(SILENCE_NS - SOON * PERIOD_NS + 1)
    stage.step()
    assert stage.told == [("gone", "is gone: gives no pictures any more")]
    for _ in range(10):
        stage.step(stage.bad.shot())
    assert stage.kinds() == ["gone", "back"]
    assert stage.bad.opened == 1


def test_an_unplugged_camera_is_opened_until_it_gives_pictures(stage: Stage) -> None:
    for _ in range(5):
        stage.step(GrabberError("unplugged"))
    assert stage.kinds() == ["gone"]
    assert stage.told[0][1].startswith("is gone: unplugged; trying again every")
    assert stage.bad.opened == 6
    stage.step(stage.bad.shot())
    assert stage.kinds() == ["gone", "back"]


def test_what_a_camera_made_of_its_settings_is_told_once_however_often_it_is_opened() -> None:
    camera = Script()
    camera.refuses = ["does not take gain_raw 99 (0 to 10): keeps 0"]
    grabber = LiveGrabber({"a": camera}, {"a": SIZE}, lambda: camera.now_ns, retry_s=0.0)
    try:
        assert camera.waits.acquire(timeout=30.0)
        for _ in range(3):
            camera.give(GrabberError("unplugged"))
        told = [event.text for event in grabber.events() if event.kind == "control"]
        assert told == camera.refuses
    finally:
        camera.comes.put(GrabberError("the end"))
        grabber._ended.set()
        grabber._cameras["a"].end()
        camera.comes.put(GrabberError("the end"))
        grabber.close()


def test_damage_now_and_then_is_one_spell_with_a_count(stage: Stage) -> None:
    for _ in range(10):
        stage.step(PictureError("a picture lacks packets"))
        stage.step(stage.bad.shot())
    assert stage.told == [("damaged", "a picture lacks packets")] * 10
    for _ in range(WHOLE):
        stage.step(stage.bad.shot())
    assert stage.told[10:] == [("whole", "gives whole pictures again, after 10 damaged ones")]


def test_pictures_of_one_signal_make_a_timestep_and_stragglers_do_not() -> None:
    a, b = Script(), Script()
    grabber = LiveGrabber(
        {"a": a, "b": b}, {"a": SIZE, "b": SIZE}, lambda: a.now_ns,
        {"a": RATE_HZ, "b": RATE_HZ}, together_s=0.05, patience_s=0.05, retry_s=0.0,
    )  # fmt: skip
    try:
        for camera in (a, b):
            assert camera.waits.acquire(timeout=30.0)
        for _ in range(5):
            a.give(a.shot())
            b.give(b.shot())
            assert {f.camera for f in grabber.next(30.0)} == {"a", "b"}
        # The picture of b comes after the next one of a: it is of the signal before.
        late = b.shot()
        a.give(a.shot())
        a.give(a.shot())
        b.give(late)
        assert {f.camera for f in grabber.next(30.0)} == {"a"}
        a.give(a.shot())
        b.shot()
        b.give(b.shot())
        frames = grabber.next(30.0)
        assert {f.camera for f in frames} == {"a", "b"}
        assert len({f.capture_ns for f in frames}) == 1
    finally:
        for camera in (a, b):
            for _ in range(4):
                camera.comes.put(GrabberError("the end"))
        grabber.close()


def test_every_trouble_that_lasts_is_present_until_it_ends() -> None:
    from vsense.vision.cameras.grabber import CameraEvent

    for end, begins in ENDS.items():
        for begin in begins:
            troubles = Troubles()
            troubles.lines([CameraEvent("a", begin, "x")])
            assert ("a", begin) in troubles.present
            troubles.lines([CameraEvent("a", end, "y")])
            assert not troubles.present
