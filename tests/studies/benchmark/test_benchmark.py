"""`vsense benchmark` from end to end in simulation: a first look, its check, what was changed."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from vsense import cli
from vsense.studies.benchmark import _checking

TAKEN = Callable[[Path], None]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a first look."""
    folder = tmp_path_factory.mktemp("benchmark") / "look"
    assert cli.main(["benchmark", "--quick", "-o", str(folder), "--site", "Brussels"]) == 0
    return folder


def wrong_of(folder: Path) -> dict[str, list[str]]:
    """What does not hold, by what was looked at."""
    claims = _checking.check(folder, lambda text: None)
    return {claim.thing: list(claim.differences) for claim in claims.of("differs")}


def test_a_first_look_holds_and_says_that_it_is_one(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = json.loads((made / "benchmark.json").read_text())
    assert (told["site"], told["mode"], told["robots"], told["quick"]) == (
        "Brussels",
        "sim",
        4,
        True,
    )
    assert told["deviations"] == ["quick: a first look, never comparable"]
    assert told["counts"] == {"valid": 6, "void": 0} and len(told["runs"]) == 6
    assert [mission["mission"] for mission in told["missions"]] == [
        *("aggregation", "foraging", "phototaxis")
    ]
    # Simulated wheels are nominal ones.
    assert len(told["noise"]["robots"]) == 4
    for robot in told["noise"]["robots"]:
        assert robot["way_over_told"] == pytest.approx(1.0, abs=0.002)
    page = (made / "report" / "report.html").read_text()
    assert "Brussels" in page and told["definition_sha256"] in page and "first look" in page
    assert cli.main(["benchmark", "check", str(made), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["holds"] and len(found["checked"]) == 6
    assert cli.main(["benchmark", "compare", str(made), str(made)]) == 2
    assert "--quick is a first look, and comparable with nothing" in capsys.readouterr().err


def edit(name: str, before: str, after: str) -> TAKEN:
    def change(folder: Path) -> None:
        path = folder / name
        text = path.read_text()
        assert before in text
        path.write_text(text.replace(before, after, 1))

    return change


def swapped(folder: Path) -> None:
    """Two runs of one mission have each other's recordings."""
    told = json.loads((folder / "benchmark.json").read_text())
    one, other = (r["run"] for r in told["runs"] if r["condition"].startswith("phototaxis"))
    name = "phototaxis.mcap"
    first = (folder / one / name).read_bytes()
    shutil.copyfile(folder / other / name, folder / one / name)
    (folder / other / name).write_bytes(first)


def without_a_run(folder: Path) -> None:
    path = folder / "runs.csv"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-1]))


def damaged(folder: Path) -> None:
    path = next(folder.glob("run-002/*.mcap"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)


def rescored(folder: Path) -> None:
    """Table and result agree in a score that the recording does not give."""
    path = folder / "benchmark.json"
    told = json.loads(path.read_text())
    run = next(run for run in told["runs"] if run["condition"] == "aggregation")
    before = run["measures"]["robots_on_green_mean"]
    run["measures"]["robots_on_green_mean"] = 3.75
    path.write_text(json.dumps(told, indent=1))
    edit("runs.csv", f"{before:.12g}", "3.75")(folder)


def test_what_was_changed_in_runs_is_found(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made, folder)
    for change in (rescored, swapped, damaged):
        change(folder)
    edit("runs.csv", "run-006", "run-007")(folder)
    wrong = {what: " | ".join(texts) for what, texts in wrong_of(folder).items()}
    assert "robots_on_green_mean is 3.75 in runs.csv, and 1." in wrong["scores"]
    assert "is of a blind run" in wrong["recordings"] and "run-002" in wrong["recordings"]
    assert "its place in the order is 6" in wrong["runs"]
    assert wrong["figures"] == "runs are missing"


def test_what_was_changed_in_the_result_is_found(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made, folder)
    edit("benchmark.json", '"sighted_better": 1.0', '"sighted_better": 0.9')(folder)
    edit("benchmark.json", '"steps": ', '"steps": 1')(folder)
    edit("benchmark.json", '"deviations": [', '"deviations": ["none", ')(folder)
    edit("runs.csv", ",valid,,", ",void,,")(folder)
    wrong = {what: " | ".join(texts) for what, texts in wrong_of(folder).items()}
    assert "run-001 is invalid and does not say why" in wrong["runs"]
    assert "0 valid runs, expected one" in wrong["runs"]
    assert "the result and runs.csv have another verdict" in wrong["runs"]
    assert wrong["deviations"].startswith("deviations: ")
    edit("runs.csv", ",void,,", ",valid,,")(folder)
    wrong = {what: " | ".join(texts) for what, texts in wrong_of(folder).items()}
    assert "missions[0].sighted_better: 0.9 before, now 1.0" in wrong["figures"]
    assert "noise.robots[0].steps: 1" in wrong["figures"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("definition/foraging.c", "static", "static "), "foraging.c: is not the definition's"),
        (edit("benchmark.json", '"definition_sha256": "4', '"definition_sha256": "5'),
         "check it with the vsense that made it"),
    ],
)  # fmt: skip
def test_another_definition_is_found(made: Path, tmp_path: Path, change: TAKEN, words: str) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made, folder)
    change(folder)
    assert words in " ".join(wrong_of(folder)["definition"])


def test_dry_touches_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["benchmark", "--dry", "--mode", "lab"]) == 0
    out = capsys.readouterr().out
    assert out.count("run-") == 60 and "60 of 60 runs follow (lab)" in out
    assert cli.main(["benchmark", "--dry", "--robots", "8", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["robots"], told["deviations"]) == (8, ["8 robots in place of 15"])
    assert os.listdir(tmp_path) == []


def test_a_first_look_needs_a_roster_of_four(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("robots.toml").write_text("".join(f"[[robot]]\ntag = {tag}\n" for tag in range(20, 24)))
    words = ["benchmark", "--quick", "--dry", "--tracker", "lines", "--json"]
    for mode in ("run", "lab"):
        assert cli.main([*words, "--mode", mode, "--roster", "robots.toml"]) == 0
        assert json.loads(capsys.readouterr().out)["robots"] == 4


@pytest.mark.parametrize(
    ("words", "robots", "expected"),
    [
        (["--mode", "run"], None, "no roster: expected --roster FILE"),
        (["--mode", "run"], 9, "has 9 robots that can play, the missions want 15; --robots 9"),
        (["--mode", "run", "--quick"], 3, "has 3 robots that can play, the missions want 4\n"),
        (["--robots", "4"], None, "--robots 4: expected 5 to 15"),
        (["--robots", "6", "--quick"], None, "--robots: --quick has four"),
        (["check", "nothing"], None, "cannot read nothing"),
        (["compare", "robots.toml", "nothing"], 1, "robots.toml: is no benchmark.json"),
    ],
)
def test_what_cannot_be_is_said_before_it_starts(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    robots: int | None,
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    if robots is not None:
        tables = (f"[[robot]]\ntag = {tag}\n" for tag in range(20, 20 + robots))
        Path("robots.toml").write_text("".join(tables))
    assert cli.main(["benchmark", *words]) == 2
    assert expected in capsys.readouterr().err
    assert not set(os.listdir(tmp_path)) - {"robots.toml"}
