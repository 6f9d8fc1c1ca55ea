"""The picture of a campaign: every setting and measure has its place, whatever the numbers."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.studies.report import _plot
from vsense.studies.series._comparison import draw

finite = st.floats(-1e9, 1e9)


@pytest.fixture(scope="module", autouse=True)
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Few pixels and no layout, which take most of the time."""
    sheet = tmp_path_factory.mktemp("style") / "coarse.mplstyle"
    sheet.write_text("savefig.dpi: 20\nfigure.constrained_layout.use: False\n")
    with _plot.styled(str(sheet)):
        yield


@settings(max_examples=15)
@given(
    st.integers(1, 5),
    st.lists(
        st.lists(st.lists(finite, max_size=6), min_size=5, max_size=5), min_size=1, max_size=5
    ),
)
def test_any_numbers_are_drawn(rows: int, table) -> None:
    settings_ = [{"sensor.noise": str(row), "light.position": "0,0,1"} for row in range(rows)]
    measures = {f"measure_{i}": some[:rows] for i, some in enumerate(table)}
    figure = draw("it", settings_, measures)
    assert _plot.encode(figure, "png").startswith(b"\x89PNG")
    assert [axes.get_xlabel() for axes in figure.axes] == [
        f"measure {i}" for i in range(len(table))
    ]
    words = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert words == [f"sensor.noise = {row}\nlight.position = 0,0,1" for row in range(rows)]


def test_runs_median_box_and_mean_are_where_they_belong() -> None:
    values = [[1.0, 2.0, 4.0, 8.0], [3.0, 3.5, 5.0, 6.0, 10.0]]
    (axes,) = draw("it", [{"a.b": "1"}, {"a.b": "2"}], {"walked_m": values}).axes
    assert axes.get_xlabel() == "walked [m]"
    assert [line.get_xdata().tolist() for line in axes.lines] == values
    boxes = [(box.get_x(), box.get_x() + box.get_width()) for box in axes.patches]
    medians = [c.get_segments()[0][0, 0] for c in axes.collections]
    for place, (line, some) in enumerate(zip(axes.lines, values)):
        low, middle, high = statistics.quantiles(some, n=4, method="inclusive")
        assert boxes[2 * place] == boxes[2 * place + 1] == (low, pytest.approx(high))
        assert medians[place] == middle
        assert (np.abs(line.get_ydata() - place) < 0.5).all()
    assert [text.get_text() for text in axes.texts] == ["3.75", "5.5"]


def test_a_campaign_without_settings_is_one_row(tmp_path: Path) -> None:
    figure = draw("it", [{}], {"one": [[1.0]], "two": [[]]})
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == ["as in the file"]
    assert figure.get_suptitle() == "it: 1 run of each setting"


def test_long_settings_are_shortened_and_told_apart() -> None:
    machines = [{"params.fsm": "--nstates 2 --s0 0 " * 9 + end} for end in "ab"]
    (axes,) = draw("it", machines, {"objective": [[1.0], [2.0]]}).axes
    first, second = (text.get_text().splitlines() for text in axes.get_yticklabels())
    assert first[0].startswith("1. params.fsm = ") and second[0].startswith("2. params.fsm = ")
    assert first[-1].endswith(" ...") and len(first) == 3
    assert max(map(len, first)) < 30
