"""Cameras that were moved since their calibration: by known ways, in real and rendered pictures."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from tests.rigs.places import DATA
from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.base.arena import Frame
from vsense.vision.cameras._reference import (
    Displacement,
    IncomparableError,
    ReferenceWatch,
    background,
    compare,
    reference_path,
)
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family

Picture = np.ndarray
PHOTOS = sorted((DATA / "wall-tags" / "photos").glob("*.jpg"))[::6]
SIZE = (408, 306)
CAMERA = Camera.looking_down("a", 0.0, 0.0, 2.4, 810.0, (810, 610))


def photograph(number: int) -> Picture:
    """A real room, half as large as the phone took it."""
    whole = cv2.imread(str(PHOTOS[number]), cv2.IMREAD_GRAYSCALE)
    return cv2.resize(whole, SIZE, interpolation=cv2.INTER_AREA)


def arena(robots: int = 6, seed: int = 1) -> Picture:
    """A rendered floor; robots are elsewhere for each seed."""
    rng = np.random.default_rng(seed)
    at = [Robot(k + 1, *rng.uniform(-0.8, 0.8, 2), rng.uniform(-3, 3)) for k in range(robots)]
    return render(CAMERA, load_family("arrow4x4"), at, Look(noise=0.0), seed=3)


def seen(picture: Picture, rng: np.random.Generator, moved: Picture | None = None) -> Picture:
    """What a camera shows later: moved, in other light, with other things in it, and noisy."""
    height, width = picture.shape
    if moved is not None:
        border = {"flags": cv2.INTER_CUBIC, "borderMode": cv2.BORDER_REFLECT}
        picture = cv2.warpAffine(picture, moved, (width, height), **border)
    picture = picture.copy()
    for _ in range(8):
        at = rng.integers((width, height)).tolist()
        cv2.circle(picture, at, width // 35, int(rng.integers(255)), -1, cv2.LINE_AA)
        cv2.circle(picture, at, width // 80, int(rng.integers(255)), -1, cv2.LINE_AA)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, width), np.linspace(-0.5, 0.5, height))
    slope = 1.0 + rng.uniform(-0.4, 0.4) * x + rng.uniform(-0.4, 0.4) * y
    lit = picture * rng.uniform(0.6, 1.3) * slope + rng.normal(0.0, 2.5, picture.shape)
    return np.clip(lit, 0, 255).astype(np.uint8)


def motion(
    x: float = 0.0, y: float = 0.0, turn: float = 0.0, zoom: float = 1.0, size=SIZE
) -> Picture:
    """The (2, 3) map of a shift [px], and a turn [degrees] and zoom about the middle."""
    middle = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
    whole = cv2.getRotationMatrix2D(middle, -turn, zoom)
    whole[:, 2] += x, y
    return whole


def reach(moved: Picture, size: tuple[int, int] = SIZE) -> float:
    """How far the picture's corners are moved at most [px]."""
    width, height = size[0] - 1, size[1] - 1
    ends = np.array([(0, 0), (width, 0), (0, height), (width, height)], dtype=float)
    return float(np.hypot(*(ends @ moved[:, :2].T + moved[:, 2] - ends).T).max())


def tries(count: int, moved: Picture | None = None) -> Iterator[Displacement]:
    rng = np.random.default_rng(count)
    photographs = [photograph(number) for number in range(len(PHOTOS))]
    references = [seen(picture, rng) for picture in photographs]
    for number in range(count):
        place = number % len(photographs)
        yield compare(references[place], seen(photographs[place], rng, moved))


def test_cameras_that_were_not_moved_are_never_named_in_200_tries() -> None:
    found = [displacement.px for displacement in tries(200)]
    assert max(found) < 0.8, "half of what is reported"


@pytest.mark.parametrize(
    "moved",
    [
        motion(2.0),
        motion(-1.2, 1.7),
        motion(9.0, -5.5),
        motion(-12.0, 9.0),
        motion(turn=0.5),
        motion(turn=-6.0),
        motion(zoom=1.01),
        motion(3.0, 4.0, 1.0, 0.99),
    ],
)
def test_a_moved_camera_is_named_with_how_far(moved: Picture) -> None:
    planted = reach(moved)
    found = list(tries(8, moved))
    assert planted >= 2.0 and all(displacement.moved for displacement in found)
    # Fewer than half of the room's corners may be left in the picture: then it is only named.
    known = [displacement.px for displacement in found if np.isfinite(displacement.px)]
    assert len(known) >= 6
    assert known == pytest.approx([planted] * len(known), abs=max(0.5, 0.03 * planted))


def test_a_camera_that_was_moved_far_is_named() -> None:
    assert all(found.moved for found in tries(8, motion(-30.0, 21.6)))
    assert all(found.moved for found in tries(8, motion(80.0, turn=30.0)))


def test_turn_and_zoom_are_told() -> None:
    rng = np.random.default_rng(4)
    room = photograph(1)
    found = compare(room, seen(room, rng, motion(turn=2.0, zoom=1.02)))
    assert found.turn_deg == pytest.approx(2.0, abs=0.1)
    assert found.zoom == pytest.approx(1.02, abs=0.002)
    by = f"{found.px:.1f} px at most (turned {found.turn_deg:+.2f} deg, zoom {found.zoom:.4f})"
    assert found.in_words() == f"by {by}"


@pytest.mark.parametrize("shift", [0.0, 2.0, 7.3, 37.0])
def test_rendered_floors_whose_robots_are_elsewhere(shift: float) -> None:
    rng = np.random.default_rng(int(shift))
    size = (CAMERA.width_px, CAMERA.height_px)
    moved = motion(0.6 * shift, -0.8 * shift, size=size)
    found = compare(arena(seed=1), seen(arena(seed=2), rng, moved))
    assert found.px == pytest.approx(shift, abs=0.4)
    assert found.moved == (shift > 0.0)


def test_what_a_camera_writes_into_its_pictures_does_not_hide_that_it_was_moved() -> None:
    def signed(picture: Picture) -> Picture:
        font = (cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1, cv2.LINE_AA)
        picture = cv2.rectangle(picture.copy(), (0, 0), (190, 18), 0, -1)
        cv2.putText(picture, "2026-11-28 12:00:00", (3, 14), *font)
        return cv2.putText(picture, "IPCAM 7", (320, 300), *font)

    rng = np.random.default_rng(5)
    for number in range(len(PHOTOS)):
        room = photograph(number)
        other = photograph((number + 1) % len(PHOTOS))
        assert compare(signed(room), signed(seen(room, rng, motion(14.0, 3.0)))).moved
        assert compare(signed(room), signed(seen(other, rng))).moved


def test_what_cannot_be_compared_is_said_and_not_passed() -> None:
    rng = np.random.default_rng(6)
    room = photograph(0)
    plain = np.clip(rng.normal(120.0, 2.0, room.shape), 0, 255).astype(np.uint8)
    for before, now, why in (
        (plain, room, "its reference picture shows too little"),
        (room, plain, "its picture shows too little"),
        (room, np.zeros_like(room), "its picture shows too little"),
        (room, room[:200], "its reference picture has 408 x 306 px, its pictures 408 x 200"),
    ):
        with pytest.raises(IncomparableError, match=why):
            compare(before, now)
    only_robots = plain.copy()
    cv2.circle(only_robots, (100, 100), 14, 20, -1)
    with pytest.raises(IncomparableError):
        compare(only_robots, only_robots)
    assert compare(room, photograph(2)).facts()["moved_px"] is None, "another room"


def test_a_board_that_is_carried_around_is_not_background() -> None:
    room = photograph(0)
    pictures = []
    for place in range(9):
        pictures.append(room.copy())
        cv2.rectangle(pictures[-1], (40 * place, 60), (40 * place + 70, 150), 255, -1)
    assert np.array_equal(background(pictures), room)


@pytest.fixture
def watch(tmp_path) -> ReferenceWatch:
    for number, name in enumerate("ab"):
        path = reference_path(tmp_path / f"{name}.json")
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), photograph(number))
    reference_path(tmp_path / "d.json").write_bytes(b"\x89PNG\r\n\x1a\n")
    return ReferenceWatch({name: tmp_path / f"{name}.json" for name in "abcd"})


def frames(at_s: float, **pictures: Picture) -> list[Frame]:
    return [Frame(name, picture, 0, round(1e9 * at_s), 0) for name, picture in pictures.items()]


def test_each_camera_is_compared_at_once_and_again_after_each_run(watch: ReferenceWatch) -> None:
    rng = np.random.default_rng(7)
    a, b = photograph(0), photograph(1)
    moved = seen(b, rng, motion(5.0))
    assert "no reference picture of c" in watch.notes[1] and "d.png is cut off" in watch.notes[0]
    told = watch.look(frames(0.0, a=seen(a, rng), b=moved, c=a))
    assert [(event.camera, event.kind) for event in told] == [("b", "displaced")]
    assert told[0].text.startswith("has moved by 5.0 px at most")
    assert watch.look(frames(1.0, a=a, b=moved)) == [], "it was told"
    watch.again()
    assert watch.look(frames(2.0, a=a, b=b)) == [], "one camera for each timestep"
    told = watch.look(frames(2.1, a=a, b=b))
    assert [(event.camera, event.kind) for event in told] == [("b", "placed")]


def test_a_first_picture_that_is_dark_is_followed_by_others(watch: ReferenceWatch) -> None:
    dark, a = np.zeros(SIZE[::-1], np.uint8), photograph(0)
    moved = seen(a, np.random.default_rng(8), motion(5.0))
    assert watch.look(frames(0.0, a=dark)) == watch.look(frames(0.1, a=moved)) == []
    assert [event.kind for event in watch.look(frames(0.4, a=moved))] == ["displaced"]
    watch.again()
    told = [event for k in range(9) for event in watch.look(frames(1.0 + k, a=dark))]
    assert [event.kind for event in told] == ["uncompared"], "told once"
