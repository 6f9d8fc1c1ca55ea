"""Python files of users: whatever goes wrong in one is one error with its file and line."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from vsense.base import users_code
from vsense.base.errors import VsenseError
from vsense.base.interruption import interruption
from vsense.base.users_code import CallWatchdog, UsersCode, line_of
from vsense.world.entities import Zone
from vsense.world.world import World

NAME = "vsense_test_of_users_code"
PATIENCE_S = 30.0


class UsersError(VsenseError):
    """What these tests have raised."""

    def __init__(self, file: str, line: int, message: str) -> None:
        super().__init__(f"{Path(file).name}:{line}: {message}")


def load(folder: Path, text: str) -> tuple[UsersCode, ModuleType]:
    (folder / "mine.py").write_text(text)
    code = UsersCode(folder / "mine.py", UsersError)
    return code, code.load(NAME)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1\ndef f(:\n", "^mine.py:2: SyntaxError:"),
        ("import no_such_module_here\n", "^mine.py:1: ModuleNotFoundError:"),
        ("\n\nx = 1 / 0\n", "^mine.py:3: ZeroDivisionError:"),
        ("def f():\n    return g()\ndef g():\n    return h\nf()\n", "^mine.py:4: NameError:"),
        ("import math\n\nmath.sqrt('x')\n", "^mine.py:3: TypeError:"),
        ("import sys\nsys.exit(3)\n", r"^mine.py:2: SystemExit: 3$"),
        ("raise ValueError('two\\nlines')\n", r"^mine.py:1: ValueError: two lines$"),
        ("raise ValueError('x' * 9999)\n", r"^mine.py:1: ValueError: x{288}$"),
        ("class E(Exception):\n    __str__ = None\nraise E()\n", "^mine.py:3: E:"),
        ("x = '\0'\n", "^mine.py:1:"),
    ],
)
def test_what_goes_wrong_has_its_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(UsersError, match=words):
        load(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("world.robots['x']", r"^mine.py:2: ValueError: no field of name x; .* has tag, x_m, y_m"),
        ("world.entities['spott']", r"KeyError: .*no 'spott' in the arena; is 'spot' meant\?"),
        ("world.entities['zz']", r"KeyError: .*no 'zz' in the arena; there are: food, spot"),
    ],
)
def test_names_that_a_world_does_not_have_come_with_those_that_it_has(
    tmp_path: Path, text: str, words: str
) -> None:
    things = [Zone(name, "circle", 0.0, 0.0, 0.1) for name in ("spot", "food")]
    world = World([23], entities=things)
    code, module = load(tmp_path, f"def look(world):\n    return {text}\n")
    with pytest.raises(UsersError, match=words), code.watch():
        module.look(world)
    assert world.entities.get("zz") is None and "zz" not in world.entities


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UsersError, match=r"^gone.py:1:.*No such file"):
        UsersCode(tmp_path / "gone.py", UsersError).load(NAME)


def test_what_fails_in_the_programs_own_code_has_the_users_last_line(tmp_path: Path) -> None:
    code, module = load(tmp_path, "\ndef call(f):\n    return f()\n")
    with (
        pytest.raises(UsersError, match=r"^mine.py:3:.*KeyError: 'x'"),
        code.watch("in call: "),
    ):
        module.call(lambda: {}["x"])
    with pytest.raises(UsersError, match=r"^mine.py:7: KeyError"), code.watch(fallback=7):
        raise KeyError("not in the file at all")


def test_the_users_own_interruption_and_errors_with_a_better_place_go_through(
    tmp_path: Path,
) -> None:
    code, _ = load(tmp_path, "")
    with pytest.raises(KeyboardInterrupt), code.watch():
        raise KeyboardInterrupt
    with pytest.raises(LookupError), code.watch(through=(LookupError,)):
        raise KeyError("x")
    with pytest.raises(UsersError, match=r"^mine.py:1: enough said$"), code.watch():
        raise VsenseError("enough said")


def test_modules_beside_it_are_found_and_read_anew_for_every_run(tmp_path: Path) -> None:
    path, modules = list(sys.path), set(sys.modules)
    for number in (1, 22):
        (tmp_path / "beside_mine.py").write_text(f"NUMBER = {number}\n")
        _, module = load(tmp_path, "from beside_mine import NUMBER\n")
        assert number == module.NUMBER
    assert sys.path == path
    assert set(sys.modules) - modules <= {NAME}


def test_packages_of_the_same_name_in_two_folders_are_two(tmp_path: Path) -> None:
    for folder in ("old", "new"):
        (tmp_path / folder / "parts").mkdir(parents=True)
        (tmp_path / folder / "parts" / "wheels.py").write_text(f"FOLDER = {folder!r}\n")
        _, module = load(tmp_path / folder, "from parts.wheels import FOLDER\n")
        assert folder == module.FOLDER


def test_dataclasses_find_their_module(tmp_path: Path) -> None:
    text = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    _, module = load(tmp_path, text + "@dataclass\nclass A:\n    x: int = 3\n")
    assert module.A().x == 3


def test_lines_of_functions(tmp_path: Path) -> None:
    _, module = load(tmp_path, "\n\ndef f():\n    pass\n")
    assert (line_of(module.f), line_of(3), line_of(len)) == (3, 1, 1)


HUNG = """
import os, signal, sys, threading, time
from pathlib import Path
from vsense import cli
from vsense.base import interruption as module
from vsense.base.errors import VsenseError
from vsense.base.interruption import interruption
from vsense.base import users_code
from vsense.base.users_code import UsersCode

users_code.STUCK_S, module.ALARM_S = 0.2, 0.05
module.last_acts.append(lambda: print("terminal restored", flush=True))

def run(words):
    make = lambda file, line, text: VsenseError(f"{file}:{line}: {text}")
    code = UsersCode(Path(sys.argv[1]), make)
    with interruption() as interrupted:
        threading.Timer(0.3, os.kill, (os.getpid(), getattr(signal, sys.argv[2]))).start()
        users = code.load("users")
        with code.watch("in act: "):
            users.act()
        print("it has returned", interrupted.wait(9.0), flush=True)
        return interrupted.code

cli._run = run
sys.exit(cli.main())
"""
PLACES = {
    "sleeps": ("while True:\n        time.sleep(0.01)", ":4: in act: it had not returned for "),
    "spins": ("while True:\n        pass", ": in act: it had not returned for "),
    "catches": (
        "while True:\n        try: time.sleep(0.01)\n        except: pass",
        "/mine.py catches what shall end it: the process ends",
    ),
    "raises": (
        "try:\n        while True: time.sleep(0.01)\n    except: raise KeyboardInterrupt('x')",
        ":5: in act: it had not returned for ",
    ),
    "returns": ("time.sleep(0.1)", "it has returned True"),
}


@pytest.mark.parametrize("how", PLACES)
@pytest.mark.parametrize("signal_name, code", [("SIGTERM", 143), ("SIGINT", 130)])
def test_a_signal_ends_what_does_not_return(
    tmp_path: Path, how: str, signal_name: str, code: int
) -> None:
    body, words = PLACES[how]
    (tmp_path / "mine.py").write_text(f"import time\ndef act():\n    {body}\n")
    command = [sys.executable, "-c", HUNG, str(tmp_path / "mine.py"), signal_name]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert words in done.stdout + done.stderr and done.returncode == code
    assert ("terminal restored" in done.stdout) == (how == "catches")
    assert "Traceback" not in done.stderr


def test_what_does_not_return_is_told_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(users_code, "STUCK_S", 0.1)
    monkeypatch.setattr(users_code, "ALARM_S", 0.01)
    path = tmp_path / "mine.py"
    path.write_text("def act(wait):\n    wait()\n")
    code = UsersCode(path, lambda file, line, text: VsenseError(text))
    users = code.load("users")
    said: list[str] = []
    told, go = threading.Event(), threading.Event()

    def say(text: str) -> None:
        said.append(text)
        told.set()

    def act(wait: Callable[[], object]) -> None:
        with code.watch(), code.watch():
            users.act(wait)

    with CallWatchdog(say):
        act(lambda: None)
        thread = threading.Thread(target=act, args=(go.wait,))
        thread.start()
        assert told.wait(PATIENCE_S)
        told.clear()
        go.set()
        thread.join()
        assert told.wait(PATIENCE_S)
    line = rf"{path}:2: it has not returned for 0\.\d s: robots stand until it does"
    assert re.fullmatch(line, said[0]) and said[1:] == [f"{path} has returned"]


def test_only_a_signal_is_ctrl_c(tmp_path: Path) -> None:
    text = "raise KeyboardInterrupt\n"
    with interruption(), pytest.raises(UsersError, match=r"^mine\.py:1: KeyboardInterrupt$"):
        load(tmp_path, text)
    with pytest.raises(KeyboardInterrupt):
        load(tmp_path, text)


SAVES = """
import signal, sys, time
from pathlib import Path
from vsense.base import interruption as module
from vsense.base import users_code
from vsense.base.errors import VsenseError

users_code.STUCK_S, module.ALARM_S = 0.1, 0.02
code = users_code.UsersCode(Path(sys.argv[1]), lambda file, line, text: VsenseError(text))
with module.interruption():
    signal.raise_signal(signal.SIGINT)
    users = code.load("users")
    with code.watch():
        users.act()
"""


def test_ctrl_c_leaves_what_begins_after_it_all_its_time(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import time\ndef act(): time.sleep(0.5); print('saved')\n")
    command = [sys.executable, "-c", SAVES, str(tmp_path / "mine.py")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout == "saved\n", done.stderr
