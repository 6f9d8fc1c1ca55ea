"""Loop functions in C++ that use the objects of controllers: in simulations only."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import require_tool
from vsense.base.errors import VsenseError
from vsense.config.experiment import load
from vsense.config.specs import Stage
from vsense.modes.sim._simulation import Simulation
from vsense.robots._compiled import SHOWN_LINES
from vsense.run.environment import Environment
from vsense.run.programs import shared_objects

HERE = Path(__file__).parent / "argos"
SAID = """\
a, begun, has a goal
b, begun, has a goal
e, begun, has a goal
a at work 9 4.5 of 27, 8
b at work 9 9 of 27, 8
e at work 9 18 of 27, 8
a at work 20 10 of 60, 8
b at work 20 20 of 60, 8
e at work 20 40 of 60, 8
"""
"""Source: what ARGoS 3 (421bd76) with argos3-epuck 66cb8d9 logs of the same files, built without
optimisation, with <physics_engines> and <media> added."""


@pytest.fixture(scope="module")
def folder(shared_cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Controller and loop functions, which are built once."""
    require_tool("c++", "build-essential")
    made = tmp_path_factory.mktemp("supervised")
    for name in ("counter.h", "counter.cpp", "supervisor.cpp"):
        shutil.copy2(HERE / name, made)
    return made


@pytest.fixture
def supervised(folder: Path) -> Path:
    return Path(shutil.copy2(HERE / "supervised.argos", folder))


def simulated(path: Path) -> Simulation:
    experiment = load(path, stage=Stage.SIM)
    return Simulation(experiment, shared_objects(experiment), 7)


@pytest.mark.parametrize("is_chained", [True, False])
def test_a_simulation_goes_as_in_argos(
    supervised: Path, monkeypatch: pytest.MonkeyPatch, is_chained: bool
) -> None:
    if not is_chained:
        monkeypatch.setattr(Simulation, "_chained", lambda run: None)
    run = simulated(supervised)
    run.run()
    assert (run.chain is not None) == is_chained
    lines = [text.removeprefix("loop functions: ") for _, text in run.record.events]
    assert lines == SAID.splitlines()


def test_a_controller_that_cannot_begin_is_named(supervised: Path) -> None:
    supervised.write_text(supervised.read_text().replace('fails="false"', 'fails="true"'))
    words = r"supervised\.argos:8: <counter> cannot go on, robot 'a': \[FATAL\] told to fail"
    with pytest.raises(VsenseError, match=words):
        simulated(supervised)


def on_robots(path: Path) -> None:
    Environment(load(path), 7)


def with_two_controllers(path: Path) -> None:
    text = path.read_text()
    start, end = text.index("    <counter"), text.index("  </controllers>")
    text = text[:end] + text[start:end].replace('id="c"', 'id="d"') + text[end:]
    last = text.rindex('config="c"')
    path.write_text(f'{text[:last]}config="d"{text[last + 10 :]}')
    simulated(path)


@pytest.mark.parametrize("begin", [on_robots, with_two_controllers])
def test_elsewhere_one_sentence_comes_first(
    supervised: Path, begin: Callable[[Path], None]
) -> None:
    with pytest.raises(VsenseError) as told:
        begin(supervised)
    first, use, *others = str(told.value).splitlines()
    assert "use the class of a controller" in first and "`vsense sim` only" in first
    line = next(
        number
        for number, text in enumerate((HERE / "supervisor.cpp").read_text().splitlines(), 1)
        if "GetController()" in text
    )
    assert use == f"{supervised.with_name('supervisor.cpp')}:{line}: GetController():"
    assert any("undefined reference to `typeinfo for CCounter'" in words for words in others)
    assert len(others) <= SHOWN_LINES
