"""Python files of users: whatever goes wrong in one is one error with its file and line."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

from vsense.base.errors import VsenseError
from vsense.base.users_code import UsersCode, line_of
from vsense.world.entities import Zone
from vsense.world.world import World

NAME = "vsense_test_of_users_code"


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
