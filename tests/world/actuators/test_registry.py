"""A new virtual actuator is one new file: nothing else has to name it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import vsense.world.actuators
from tests.world.actuators.conftest import element_of
from vsense.base.errors import ConfigError
from vsense.config import devices
from vsense.world.actuators.base import ActuatorError
from vsense.world.sensors.base import Scope
from vsense.world.sensors.quality import Quality

NEW_ACTUATOR = """
from dataclasses import dataclass

from vsense.world.sensors.quality import Scale

ELEMENTS = ("virtual_lamp_actuator",)
_SHARE = Scale(low=0.0, high=1.0)


@dataclass(frozen=True)
class Lamp:
    id: str
    name: str = "lamp"
    layout: str = "f4"
    scale: Scale = _SHARE

    def apply(self, world, rows, values, increments):
        world.results[self.id] = float(values.max(initial=0.0))


def from_xml(element, scope):
    return Lamp(element.text("id"))
"""
ELEMENT = '<virtual_lamp_actuator id="beacon" noise_std_dev="0.1" vs:update_every="5" />'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(
        vsense.world.actuators, "__path__", [*vsense.world.actuators.__path__, str(tmp_path)]
    )
    devices.factories.cache_clear()
    yield tmp_path
    devices.factories.cache_clear()
    for name in ("lamp_of_test", "second_of_test"):
        sys.modules.pop(f"vsense.world.actuators.{name}", None)


def test_a_new_actuator_is_one_new_file(folder: Path, scope: Scope) -> None:
    (folder / "lamp_of_test.py").write_text(NEW_ACTUATOR)
    mounted = devices.mount_actuator(element_of(ELEMENT), scope)
    assert (mounted.actuator.name, mounted.line) == ("lamp", 1)
    assert mounted.quality == Quality(noise_std_dev=0.1, update_every=5)


def test_two_files_for_one_element_are_refused(folder: Path) -> None:
    for name in ("lamp_of_test", "second_of_test"):
        (folder / f"{name}.py").write_text(NEW_ACTUATOR)
    with pytest.raises(ActuatorError, match=r"<virtual_lamp_actuator>.*module's"):
        devices.factories(devices.ACTUATORS)


def test_a_new_actuators_own_errors_have_their_line(folder: Path, scope: Scope) -> None:
    (folder / "lamp_of_test.py").write_text(NEW_ACTUATOR)
    with pytest.raises(ConfigError, match=r"x\.argos:1: <virtual_lamp_actuator> id:"):
        devices.mount_actuator(element_of("<virtual_lamp_actuator />"), scope)
