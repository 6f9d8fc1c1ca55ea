"""What this machine has and lacks: compilers, libraries, ports, sockets, the clock, permissions.

A check looks and changes nothing. What is lacking is told with what it is for and, where one line
mends it, that line.
"""

from __future__ import annotations

import ctypes
import glob
import importlib.util
import os
import platform
import shutil
import stat
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from vsense import __version__
from vsense.base import sharing
from vsense.base.errors import EXTRAS, VsenseError, pip_line
from vsense.base.terminal import aligned
from vsense.robots import boards, build, key_holders
from vsense.robots.compiling import APT_LINE, BuildError, native
from vsense.robots.link import keys, network, strangers
from vsense.robots.sources import commit
from vsense.vision.cameras import aravis
from vsense.vision.cameras.aravis import AravisError

OK, LACKS, BROKEN = "ok", "lacks", "BROKEN"
"""`LACKS`: something cannot be done. `BROKEN`: not even `vsense sim` and `vsense lab` can."""

ROBOTS_PORT, PAGE_PORT = 4050, 8080
"""Where robots and browsers connect to, unless the experiment or an option says otherwise."""

PICTURES_BYTES = 2 * 1620 * 1220
"""Two pictures of the thesis's cameras, which the sockets of GigE cameras should hold."""
_RMEM = Path("/proc/sys/net/core/rmem_max")

_PURPOSES = {
    "web": "the page (--web)",
    "https": "the page for other machines",
    "record": "recordings (--record, replay, report, export)",
    "report": "charts of reports and campaigns, tests of runs",
    "robot": "daemons for robots' boards (vsense robot build)",
    "cluster": "campaigns on several machines (--on)",
    "completion": "completion in a shell",
    "foxglove": "runs and replays in Foxglove (--foxglove)",
    "mocap": 'robots\' places from motion capture systems (<vs:tracker format="mocap">)',
    "lua": "controllers of ARGoS in Lua",
    "nodes": "cameras on several computers (vsense camera node)",
    "notebook": "runs that play in notebooks",
    "learn": "learning in simulation (vsense.parallel_env)",
    "optimize": "searches for the best settings (vsense optimize)",
    "ros2": "robots with ROS 2 (exec:ros2), and poses for it (--ros2)",
    "rosbag": "bags of ROS 2 (vsense export --rosbag)",
    "tables": "runs as data frames (to_pandas), tables as Parquet (export --parquet)",
    "thymio": "the driver of Thymios (exec:thymio)",
}

_TIME_ERROR = 5
"""What adjtimex() returns of a clock that nobody sets. Source: Linux, adjtimex(2)."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: what it is.
        state: `OK`, `LACKS` or `BROKEN`.
        text: what there is, or what cannot be done without it.
        mend: the command that mends it, "": none does, or nothing is to be mended.
    """

    name: str
    state: str
    text: str
    mend: str = ""


def table(all_findings: Sequence[Finding]) -> list[str]:
    """The findings as lines for people: what is needed, and apart from it what is optional."""
    rows = aligned([(finding.name, finding.text) for finding in all_findings])
    pairs = list(zip(rows, all_findings, strict=True))
    heads = {BROKEN: "needed, and not here:", OK: "here:", LACKS: "optional, and not here:"}
    lines = list[str]()
    for state, head in heads.items():
        own = [(row, finding.mend) for row, finding in pairs if finding.state == state]
        lines += ["", head] if own else []
        for row, mend in own:
            lines += [f"  {row}", *([f"      {mend}"] if mend else [])]
    broken = sum(finding.state == BROKEN for finding in all_findings)
    works = "vsense cannot simulate here: see above" if broken else "vsense sim and vsense lab work"
    return [*lines, "", works]


def findings() -> Iterator[Finding]:
    """Looks at everything, in an order from what everybody needs to what few do."""
    checks: tuple[Callable[[], Iterator[Finding]], ...] = (
        *(_compilers, _cache, _extras, _cameras, _ports, _sockets),
        *(_descriptors, _clock, _lab, _keys, _disk),
    )
    for check in checks:
        yield from check()


def _compilers() -> Iterator[Finding]:
    try:
        toolchain = native()
        yield Finding("C compiler", OK, shutil.which(toolchain.command[0]) or toolchain.command[0])
    except BuildError:
        yield Finding("C compiler", BROKEN, "no controller can be built: sim, lab", APT_LINE)
        return
    try:
        cxx = toolchain.for_cxx().command[0]
        yield Finding("C++ compiler", OK, shutil.which(cxx) or cxx)
    except BuildError:
        yield Finding("C++ compiler", LACKS, "no controllers for ARGoS", APT_LINE)


def _cache() -> Iterator[Finding]:
    folder = build.cache_directory()
    there = next(path for path in (folder, *folder.parents) if os.path.exists(path))
    if os.access(there, os.W_OK | os.X_OK):
        yield Finding("cache", OK, str(folder))
        return
    mend = f"sudo chown -R $USER {there}"
    yield Finding("cache", BROKEN, f"{there} cannot be written: nothing can be built", mend)


def _extras() -> Iterator[Finding]:
    packages: dict[str, list[str]] = {}
    for package, extra in EXTRAS.items():
        packages.setdefault(extra, []).append(package)
    for extra, wanted in sorted(packages.items()):
        missing = [name for name in wanted if importlib.util.find_spec(name) is None]
        purpose = _PURPOSES[extra]
        if extra == "robot" and shutil.which(boards.TARGETS["epuck"].debian[0]) is not None:
            missing = []
        if not missing:
            yield Finding(f"extra {extra}", OK, purpose)
        else:
            yield Finding(f"extra {extra}", LACKS, f"needed for {purpose}", pip_line(missing[0]))


def _cameras() -> Iterator[Finding]:
    try:
        aravis.load()
        yield Finding("Aravis", OK, "GigE Vision and USB3 Vision cameras")
    except AravisError:
        mend = f"sudo apt install {aravis.ARAVIS_PACKAGE}"
        yield Finding("Aravis", LACKS, "no GigE Vision and USB3 Vision cameras", mend)
    devices = sorted(glob.glob("/dev/video*"))
    closed = [name for name in devices if not os.access(name, os.R_OK | os.W_OK)]
    if closed:
        text = f"{', '.join(closed)} cannot be opened"
        yield Finding("V4L2", LACKS, text, "sudo adduser $USER video   # and log in again")
    elif devices:
        yield Finding("V4L2", OK, ", ".join(devices))


def _ports() -> Iterator[Finding]:
    try:
        robots = network.bind("127.0.0.1", ROBOTS_PORT)
        robots.tcp.close()
        robots.udp.close()
        yield Finding("robots' port", OK, f"{ROBOTS_PORT}, TCP and UDP")
    except VsenseError as error:
        yield Finding("robots' port", LACKS, str(error), "vsense control status   # or --port 0")
    try:
        network.listen("127.0.0.1", PAGE_PORT)[0].close()
        yield Finding("page's port", OK, str(PAGE_PORT))
    except VsenseError as error:
        yield Finding("page's port", LACKS, str(error), "--web 0   # takes a free one")


def _sockets() -> Iterator[Finding]:
    try:
        room = int(_RMEM.read_text())
    except (OSError, ValueError):
        return
    if room >= PICTURES_BYTES:
        yield Finding("socket buffers", OK, f"net.core.rmem_max {room} bytes")
        return
    text = f"net.core.rmem_max {room} bytes: GigE cameras' pictures come damaged (two are more)"
    yield Finding("socket buffers", LACKS, text, "sudo sysctl -w net.core.rmem_max=33554432")


def _descriptors() -> Iterator[Finding]:
    shortage = strangers.shortage()
    if shortage:
        yield Finding("open files", LACKS, shortage)


def _clock() -> Iterator[Finding]:
    try:
        # `struct timex` has 208 bytes where long has 8; all zeros: only ask.
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(512))
    except (OSError, AttributeError):
        return
    if state == _TIME_ERROR:
        text = "nobody sets it: times in recordings of several machines do not agree"
        yield Finding("clock", LACKS, text, "sudo timedatectl set-ntp true")
    elif state >= 0:
        yield Finding("clock", OK, "is kept right")


def _lab() -> Iterator[Finding]:
    try:
        folder = sharing.lab()
    except sharing.SharingError as error:
        text, _, mend = str(error).partition(": sudo ")
        yield Finding("lab folder", LACKS, text, f"sudo {mend}" if mend else "")
        return
    if folder is None:
        yield Finding("lab folder", OK, "none: each account has runs of its own (vsense share)")
        return
    names = ", ".join(sharing.members(folder.gid)) or "nobody"
    yield Finding("lab folder", OK, f"{folder.path}, group '{folder.group}': {names}")
    for path in sorted(folder.path.iterdir()):
        try:
            status = path.lstat()
        except OSError:
            continue  # a run has just ended
        if stat.S_ISDIR(status.st_mode):
            continue
        if status.st_mode & 0o007:
            text = f"others can use {path} (mode {stat.S_IMODE(status.st_mode):04o})"
            yield Finding("lab folder", LACKS, text, f"sudo chmod o= {path}")
        if status.st_gid != folder.gid:
            text = f"{path} is of group '{sharing.group_name(status.st_gid)}'"
            yield Finding("lab folder", LACKS, text, f"sudo chgrp {folder.group} {path}")


def _keys() -> Iterator[Finding]:
    try:
        path = keys.default_path()
        swarm_keys = keys.read(path) if os.path.exists(path) else None
    except sharing.SharingError:
        return  # told above
    except VsenseError as error:
        text, _, mend = str(error).partition(": chmod ")
        yield Finding("swarm key", LACKS, text, f"chmod {mend}" if mend else "")
        return
    if swarm_keys is None:
        mend = "vsense robot keys --new-key"
        yield Finding("swarm key", LACKS, "vsense run takes no robot without --insecure", mend)
        return
    yield Finding("swarm key", OK, str(path))
    for note in key_holders.trust(key_holders.file_of(path), swarm_keys).notes:
        yield Finding("swarm key", LACKS, note)


def _disk() -> Iterator[Finding]:
    free = shutil.disk_usage(".").free
    minutes = free / 1.3e9
    text = f"{free / 1e9:.0f} GB free here: {minutes:.0f} minutes of four cameras (--record-images)"
    yield Finding("disk", OK if minutes >= 10 else LACKS, text)


UNKNOWN = "?"
_OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless")
"""Packages that bring OpenCV; with several of them in one environment the last one installed is
there."""


def versions() -> dict[str, str]:
    """Gives versions by the name of what has them, vsense first."""
    revision = commit()
    return {
        "vsense": f"{__version__} ({revision})" if revision else __version__,
        "Python": platform.python_version(),
        "NumPy": _package("numpy"),
        "OpenCV": _package(*_OPENCV),
    }


def _package(*names: str) -> str:
    """The version of the first of some packages that is there."""
    for name in names:
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return UNKNOWN
