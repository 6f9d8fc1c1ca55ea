"""When pictures were taken: tables of timestamps, numbers in names, steady rates."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import ConfigError
from vsense.vision.cameras._recordings import CaptureTime, at_rate, read_timestamps
from vsense.vision.cameras.picture import natural_order


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "times.csv"
    path.write_text(text)
    return path


def test_numbers_in_the_names_leave_gaps_where_pictures_are_missing() -> None:
    taken = at_rate(["p_008.png", "p_010.png", "p_011.png"], 5, 10.0)
    assert taken == [
        CaptureTime("p_008.png", 8, 5), CaptureTime("p_010.png", 10, 200_000_005),
        CaptureTime("p_011.png", 11, 300_000_005),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "names", [["a.png", "b.png"], ["1_1.png", "2_1.png"], ["1699999.png", "1700033.png"]]
)
def test_numbers_that_do_not_count_are_not_used(names: list[str]) -> None:
    assert [(t.timestep, t.capture_ns) for t in at_rate(names, 0, 4.0)] == [
        (None, 0), (None, 250_000_000),
    ]  # fmt: skip


@given(st.lists(st.integers(0, 10**6), unique=True, max_size=30))
def test_natural_order_counts(numbers: list[int]) -> None:
    names = [f"img{n}_left.png" for n in numbers]
    assert sorted(names, key=natural_order) == [f"img{n}_left.png" for n in sorted(numbers)]


@given(st.lists(st.text(max_size=8)))
def test_natural_order_orders_any_names(names: list[str]) -> None:
    backwards = names[::-1]
    assert sorted(backwards, key=natural_order) == sorted(names, key=natural_order)


def test_a_table_is_read(tmp_path: Path) -> None:
    path = table(tmp_path, "picture, timestep ,capture_s\r\na.png,3,1.5\r\n\r\nb.png,7,1.625\r\n")
    assert read_timestamps(path, named=True) == [
        CaptureTime("a.png", 3, 1_500_000_000), CaptureTime("b.png", 7, 1_625_000_000),
    ]  # fmt: skip
    path = table(tmp_path, "\ufeffcapture_ns\n12\n13\n")
    assert read_timestamps(path, named=False) == [
        CaptureTime("", None, 12),
        CaptureTime("", None, 13),
    ]


@pytest.mark.parametrize(
    "text, line, words",
    [
        ("", 1, "is empty, expected a header of picture, timestep, capture_ns, capture_s"),
        ("picture,time\n", 1, "column 'time' is not one of: picture"),
        ("picture,picture,capture_s\n", 1, "a column is there twice"),
        ("picture\n", 1, "expected one of the columns capture_ns and capture_s"),
        ("picture,capture_s,capture_ns\n", 1, "expected one of the columns"),
        ("capture_s\n", 1, "column picture is missing"),
        ("picture,capture_ns\na.png\n", 2, "has 1 values, expected 2"),
        ("picture,capture_ns\na.png,1.5\n", 2, "capture_ns: '1.5' is not a whole number"),
        ("picture,capture_s\na.png,nan\n", 2, "capture_s: 'nan' is not a time in seconds"),
        ("picture,capture_s\na.png,1\n\nb.png,1\n", 4, "is not later than the picture before it"),
        ("picture,timestep,capture_s\na,4,1\nb,4,2\n", 3, "timestep: 4 does not rise"),
        ("picture,capture_s\n../a.png,1\n", 2, "'../a.png' is not a plain file name"),
        (f"picture,capture_s\na,1\n{'b' * 140_000},2\n", 3, "field larger than field limit"),
    ],
)
def test_a_broken_table_is_refused_at_its_line(
    tmp_path: Path, text: str, line: int, words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        read_timestamps(table(tmp_path, text), named=True)
    assert caught.value.line == line
    assert words in caught.value.message


@given(st.binary(max_size=200))
def test_any_bytes_are_a_table_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(b"picture,timestep,capture_s\n" + data)
    try:
        read_timestamps(path, named=True)
    except ConfigError as error:
        assert error.file == str(path)


def test_a_table_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing\.csv:1:.*No such file"):
        read_timestamps(tmp_path / "nothing.csv", named=True)
