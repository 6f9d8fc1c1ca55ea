"""Pictures that are older than their stamps: the camera is told with by how much, and no other."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import Frame
from vsense.base.errors import NoMorePictures
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.cameras.health import Health
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.camera_tracking import CameraTracking

FAMILY = load_family("arrow4x4-thesis")
PERIOD_S = 0.1
LENGTH = 64
MOST_PERIODS = 4
ROBOTS = 6
TAGS = (31, 1843, 4334, 7167, 7488, 10084)
HEIGHTS_M = dict.fromkeys(TAGS, HEIGHT_M)
SPEED_M_S = 0.12
BLANK = np.zeros((480, 640), np.uint8)
NAMES = ("north", "east", "south", "west")


def below(id: str, x_m: float, y_m: float) -> Camera:
    return Camera.looking_down(id, x_m, y_m, 2.43, 900.0, (640, 480))


RIG = tuple(below(id, *at) for id, at in zip(NAMES, ((0, 0.25), (0.3, 0), (0, -0.25), (-0.3, 0))))


@cache
def ways() -> tuple[tuple[Robot, ...], ...]:
    """Robots that drive at full speed and turn, each in a place of its own that all cameras see."""
    rng = np.random.default_rng(5)
    homes = np.array([(x, y) for x in (-0.2, 0.0, 0.2) for y in (-0.15, 0.15)])
    offs, yaws = rng.uniform(-0.05, 0.05, (ROBOTS, 2)), rng.uniform(-3.0, 3.0, ROBOTS)
    shown = []
    for _ in range(LENGTH):
        moved = offs + SPEED_M_S * PERIOD_S * np.stack((np.cos(yaws), np.sin(yaws)), axis=1)
        stays = (np.abs(moved) < (0.06, 0.11)).all(axis=1) & (rng.random(ROBOTS) > 0.05)
        offs[stays] = moved[stays]
        yaws[~stays] += rng.uniform(0.4, 1.2, int((~stays).sum()))
        poses = zip(TAGS, (homes + offs).tolist(), yaws.tolist())
        shown.append(tuple(Robot(tag, x, y, yaw) for tag, (x, y), yaw in poses))
    return tuple(shown)


@cache
def picture(camera: Camera, timestep: int) -> np.ndarray:
    look = Look(litter=0, noise=4.0)
    return render(camera, FAMILY, list(ways()[timestep]), look, seed=timestep)


DETECTOR = make_detector(FAMILY, TAGS, HEIGHT_M)


@cache
def detected(camera: Camera, timestep: int) -> np.ndarray:
    return DETECTOR.detect(picture(camera, timestep), camera)


Change = Callable[[int, np.ndarray], np.ndarray]


def watch(
    rig: Sequence[Camera],
    late: dict[str, int],
    known: Sequence[Camera] = (),
    stands: bool = False,
    change: Change = lambda timestep, rows: rows,
) -> list[tuple[float, str]]:
    """Returns what is told, and when [s].

    `late` cameras' pictures are so many periods old; `known` are the cameras as they were
    calibrated, where that is wrong; `change` is what else becomes of a picture's detections.
    """
    health = Health(known or rig, HEIGHTS_M)
    told = []
    for timestep in range(MOST_PERIODS, LENGTH):
        frames, found = [], {}
        for camera in rig:
            shown = 0 if stands else timestep - late.get(camera.id, 0)
            frames.append(Frame(camera.id, BLANK, timestep, round(1e9 * PERIOD_S * timestep), 0))
            found[camera.id] = change(timestep, detected(camera, shown))
        told += [(timestep - MOST_PERIODS, event) for event in health.update(frames, found)]
    return [(PERIOD_S * at, str(event)) for at, event in told if event.kind in ("late", "apart")]


def late_ms(line: str) -> int:
    return int(re.search(r"is late by about (\d+) ms", line)[1])


@pytest.mark.parametrize(
    ("rig", "periods"),
    [
        *(pytest.param(RIG[:2], n, id=f"two cameras, {n}") for n in (1, 3)),
        *(pytest.param(RIG, n, id=f"four cameras, {n}") for n in (2, 4)),
        *(pytest.param(RIG[:2], n, marks=pytest.mark.campaign) for n in (2, 4)),
        *(pytest.param(RIG, n, marks=pytest.mark.campaign) for n in (1, 3)),
    ],
)
def test_a_late_camera_is_told_within_seconds_with_by_how_much(
    rig: Sequence[Camera], periods: int
) -> None:
    for name in ("north", "east"):
        (at_s, line), *more = watch(rig, {name: periods})
        assert more == [] and at_s < 5.0
        assert line.startswith(f"camera {name}: is late by about ")
        assert late_ms(line) == pytest.approx(1e3 * PERIOD_S * periods, abs=30)


def test_two_late_cameras_are_told_each_with_its_own_delay() -> None:
    told = [line for _, line in watch(RIG, {"south": 2, "west": 4})]
    assert [line.split(":")[0] for line in sorted(told)] == ["camera south", "camera west"]
    assert [late_ms(line) for line in sorted(told)] == pytest.approx([200, 400], abs=30)


def test_a_late_camera_has_not_moved() -> None:
    """Robots that drive the same way are all as far off as if the camera had been knocked."""
    assert [line for _, line in watch(RIG[:2], {"north": 4}) if "disagree" in line] == []


@pytest.mark.parametrize("stands", [False, True])
def test_cameras_that_are_not_late_are_not_told(stands: bool) -> None:
    assert watch(RIG, {}, stands=stands) == []
    noise = np.random.default_rng(3)

    def shake(timestep: int, rows: np.ndarray) -> np.ndarray:
        rows = rows.copy()
        for name in ("x_px", "y_px"):
            rows[name] += noise.normal(0.0, 1.0, len(rows))
        return rows

    assert watch(RIG, {}, stands=stands, change=shake) == []


def test_standing_robots_tell_no_time() -> None:
    assert watch(RIG[:2], {"north": 4}, stands=True) == []


@pytest.mark.parametrize(
    "wrong",
    [
        "shifted",
        "higher",
        *(
            pytest.param(wrong, marks=pytest.mark.campaign)
            for wrong in ("turned", "longer", "bent")
        ),
    ],
)
def test_a_camera_that_is_calibrated_wrong_is_not_late(wrong: str) -> None:
    x, y, z = RIG[0].position_m
    c, s = np.cos(0.05), np.sin(0.05)
    turn = np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)])
    turned = np.reshape(RIG[0].rotation, (3, 3)) @ turn
    changed = {
        "shifted": replace(RIG[0], position_m=(x + 0.03, y, z)),
        "turned": replace(RIG[0], rotation=tuple(turned.ravel().tolist())),
        "higher": replace(RIG[0], position_m=(x, y, z + 0.2)),
        "longer": replace(RIG[0], fx_px=0.95 * RIG[0].fx_px),
        "bent": replace(RIG[0], distortion=(0.5, 0.0, 0.0, 0.0, 0.0)),
    }[wrong]
    told = watch(RIG, {}, known=(changed, *RIG[1:]))
    assert [line for _, line in told if "late" in line] == []


def test_a_camera_that_is_late_and_calibrated_wrong_is_told_both() -> None:
    x, y, z = RIG[0].position_m
    shifted = replace(RIG[0], position_m=(x + 0.03, y, z))
    told = [line for _, line in watch(RIG[:2], {"north": 3}, known=(shifted, RIG[1]))]
    assert sorted(line.split(" ", 2)[2].split(" ")[0] for line in told) == ["and", "is"]


def test_the_end_is_told() -> None:
    health = Health(RIG[:2], HEIGHTS_M)
    told = []
    for timestep in range(3 * LENGTH):
        way = timestep % (2 * LENGTH)
        shown = min(way, 2 * LENGTH - 1 - way)  # there, back, and there again
        late = 3 if timestep < LENGTH - 4 else 0
        at_ns = round(1e9 * PERIOD_S * timestep)
        frames = [Frame(camera.id, BLANK, timestep, at_ns, 0) for camera in RIG[:2]]
        back = {"north": max(shown - late, 0), "east": shown}
        found = {camera.id: detected(camera, back[camera.id]) for camera in RIG[:2]}
        told += [str(e) for e in health.update(frames, found) if e.kind in ("late", "timely")]
    assert [line.split(":")[0] for line in told] == ["camera north"] * 2
    assert told[1] == "camera north: is no longer late"


class Late:
    """Gives the pictures of two cameras, of which one is late."""

    timesteps, missed = LENGTH - MOST_PERIODS, 0

    def __init__(self, periods: int) -> None:
        self._periods, self._timestep = periods, MOST_PERIODS

    def next(self, timeout_s: float) -> list[Frame]:
        """Gives the next timestep."""
        now, self._timestep = self._timestep, self._timestep + 1
        if now == LENGTH:
            raise NoMorePictures("all were given")
        shown = {"north": now - self._periods, "east": now}
        at_ns = round(1e9 * PERIOD_S * now)
        return [Frame(c.id, picture(c, shown[c.id]), now, at_ns, at_ns) for c in RIG[:2]]

    def events(self) -> list[CameraEvent]:
        """Nothing else happens."""
        return []

    def close(self) -> None:
        """Has nothing to close."""


def test_a_tracking_session_tells_it_and_keeps_it_as_the_cameras_state() -> None:
    told: list[str] = []
    tracker = ArenaTracker.for_family(RIG[:2], FAMILY, HEIGHTS_M)
    tracking = CameraTracking(Late(3), tracker, told.append)
    for _ in range(LENGTH - MOST_PERIODS):
        tracking.next(1.0)
        tracking.check_cameras()
    tracking.close()
    (line,) = [line for line in told if "late" in line]
    assert late_ms(line) == pytest.approx(300, abs=30)
    assert tracking.troubles.present["north", "late"].text in line
