"""Plans of series: what they say, what is refused and where, and the order of runs."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from vsense.base.errors import ConfigError, UsageError
from vsense.run.runs_csv import RunRow
from vsense.run.verdict import VoidCriteria
from vsense.studies.series._folder import differences
from vsense.studies.series._order import CUT, VoidLimit, cells, count_valid, duplicates, pending
from vsense.studies.series._plan import RobotRules, SeriesPlan, read

TEXT = """
name = "gradient"
mode = "sim"
experiment = "foraging"
repetitions = 3
again = 1

[[condition]]
name = "sighted"

[[condition]]
blind = true
settings = { "foraging.pull" = 0.5 }

[[start]]
name = "a"
seed = 7

[[start]]
poses = [[0.5, -0.5, 90], [1, 0, -180]]

[void]
lost_s = 5
"""


def plan_of(tmp_path: Path, text: str = TEXT) -> SeriesPlan:
    path = tmp_path / "plan.toml"
    path.write_text(text)
    return read(path)


def row(cell_of: SeriesPlan, number: int, verdict: str = "valid", why: str = "") -> RunRow:
    cell = cells(cell_of)[number - 1]
    return RunRow(
        run=f"run-{number:03d}",
        mode="sim",
        experiment="",
        condition=cell.condition,
        start=cell.start,
        repetition=str(cell.repetition),
        verdict=verdict,
        why=why,
    )


def test_a_plan_is_read(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    assert [c.name for c in plan.conditions] == ["sighted", "blind, foraging.pull=0.5"]
    assert plan.conditions[1].settings == {"foraging.pull": "0.5"}
    assert plan.starts[1].name == "start2"
    assert plan.starts[1].places.poses[0] == pytest.approx((0.5, -0.5, math.pi / 2))
    assert plan.runs == 12
    assert plan.void == VoidCriteria(lost_s=5.0)
    rules = RobotRules(battery_v=0.0, least=None, ready_s=60.0, home=True, virtual_walls=False)
    assert RobotRules() == rules


@pytest.mark.parametrize(
    ("before", "after", "line", "words"),
    [
        ('mode = "sim"', 'mode = "simulation"', 3, "expected one of sim, lab, run"),
        ("repetitions = 3", "repetitions = 0", 5, "a whole number from 1"),
        ("again = 1", "agian = 1", 6, "is 'again' meant?"),
        ("blind = true", 'name = "sighted"', 12, "a second condition called 'sighted'"),
        ("seed = 7", "sed = 7", 17, "is 'seed' meant?"),
        ("seed = 7", "", 15, "expected a seed, or poses"),
        ("[1, 0, -180]", "[1, 0]", 20, "a list of [x in m, y in m, heading in degrees]"),
        ("lost_s = 5", "lost_s = true", 23, "a number from 0.1"),
        ('experiment = "foraging"', "", 8, "no experiment"),
        ('"foraging.pull" = 0.5', '"foraging" = 0.5', 13, "ELEMENT.attribute"),
        ("[[start]]", "[[strat]]", 15, "is 'start' meant?"),
        ("[void]", "[void", 22, "expected TOML"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    tmp_path: Path, before: str, after: str, line: int, words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        plan_of(tmp_path, TEXT.replace(before, after))
    assert words in str(caught.value)
    assert caught.value.line == line


def test_a_plan_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read"):
        read(tmp_path / "none.toml")


def test_each_block_has_every_condition_at_every_start_once(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    order = cells(plan)
    for block in (1, 2, 3):
        cells_of = Counter((c.condition, c.start) for c in order if c.block == block)
        assert len(cells_of) == 4 and set(cells_of.values()) == {1}
    orders = {tuple((c.condition, c.start) for c in order if c.block == b) for b in (1, 2, 3)}
    assert len(orders) > 1, "blocks are shuffled"
    assert order == cells(plan), "by the plan alone"


def test_pairs_have_one_seed_and_all_others_their_own(tmp_path: Path) -> None:
    order = cells(plan_of(tmp_path))
    seeds = Counter(cell.seed for cell in order)
    assert set(seeds.values()) == {2} and len(seeds) == 6
    assert len({(c.seed, c.start, c.repetition) for c in order}) == 6


def test_order_and_seeds_are_the_same_everywhere(tmp_path: Path) -> None:
    order = cells(plan_of(tmp_path))
    # printf 1/a/1 | b2sum -l 64: 522185cc889334e9, of which the remainder is taken.
    seed = 0x522185CC889334E9 % (2**32 - 1) + 1
    assert {c.seed for c in order if (c.start, c.repetition) == ("a", 1)} == {seed}
    # As Python 3.6 to 3.13 shuffle them: a series goes on with another Python, too.
    first = [c.condition[0] + c.start[0] for c in order[:4]]
    assert first == ["ss", "ba", "sa", "bs"]


def test_rows_that_somebody_has_changed(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    moved = replace(row(plan, 1), start="1e5")  # as spreadsheets do
    with pytest.raises(UsageError, match=r"run-001.*'1e5'"):
        pending(plan, [moved])
    # The row of a first attempt was taken away: names are not given twice.
    second = replace(row(plan, 1, "void", "lost"), run="run-001-2")
    assert "run-001-3" in [run.name for run in pending(plan, [second])]
    again = replace(row(plan, 1), run="run-001-2")
    rows = [row(plan, 1), again, row(plan, 2)]
    assert (count_valid(plan, rows), duplicates(rows)) == (2, ["run-001 and run-001-2"])


def test_a_plan_is_the_same_wherever_it_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").mkdir()
    for name in ("mine/walk.c", "mine/walk.argos"):
        (tmp_path / name).touch()
    text = TEXT.replace('"foraging"', '"mine/walk.argos"')
    text = text.replace('name = "sighted"', 'controller = "mine/walk.c"')
    told = plan_of(tmp_path, text).facts()
    monkeypatch.chdir(tmp_path)
    assert read(Path("plan.toml")).facts() == told
    monkeypatch.chdir(tmp_path / "mine")
    assert read(Path("../plan.toml")).facts() == told
    assert told["conditions"][0]["experiment"] == "mine/walk.argos"
    plan = replace(read(Path("../plan.toml")), path=tmp_path / "other" / "plan.toml")
    assert plan.beside("walk.c") == str(tmp_path / "mine" / "walk.c")


def test_a_condition_without_a_name_gets_one_that_tables_give_back(tmp_path: Path) -> None:
    text = TEXT.replace('"foraging.pull" = 0.5', '"foraging.word" = "two\\n words "')
    plan = plan_of(tmp_path, f"\ufeff{text}")
    assert plan.conditions[1].name == "blind, foraging.word=two words"


def test_what_is_valid_is_done_and_what_is_void_comes_again_after_its_block(
    tmp_path: Path,
) -> None:
    plan = plan_of(tmp_path)
    rows = [row(plan, 1), row(plan, 2, "void", "lost")]
    todo = pending(plan, rows)
    assert [run.name for run in todo[:4]] == ["run-003", "run-004", "run-002-2", "run-005"]
    assert len(todo) == 11
    assert pending(plan, [row(plan, n) for n in range(1, 13)]) == []


def test_a_run_that_is_void_too_often_ends_the_series(tmp_path: Path) -> None:
    plan, void = plan_of(tmp_path), "robot 3 lost for 6.0 s"
    once = row(plan, 5, "void", void)
    assert pending(plan, [once])
    assert pending(plan, [once, row(plan, 5, "void", f"{CUT}: interrupted")])[-1]
    with pytest.raises(VoidLimit, match=r"invalid 2 .*robot 3 lost"):
        pending(plan, [once, once])


def test_what_has_changed_in_a_plan_is_named(tmp_path: Path) -> None:
    before = plan_of(tmp_path).facts()
    assert differences(before, plan_of(tmp_path, f"# looks\n{TEXT}").facts()) == []
    now = plan_of(tmp_path, TEXT.replace("lost_s = 5", "lost_s = 9").replace("pull", "trail"))
    assert differences(before, now.facts()) == [
        "conditions 2.name: 'blind, foraging.pull=0.5' before, now 'blind, foraging.trail=0.5'",
        "conditions 2.settings.foraging.pull: '0.5' before, now None",
        "conditions 2.settings.foraging.trail: None before, now '0.5'",
        "void.lost_s: 5.0 before, now 9.0",
    ]
