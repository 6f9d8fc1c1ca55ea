"""Two labs' results beside each other, and results that cannot stand so."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vsense import cli
from vsense.base.errors import UsageError
from vsense.run.runs_csv import RunRow
from vsense.studies.benchmark import _definition
from vsense.studies.benchmark._comparing import compare

KNOWN = _definition.load()


def written(folder: Path, site: str, shift: float, **others: Any) -> Path:
    """A result in which foraging brought `shift` items more than elsewhere; one run was void."""
    rng = np.random.default_rng(3 if shift == 0.0 else 4)
    runs = []
    for mission in KNOWN.missions:
        for number in range(10):
            value = 14.0 + number % 5 + rng.normal(0.0, 0.2) + (
                shift if mission.name == "foraging" else 0.0
            )  # fmt: skip
            place = {"block": str(number // 5 + 1), "start": f"start{number % 5 + 1}"}
            where = {"mode": "sim", "experiment": mission.name, "condition": mission.name}
            run = RunRow(run=f"run-{len(runs)}", repetition=place["block"], seed=number,
                         measures={mission.measure: value}, **place, **where)  # fmt: skip
            runs.append(asdict(run))
    lost = {"run": "run-void", "verdict": "void", "why": "lost", "measures": {}}
    runs.append({**runs[-1], **lost})
    told = {
        "form": 1, "benchmark": KNOWN.name, "definition_sha256": KNOWN.sha256, "quick": False,
        "deviations": [], "site": site, "mode": "sim", "made": "2026-11-24", "versions": [],
        "missions": [], "latency": None, "accuracy": {"seen_share": 0.99}, "noise": {},
        "runs": runs, **others,
    }  # fmt: skip
    folder.mkdir()
    (folder / "benchmark.json").write_text(json.dumps(told))
    return folder


def test_two_labs_are_tested_mission_by_mission(tmp_path: Path) -> None:
    here = written(tmp_path / "here", "here", 0.0)
    there = written(tmp_path / "there", "there", 8.0)
    found = compare([here, there], independent=False, tests=True)
    studies = {study.study.title: study for study in found.studies}
    assert list(studies) == ["aggregation", "foraging", "phototaxis"]
    (forage,) = studies["foraging"].measures
    (pair,) = forage.pairs
    assert forage.paired and pair.n == (10,)
    assert pair.test is not None and pair.test.p == pytest.approx(2 / 2**10)
    assert pair.effect is not None and pair.effect.a12 == 0.0
    assert pair.same is not None and pair.same.p is not None and pair.same.p > 0.99
    (gather,) = studies["aggregation"].measures
    same = gather.pairs[0].same
    assert same is not None and same.p is not None and same.p < 1e-4, "within one robot"
    text = "\n".join(found.lines())
    assert "here (sim) n = 10 (0 invalid), there (sim) n = 10 (0 invalid)" in text
    assert "here (sim) n = 10 (1 invalid), there (sim) n = 10 (1 invalid)" in text
    alone = compare([here, there], independent=True, tests=True)
    assert alone.studies[0].measures[0].pairs[0].n == (10, 10)
    assert json.loads(json.dumps(found.as_json()))["labs"][1]["site"] == "there"


def test_a_comparison_has_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    labs = [str(written(tmp_path / name, name, shift)) for name, shift in (("a", 0.0), ("b", 8.0))]
    page = tmp_path / "page"
    words = ["benchmark", "compare", *labs, "--unpaired", "--json", "--report", str(page)]
    assert cli.main(words) == 0
    assert json.loads(capsys.readouterr().out)["labs"][1]["site"] == "b"
    assert "<html" in (page / "report.html").read_text()


@pytest.mark.parametrize(
    ("others", "words"),
    [
        ({"quick": True}, "a first look"),
        ({"definition_sha256": "0" * 64}, "their definitions differ"),
        ({"deviations": ["8 robots in place of 15"]}, "none, 8 robots in place of 15"),
        ({"runs": [{}]}, "is damaged: KeyError"),
        ({"made": None}, "is damaged: .*made is None"),
        ({"versions": [1]}, "is damaged: .*versions is"),
        ({"latency": {"stations": {"capture_to_sent_ms": 3}}}, "is damaged"),
        ({"latency": {"late_share_mean": "x"}}, "is damaged"),
        ({"form": 2}, "has form 2, this vsense reads 1"),
        ({"runs": None}, "is no benchmark.json"),
    ],
)
def test_what_cannot_be_compared_is_told(
    tmp_path: Path, others: dict[str, Any], words: str
) -> None:
    here = written(tmp_path / "here", "here", 0.0)
    there = written(tmp_path / "there", "there", 0.0, **others)
    with pytest.raises(UsageError, match=words):
        compare([here, there], independent=False, tests=False)
