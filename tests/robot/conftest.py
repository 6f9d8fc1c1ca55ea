"""The daemon, built once under strict flags, and rigs that are closed after the test."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from tests.conftest import require_tool
from tests.robot.rig import Rig

ROOT = Path(__file__).parent.parent.parent
STRICT = ["-std=c99", "-D_POSIX_C_SOURCE=200809L", "-pedantic", "-Wall", "-Wextra", "-Wshadow"]
STRICT += ["-Wconversion", "-Werror", "-I", str(ROOT / "c_src"), "-I", str(ROOT / "robot")]


def build(
    target: Path, controller: Path, *more: str, instead: Mapping[str, Path] | None = None
) -> Path:
    """Builds `vsensed` with a controller, under the sanitizers.

    Args:
        target: the program.
        controller: its source.
        more: arguments for the compiler.
        instead: sources to be taken in place of the shipped ones of these names.
    """
    left_out = instead or {}
    shipped = [*ROOT.glob("c_src/*.c"), *ROOT.glob("robot/*.c")]
    sources = [path for path in shipped if path.name not in left_out]
    sources += [*left_out.values(), controller]
    command = [require_tool("cc", "build-essential"), *STRICT, "-DVS_NO_ATOMICS", "-O1", "-g"]
    command += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command += ["-o", str(target), *map(str, sources), "-lm", *more]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of `vsensed` with the pollutant controller."""
    target = tmp_path_factory.mktemp("daemon") / "vsensed"
    return build(target, ROOT / "robot" / "controllers" / "pollutant.c")


@pytest.fixture(scope="session")
def probe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of `vsensed` with the controller of `probe.c` and the faults that it can make."""
    target = tmp_path_factory.mktemp("probe") / "vsensed"
    wrap = "-Wl,--wrap=fork,--wrap=recv"
    return build(target, Path(__file__).parent / "probe.c", wrap)


@pytest.fixture
def rigs(program: Path) -> Iterator[Callable[..., Rig]]:
    """Makes rigs whose daemon gets more arguments."""
    made: list[Rig] = []

    def make(*more: str, **changes: str) -> Rig:
        made.append(Rig(program, *more, **changes))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def rig(rigs: Callable[..., Rig]) -> Rig:
    """A rig with a daemon that was just started."""
    one = rigs()
    one.start()
    return one
