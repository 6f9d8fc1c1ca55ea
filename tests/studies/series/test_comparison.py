"""The picture of a campaign: every setting and measure has its place, whatever the numbers."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.run.runs_csv import RunRow
from vsense.studies.report import Questions, _plot
from vsense.studies.report._charts import compared
from vsense.studies.report._compare import campaign_runs, groups
from vsense.studies.report.study._collect import TableOfRuns
from vsense.studies.report.study._results import results_of
from vsense.studies.report.study._section import boxes
from vsense.studies.series._comparison import PANELS_IN_ROW, draw

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
    dots, means = axes.lines[::2], axes.lines[1::2]
    assert [line.get_xdata().tolist() for line in dots] == values
    assert [float(line.get_xdata()[0]) for line in means] == [3.75, 5.5]
    medians = [c.get_segments()[0][0, 0] for c in axes.collections]
    assert medians == [statistics.median(some) for some in values]
    low, _, high = statistics.quantiles(values[1], n=4, method="inclusive")
    boxes = [(box.get_x(), box.get_x() + box.get_width()) for box in axes.patches]
    assert boxes == [(low, pytest.approx(high))] * 2, "four runs have no box"
    assert all((np.abs(line.get_ydata() - place) < 0.5).all() for place, line in enumerate(dots))


@pytest.mark.parametrize(
    ("values", "low", "high", "whole"),
    [
        ([2.0, 3.0, 4.0], 0.0, 4.16, True),  # near 0: from 0
        ([0.0, 0.0], -0.04, 1.0, True),
        ([3.0, 3.0], 0.0, 3.12, True),
        ([40.5, 41.0], 40.48, 41.02, False),  # varies a little around much
        ([-1.0, 2.0], -1.12, 2.12, True),
        ([-5.0, -2.0], -5.2, 0.0, True),
    ],
)
def test_an_axis_begins_where_the_data_ask_and_no_dot_is_cut(
    values: list[float], low: float, high: float, whole: bool
) -> None:
    (axes,) = draw("it", [{}], {"items": [values]}).axes
    assert axes.get_xlim() == pytest.approx((low, high))
    assert all(not line.get_clip_on() for line in axes.lines)
    ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
    assert len(ticks) > 1 and all(float(tick).is_integer() for tick in ticks) is whole


def test_a_report_draws_the_same_chart() -> None:
    values = [[2.0, 3.0, 3.0, 4.0, 4.0], [6.0, 7.0]]
    rows = [RunRow(run=f"{c}{n}", mode="sim", experiment="it", condition=f"a.b={c + 1}", seed=n,
                   measures={"items": v})
            for c, group in enumerate(values) for n, v in enumerate(group)]  # fmt: skip
    table = TableOfRuns(Path("it.csv"), rows)
    (result,) = results_of(rows, Questions(tests=False), lambda text: None)
    (drawing,) = boxes(result, "x-")
    (ours,) = draw("it", [{"a.b": "1"}, {"a.b": "2"}], {"items": values}).axes
    (theirs,) = drawing.figure.axes
    assert theirs.get_xlim() == ours.get_xlim()
    for one, other in zip(theirs.lines, ours.lines, strict=True):
        assert np.array_equal(one.get_xydata(), other.get_xydata())
    assert [b.get_bbox().bounds for b in theirs.patches] == [
        b.get_bbox().bounds for b in ours.patches
    ]
    # Another chart of the same numbers, of recordings that are compared.
    (end,) = [d for d in compared(groups([], campaign_runs(table))) if d.name.endswith("-end")]
    assert end.figure.axes[0].get_xlim() == ours.get_xlim()


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


def test_a_row_of_panels_is_as_high_whatever_is_below() -> None:
    runs = [[1.0, 2.0]]
    heights = []
    for rows in (1, 2, 4):
        measures = {f"m{number}": runs for number in range(rows * PANELS_IN_ROW)}
        heights.append(draw("it", [{"a.b": "1"}], measures).get_figheight())
    more = [{"a.b": str(number)} for number in range(10)]
    assert draw("it", more, {"m": runs * 10}).get_figheight() > heights[0] + 1.0
    first, second, fourth = heights
    assert second > first + 0.5 and fourth - second == pytest.approx(2.0 * (second - first))
