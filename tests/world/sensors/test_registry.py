"""A new virtual sensor is one new file: nothing else has to name it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import vsense.world.sensors
from vsense.base.errors import ConfigError
from vsense.base.xml.parsing import parse
from vsense.config import devices
from vsense.world.sensors.base import Scope, SensorError
from vsense.world.sensors.quality import Quality

NEW_SENSOR = """
from dataclasses import dataclass

import numpy as np

ELEMENTS = ("virtual_compass_sensor",)


@dataclass(frozen=True)
class Compass:
    scale: float
    name: str = "compass"
    layout: str = "f4"

    def read(self, world, robots):
        return self.scale * robots["yaw_rad"][:, None]


def from_xml(element, scope):
    return Compass(element.number("scale", 0.0, 10.0, default=1.0))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(
        vsense.world.sensors, "__path__", [*vsense.world.sensors.__path__, str(tmp_path)]
    )
    devices.factories.cache_clear()
    yield tmp_path
    devices.factories.cache_clear()
    for name in ("compass_of_test", "second_of_test"):
        sys.modules.pop(f"vsense.world.sensors.{name}", None)


def test_the_shipped_sensors_are_found() -> None:
    assert set(devices.factories(devices.SENSORS)) == {
        "destination_virtual_sensor",
        "gps_virtual_sensor",
        "virtual_black_white_location_sensor",
        "virtual_field_sensor",
        "virtual_ground_sensor",
        "virtual_led_sensor",
        "virtual_light_sensor",
        "virtual_pollutant_sensor",
        "virtual_proximity_sensor",
        "virtual_radiation_sensor",
        "virtual_range_and_bearing_sensor",
        "virtual_rgb_ground_sensor",
        "vs:sensor",
    }


def test_a_new_sensor_is_one_new_file(folder: Path) -> None:
    (folder / "compass_of_test.py").write_text(NEW_SENSOR)
    xml = b'<r xmlns:vs="urn:vsense:1"><virtual_compass_sensor scale="2" vs:update_every="5"/></r>'
    element = parse(xml, "x.argos").child("virtual_compass_sensor")
    mounted = devices.mount_sensor(element, Scope({}, 0))
    assert (mounted.sensor.name, mounted.line) == ("compass", 1)
    assert mounted.quality == Quality(update_every=5)


def test_two_files_for_one_element_are_refused(folder: Path) -> None:
    for name in ("compass_of_test", "second_of_test"):
        (folder / f"{name}.py").write_text(NEW_SENSOR)
    with pytest.raises(SensorError, match=r"<virtual_compass_sensor>.*module's"):
        devices.factories(devices.SENSORS)


@pytest.mark.parametrize("every", ["0", "-1", "1.5", "always"])
def test_a_wrong_updating_condition_is_refused(every: str) -> None:
    xml = f'<r xmlns:vs="urn:vsense:1"><virtual_pollutant_sensor vs:update_every="{every}"/></r>'
    element = parse(xml.encode(), "x.argos").child("virtual_pollutant_sensor")
    with pytest.raises(ConfigError, match="vs:update_every"):
        devices.mount_sensor(element, Scope({"epuck_22_1": 22}, 0))


def test_a_layout_that_no_robot_can_read_is_refused_at_its_element(folder: Path) -> None:
    (folder / "compass_of_test.py").write_text(NEW_SENSOR.replace('"f4"', '"f8"'))
    element = parse(b"<r><virtual_compass_sensor/></r>", "x.argos").child("virtual_compass_sensor")
    with pytest.raises(ConfigError, match=r"x.argos:1: <virtual_compass_sensor>:.*'f8'"):
        devices.mount_sensor(element, Scope({}, 0))
