"""Pictures on the disk: whose they are, and which show the same moment."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from vsense.base.errors import UsageError, VsenseError
from vsense.vision.calibration._pictures import gather, inspect

GREY = np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)


def put(path: Path, grey: int = 0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((48, 64), grey, np.uint8))
    return path


def found(*paths: Path, every: int = 1) -> list[tuple[str, str]]:
    return [(p.camera, p.moment) for p in gather(paths, every)]


def test_folder_per_camera_and_same_name_is_same_moment(tmp_path: Path) -> None:
    for name in ("left/b.png", "left/a.jpg", "right/a.png", "left/notes.txt"):
        put(tmp_path / name) if not name.endswith("txt") else (tmp_path / name).write_text("x")
    expected = [("left", "a"), ("left", "b"), ("right", "a")]
    assert found(tmp_path) == expected
    assert found(tmp_path / "left", tmp_path / "right") == expected
    assert found(tmp_path / "right" / "a.png", tmp_path / "left") == expected


def test_table_of_timesteps_says_which_moments_are_the_same(tmp_path: Path) -> None:
    for name in ("left/x1.png", "left/x2.png", "right/y7.png", "right/spare.png"):
        put(tmp_path / name)
    (tmp_path / "left/timestamps.csv").write_text(
        "picture,timestep,capture_ns\nx1.png,4,100\nx2.png,5,200\n"
    )
    (tmp_path / "right/timestamps.csv").write_text("picture,timestep,capture_ns\ny7.png,5,230\n")
    assert found(tmp_path) == [("left", "000004"), ("left", "000005"), ("right", "000005")]


def test_pictures_taken_within_20_ms_are_one_moment(tmp_path: Path) -> None:
    for name in ("left/a.png", "left/b.png", "right/c.png", "right/d.png"):
        put(tmp_path / name)
    (tmp_path / "left/timestamps.csv").write_text("picture,capture_s\na.png,1.000\nb.png,1.100\n")
    (tmp_path / "right/timestamps.csv").write_text("picture,capture_s\nc.png,1.015\nd.png,1.130\n")
    moments = dict(zip("abcd", (m for _, m in found(tmp_path))))
    assert moments["a"] == moments["c"]
    assert len(set(moments.values())) == 3


def test_video_gives_every_nth_frame(tmp_path: Path) -> None:
    path = tmp_path / "left.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    if not writer.isOpened():
        pytest.skip("OpenCV here writes no MJPG video")
    for grey in range(0, 250, 25):
        writer.write(np.full((48, 64, 3), grey, np.uint8))
    writer.release()
    assert found(path, every=4) == [("left", f"{n:06d}") for n in (0, 4, 8)]
    greys = [int(g) for _, _, g in inspect(gather([path], 4), lambda: np.mean, _ignore)]
    assert greys == pytest.approx([0, 100, 200], abs=4)


def _ignore(done: int, total: int) -> None:
    assert 0 < done <= total


def test_every_picture_is_looked_at_with_its_size(tmp_path: Path) -> None:
    for number in range(7):
        put(tmp_path / "left" / f"{number}.png", number * 20)
    seen = list(inspect(gather([tmp_path]), lambda: np.mean, _ignore))
    assert [(p.moment, size, float(g)) for p, size, g in seen] == [
        (str(n), (64, 48), n * 20.0) for n in range(7)
    ]


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "bad.avi").write_text("x")
    for path, said in (
        (empty, "no pictures"),
        (tmp_path / "none", "no such file"),
        (tmp_path / "notes.txt", "video.*folder"),
        (tmp_path / "bad.avi", "no video that can be read"),
    ):
        with pytest.raises(UsageError, match=said):
            gather([path])


def test_two_pictures_of_one_moment_are_refused(tmp_path: Path) -> None:
    put(tmp_path / "left" / "a.png")
    put(tmp_path / "left" / "a.jpg")
    with pytest.raises(UsageError, match=r"camera left.*picture a"):
        gather([tmp_path])


def test_broken_picture_is_refused_by_name(tmp_path: Path) -> None:
    path = put(tmp_path / "left" / "a.png")
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(VsenseError, match=r"a\.png"):
        list(inspect(gather([tmp_path]), lambda: np.mean, _ignore))
