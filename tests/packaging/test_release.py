"""The files of a release: built by `scripts/release build`, checked with the index's own tools, and
used as a new user would, in environments of their own with the sources gone.

`VSENSE_DIST` names a folder that holds them already. Minutes: only with `-m campaign`.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.conftest import lack
from tests.packaging.conftest import (
    ROOT,
    clean_environment,
    copy_of_sources,
    pins,
    requirements,
    run,
)

pytestmark = pytest.mark.campaign

INSTALL = ("-m", "pip", "--python")
"""Installs into another environment, with the pip of this one."""

TAG = "cp310-abi3-manylinux_2_28"
PLUGINS = ("pytest-rerunfailures", "pytest-xdist")
AT_BOUNDS = (
    "tests/wire",
    "tests/config/test_roster.py",
    "tests/commands/test_completion.py",
    "tests/monitor/recording/test_round_trip.py",
    "tests/monitor/recording/test_damage.py",
    "tests/monitor/ui/test_server.py",
    "tests/monitor/ui/test_https.py",
    "tests/monitor/ui/test_foxglove_server.py",
    "tests/studies/report",
    "tests/vision/markers",
)
"""Tests that go through every dependency."""

MACHINES = ("x86_64", "aarch64")


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with sdist and wheels."""
    if "VSENSE_DIST" in os.environ:
        return Path(os.environ["VSENSE_DIST"])
    made = tmp_path_factory.mktemp("dist")
    run(ROOT / "scripts/release", "build", made)
    return made


def wheel_for(dist: Path, machine: str) -> Path:
    (wheel,) = dist.glob(f"*-{TAG}_{machine}.whl")
    return wheel


def environment_of(interpreter: str, folder: Path) -> Path:
    """Makes an environment; gives its Python."""
    run(interpreter, "-m", "venv", "--without-pip", folder)
    return folder / "bin" / "python"


def program(name: str) -> Path:
    """A program of the extra `release`, beside this Python."""
    path = Path(sys.executable).with_name(name)
    if not path.is_file():
        lack(f"needs {name}: pip install '.[release]'")
    return path


def test_an_index_would_take_them(dist: Path) -> None:
    files = sorted(path for path in dist.iterdir() if path.suffix != ".json")
    assert [path.suffix for path in files] == [".whl", ".whl", ".gz"]
    run(program("twine"), "check", "--strict", *files)
    run(program("check-wheel-contents"), *dist.glob("*.whl"))


@pytest.mark.parametrize("machine", MACHINES)
def test_the_wheel_runs_on_the_systems_that_its_name_says(dist: Path, machine: str) -> None:
    wheel = wheel_for(dist, machine)
    told = run(program("auditwheel"), "show", wheel).stdout
    oldest = re.search(rf'"manylinux_2_([0-9]+)_{machine}"', told)
    assert oldest and int(oldest[1]) <= 28, told
    run(program("abi3audit"), "--strict", "--assume-minimum-abi3", "3.10", wheel)


@pytest.mark.parametrize("machine", MACHINES)
def test_the_wheel_is_small_and_its_daemon_static(dist: Path, machine: str, tmp_path: Path) -> None:
    wheel = wheel_for(dist, machine)
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    libraries = sorted((tmp_path / "vsense").glob("_*.so"))
    assert len(libraries) == 2
    assert sum(path.stat().st_size for path in libraries) < 500_000, "without debug information"
    assert wheel.stat().st_size < 2_000_000
    daemon = tmp_path / "vsense/_sources/bin/vsensed"
    head = daemon.read_bytes()
    assert int.from_bytes(head[18:20], "little") == {"x86_64": 62, "aarch64": 183}[machine]
    assert b"/lib" not in head[:4096] and b"ld-linux" not in head, "no loader: it is static"
    metadata = next(tmp_path.glob("*.dist-info/METADATA")).read_text(encoding="utf-8")
    assert "License-Expression: MIT" in metadata and not re.search(r"\]\((?!https:)", metadata)


@pytest.mark.parametrize("minor", range(10, 15))
def test_from_the_wheel_everything_is_possible(dist: Path, minor: int, tmp_path: Path) -> None:
    """As a new user, in an empty folder, with the sources out of reach."""
    interpreter = shutil.which(f"python3.{minor}")
    # Of what pyenv does not offer here there is a name, too, that runs nothing.
    if interpreter is None or subprocess.run([interpreter, "-c", ""], check=False).returncode != 0:
        pytest.skip(f"python3.{minor} is not installed")
    python = environment_of(interpreter, tmp_path / "venv")
    wheel = wheel_for(dist, platform.machine())
    run(sys.executable, *INSTALL, python, "install", "--no-compile", f"{wheel}[record]")
    environment = clean_environment(tmp_path / "cache", CC="no-compiler")
    vsense, here = python.with_name("vsense"), tmp_path / "empty"
    here.mkdir()
    command = ["lab", "pollutant", "--robots", "2", "--duration", "3", "--port", "0", "--json"]
    summary = json.loads(run(vsense, *command, cwd=here, env=environment).stdout)
    assert summary["robots"] == 2
    assert summary["timesteps"] + summary["left_out_timesteps"] == 30 and summary["timesteps"] > 15
    assert not (tmp_path / "cache").exists(), "the wheel carries the host's daemon ready made"

    del environment["CC"]

    def told(*words: object) -> str:
        return run(vsense, *words, cwd=here, env=environment).stdout

    assert "controller.h" in told("docs")
    assert told("docs", "--path", "sensors").startswith(str(tmp_path / "venv"))
    told("new", "mine", "--sensor")
    argos = "mine/mine.argos"
    measures = json.loads(told("sim", argos, "--duration", "10", "--json"))["measures"]
    assert "robots_on_spot" in measures
    lab = ("--duration", "3", "--port", "0", "--record", "--json")
    assert json.loads(told("lab", argos, "--robots", "3", *lab))["robots"] == 3
    told("robot", "build", "--experiment", argos, "--target", "host", "-o", "vsensed")
    assert "vsensed" in run(here / "vsensed", "--version").stdout
    recording = str(next(here.rglob("*.mcap")))
    told("export", recording, "-o", "tables")
    # What an extra needs is installed by the words that say that it is missing.
    missing = subprocess.run(
        [vsense, "lab", "pollutant", "--web", "0", "--duration", "1"],
        cwd=here, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert missing.returncode == 2 and f"{python} -m pip install 'aiohttp" in missing.stderr
    assert ROOT.as_posix() not in missing.stderr


def test_every_command_of_every_page_runs_from_the_wheel(dist: Path, tmp_path: Path) -> None:
    """Each page's in a folder of its own, which has only what the page takes for granted."""
    python = environment_of(sys.executable, tmp_path / "venv")
    wheel = f"{wheel_for(dist, platform.machine())}[all]"
    run(sys.executable, *INSTALL, python, "install", "--no-compile", wheel)
    environment = clean_environment(tmp_path / "cache", VSENSE_PROGRAMS=str(python.parent))
    pages = ("-m", "pytest", "-m", "campaign", "tests/site/test_blocks.py")
    done = run(sys.executable, *pages, cwd=ROOT, env=environment)
    assert " passed" in done.stdout and "skipped" not in done.stdout


def test_the_sdist_builds_and_tests_itself(dist: Path, tmp_path: Path) -> None:
    (packed,) = dist.glob("*.tar.gz")
    with tarfile.open(packed) as archive:
        archive.extractall(tmp_path, filter="data")
    (tree,) = tmp_path.iterdir()
    environment = clean_environment(tmp_path / "cache", PYTHON=sys.executable)
    some = (
        "tests/test_house.py",
        "tests/packaging/test_contents.py",
        "tests/wire",
        "tests/tools/shipped",
    )
    done = run(tree / "scripts/test", *some, cwd=tree, env=environment)
    assert " passed" in done.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("docs",), "build/docs/html/index.html\n"),
        (("bench", "robot", "--json"), '"steps"'),
    ],
    ids=["docs", "bench"],
)
def test_scripts_work_in_a_fresh_clone(words: tuple[str, ...], says: str, tmp_path: Path) -> None:
    tree = copy_of_sources(tmp_path / "tree")
    environment = clean_environment(tmp_path / "cache", PYTHON=sys.executable)
    name, *arguments = words
    done = run(tree / "scripts" / name, *arguments, cwd=tmp_path, env=environment)
    assert says in done.stdout
    assert importlib.util.find_spec("pytest") and not list(tree.glob(".venv/lib/*/*/pytest"))


def test_its_bill_of_materials_is_valid_and_has_every_file(dist: Path) -> None:
    """By the schema that CycloneDX publishes, as its own library carries it."""
    validation = pytest.importorskip("cyclonedx.validation.json", reason="needs the extra release")
    schema = importlib.import_module("cyclonedx.schema").SchemaVersion
    (bill,) = dist.glob("*.cdx.json")
    content = json.loads(bill.read_text())
    version = schema.from_version(content["specVersion"])
    assert validation.JsonStrictValidator(version).validate_str(bill.read_text()) is None
    assert content["metadata"]["component"]["name"] == "vsense"
    parts = {(part["name"], part["version"]): part for part in content["components"]}
    assert {(part.name, str(part.specifier)[2:]) for part in pins()} == set(parts)
    assert all(part["externalReferences"][0]["hashes"] for part in parts.values())


def test_it_works_at_exactly_its_lower_bounds(tmp_path: Path) -> None:
    python = environment_of(sys.executable, tmp_path / "venv")
    tree = copy_of_sources(tmp_path / "tree")
    exactly = [str(needed).replace(">=", "==") for needed in requirements()]
    install = (*INSTALL, python, "install", "--no-compile")
    run(sys.executable, *install, "--editable", tree, *exactly, "pytest", "hypothesis", *PLUGINS)
    environment = clean_environment(tmp_path / "cache")
    done = run(python, "-m", "pytest", "-n2", *AT_BOUNDS, cwd=tree, env=environment)
    assert " passed" in done.stdout and " skipped" not in done.stdout, done.stdout[-500:]


def test_an_editable_install_uses_its_tree(tmp_path: Path) -> None:
    python = environment_of(sys.executable, tmp_path / "venv")
    tree = copy_of_sources(tmp_path / "tree")
    run(sys.executable, *INSTALL, python, "install", "--no-compile", "--editable", tree)
    vsense = python.with_name("vsense")
    environment = clean_environment(tmp_path / "cache")
    command = ["lab", "pollutant", "--robots", "1", "--duration", "1", "--port", "0", "--json"]
    lab = run(vsense, *command, cwd=tmp_path, env=environment)
    assert json.loads(lab.stdout)["robots"] == 1
    assert list((tmp_path / "cache").rglob("vsensed")), "the daemon is built from the tree"
    (tree / "vsense/base/errors.py").write_text("raise SystemExit(77)\n")
    edited = subprocess.run([vsense], cwd=tmp_path, env=environment)
    assert edited.returncode == 77, "an edit of the tree is an edit of what is installed"
