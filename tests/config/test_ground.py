"""The floor's picture and fields, as an experiment file names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from vsense.base.errors import ConfigError
from vsense.config.arena import floor_of, make_field
from vsense.config.experiment import read
from vsense.config.specs import Experiment

Read = Callable[..., Experiment]


@pytest.fixture
def read_beside(tmp_path: Path, example: str) -> Callable[[str], Experiment]:
    """Reads the example with another element in its arena, beside the files of tmp_path."""
    (tmp_path / "mine.c").touch()

    def read_with(element: str) -> Experiment:
        text = example.replace("</arena>", f"{element}</arena>")
        return read(text.encode(), "x.argos", tmp_path / "x.argos")

    return read_with


def picture(path: Path, channels: int, dtype: type = np.uint8) -> np.ndarray:
    """Writes a picture of 3 x 2 pixels; gives it as red, green, blue and perhaps alpha."""
    values = np.arange(6 * max(channels, 1), dtype=dtype).reshape(2, 3, -1) * 10
    cv2.imwrite(str(path), values)
    order = {1: [0, 0, 0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]
    return values[:, :, order]


FLOOR = '<floor id="f" source="image" path="floor.png" />'


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_the_floor_shows_its_picture_around_the_origin(
    tmp_path: Path, read_beside: Callable[[str], Experiment], channels: int
) -> None:
    expected = picture(tmp_path / "floor.png", channels)
    experiment = read_beside(FLOOR)
    assert experiment.floor is not None
    assert (experiment.floor.id, experiment.floor.path) == ("f", tmp_path / "floor.png")
    floor = floor_of(experiment)
    # The arena is 3 x 2.4 m: pixels of 1 x 1.2 m, the first row at the highest y.
    points = [(x, y) for y in (0.6, -0.6) for x in (-1.0, 0.0, 1.0)]
    seen = floor.sample(points)[:, : expected.shape[2]]
    assert np.array_equal(seen, expected.reshape(6, -1))


def test_without_a_picture_the_floor_is_plain(read_text: Read, example: str) -> None:
    assert (floor_of(read_text(example)).sample([(0, 0)]) == 255).all()


def test_loop_functions_paint_at_a_resolution(read_beside: Callable[[str], Experiment]) -> None:
    experiment = read_beside('<floor id="f" source="loop_functions" pixels_per_meter="50" />')
    assert experiment.floor is not None
    assert (experiment.floor.path, experiment.floor.pixels_per_m) == (None, 50.0)


def test_the_picture_of_a_file_of_vsense_is_where_it_says(
    tmp_path: Path, read_beside: Callable[[str], Experiment]
) -> None:
    picture(tmp_path / "floor.png", 3)
    with pytest.raises(ConfigError, match=r"elsewhere/floor\.png"):
        read_beside(FLOOR.replace("floor.png", "elsewhere/floor.png"))


def test_what_is_no_picture_is_refused_at_its_line(
    tmp_path: Path, read_beside: Callable[[str], Experiment]
) -> None:
    path = tmp_path / "floor.png"

    def refused() -> str:
        with pytest.raises(ConfigError, match=r"^x\.argos:40: <floor> path:") as caught:
            read_beside(FLOOR)
        return str(caught.value)

    assert "No such file or directory, expected a picture" in refused()
    path.write_bytes(b"")
    assert "it is empty" in refused()
    path.write_bytes(b"P6 this is no picture")
    assert "it is no picture" in refused()
    cv2.imwrite(str(path), np.zeros((4097, 4096), np.uint8))  # 21 kB
    assert "4096 x 4097 pixels, expected at most 16777216" in refused()
    picture(path, 3, np.uint16)
    assert "has colours of 16 bits instead of 8" in refused()
    path.unlink()
    path.mkdir()
    assert "expected a picture" in refused()


def test_a_picture_that_vanishes_is_refused_when_it_is_needed(
    tmp_path: Path, read_beside: Callable[[str], Experiment]
) -> None:
    picture(tmp_path / "floor.png", 3)
    experiment = read_beside(FLOOR)
    (tmp_path / "floor.png").unlink()
    with pytest.raises(ConfigError, match=r"^x\.argos:40: <floor> path: .*No such file"):
        floor_of(experiment)


def test_a_field_is_made_as_the_file_says(read_beside: Callable[[str], Experiment]) -> None:
    experiment = read_beside(
        '<vs:field id="f" cell="0.1" evaporation="0.5" diffusion="0.001" initial="2" />'
    )
    field = make_field(experiment.fields[0], experiment.arena)
    assert field.concentration.shape == (24, 30)
    assert (field.evaporation_per_s, field.diffusion_m2_s) == (0.5, 0.001)
    assert field.total() == pytest.approx(2 * 3 * 2.4)


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ('cell="0.001"', r"cells of 0.001 m are 3000 x 2400 in this arena, expected at most"),
        ('cell="0.01" diffusion="1"', r"a diffusion of 1 m\^2/s is too fast .* expected at most"),
        ('cell="0"', r"cell: 0 is out of range, expected 0.001 to 10 m"),
    ],
)
def test_a_field_that_cannot_be_had_is_refused_at_its_line(
    read_beside: Callable[[str], Experiment], attributes: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=rf"^x\.argos:40: <vs:field>.* {words}|{words}"):
        read_beside(f'<vs:field id="f" {attributes} />')
