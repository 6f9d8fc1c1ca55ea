"""Old against new: intervals that keep their word however often is looked, and what people see."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

import vsense
from tests.rigs.places import ROOT
from vsense.base.arena import Floats
from vsense.base.errors import UsageError
from vsense.base.terminal import Console
from vsense.cli import main
from vsense.run.runs_csv import read_runs
from vsense.studies.series import _sequential
from vsense.studies.series._sequential import BETTER, NOT_CLEAR, NOT_WORSE, WORSE
from vsense.studies.series._sides import NEW, OLD
from vsense.studies.series.compare import Margin, _Looks

FORAGING = ROOT / "vsense" / "config" / "experiments" / "foraging.argos"
ITEMS = ("--maximize", "items_home")
Draw = Callable[[np.random.Generator, int], tuple[Floats, Floats]]


_ALIKE = SimpleNamespace(length_s=60.0, robots=())


def final_verdict(old: Floats, new: Floats, margin: float) -> str:
    """What a comparison says that looks at pairs one after the other."""

    class Making:
        """Runs that are made already."""

        how, path = SimpleNamespace(seeds=lambda pairs: pairs), Path("runs.csv")

        def complete(self, both: object, seeds: int, what: str) -> None: ...

        def rows(self, side: str, seeds: int) -> list[dict[str, float]]:
            return [{"x": value} for value in {OLD: old, NEW: new}[side][:seeds]]

    objective = SimpleNamespace(measure="x", more=True, of=lambda row: row["x"])
    alike: Any = dict.fromkeys((OLD, NEW), SimpleNamespace(experiment=_ALIKE))
    asked: Any = _Looks(objective, Margin(margin), len(old))
    return str(
        asked.take(Making(), alike, Console(io.StringIO()), _sequential.FEWEST_ALIKE).verdict
    )


def test_a_measure_that_is_always_0_tells_nothing() -> None:
    dead = np.zeros(100)
    with pytest.raises(UsageError, match="x: 0 in every run of both sides: nothing can be told"):
        final_verdict(dead, dead, 0.1)
    assert final_verdict(dead + 1.0, dead + 1.0, 0.1) == NOT_WORSE


def paired(share: float, start_share: float = 0.5) -> Draw:
    """Counts about 14, as foraging's, with a part that the start decides; new ones are `share`."""

    def draw(random: np.random.Generator, pairs: int) -> tuple[Floats, Floats]:
        start = random.gamma(1.0 / start_share**2 * 4.0, size=pairs) / (4.0 / start_share**2)
        return random.poisson(14.0 * start) * 1.0, random.poisson(14.0 * share * start) * 1.0

    return draw


def rare(random: np.random.Generator, pairs: int) -> tuple[Floats, Floats]:
    """Either side fails in a tenth of its runs."""
    return 1.0 * (random.random(pairs) < 0.9), 1.0 * (random.random(pairs) < 0.9)


def shares_of_verdicts(draw: Draw, margin: float, times: int) -> dict[str, float]:
    random = np.random.default_rng(5)
    verdicts = [final_verdict(*draw(random, 400), margin) for _ in range(times)]
    return {name: verdicts.count(name) / times for name in (BETTER, NOT_WORSE, WORSE, NOT_CLEAR)}


def test_the_boundary_is_crossed_by_a_twentieth_of_all_sequences() -> None:
    walks = np.random.default_rng(1).standard_normal((20_000, 400)).cumsum(axis=1)
    at_looks = np.array(_sequential.LOOKS)
    farthest = np.abs(walks[:, at_looks - 1] / np.sqrt(at_looks)).max(axis=1)
    assert (farthest > _sequential._BOUNDARY).mean() == pytest.approx(0.05, abs=0.005)
    assert (farthest > 1.96).mean() == pytest.approx(0.26, abs=0.01)  # as the page says


@pytest.mark.parametrize("freedom", [7, 11, 15, 399])
def test_estimated_variances_widen_the_interval_as_students_t_does(freedom: int) -> None:
    from scipy import stats  # takes a second, which nobody else waits for

    tail = stats.norm.sf(_sequential._BOUNDARY)
    assert _sequential._quantile(freedom) == pytest.approx(stats.t.isf(tail, freedom), rel=3e-4)


@pytest.mark.parametrize("draw", [paired(1.0), paired(1.0, 0.05), rare], ids=["", "even", "rare"])
def test_equal_sides_are_seldom_called_unlike(draw: Draw) -> None:
    shares = shares_of_verdicts(draw, 0.1, 600)
    # 5 % and three standard errors; whoever looks as often with 1.96 says it far more often.
    assert shares[WORSE] + shares[BETTER] < 0.077


def test_a_loss_is_found_and_one_beyond_the_margin_seldom_accepted() -> None:
    assert shares_of_verdicts(paired(0.9), 0.1, 200)[WORSE] > 0.8
    assert shares_of_verdicts(paired(0.9), 0.1, 200)[NOT_WORSE] < 0.062
    assert shares_of_verdicts(paired(1.1), 0.1, 200)[WORSE] == 0.0


def test_what_is_seldom_has_time_to_happen() -> None:
    """As good as before, or a little better, but for runs that end with nothing."""

    def failing(share: float, gain: float) -> Draw:
        def draw(random: np.random.Generator, pairs: int) -> tuple[Floats, Floats]:
            old = random.normal(10.0, 0.5, pairs)
            return old, np.where(random.random(pairs) < share, 0.0, gain * old)

        return draw

    for margin, share, gain in ((0.1, 0.15, 1.001), (0.05, 0.125, 1.03)):
        shares = shares_of_verdicts(failing(share, gain), margin, 200)
        assert shares[BETTER] + shares[NOT_WORSE] <= 0.05  # it was 0.3
        assert shares[WORSE] > 0.9
    few = [_sequential.fewest_to_pass(margin, True) for margin in (0.0, 0.02, 0.05, 0.1, 0.5)]
    assert few == [400, 183, 72, 48, 48]
    for margin, pairs in ((0.02, few[1]), (0.05, few[2])):
        assert (1.0 - margin) ** pairs <= 0.025 < (1.0 - margin) ** (pairs - 1)
    assert _sequential.fewest_to_pass(0.02, False) == 48


def test_pairs_that_are_alike_prove_nothing_while_they_are_few() -> None:
    same = np.full(400, 3.0)
    for relative in (False, True):
        few = _sequential.shift_of(same[:47], same[:47], relative)
        assert (few.value, few.known) == (0.0, False)
        assert _sequential.verdict_of(few, 0.1, True) == NOT_CLEAR
        many = _sequential.shift_of(same[:48], same[:48], relative)
        assert _sequential.verdict_of(many, 0.1, True) == NOT_WORSE
    assert final_verdict(same * 0.0, same, 0.1) == NOT_CLEAR  # a share of nothing


def test_an_absolute_shift_has_the_interval_of_paired_differences() -> None:
    from scipy import stats  # takes a second, which nobody else waits for

    old, new = paired(1.2)(np.random.default_rng(5), 24)
    shift = _sequential.shift_of(old, new, relative=False)
    level = 1.0 - 2.0 * stats.norm.sf(_sequential._BOUNDARY)
    bounds = stats.ttest_rel(new, old).confidence_interval(level)
    assert shift.value == pytest.approx((new - old).mean()) and not shift.relative
    assert (shift.low, shift.high) == pytest.approx(tuple(bounds), rel=1e-2)


def compare(*words: str | Path) -> int:
    return main(["compare", *map(str, words)])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Foraging in `mine/`, where it is slow; the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    text = FORAGING.read_text().replace('speed_cm_s="12"', 'speed_cm_s="4"')
    (tmp_path / "mine" / "mine.argos").write_text(text)
    (tmp_path / "mine" / "foraging.py").write_bytes(FORAGING.with_suffix(".py").read_bytes())
    return tmp_path


def test_a_worse_side_fails_and_its_runs_are_kept(folder: Path, capsys) -> None:
    words = ("foraging", "mine", *ITEMS, "--duration", "60", "-o", "runs.svg", "--json")
    assert compare(*words) == 1
    said = capsys.readouterr()
    facts = json.loads(said.out)
    rows = read_runs(folder / "runs.csv")
    means = [
        np.mean([row.measures["items_home"] for row in rows if row.condition == side])
        for side in ("old", "new")
    ]
    assert [facts["old_mean"], facts["new_mean"]] == pytest.approx(means)
    assert facts["verdict"] == "worse" and not facts["passed"]
    assert facts["effect"] == pytest.approx(means[1] / means[0] - 1.0)
    assert facts["low"] < facts["effect"] < facts["high"] < 0.0
    assert {row.seed for row in rows} == set(range(1, facts["pairs"] + 1))
    assert len(rows) == 2 * facts["pairs"]
    assert re.search(r"^worse: items home .* accepted: 10 % less$", said.err, re.M)
    assert "pairs of runs" in (folder / "runs.svg").read_text()
    before = (folder / "runs.csv").read_bytes()
    assert compare(*words) == 1 and (folder / "runs.csv").read_bytes() == before
    assert compare("mine", "foraging", *words[2:6], "-o", "new.png") == 0
    assert "better: items home" in capsys.readouterr().err
    assert cv2.imread("new.png").shape[1] > 1000
    runs = (folder / "new.csv").read_bytes()
    assert compare("mine", "foraging", "--minimize", *words[3:6], "-o", "new.csv") == 1
    assert (folder / "new.csv").read_bytes() == runs, "another aim needs no other runs"


def test_git_has_the_old_side(folder: Path, capsys) -> None:
    def git(*words: str) -> None:
        who = ("-c", "user.name=n", "-c", "user.email=e@example.org")
        subprocess.run(["git", *who, *words], check=True, capture_output=True)

    git("init", "-b", "main", ".")
    file = Path("mine/mine.argos")
    slow = file.read_text()
    file.write_text(slow.replace('speed_cm_s="4"', 'speed_cm_s="12"'))
    git("add", "mine")
    git("commit", "-m", "fast")
    file.write_text(slow)
    how = (*ITEMS, "--duration", "60")
    assert compare("main:", "mine", *how) == 1
    assert "worse: items home" in capsys.readouterr().err
    assert compare("main:mine/mine.argos", "main:mine", *how, "--pairs", "8") == 0
    assert "the same in every pair, in 8 pairs" in capsys.readouterr().err
    assert [path.suffix for path in sorted(Path("runs").iterdir())] == [".csv", ".png"] * 2
    for side, words in (
        ("nowhere:", "nowhere: is no revision of "),
        ("main:other", "main:other: this revision has no other"),
    ):
        assert compare(side, "mine", *how) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("foraging", "foraging", "--maximize", "item_home"), "is 'items_home' meant?"),
        (("foraging", "foragin", *ITEMS), "is 'foraging' meant?"),
        (("foraging", "foraging", *ITEMS, "--margin", "1O%"), "margin '1O%': expected a share"),
        (("foraging", "foraging", *ITEMS, "--pairs", "500"), "expected a whole number, 8 to 400"),
        (("foraging", "foraging", *ITEMS, "--set", "foraging.relase=1"), "is 'release' meant?"),
        (("foraging", "foraging", *ITEMS, "--set", "a.b=1", "--set", "a.b=2"), "a.b: given twice"),
        (("mine/foraging.py", "mine/foraging.py", *ITEMS), "both are controllers"),
    ],
)
def test_what_is_wrong_is_said(words: tuple[str, ...], said: str, folder: Path, capsys) -> None:
    assert compare(*words, "--duration", "5") == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({}, "one of maximize and minimize"),
        ({"maximize": "x", "minimize": "y"}, "one of maximize and minimize"),
        ({"maximize": "x", "durtion_s": 3}, "durtion_s: no such option; is 'duration_s' meant?"),
        ({"maximize": "x", "duration_s": "3"}, "duration_s='3': expected a number"),
        ({"maximize": "x", "pairs": 7}, "pairs=7: expected a whole number, 8 to 400"),
        ({"maximize": "x", "seed": 0}, "seed=0: expected a whole number"),
    ],
)
def test_what_is_wrong_in_python_is_said(how: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=re.escape(said)):
        vsense.compare("foraging", "foraging", **how)


def test_ctrl_c_keeps_the_runs(folder: Path) -> None:
    command = [sys.executable, "-m", "vsense", "compare", "foraging", "mine", *ITEMS, "-j", "1"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [*command, "-o", "runs.csv"], env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        while not Path("runs.csv").exists():
            assert process.poll() is None
            time.sleep(0.02)  # or it takes a processor from the one that it waits for
        process.send_signal(signal.SIGTERM)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 143, said
    assert "the same command goes on from there" in said
    assert 1 <= len(read_runs(Path("runs.csv"))) < 16


TESTS = """
def test_as_good(vsense_compare):
    assert vsense_compare("foraging", "foraging", maximize="items_home", duration_s=20).pairs == 8

def test_slow(vsense_compare):
    vsense_compare("foraging", "mine", maximize="items_home", margin="5%", duration_s=60)
"""


def test_pytest_has_a_fixture_for_it(folder: Path) -> None:
    (folder / "test_mine.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-p", "vsense.studies._pytest_plugin", "--tb=short"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100)
    assert ran.returncode == 1 and "1 failed, 1 passed" in ran.stdout, ran.stdout + ran.stderr
    assert re.search(r"^worse: items home .* accepted: 5 % less$", ran.stdout, re.M)
    assert re.search(r"^picture: .*\.png$", ran.stdout, re.M)


def write_other(folder: Path, arrived: str = "arrived") -> None:
    """Foraging as `other.argos`, whose robots first draw a random number more, and so go elsewhere:
    with the same numbers drawn all pairs are alike, and nothing could go wrong.

    `arrived`: who brings an item home, of those that do.
    """
    begin = "    vs_walk_init("
    source = (ROOT / "robot" / "controllers" / "foraging.c").read_text()
    assert begin in source
    (folder / "other.c").write_text(source.replace(begin, f"    vs_robot_random(robot);\n{begin}"))
    text = FORAGING.read_text().replace('library="foraging"', 'library="other.c"')
    (folder / "other.argos").write_text(text)
    text = FORAGING.with_suffix(".py").read_text()
    assert "int(arrived.sum())" in text
    (folder / "foraging.py").write_text(text.replace("int(arrived.sum())", f"int({arrived}.sum())"))


def verdicts_of_foraging(comparisons: int) -> list[str]:
    """Verdicts of foraging against other.argos, each of runs that no other one has."""
    found = [
        vsense.compare(
            "foraging", "other.argos", maximize="items_home", seed=1 + 400 * n, output=f"{n}.csv"
        )
        for n in range(comparisons)
    ]
    print("median pairs:", np.median([answer.pairs for answer in found]))
    verdicts = [answer.verdict for answer in found]
    print({verdict: verdicts.count(verdict) for verdict in set(verdicts)})
    return verdicts


@pytest.mark.campaign
def test_a_controller_against_itself_raises_few_alarms(folder: Path) -> None:
    write_other(folder)
    verdicts = verdicts_of_foraging(200)
    assert verdicts.count(WORSE) + verdicts.count(BETTER) <= 10


@pytest.mark.campaign
def test_a_tenth_of_foraging_is_missed(folder: Path) -> None:
    # Every tenth item is lost: which one, a digit of the place says in which it arrives.
    digit = 'np.floor(1e5 * world.robots["x_m"])[:count] % 10.0'
    write_other(folder, f"(arrived & ({digit} != 7.0))")
    assert verdicts_of_foraging(50).count(WORSE) >= 40


IMPORTS = """
from helper import SPEED

class Controller:
    def __init__(self, robot):
        for name in ("speed_cm_s", "walk_s", "enough"):
            robot.param(name, 1.0)

    def step(self, robot):
        robot.set_wheels(SPEED, SPEED)
"""


def test_what_a_controller_imports_is_part_of_what_is_compared(folder: Path, capsys) -> None:
    """A controller's file takes the place of the experiment's: its helper changes."""
    (folder / "new").mkdir()
    (folder / "new" / "mine.py").write_text(IMPORTS)
    tables = set()
    for speed in (300, 0):
        (folder / "new" / "helper.py").write_text(f"SPEED = {speed}\n")
        how = ("--duration", "5", "--robots", "3", "--pairs", "8", "--json")
        assert compare("phototaxis", "new/mine.py", "--minimize", "light_distance_m", *how) != 2
        tables.add(json.loads(capsys.readouterr().out)["table"])
    assert len(tables) == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('length="120"', 'length="60"'), "old has 120 s a run, new 60: .*--duration makes"),
        (('quantity="15"', 'quantity="12"'), "old has 15 robots, new 12: .*--robots makes"),
    ],
)
def test_sides_of_other_sizes_are_not_compared(
    change: tuple[str, str], words: str, folder: Path, capsys
) -> None:
    path = folder / "mine" / "mine.argos"
    assert change[0] in path.read_text(), path.read_text()
    text = path.read_text().replace(*change)
    path.write_text(re.sub(r'vs:tags="[^"]*"', "", text) if "quantity" in change[0] else text)
    assert compare("foraging", "mine", *ITEMS) == 2
    assert re.search(words, capsys.readouterr().err)
    with pytest.raises(UsageError, match=r"margin 10: the old mean is .*; is '10%' meant"):
        vsense.compare("foraging", "foraging", maximize="items_home", margin=10, duration_s=20)
