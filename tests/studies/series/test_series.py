"""`vsense series` from end to end, in simulation: its table, going on, changed plans, failures."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path

import pytest

from vsense import cli
from vsense.run.runs_csv import read_runs

PLAN = """
mode = "sim"
experiment = "foraging"
duration_s = 1
repetitions = 2

[robots]
count = 2

[[condition]]
name = "sighted"

[[condition]]
name = "blind"
blind = true

[[start]]
name = "drawn"
seed = 7

[[start]]
name = "written"
poses = [[0.4, 0.4, 0], [-0.4, -0.4, 90]]
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "walks.toml"
    path.write_text(PLAN)
    return path


def series(*words: object) -> int:
    return cli.main(["series", *map(str, words)])


def test_a_series_goes_on_where_it_was_and_gives_the_same_table(
    plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = plan.parent / "walks-sim" / "runs.csv"
    assert series(plan, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["planned"], told["valid"], told["complete"]) == (8, 8, True)
    rows, whole = read_runs(table), table.read_bytes()
    assert [row.run for row in rows] == [f"run-{n:03d}" for n in range(1, 9)]
    assert {(r.condition, r.start, r.block) for r in rows} == {
        (c, s, b) for c in ("sighted", "blind") for s in ("drawn", "written") for b in "12"
    }
    assert {row.tags for row in rows} == {rows[0].tags} and len(rows[0].tags) == 2
    pairs = {(row.start, row.block, row.seed) for row in rows}
    assert len(pairs) == 4, "both conditions of a pair have its seed"
    # Killed in the middle of a row: what was whole stays, and the rest is made again, bit for bit.
    lines = whole.splitlines(keepends=True)
    table.write_bytes(b"".join(lines[:5]) + lines[5][:30])
    assert series(plan) == 0
    assert "its last row was cut short" in capsys.readouterr().err
    assert table.read_bytes() == whole
    plan.write_text(PLAN.replace("duration_s = 1", "duration_s = 3"))
    assert series(plan) == 2
    assert "duration_s: 1.0 before, now 3.0" in capsys.readouterr().err
    assert series(plan, "--dry") == 2, "nor is it said which of its runs would follow"
    assert table.read_bytes() == whole


def test_dry_touches_nothing_and_tells_the_order(
    plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert series(plan, "--dry", "--mode", "lab") == 0
    out = capsys.readouterr().out
    assert out.count("run-") == 8 and "8 of 8 runs follow (lab)" in out
    lasts_s = []
    for words in ((), ("--pace", "0.5")):
        assert series(plan, "--dry", "--mode", "lab", "--json", *words) == 0
        lasts_s.append(json.loads(capsys.readouterr().out)["wall_s"])
    # A second each, opening, and the way home.
    assert lasts_s == [8 * 23.0, 8 * 46.0]
    assert os.listdir(plan.parent) == ["walks.toml"]


def test_the_example_is_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert series("--example") == 0
    path = tmp_path / "plan.toml"
    path.write_text(capsys.readouterr().out)
    assert series(path, "--dry", "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["runs"]) == 12


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('"foraging"', '"foragin"', "walks.toml:10: sighted:"),
        ("[-0.4, -0.4, 90]", "[0.41, 0.4, 90]", "overlaps with"),
        (", [-0.4, -0.4, 90]", "", "1 poses: foraging.argos has 2 robots"),
        ("count = 2", "count = 99", "2 poses: foraging.argos has 99 robots"),
        ("blind = true", 'controller = "nobody.c"', "nobody.c"),
        ("blind = true", 'settings = { "foraging.pul" = 1 }', "reads no parameter 'pul'"),
    ],
)
def test_what_does_not_fit_is_told_before_anything_runs(
    plan: Path, before: str, after: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    plan.write_text(PLAN.replace(before, after))
    assert series(plan) == 2
    assert words in capsys.readouterr().err
    assert os.listdir(plan.parent) == ["walks.toml"]


@pytest.mark.parametrize("mode", ["lab", "run"])
def test_ports_that_cannot_be_had_are_told_before_robots_start(
    plan: Path, mode: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [plan, "--mode", mode, "--tracker", "lines", "--insecure", "--no-deploy"]
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for option in ("--web", "--foxglove", "--port"):
            free = [] if option == "--port" else ["--port", "0"]
            assert series(*words, *free, option, port) == 1
            assert f"port {port}" in capsys.readouterr().err
    assert series(*words, "--port", "4050", "--web", "4050") == 2
    assert "--web: 4050 is a port for robots, too" in capsys.readouterr().err
    assert os.listdir(plan.parent) == ["walks.toml"]


def test_a_failing_controller_ends_the_series_with_its_name(
    plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = plan.parent / "broken.c"
    broken.write_text(
        '#include "controller.h"\n'
        "static void init(void *state, struct vs_robot *robot) { (void)state, (void)robot; }\n"
        "static void step(void *state, struct vs_robot *robot)\n"
        "{\n    (void)state, (void)robot;\n    __builtin_trap();\n}\n"
        'const struct vs_controller vs_controller = {"broken", 1, init, step, 0};\n'
    )
    plan.write_text(PLAN.replace("blind = true", 'controller = "broken.c"'))
    assert series(plan, "-j", 1, "--lenient") == 1
    said = capsys.readouterr().err
    assert "blind, start" in said and "broken.c' was killed by SIG" in said
