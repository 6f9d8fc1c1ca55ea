"""Hard pictures of all families, and a table of how many of their markers are named.

`scripts/bench hard` prints it: the share that is named in single pictures, without what a tracker
knows, and names that are not there. The test that holds its figures is `test_hard_sets.py`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.arena import UNNAMED
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers import families
from vsense.vision.markers.families import SquareFamily, load_family
from vsense.vision.tracking._detector import make_detector

LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
FAMILIES = ("arrow4x4", "arrow4x4-thesis", "aruco_4x4_50", "apriltag_36h11")
ROBOTS = 20
FOCAL_PX = 1620.0
APART_M = 0.075
AWAY_M = 2.37
SIZE_PX = (1000, 760)
SCALES_PX_PER_M = {"small": 2.0 / 5.3e-3, "usual": FOCAL_PX / AWAY_M}
"""Small: an arrow's unit is 2 px wide, a disc 26 px. Usual: as in the thesis, 3.6 px and 48 px."""
GLARE, GLARE_PX, GLARE_OFF_PX = 110.0, 8.0, 12.0
"""A spot of light on each disc: the most grey values that it adds, its standard deviation, and how
far from the disc's centre it may be, along each axis."""


class Tone(NamedTuple):
    """What becomes of a picture's grey values."""

    gain: float
    offset: float
    noise: float


@dataclass(frozen=True, slots=True)
class HardSet:
    """What makes pictures hard."""

    look: Look = field(default_factory=Look)
    tone: Tone | None = None
    has_glare: bool = False


SETS = {
    "easy": HardSet(),
    "blur 1.2 px": HardSet(Look(psf_px=1.2)),
    "noise 6": HardSet(Look(noise=6.0)),
    "noise 12": HardSet(Look(noise=12.0)),
    "glare": HardSet(has_glare=True),
    "dark": HardSet(tone=Tone(0.2, 2.0, 1.5)),
    "uneven": HardSet(Look(light=0.7, vignetting=0.5)),
    "low contrast": HardSet(tone=Tone(0.13, 100.0, 1.5)),
    "very hard": HardSet(Look(psf_px=1.5, noise=8.0, exposure_s=0.04, light=0.8)),
}
"""Dark: black and white are 34 grey values apart; low contrast: 22. Very hard: all at once, and
robots that drive 5 mm while they are exposed."""


class Score(NamedTuple):
    """Of how many markers how many are named, and how many names are wrong or misplaced."""

    markers: int
    named: int
    wrong: int

    def __str__(self) -> str:
        wrong = f", {self.wrong} wrong" if self.wrong else ""
        return f"{100.0 * self.named / self.markers:.0f} %{wrong}"


def crowd(tags: Sequence[int], camera: Camera, rng: np.random.Generator) -> list[Robot]:
    """Returns robots below a camera that touch nobody and drive."""
    reach = 0.42 * (camera.position_m[2] - HEIGHT_M) / camera.fx_px
    robots: list[Robot] = []
    for tag in tags:
        while True:
            x, y = rng.uniform(-1.0, 1.0, 2) * reach * (camera.width_px, camera.height_px)
            if all(np.hypot(x - r.x_m, y - r.y_m) > APART_M for r in robots):
                robots.append(Robot(tag, x, y, float(rng.uniform(-np.pi, np.pi)), 0.12))
                break
    return robots


@cache
def square_family(name: str) -> SquareFamily:
    """Loads a family of squares."""
    family = load_family(name)
    assert isinstance(family, SquareFamily)
    return family


def square_crowd(family: SquareFamily, camera: Camera) -> list[Robot]:
    """Returns 20 robots with squares, as `crowd`."""
    rng = np.random.default_rng(3)
    return crowd(rng.choice(family.tags, ROBOTS, replace=False).tolist(), camera, rng)


def retouch(
    image: np.ndarray, camera: Camera, robots: Sequence[Robot], hard: HardSet, seed: int
) -> np.ndarray:
    """Returns a (height, width) uint8 picture with a set's glare and tone."""
    rng = np.random.default_rng(seed)
    grey = image.astype(np.float64)
    if hard.has_glare:
        grey += glare(camera, robots, rng)
    if hard.tone is not None:
        grey = hard.tone.gain * grey + hard.tone.offset
        grey += rng.normal(0.0, hard.tone.noise, image.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def glare(camera: Camera, robots: Sequence[Robot], rng: np.random.Generator) -> np.ndarray:
    """Returns the grey values that spots of light on the discs add."""
    spots = np.zeros((camera.height_px, camera.width_px), dtype=np.float32)
    for robot in robots:
        middle = camera.project(np.array((robot.x_m, robot.y_m, HEIGHT_M)))
        x, y = np.rint(middle + rng.uniform(-GLARE_OFF_PX, GLARE_OFF_PX, 2)).astype(int)
        spots[np.clip(y, 0, camera.height_px - 1), np.clip(x, 0, camera.width_px - 1)] += 1.0
    spots = cv2.GaussianBlur(spots, (0, 0), GLARE_PX)
    return GLARE / spots.max() * spots


@cache
def roster(name: str) -> tuple[int, ...]:
    """Returns the tags that `vsense camera markers --ids auto:20` chooses."""
    return tuple(families.parse_tags(f"auto:{ROBOTS}", load_family(name)))


@cache
def drawn(
    name: str, px_per_m: float, look: Look, seed: int
) -> tuple[Camera, list[Robot], np.ndarray]:
    """Renders a picture of a family's whole roster."""
    camera = Camera.looking_down("c", 0.0, 0.0, HEIGHT_M + AWAY_M, px_per_m * AWAY_M, SIZE_PX, LENS)
    robots = crowd(roster(name), camera, np.random.default_rng(seed))
    return camera, robots, render(camera, load_family(name), robots, look, seed)


def shots(
    name: str, px_per_m: float, hard: HardSet, pictures: int
) -> list[tuple[Camera, list[Robot], np.ndarray]]:
    """Returns a set's pictures of one family."""
    made = []
    for seed in range(pictures):
        camera, robots, image = drawn(name, px_per_m, hard.look, seed)
        made.append((camera, robots, retouch(image, camera, robots, hard, seed)))
    return made


def score(name: str, px_per_m: float, hard: HardSet, pictures: int) -> Score:
    """Has a family's markers named, picture by picture."""
    detector = make_detector(load_family(name), roster(name), HEIGHT_M)
    total = Score(0, 0, 0)
    for camera, robots, image in shots(name, px_per_m, hard, pictures):
        found = detector.detect(image, camera)
        here = judge(found[found["tag"] != UNNAMED], robots, camera)
        total = Score(*(a + b for a, b in zip(total, here)))
    return total


def judge(named: np.ndarray, robots: Sequence[Robot], camera: Camera) -> Score:
    """Compares (n,) DETECTION with the truth; a name that is told twice is wrong once."""
    places = camera.to_plane(np.stack((named["x_px"], named["y_px"]), axis=-1), HEIGHT_M)
    truth = {robot.tag: robot for robot in robots}
    right: set[int] = set()
    wrong = 0
    for tag, (x, y) in zip(named["tag"].tolist(), places):
        robot = truth.get(tag)
        is_there = robot is not None and np.hypot(x - robot.x_m, y - robot.y_m) < 3e-3
        wrong += not is_there or tag in right
        right |= {tag} if is_there else set()
    return Score(len(robots), len(right), wrong)


def main(pictures: int) -> None:
    """Prints the table."""
    print(f"named of {pictures * ROBOTS} markers in single pictures, and wrong names if any\n")
    for scale, px_per_m in SCALES_PX_PER_M.items():
        print(f"| {scale:12} | " + " | ".join(f"{name:15}" for name in FAMILIES) + " |")
        print(f"| {'-' * 12} |" + f" {'-' * 15} |" * len(FAMILIES))
        for title, hard in SETS.items():
            cells = [str(score(name, px_per_m, hard, pictures)) for name in FAMILIES]
            print(
                f"| {title:12} | " + " | ".join(f"{cell:15}" for cell in cells) + " |", flush=True
            )
        print()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="scripts/bench hard", description=__doc__)
    parser.add_argument("pictures", nargs="?", type=int, default=5, help="of each set (default: 5)")
    main(parser.parse_args().pictures)
