"""Pictures that no camera of a session can have taken, and sizes that no tracker takes: told where
they are, and no success where there is no state."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.vision.tracking.synthetic import Look, Robot, render
from vsense import cli
from vsense.base.errors import VsenseError
from vsense.base.native import kernels
from vsense.vision.cameras._recorded_grabber import RecordedGrabber
from vsense.vision.cameras._recordings import DirectoryRecording
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.camera_tracking import CameraTracking

SIZE = (480, 360)
RESOURCES = """<arena_tracking_system>
<grabbers><grabber id="g" type="directory" path="pictures" /></grabbers>
<trackers><tracker id="t" tags="31" /></trackers>
<cameras>
<camera id="top" calibration="top.json" />
</cameras>
</arena_tracking_system>"""
EXPERIMENT = """<arena_tracking><arena_state_tracker>
<camera_state_tracker grabber="g" camera="top" tracker="t" />
</arena_state_tracker></arena_tracking>"""


def session(folder: Path, size: tuple[int, int] = SIZE) -> list[str]:
    camera = Camera.looking_down("top", 0.0, 0.0, 2.4, 1600.0, size)
    (folder / "top.json").write_text(camera.to_json())
    (folder / "resources.xml").write_text(RESOURCES)
    (folder / "experiment.xml").write_text(EXPERIMENT)
    (folder / "pictures").mkdir()
    return [str(folder / "resources.xml"), str(folder / "experiment.xml")]


def picture() -> np.ndarray:
    camera = Camera.looking_down("top", 0.0, 0.0, 2.4, 1600.0, SIZE)
    return render(camera, load_family("arrow4x4"), [Robot(31, 0.0, 0.0, 0.5)], Look(litter=3))


def flipped(data: bytes, bits: int) -> bytes:
    """A JPEG whose header claims another width: bits of its size have changed on the disk."""
    place = data.index(b"\xff\xc0") + 7
    width = int.from_bytes(data[place : place + 2], "big") ^ bits
    return data[:place] + width.to_bytes(2, "big") + data[place + 2 :]


def spoil(folder: Path) -> None:
    jpeg = bytes(cv2.imencode(".jpg", picture())[1])
    (folder / "1.jpg").write_bytes(flipped(jpeg, 0x80))
    (folder / "2.jpg").write_bytes(flipped(jpeg, 0xC000))
    assert cv2.imwrite(str(folder / "3.png"), np.zeros((10_000, 10_000), np.uint8))
    (folder / "4.jpg").write_bytes(jpeg[: len(jpeg) // 2])


def test_pictures_that_no_camera_took_are_told_and_the_good_ones_tracked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = session(tmp_path)
    spoil(tmp_path / "pictures")
    assert cv2.imwrite(str(tmp_path / "pictures" / "5.png"), picture())
    assert cli.main(["track", *files, "--offline"]) == 0
    out = capsys.readouterr()
    assert len(out.out.splitlines()) == 1 and '"tag":31' in out.out
    for told in (
        "camera top: a picture of 352 x 360 px, its calibration is for 480 x 360",
        "camera top: 3.png claims to have 10000 x 10000 pixels, expected at most 50000000 pixels",
        "camera top: 4.jpg is cut off",
    ):
        assert told in out.err


def test_a_session_without_a_state_is_an_error_that_says_what_was_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = session(tmp_path)
    spoil(tmp_path / "pictures")
    assert cli.main(["track", *files, "--offline"]) == 1
    out = capsys.readouterr()
    assert out.out == ""
    last = out.err.splitlines()[-1]
    assert last == (
        "vsense: the recording ends after 4 timesteps: none has a picture that can be used (camera"
        " top: 2 times damaged, camera top: 2 times size)"
    )


def test_no_state_is_an_error_for_run_and_serve_too_whatever_pace(tmp_path: Path) -> None:
    session(tmp_path)
    spoil(tmp_path / "pictures")
    recordings = {"top": DirectoryRecording(tmp_path / "pictures")}
    camera = Camera.looking_down("top", 0.0, 0.0, 2.4, 1600.0, SIZE)
    tracker = ArenaTracker.for_family([camera], load_family("arrow4x4"), {31: 0.06})
    grabber = RecordedGrabber(recordings, {"top": SIZE}, lambda: 0)
    tracking = CameraTracking(grabber, tracker, lambda line: None)
    with pytest.raises(VsenseError, match=r"none .*picture") as caught:
        tracking.next(10.0)
    assert type(caught.value) is VsenseError, "a GrabberError would be waited for"
    tracking.close()


@pytest.mark.parametrize("command", ["track", "serve"])
@pytest.mark.parametrize("size, name", [((8193, 360), "width_px"), ((480, 9000), "height_px")])
def test_a_camera_larger_than_the_tracker_takes_is_refused_at_its_line(
    command: str,
    size: tuple[int, int],
    name: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = session(tmp_path, size)
    assert cli.main([command, *files]) == 2
    value = max(size)
    assert capsys.readouterr().err == (
        f"vsense: {files[0]}:5: <camera> calibration: {tmp_path}/top.json: {name} is {value},"
        " expected at most 8192\n"
    )


def test_the_largest_camera_is_tracked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    side = kernels.VS_MARKERS_SIDE
    files = session(tmp_path, (side, 64))
    blank = np.full((64, side), 128, np.uint8)
    assert cv2.imwrite(str(tmp_path / "pictures" / "1.png"), blank)
    assert cli.main(["track", *files, "--offline"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_serving_a_recording_without_a_usable_picture_ends(tmp_path: Path) -> None:
    files = session(tmp_path)
    spoil(tmp_path / "pictures")
    words = [sys.executable, "-m", "vsense", "serve", *files, "--port", "0"]
    done = subprocess.run(words, timeout=60.0, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "none has a picture" in done.stderr.splitlines()[-1]
