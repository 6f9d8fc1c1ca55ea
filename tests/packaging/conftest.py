"""What the packaging tests share: commands that must succeed, and a copy of the sources."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import tomlkit
from packaging.requirements import Requirement

from tests.rigs.places import ROOT

EXTRAS = (
    *("cluster", "completion", "foxglove", "https", "learn", "lua", "mocap", "nodes", "notebook"),
    *("optimize", "record", "report", "ros2", "rosbag", "tables", "thymio", "web"),
)
"""All that users can ask for but the compiler, which is pinned."""

_MADE = ("__pycache__", "*.so", "*.egg-info", "build", "dist", "runs", "PKG-INFO", "setup.cfg")


def run(*command: object, **options: object) -> subprocess.CompletedProcess[str]:
    """Runs a command; what it says on standard error is the message where it fails."""
    result = subprocess.run(
        [str(word) for word in command],
        capture_output=True,
        text=True,
        timeout=900,
        **options,  # type: ignore[call-overload]
    )
    assert result.returncode == 0, f"{result.stdout[-1500:]}{result.stderr[-3000:]}"
    return result


def copy_of_sources(tree: Path) -> Path:
    """Copies what a fresh clone holds, or an unpacked sdist."""
    if not (ROOT / ".git").exists():
        ignored = shutil.ignore_patterns(*_MADE, ".venv", ".pytest_cache", ".hypothesis")
        return shutil.copytree(ROOT, tree, ignore=ignored)
    # Files that are not added yet count, too: a test that passes only after `git add` surprises.
    listed = run("git", "ls-files", "--cached", "--others", "--exclude-standard", cwd=ROOT).stdout
    for name in listed.split("\n"):
        if name and (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
    return tree


def requirements() -> list[Requirement]:
    """What vsense needs with all EXTRAS, as pyproject.toml says it."""
    with open(ROOT / "pyproject.toml") as file:
        project = tomlkit.load(file).unwrap()["project"]
    extras = project["optional-dependencies"]
    lines = [*project["dependencies"], *(line for extra in EXTRAS for line in extras[extra])]
    # Extras that take other extras bring nothing of their own with those.
    return [Requirement(line) for line in lines if not line.startswith("vsense[")]


def pins() -> list[Requirement]:
    """The lines of scripts/constraints.txt without their hashes."""
    text = (ROOT / "scripts/constraints.txt").read_text()
    lines = re.findall(r"^([^#\s].*?) \\$", text, re.M)
    return [Requirement(line) for line in lines]


def clean_environment(cache: Path, **variables: str) -> dict[str, str]:
    """Variables for a vsense that has nothing to do with this checkout."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), **variables}
    environment.pop("PYTHONPATH", None)
    return environment
