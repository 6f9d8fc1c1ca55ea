"""A new virtual actuator is one new file: nothing else has to name it."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import vsense.world.actuators
from tests.conftest import States
from tests.world.actuators.conftest import element_of
from vsense.base.errors import ConfigError
from vsense.config import devices
from vsense.world.actuators.bank import ActuatorBank
from vsense.world.actuators.base import ActuatorError, MountedActuator
from vsense.world.sensors.base import Scope
from vsense.world.sensors.quality import Quality
from vsense.world.world import World

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


@pytest.fixture
def users(tmp_path: Path) -> Scope:
    return Scope({}, 0, folder=tmp_path)


OWN = '<vs:actuator file="lamp.py" id="beacon" noise_std_dev="0.1" vs:update_every="5" />'


def test_an_actuator_of_the_users_own_is_one_file_beside_the_experiment(
    users: Scope, state: States
) -> None:
    (users.folder / "lamp.py").write_text(NEW_ACTUATOR)
    mounted = devices.mount_actuator(element_of(OWN), users)
    assert mounted.quality == Quality(noise_std_dev=0.1, update_every=5)
    plain = MountedActuator(mounted.actuator, 1)
    world, bank = World([5, 6]), ActuatorBank([plain], [5, 6])
    world.update(state({5: (0.0, 0.0, 0.0), 6: (1.0, 0.0, 0.0)}, 10**8), 0)
    levels = {5: 0.25, 6: 0.75}
    bank.apply(world, {tag: struct.pack("<f", level) for tag, level in levels.items()})
    assert world.results["beacon"] == 0.75


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("def apply", "def aply", r"lamp.py gave has no apply .is 'aply' meant"),
        ("_SHARE = Scale(low=0.0, high=1.0)", "_SHARE = 3", r"scale is 3, expected vsense.Scale"),
        ('"f4"', '"f8"', r"layout 'f8': expected 'type' or 'count\*type'"),
        (
            "def apply",
            "def kernal(self): ...\n\n    def apply",
            r"lamp.py:17: kernal is called by nobody",
        ),
        ("return Lamp(", "return Lampe(", r"lamp.py:22: NameError: name 'Lampe'"),
    ],
)
def test_a_users_actuator_that_is_wrong_is_told_with_file_and_line(
    users: Scope, old: str, new: str, words: str
) -> None:
    (users.folder / "lamp.py").write_text(NEW_ACTUATOR.replace(old, new))
    with pytest.raises((ConfigError, ActuatorError), match=words):
        devices.mount_actuator(element_of(OWN), users)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("1 / 0", "lamp.py:18: ZeroDivisionError: division by zero"),
        ("world.results['a'] = float('nan')", "lamp.py:18: result 'a' is nan, expected a finite"),
        ("world.results['a'] = values[9, 9]", "lamp.py:18: IndexError: index 9 is out of bounds"),
    ],
)
def test_an_error_while_it_acts_names_file_and_line(
    users: Scope, state: States, code: str, words: str
) -> None:
    line = "        world.results[self.id] ="
    text = NEW_ACTUATOR.replace(line, f"        {code}\n{line}")
    (users.folder / "lamp.py").write_text(text)
    actuator = devices.mount_actuator(element_of(OWN), users).actuator
    world, bank = World([5]), ActuatorBank([MountedActuator(actuator, 1)], [5])
    world.update(state({5: (0.0, 0.0, 0.0)}, 10**8), 0)
    with pytest.raises(ActuatorError, match=re.escape(words)):
        bank.apply(world, {5: struct.pack("<f", 0.5)})
