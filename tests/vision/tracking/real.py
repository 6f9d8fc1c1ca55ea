"""Real photographs for the tests: what they show, and what may happen to them on the way."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from tests.rigs.places import DATA
from vsense.vision.markers._dictionary import SquareFamily, load_codes


def grey(path: Path) -> np.ndarray:
    """Reads a picture as (height, width) uint8."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None, path
    return image


def square_family(dictionary: str, folder: Path = DATA) -> SquareFamily:
    """Returns a family of a dictionary's markers, of no particular size."""
    return SquareFamily(dictionary, load_codes(dictionary, folder), 45.0, 0.0, 70.0, (0.0, 0.0))


def wall_photos() -> Iterator[tuple[np.ndarray, set[int]]]:
    """Yields each photograph of the room with the ids in it."""
    folder = DATA / "wall-tags"
    ids = json.loads((folder / "ids.json").read_text())
    for path in sorted((folder / "photos").iterdir()):
        yield grey(path), set(ids[path.name])


def swarm_photos() -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yields name, photograph and (n, 4, 2) corners of NASA's Swarmathon, pixel centres whole."""
    for path in sorted((DATA / "swarmathon").glob("*.jpg")):
        text = path.with_suffix(".txt").read_text()
        values = [re.findall(r"[-\d.]+", line)[1:] for line in text.splitlines() if line]
        yield path.stem[:11], grey(path), np.array(values, dtype=float).reshape(-1, 4, 2) - 0.5


def half_size(image: np.ndarray) -> np.ndarray:
    return cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


def blurred(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), 2.0)


def motion_blurred(image: np.ndarray) -> np.ndarray:
    return cv2.blur(image, (9, 1))


def noisy(image: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(1).normal(0.0, 15.0, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def dark(image: np.ndarray) -> np.ndarray:
    return np.rint(0.25 * image).astype(np.uint8)


def compressed(image: np.ndarray) -> np.ndarray:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 10])
    return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
