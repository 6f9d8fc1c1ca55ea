"""The user's Python: what it can do, and that each of its faults is named with its line."""

from __future__ import annotations

import sys
from pathlib import Path
from textwrap import dedent

import pytest

from vsense.base.errors import likely
from vsense.world import World
from vsense.world.entities import Arena
from vsense.world.fields import Field
from vsense.world.loop_functions import LoopFunctions, LoopFunctionsError

ARENA = Arena((2.0, 1.0, 1.0), (0.0, 0.0, 0.5))

DOORS = """
from vsense.world import Box, Light, Zone

def reset(world):
    world.put(Box("door", (0, 0, 0), (0.1, 1.0, 0.1)))
    world.put(Light("lamp", (0, 0, 0.5), intensity=2.0))
    world.put(Zone("home", "circle", 0, 0, radius_m=0.5, color=(0, 0, 255)))
    world.results["opened"] = 0

def pre_step(world):
    if world.time_s >= float(world.params["open_s"]):
        world.move("door", 0, 2)
        world.results["opened"] += 1
    world.fields["pheromone"].deposit([(0.1, 0.1)], 1.0)

def post_step(world):
    world.move("lamp", world.time_s, world.random.random())

def end(world):
    inside = world.entities["home"].contains([(r["x_m"], r["y_m"]) for r in world.robots])
    return {"inside": inside.mean(), "pheromone": world.fields["pheromone"].total()}
"""


def written(folder: Path, text: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(dedent(text))
    return path


def world_of(*tags: int) -> World:
    return World(tags, fields=[Field("pheromone", ARENA, 0.05)])


def lives(loop: LoopFunctions, world: World, timesteps: int) -> dict[str, float]:
    loop.reset(world)
    for k in range(timesteps):
        world.run_timestep = k
        loop.pre_step(world)
        loop.post_step(world)
    return loop.end(world)


def test_doors_open_lights_wander_and_results_come_out(tmp_path: Path) -> None:
    world = world_of(1, 2)
    loop = LoopFunctions(written(tmp_path, DOORS), params={"open_s": "0.5"})
    results = lives(loop, world, 10)
    assert results == {"opened": 5.0, "inside": 1.0, "pheromone": pytest.approx(10.0)}
    assert world.boxes()[0].position_m == (0.0, 2.0, 0.0)
    assert world.lights()[0].position_m[0] == pytest.approx(0.9)


def test_a_class_keeps_its_own_state_and_is_new_in_every_run(tmp_path: Path) -> None:
    text = """
    class {name}:
        def __init__(self):
            self.steps = 0
        def post_step(self, world):
            self.steps += 1
        def end(self, world):
            return {{"steps": self.steps}}
    """
    for name, label in (("LoopFunctions", ""), ("Mine", "Mine")):
        path = written(tmp_path, text.format(name=name))
        for _ in range(2):
            assert lives(LoopFunctions(path, label), world_of(), 3) == {"steps": 3.0}


def test_a_label_without_its_class_means_the_files_functions(tmp_path: Path) -> None:
    path = written(tmp_path, "def end(world):\n    return {'a': 1}\n")
    assert LoopFunctions(path, "foraging").end(world_of()) == {"a": 1.0}


def test_state_of_the_module_does_not_outlive_the_run(tmp_path: Path) -> None:
    written(tmp_path, "count = []\n", "helper_of_loop.py")
    text = """
    import helper_of_loop
    seen = []
    def pre_step(world):
        seen.append(1)
        helper_of_loop.count.append(1)
    def end(world):
        return {"seen": len(seen), "count": len(helper_of_loop.count)}
    """
    before = list(sys.path)
    for _ in range(2):
        results = lives(LoopFunctions(written(tmp_path, text)), world_of(), 2)
        assert results == {"seen": 2.0, "count": 2.0}
    assert sys.path == before and "helper_of_loop" not in sys.modules


def test_a_module_beside_it_may_be_imported_late_and_blamed_at_the_call(tmp_path: Path) -> None:
    written(tmp_path, "def fail():\n    raise ValueError('too much')\n", "late_helper.py")
    text = "def pre_step(world):\n    import late_helper\n    late_helper.fail()\n"
    loop = LoopFunctions(written(tmp_path, text))
    with pytest.raises(LoopFunctionsError, match=r"mine.py:3: in pre_step: ValueError: too much$"):
        loop.pre_step(world_of())
    del sys.modules["late_helper"]


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("def reset(world)\n    pass", 1, "SyntaxError:.*':'"),
        ("def reset(world):\npass", 2, "IndentationError:"),
        ("x = 1\nimport no_such_module_at_all", 2, "ModuleNotFoundError:"),
        ("x = 1\n\ny = 1 / 0", 3, "ZeroDivisionError:"),
        ("import sys\nsys.exit(3)", 2, "SystemExit: 3"),
        ("raise SystemExit", 1, "SystemExit"),
        ("x = 1", 1, "reset, pre_step"),
        ("", 1, "holds no loop function"),
        ("reset = 3", 1, r"reset .*3.*reset\(world\)"),
        ("x = 1\ndef reset():\n    pass", 2, "reset:.*arguments"),
        ("def end(world, more):\n    pass", 1, "end:.*'more'"),
        ("async def reset(world):\n    pass", 1, "reset .*async"),
        ("def pre_step(world):\n    yield 1", 1, "pre_step .*async"),
        ("class LoopFunctions:\n  def __init__(self):\n    oops", 3, "LoopFunctions: NameError"),
        ("class LoopFunctions:\n  def __init__(self, a):\n    a", 2, "LoopFunctions: TypeError"),
        ("class LoopFunctions:\n  pass", 1, "holds no loop function"),
        ("class E(Exception):\n  def __str__(self): 1/0\nraise E()", 3, "E: it cannot say"),
        ("\0", 1, "null byte"),
        ("# -*- coding: nonsense -*-", 1, "encoding:"),
    ],
)
def test_a_file_that_does_not_load(tmp_path: Path, text: str, line: int, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(LoopFunctionsError, match=message) as caught:
        LoopFunctions(path)
    assert str(caught.value).startswith(f"{path}:{line}: ")
    assert "\n" not in str(caught.value) and caught.value.line == line


def test_a_file_that_is_not_there_or_is_none(tmp_path: Path) -> None:
    with pytest.raises(LoopFunctionsError, match=r"gone.py:1:.*No such file"):
        LoopFunctions(tmp_path / "gone.py")
    with pytest.raises(LoopFunctionsError, match="Is a directory"):
        LoopFunctions(tmp_path)
    binary = tmp_path / "binary.py"
    binary.write_bytes(bytes(range(128, 256)))
    with pytest.raises(LoopFunctionsError, match=r"binary.py:1: SyntaxError"):
        LoopFunctions(binary)


def test_a_label_that_names_nothing(tmp_path: Path) -> None:
    with pytest.raises(LoopFunctionsError, match=r"class 'Mine'.*label"):
        LoopFunctions(written(tmp_path, "x = 1"), "Mine")


@pytest.mark.parametrize("hook", ["reset", "pre_step", "post_step", "end"])
@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("world.nonsense", "AttributeError: 'World'.*'nonsense'"),
        ("raise SystemExit(0)", "SystemExit: 0"),
        ("world.move('door', 0, 0)", "'door'.*world"),
        ("world.put(3)", "3 cannot be put into the world"),
        ("world.results['a'] = 'many'", "'a'.*'many'"),
        ("world.robots['x_m'] = 0", "ValueError:.*read-only"),
        ("return 7", "gave 7"),
        ("raise ValueError('two\\nlines')", "ValueError: two lines"),
        ("def deep(): deep()\n    deep()", "RecursionError:"),
    ],
)
def test_a_hook_that_fails(tmp_path: Path, hook: str, body: str, message: str) -> None:
    path = written(tmp_path, f"x = 1\ndef {hook}(world):\n    {body}\n")
    loop = LoopFunctions(path)
    with pytest.raises(LoopFunctionsError, match=message) as caught:
        getattr(loop, hook)(world_of())
    at = 2 if body == "return 7" else 3
    assert str(caught.value).startswith(f"{path}:{at}: in {hook}: ")


def test_a_setting_that_is_not_there_is_said_with_those_that_are(tmp_path: Path) -> None:
    path = written(tmp_path, "def reset(world):\n    world.params['spt']\n")
    words = r":2: in reset: KeyError: .*no attribute 'spt' of <loop_functions>; is 'spot' meant\?"
    with pytest.raises(LoopFunctionsError, match=words):
        LoopFunctions(path, params={"spot": "food"}).reset(world_of())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("{'a': 'x'}", "in end: result 'a' is 'x', expected a finite number"),
        ("{'a': float('nan')}", "in end: result 'a' is nan"),
        ("{1: 2.0}", "in end: a result is called 1, expected a name"),
        ("[('a', 1)]", r"in end: gave \[\('a', 1\)\], expected a dict of numbers by name"),
    ],
)
def test_what_end_gives_is_checked(tmp_path: Path, given: str, message: str) -> None:
    loop = LoopFunctions(written(tmp_path, f"\n\ndef end(world):\n    return {given}\n"))
    with pytest.raises(LoopFunctionsError, match=f"mine.py:3: {message}"):
        loop.end(world_of())


def test_results_written_on_the_way_are_kept(tmp_path: Path) -> None:
    loop = LoopFunctions(written(tmp_path, "def end(world):\n    return {'b': 2}\n"))
    world = world_of()
    world.results["a"] = 1.0
    assert loop.end(world) == {"a": 1.0, "b": 2.0}
    silent = LoopFunctions(written(tmp_path, "def reset(world):\n    pass\n"))
    assert silent.end(world) == {"a": 1.0}


def test_ctrl_c_is_the_users_own(tmp_path: Path) -> None:
    loop = LoopFunctions(written(tmp_path, "def reset(world):\n    raise KeyboardInterrupt\n"))
    with pytest.raises(KeyboardInterrupt):
        loop.reset(world_of())


def test_the_floors_colours(tmp_path: Path) -> None:
    text = """
    def floor_color(x_m, y_m):
        return (255, 0, 0) if x_m > 0 else (0, 0, 50 + 100 * y_m)
    """
    floor = LoopFunctions(written(tmp_path, text)).floor(ARENA, 10.0)
    assert floor.image is not None and floor.image.shape == (10, 20, 3)
    sampled = floor.sample([(0.5, 0.0), (-0.5, 0.45), (-0.5, -0.45)])[:, :3]
    assert sampled.tolist() == [[255, 0, 0], [0, 0, 95], [0, 0, 5]]


@pytest.mark.parametrize(
    "color", ["None", "3", "(1, 2)", "(0, 0, 256)", "('a', 0, 0)", "(-1, 0, 0)"]
)
def test_a_floor_has_colours(tmp_path: Path, color: str) -> None:
    loop = LoopFunctions(written(tmp_path, f"def floor_color(x, y):\n    return {color}\n"))
    with pytest.raises(LoopFunctionsError, match=r"mine.py:1:.*floor_color:.*0.*255"):
        loop.floor(ARENA, 10.0)


def test_a_floor_is_asked_for_only_where_there_is_one(tmp_path: Path) -> None:
    loop = LoopFunctions(written(tmp_path, "def reset(world):\n    pass\n"))
    with pytest.raises(LoopFunctionsError, match=r"floor_color\(x_m, y_m\)"):
        loop.floor(ARENA, 10.0)
    fine = LoopFunctions(written(tmp_path, "def floor_color(x, y):\n    return 0, 0, 0\n"))
    with pytest.raises(LoopFunctionsError, match="10000000"):
        fine.floor(ARENA, 1e5)


def test_a_function_that_looks_like_a_hook_is_refused(tmp_path: Path) -> None:
    text = "def reset(world):\n    pass\n\n\ndef poststep(world):\n    pass\n"
    with pytest.raises(LoopFunctionsError, match=r"mine.py:5:.*'post_step'"):
        LoopFunctions(written(tmp_path, text))
    LoopFunctions(written(tmp_path, text.replace("poststep", "_poststep")))
    LoopFunctions(written(tmp_path, text.replace("poststep", "helper")))


def test_a_helper_that_begins_as_a_hook_does_is_no_misspelling(tmp_path: Path) -> None:
    """`likely` decides there: what is only a part of a hook's name is the user's own."""
    for name in ("reset_counts", "pre", "end_of_day"):
        assert likely(name, ("reset", "pre_step", "end", "populate")) == ""
