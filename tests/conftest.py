"""What all tests share: arena states made by hand, and what happens where a tool is missing."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

import pytest
from hypothesis import settings

from vsense.base import clock
from vsense.base.arena import ArenaState
from vsense.base.errors import pip_line
from vsense.robots import boards, build

# What this machine's accounts share is none of the tests' business.
os.environ["VSENSE_LAB"] = ""

# A busy machine is no defect: no property has to hold within a wall-clock time. Half as many
# examples as usual, since all are drawn anew in each run.
settings.register_profile("vsense", deadline=None, max_examples=50)
settings.load_profile("vsense")


ALONE = (
    *("tests/faults/", "tests/monitor/ui/test_lab_page.py"),
    *(f"tests/system/test_{name}.py" for name in ("attacked_lab", "flooded_lab", "lab")),
)
"""Tests that need the machine for themselves: whole labs that keep or measure times. Those marked
`quick` end before anything keeps time, those marked `paced` measure none."""


PACED = (
    *("tests/board/", "tests/gige/"),
    *(f"tests/robots/test_{name}.py" for name in ("bases", "daemon", "faults", "hangs")),
    *(f"tests/robots/test_{name}.py" for name in ("hard_faults", "stops")),
    "tests/system/",
)
"""Tests of one board, daemon or run, or of four cameras, in real time: with their like, and with
those of `PATIENT`."""


LONG = (
    *("tests/packaging/", "tests/tools/camera_setup/test_fake_camera.py"),
    *(f"tests/robots/test_{name}.py" for name in ("argos_controllers", "building", "arm", "cxx")),
    *("tests/robots/test_c_suite.py", "tests/modes/sim/test_cluster.py"),
    *(f"tests/monitor/ui/test_{name}.py" for name in ("page", "server")),
    *(f"tests/system/test_{name}.py" for name in ("every_option", "first_day", "series")),
)
"""Files of a few long tests: they begin first, so that no worker is left alone with one."""


PATIENT = (
    *("tests/fuzz/", "tests/kernels/test_c_suite.py"),
    *(f"tests/robots/test_{name}.py" for name in ("argos_controllers", "controller_rules", "cxx")),
    *(f"tests/run/test_cxx_{name}.py" for name in ("controllers", "loop")),
    *(f"tests/studies/series/test_{name}.py" for name in ("campaign", "compare", "optimize")),
)
"""Files that compile and calculate, and wait for nobody: they have the processor time that those of
`PACED` leave, which wait for their robots for much of theirs."""


TRIES_AGAIN = 2
"""Of a failed test that keeps real time, but beside other workers: those `scripts/test` tries again
with the machine for themselves. It names each: one that fails in different runs is no accident."""


OPT_IN = "campaign"
"""Tests with this marker take minutes: they run where `-m campaign` asks for them."""


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leaves out, unread, the files that have no test of the one part that is asked for."""
    part = config.option.markexpr
    if part not in ("alone", "paced", "patient") or collection_path.suffix != ".py":
        return None
    place = collection_path.relative_to(config.rootpath).as_posix()
    files = PATIENT if part == "patient" else ALONE + PACED
    if place.startswith(files) or f"mark.{part}" in collection_path.read_text():
        return None
    return True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Puts the tests of `LONG` first, marks those of the other lists, leaves out `OPT_IN`."""
    if OPT_IN not in config.option.markexpr:
        left_out = [item for item in items if item.get_closest_marker(OPT_IN)]
        items[:] = [item for item in items if not item.get_closest_marker(OPT_IN)]
        config.hook.pytest_deselected(items=left_out)
    items.sort(key=lambda item: not item.nodeid.startswith(LONG))
    for item in items:
        spared = any(map(item.get_closest_marker, ("quick", "paced")))
        if item.nodeid.startswith(ALONE) and not spared:
            item.add_marker("alone")
        elif item.nodeid.startswith(PACED) and item.get_closest_marker("quick") is None:
            item.add_marker("paced")
        elif item.nodeid.startswith(PATIENT):
            item.add_marker("patient")
        keeps_time = item.get_closest_marker("alone") or item.get_closest_marker("paced")
        if keeps_time and "PYTEST_XDIST_WORKER" not in os.environ:
            item.add_marker(pytest.mark.flaky(reruns=TRIES_AGAIN, reruns_delay=2))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Leaves what was skipped or tried again in the file that `scripts/test` shows at its end."""
    is_worker = hasattr(terminalreporter.config, "workerinput")  # its skips reach the first process
    if is_worker or "VSENSE_SKIPPED" not in os.environ:
        return
    with open(os.environ["VSENSE_SKIPPED"], "a") as file:
        for report in terminalreporter.stats.get("skipped", []):
            _, _, reason = report.longrepr
            place = report.nodeid.partition("::")[0]
            file.write(f"skipped {place}: {reason.removeprefix('Skipped: ')}\n")
        options, kinds = terminalreporter.config.option, ["rerun"]
        if options.markexpr == "paced" and options.dist != "no":
            kinds += ["failed", "error"]
        for report in (report for kind in kinds for report in terminalreporter.stats.get(kind, [])):
            file.write(f"tried again {report.nodeid}\n")


def shared_folder(name: str, factory: pytest.TempPathFactory) -> Path:
    """A folder that all workers of this session have in common."""
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    folder.mkdir(exist_ok=True)
    return folder


USERS = build.cache_directory()


def share_parts(cache: Path) -> None:
    """Has a cache use the user's of what all programs share: a C library takes half a minute."""
    (cache / "vsense").mkdir(parents=True, exist_ok=True)
    for name in ("parts", "zig"):
        (USERS / name).mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):  # of this session's other workers, or files
            (cache / "vsense" / name).symlink_to(USERS / name)


def pytest_runtest_setup() -> None:
    # A test that ran a lab with a pace in this process has left its clock slower.
    clock.slow(1000)


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of builds of the test's own: `$XDG_CACHE_HOME`."""
    cache = tmp_path / "cache"
    share_parts(cache)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    return cache


@pytest.fixture(scope="module")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of builds that all workers of this session have in common: `$XDG_CACHE_HOME`.

    `VSENSE_TEST_BUILDS` names one for several sessions of the same sources.
    """
    named = os.environ.get("VSENSE_TEST_BUILDS")
    cache = Path(named) if named else shared_folder("builds", tmp_path_factory)
    share_parts(cache)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(cache))
        yield cache


def require_tool(name: str, package: str) -> str:
    """Gives the tool's path, or skips the test (under CI: fails it), naming the Debian package."""
    path = shutil.which(name)
    if path is None:
        lack(f"needs {name}: apt install {package}")
    return path


def require_library(name: str, package: str) -> None:
    """Skips the test (under CI: fails it) where a shared library is not there."""
    try:
        ctypes.CDLL(name)
    except OSError:
        lack(f"needs {name}: apt install {package}")


def require_zig() -> None:
    """Skips the test (under CI: fails it) where the pinned cross compiler is not installed."""
    if importlib.util.find_spec("ziglang") is None:
        lack(f"needs ziglang: {pip_line('ziglang')}")


def require_own_network() -> None:
    """Skips the test (under CI: fails it) where nobody may make a network of one's own."""
    unshare = require_tool("unshare", "util-linux")
    allowed = subprocess.run([unshare, "--net", "--mount", "true"], capture_output=True, text=True)
    if allowed.returncode != 0 or not os.access("/dev/net/tun", os.R_OK | os.W_OK):
        lack(f"no network namespaces or no /dev/net/tun here: {allowed.stderr.strip()}")


def machine_up_for(uptime_s: int) -> tuple[str, ...]:
    """What a program begins with whose machine was started so long ago, or less if this one was.

    Skips the test (under CI: fails it) where nobody may make a time namespace.
    """
    unshare = require_tool("unshare", "util-linux")
    # The raw clock is shifted by as much as the one that NTP slews: neither may go below 0.
    monotonic_s = min(map(time.clock_gettime, (time.CLOCK_MONOTONIC, time.CLOCK_MONOTONIC_RAW)))
    shifts = {"--monotonic": monotonic_s, "--boottime": time.clock_gettime(time.CLOCK_BOOTTIME)}
    command = [unshare, "--time", "--fork", "--kill-child"]
    for option, now_s in shifts.items():
        command += [option, str(min(0, uptime_s - int(now_s)))]
    allowed = subprocess.run([*command, "true"], capture_output=True, text=True)
    if allowed.returncode != 0:
        lack(f"no time namespaces here ({unshare} --time): {allowed.stderr.strip()}")
    return tuple(command)


def lack(text: str) -> NoReturn:
    """Skips the test; under CI, where everything is there, fails it."""
    if os.environ.get("CI"):
        pytest.fail(text)
    pytest.skip(text)


@pytest.fixture(scope="session")
def arm_daemon(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of `vsensed` for ARMv5 with the pollutant controller, as `vsense robot build` makes it.

    The compiler's own cache stays the user's: its C library takes a minute to build.
    """
    require_zig()
    made = tmp_path_factory.mktemp("arm") / "vsensed"
    return boards.build("pollutant", "epuck", made).path


Place = tuple[float, float, float]
States = Callable[..., ArenaState]


@pytest.fixture(scope="session")
def state() -> States:
    """Makes an arena state: `places` by tag, all seen now but those in `lost`."""

    from tests.world.sensors.scenes import arena_state  # with the world, which few tests need

    return arena_state
