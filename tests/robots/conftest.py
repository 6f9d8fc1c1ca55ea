"""The daemon, built once under strict flags, and rigs that are closed after the test."""

from __future__ import annotations

import fcntl
import hashlib
import os
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import require_tool
from tests.rigs import compiling
from tests.rigs.places import ROOT
from tests.robots.rig import TABLE, Rig
from tests.robots.rosters import FAKE_DAEMON, SSH, write_program
from vsense.robots.compiling import HELPERS, HOST_FLAGS, native
from vsense.robots.link.table import Direction, Entry, Table

STRICT = ["-std=c99", "-D_POSIX_C_SOURCE=200809L", *compiling.STRICT]
STRICT += ["-I", str(ROOT / "c_src"), "-I", str(ROOT / "robot")]
DROPS = Table([*TABLE.entries, Entry(11, "drops", "u4", Direction.ACTUATOR)])
"""What the controller of `probe.c` knows."""

FLAGS = [*STRICT, *HOST_FLAGS, *compiling.SANITIZE]
QUICKLY = ("-O0", "-fno-sanitize=all")
"""For daemons whose C is not what is tested."""


@pytest.fixture
def natively(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has boards' daemons compiled as labs' are, whose parts are there already."""
    monkeypatch.setattr("vsense.robots.boards.toolchain", lambda target, cache: native())


class Builder:
    """Builds daemons under the sanitizers; what they have in common is compiled once.

    Workers and runs share it: each of them would need most of the objects.
    """

    def __init__(self, folder: Path) -> None:
        """Compiles nothing yet; the objects go to a folder, and are used until a source changes."""
        self._folder = folder
        folders = [ROOT / name for name in ("c_src", "robot", "firmware_bridge", "tests/c")]
        self._changed_s = max(p.stat().st_mtime for f in folders for p in f.rglob("*.[ch]"))

    def __call__(
        self,
        target: Path,
        controller: Path,
        *more: str,
        instead: Mapping[str, Path] | None = None,
    ) -> Path:
        """Builds `vsensed` with a controller.

        Args:
            target: the program.
            controller: its source.
            more: arguments for the compiler.
            instead: sources to be taken in place of the shipped ones of these names.
        """
        left_out = instead or {}
        shipped = [*ROOT.glob("c_src/*.c"), *ROOT.glob("robot/*.c")]
        flags = [*FLAGS, *(word for word in more if not word.startswith("-Wl,"))]
        objects = self.objects([p for p in shipped if p.name not in left_out], flags)
        begun = target.with_suffix(".o")
        compiling.compiled(begun, *flags, *HELPERS, "-c", controller)
        compiling.compiled(target, *FLAGS, *left_out.values(), begun, *objects, "-lm", *more)
        return target

    def objects(self, sources: Sequence[Path], flags: Sequence[str] = FLAGS) -> list[Path]:
        """Gives the sources compiled with these flags, by all processors where need be."""
        folder = self._folder / hashlib.sha256(" ".join(flags).encode()).hexdigest()[:8]
        folder.mkdir(parents=True, exist_ok=True)
        made = [folder / f"{source.stem}.o" for source in sources]
        with open(folder / "lock", "w") as lock, ThreadPool() as pool:
            fcntl.flock(lock, fcntl.LOCK_EX)
            old = [o for o in made if not o.exists() or o.stat().st_mtime <= self._changed_s]
            missing = [(source, o, flags) for source, o in zip(sources, made) if o in old]
            pool.starmap(_compile, missing)
        return made


def _compile(source: Path, target: Path, flags: Sequence[str]) -> None:
    # A compiler that was broken off must not leave what looks like an object.
    begun = target.with_suffix(".new")
    compiling.compiled(begun, *flags, "-c", source)
    begun.rename(target)


@pytest.fixture(scope="session")
def build(pytestconfig: pytest.Config) -> Builder:
    """Builds daemons with controllers: see `Builder`."""
    return Builder(pytestconfig.cache.mkdir("objects"))


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory, build: Builder) -> Path:
    """Path of `vsensed` with the pollutant controller."""
    target = tmp_path_factory.mktemp("daemon") / "vsensed"
    return build(target, ROOT / "robot" / "controllers" / "pollutant.c")


@pytest.fixture(scope="session")
def probe(tmp_path_factory: pytest.TempPathFactory, build: Builder) -> Path:
    """Path of `vsensed` with the controller of `probe.c` and the faults that it can make."""
    target = tmp_path_factory.mktemp("probe") / "vsensed"
    wraps = ("fork", "recv", "waitpid", "write", "clock_gettime")
    wrap = "-Wl," + ",".join(f"--wrap={name}" for name in wraps)
    return build(target, Path(__file__).parent / "probe.c", wrap)


@pytest.fixture(scope="session")
def talker(tmp_path_factory: pytest.TempPathFactory, build: Builder) -> Path:
    """Path of `vsensed` with the controller of `boards.c`."""
    target = tmp_path_factory.mktemp("talker") / "vsensed"
    return build(target, Path(__file__).parent / "boards.c", *QUICKLY)


@pytest.fixture
def rigs(program: Path) -> Iterator[Callable[..., Rig]]:
    """Makes rigs whose daemon gets more arguments."""
    made: list[Rig] = []

    def make(*more: str, **changes: Any) -> Rig:
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


@pytest.fixture
def probes(probe: Path) -> Iterator[Callable[..., Rig]]:
    """Makes running rigs whose controller is `probe.c`."""
    made: list[Rig] = []

    def make(*more: str, params: str = "") -> Rig:
        made.append(Rig(probe, *more))
        made[-1].host.params, made[-1].host.table = params, DROPS
        made[-1].start()
        made[-1].run()
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder with the boards; the daemon that is deployed is a stand-in, too."""
    require_tool("tar", "tar")
    folder = tmp_path / "boards"
    write_program(tmp_path / "path" / "ssh", SSH)
    write_program(folder / "bin" / "id", "echo 0")
    write_program(folder / "bin" / "systemctl", 'echo "$@" >>"$VSENSED_ROOT/systemctl"')
    write_program(folder / "bin" / "update-rc.d", 'echo "$@" >>"$VSENSED_ROOT/update-rc.d"')
    monkeypatch.setenv("BOARDS", str(folder))
    monkeypatch.setenv("PATH", f"{tmp_path / 'path'}:{os.environ['PATH']}")
    # A script may stand in for a program only where the first bytes are not looked at.
    monkeypatch.setattr("vsense.robots.boards.load", lambda binary: binary.read_bytes())
    write_program(tmp_path / "vsensed", FAKE_DAEMON)
    monkeypatch.chdir(tmp_path)
    yield folder
    # What was started on a board goes on when the test is over.
    for script in folder.glob("*/etc/init.d/vsensed"):
        board = script.parents[2]
        subprocess.run([script, "stop"], env={**os.environ, "VSENSED_ROOT": str(board)}, timeout=30)
