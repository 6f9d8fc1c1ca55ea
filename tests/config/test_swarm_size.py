"""Swarms of any size: more robots than the file has, or another quantity, in every mode."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.robots import rosters
from vsense import cli
from vsense.base.errors import ConfigError, UsageError
from vsense.base.terminal import Console
from vsense.config import roster
from vsense.config.casting import Casting
from vsense.config.experiment import SHIPPED_FOLDER, first_robots, load
from vsense.config.placement import settle
from vsense.config.specs import Experiment, Stage
from vsense.modes.options import say_warnings
from vsense.run.runs_csv import read_runs
from vsense.studies.series.run import PlannedSeries, SeriesOptions

DRAWN = 'min="-1.48,-1.18,0" max="1.48,1.18,0"'
"""Where foraging's robots are drawn."""


def grown(
    name: str | Path, count: int, stage: Stage = Stage.SIM, casting: Casting | None = None
) -> Experiment:
    casting = casting or Casting(limit=count)
    return first_robots(load(name, stage=stage, casting=casting), count)


def edited(folder: Path, *pairs: tuple[str, str], name: str = "foraging") -> Path:
    """A shipped experiment with other words, beside its loop functions."""
    for suffix in (".argos", ".py"):
        text = (SHIPPED_FOLDER / f"{name}{suffix}").read_text()
        for old, new in pairs if suffix == ".argos" else ():
            assert old in text
            text = text.replace(old, new)
        (folder / f"{name}{suffix}").write_text(text)
    return folder / f"{name}.argos"


def test_a_distribute_grows_and_leaves_the_others_as_they_are() -> None:
    few, many = load("foraging", stage=Stage.SIM), grown("foraging", 50)
    assert many.robots[:15] == few.robots
    assert [robot.id for robot in many.robots[15:]] == [f"epuck{n}" for n in range(15, 50)]
    assert len({robot.tag for robot in many.robots}) == 50 and many.warnings == ()
    places = [settle(experiment, 3).robots[:15] for experiment in (few, many)]
    assert places[0] == places[1]


@pytest.mark.parametrize(("count", "predators"), [(28, 8), (15, 4), (30, 9), (100, 29)])
def test_several_grow_in_proportion(count: int, predators: int) -> None:
    kinds = [robot.controller for robot in grown("predator_prey", count).robots]
    assert (len(kinds), kinds.count("predator")) == (count, predators)


def test_numbers_of_more_robots_are_nobody_elses(tmp_path: Path) -> None:
    again = '<distribute><position method="constant" values="0,0,0" />'
    again += '<orientation method="constant" values="0,0,0" /><entity quantity="1" max_trials="9"'
    again += ' base_num="15"><e-puck id="epuck"><controller config="ant" /></e-puck></entity>'
    path = edited(tmp_path, ("</arena>", f"{again}</distribute></arena>"))
    with pytest.raises(UsageError, match=r"line 97 .*3 for the 1 places of its method 'constant'"):
        grown(path, 40)
    names = [robot.id for robot in grown(path, 18).robots]
    assert names[15:] == ["epuck15", "epuck16", "epuck17"]


def test_robots_with_places_of_their_own_are_not_more(tmp_path: Path) -> None:
    text = (SHIPPED_FOLDER / "foraging.argos").read_text()
    start, end = text.index("    <distribute>"), text.index("  </arena>")
    alone = '<e-puck id="one"><body position="0,0,0" orientation="0,0,0" />'
    alone += '<controller config="ant" /></e-puck>'
    (tmp_path / "foraging.py").write_bytes((SHIPPED_FOLDER / "foraging.py").read_bytes())
    path = tmp_path / "alone.argos"
    path.write_text(text[:start] + alone + text[end:])
    with pytest.raises(UsageError, match=r"^3 robots: .*alone.argos has 1, all at places of their"):
        grown(path, 3)


def test_a_grid_has_only_its_places(tmp_path: Path) -> None:
    grid = 'grid" center="0,0,0" distances="0.2,0.2,0" layout="6,3,1'
    path = edited(tmp_path, (f'uniform" {DRAWN[:-1]}', grid))
    assert len(settle(grown(path, 18), 1).robots) == 18
    with pytest.raises(UsageError, match=r"^19 robots: .* line 88 would have 19 for the 18 places"):
        grown(path, 19)


def test_another_quantity_takes_the_files_tags_as_far_as_they_go() -> None:
    there = [robot.tag for robot in load("foraging").robots]
    few, many = (
        load("foraging", settings={"entity.quantity": n}, stage=Stage.SIM) for n in ("10", "20")
    )
    assert [robot.tag for robot in few.robots] == there[:10] and few.warnings == ()
    assert [robot.tag for robot in many.robots][:15] == there and many.warnings == ()
    assert many.robots == grown("foraging", 20).robots


@pytest.mark.parametrize("stage", [Stage.SIM, Stage.LAB, Stage.RUN])
def test_a_quantity_and_a_number_of_robots_are_refused_together(stage: Stage) -> None:
    settings, casting = {"entity.quantity": "10"}, Casting(limit=50)
    with pytest.raises(UsageError, match=r"^50 robots .*'entity.quantity' says how many"):
        load("foraging", settings=settings, stage=stage, casting=casting)
    things = load("pollutant", settings={"arena.size": "6,6,1"}, casting=Casting(limit=3))
    assert len(first_robots(things, 3).robots) == 3


def test_a_quantity_and_tags_in_the_file_must_agree(tmp_path: Path) -> None:
    path = edited(tmp_path, ('quantity="15"', 'quantity="16"'))
    with pytest.raises(ConfigError, match="has 15 tags, expected 16 as in quantity"):
        load(path)


def test_a_simulation_needs_no_tags_and_a_lab_names_a_family_that_suffices(tmp_path: Path) -> None:
    tags = (SHIPPED_FOLDER / "foraging.argos").read_text().partition('vs:tags="')[2]
    tags = tags.partition('"')[0]
    words = (f'vs:tags="{tags}"', ""), ('family="arrow4x4"', 'family="aruco_4x4_50"')
    path = edited(tmp_path, *words)
    worn = [robot.tag for robot in grown(path, 60).robots]
    assert sorted(worn) == list(range(60))
    assert len(grown(path, 50, Stage.LAB).robots) == 50
    with pytest.raises(ConfigError) as caught:
        grown(path, 60, Stage.LAB)
    assert "60 bodies have no tag, and the marker family 'aruco_4x4_50' has 50" in str(caught.value)
    assert "apriltag_36h11 (587)" in str(caught.value) and "arrow4x4 (65536)" in str(caught.value)


def test_real_robots_beyond_the_file_are_the_rosters(tmp_path: Path) -> None:
    lab = roster.read(rosters.write(tmp_path, "a tag=7\nb tag=31\nc tag=24\nd tag=8 spare=true\n"))
    taken = grown("foraging", 17, Stage.RUN, Casting.of(lab, limit=17))
    assert [robot.tag for robot in taken.robots[15:]] == [7, 24] and taken.warnings == ()
    with pytest.raises(ConfigError, match=r"asks for 3 robots, and .* has 2 for it: 8 a spare; 31"):
        grown("foraging", 18, Stage.RUN, Casting.of(lab, limit=18))
    alone = grown("foraging", 17, Stage.RUN)
    (warning,) = alone.warnings
    worn = ", ".join(str(robot.tag) for robot in alone.robots[15:])
    words = f"vs:tags has tags for the others only: 'epuck15' to 'epuck16' wear {worn}"
    assert f"{words}; a roster gives them others: vsense robot init" in warning


PLAN = """
mode = "{mode}"
experiment = "{path}"
duration_s = 1
[[condition]]
name = "sighted"
[[start]]
name = "drawn"
seed = 7
"""


@pytest.mark.parametrize("stage", [Stage.SIM, Stage.LAB])
def test_tags_that_cameras_confuse_are_reported_where_there_are_cameras(
    stage: Stage, tmp_path: Path, capsys
) -> None:
    path = edited(tmp_path, ('vs:tags="31 1843', 'vs:tags="31 30'))
    say_warnings(load(path, stage=stage), Console())
    words = f"vsense: {path}: tags 30 and 31 differ in one cell: cameras may confuse them"
    has_cameras = stage is Stage.LAB
    assert (words in capsys.readouterr().err) is has_cameras
    assert cli.main([stage.value, str(path), "--dry"]) == 0
    assert ("tags 30 and 31 differ in one cell" in capsys.readouterr().out) is has_cameras
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN.format(mode=stage.value, path=path))
    warnings = "\n".join(PlannedSeries(plan, SeriesOptions())._warnings())
    assert ("tags 30 and 31 differ in one cell" in warnings) is has_cameras


@pytest.mark.parametrize("command", ["sim", "lab --port 0", "sim --runs 2"])
def test_robots_without_room_are_refused_before_any_folder_is_made(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    words, *options = command.split()
    path = edited(tmp_path, (DRAWN, 'min="-0.1,-0.1,0" max="0.1,0.1,0"'))
    assert cli.main([words, str(path), *options]) == 2
    assert "of 15 have a place; expected fewer of them, more room" in capsys.readouterr().err
    path = edited(tmp_path, (DRAWN, 'min="5,5,0" max="6,6,0"'))
    assert cli.main([words, str(path), *options]) == 2
    said = capsys.readouterr().err
    assert "all 1000 places drawn for 'epuck_31_0' are outside of the arena or" in said
    assert list(here.iterdir()) == []


def test_every_seed_of_a_campaign_is_tried_before_any_file_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    path = edited(tmp_path, (DRAWN, 'min="-0.16,-0.16,0" max="0.16,0.16,0"'))
    settle(load(path), 5)
    with pytest.raises(ConfigError, match="13 of 15 have a place"):
        settle(load(path), 6)
    assert cli.main(["sim", str(path), "--seeds", "5,6", "--duration", "1"]) == 2
    assert "13 of 15 have a place" in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_a_grown_run_is_packed_and_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    sim = ["sim", "foraging", "--robots", "18", "--duration", "2", "--output", "run"]
    assert cli.main(sim) == 0
    assert json.loads(Path("run/summary.json").read_text())["robots"] == 18
    assert cli.main(["pack", "run", "-o", "run.zip", "--no-report", "--json"]) == 0
    capsys.readouterr()
    assert cli.main(["reproduce", "run.zip", "--json"]) == 0
    print(capsys.readouterr().out)


def test_a_campaign_over_swarm_sizes_prints_its_medians(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    sizes = ["--set", "entity.quantity=10,20", "--runs", "2", "--duration", "2", "-j", "1"]
    assert cli.main(["sim", "foraging", *sizes]) == 0
    said = capsys.readouterr().err
    assert "median" in said and "entity.quantity=20" in said
    assert [row.robots for row in read_runs(Path("results.csv"))] == [10, 10, 20, 20]
    assert cli.main(["pack", "results.csv", "-o", "sizes.zip", "--no-report"]) == 0
    assert cli.main(["reproduce", "sizes.zip"]) == 0


@pytest.mark.parametrize("count", [4, 18])
def test_dry_describes_as_many_as_would_run(count: int, capsys) -> None:
    assert cli.main(["sim", "foraging", "--robots", str(count), "--dry"]) == 0
    said = capsys.readouterr().out
    assert f"robots          {count}: epuck_31_0" in said
