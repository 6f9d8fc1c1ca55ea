"""Square families: OpenCV's dictionaries, what their markers look like, the definitions."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vision.markers.texture import draw_texture
from tests.vision.tracking.real import DATA
from vsense.vision.markers._dictionary import SquareFamily, load_codes
from vsense.vision.markers.families import FamilyError, load_family

ARUCO = load_family("aruco_4x4_50")
TAG36 = load_family("apriltag_36h11")
BOARD = DATA / "opencv-tutorial" / "tutorial_dict.yml"
GOOD = {
    "name": "mine",
    "kind": "square",
    "dictionary": "DICT_5X5_100",
    "heading_deg": 90.0,
    "size_mm": 40.0,
    "disc_diameter_mm": 70.0,
}


def written(folder: Path, **change: object) -> str:
    file = folder / "mine.json"
    file.write_text(json.dumps(GOOD | change))
    return str(file)


@given(st.sampled_from([ARUCO, TAG36]), st.data())
def test_a_marker_looks_as_opencv_draws_it(family: SquareFamily, data: st.DataObject) -> None:
    tag = data.draw(st.integers(0, family.tags - 1))
    number = getattr(cv2.aruco, family.codes.name)
    side = family.codes.cells + 2
    drawn = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(number), tag, side)
    middle = (side - 1) / 2.0 - np.arange(side)
    up, left = np.meshgrid(middle, middle, indexing="ij")
    white = family.is_white(tag, np.stack((up, left), axis=-1) * family.cell_mm)
    assert white.tolist() == (drawn > 127).tolist()
    assert white[1:-1, 1:-1].tolist() == family.bits(tag).tolist()


@given(st.floats(-360.0, 360.0), st.integers(0, 49), st.integers(0, 2**32 - 1))
def test_the_heading_turns_the_marker_under_the_robot(deg: float, tag: int, seed: int) -> None:
    turned = SquareFamily("turned", ARUCO.codes, 45.0, deg, 70.0, (0.0, 0.0))
    points = np.random.default_rng(seed).uniform(-30.0, 30.0, (50, 2))
    turn = math.radians(deg)
    c, s = math.cos(turn), math.sin(turn)
    upright = points @ np.array([[c, s], [-s, c]])
    near = np.abs(np.mod(upright / ARUCO.cell_mm + 0.5, 1.0) - 0.5).min(axis=1) > 1e-6
    expected = ARUCO.is_white(tag, upright)
    assert (turned.is_white(tag, points) == expected)[near].all()


def test_around_the_black_square_there_is_white() -> None:
    assert ARUCO.is_white(3, np.array([[22.6, 0.0], [0.0, -22.6], [300.0, 300.0]])).all()
    assert not ARUCO.is_white(3, np.array([[22.4, 0.0], [0.0, -22.4], [-22.4, 22.4]])).any()


def test_the_shipped_families_fit_the_robots_disc() -> None:
    for family, tags, correction in ((ARUCO, 50, 1), (TAG36, 587, 5)):
        assert family.tags == tags and family.codes.correction == correction
        assert family.disc_diameter_mm == 70.0 and family.size_mm == 45.0
        drawn = draw_texture(family, 0, 2.0)
        assert drawn.ink.shape == drawn.coverage.shape == (142, 142)


def test_a_dictionary_file_lies_beside_its_definition(tmp_path: Path) -> None:
    (tmp_path / "board.yml").write_text(BOARD.read_text())
    family = load_family(written(tmp_path, dictionary="board.yml", centre_mm=[3.0, -1.0]))
    assert family.tags == 35 and family.codes.cells == 6 and family.codes.correction == 6
    assert family.disc_centre_mm.tolist() == [3.0, -1.0]
    first = "".join(str(int(bit)) for bit in family.bits(0).ravel())
    assert first == "101011111011111001001001101100000000"


@pytest.mark.parametrize("tag", [-1, 50])
def test_a_tag_that_the_family_does_not_have_is_refused(tag: int) -> None:
    with pytest.raises(FamilyError, match="0 to 49"):
        ARUCO.bits(tag)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"dictionary": "DICT_9X9_50"}, "'DICT_9X9_50'"),
        ({"dictionary": "detectMarkers"}, "not known"),
        ({"dictionary": "nowhere.yml"}, r"nowhere\.yml:"),
        ({"size_mm": 0.0}, "positive"),
        ({"size_mm": 50.0}, "rim"),
        ({"centre_mm": [9.0, 0.0]}, "rim"),
        ({"centre_mm": [9.0]}, "index"),
        ({"heading_deg": math.nan}, "heading_deg"),
        ({"heading_deg": "north"}, "north"),
        ({"kind": "round"}, "arrow or square"),
    ],
)
def test_a_broken_definition_is_named(
    tmp_path: Path, change: dict[str, object], complaint: str
) -> None:
    assert load_family(written(tmp_path)).name == "mine"
    with pytest.raises(FamilyError, match=complaint):
        load_family(written(tmp_path, **change))
    short = {key: value for key, value in GOOD.items() if key != "size_mm"}
    (tmp_path / "mine.json").write_text(json.dumps(short))
    with pytest.raises(FamilyError, match=r"size_mm.*missing"):
        load_family(str(tmp_path / "mine.json"))


@pytest.mark.parametrize("text", ["", "%YAML:1.0\n---\n", "%YAML:1.0\n---\nnmarkers: 2\n", "{"])
def test_a_broken_dictionary_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "broken.yml").write_text(text)
    with pytest.raises(FamilyError, match=r"broken\.yml"):
        load_codes("broken.yml", tmp_path)
