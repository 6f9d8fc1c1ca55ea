"""`vsense camera tune` on a terminal and on a pipe, with a scripted camera."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.tools.camera_setup.stage import CALIBRATION, DAMAGED, GONE, Scripted, options, tuner
from vsense.base.errors import GrabberError, UsageError
from vsense.base.terminal import LiveBlock
from vsense.tools.camera_setup import tuning
from vsense.tools.camera_setup.tuning import TuningBlock, calibration_of, tuner_of
from vsense.vision.cameras.source import Controls
from vsense.vision.tracking.single_camera import MOST_DAMAGED, OpenCamera


class Clock:
    """A clock that goes on by 100 ms whenever it is read."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        self.now_ns += 100_000_000
        return self.now_ns


def watch(scripted: Scripted, interrupted: threading.Event) -> tuple[TuningBlock, io.StringIO]:
    drawn = io.StringIO()
    return TuningBlock(tuner(scripted), interrupted, LiveBlock(drawn), Clock()), drawn


def after(reads: int, act: Callable[[], None]) -> Callable[[int], None]:
    return lambda done: act() if done == reads else None


def test_blocks_follow_each_other_until_ctrl_c() -> None:
    scripted, interrupted = Scripted(), threading.Event()
    scripted.after_read = after(12, interrupted.set)
    made, drawn = watch(scripted, interrupted)
    made.run()
    text = drawn.getvalue()
    assert text.count("cam: 640 x 480 px, 25.0 pictures/s") >= 2, "by when they came: 40 ms"
    assert text.count("Ctrl-C ends") >= 2


def test_a_camera_that_goes_is_told_waited_for_and_taken_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tuning, "RETRY_S", 0.0)
    scripted, interrupted = Scripted(), threading.Event()
    plugged = scripted.open

    def unplug() -> None:
        scripted.fails = GONE

    def plug() -> list[str]:
        scripted.fails = None
        scripted.after_read = after(scripted.reads + 12, interrupted.set)
        return plugged()

    scripted.after_read = after(8, unplug)
    made, drawn = watch(scripted, interrupted)
    scripted.open = plug  # type: ignore[method-assign]
    made.run()
    before, gone, later = drawn.getvalue().partition("gone, trying again every 0 s")
    assert gone and "pictures/s" in before and "pictures/s" in later


def test_one_damaged_picture_is_passed_over_and_many_are_told() -> None:
    scripted = Scripted(DAMAGED)
    camera = OpenCamera("cam", scripted, scripted)

    def mend() -> None:
        scripted.fails = None

    scripted.after_read = after(3, mend)
    assert camera.picture().image.size
    scripted.after_read, scripted.fails = (lambda reads: None), DAMAGED
    with pytest.raises(GrabberError, match=r"cam:.*12.*90"):
        camera.picture()
    assert scripted.reads == 3 + MOST_DAMAGED


def test_errors_name_the_camera_once() -> None:
    camera = OpenCamera("/dev/video0", Scripted(), None)
    assert str(camera.named(GrabberError("/dev/video0 is gone"))) == "/dev/video0 is gone"
    assert str(camera.named(GONE)) == "/dev/video0: gives no pictures for 0.4 s"


def test_what_the_camera_does_not_tell_is_what_it_was_asked_for() -> None:
    scripted = Scripted()
    camera = OpenCamera("stream", scripted, None)
    made = tuner_of(camera, options(Controls(exposure_us=4000.0)), None)
    shown = made.view(scripted.read().image, scripted.read().image, None)
    assert shown.reading.exposure_us == 4000.0 and shown.reading.gain is None


def test_speed_and_scale_of_the_user() -> None:
    scripted = Scripted()
    made = tuner(scripted, speed=0.5, px_per_m=100.0)
    reading = made.view(scripted.read().image, scripted.read().image, None).reading
    assert reading.blur_px == pytest.approx(0.5 * 0.01 * 100.0)
    assert reading.scale is not None and reading.scale.source == "--px-per-m"


RESOURCES = """\
<arena_tracking_system>
  <grabbers /><trackers />
  <cameras><camera id="ceiling" calibration="c.json" /></cameras>
</arena_tracking_system>
"""


def test_calibration_comes_from_the_resources_file(tmp_path: Path) -> None:
    path = tmp_path / "resources.xml"
    path.write_text(RESOURCES)
    (tmp_path / "c.json").write_text(CALIBRATION.to_json())
    found = calibration_of(options(camera="ceiling", resources=str(path)))
    assert found is not None and found.id == "ceiling"
    assert calibration_of(options(camera=None, resources=str(path))) is None
    with pytest.raises(UsageError, match="camera 'floor'"):
        calibration_of(options(camera="floor", resources=str(path)))
    with pytest.raises(UsageError, match="expected --resources"):
        calibration_of(options(camera="ceiling", resources=None))
