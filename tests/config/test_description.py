"""What `--dry` says: everything that is there, and what a datagram costs."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import pytest

from tests.rigs.places import DATA
from vsense.base.errors import ConfigError, UsageError
from vsense.base.native import ffi, lib
from vsense.commands.experiments import open_experiment
from vsense.config.description import bytes_down, bytes_up, describe
from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.robots.link.table import Direction, Entry, Table

Read = Callable[..., Experiment]

ARGOS = DATA / "argos" / "epuck_obstacleavoidance.argos"


def table(experiment: Experiment) -> Table:
    sensors = [
        (m.sensor.name, m.sensor.layout, Direction.SENSOR)
        for m in experiment.controllers[0].sensors
    ]
    actuators = [
        (m.actuator.name, m.actuator.layout, Direction.ACTUATOR)
        for m in experiment.controllers[0].actuators
    ]
    return Table(Entry(i, *entry) for i, entry in enumerate([*sensors, *actuators], 1))


def encoded(experiment: Experiment, direction: Direction) -> int:
    """Bytes of a real datagram with this experiment's table."""
    layout = table(experiment).cdata
    header = ffi.new("struct vs_header *", {"table_hash": layout.hash, "session": 1})
    out, length = ffi.new("uint8_t[]", lib.VS_DATAGRAM_MAX), ffi.new("size_t *")
    if direction == Direction.SENSOR:
        body = ffi.new("struct vs_state *")
        code = lib.vs_encode_state(header, layout, body, out, len(out), length)
    else:
        body = ffi.new("struct vs_telemetry *")
        code = lib.vs_encode_telemetry(header, layout, body, out, len(out), length)
    assert code == lib.VS_OK
    return int(length[0])


def test_the_bytes_are_those_of_real_datagrams(read_full: Read, full: str) -> None:
    for experiment in (read_full(full), load("pollutant")):
        (controller,) = experiment.controllers
        assert bytes_down(controller) == encoded(experiment, Direction.SENSOR)
        assert bytes_up(controller) == encoded(experiment, Direction.ACTUATOR)
        text = describe(experiment)
        assert f"per robot and timestep {bytes_down(controller)} bytes down" in text
        assert f"{bytes_up(controller)} bytes up" in text


def test_everything_in_an_experiment_is_described(read_full: Read, full: str) -> None:
    experiment = read_full(full)
    text = describe(experiment)
    names = [
        *(robot.id for robot in experiment.robots),
        *(thing.id for thing in experiment.objects),
        *(entity.id for entity in experiment.entities),
        *(spec.entity.id for spec in experiment.distributed),
        *(field.id for field in experiment.fields),
        *(mounted.sensor.name for mounted in experiment.controllers[0].sensors),
        *(mounted.actuator.name for mounted in experiment.controllers[0].actuators),
        "doors.py", "floor.png", "mine.c", "alpha=0.5", "10.0.0.1:4051", "10.0.0.2:4040", "seed 7",
        "40 s, 400 timesteps of 100 ms", "3 x 2.4 x 1 m", "arrow4x4", "(tag 23)",
        "boxes           4 (1 physical, 3 virtual), 2 of them placed by the seed",
    ]  # fmt: skip
    assert [name for name in names if name not in text] == []
    assert text.endswith("everything in the file is supported")
    experiment.refuse_warnings()


def test_what_is_not_supported_stands_at_the_end() -> None:
    experiment = load(ARGOS)
    description, _, rest = describe(experiment).partition("not as the file says:\n")
    assert [line.strip() for line in rest.splitlines()] == list(experiment.warnings)
    assert "no limit, timesteps of 100 ms, seed 124" in description


def options(**changes: object) -> argparse.Namespace:
    plain = {"experiment": "pollutant", "duration": None, "set": [], "dry": False, "strict": False}
    plain |= {
        "lenient": False,
        "roster": None,
        "replace": [],
        "json": False,
        "sources": [],
        "include": [],
    }
    return argparse.Namespace(**{**plain, **changes})


def test_opening_as_the_command_line_says(capsys: pytest.CaptureFixture[str]) -> None:
    experiment = open_experiment(
        options(duration=60.0, set=[("wanderer.walk_s", "3"), ("sensor.noise", "0.1")])
    )
    assert experiment is not None
    assert experiment.length_s == 60.0
    assert experiment.controllers[0].params["walk_s"] == "3"
    assert experiment.controllers[0].sensors[0].quality.noise_level == 0.1
    given = open_experiment(options(set=[("a.b", ["1", "2"])]), {"wanderer.walk_s": "4"})
    assert given is not None and given.controllers[0].params["walk_s"] == "4"
    assert capsys.readouterr().out == ""


def test_dry_prints_and_gives_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert open_experiment(options(dry=True, strict=True)) is None
    assert capsys.readouterr().out == describe(load("pollutant")) + "\n"


def test_strict_refuses_what_is_not_supported(capsys: pytest.CaptureFixture[str]) -> None:
    path = str(ARGOS)
    assert open_experiment(options(experiment=path)) is not None
    with pytest.raises(ConfigError, match=r"--strict.*4.*\(--dry"):
        open_experiment(options(experiment=path, strict=True))
    assert capsys.readouterr().out == ""
    with pytest.raises(ConfigError) as caught:
        open_experiment(options(experiment=path, strict=True, dry=True))
    assert (caught.value.file, caught.value.line) == (path, 19)
    assert "not as the file says:" in capsys.readouterr().out
    with pytest.raises(UsageError):
        open_experiment(options(set=[("nobody.x", "1")]))
