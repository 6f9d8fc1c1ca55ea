"""Several runs: groups, curves with mean and spread, and end values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.studies.report.runs import messages, write
from vsense.studies.report import _compare
from vsense.studies.report._compare import Group
from vsense.studies.report._findings import Findings, read_findings


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Findings]:
    folder = tmp_path_factory.mktemp("runs")
    made = [(True, 0.0), (False, 1.0), (False, 2.0), (False, 6.0)]
    paths = [
        write(
            folder / f"{place}.mcap",
            messages(blind=blind, seed=place, home=lambda timestep, f=factor: f * max(timestep, 0)),
        )
        for place, (blind, factor) in enumerate(made)
    ]
    paths.append(write(folder / "other.mcap", messages(name="other")))
    return [read_findings(path) for path in paths]


def test_groups_are_experiments_and_conditions(runs: list[Findings]) -> None:
    found = _compare.groups(runs)
    names = [(group.experiment, group.condition, len(group.runs)) for group in found]
    assert names == [("hand", "sighted", 3), ("hand", "blind", 1), ("other", "sighted", 1)]
    assert [len(members) for members in _compare.by_experiment(found).values()] == [2, 1]


def test_curves_have_mean_and_sample_deviation(runs: list[Findings]) -> None:
    curve = _compare.curve(_compare.groups(runs)[0], "items_home")
    assert curve is not None
    assert curve.time_s[0] == 0.0 and curve.time_s[-1] == pytest.approx(1.9)
    timesteps = np.arange(20.0)
    timesteps[8] = 7.0  # That one was missed: the value before it lasts.
    assert np.allclose(curve.mean, 3.0 * timesteps)
    assert np.allclose(curve.spread, np.std([1.0, 2.0, 6.0], ddof=1) * timesteps)


def test_a_single_run_has_no_spread(runs: list[Findings]) -> None:
    group = _compare.groups(runs)[1]
    curve = _compare.curve(group, "items_home")
    assert curve is not None and not curve.spread.any()
    assert _compare.table([group])["items home, at the end"]["blind"].spread is None
    assert _compare.curve(group, "unknown") is None


def test_end_values(runs: list[Findings]) -> None:
    members = _compare.by_experiment(_compare.groups(runs))["hand"]
    row = _compare.table(members)["items home, at the end"]
    sighted = row["sighted"]
    assert (sighted.mean, sighted.median) == (57.0, 38.0)
    assert sighted.spread == pytest.approx(19.0 * np.sqrt(7.0))
    assert list(row["blind"].values) == [0.0]
    distance = _compare.table(members)["distance per robot [m]"]["sighted"]
    assert distance.mean == pytest.approx(19 * 0.0125 / 2)


def test_a_curve_ends_with_the_shortest_run(runs: list[Findings], tmp_path: Path) -> None:
    sent = [m for m in messages() if m.topic != "/signals" or m.data["time_s"] < 0.55]
    short = read_findings(write(tmp_path / "short.mcap", sent))
    curve = _compare.curve(Group("hand", "sighted", [runs[1], short]), "items_home")
    assert curve is not None and curve.time_s[-1] == pytest.approx(0.5)
