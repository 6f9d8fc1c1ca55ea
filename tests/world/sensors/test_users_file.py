"""A sensor of the user's own beside his experiment: found, used, and blamed by file and line."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from tests.world.sensors.scenes import STEP_NS, mount, world_of
from vsense.base.errors import ConfigError
from vsense.world.sensors.bank import SensorBank
from vsense.world.sensors.base import MountedSensor, Scope, SensorError
from vsense.world.sensors.quality import Quality

GOOD = """
from dataclasses import dataclass

import numpy as np


@dataclass
class Height:
    offset: float
    name: str = "height"
    layout: str = "f4"

    def read(self, world, robots):
        return robots["y_m"][:, None] + self.offset


def from_xml(element, scope):
    return Height(element.number("offset", 0, 10, "m"))
"""


@pytest.fixture
def scope(tmp_path: Path) -> Scope:
    return Scope({}, 0, folder=tmp_path)


def write(scope: Scope, text: str) -> None:
    (scope.folder / "mine.py").write_text(text)


def mounted(scope: Scope, more: str = 'offset="1"') -> MountedSensor:
    return mount(f'<vs:sensor file="mine.py" {more}/>', scope)


def sent(sensor: MountedSensor) -> bytes:
    bank = SensorBank([sensor], [1])
    ((value, capture_ns),) = bank.encode(world_of({1: (0.0, 2.0, 0.0)}), 0)[1]
    assert capture_ns == STEP_NS
    return value


def test_it_is_used_as_any_other_with_quality_and_condition(scope: Scope) -> None:
    write(scope, GOOD)
    assert sent(mounted(scope)) == struct.pack("<f", 3.0)
    biased = mounted(scope, 'offset="1" vs:bias="0.5" vs:update="every:3"')
    assert biased.quality == Quality(bias=0.5, update_every=3)
    assert sent(biased) == struct.pack("<f", 3.5)


def test_its_optional_members_are_those_of_any_other(scope: Scope) -> None:
    more = """
    def changed(self, sent, fresh):
        return fresh[:, 0] > sent[:, 0]

    def tidy(self, values):
        return values * 2
"""
    write(scope, GOOD.replace("\n\ndef from_xml", more + "\n\ndef from_xml"))
    sensor = mounted(scope, 'offset="1" vs:bias="1"')
    assert sensor.updating.kind == "own"
    assert sent(sensor) == struct.pack("<f", 8.0)


def test_two_files_of_one_name_in_two_folders_do_not_meet(scope: Scope, tmp_path: Path) -> None:
    write(scope, GOOD)
    other = Scope({}, 0, folder=tmp_path / "other")
    other.folder.mkdir()
    write(other, GOOD.replace('"height"', '"depth"'))
    names = [mounted(s).sensor.name for s in (scope, other, scope)]
    assert names == ["height", "depth", "height"]


def test_an_edited_file_is_read_again(scope: Scope) -> None:
    write(scope, GOOD)
    assert mounted(scope).sensor.name == "height"
    write(scope, GOOD.replace('"height"', '"higher"'))
    assert mounted(scope).sensor.name == "higher"
    assert [path.name for path in scope.folder.iterdir()] == ["mine.py"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def f(:\n", "mine.py:1: SyntaxError:"),
        ("\nimport no_such_module_here\n", "mine.py:2: ModuleNotFoundError:"),
        ("\n\nx = 1 / 0\n", "mine.py:3: ZeroDivisionError:"),
        (GOOD.replace("return Height(", "return Hight("), "mine.py:18: NameError:.*'Hight'"),
    ],
)
def test_an_error_in_it_names_file_and_line(scope: Scope, text: str, words: str) -> None:
    write(scope, text)
    with pytest.raises(SensorError, match=words):
        mounted(scope)


def test_an_error_while_it_reads_names_file_and_line(scope: Scope) -> None:
    write(scope, GOOD.replace('robots["y_m"]', 'robots["height_m"]'))
    sensor = mounted(scope)
    with pytest.raises(SensorError, match=r"mine.py:14: ValueError:.*height_m"):
        sent(sensor)


def test_what_it_gives_is_checked(scope: Scope) -> None:
    write(scope, GOOD.replace("+ self.offset", "/ 0.0"))
    with (
        pytest.warns(RuntimeWarning),
        pytest.raises(SensorError, match="'height': inf"),
    ):
        sent(mounted(scope))


@pytest.mark.parametrize(
    ("text", "more", "words"),
    [
        ("x = 1\n", "", r"file: .*mine.py has no function 'from_xml\(element, scope\)'"),
        ("def from_xml(e, s):\n    return 3\n", "", r"mine.py gave has no name, layout, read"),
        (GOOD, 'offset="11"', r"<vs:sensor> offset: 11 is out of range"),
        (GOOD.replace('"f4"', '"f8"'), 'offset="1"', r"<vs:sensor>: layout 'f8': expected"),
        (GOOD, 'offset="1" ofset="1"', r"ofset: is not an attribute of it; is 'offset' meant"),
    ],
)
def test_what_is_no_sensor_is_refused_at_its_element(
    scope: Scope, text: str, more: str, words: str
) -> None:
    write(scope, text)
    with pytest.raises(ConfigError, match="x.argos:1: .*" + words):
        mounted(scope, more)


def test_a_file_that_is_not_there_is_refused(scope: Scope) -> None:
    with pytest.raises(ConfigError, match=r"file:.*'.*mine.py'"):
        mounted(scope)
    with pytest.raises(ConfigError, match=r"file:.*missing"):
        mount("<vs:sensor/>", scope)
    with pytest.raises(ConfigError, match=r"file: .*'/"):
        mount('<vs:sensor file="."/>', scope)


def test_values_of_a_wrong_shape_have_their_line(scope: Scope) -> None:
    write(scope, GOOD.replace('robots["y_m"][:, None]', 'robots["y_m"]'))
    with pytest.raises(SensorError, match=r"mine\.py:13:.*'height':.*\(1,\)"):
        sent(mounted(scope))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "def from_xml",
            "def from_xlm",
            r"no function 'from_xml\(element, scope\)' .is 'from_xlm'",
        ),
        ("def read(", "def raed(", r"gave has no read .is 'raed' meant"),
        (
            "def read(",
            "def tidyy(self, values): ...\n\n    def read(",
            r"mine.py:13: tidyy is called",
        ),
        (
            "def read(",
            "def change(self, a, b): ...\n\n    def read(",
            r"is 'changed' meant\?\); beg",
        ),
    ],
)
def test_a_misspelt_name_is_told_with_the_one_that_is_meant(
    scope: Scope, old: str, new: str, words: str
) -> None:
    write(scope, GOOD.replace(old, new))
    with pytest.raises((ConfigError, SensorError), match=words):
        mounted(scope)


def test_names_of_its_own_are_left_alone(scope: Scope) -> None:
    own = "def _tidyy(self): ...\n\n    def measure(self): ...\n\n    def read("
    write(scope, GOOD.replace("def read(", own))
    assert sent(mounted(scope)) == struct.pack("<f", 3.0)
