"""Who plays the parts of an experiment: robots out of a roster, and spares put in."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from tests.robots import rosters
from vsense import cli
from vsense.base.errors import ConfigError, UsageError
from vsense.config import roster
from vsense.config.casting import Casting, pair
from vsense.config.experiment import first_robots, load
from vsense.config.specs import Experiment, Stage
from vsense.modes.sim.job import Job, Setup

LAB = (
    "a tag=30\nb tag=23\nc tag=24 out_of_order=left~motor~stalls\nd tag=37 spare=true\n"
    "e tag=25 name=blue\nf tag=26\n"
)
"""Robots that may be taken: 30, 23, 25, 26."""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    return rosters.write(tmp_path, LAB)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Foraging with three robots without tags."""
    shipped = Path(str(load("foraging").path))
    text = shipped.read_text()
    start = text.index('vs:tags="')
    end = text.index('"', start + 9) + 1
    text = text[:start] + text[end:]
    path = shipped.parent / "foraging.py"
    (tmp_path / "foraging.py").write_bytes(path.read_bytes())
    mine = tmp_path / "foraging.argos"
    mine.write_text(text)
    return mine


def cast(file: Path, lab: Path | None, *pairs: str, robots: int | None = 3) -> Experiment:
    known = None if lab is None else roster.read(lab)
    casting = Casting.of(known, [pair(text) for text in pairs], robots)
    return first_robots(load(file, stage=Stage.SIM, casting=casting), robots)


def tags(experiment: Experiment) -> list[int]:
    return [robot.tag for robot in experiment.robots]


def test_robots_without_tags_are_the_rosters_that_work_in_its_order(file: Path, lab: Path) -> None:
    experiment = cast(file, lab)
    assert tags(experiment) == [30, 23, 25]
    assert experiment.taken == (30, 23, 25)
    assert not any("vs:tags is missing" in warning for warning in experiment.warnings)
    # Nobody else is given a robot's number: not even who is left out by --robots.
    everybody = load(file, stage=Stage.SIM, casting=Casting.of(roster.read(lab), limit=3))
    assert not {24, 26, 37} & set(tags(everybody))


def test_without_a_roster_all_is_as_before(file: Path) -> None:
    assert tags(cast(file, None)) == tags(first_robots(load(file, stage=Stage.SIM), 3))
    # Only real robots have to wear a marker: nothing is said of simulated ones.
    assert not any("vs:tags is missing" in text for text in cast(file, None).warnings)
    assert any("vs:tags is missing" in text for text in load(file, stage=Stage.RUN).warnings)


def test_too_few_robots_are_told_with_who_is_left_out_and_why(file: Path, lab: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        cast(file, lab, robots=5)
    assert "asks for 5 robots, and " in str(caught.value)
    assert "has 4 for it: 24 out of order: left motor stalls; 37 a spare" in str(caught.value)
    assert str(caught.value).startswith(f"{file}:")


def test_a_spare_plays_the_part_of_another(file: Path, lab: Path) -> None:
    before, after = cast(file, lab), cast(file, lab, "23=37")
    assert tags(after) == [30, 37, 25]
    assert [(r.id, r.number, r.controller) for r in after.robots] == [
        (r.id, r.number, r.controller) for r in before.robots
    ]


def test_a_spare_is_put_in_without_a_roster_too() -> None:
    shipped = tags(load("foraging"))
    experiment = load("foraging", casting=Casting(replaced=((shipped[1], 9000),)))
    assert tags(experiment) == [shipped[0], 9000, *shipped[2:]]


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        (["7=37"], "--replace 7=37: no robot has tag 7; expected one of 30, 23, 25"),
        (["23=25"], "--replace 23=25: 25 is in the experiment already"),
        (["23=24"], "--replace 23=24: 24 is out of order: left motor stalls"),
        (["23=37", "30=37"], "--replace 30=37: 37 is in the experiment already"),
    ],
)
def test_replacements_that_cannot_be(file: Path, lab: Path, pairs: list[str], words: str) -> None:
    with pytest.raises(UsageError) as caught:
        cast(file, lab, *pairs)
    assert str(caught.value).startswith(words)


@pytest.mark.parametrize("text", ["23", "23=", "=3", "23=23", "a=b", "1=70000", "1=2=3", "-1=2"])
def test_words_that_are_no_replacement(text: str) -> None:
    with pytest.raises(ValueError, match=r"tags.*23=37"):
        pair(text)


def test_a_casting_travels(file: Path, lab: Path) -> None:
    casting = cast(file, lab, "23=37").casting
    assert Casting.read(json.loads(json.dumps(asdict(casting)))) == casting
    job = Job(Setup(str(file), robots=3, casting=casting), 1, {})
    assert tags(Job.from_line(job.to_line()).setup.load()) == [30, 37, 25]


def test_who_plays_is_told(file: Path, lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--roster", str(lab), "--robots", "3", "--replace", "23=37", "--duration", "1"]
    assert cli.main(["sim", str(file), *words, "-o", str(lab.parent / "out")]) == 0
    said = capsys.readouterr().err
    assert (
        f"{lab}: robots 30 25 take part; not taken: 24 is out of order: left motor stalls" in said
    )
    assert "robot 37 takes the role of 23" in said


def test_a_robot_plays_no_part_of_another_model(file: Path, lab: Path) -> None:
    text = lab.read_text()
    for tag, model in ((30, "thymio2"), (23, "epuck"), (37, "thymio2")):
        text = text.replace(f"tag = {tag}\n", f'tag = {tag}\nmodel = "{model}"\n')
    lab.write_text(text)
    assert tags(cast(file, lab)) == [23, 25, 26], "of the others the roster does not say"
    with pytest.raises(ConfigError, match=r"has 3 for it: .*; 30 is of the model thymio2$"):
        cast(file, lab, robots=4)
    with pytest.raises(UsageError, match=r"37 is of the model 'thymio2', and not of 'epuck'"):
        cast(file, lab, "25=37")
    file.write_text(file.read_text().replace('<e-puck id="', '<e-puck vs:model="thymio2" id="'))
    assert tags(cast(file, lab)) == [30, 25, 26]
    assert tags(cast(file, lab, "25=37")) == [30, 37, 26]
    shipped = load("foraging").path
    named = file.with_name("named.argos")
    named.write_text(shipped.read_text())
    tag = load("foraging").robots[0].tag
    lab.write_text(f'[[robot]]\ntag = {tag}\nmodel = "thymio2"\n')
    with pytest.raises(ConfigError, match=f"says that robot {tag} is of the model 'thymio2'"):
        load(str(named), stage=Stage.SIM, casting=Casting.of(roster.read(lab)))
