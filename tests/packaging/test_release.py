"""sdist -> wheel -> install elsewhere, with the source tree gone, still runs the lab; so does an
editable install, from its tree."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
INSTALL = ("-m", "pip", "--python")
"""Installs into another environment, with the pip of this one."""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment of its own; what vsense depends on is fetched into it once."""
    venv = tmp_path_factory.mktemp("venv")
    run(sys.executable, "-m", "venv", "--without-pip", venv)
    return venv / "bin" / "python"


def run(*command: object, **options: object) -> subprocess.CompletedProcess[str]:
    result = subprocess.run(
        [str(word) for word in command],
        capture_output=True,
        text=True,
        timeout=300,
        **options,  # type: ignore[call-overload]
    )
    assert result.returncode == 0, result.stderr[-3000:]
    return result


def copy_of_sources(tree: Path) -> Path:
    """Copies what git tracks: what a fresh clone holds."""
    for name in run("git", "ls-files", cwd=ROOT).stdout.split("\n"):
        if name and (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
    return tree


@pytest.mark.system
def test_editable_install_uses_its_tree(python: Path, tmp_path: Path) -> None:
    tree = copy_of_sources(tmp_path / "tree")
    run(sys.executable, *INSTALL, python, "install", "--no-compile", "--editable", tree)
    vsense = python.with_name("vsense")
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("PYTHONPATH", None)
    command = ["lab", "pollutant", "--robots", "1", "--duration", "1", "--port", "0", "--json"]
    lab = run(vsense, *command, cwd=tmp_path, env=environment)
    assert json.loads(lab.stdout)["robots"] == 1
    assert list((tmp_path / "cache").rglob("vsensed")), "the daemon is built from the tree"
    where = (
        "from vsense import native; from vsense.robot import build;"
        " print(native.lib, build.source_tree().root)"
    )
    assert str(tree) in run(python, "-c", where, cwd=tmp_path, env=environment).stdout
    (tree / "vsense/errors.py").write_text("raise SystemExit(77)\n")
    edited = subprocess.run([vsense], cwd=tmp_path, env=environment)
    assert edited.returncode == 77, "an edit of the tree is an edit of what is installed"


@pytest.mark.system
def test_wheel_from_sdist_runs_the_lab_without_its_sources(python: Path, tmp_path: Path) -> None:
    tree = copy_of_sources(tmp_path / "tree")
    run(sys.executable, "-m", "build", "--sdist", "--outdir", tmp_path, tree)
    shutil.rmtree(tree)
    (sdist,) = tmp_path.glob("*.tar.gz")
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", tmp_path, sdist)
    (wheel,) = tmp_path.glob("*.whl")
    assert "-abi3-" in wheel.name
    carried = zipfile.ZipFile(wheel).namelist()
    assert "vsense/_sources/c_src/vs_session.c" in carried
    assert not [name for name in carried if "/host/" in name], "no robot runs the kernels"

    run(sys.executable, *INSTALL, python, "uninstall", "--yes", "vsense")
    run(sys.executable, *INSTALL, python, "install", "--no-compile", wheel)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    environment = {**os.environ, "CC": "no-compiler", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("PYTHONPATH", None)
    command = ["lab", "pollutant", "--robots", "2", "--duration", "3", "--port", "0", "--json"]
    lab = run(python.with_name("vsense"), *command, cwd=elsewhere, env=environment)
    summary = json.loads(lab.stdout)
    assert summary["robots"] == 2
    assert summary["timesteps"] + summary["left_out_timesteps"] == 30 and summary["timesteps"] > 15
    assert not (tmp_path / "cache").exists(), "the wheel carries the host's daemon ready made"
