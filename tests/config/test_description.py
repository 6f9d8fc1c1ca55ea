"""What `--dry` says: everything that is there, and what a datagram costs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.rigs.places import DATA
from vsense.base.errors import ConfigError, UsageError
from vsense.base.native import ffi, lib
from vsense.config.description import bytes_down, bytes_up, describe
from vsense.config.experiment import load
from vsense.config.specs import Experiment, Stage
from vsense.modes.options import ExperimentOptions
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


def asked(experiment: str = "pollutant", **how: Any) -> ExperimentOptions:
    return ExperimentOptions(experiment, Stage.RUN, **how)


def test_loading_as_it_is_asked_for() -> None:
    settings = {"wanderer.walk_s": "3", "sensor.noise": "0.1"}
    experiment = asked(duration=60.0, settings=settings).load()
    assert experiment.length_s == 60.0
    assert experiment.controllers[0].params["walk_s"] == "3"
    assert experiment.controllers[0].sensors[0].quality.noise_level == 0.1


def test_what_is_described_is_all() -> None:
    assert list(asked(strict=True).described(False)) == [describe(load("pollutant"))]


@pytest.mark.parametrize("stage", [Stage.SIM, Stage.LAB])
def test_robots_that_find_no_room_are_reported_without_a_run(tmp_path: Path, stage: Stage) -> None:
    path = tmp_path / "far.argos"
    words = ARGOS.read_text().splitlines()
    there = next(n for n, text in enumerate(words) if "<position" in text)
    words[there] = '<position method="uniform" min="5,5,0" max="6,6,0" />'
    path.write_text("\n".join(words))
    described = ExperimentOptions(str(path), stage).described(False)
    assert "\n  robots " in next(described)
    with pytest.raises(ConfigError, match="outside of the arena") as caught:
        next(described)
    assert (caught.value.file, caught.value.line) == (str(path), there + 3)  # the <entity>


def test_strict_refuses_what_is_not_supported() -> None:
    path = str(ARGOS)
    asked(path).load()
    with pytest.raises(ConfigError, match=r"--strict, and 4 more like it \(--dry shows them\)"):
        asked(path, strict=True).load()
    described = asked(path, strict=True).described(False)
    assert "not as the file says:" in next(described)
    with pytest.raises(ConfigError) as caught:
        next(described)
    assert (caught.value.file, caught.value.line) == (path, 19)
    with pytest.raises(UsageError):
        asked(settings={"nobody.x": "1"}).load()
