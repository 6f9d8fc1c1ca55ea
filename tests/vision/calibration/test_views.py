"""Corners files: written and read again, and refused with file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import ConfigError, UsageError
from vsense.vision.calibration._placement import read_points, read_seen
from vsense.vision.calibration._views import View, read_corners, write_corners

names = st.text('abcdefghij_-0123456789 ,"', min_size=1, max_size=8).map(lambda t: f"a{t}z")
pixels = st.floats(-10.0, 5000.0).map(lambda value: round(value, 4))


@st.composite
def view_lists(draw: st.DrawFn) -> list[View]:
    keys = draw(st.sets(st.tuples(names, names), max_size=4))
    views = []
    for camera, moment in sorted(keys):
        ids = sorted(draw(st.sets(st.integers(0, 23), min_size=1, max_size=6)))
        places = [(draw(pixels), draw(pixels)) for _ in ids]
        views.append(View(camera, moment, np.array(ids), np.array(places)))
    return views


@given(view_lists())
def test_written_corners_are_read_again(
    tmp_path_factory: pytest.TempPathFactory, views: list[View]
) -> None:
    path = tmp_path_factory.mktemp("corners") / "corners.csv"
    write_corners(path, views)
    again = read_corners(path, 24)
    assert [(v.camera, v.moment) for v in again] == [(v.camera, v.moment) for v in views]
    for one, other in zip(views, again):
        np.testing.assert_array_equal(one.ids, other.ids)
        np.testing.assert_allclose(one.pixels, other.pixels, atol=1e-4)


HEADER = "camera,moment,corner,x_px,y_px\n"


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", 1, "no column 'camera'"),
        ("camera,moment,corner,x_px\n", 1, "no column 'y_px'"),
        (HEADER + "a,1,24,1,2\n", 2, "corner: '24': expected 0 to 23"),
        (HEADER + "a,1,-1,1,2\n", 2, "corner: '-1'"),
        (HEADER + f"a,1,{'1' * 5000},1,2\n", 2, "corner: '1111"),
        (HEADER + "a,1,3,1,2\na,1,3,1,2\n", 3, "there twice"),
        (HEADER + "a,1,3,1\n", 2, "4 values: the header has 5"),
        (HEADER + "a,1,3,nan,2\n", 2, "x_px: 'nan' is not a number"),
    ],
)
def test_wrong_corners_are_refused_with_their_line(
    tmp_path: Path, text: str, line: int, said: str
) -> None:
    path = tmp_path / "corners.csv"
    path.write_text(text)
    with pytest.raises(ConfigError) as refusal:
        read_corners(path, 24)
    assert refusal.value.line == line and said in str(refusal.value)


def test_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_corners(tmp_path / "none.csv", 24)


POINTS = "id,x_m,y_m,z_m\n" + "".join(f"p{k},{k},{k * k},0\n" for k in range(4))


def test_known_points_and_where_they_are_seen(tmp_path: Path) -> None:
    points, seen = tmp_path / "points.csv", tmp_path / "seen.csv"
    points.write_text(POINTS)
    seen.write_text("camera,id,x_px,y_px\nleft,p1,10,20\nleft,p1,11,21\nleft,p2,5,6\n")
    known = read_points(points)
    np.testing.assert_array_equal(known["p3"], (3.0, 9.0, 0.0))
    views = read_seen(seen, known, ["left"])
    assert [(v.camera, v.moment, len(v.ids)) for v in views] == [
        ("left", "point p1", 2),
        ("left", "point p2", 1),
    ]


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("right,p1,1,2", "camera: 'right': expected left"),
        ("left,p9,1,2", "id: 'p9' is not among"),
        ("left,p1,one,2", "x_px: 'one' is not a number"),
    ],
)
def test_wrong_sights_of_points_are_refused(tmp_path: Path, row: str, said: str) -> None:
    points, seen = tmp_path / "points.csv", tmp_path / "seen.csv"
    points.write_text(POINTS)
    seen.write_text(f"camera,id,x_px,y_px\n{row}\n")
    with pytest.raises(ConfigError, match=r"seen\.csv:2:") as refusal:
        read_seen(seen, read_points(points), ["left"])
    assert said in str(refusal.value)


def test_too_few_or_double_points_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("id,x_m,y_m,z_m\na,0,0,0\n")
    with pytest.raises(ConfigError, match="expected 4 or more"):
        read_points(path)
    path.write_text("id,x_m,y_m,z_m\na,0,0,0\na,1,0,0\n")
    with pytest.raises(ConfigError, match=r"points\.csv:3: id: a.*twice"):
        read_points(path)
