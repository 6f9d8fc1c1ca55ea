"""The page about porting an ARGoS controller: what it shows is what there is, and compiles."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.conftest import require_tool
from tests.robots.conftest import ROOT, STRICT
from vsense.config import argos
from vsense.config.argos import MISSING
from vsense.config.devices import virtual_devices
from vsense.robots import build

PAGE = ROOT / "robot" / "README.md"
CONTROLLERS = ROOT / "robot" / "controllers"
PORT = CONTROLLERS / "epuck_obstacleavoidance.c"


def blocks(language: str) -> list[str]:
    """The page's blocks of code in a language."""
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)


def run(*command: str | Path, cwd: Path | None = None) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_page_shows_the_port_as_it_is() -> None:
    source = PORT.read_text()
    shown = blocks("c")
    assert len(shown) == 5
    for block in shown:
        assert block in source


@pytest.mark.parametrize("name", ["epuck_obstacleavoidance", "stand_still"])
def test_a_port_is_c_and_c_plus_plus(tmp_path: Path, name: str) -> None:
    source = CONTROLLERS / f"{name}.c"
    run(require_tool("cc", "build-essential"), *STRICT, "-c", source, "-o", tmp_path / "c.o")
    cpp = [require_tool("c++", "build-essential"), "-std=c++11", "-pedantic", "-Wall", "-Wextra"]
    cpp += ["-Werror", "-I", str(ROOT / "robot"), "-x", "c++"]
    run(*cpp, "-c", source, "-o", tmp_path / "cpp.o")
    nm = require_tool("nm", "binutils")
    for made in ("c.o", "cpp.o"):
        # Under its C name in both, or the daemon would not find it.
        assert re.search(r" [DR] vs_controller$", run(nm, tmp_path / made), re.M)


@pytest.mark.usefixtures("own_cache")
def test_the_pages_controller_in_c_plus_plus_builds(tmp_path: Path) -> None:
    require_tool("c++", "build-essential")
    (source,) = [block for block in blocks("cpp") if "#include" in block]
    (tmp_path / "mine.cpp").write_text(source)
    assert "controller mine " in run(build.daemon("mine.cpp", tmp_path), "--version")


def test_warnings_point_to_a_heading_of_the_page_and_to_devices_that_exist() -> None:
    file, _, heading = argos.PORTING_PAGE.partition(", ")
    assert ROOT / file == PAGE
    assert f"## {heading.strip(chr(39))}\n" in PAGE.read_text(encoding="utf-8")
    known = {name for names in virtual_devices().values() for name in names}
    missing = [words for section in MISSING.values() for words in section.values()]
    said = " ".join([*missing, PAGE.read_text(encoding="utf-8")])
    named = set(re.findall(r"<((?:virtual_|gps_)[a-z_]+)>", said))
    assert named - known == set()
    assert "virtual_range_and_bearing_sensor" in named
