"""Pictures of moments, with all cameras at once; the grabber is scripted."""

from __future__ import annotations

import io
import queue
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from vsense.base.arena import Frame
from vsense.base.errors import GrabberError, UsageError, VsenseError
from vsense.base.terminal import Console
from vsense.tools.camera_setup import shooting
from vsense.tools.camera_setup.shooting import Names, ShootingSession, ShootOptions
from vsense.vision.calibration.board import Board, page
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.markers import _paper

BOARD = Board.parse("charuco:7x5:30mm:4X4_50")
STEP_NS = 100_000_000
ASKED = ShootOptions("none.xml", Path("shoot"), None, None, None, "floor")


class Grabber:
    """Cameras that give what a test says, one timestep after the other.

    Attributes:
        now_ns: the time, which goes on with every timestep.
    """

    timesteps = None
    missed = 0

    def __init__(self, images: dict[str, np.ndarray]) -> None:
        self.images = images
        self.now_ns = 0
        self.said: list[CameraEvent] = []

    def next(self, timeout_s: float) -> Sequence[Frame]:
        self.now_ns += STEP_NS
        if not self.images:
            raise GrabberError("no camera gave a picture")
        # What comes now was taken a moment ago.
        taken_ns = self.now_ns - STEP_NS // 2
        return [Frame(c, image, 0, taken_ns, self.now_ns) for c, image in self.images.items()]

    def events(self) -> list[CameraEvent]:
        said, self.said = self.said, []
        return said

    def close(self) -> None:
        pass

    def clock(self) -> int:
        return self.now_ns


def board_picture() -> np.ndarray:
    drawn = _paper.draw(page(BOARD), 75)
    grey = drawn if drawn.ndim == 2 else cv2.cvtColor(drawn, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(grey)


def shoot(
    grabber: Grabber, folder: Path, cameras: Sequence[str], board: Board | None = None
) -> tuple[ShootingSession, io.StringIO]:
    heard = io.StringIO()
    return ShootingSession(
        list(cameras), folder, board, grabber, Console(heard), grabber.clock
    ), heard


def test_every_camera_gets_a_folder_and_says_whether_it_sees_the_board(tmp_path: Path) -> None:
    blank = np.full((480, 640), 90, np.uint8)
    grabber = Grabber({"b": blank, "a": board_picture()})
    made, heard = shoot(grabber, tmp_path, ["a", "b", "c"], BOARD)
    assert made.take("floor_01")
    assert heard.getvalue() == "floor_01: a 24 of 24 corners, b no board, c NO PICTURE\n"
    assert made.moments == {"floor_01": {"a": 24, "b": 0}}
    taken = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.png"))
    assert taken == ["a/floor_01.png", "b/floor_01.png"]
    assert np.array_equal(cv2.imread(str(tmp_path / "b/floor_01.png"), cv2.IMREAD_GRAYSCALE), blank)


def test_a_picture_from_before_the_key_is_not_the_moment(tmp_path: Path) -> None:
    grabber = Grabber({"a": np.zeros((8, 8), np.uint8)})
    made, _ = shoot(grabber, tmp_path, ["a"])
    grabber.now_ns += STEP_NS
    asked_ns = grabber.now_ns
    made.take("floor_01")
    assert grabber.now_ns - STEP_NS // 2 >= asked_ns


def test_cameras_that_deliver_nothing_make_no_moment(tmp_path: Path) -> None:
    made, heard = shoot(Grabber({}), tmp_path, ["a"])
    assert not made.take("floor_01")
    assert heard.getvalue() == "floor_01: a NO PICTURE\n" and list(tmp_path.iterdir()) == []


def test_what_happens_to_cameras_is_told(tmp_path: Path) -> None:
    grabber = Grabber({})
    grabber.said = [CameraEvent("a", "gone", "is gone")]
    made, heard = shoot(grabber, tmp_path, ["a"])
    made.idle()
    assert heard.getvalue() == "vsense: camera a: is gone\n"


def test_beginning_waits_for_all_and_names_who_is_missing(tmp_path: Path) -> None:
    grabber = Grabber({"a": np.zeros((8, 8), np.uint8)})
    made, heard = shoot(grabber, tmp_path, ["a", "b"])
    made.begin(threading.Event())
    assert heard.getvalue() == "vsense: no picture yet of b; going on without\n"
    assert grabber.now_ns >= shooting.FIRST_NS


def test_pictures_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    made, _ = shoot(Grabber({"a": np.zeros((8, 8), np.uint8)}), tmp_path, ["a"])
    with pytest.raises(VsenseError, match="cannot be made"):
        made.take("floor_01")


def by_hand(
    made: ShootingSession, folder: Path, typed: Sequence[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: queue.Queue[str | None] = queue.Queue()
    for line in (*typed, None):
        lines.put(line)
    monkeypatch.setattr(shooting, "_typed", lambda: lines)
    shooting._by_hand(made, Names(folder), threading.Event(), Console(io.StringIO()))


def test_enter_goes_on_and_a_word_begins_a_series(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, _ = shoot(Grabber({"a": np.zeros((8, 8), np.uint8)}), tmp_path, ["a"])
    by_hand(made, tmp_path, ["\n", "\n", "tilt\n", "\n", "../x\n", "q\n", "\n"], monkeypatch)
    assert list(made.moments) == ["floor_01", "floor_02", "tilt_01", "tilt_02"]


def test_nobody_writes_over_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "floor_01.png").touch()
    made, _ = shoot(Grabber({"a": np.zeros((8, 8), np.uint8)}), tmp_path, ["a"])
    by_hand(made, tmp_path, ["floor_01\n", "\n"], monkeypatch)
    assert list(made.moments) == ["floor_02"]
    assert (tmp_path / "a" / "floor_01.png").read_bytes() == b""


def test_names() -> None:
    names = Names(Path("nowhere"))
    assert names.next == "floor_01" and names.choose(" \n") == "floor_01"
    assert names.choose("tilt") == "tilt_01" and names.choose("tilt_07") == "tilt_07"
    names.take("tilt_07")
    assert names.next == "tilt_08"
    for bad in ("a/b", "..", "ä", "x y", "-x", "tilt_07"):
        assert names.choose(bad) == ""


def test_by_itself_it_takes_as_many_as_it_is_told(tmp_path: Path) -> None:
    made, _ = shoot(Grabber({"a": np.zeros((8, 8), np.uint8)}), tmp_path, ["a"])
    shooting._by_itself(made, Names(tmp_path, "tilt"), 1e-6, 3, threading.Event())
    assert list(made.moments) == ["tilt_01", "tilt_02", "tilt_03"]


def test_a_file_without_cameras_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "resources.xml"
    path.write_text(
        "<arena_tracking_system><grabbers/><trackers/><cameras/></arena_tracking_system>"
    )
    with pytest.raises(UsageError, match="grabber"):
        shooting.run(replace(ASKED, resources=str(path)))


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a/b", "", ".", "a b", "-x"])
def test_pictures_are_never_written_elsewhere(name: str) -> None:
    with pytest.raises(UsageError, match=r"--name:.*word"):
        shooting.run(replace(ASKED, name=name))


def test_a_count_needs_to_know_how_often() -> None:
    with pytest.raises(UsageError, match=r"--count:.*--every"):
        shooting.run(replace(ASKED, count=3))
