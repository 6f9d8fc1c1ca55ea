"""Runs in their own processes: who crashes is named, who never returns too, and nobody is left."""

from __future__ import annotations

import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from tests.modes.sim.conftest import task_of
from tests.rigs.places import ROOT
from tests.rigs.processes import descendants
from vsense.base.errors import Interrupted
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import SimulatedRunError, Task, libraries_of
from vsense.modes.sim.watch import simulate_all

TIMESTEP = 4
"""The controller fails in its fifth control step."""


def results(*tasks: Task, processes: int = 1, limit_s: float = 10.0) -> list[dict[str, Any]]:
    going = simulate_all(tasks, processes, threading.Event(), lambda workers: None, limit_s)
    found = {id(done): result for done, result in going}
    return [found[id(task)] for task in tasks]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("1", r"was killed by SIGSEGV at faulty\.c:{SEGMENT}"),
        ("2", r"was killed by SIGFPE at faulty\.c:{DIVIDE}"),
        ("3", r"was killed by SIGABRT at faulty\.c:{ABORT}"),
        ("5", r"ended with exit code 7"),
    ],
)
def test_a_crash_is_named(write_experiment, fault: str, words: str) -> None:
    path = write_experiment("plain")
    lines = (path.parent / "faulty.c").read_text().splitlines()
    for name in ("SEGMENT", "DIVIDE", "ABORT"):
        line = next(n for n, text in enumerate(lines, 1) if text.startswith(f"    case {name}:"))
        words = words.replace(f"{{{name}}}", str(line))
    with pytest.raises(Exception) as caught:
        results(task_of(path, fault))
    assert re.fullmatch(
        rf"robot 31, in timestep {TIMESTEP} \(t = 0\.4 s\):"
        rf" its controller 'faulty\.c' {words}",
        str(caught.value),
    )


def test_a_run_that_has_failed_leaves_its_verdict(write_experiment, tmp_path: Path) -> None:
    path, words = write_experiment("plain"), ["-m", "vsense", "sim"]
    words += [str(path), "--duration", "1", "--set", "wanderer.fault=2", "--json"]
    words += ["-o", str(tmp_path / "out")]
    ran = subprocess.run([sys.executable, *words], capture_output=True, cwd=ROOT, text=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert ran.returncode == 1 and json.loads(ran.stdout) == summary
    assert (summary["verdict"], summary["ended"], summary["timesteps"]) == ("void", "failed", 4)
    assert re.fullmatch(
        r"failed in mid-run: robot 31, .* was killed by SIGFPE at faulty\.c:\d+", summary["why"]
    )
    assert summary["measures"] == {} and summary["speedup"] is None


def test_without_addr2line_it_is_said_what_is_missing(
    write_experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = task_of(write_experiment("plain"), "1")
    (tmp_path / "cc").symlink_to(str(shutil.which("cc")))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(Exception, match=r"SIGSEGV; with addr2line .* apt install binutils"):
        results(task)


def test_a_fault_while_a_library_is_loaded_is_named(write_experiment) -> None:
    """Static objects of C++ are made then."""
    path = write_experiment("plain", ('library="faulty.c"', 'library="born.c"'))
    born = "__attribute__((constructor)) static void birth(void)\n{\n    for (;;);\n}\n"
    source = (path.parent / "faulty.c").read_text()
    (path.parent / "born.c").write_text(source + born)
    setup = Setup(str(path), 1.0)
    experiment = setup.load()
    libraries = libraries_of(experiment)
    words = r"controller '\w+' \(born\.c\), when it was loaded, did not return within 0\.5 s"
    with pytest.raises(Exception, match=words):
        results(Task(Job(setup, 1, libraries), experiment), limit_s=0.5)


def test_an_endless_loop_is_named_and_ended(write_experiment) -> None:
    before = len(descendants())
    with pytest.raises(Exception, match=r"robot 31.*timestep 4 .* not return within 0\.5 s"):
        results(task_of(write_experiment("plain"), "4"), limit_s=0.5)
    assert len(descendants()) <= before + 1, "only the ps that asks"


def test_one_run_is_like_any_other(write_experiment) -> None:
    """Whatever a run leaves in memory, and however many processes: the same results."""
    path = write_experiment("plain")
    tasks = [task_of(path, "6", seed) for seed in (1, 2, 1, 2, 1)]
    one, two = (results(*tasks, processes=number) for number in (1, 2))
    for run in (*one, *two):
        del run["wall_s"], run["cpu_s"]
    assert one == two
    assert one[0] == one[2] == one[4] and one[1] == one[3]
    assert one[0]["timesteps"] == 10 and one[0]["robots"] == 15


def test_runs_of_one_setup_share_what_is_read_of_its_files(write_experiment) -> None:
    """The first run reads them in its own process, the second one's worker for all that follow."""
    path = write_experiment("kept")
    tasks = [task_of(path, "6", seed) for seed in (1, 2, 3, 1, 2, 3)]
    found = []
    for _, run in simulate_all(tasks, 1, threading.Event(), lambda workers: None):
        found.append({key: value for key, value in run.items() if not key.endswith("_s")})
        if len(found) == 2:
            path.write_text("nobody reads this")
    assert found[3:] == found[:3]


def test_what_users_python_does_when_files_are_read_is_done_in_every_run(write_experiment) -> None:
    loop = '<loop_functions library="none" label="counts"/>\n  <arena '
    path = write_experiment("counts", ("<arena ", loop))
    log = path.with_name("log.txt")
    path.with_name("counts.py").write_text(
        f"def populate(space):\n    with open({str(log)!r}, 'a') as log:\n        log.write('x')\n"
    )
    path.write_text(path.read_text().replace('library="none"', 'library="counts.py"'))
    tasks = [task_of(path, "6", seed) for seed in (1, 2, 3)]
    log.unlink()
    results(*tasks)
    assert log.read_text() == "xxx"


def test_what_users_python_prints_goes_to_standard_error(write_experiment) -> None:
    loop = '<loop_functions library="none" label="speaks"/>\n  <arena '
    path = write_experiment("speaks", ("<arena ", loop))
    path.with_name("speaks.py").write_text("def reset(world):\n    print('good morning')\n")
    path.write_text(path.read_text().replace('library="none"', 'library="speaks.py"'))
    words = ["-m", "vsense", "sim", str(path), "--duration", "1", "--json"]
    env = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    output = ["--output", str(path.parent / "spoken")]
    ran = subprocess.run(
        [sys.executable, *words, *output], capture_output=True, cwd=ROOT, env=env, check=True
    )
    assert b"\ngood morning\n" in ran.stderr and json.loads(ran.stdout)["timesteps"] == 10


def test_what_a_user_can_mend_comes_through_as_it_is(write_experiment) -> None:
    good = task_of(write_experiment("crowded"))
    write_experiment(
        "crowded", ('min="-1.48,-1.18,0" max="1.48,1.18,0"', 'min="0,0,0" max="0,0,0"')
    )
    with pytest.raises(SimulatedRunError, match=r"crowded\.argos:\d+: .* no room") as caught:
        results(good)
    assert caught.value.exit_code == 2


def test_who_interrupts_leaves_nobody_behind(write_experiment) -> None:
    before = len(descendants())
    interrupted = threading.Event()
    going = simulate_all(
        [task_of(write_experiment("plain"), "4")],
        1,
        interrupted,
        lambda workers: interrupted.set() if workers[0].timesteps >= TIMESTEP else None,
        60.0,
    )
    with pytest.raises(Interrupted):
        list(going)
    assert len(descendants()) <= before + 1


FACTS = """
import json, os, signal, sys, threading
from vsense.base import processes

processes.ForkedProcess.allow()
signal.signal(signal.SIGTERM, lambda *_: sys.exit(3))
signal.signal(signal.SIGHUP, signal.SIG_IGN)
folder = sys.argv[1]
sys.argv, sys.path[:1] = [f"{folder}/vsense"], [folder]
held, shared = open(f"{folder}/held", "w"), os.open(f"{folder}/shared", os.O_RDWR | os.O_CREAT)
print("waits")

def run(shared):
    folder = "/proc/self/fd"
    known = {n: os.readlink(f"{folder}/{n}") for n in os.listdir(folder)[:-1]}
    handlers = {n: str(signal.getsignal(n)) for n in (signal.SIGTERM, signal.SIGHUP)}
    own = [os.getsid(0) == os.getpid(), signal.getsignal(signal.SIGINT).__name__]
    print(json.dumps([known, handlers, own, sys.path[0], input()]), flush=True)
    return 7

process, jobs, answers = processes.begin_worker("__main__", [shared], fresh=False)
jobs.write(b"job\\n")
jobs.close()
given = json.loads(answers.read())
waiting = threading.Event()
thread = threading.Thread(target=waiting.wait)
alone = processes.ForkedProcess.is_safe()
thread.start()
ends = [process.wait(), process.poll(), alone, processes.ForkedProcess.is_safe()]
print(json.dumps([ends, held.fileno(), shared, *given]))
waiting.set()
"""


def test_a_fork_has_nothing_of_its_parents_but_what_it_shares(tmp_path: Path) -> None:
    words = [sys.executable, "-c", FACTS, str(tmp_path)]
    ran = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=True)
    first, facts = ran.stdout.splitlines()
    assert (first, ran.stderr) == ("waits", "")
    ends, held, shared, known, handlers, own, folder, line = json.loads(facts)
    assert (ends, line) == ([7, 7, True, False], "job")
    assert known.pop(str(shared)) == str(tmp_path / "shared")
    assert known.pop(str(held)) == os.devnull
    pipes = [known.pop(number) for number in ("0", "1", "2")]
    assert all(name.startswith("pipe:") for name in pipes) and len({*pipes}) == 3
    assert {*known.values()} <= {os.devnull}
    assert handlers == {"15": str(signal.SIG_DFL), "1": str(signal.SIG_IGN)}
    assert own == [True, "default_int_handler"]
    assert folder != str(tmp_path)


SAME = """
import json, os, sys, threading
from vsense.base import processes

if sys.argv[2] == "forked":
    processes.ForkedProcess.allow()
from tests.modes.sim.conftest import task_of
from tests.rigs.processes import descendants
from vsense.modes.sim.watch import WorkerProcess, simulate_all

tasks = [task_of(sys.argv[1], "6", seed) for seed in (1, 2, 1)]
worker = WorkerProcess()
kind = type(worker._process).__name__
worker.close()
going = simulate_all(tasks, 2, threading.Event(), lambda workers: None, 60.0)
runs = {id(task): run for task, run in going}
for run in runs.values():
    del run["wall_s"], run["cpu_s"]
print(json.dumps([kind, [runs[id(task)] for task in tasks], len(descendants())]))
"""


def test_a_forked_worker_does_what_one_that_was_started_does(write_experiment) -> None:
    path, found = write_experiment("plain"), {}
    for way in ("forked", "started"):
        words = [sys.executable, "-c", SAME, str(path), way]
        ran = subprocess.run(words, stdout=subprocess.PIPE, cwd=ROOT, check=True)
        found[way] = json.loads(ran.stdout)
    assert found["forked"][0] == "ForkedProcess" and found["started"][0] == "Popen"
    assert found["forked"][1:] == found["started"][1:]
    assert found["forked"][1][0]["timesteps"] == 10 and found["forked"][2] <= 1, "only the ps"


SCRIPT = """
import sys, threading
from vsense.base import processes

if sys.argv[2] == "forked":
    processes.ForkedProcess.allow()
from tests.modes.sim.conftest import task_of
from vsense.modes.sim.watch import simulate_all

def show(workers):
    if workers[0].timesteps >= 4:
        print(workers[0]._process.pid, flush=True)

list(simulate_all([task_of(sys.argv[1], "4")], 1, threading.Event(), show, 60.0))
"""


@pytest.mark.parametrize("way", ["forked", "started"])
def test_a_loop_without_an_end_dies_with_who_started_it(write_experiment, way: str) -> None:
    path = write_experiment("plain")
    words = [sys.executable, "-c", SCRIPT, str(path), way]
    parent = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    looping = descendants(worker)
    assert len(looping) == 1
    watched = [os.pidfd_open(pid) for pid in (worker, *looping)]
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    for descriptor in watched:
        # It becomes readable when its process has ended.
        assert select.select([descriptor], [], [], 60.0)[0], "it lives on"
        os.close(descriptor)
