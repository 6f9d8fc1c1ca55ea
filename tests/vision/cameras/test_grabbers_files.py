"""Directories and videos as recordings: real files, good ones and damaged ones."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import GrabberError
from vsense.vision.cameras._recordings import DirectoryRecording, VideoRecording
from vsense.vision.cameras.picture import PictureError, decode, to_grey


def scene(seed: int = 0, shape: tuple[int, int] = (48, 64)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return cv2.GaussianBlur(rng.integers(0, 256, shape, dtype=np.uint8), (0, 0), 1.5)


def encoded(suffix: str, image: np.ndarray) -> bytes:
    return bytes(cv2.imencode(suffix, image)[1])


@pytest.mark.parametrize("suffix", [".png", ".pgm", ".bmp", ".tiff"])
def test_a_picture_comes_as_it_was_written(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"a{suffix}").write_bytes(encoded(suffix, scene()))
    assert np.array_equal(DirectoryRecording(tmp_path).read(0), scene())


def test_colour_is_made_grey_with_the_usual_weights(tmp_path: Path) -> None:
    colour = np.full((4, 4, 3), (10, 100, 200), np.uint8)
    (tmp_path / "a.png").write_bytes(encoded(".png", colour))
    grey = DirectoryRecording(tmp_path).read(0)
    assert grey.shape == (4, 4)
    assert np.all(np.abs(grey.astype(int) - round(0.114 * 10 + 0.587 * 100 + 0.299 * 200)) <= 1)


@pytest.mark.parametrize("shape", [(3, 4), (3, 4, 1), (3, 4, 3), (3, 4, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_every_usual_layout_becomes_grey(shape: tuple[int, ...], dtype: type) -> None:
    image = np.full(shape, 100 if dtype is np.uint8 else 100 << 8, dtype)
    assert np.array_equal(to_grey(image), np.full((3, 4), 100, np.uint8))


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((3, 4, 2), np.uint8),
        np.zeros(9, np.uint8),
        np.zeros((3, 4)),
        np.zeros((0, 4), np.uint8),
    ],
)
def test_what_is_no_picture_is_refused(image: np.ndarray) -> None:
    with pytest.raises(PictureError):
        to_grey(image)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".pgm"])
def test_a_picture_cut_off_anywhere_is_told_and_never_half_used(suffix: str) -> None:
    whole = encoded(suffix, scene())
    for length in range(0, len(whole) - 1, max(1, len(whole) // 60)):
        with pytest.raises(PictureError, match=r"^a is (empty|cut off after \d+ bytes|no picture)"):
            decode(whole[:length], "a")
    assert decode(whole, "a").shape == (48, 64)


@given(st.binary(max_size=64), st.sampled_from([".png", ".jpg", ".pgm", ""]), st.integers(0, 800))
def test_any_damage_gives_a_picture_or_one_error(data: bytes, suffix: str, at: int) -> None:
    whole = encoded(suffix, scene()) if suffix else b""
    damaged = whole[:at] + data + whole[at + len(data) :]
    try:
        assert decode(damaged, "a").ndim == 2
    except PictureError as error:
        assert str(error).startswith("a ")


@pytest.mark.parametrize("length", [300, 1 << 20, (1 << 31) - 1, (1 << 32) - 1])
def test_a_png_that_claims_more_data_than_it_has_is_refused_before_it_costs_memory(
    length: int,
) -> None:
    data = bytearray(encoded(".png", np.zeros((48, 64), np.uint8)))
    place = data.find(b"IDAT") - 4
    data[place : place + 4] = length.to_bytes(4, "big")
    with pytest.raises(PictureError, match=rf"^a is cut off after {len(data)} bytes$"):
        decode(bytes(data), "a")


@pytest.mark.parametrize("behind", [b"\r\n", b"\0" * 500, b"\xff" * 16, b"\r\n" + b"\0" * 9])
def test_a_little_behind_a_jpeg_is_no_damage(behind: bytes) -> None:
    assert decode(encoded(".jpg", scene()) + behind, "a").shape == (48, 64)


def claiming(suffix: str, width: int, height: int) -> bytes:
    """A picture whose header claims another size than it has."""
    data = bytearray(encoded(suffix, scene()))
    place, size = (16, 4) if suffix == ".png" else (data.find(b"\xff\xc0") + 5, 2)
    sides = (width, height) if suffix == ".png" else (height, width)
    data[place : place + 2 * size] = b"".join(side.to_bytes(size, "big") for side in sides)
    return bytes(data)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_picture_that_claims_to_be_enormous_is_refused_before_it_costs_memory(
    suffix: str,
) -> None:
    with pytest.raises(PictureError) as caught:
        decode(claiming(suffix, 32767, 30000), "a")
    assert str(caught.value) == (
        "a claims to have 32767 x 30000 pixels, expected at most 50000000 pixels"
    )
    assert decode(encoded(suffix, scene()), "a", 48 * 64).shape == (48, 64)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".gif", ".tif", ".webp", ".ppm"])
@pytest.mark.parametrize("quality", [50, 101])
def test_the_size_is_found_in_every_kind_of_picture(suffix: str, quality: int) -> None:
    """A WebP of more than 100 % is of another kind, and so is one with opacity."""
    for channels in (3, 4) if suffix == ".webp" else (3,):
        how = [cv2.IMWRITE_WEBP_QUALITY, quality]
        whole = cv2.imencode(suffix, np.dstack([scene()] * channels), how)[1].tobytes()
        assert decode(whole, "a", 48 * 64).shape == (48, 64)
        with pytest.raises(PictureError, match=r"^a claims to have 64 x 48"):
            decode(whole, "a", 48 * 64 - 1)


def test_what_does_not_say_its_size_is_no_picture() -> None:
    with pytest.raises(PictureError, match=r"^a is no picture"):
        decode(encoded(".pam", np.dstack([scene()] * 3)), "a")


@pytest.mark.parametrize(
    "filling",
    [
        b"\xff\xe0\x00\x08\xff\xc0\xff\xff\xff\xff",  # looks like a header inside of a segment
        b"\xff\xff\xff\xfe\x00\x02",  # any number of 0xff, then an empty comment
        b"\xff\x01\xff\xd0",  # markers without a length
        b"\x00\x11\xff\x00",  # garbage between segments
    ],
)
def test_the_size_in_a_jpeg_is_found_behind_whatever_comes_before(filling: bytes) -> None:
    whole = encoded(".jpg", scene())
    with pytest.raises(PictureError, match=r"^a .*64 x 48"):
        decode(whole[:2] + filling + whole[2:], "a", 100)


def test_a_directory_is_in_natural_order_and_leaves_out_what_is_no_picture(tmp_path: Path) -> None:
    for name in ("b10.png", "b9.png", "notes.txt", "b9.json"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "folder.png").mkdir()
    recording = DirectoryRecording(tmp_path, start_ns=7, rate_hz=2.0)
    assert [(t.picture, t.capture_ns) for t in recording.taken] == [
        ("b9.png", 7), ("b10.png", 500_000_007),
    ]  # fmt: skip


def test_timestamps_decide_about_order_and_choice(tmp_path: Path) -> None:
    for name in "abc":
        (tmp_path / f"{name}.png").write_bytes(encoded(".png", scene(ord(name))))
    (tmp_path / "t.csv").write_text("picture,capture_s\nc.png,1\na.png,2\nlost.png,3\n")
    recording = DirectoryRecording(tmp_path, tmp_path / "t.csv")
    assert np.array_equal(recording.read(0), scene(ord("c")))
    assert np.array_equal(recording.read(1), scene(ord("a")))
    with pytest.raises(PictureError, match=r"^lost\.png.*No such file"):
        recording.read(2)


def test_a_directory_without_pictures_says_what_it_looks_for(tmp_path: Path) -> None:
    with pytest.raises(GrabberError, match=r"\.png, \.jpg"):
        DirectoryRecording(tmp_path)
    with pytest.raises(GrabberError, match="No such file"):
        DirectoryRecording(tmp_path / "nothing")


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video whose picture k is as bright as 10 k + 20."""
    path = tmp_path_factory.mktemp("film") / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 8.0, (64, 48), True)
    for k in range(12):
        writer.write(np.full((48, 64, 3), 10 * k + 20, np.uint8))
    writer.release()
    return path


def test_a_video_gives_its_pictures_in_any_order(film: Path) -> None:
    recording = VideoRecording(film, start_ns=3)
    assert [t.capture_ns for t in recording.taken[:2]] == [3, 125_000_003]
    for place in (0, 1, 5, 2, 2, 11):
        assert abs(float(recording.read(place).mean()) - (10 * place + 20)) < 2.0
    recording.close()
    recording.close()


def test_pictures_stay_as_they_are_whatever_is_read_after_them(film: Path, tmp_path: Path) -> None:
    for k in range(12):
        image = np.full((48, 64), 10 * k + 20, np.uint8)
        (tmp_path / f"{k}.png").write_bytes(encoded(".png", image))
    for recording in (VideoRecording(film), DirectoryRecording(tmp_path)):
        held = [recording.read(place) for place in range(12)]
        before = [image.copy() for image in held]
        for place in (*range(12), *range(12)):
            recording.read(place)
        recording.close()
        assert all(np.array_equal(a, b) for a, b in zip(held, before))
        assert not any(np.shares_memory(a, b) for a, b in pairwise(held))


def test_a_videos_timestamps_may_be_a_table(film: Path, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(
        "timestep,capture_s\n" + "".join(f"{k + 4},{k}\n" for k in range(14))
    )
    recording = VideoRecording(film, tmp_path / "t.csv")
    assert recording.taken[1].timestep == 5
    with pytest.raises(PictureError, match=r"film\.avi.*12 pictures"):
        recording.read(13)


def test_a_video_cut_off_gives_what_is_left(film: Path, tmp_path: Path) -> None:
    short = tmp_path / "short.avi"
    data = film.read_bytes()
    sixth = [at for at in range(len(data)) if data.startswith(b"00dc", at)][5]
    short.write_bytes(data[: sixth + 100])
    recording = VideoRecording(short)
    good = 0
    for place in range(len(recording.taken)):
        try:
            assert recording.read(place).shape == (48, 64)
            good += 1
        except PictureError as error:
            assert "short.avi" in str(error)
    assert 1 <= good < 12


def test_what_is_no_video_is_told(tmp_path: Path) -> None:
    (tmp_path / "x.avi").write_bytes(b"no video at all")
    with pytest.raises(GrabberError, match=r"x\.avi:.*OpenCV"):
        VideoRecording(tmp_path / "x.avi")
