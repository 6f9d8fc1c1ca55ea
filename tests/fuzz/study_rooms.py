"""Rooms of what studies leave behind and share: packages, series' folders, benchmarks' results."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import struct
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random

from tests.fuzz import mutate
from tests.rigs.places import DATA
from vsense.base.errors import VsenseError
from vsense.config.experiment import load
from vsense.modes import origin
from vsense.modes.sim.job import Setup
from vsense.run.runs_csv import RunsFile, read_runs
from vsense.studies.benchmark import _comparing, _definition, _evidence
from vsense.studies.packages._archive import MANIFEST, Package, manifest_of
from vsense.studies.packages._contents import CONTENTS, MOST_CONTENTS, PackageContents
from vsense.studies.packages._gathering import gather
from vsense.studies.report.study._collect import read_tables
from vsense.studies.series import _folder, _plan
from vsense.vision.calibration import checked
from vsense.vision.cameras.camera import Camera

MADE = DATA / "made-by-0.1"


@dataclass(frozen=True, slots=True)
class PackageScene:
    """A package's files, and where changed packages are written."""

    folder: Path
    files: Mapping[str, bytes]


def prepare_package(folder: Path) -> PackageScene:
    """A package of two simulated runs, but its recordings."""
    with zipfile.ZipFile(MADE / "kept.zip") as archive:
        names = [name for name in archive.namelist() if not name.endswith(".mcap")]
        return PackageScene(folder, {name: archive.read(name) for name in names})


def package(random: Random, scene: PackageScene) -> None:
    """A package is opened, verified, read and unpacked: into its folder, and nowhere else."""
    files = dict(scene.files)
    del files[MANIFEST]
    kind = random.randrange(4)
    contents = json.loads(files[CONTENTS])
    if kind < 2:
        files[CONTENTS] = mutate.as_json(random, contents).encode("utf-8", "surrogatepass")
    elif kind == 2:
        name = random.choice([*files])
        new = mutate.text(random, name).encode("utf-8", "replace").decode()
        files[new] = files.pop(name)
    sums = manifest_of({name: hashlib.sha256(data).hexdigest() for name, data in files.items()})
    if random.random() < 0.2:
        sums = mutate.text(random, sums.decode(errors="replace")).encode("utf-8", "replace")
    path, target = scene.folder / "changed.zip", scene.folder / "unpacked" / "here"
    data = _zipped(random, {**files, MANIFEST: sums})
    path.write_bytes(mutate.raw(random, data) if kind == 3 or random.random() < 0.1 else data)
    before = set(scene.folder.iterdir())
    try:
        with Package(path) as opened:
            opened.verify()
            opened.unpack(target)
            PackageContents.read(opened.read(CONTENTS, MOST_CONTENTS), opened.names)
        origin.read(path)
    finally:
        inside = [*target.parent.iterdir()] if target.parent.exists() else []
        shutil.rmtree(target.parent, ignore_errors=True)
        assert inside in ([], [target])
        assert {*scene.folder.iterdir()} - before <= {target.parent}


def _zipped(random: Random, files: Mapping[str, bytes]) -> bytes:
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            with suppress(ValueError, struct.error):  # zipfile cannot write such a name
                info = zipfile.ZipInfo(name)
                if random.random() < 0.02:
                    info.external_attr = random.choice((0o120777, 0o040755, 0o060644)) << 16
                archive.writestr(info, data)
    return written.getvalue()


@dataclass(frozen=True, slots=True)
class StudyScene:
    """A folder of a series, a benchmark and cameras, and what its files have at first."""

    folder: Path
    files: Mapping[str, bytes]
    plan: _plan.SeriesPlan


def prepare_study(folder: Path) -> StudyScene:
    """What a simulated series, a lab's run and a benchmark left behind, but recordings."""
    for place in ("mine/kept-sim", "benchmark", "lab-run"):
        for path in (MADE / place).iterdir():
            if path.is_file() and path.suffix in (".csv", ".json", ".zip"):
                target = folder / Path(place).name / path.name
                target.parent.mkdir(exist_ok=True)
                shutil.copy(path, target)
    view = Camera.looking_down("left", 0.0, 0.0, 2.0, 800.0, (640, 480))
    (folder / "left.json").write_text(view.to_json())
    check = folder / checked.CAMERA_CHECK_FILE
    check.parent.mkdir()
    said = {"when": "2026-11-23", "points": 9, "rms_mm": 1.5, "worst_mm": 3.0, "shape_rms_mm": 1.0}
    check.write_text(json.dumps({**said, "cameras": {"left": checked.digest(view)}}))
    result = folder / "benchmark" / "benchmark.json"
    facts = {**json.loads(result.read_text()), "quick": False}
    # As if this vsense had made it: only then it is compared.
    facts["definition_sha256"] = _definition.load().sha256
    result.write_text(json.dumps(facts))
    shutil.copytree(MADE / "mine", folder / "mine", ignore=shutil.ignore_patterns("kept-sim"))
    files = {name: (folder / name).read_bytes() for name in _READ}
    return StudyScene(folder, files, _plan.read(folder / "mine" / "plan.toml"))


def _series(scene: StudyScene, path: Path) -> None:
    gather([path.parent])
    _folder.allowed_changes(scene.plan, path.parent)


def _runs(scene: StudyScene, path: Path) -> None:
    for row in read_runs(path):
        RunsFile(scene.folder / "written.csv").append(row)
    (scene.folder / "written.csv").unlink(missing_ok=True)
    read_tables([path])
    gather([path.parent])


def _table(scene: StudyScene, path: Path) -> None:
    read_tables([path])


def _benchmark(scene: StudyScene, path: Path) -> None:
    whole = scene.folder / "whole.json"
    whole.write_bytes(scene.files["benchmark/benchmark.json"])
    compared = _comparing.compare([path, whole], independent=False, tests=False)
    assert json.dumps(compared.as_json()) and [*compared.lines()]


def _summary(scene: StudyScene, path: Path) -> None:
    runs = path.with_name("runs.csv")
    runs.unlink(missing_ok=True)
    with suppress(VsenseError):
        _evidence._summary(path)
    gather([path.parent])


def _origin(scene: StudyScene, path: Path) -> None:
    experiments = [load(scene.folder / "mine" / "mine.argos")]
    origin.is_of(origin.read(path), experiments, Setup("mine.argos"))
    gather([path.parent])


def _check(scene: StudyScene, path: Path) -> None:
    file = scene.folder / "left.json"
    known = checked.of_session({"left": (Camera.from_json(file.read_text()), file)})
    assert json.dumps(known, allow_nan=False)


_READ: Mapping[str, Callable[[StudyScene, Path], None]] = {
    "kept-sim/series.json": _series,
    "kept-sim/runs.csv": _runs,
    "benchmark/runs.csv": _table,
    "benchmark/benchmark.json": _benchmark,
    "lab-run/summary.json": _summary,
    "kept-sim/made.zip": _origin,
    str(checked.CAMERA_CHECK_FILE): _check,
}


def study(random: Random, scene: StudyScene) -> None:
    """One file of a study has changed, and everything that reads it does."""
    name = random.choice([*_READ])
    path, data = scene.folder / name, scene.files[name]
    if random.random() < 0.1:
        changed = mutate.raw(random, data)
    elif path.suffix == ".json":
        changed = mutate.as_json(random, json.loads(data)).encode("utf-8", "surrogatepass")
    elif path.suffix == ".zip":
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            files = {inner: archive.read(inner) for inner in archive.namelist()}
        facts = mutate.as_json(random, json.loads(files[origin.FACTS]))
        files[origin.FACTS] = facts.encode("utf-8", "surrogatepass")
        changed = _zipped(random, files)
    else:
        changed = mutate.text(random, data.decode()).encode("utf-8", "surrogatepass")
    path.write_bytes(changed)
    try:
        _READ[name](scene, path)
    finally:
        path.write_bytes(data)
