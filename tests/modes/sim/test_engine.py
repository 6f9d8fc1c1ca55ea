"""The seam for other machines, with executors of Python's own; and what a worker looks at before it
does a job."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vsense
from tests.modes.sim.conftest import task_of
from tests.rigs.processes import descendants
from vsense.base.errors import Interrupted, VsenseError
from vsense.base.interruption import Interruption
from vsense.cli import main
from vsense.modes.sim import engine, fingerprint
from vsense.modes.sim._worker import NotHere, settled
from vsense.modes.sim.engine import Engine, WorkPlace
from vsense.modes.sim.job import Job, JobOrigin, Setup
from vsense.modes.sim.outcome import Task


def nothing(workers: object) -> None:
    pass


def test_a_pool_of_processes_gives_the_same_rows(pollutant: Path, tmp_path: Path) -> None:
    here, there = tmp_path / "here.csv", tmp_path / "there.csv"
    arguments = ("--duration", "6", "--set", "sensor.noise=0,0.7", "--seeds", "3,1")
    assert main(["sim", "pollutant", *arguments, "-j", "2", "-o", str(here)]) == 0
    experiment, noises = vsense.load("pollutant", duration_s=6), {"sensor.noise": [0, 0.7]}
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        experiment.simulate_many((3, 1), noises, there, on=executor)
    assert here.read_bytes() == there.read_bytes()


def test_an_endless_loop_is_named_and_ended(write_experiment, monkeypatch) -> None:
    monkeypatch.setattr(engine, "HANG_MAX_S", 0.5)
    before = len(descendants())
    with ThreadPoolExecutor(1) as threads:
        asked = replace(task_of(write_experiment("plain"), "4"), label="seed 1")
        going = Engine("threads", threads).simulate([asked], Interruption(), nothing)
        words = r"seed 1: robot 31.*timestep 4 .* not return within 0\.5 s"
        with pytest.raises(VsenseError, match=words):
            list(going)
    assert len(descendants()) <= before + 1, "only the ps that asks"


def test_a_process_waits_for_its_next_job_and_not_for_ever(write_experiment, monkeypatch) -> None:
    path, before = write_experiment("plain"), len(descendants())

    def simulate(kept_s: float, *seeds: int) -> None:
        monkeypatch.setattr(engine, "IDLE_PROCESS_S", kept_s)
        with ThreadPoolExecutor(1) as threads:
            tasks = [task_of(path, "0", seed) for seed in seeds]
            found = list(Engine("threads", threads).simulate(tasks, Interruption(), nothing))
        assert [done.job.seed for done, _ in found] == list(seeds)

    simulate(600.0, 1, 2)
    (first,) = engine._free
    simulate(600.0, 3)
    assert [first] == list(engine._free)
    assert len(descendants()) == before + 1
    simulate(0.0, 4)
    while len(descendants()) > before:
        time.sleep(0.02)
    assert not engine._free


class Promise:
    """What an engine gives that is none of Python's own: no more than `PendingJob`."""

    def __init__(self, error: Exception | None = None) -> None:
        self.error, self.cancelled = error, False

    def done(self) -> bool:
        return self.error is not None

    def result(self) -> Any:
        assert self.error is not None
        raise self.error

    def cancel(self) -> None:
        self.cancelled = True


class Promises:
    """An engine that answers as it is told, and then never more."""

    def __init__(self, *errors: Exception) -> None:
        self.errors, self.given = list(errors), list[Promise]()

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Promise:
        if self.errors and isinstance(self.errors[0], ConnectionError):
            raise self.errors[0]
        self.given.append(Promise(self.errors.pop(0) if self.errors else None))
        return self.given[-1]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (CancelledError(), "it has dropped it: nothing answers there any more, or somebody has"),
        (ValueError("too bad"), "it gave it up: ValueError: too bad"),
        (ConnectionError("gone"), "it takes no jobs any more: ConnectionError: gone"),
    ],
)
def test_what_an_engine_cannot_do_is_told_with_the_run(
    write_experiment, error: Exception, words: str
) -> None:
    asked = replace(task_of(write_experiment("plain")), label="seed 1")
    promises = Promises(error)
    with pytest.raises(VsenseError) as caught:
        list(Engine("it", promises).simulate([asked, asked], Interruption(), nothing))
    assert str(caught.value).startswith(f"seed 1: {words}")
    assert [some.cancelled for some in promises.given[1:]] == [True] * len(promises.given[1:])


def test_jobs_that_nobody_waits_for_are_cancelled(write_experiment, monkeypatch) -> None:
    monkeypatch.setattr(engine, "JOBS_AHEAD", 2)
    asked, promises, interrupted = task_of(write_experiment("plain")), Promises(), Interruption()
    going = Engine("it", promises).simulate([asked] * 3, interrupted, lambda _: interrupted.set())
    with pytest.raises(Interrupted):
        list(going)
    assert [some.cancelled for some in promises.given] == [True, True], "the third was not handed"


class Elsewhere(WorkPlace):
    """A worker whose engine has forgotten the job."""

    def is_wanted(self) -> bool:
        return False


def test_a_run_that_is_not_wanted_any_more_ends(write_experiment) -> None:
    before = len(descendants())
    line = task_of(write_experiment("plain"), "4").job.to_line().decode()
    answer = engine.do(line, fingerprint.of_machine(), Elsewhere())
    assert answer["refused"] == "nobody waits for it"
    assert len(descendants()) == before


def test_a_worker_of_another_kind_says_what_differs() -> None:
    here = dict(fingerprint.of_machine())
    assert fingerprint.difference(here) == ""
    for name in ("vsense", "Python", "NumPy", "OpenCV"):
        words = f"has {name} {here[name]}, expected 0.1"
        assert fingerprint.difference({**here, name: "0.1"}) == words
    differs = fingerprint.difference({**here, "sources": "cafe"})
    assert f"has other sources of vsense {here['vsense']} ({here['sources']}, expected c" in differs
    differs = fingerprint.difference({**here, "exp": "cafe", "C's sin": "cafe"})
    assert differs.startswith("computes other last digits (exp, C's sin): its processor or C lib")
    del here["tan"]
    assert "(tan)" in fingerprint.difference(here), "an older one does not know it"


def test_last_digits_are_those_of_the_functions() -> None:
    results = np.exp(np.linspace(-20.0, 20.0, 4096))
    digest = hashlib.sha256(results.tobytes()).hexdigest()
    assert digest.startswith(fingerprint.of_machine()["exp"])


def origin_of(path: Path, **changes: str) -> JobOrigin:
    """What travels with a job of the experiment at a path."""
    files = fingerprint.of_files(task_of(path))
    return JobOrigin("elsewhere", str(path.parent), None, {**files, **changes})


def test_a_job_finds_its_files_or_says_which_not(write_experiment, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_experiment("plain")
    faulty = path.with_name("faulty.c")
    origin = origin_of(path)
    assert {str(path), str(faulty)} <= origin.files.keys()
    job = Job(Setup(path.name, 1.0), 1, {}, origin=origin)
    found = settled(Job.from_line(job.to_line()))
    assert found.origin is None and [Path(p).name for p in found.libraries.values()] == [
        "inprocess.so"
    ]
    assert Path.cwd() == path.parent, "relative paths are the user's"
    same = "on every machine expected as it is on elsewhere: in a folder that they share, or copied"
    for changes, words in (
        ({"/none/at.all": "ab"}, "/none/at.all: cannot be read: No such file or directory"),
        ({str(faulty): "ab"}, f"{faulty}: is another one there"),
    ):
        with pytest.raises(NotHere) as caught:
            settled(replace(job, origin=origin_of(path, **changes)))
        assert str(caught.value) == f"{words}; {same}"


def test_what_runs_depend_on_has_no_file_of_ours() -> None:
    """They may lie elsewhere on each machine: their digest is vsense's own."""
    setup = Setup("foraging")
    experiment = setup.load()
    assert experiment.loop_functions is not None
    assert fingerprint.of_files(Task(Job(setup, 1, {}), experiment)) == {}


def test_python_that_is_imported_from_beside_counts(write_experiment, tmp_path: Path) -> None:
    """A campaign with another helper is another campaign."""
    path = tmp_path / "own.argos"
    loop = '</framework>\n  <loop_functions library="loop.py" label="loop" />'
    text = write_experiment("plain").read_text().replace("</framework>", loop)
    path.write_text(text.replace('library="faulty.c"', 'library="pollutant"'))
    (tmp_path / "loop.py").write_text(
        "import math, other.deep as deep\nfrom helper import A\nclass LoopFunctions: ...\n"
    )
    (tmp_path / "helper.py").write_text("A = 1\n")
    (tmp_path / "other").mkdir()
    for name in ("__init__", "deep", "far"):
        (tmp_path / "other" / f"{name}.py").touch()
    asked = task_of(path)
    for name in ("vsense", "math"):  # Python has its own before what lies beside
        (tmp_path / name).mkdir()
        (tmp_path / name / "far_away.py").touch()
    (tmp_path / "other" / "deep.py").write_text("import vsense.base.clock, top\n")
    (tmp_path / "top.py").touch()
    names = {Path(name).name for name in fingerprint.of_files(asked)}
    assert names == {
        "top.py",
        "own.argos",
        "loop.py",
        "helper.py",
        "__init__.py",
        "deep.py",
        "far.py",
    }
    before = fingerprint.of_campaign(asked)
    (tmp_path / "helper.py").write_text("A = 2\n")
    assert fingerprint.of_campaign(asked) != before
