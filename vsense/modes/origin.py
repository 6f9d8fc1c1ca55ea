"""What runs were made from, kept beside what they leave: `made.zip`.

It has the files of users that results depend on, as they were when the runs began, and how the
experiment was read, so that a package can be made years later. A folder may have several: number n
of `made-n.zip` is how many rows its runs.csv had when something in it had changed.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
import re
import stat
import subprocess
import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.base.files import MOST_FILE_BYTES, PACKAGE_FOLDER, read_bytes, replace_bytes
from vsense.config.specs import Experiment
from vsense.modes.sim import fingerprint
from vsense.modes.sim.job import Setup
from vsense.robots import finding
from vsense.robots.compiling import native
from vsense.robots.sources import HOSTED, commit, headers, source_roots

ARCHIVE_STEM = "made"
"""What the file's name begins with."""
FACTS = "made.json"
"""In it."""
ORIGIN_FORMAT = 1

PACKAGE_PREFIX = "vsense/"
"""What names of vsense's own files begin with."""

DATE = (1980, 1, 1, 0, 0, 0)
"""Of everything in a ZIP file of ours: the same contents give the same bytes."""
MOST_FILES = 100_000
"""In one of them."""

_SECRET = re.compile(rb"\A# Swarm keys of vsense|-----BEGIN [A-Z ]*PRIVATE KEY-----")
_SECRETS = (".key", ".pem")
MOST_FACTS_BYTES = 8 << 20
"""Of `FACTS`: room for twenty thousand conditions; read, empty lists take twenty times as much."""
_MOST_KEPT, _UNFOLDED_BYTES = 1 << 30, 128 << 20


@dataclass(frozen=True, slots=True)
class RunOrigin:
    """What some runs were made from.

    Attributes:
        mode: `sim`, `lab` or `run`.
        machine: versions, and all else that changes results; see `fingerprint.of_machine`.
        about: more of it, for people: system, compiler, Python.
        setups: of simulated runs, by `key_of`.
        files: bytes by name; names of vsense's own begin with `PACKAGE_PREFIX`.
        paths: where each file was, by name, absolute.
    """

    mode: str
    machine: Mapping[str, str]
    about: Mapping[str, str]
    setups: Mapping[str, Mapping[str, Any]]
    files: Mapping[str, bytes]
    paths: Mapping[str, str]

    @property
    def own(self) -> list[str]:
        """Names of the files that are vsense's own."""
        return [name for name in self.files if name.startswith(PACKAGE_PREFIX)]


def key_of(condition: str = "", start: str = "") -> str:
    """What the setup of a row is found by: its condition and its start, "" where all share it."""
    return json.dumps([condition, start])


def keep(
    folder: Path,
    mode: str,
    experiments: Iterable[Experiment],
    say: Callable[[str], None],
    setups: Mapping[str, Setup] | None = None,
    more_files: Iterable[str | Path] = (),
    stem: str = ARCHIVE_STEM,
    rows: int = 0,
) -> None:
    """Keeps what runs are about to be made from, where it is not what is kept already.

    Args:
        folder: of the runs; `stem`: the file's name there.
        mode: `sim`, `lab` or `run`.
        say: takes a line where it cannot be kept: no run shall end for it.
        setups: of simulated runs, by `key_of`.
        more_files: others that results depend on, such as a tracking session's; of XML files also
            those that they name.
        rows: of the table of runs, so far.
    """
    try:
        named, private = _named(list(experiments), map(Path, more_files))
        if private:
            say(f"vsense: not kept, as others may not read it: {', '.join(map(str, private))}")
        data = _packed(mode, named, setups or {})
        there = kept_in(folder, stem)
        if there and read_bytes(there[-1][1], _MOST_KEPT) == data:
            return
        name = f"{stem}-{rows}.zip" if there else f"{stem}.zip"
        replace_bytes(folder / name, data, _mode_of(named))
    except (OSError, VsenseError) as error:
        say(f"vsense: what the runs were made from is not kept: {error}")


def stem_beside(table: Path) -> str:
    """What the file's name begins with where it lies beside a campaign's table."""
    return f"{table.stem}-{ARCHIVE_STEM}"


def kept_in(folder: Path, stem: str = ARCHIVE_STEM) -> list[tuple[int, Path]]:
    """What a folder has kept: from which row on, and the file; in order."""
    archives = []
    with suppress(OSError):
        for path in folder.glob(f"{stem.replace('[', '[[]')}*.zip"):
            number = re.fullmatch(rf"{re.escape(stem)}(?:-(\d{{1,9}}))?\.zip", path.name)
            if number is not None:
                archives.append((int(number[1] or 0), path))
    return sorted(archives)


def kept_beside(table: Path) -> list[tuple[int, Path]]:
    """What a campaign has kept beside its table, likewise."""
    return kept_in(table.parent, stem_beside(table))


def read(path: Path) -> RunOrigin:
    """Reads what `keep` wrote; VsenseError if it is damaged."""
    try:
        data = read_bytes(path, _MOST_KEPT)
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            infos = archive.infolist()
            size, most = sum(info.file_size for info in infos), len(data) + _UNFOLDED_BYTES
            if size > most or archive.getinfo(FACTS).file_size > MOST_FACTS_BYTES:
                raise ValueError(f"unfolds to {size} bytes")
            facts = json.loads(archive.read(FACTS))
            files = {one.filename: archive.read(one) for one in infos if one.filename != FACTS}
        machine, about, setups = (dict(facts[name]) for name in ("machine", "about", "setups"))
        for setup in setups.values():
            dict(Setup.read(setup).settings)  # raises where it is none
        paths = {name: str(facts["paths"][name]) for name in files}
        return RunOrigin(str(facts["mode"]), machine, about, setups, files, paths)
    except OSError as error:
        raise VsenseError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # zipfile raises anything
        raise VsenseError(f"{path}: is damaged: {error!r}") from None


def is_of(kept: RunOrigin, experiments: Sequence[Experiment], setup: Setup) -> bool:
    """Whether runs were made of the files that experiments are made from now, and set up as
    `setup`, but for the values of its settings.

    Of vsense's own files only the names are compared.

    Raises:
        OSError: a file cannot be read.
    """
    named, _ = _named(experiments)
    users = {name for name in named if not name.startswith(PACKAGE_PREFIX)}
    shape = (setup.duration_s, setup.robots, setup.blind, [*setup.settings])
    # vsense 0.1 did not keep packages that Python imports, nor the second name of `import a, b`.
    known = users & kept.files.keys()
    return (
        kept.files.keys() <= named.keys()
        and all(name.endswith(".py") for name in users - known)
        and all(kept.files[name] == read_bytes(named[name]) for name in known)
        and all(
            shape == (one.duration_s, one.robots, one.blind, [*one.settings])
            for one in map(Setup.read, kept.setups.values())
        )
    )


def _used(experiment: Experiment) -> list[Path]:
    """The files that an experiment was read from, without the headers of its programs."""
    loop, floor = experiment.loop_functions, experiment.floor
    sources = [path for controller in experiment.controllers for path in controller.sources]
    sources += [] if loop is None or loop.program is None else loop.program.sources
    others = (loop and loop.path, floor and floor.path, experiment.casting.roster)
    return [experiment.path, *sources, *(Path(path) for path in others if path)]


def files_of(experiment: Experiment) -> list[Path]:
    """The files that an experiment is made from, as far as they can be found without a compiler;
    of vsense's own those that it names, no headers."""
    loop, used = experiment.loop_functions, _used(experiment)
    programs = [controller.program for controller in experiment.controllers]
    programs += [] if loop is None or loop.program is None else [loop.program]
    files = dict.fromkeys([*used, *_own_files(experiment.path, used)])
    files.update(dict.fromkeys([] if loop is None else _own_files(loop.path, used)))
    for program in programs:
        included = headers(program.sources, program.includes)
        files.update(dict.fromkeys(path for path in included if _own_name(path) is None))
    return list(files)


def _own_files(path: Path, used: Iterable[Path] = ()) -> list[Path]:
    """What a file names beside or below it, or in its repository, and modules that `used` ones may
    import: a stranger's file may name any of this account's."""
    folder = path.resolve().parent
    root = finding.root_of(folder) or folder
    places = [root, *(program.resolve().parent for program in used if program.suffix in HOSTED)]

    def is_own(file: Path) -> bool:
        own = places if file.suffix in HOSTED else [root]
        return any(map(file.resolve().is_relative_to, own)) or _own_name(file) is not None

    return list(filter(is_own, fingerprint.named_files(path)))


def about_machine() -> dict[str, str]:
    """What this machine is, for people; no names of anybody."""
    compiler = ""
    with suppress(VsenseError, OSError, subprocess.SubprocessError, IndexError):
        asked = [*native().command, "--version"]
        done = subprocess.run(asked, capture_output=True, text=True, timeout=5.0)
        compiler = done.stdout.splitlines()[0]
    return {
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "libc": " ".join(platform.libc_ver()),
        "compiler": compiler,
        "CXXFLAGS": os.environ.get("CXXFLAGS", ""),
        "Python": platform.python_version(),
        "commit": commit(),
    }


def _packed(mode: str, named: Mapping[str, Path], setups: Mapping[str, Setup]) -> bytes:
    facts = {
        "format": ORIGIN_FORMAT,
        "mode": mode,
        "machine": dict(fingerprint.of_machine()),
        "about": about_machine(),
        "setups": {key: _absolute(setup) for key, setup in setups.items()},
        "paths": {name: str(path) for name, path in named.items()},
    }
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        text = json.dumps(facts, indent=1, sort_keys=True)
        archive.writestr(zipfile.ZipInfo(FACTS, DATE), text, zipfile.ZIP_DEFLATED)
        for name in sorted(named):
            data = read_bytes(named[name])
            archive.writestr(zipfile.ZipInfo(name, DATE), data, zipfile.ZIP_DEFLATED)
    return target.getvalue()


def _mode_of(named: Mapping[str, Path]) -> int | None:
    """Who may read what has these files: nobody who may not read each; None: as the umask says."""
    mode = 0o644
    for path in named.values():
        mode &= path.stat().st_mode
    return None if mode == 0o644 else mode | 0o600


def _named(
    experiments: Sequence[Experiment], more_files: Iterable[Path] = ()
) -> tuple[dict[str, Path], list[Path]]:
    """The files to keep by their names in an archive, and those that are left out as private."""
    asked = [path for e in experiments for path in _used(e)] + list(more_files)
    candidates = dict.fromkeys([*asked, *(p for e in experiments for p in files_of(e))])
    for path in [path for path in candidates if path.suffix == ".xml"]:
        candidates.update(dict.fromkeys(_own_files(path)))
    # Where its folder truly is, under its own name: names in an experiment are beside that.
    paths = dict.fromkeys(Path(os.path.realpath(path.parent), path.name) for path in candidates)
    public, private = _public(paths, set(map(os.path.realpath, asked)))
    return _names(public), private


def _absolute(setup: Setup) -> dict[str, Any]:
    """A setup that does not depend on the present folder."""
    here, path = Path.cwd(), Path(setup.experiment)
    name = str(path.absolute()) if os.path.isfile(path) else setup.experiment
    return asdict(replace(setup, experiment=name, code=setup.code.absolute(here)))


def _public(paths: Iterable[Path], asked: Collection[str]) -> tuple[list[Path], list[Path]]:
    """Files but for those that hold secrets, cannot be read, or are no files to keep; and those
    that others may not read. Of those `asked` for by a person or the parser none is private."""
    files, private = [], []
    for path in list(paths)[:MOST_FILES]:
        with suppress(OSError):
            status = path.stat()
            if path.suffix in _SECRETS or status.st_size > MOST_FILE_BYTES:
                continue
            is_open = os.path.realpath(path) in asked or status.st_mode & stat.S_IROTH
            if not is_open and _own_name(path) is None:
                private.append(path)
            elif not _SECRET.search(read_bytes(path)):
                files.append(path)
    return files, private


def _names(paths: Iterable[Path]) -> dict[str, Path]:
    own = {path: name for path in paths if (name := _own_name(path)) is not None}
    users = [path for path in paths if path not in own]
    above = Path(os.path.commonpath([path.parent for path in users])) if users else Path("/")
    names = {name: path for path, name in own.items()}
    account = Path.home().name
    for path in users:
        parts = ("user" if part == account else part for part in path.relative_to(above).parts)
        names["/".join(("files", *parts))] = path
    return names


def _own_name(path: Path) -> str | None:
    """The name of a file that comes with vsense; None: it is a user's."""
    resolved = path.resolve()
    if resolved.is_relative_to(PACKAGE_FOLDER):
        below = resolved.relative_to(PACKAGE_FOLDER)
        if below.parts[:1] != ("_sources",):
            return f"{PACKAGE_PREFIX}{below.as_posix()}"
    for root in source_roots():
        for folder in ("robot", "c_src"):
            if resolved.is_relative_to(root / folder):
                return f"{PACKAGE_PREFIX}{resolved.relative_to(root).as_posix()}"
    return None


def digest(files: Mapping[str, bytes]) -> str:
    """A digest of files, for the name of the folder that has them."""
    hashed = hashlib.sha256()
    for name in sorted(files):
        hashed.update(name.encode() + b"\0" + hashlib.sha256(files[name]).digest())
    return hashed.hexdigest()[:8]
