"""The benchmark's definition: its files are those that its digests name, and stay so."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from vsense.base.errors import VsenseError
from vsense.studies.benchmark import _definition
from vsense.studies.benchmark._definition import OtherDefinition
from vsense.studies.series import _plan as plans
from vsense.studies.series._parts import PlanLoader

VERSION_1 = "47fb3c976f071db2010bfaa5f2ad6a673a1169e753c81c2781ab7791462d40ef"
"""Results that were made are of this one. A file that it names (an experiment's loop functions, a
controller) changes only where its missions stay the same in every bit, which a test of
`tests/system/test_made_before.py` holds; its digest is then added to `_definition.LATER`."""


def files_of(known: _definition.Definition) -> dict[str, Path]:
    found = {known.plan().name: known.plan(), known.plan(quick=True).name: known.plan(quick=True)}
    for quick in (False, True):
        plan = plans.read(known.plan(quick), "sim")
        for planned in PlanLoader(plan).load_all().values():
            found |= {path.name: path for path in planned.files}
    return found


def test_version_1_is_what_it_was() -> None:
    known = _definition.load()
    assert known.sha256 == hashlib.sha256(known.file.read_bytes()).hexdigest() == VERSION_1
    files = files_of(known)
    digests = {n: hashlib.sha256(p.read_bytes()).hexdigest() for n, p in files.items()}
    assert set(digests) == set(known.digests)
    later = {name for name in digests if digests[name] != known.digests[name]}
    assert later == set(_definition.LATER)
    known.require(files.values())


def test_its_missions_are_those_of_its_plan() -> None:
    known = _definition.load()
    plan = plans.read(known.plan(), "sim")
    names = [mission.name for mission in known.missions]
    wanted = {name + blind for name in names for blind in ("", _definition.BLIND)}
    assert {condition.name for condition in plan.conditions} == wanted
    assert all(c.blind is c.name.endswith(_definition.BLIND) for c in plan.conditions)
    for planned in PlanLoader(plan).load_all().values():
        assert len(planned.experiment.robots) == known.robots


def test_another_file_is_named(tmp_path: Path) -> None:
    known = _definition.load()
    files = files_of(known)
    other = tmp_path / "foraging.c"
    other.write_bytes(files["foraging.c"].read_bytes() + b"\n")
    with pytest.raises(OtherDefinition, match=r"not the definition's: foraging\.c;"):
        known.require((files | {"foraging.c": other}).values())


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"missions": [{}], "name": "x"}'])
def test_what_is_no_definition_is_told(tmp_path: Path, text: str) -> None:
    shutil.copytree(_definition.NEWEST, tmp_path / "v1")
    (tmp_path / "v1" / _definition.DEFINITION_FILE).write_text(text)
    with pytest.raises(VsenseError, match="is no definition of a benchmark"):
        _definition.load(tmp_path / "v1")
    assert json.loads(_definition.load().file.read_text())["name"] == "vsense-benchmark 1"
