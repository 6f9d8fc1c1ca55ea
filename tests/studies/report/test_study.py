"""Studies: which runs are compared with which, and what the page says of them."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.studies.report.runs import Reader
from vsense.base.errors import UsageError
from vsense.cli import main
from vsense.monitor.recording.form import RecordingError
from vsense.run.runs_csv import RunRow, RunsFile
from vsense.studies.report import Questions
from vsense.studies.report.report import make_report
from vsense.studies.report.study import _results, _words
from vsense.studies.report.study._collect import read_tables, tables_in
from vsense.studies.report.study._design import Study, studies
from vsense.studies.report.study._results import results_of

pytestmark = pytest.mark.usefixtures("coarse")


def row(run: int, condition: str, items: float | None = 1.0, **others: Any) -> RunRow:
    told: dict[str, Any] = {"mode": "lab", "experiment": "foraging", "series": "s", **others}
    return RunRow(run=str(run), condition=condition, measures={"items_home": items}, **told)


def plan(*conditions: str, blocks: int = 6) -> list[RunRow]:
    """A run of every condition in each block; later conditions bring home more."""
    return [
        row(10 * block + place, name, float(block + 10 * place), block=str(block), start="a")
        for block in range(blocks)
        for place, name in enumerate(conditions)
    ]


def written(path: Path, rows: list[RunRow]) -> Path:
    table = RunsFile(path)
    for one in rows:
        table.append(one)
    return path


def only(rows: list[RunRow], **asked: Any) -> Study:
    (found,) = studies(rows, **asked)
    return found


def test_void_runs_are_counted_and_never_pooled() -> None:
    rows = [*plan("blind", "sighted"), row(99, "blind", 1e6, verdict="void", why="fell over")]
    (result,) = results_of(rows, Questions())
    assert [arm.label for arm in result.study.arms] == ["sighted", "blind"]
    assert result.counts == "sighted n = 6 (0 invalid), blind n = 6 (1 invalid)"
    spread = result.measures[0].spreads[1]
    assert spread is not None and (spread.n, spread.greatest) == (6, 5.0)


def test_runs_of_another_experiment_or_kind_are_never_pooled() -> None:
    rows = [
        *plan("a", "b"), *(replace(r, mode="sim") for r in plan("a")),
        row(5, "a", experiment="other"),
    ]  # fmt: skip
    found = studies(rows)
    titles = ["foraging, sim", "foraging, lab", "other, lab"]
    assert sorted(study.title for study in found) == sorted(titles)
    by_mode = {study.title: [arm.label for arm in study.arms] for study in studies(rows, ("mode",))}
    assert by_mode == {
        "foraging, a": ["sim", "lab"], "foraging, b": ["lab"], "other, a": ["lab"],
    }  # fmt: skip
    both = studies(rows, ("mode", "condition"))
    assert [arm.label for arm in both[0].arms] == ["sim, a", "lab, a", "lab, b"]


def test_conditions_come_in_the_order_of_their_numbers() -> None:
    names = ["x=10", "x=9", "x=-1", "blind", "sighted"]
    found = only([row(place, name) for place, name in enumerate(names)])
    assert [arm.label for arm in found.arms] == ["sighted", "blind", "x=-1", "x=9", "x=10"]


def test_runs_with_the_same_start_are_pairs() -> None:
    (result,) = results_of(plan("a", "b"), Questions())
    (pair,) = result.measures[0].pairs
    assert result.study.keyed == ["series", "block", "start", "repetition"]
    assert pair.test is not None and pair.test.name == "Wilcoxon signed-rank test"
    # Six pairs, all of one sign (Siegel 1956, table G).
    assert (pair.test.p, pair.n) == (2 / 2**6, (6,))
    (result,) = results_of(plan("a", "b"), Questions(independent=True))
    (pair,) = result.measures[0].pairs
    assert pair.test is not None and pair.test.name == "Wilcoxon rank-sum test"
    assert pair.test.p == pytest.approx(2 / 924), "the least of 12 over 6"


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ([*plan("a", "b"), row(99, "a")], "not every run names its block"),
        ([*plan("a", "b"), row(99, "a", block="1", start="a")], "several runs of a condition"),
        ([r for r in plan("a", "b") if r.condition == "a" or r.block < "2"], "only 2 blocks have"),
    ],
)
def test_runs_that_are_no_pairs_are_independent_and_it_is_said(
    rows: list[RunRow], why: str
) -> None:
    study = only(rows)
    assert study.keyed == () and why in study.why_independent


def test_plans_that_number_their_starts_alike_make_no_pairs_across() -> None:
    """But the same plan in simulation and lab does: there every pair crosses series."""
    one, other = plan("a", "b"), [replace(r, series="t") for r in plan("a", "b")]
    study = only([*one, *other])
    assert study.keyed[0] == "series"
    assert study.blocks("items_home", study.arms)[0].shape == (12, 2)
    crossed = [*plan("a"), *(replace(r, series="t", mode="sim") for r in plan("a"))]
    assert list(only(crossed, by=("mode",)).keyed) == ["block", "start", "repetition"]


def test_three_conditions_have_friedman_and_holm() -> None:
    rows = [r for r in plan("a", "b", "c", blocks=8) if r.run != "71"]
    (result,) = results_of(rows, Questions())
    (found,) = result.measures
    assert found.overall is not None and found.overall.name == "Friedman test"
    assert (found.overall.n, found.overall.value, found.dropped) == ((7,), 14.0, 1)
    assert [pair.adjusted for pair in found.pairs] == pytest.approx([3 * 2 / 2**7] * 3)
    said = " ".join(_words.sentences(result, found))
    assert "1 block is not complete" in said
    assert "7 complete blocks, χ²(2) = 14" in said
    assert "Holm-adjusted over 3 pairs p = 0.047" in said
    free = [replace(r, block="", start="") for r in rows]
    (found,) = results_of(free, Questions())[0].measures
    assert found.overall is not None and found.overall.name == "Kruskal-Wallis test"


def test_what_no_result_could_show_is_said() -> None:
    (result,) = results_of(plan("a", "b", blocks=3), Questions())
    said = " ".join(_words.sentences(result, result.measures[0]))
    assert "p cannot be below 0.25, whatever the runs give" in said
    (result,) = results_of([row(1, "a"), row(2, "b")], Questions())
    said = " ".join(_words.sentences(result, result.measures[0]))
    assert "not tested (a condition has 1 run, at least 2 of each needed)" in said


def test_runs_without_a_number_are_left_out_and_told() -> None:
    rows = [*plan("a", "b"), *(row(90 + n, "a", bad, block=f"9{n}") for n, bad in
            enumerate((None, float("nan"), float("inf"))))]  # fmt: skip
    (result,) = results_of(rows, Questions())
    (found,) = result.measures
    assert (found.without, found.dropped, found.paired) == ([3, 0], 3, True)
    assert "a: 3 of 9 valid runs gave no number" in " ".join(_words.sentences(result, found))


def test_sameness_is_tested_against_a_persons_margin() -> None:
    rows = [row(n, name, 5.0 + n % 3) for name in "ab" for n in range(12)]
    (result,) = results_of(rows, Questions(margins={"items_home": 2.0}))
    same = result.measures[0].pairs[0].same
    assert same is not None and same.difference == 0.0
    said = " ".join(_words.sentences(result, result.measures[0]))
    assert "a the same as b within ±2: two one-sided Welch t-tests" in said
    assert ": shown at 5 %." in said
    (result,) = results_of(rows, Questions(margins={"items_home": 0.1}))
    assert ": not shown at 5 %." in " ".join(_words.sentences(result, result.measures[0]))
    assert "items home ±0.1" in _words.methods([result], Questions())


def test_one_condition_may_be_what_all_others_are_compared_with() -> None:
    rows = plan(*(f"c{n}" for n in range(12)))
    (result,) = results_of(rows, Questions(against="c3"))
    assert [pair.second for pair in result.measures[0].pairs] == ["c3"] * 11
    (result,) = results_of(rows, Questions())
    assert not result.measures[0].pairs and "--against CONDITION" in result.measures[0].left_out


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({"by": ("verdict",)}, "--by verdict: no column that groups runs"),
        ({"by": ("mod",)}, "is 'mode' meant?"),
        ({"margins": {"items": 1.0}}, "--same items: no measure of these runs; is 'items_home'"),
        ({"only": ("x",)}, "--measure x: no measure of these runs; there are: items_home"),
        ({"against": "c"}, "--against c: no condition of these runs; there are: a, b"),
    ],
)
def test_what_is_not_there_cannot_be_asked(asked: dict[str, Any], reason: str) -> None:
    with pytest.raises(UsageError) as told:
        results_of(plan("a", "b"), Questions(**asked))
    assert reason in str(told.value)


def test_a_run_that_is_named_twice_counts_once(tmp_path: Path) -> None:
    first = written(tmp_path / "1.csv", plan("a", "b"))
    second = written(tmp_path / "2.csv", [*plan("a"), row(500, "b")])
    found = read_tables([first, second, first, tmp_path / "." / "1.csv"])
    assert [(len(table.rows), table.repeated) for table in found] == [(12, 0), (1, 6)]
    other = written(tmp_path / "3.csv", [replace(plan("a")[0], verdict="void")])
    with pytest.raises(UsageError, match=r"3.csv: run '0' of series 's' is in .*1.csv, too, with"):
        read_tables([first, other])


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.csv")
    with pytest.raises(RecordingError, match="is a pipe, expected a file"):
        read_tables([tmp_path / "x.csv"])
    assert tables_in(tmp_path) == []


def test_what_else_differs_is_told() -> None:
    rows = [*(row(n, "a", robots=10) for n in range(3)), *(row(n, "b", robots=12) for n in (8, 9))]
    assert dict(only(rows).differences()) == {"robots": ["10", "12"]}


def test_other_robots_and_another_light_are_told_once() -> None:
    def arm(word: str, first: int, **told: object) -> list[RunRow]:
        return [row(n, word, **told) for n in range(first, first + 3)]

    dark = arm("a", 0, tags=(1, 2), uids=("aa", "bb"), light_level=0.30)
    alike = arm("b", 5, tags=(1, 3), uids=("aa", "cc"), light_level=0.32)
    assert dict(only([*dark, *alike]).differences()) == {"tags": ["1 2", "1 3"]}
    light = arm("b", 5, tags=(1, 2), uids=("aa", "cc"), light_level=0.40)
    told = dict(only([*dark, *light]).differences())
    assert told == {"uids": ["aa bb", "aa cc"], "light_level": ["0.3", "0.4"]}
    light[0] = replace(light[0], light_level=0.3)
    assert "light_level" not in dict(only([*dark, *light]).differences()), "they overlap"


@pytest.fixture(scope="module")
def page(coarse: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The report of three conditions, one run void, and its numbers."""
    folder = tmp_path_factory.mktemp("study")
    rows = plan("sighted", "blind", "<noise>")
    rows[4] = replace(rows[4], verdict="void", why="robot 23 lost for 7 s")
    made = make_report([written(folder / "runs.csv", rows)], folder / "out", form="svg")
    return folder / "out", json.loads(json.dumps(made.as_json()))


def test_the_page_says_all_of_a_study(page: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = page
    text = (folder / "report.html").read_text()
    read = Reader(text)
    assert read.headings == [
        "17 runs compared, 1 invalid", "foraging, lab: sighted against blind against <noise>",
        "Run-to-run spread", "Comparisons", "For the methods of a paper",
    ]  # fmt: skip
    assert "n: sighted 6 (invalid: 0), blind 5 (invalid: 1), &lt;noise&gt; 6 (invalid: 0)" in text
    assert "robot 23 lost for 7 s" in text and "Friedman test (exact), 5 complete blocks" in text
    assert "each of 17 valid runs gives one value" in text and "1 further run was invalid" in text
    assert "SciPy" in text and "seed 1" in text
    drawn = (folder / "runs-01-items_home.svg").read_text()
    assert ">sighted</text>" in drawn and ">(n = 5)</text>" in drawn


def test_a_study_without_a_valid_run_says_so(tmp_path: Path) -> None:
    rows = [replace(row, verdict="void", why="fell over") for row in plan("a", "b")]
    make_report([written(tmp_path / "runs.csv", rows)], tmp_path / "out", form="svg")
    text = (tmp_path / "out" / "report.html").read_text()
    read = Reader(text)
    assert read.headings[0] == "12 runs, none is valid"
    assert not {"Run-to-run spread", "Comparisons"} & set(read.headings)
    assert "a has no valid run" in text and "Invalid runs" in text and "Void" not in text


def test_the_numbers_are_those_of_the_page(page: tuple[Path, dict[str, Any]]) -> None:
    (study,) = page[1]["studies"]
    found = study["measures"]["items_home"]
    assert [each["n"] for each in study["conditions"]] == [6, 5, 6]
    assert study["conditions"][1]["void"] == [{"run": "11", "why": "robot 23 lost for 7 s"}]
    assert found["conditions"]["blind"]["values"] == [10.0, 12.0, 13.0, 14.0, 15.0]
    assert found["overall"]["value"] == pytest.approx(10.0) and found["incomplete_blocks"] == 1
    assert [pair["effect"]["a12"] for pair in found["pairs"]] == [0.0, 0.0, 0.0]
    assert escape(page[1]["methods"]) in (page[0] / "report.html").read_text()


def test_the_same_runs_give_the_same_page(tmp_path: Path) -> None:
    table = written(tmp_path / "runs.csv", plan("a", "b"))
    pages = [make_report([table], tmp_path / name, form="").files[0].read_bytes() for name in "xy"]
    assert pages[0] == pages[1]


def test_without_scipy_there_is_all_but_the_tests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)
    table = written(tmp_path / "runs.csv", plan("a", "b", "c"))
    command = ["report", str(table), "-o", str(tmp_path / "out")]
    assert main([*command, "--same", "items_home=1"]) == 2 and not (tmp_path / "out").exists()
    assert "statistical tests need the Python package scipy: " in capsys.readouterr().err
    assert main(command) == 0
    said = capsys.readouterr().err
    assert said.count("statistical tests need the Python package scipy: ") == 1
    text = (tmp_path / "out" / "report.html").read_text()
    assert "Statistical tests need the Python package scipy" in text
    assert "A12 = 0, 95 % interval 0 to 0" in text and "Wilcoxon" not in text
    assert (tmp_path / "out" / "runs-01-items_home.png").exists()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--by", "mode"], "--by: tables of runs (.csv) only, and none is named"),
        (["--unpaired", "--same", "a=1"], "--same, --unpaired: tables of runs (.csv) only"),
    ],
)
def test_questions_without_a_table_are_refused(
    arguments: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(tmp_path / "x.mcap"), *arguments]) == 2
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize("margin", ["items_home=-1", "items_home", "items_home=nan", "=1"])
def test_wrong_margins_are_usage_errors(margin: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["report", "x.csv", "--same", margin])
    assert "expected MEASURE=MARGIN with a margin above 0" in capsys.readouterr().err


def test_all_is_computed_for_many_runs() -> None:
    """More runs than exact tests take, and more differences than are sorted."""
    random = np.random.default_rng(1)
    rows = [row(n, name, float(random.normal())) for name in "ab" for n in range(101)]
    (result,) = results_of(rows, Questions(tests=False))
    effect = result.measures[0].pairs[0].effect
    assert effect is not None and effect.resamples == 1_000
    assert effect.a12_low is not None and 0.3 < effect.a12_low < effect.a12 < 0.7
    assert _results.as_json(result)["measures"]["items_home"]["pairs"][0]["test"] is None
