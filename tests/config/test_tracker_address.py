"""The address of another tracker in an experiment file."""

from __future__ import annotations

import pytest

from vsense.config.tracker_address import TrackerAddress, read_tracker
from vsense.config.xml import parse
from vsense.errors import ConfigError


def read(framework: str = "", engine: str | None = None) -> TrackerAddress | None:
    engines = f"<physics_engines>\n<iridia_tracking_system {engine}/>\n</physics_engines>"
    text = f"<argos-configuration>\n<framework {framework}/>\n{engines if engine else ''}\n"
    return read_tracker(parse(f"{text}</argos-configuration>".encode(), "x.argos"))


@pytest.mark.parametrize("prefix", ["ats", "its"])
def test_the_thesis_names_it_on_the_framework(prefix: str) -> None:
    found = read(f'{prefix}_host="10.0.0.7" {prefix}_port="4041"')
    assert found == TrackerAddress("10.0.0.7", 4041, (0.0, 0.0), 2)


@pytest.mark.parametrize("prefix", ["ats", "its"])
def test_the_code_names_it_on_the_physics_engine(prefix: str) -> None:
    found = read("", f'id="its" {prefix}_host="tracker" translate_x="2.57" translate_y="4.565"')
    assert found == TrackerAddress("tracker", 4040, (2.57, 4.565), 4)


def test_the_engine_shifts_the_tracker_that_the_framework_names() -> None:
    found = read('ats_host="a"', 'id="its" translate_x="1"')
    assert found is not None and found.origin_m == (1.0, 0.0)


def test_without_a_host_there_is_none() -> None:
    assert read() is None
    assert read("", 'id="its" translate_x="1"') is None


@pytest.mark.parametrize(
    ("framework", "engine", "message"),
    [
        ('ats_port="4040"', None, "x.argos:2: <framework> ats_port: is without ats_host"),
        ('ats_host="a" its_host="b"', None, "x.argos:2: <framework> its_host: stands beside"),
        ('ats_host="a" ats_port="0"', None, "out of range, expected 1 to 65535"),
        ('ats_host=" "', None, "is empty, expected a host's name or address"),
        ('ats_host="a"', 'its_host="b"', "x.argos:4: .* a tracker's host stands in line 2 already"),
        ("", 'its_host="b" translate_x="far"', "translate_x: 'far'"),
    ],
)
def test_what_is_wrong_is_refused_at_its_line(
    framework: str, engine: str | None, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read(framework, engine)
