"""Campaigns on other machines: schedulers and workers are real processes of this one.

Each worker has a cache of its own or shares one, as machines with and without a common home do.
"""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.conftest import lack
from tests.rigs.compiling import counting_compiler
from tests.rigs.places import ROOT
from tests.rigs.processes import descendants
from vsense import __version__
from vsense.base.errors import pip_line
from vsense.cli import main
from vsense.commands import sim
from vsense.modes.sim import engine

SHORT = ("--duration", "6")


def require_dask() -> None:
    if importlib.util.find_spec("distributed") is None:
        lack(f"needs dask: {pip_line('distributed')}")


class Program(subprocess.Popen[bytes]):
    """A program of Dask's, from a line of its log on; `word` is the line's last one."""

    def __init__(self, words: Sequence[str], until: str, **environment: str) -> None:
        descriptor, name = tempfile.mkstemp()
        self._log = Path(name)
        everything = {**os.environ, **environment}
        super().__init__([sys.executable, "-m", *words], stderr=descriptor, env=everything)
        os.close(descriptor)
        wait_for(lambda: self.poll() is not None or self._told(until) != "")
        self.word = self._told(until).split()[-1]

    def _told(self, words: str) -> str:
        return next((line for line in self._log.read_text().splitlines() if words in line), "")

    def end(self) -> None:
        self.kill()
        self.wait()
        self._log.unlink()


def scheduler() -> Program:
    """Starts a scheduler, which gives a run up with whom its second worker dies."""
    require_dask()
    words = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    allowed = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
    return Program([*words, "--no-dashboard"], "Scheduler at:", **allowed)


def worker(address: str, **environment: str) -> Program:
    words = ["distributed.cli.dask_worker", address, "--no-nanny", "--no-dashboard"]
    return Program([*words, "--nthreads", "1"], "Registered to:", **environment)


def wait_for(reached: Callable[[], bool]) -> None:
    while not reached():
        time.sleep(0.02)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    started = scheduler()
    yield started.word
    started.end()


@pytest.fixture
def workers(address: str) -> Iterator[Callable[..., list[Program]]]:
    """Starts workers, together; each has variables of its own."""
    with ExitStack() as stack:

        def start(*environments: dict[str, str]) -> list[Program]:
            with ThreadPoolExecutor(len(environments)) as threads:
                going = [threads.submit(worker, address, **some) for some in environments]
            started = [some.result() for some in going]
            for some in started:
                stack.callback(some.end)
            return started

        yield start


def started_campaign(*arguments: str | Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "vsense", "sim", *map(str, arguments)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def rows(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


def test_a_killed_worker_costs_no_row_and_changes_none(
    address: str, workers, pollutant: Path, tmp_path: Path
) -> None:
    """Two campaigns at once; one goes on from rows of this machine. Both workers share a cache, in
    which each controller is compiled once."""
    whole, new, old = (tmp_path / f"{name}.csv" for name in ("whole", "new", "old"))
    swept = ("pollutant", *SHORT, "--runs", "5", "--set", "sensor.noise=0,0.7")
    assert main(["sim", *swept, "-j", "2", "-o", str(whole)]) == 0
    old.write_bytes(b"".join(whole.read_bytes().splitlines(keepends=True)[:4]))
    compiler, notes = counting_compiler(tmp_path)
    shared = {"CC": str(compiler), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    killed, _ = workers(shared, shared)
    going = [started_campaign(*swept, "--on", address, "-o", path) for path in (new, old)]
    wait_for(lambda: rows(new) >= 2 and rows(old) >= 5)
    assert min(rows(new), rows(old)) < 11, "it is killed in the middle"
    killed.kill()
    said = [some.communicate()[1] for some in going]
    assert [some.returncode for some in going] == [0, 0], said
    assert "workers: 2, runs at the same time: 2" in said[0]
    assert "3 of 10 runs; it goes on from there" in said[1]
    assert new.read_bytes() == old.read_bytes() == whole.read_bytes()
    assert notes.read_text() == "\n"


def test_comparisons_and_searches_have_their_runs_done(
    address: str, workers, tmp_path: Path
) -> None:
    workers({})
    for words in (("compare", "foraging"), ("optimize", "--vary", "foraging.release=0..1")):
        paths = [tmp_path / f"{words[0]}{n}.csv" for n in (1, 2)]
        how = ("--minimize", "items_home", "--robots", "2", "--duration", "2")
        how += ("--trials", "2", "--runs", "1") if words[0] == "optimize" else ("--pairs", "8")
        for path, where in zip(paths, (("-j", "1"), ("--on", address))):
            assert main([words[0], "foraging", *words[1:], *how, *where, "-o", str(path)]) == 0
        assert paths[0].read_bytes() == paths[1].read_bytes()


PLAN = """
mode = "sim"
experiment = "foraging"
duration_s = 1
settings = { "foraging.release" = 0.5 }
[robots]
count = 2
[[condition]]
name = "sighted"
[[condition]]
name = "blind"
blind = true
[[start]]
name = "drawn"
seed = 7
[[start]]
name = "written"
poses = [[0.4, 0.4, 0], [-0.4, -0.4, 90]]
"""


def test_a_series_is_the_same_on_a_cluster(address: str, workers, tmp_path: Path, capsys) -> None:
    workers({}, {})
    plan, here, there = (tmp_path / name for name in ("plan.toml", "here", "there"))
    plan.write_text(PLAN)
    assert main(["series", str(plan), "-o", str(here)]) == 0
    assert main(["series", str(plan), "--on", address, "-o", str(there)]) == 0
    assert "workers: 2, runs at the same time: 2" in capsys.readouterr().err
    assert (there / "runs.csv").read_bytes() == (here / "runs.csv").read_bytes()
    for words in (("--record",), ("-j", "2"), ("--mode", "lab")):
        assert main(["series", str(plan), "--on", address, "-o", str(tmp_path / "x"), *words]) == 2
    assert not (tmp_path / "x").exists()


def test_who_crashes_is_named_and_a_run_that_kills_its_workers_is_given_up(
    address: str, workers, write_experiment, tmp_path: Path, capsys
) -> None:
    workers({}, {})
    experiment = str(write_experiment("plain"))
    said = []
    for where in (["-j", "1"], ["--on", address]):
        faults = ["--set", "wanderer.fault=0,1", "--duration", "1", "--runs", "1", *where]
        path = tmp_path / f"{len(said)}.csv"
        assert main(["sim", experiment, *faults, "-o", str(path)]) == 1
        said.append(capsys.readouterr().err.splitlines()[-1])
    assert "wanderer.fault=1, seed 1: robot 31, in timestep 4" in said[0]
    assert said[0] == said[1]
    faults = ["--set", "wanderer.fault=7", "--duration", "1", "--runs", "1", "--on", address]
    assert main(["sim", experiment, *faults, "-o", str(tmp_path / "killed.csv")]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"wanderer.fault=7, seed 1: the Dask cluster {address} gave it up: KilledWorker" in last
    assert "2 different workers" in last


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_who_ends_a_campaign_leaves_nothing_running(
    address: str, workers, write_experiment, tmp_path: Path, number: signal.Signals
) -> None:
    (started,) = workers({})
    faults = ("--set", "wanderer.fault=4", "--duration", "1", "--runs", "3", "--on", address)
    going = started_campaign(write_experiment("plain"), *faults, "-o", tmp_path / "r.csv")
    wait_for(lambda: len(descendants(started.pid)) >= 2)
    going.send_signal(number)
    said = going.communicate()[1]
    if number == signal.SIGKILL:
        assert going.returncode == -number
    else:
        assert going.returncode == 128 + number
        assert "0 of 3 runs; the same command goes on from there" in said
    assert "Traceback" not in said
    wait_for(lambda: not descendants(started.pid))


def test_a_scheduler_that_dies_is_told_and_takes_its_runs_along(
    write_experiment, tmp_path: Path
) -> None:
    lost = scheduler()
    address = lost.word
    started = worker(address)
    faults = ("--set", "wanderer.fault=4", "--duration", "1", "--runs", "3", "--on", address)
    going = started_campaign(write_experiment("plain"), *faults, "-o", tmp_path / "r.csv")
    wait_for(lambda: len(descendants(started.pid)) >= 2)
    behind = descendants(started.pid)
    lost.end()
    said = going.communicate()[1].splitlines()[-1]
    assert going.returncode == 1
    assert said.startswith(f"vsense: wanderer.fault=4, seed 1: the Dask cluster {address} has drop")
    started.wait()
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in behind))


def test_workers_that_would_give_other_results_are_named_before_anything_runs(
    address: str, workers, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, code in (
        ("none", "import sys\nsys.modules['vsense'] = None\n"),
        ("older", "import vsense\nvsense.__version__ = '0.0.9'\n"),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "sitecustomize.py").write_text(code)
    workers(*({"PYTHONPATH": str(tmp_path / name)} for name in ("none", "older")))
    assert main(["sim", "pollutant", *SHORT, "--runs", "2", "--on", address]) == 1
    said = capsys.readouterr().err
    assert f"cannot load vsense {__version__}: ModuleNotFoundError" in said
    assert f"has vsense 0.0.9, expected {__version__}" in said
    assert said.count("worker tcp://127.0.0.1:") == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["none", "older"]


def test_a_worker_without_a_compiler_is_named(
    address: str, workers, pollutant: Path, tmp_path: Path, capsys
) -> None:
    workers({"CC": "/nowhere/cc", "XDG_CACHE_HOME": str(tmp_path / "cache")})
    asked = ["--runs", "2", "--on", address, "-o", str(tmp_path / "r.csv")]
    assert main(["sim", "pollutant", *SHORT, *asked]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert "seed 1: worker tcp://127.0.0.1:" in last
    assert "no C compiler '/nowhere/cc'; install one with: " in last


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--runs", "2", "-j", "2"), "-j: with --on"),
        ((), "--on: a campaign only"),
    ],
)
def test_what_does_not_go_with_a_cluster_is_refused(
    tmp_path: Path, monkeypatch, capsys, arguments: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sim", "pollutant", "--on", "tcp://127.0.0.1:1", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "text",
    [
        *("scheduler", "scheduler:8786", "http://a:1", "tcp://a", "tcp://a:0", "tcp://a:65536"),
        *("tcp://:8786", "tcp://a:8786/b", "tcp://::1:8786"),
    ],
)
def test_no_address_of_a_scheduler(text: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["sim", "pollutant", "--runs", "2", "--on", text])
    assert ended.value.code == 2
    words = f"'{text}': expected the address of a Dask scheduler, such as tcp://"
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("text", ["tcp://a:1", "tls://a.b-c.de:65535", "tcp://[fe80::1%eth0]:8786"])
def test_addresses_of_schedulers(text: str) -> None:
    assert sim.scheduler(text) == text


@pytest.mark.parametrize("what", ["Timed out", "silence for 0.3 s"])
def test_a_scheduler_that_is_not_there_is_told_before_anything_runs(
    tmp_path: Path, monkeypatch, capsys, what: str
) -> None:
    """Nobody listens, or somebody who says nothing."""
    require_dask()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(engine, "SCHEDULER_TIMEOUT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        if what == "Timed out":
            silent.close()
        assert main(["sim", "pollutant", "--runs", "2", "--on", f"tcp://127.0.0.1:{port}"]) == 1
    said = capsys.readouterr().err
    assert f"--on tcp://127.0.0.1:{port}: no Dask scheduler answers there: {what}" in said
    assert list(tmp_path.iterdir()) == []


def test_without_dask_nothing_is_begun(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert main(["sim", "pollutant", "--runs", "2", "--on", "tcp://127.0.0.1:1"]) == 2
    words = (
        r"--on needs the Python package distributed: .*pip install 'dask\[distributed\]>=[0-9.]+'"
    )
    assert re.search(words, capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("module", ["vsense.commands.sim", "vsense.modes.sim._worker"])
def test_a_simulation_loads_no_cluster_no_page_and_nothing_that_draws(module: str) -> None:
    words = f"import sys, {module}\nprint(*{{n.partition('.')[0] for n in sys.modules}})"
    ran = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert "numpy" in ran.stdout.split()
    others = {"dask", "distributed", "tornado", "cv2", "matplotlib", "ssl", "aiohttp"}
    assert not others & set(ran.stdout.split())
