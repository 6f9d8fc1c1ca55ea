"""Runs in their own processes: who crashes is named, who never returns too, and nobody is left."""

from __future__ import annotations

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


SCRIPT = """
import sys, threading
from tests.modes.sim.conftest import task_of
from vsense.modes.sim.watch import simulate_all

def show(workers):
    if workers[0].timesteps >= 4:
        print(workers[0]._process.pid, flush=True)

list(simulate_all([task_of(sys.argv[1], "4")], 1, threading.Event(), show, 60.0))
"""


def test_a_loop_without_an_end_dies_with_who_started_it(write_experiment) -> None:
    path = write_experiment("plain")
    parent = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(path)], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
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
