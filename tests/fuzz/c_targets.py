"""The libFuzzer targets of `targets/`: built with clang, run, and their corpora kept small.

Everything that is built lies in `build/fuzz/` of the repository. What a campaign finds of use stays
there, too, and the next one goes on with it; `minimise` brings the best of it into `corpus/`.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
BUILT = ROOT / "build" / "fuzz"
CLANG = "clang-19"
APT_LINE = "sudo apt install clang-19 libclang-rt-19-dev"

_FOLDERS = ("c_src", "c_src/host", "firmware_bridge", "robot")
_LEFT_OUT = {"main.c"}
FLAGS = ["-std=c11", "-g", "-O2", "-D_POSIX_C_SOURCE=200809L"]
FLAGS += [f"-I{ROOT / folder}" for folder in _FOLDERS]
_SANITIZE = "address,undefined"
STRICT = ["-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror"]
_FILES_MAX, _BYTES_MAX, _LONG_BYTES = 29, 19_000, 1500
"""Of a corpus in the tree, and of one file in it."""
_LONGEST_S, _MEMORY_MB = 2, 512
"""Of one execution, and of the whole process: AddressSanitizer alone takes some 200 MB."""
_STATISTIC = re.compile(rb"stat::number_of_executed_units:\s+(\d+)")
_COVERAGE = re.compile(rb"cov: (\d+)")


class BuildFailed(Exception):
    """The text is the compiler's, or says what is missing."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a campaign of one target came to; `findings` are files, or say how to repeat a case."""

    name: str
    executions: int
    seconds: float
    coverage: int | None
    findings: tuple[str, ...]


def names() -> list[str]:
    """All targets."""
    return sorted(path.stem for path in (HERE / "targets").glob("*.c"))


def build(targets: Sequence[str]) -> dict[str, Path]:
    """Builds targets; what has not changed since is not compiled again.

    Raises:
        BuildFailed: clang is missing, or refuses a file.
    """
    if not targets:
        return {}  # Python's need no compiler
    if shutil.which(CLANG) is None:
        raise BuildFailed(f"{CLANG} is missing; install it with: {APT_LINE}")
    folder = BUILT / _digest(_headers())
    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(2) as pool:
        objects = list(pool.map(lambda source: _compile(source, folder), sources()))
    archive = folder / f"shared-{_digest(objects)}.a"
    if not archive.exists():
        _run(["ar", "rcs", str(archive), *map(str, objects)])
    return {name: _link(name, archive, folder) for name in targets}


def sources() -> Iterator[Path]:
    """The C files that targets are linked with."""
    for name in _FOLDERS:
        yield from (p for p in sorted((ROOT / name).glob("*.c")) if p.name not in _LEFT_OUT)


def _headers() -> Iterator[Path]:
    for folder in (*(ROOT / name for name in _FOLDERS), ROOT / "tests" / "c", HERE / "targets"):
        yield from sorted(folder.glob("*.h"))


def _digest(paths: Iterable[Path]) -> str:
    found = hashlib.sha256(" ".join(FLAGS).encode())
    for path in paths:
        found.update(
            f"{path.name}\n".encode() + (path.read_bytes() if path.suffix != ".o" else b"")
        )
    return found.hexdigest()[:12]


def _compile(source: Path, folder: Path) -> Path:
    target = folder / f"{source.stem}-{_digest([source])}.o"
    if not target.exists():
        flags = [*FLAGS, f"-fsanitize=fuzzer-no-link,{_SANITIZE}", "-fno-sanitize-recover=all"]
        _make(target, [CLANG, *flags, "-c", str(source)])
    return target


def _link(name: str, archive: Path, folder: Path) -> Path:
    source = HERE / "targets" / f"{name}.c"
    life = ROOT / "tests" / "c" / "robot_life.c"
    target = folder / f"{name}-{_digest([source, archive, life])}"
    if not target.exists():
        flags = [*FLAGS, *STRICT, f"-fsanitize=fuzzer,{_SANITIZE}", "-fno-sanitize-recover=all"]
        _make(target, [CLANG, *flags, str(source), str(archive), "-lm"])
    return target


def _make(target: Path, command: list[str]) -> None:
    # A compiler that was broken off must not leave what looks like its work, and two may work
    # at once.
    begun = target.with_name(f"{target.name}.{os.getpid()}")
    _run([*command, "-o", str(begun)])
    begun.rename(target)


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BuildFailed(done.stderr)


def run(name: str, program: Path, seconds: float, runs: int | None, seed: int) -> Outcome:
    """Runs one target for so long, or so often; inputs that are of use are kept."""
    kept, found = BUILT / "work" / name, BUILT / "findings"
    for folder in (kept, found, HERE / "corpus" / name):
        folder.mkdir(parents=True, exist_ok=True)
    before = set(found.glob(f"{name}-*"))
    limit = f"-runs={runs}" if runs is not None else f"-max_total_time={max(1, round(seconds))}"
    options = [limit, f"-seed={seed}", "-print_final_stats=1", f"-artifact_prefix={found}/{name}-"]
    options += [f"-timeout={_LONGEST_S}", f"-rss_limit_mb={_MEMORY_MB}", "-reload=0"]
    command = [str(program), *options, str(kept), str(HERE / "corpus" / name)]
    log = BUILT / f"{name}.log"
    began_s = time.monotonic()
    with log.open("wb") as file:
        code = subprocess.run(command, stdout=file, stderr=file, check=False).returncode
    elapsed_s = time.monotonic() - began_s
    said = log.read_bytes()
    executed = _STATISTIC.findall(said)
    covered = _COVERAGE.findall(said)
    findings = tuple(str(path) for path in sorted(set(found.glob(f"{name}-*")) - before))
    if code != 0 and not findings:
        findings = (f"ended with {code}, see {log}",)
    count = int(executed[-1]) if executed else 0
    return Outcome(name, count, elapsed_s, int(covered[-1]) if covered else None, findings)


def minimise(name: str, program: Path) -> int:
    """Brings the inputs that cover all of what is covered into the tree; gives how many."""
    merged = BUILT / "merged" / name
    shutil.rmtree(merged, ignore_errors=True)
    merged.mkdir(parents=True)
    corpus = HERE / "corpus" / name
    corpus.mkdir(parents=True, exist_ok=True)
    sources = [str(corpus), str(BUILT / "work" / name)]
    _run([str(program), "-set_cover_merge=1", "-reload=0", str(merged), *sources])
    # A long input covers what many short ones do; one alone must not take all the room.
    sizes = {path: path.stat().st_size for path in merged.iterdir()}
    chosen = sorted((p for p in sizes if sizes[p] <= _LONG_BYTES), key=lambda p: -sizes[p])
    for path in corpus.iterdir():
        path.unlink()
    size = count = 0
    for path in chosen:
        size += sizes[path]
        if count == _FILES_MAX or size > _BYTES_MAX:
            break
        shutil.copyfile(path, corpus / path.name[:16])
        count += 1
    return count
