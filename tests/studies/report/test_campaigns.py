"""Campaigns' tables beside recordings: the run is the unit, and kinds of runs stay apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.studies.report.runs import experiment, messages, write
from vsense.base.errors import UsageError
from vsense.base.message_bus import Message
from vsense.cli import main
from vsense.run.runs_csv import RUNS, RunRow, RunsFile
from vsense.studies.report import _charts, _compare
from vsense.studies.report._compare import CampaignRuns, campaign_runs
from vsense.studies.report._findings import Findings, read_findings
from vsense.studies.report.report import make_report
from vsense.studies.report.study._collect import read_tables, tables_in

HEAD = "campaign,experiment,sensor.noise,seed,robots,duration_s,items_home,in_cone_before_turn,"
TABLE = (
    f"{HEAD}lit_before_turn,in_cone_after_turn,lit_after_turn\n"
    "ab,hand,0,1,2,2,10,5,4,3,2\n"
    "ab,hand,0,2,2,2,20,5,4,5,3\n"
    "ab,hand,0.2,1,2,2,4,6,1,,\n"
)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "noise.csv"
    path.write_text(TABLE)
    return path


def made_by(command: str, recorded: bool = False, **others: Any) -> list[Message]:
    """The run of `messages`, made by another command."""
    told = list(messages(**others))
    facts = {**experiment(), **told[0].data, "command": command, "recorded": recorded}
    assert told[0].topic == "/experiment"
    return [Message("/experiment", told[0].time_ns, facts), *told[1:]]


@pytest.fixture
def kinds(tmp_path: Path) -> list[Findings]:
    runs = [("run", False), ("lab", False), ("sim", False), ("run", True)]
    return [
        read_findings(write(tmp_path / f"{n}.mcap", made_by(command, recorded)))
        for n, (command, recorded) in enumerate(runs)
    ]


def read_campaign(path: Path) -> list[CampaignRuns]:
    return [some for table in read_tables([path]) for some in campaign_runs(table)]


def test_a_table_is_a_group_for_each_combination_of_settings(table: Path) -> None:
    first, second = read_campaign(table)
    assert (first.condition, list(first.seeds)) == ("sensor.noise=0", ["1", "2"])
    assert first.ends == {
        "items_home": [10.0, 20.0], "robots_in_cone": [3.0, 5.0], "lit_in_cone": [2.0, 3.0],
    }  # fmt: skip
    # Where the wind never turns, the end is before its turn.
    assert second.ends == {"items_home": [4.0], "robots_in_cone": [6.0], "lit_in_cone": [1.0]}


def test_kinds_of_runs_are_groups_of_their_own(kinds: list[Findings], table: Path) -> None:
    found = _compare.groups(kinds, read_campaign(table))
    assert [(group.condition, group.count) for group in found] == [
        ("simulation", 1), ("simulation (sensor.noise=0)", 2), ("simulation (sensor.noise=0.2)", 1),
        ("lab", 1), ("robots", 1), ("recorded pictures", 1),
    ]  # fmt: skip
    end = _compare.table(found)["items home, at the end"]
    assert (end["simulation (sensor.noise=0)"].mean, end["lab"].values) == (15.0, [19.0])
    assert end["lab"].spread is None, "of one run there is none"
    assert "simulation (sensor.noise=0)," not in _charts.few(found) and ", lab," in _charts.few(
        found
    )


def test_a_simulated_run_has_neither_latencies_nor_links(kinds: list[Findings]) -> None:
    real, simulated = kinds[0], kinds[2]
    assert real.latency and not simulated.latency and not simulated.lacks
    assert _charts.robots(simulated) is None
    assert simulated.label == "hand, simulation, seed 1"


def test_the_page_says_what_is_compared(tmp_path: Path, table: Path) -> None:
    real = write(tmp_path / "real.mcap", made_by("run"))
    assert main(["report", str(table), str(real), "-o", str(tmp_path / "out")]) == 0
    text = (tmp_path / "out" / "report.html").read_text()
    assert "hand: simulation and robots compared" in text
    assert "Runs: 2 simulation (sensor.noise=0), 1 simulation (sensor.noise=0.2), 1 robots" in text
    assert "Of one run there is no spread" in text and "4 runs compared" in text
    assert "2: 1 … 2" in text, "the campaign's row of the table of runs"


def test_a_folder_with_tables_stands_for_them(tmp_path: Path, table: Path) -> None:
    (tmp_path / "other.csv").write_text("time_s,timestep\n0,1\n")
    assert tables_in(tmp_path) == [table]
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "out")]) == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert "runs-01-items_home.png" in names, "no run is recorded, but the ends are known"
    assert not [name for name in names if name.startswith("compared")]


def test_a_folder_of_runs_stands_for_its_recordings_where_it_has_some(tmp_path: Path) -> None:
    row = RunRow(run="run-1", mode="lab", experiment="hand", condition="sighted")
    RunsFile(tmp_path / RUNS).append(replace(row, measures={"items_home": 1.0}))
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "a")]) == 0
    assert (tmp_path / "a" / "runs-01-items_home.png").exists()
    write(tmp_path / "hand.mcap", messages())
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "b")]) == 0
    assert not (tmp_path / "b" / "runs-01-items_home.png").exists()
    assert (tmp_path / "b" / "measures.png").exists()


def test_a_run_is_one_whether_its_recording_or_its_row_tells_of_it(tmp_path: Path) -> None:
    for number, verdict in ((1, "valid"), (2, "void"), (3, "valid")):
        row = RunRow(run=f"run-{number}", mode="sim", experiment="hand", condition="sighted")
        row = replace(row, verdict=verdict, measures={"items_home": float(number)})
        RunsFile(tmp_path / RUNS).append(row)
    kept = [tmp_path / f"run-{number}" / "hand.mcap" for number in (1, 2)]
    for path in kept:
        path.parent.mkdir()
        write(path, made_by("sim"))
    report = make_report([tmp_path / RUNS, *kept], tmp_path / "out")
    groups = [group["runs"] for group in report.as_json()["comparison"]]
    assert groups == [1, 1], "run-1's recording, and run-3's row"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "noise.csv:1:.*runs.csv:"),
        ("time_s,timestep\n0,1\n", "noise.csv:1:.*no runs.csv"),
        ("campaign,experiment,seed,robots\n", "campaign"),
        (TABLE.partition("\n")[0] + "\n", "holds no run"),
        (TABLE + "ab,hand\n", "noise.csv:5: 2 values.*11"),
        (TABLE + "x" * 200_000 + "\n", "noise.csv:5:.*larger"),
        ("x" * 200_000, "noise.csv:1:.*larger"),
        (TABLE.replace(",10,", ",ten,"), "noise.csv:2:.*'ten'"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "noise.csv").write_text(text)
    with pytest.raises(UsageError, match=reason):
        read_campaign(tmp_path / "noise.csv")


def test_campaigns_of_the_same_name_stay_apart(tmp_path: Path) -> None:
    """As `vsense sim --runs` names them, with and without settings."""
    plain = TABLE.replace(",sensor.noise", "").replace("hand,0,", "hand,")
    plain = plain.replace("0.2,1,", "3,")
    other, short = plain.replace(",20,", ",40,"), TABLE.rpartition("ab,")[0]
    for folder, text in (("a/x", plain), ("b/x", other), ("c", TABLE), ("d", short)):
        (tmp_path / folder).mkdir(parents=True)
        # Another campaign is another series.
        series = text.replace("ab,", f"{folder[0]}a,")
        (tmp_path / folder / "results.csv").write_text(series)
    files = [tmp_path / name / "results.csv" for name in ("a/x", "b/x", "c", "d")]
    found = _compare.groups([], [some for path in files for some in read_campaign(path)])
    assert [(group.condition, group.count) for group in found] == [
        ("simulation (a/x/results.csv, as in the file)", 3),
        ("simulation (b/x/results.csv, as in the file)", 3),
        ("simulation (c/results.csv, sensor.noise=0)", 2),
        ("simulation (sensor.noise=0.2)", 1),
        ("simulation (d/results.csv, sensor.noise=0)", 2),
    ]
    ends = _compare.table(found)["items home, at the end"]
    assert ends["simulation (a/x/results.csv, as in the file)"].values == [10.0, 20.0, 4.0]
    assert ends["simulation (b/x/results.csv, as in the file)"].values == [10.0, 40.0, 4.0]


def test_a_table_that_is_named_twice_counts_once(table: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.csv"
    again.symlink_to(table)
    assert len(make_report([table, again, table], tmp_path / "out", form="").tables) == 1
