"""What controllers ask for in vain and are told in vain: refused before anything starts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import require_tool
from vsense import cli
from vsense.base.errors import ConfigError
from vsense.config.experiment import load, read
from vsense.config.specs import Stage
from vsense.run import asked


@pytest.fixture(scope="module", autouse=True)
def compiler() -> None:
    require_tool("cc", "build-essential")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("stop_probabilty", "0.1", "reads no parameter 'stop_probabilty'; is 'stop_probability'"),
        ("walks_s", "1", "reads no parameter 'walks_s'; is 'walk_s' meant?"),
        ("x", "1", "reads no parameter 'x'; there are: near_raw, speed_cm_s, stop_probability, "),
        ("walk_s", "many", "its parameter 'walk_s' is 'many', expected a number"),
        ("walk_s", "-1", "its parameter 'walk_s' is '-1', expected a number of 0 or more"),
        ("stop_probability", "1.1", "is '1.1', expected a number from 0 to 1"),
    ],
)
def test_a_parameter_that_nobody_reads_or_that_is_no_number(
    key: str, value: str, words: str
) -> None:
    wrong = load("pollutant", settings={f"pollutant.{key}": value}, stage=Stage.SIM)
    line = wrong.controllers[0].line
    where = f"pollutant.argos:{line}: <pollutant_controller>: "
    with pytest.raises(ConfigError, match=re.escape(where) + ".*" + re.escape(words)):
        asked.check(wrong)


def test_what_is_read_and_what_may_be_read_is_right() -> None:
    """A name that stands in quotes in the source may be read in some cases, and is not refused."""
    for stage in Stage:
        asked.check(load("pollutant", settings={"pollutant.walk_s": "2"}, stage=stage))
    asked.check(load("pollutant", settings={"pollutant.pollutant": "2"}, stage=Stage.SIM))


def test_a_sensor_that_nobody_offers() -> None:
    path = load("pollutant").path
    text = re.sub(r"(?s)<virtual_pollutant_sensor.*?/>", "", path.read_text())
    bare = read(text.encode(), "bare.argos", path, stage=Stage.RUN)
    with pytest.raises(ConfigError, match="sensor 'pollutant'"):
        asked.check(bare)


def test_a_program_that_fails_at_once_is_left_to_the_run(tmp_path: Path) -> None:
    (tmp_path / "bad.c").write_text(
        '#include "controller.h"\n#include <stdlib.h>\n'
        "static void init(void *state, struct vs_robot *robot) { (void)state; (void)robot;"
        " abort(); }\nconst struct vs_controller vs_controller = {.name = "
        '"bad", .init = init};\n'
    )
    text = load("pollutant").path.read_text().replace('library="pollutant"', 'library="bad.c"')
    asked.check(read(text.encode(), "bad.argos", tmp_path / "bad.argos", stage=Stage.SIM))


@pytest.mark.parametrize("command", ["sim", "lab", "run"])
def test_commands_refuse_before_they_begin(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main([command, "pollutant", "--set", "pollutant.warp=4"]) == 2
    assert "reads no parameter 'warp'; there are: " in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_campaign_tries_every_setting_before_its_first_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    swept = ["sim", "pollutant", "--runs", "2", "--set", "pollutant.walk_s=1,2,x"]
    assert cli.main(swept) == 2
    assert "its parameter 'walk_s' is 'x', expected a number" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
