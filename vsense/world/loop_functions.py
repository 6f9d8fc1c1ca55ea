"""The user's own Python around every timestep: reads and changes the world, and measures.

An experiment names a file, `<loop_functions library="doors.py" />`. It holds any of these, as
functions or as methods of one class, called as the attribute `label` says ("LoopFunctions"
where there is none), which is made for every run, without arguments:

    def populate(space):   while the experiment is read: space.add_robot(id, controller, x_m, y_m)
    def reset(world):      before the first timestep
    def pre_step(world):   after the robots were seen, before their virtual actuators act
    def post_step(world):  after the robots' readings were computed
    def end(world):        after the last timestep; may give measures of the run, a dict
    def floor_color(x_m, y_m):  with <floor source="loop_functions">: red, green, blue, 0..255

`world` is the `World`: `world.params["door_s"]` are the other attributes of the element, as texts,
which people may change on the page while it runs, as they may move things. They may add and remove
virtual robots only where file or class says `robots_may_change = True`: the rows of `world.robots`
come and go then, those of before stay first;
`world.random` is what to draw from, so that a seed repeats a run; `world.driven_by("prey")` tells
which of `world.robots` that controller drives. What goes wrong in the file becomes one error that
names its line.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn, Protocol

import numpy as np

from vsense.base.errors import VsenseError, instead
from vsense.base.users_code import UsersCode, line_of
from vsense.world.entities import Arena, WorldError
from vsense.world.fields import Floor
from vsense.world.world import Results, World

HOOKS = {"populate": 1, "reset": 1, "pre_step": 1, "post_step": 1, "end": 1, "floor_color": 2}
"""What the file may hold, and how many arguments each is called with."""

STEPS = frozenset(("pre_step", "post_step"))
"""Those that are called in every timestep."""

DEFAULT_LABEL = "LoopFunctions"

_MODULE = "vsense_loop_functions"
_MAX_PIXELS = 10_000_000
_ARGUMENTS = {1: "world", 2: "x_m, y_m"}

Hook = Callable[..., Any]


class LoopParams(dict[str, str]):
    """The settings of loop functions, as texts; a KeyError names those that are there."""

    def __missing__(self, name: str) -> NoReturn:
        raise KeyError(f"no attribute {name!r} of <loop_functions>; {instead(name, self)}")


class LoopFunctionsError(VsenseError):
    """The user's file failed; `file:line: what happened`, lines from 1."""

    def __init__(self, file: str, line: int, message: str) -> None:
        super().__init__(f"{file}:{line}: {message}")
        self.file = file
        self.line = line
        self.message = message


class Hooks(Protocol):
    """What is called around every timestep of a run, whatever it is written in.

    Attributes:
        steps: which of pre_step and post_step there are.
        finished: the hooks have said that the experiment is over.
        said: what they logged since the list was emptied.
        moved: x, y and yaw of robots, by row, that were put somewhere since it was emptied.
        robots_may_change: virtual robots may come and go while a run goes on.
    """

    robots_may_change: bool
    steps: frozenset[str]
    finished: bool
    said: list[str]
    moved: dict[int, tuple[float, float, float]]

    def renewed(self) -> Hooks:
        """The hooks of a run that begins anew."""
        ...

    def reset(self, world: World) -> None:
        """Before the first timestep."""
        ...

    def pre_step(self, world: World) -> None:
        """After the robots were seen, before their virtual actuators act."""
        ...

    def post_step(self, world: World) -> None:
        """After the robots' readings were computed."""
        ...

    def end(self, world: World) -> dict[str, float]:
        """After the last timestep; gives the run's measures."""
        ...

    def floor(self, arena: Arena, pixels_per_m: float) -> Floor:
        """The floor that the hooks give, pixel by pixel."""
        ...


class LoopFunctions:
    """The hooks of one user's file for one run; they never move robots or end a run."""

    finished = False

    def __init__(
        self, path: Path, label: str = "", params: Mapping[str, str] | None = None
    ) -> None:
        """Loads the file; modules beside it may be imported in it.

        Args:
            label: name of the class that holds the hooks, "": the default one. Without such a
                class the file's own functions are the hooks: in ARGoS everything has a label.
            params: the user's settings, for `world.params`.

        Raises:
            LoopFunctionsError: the file cannot be read or run, or holds no hook.
        """
        self._made_of = path, label, params
        self.said: list[str] = []
        self.moved: dict[int, tuple[float, float, float]] = {}
        self._code = UsersCode(path, LoopFunctionsError)
        self._file = self._code.file
        self._params = dict(params or {})
        module = self._code.load(_MODULE)
        self._hooks: dict[str, Hook] = {}
        self._lines: dict[str, int] = {}
        holder = self._holder(module, label)
        self.robots_may_change = getattr(holder, "robots_may_change", False) is True
        for name, arguments in HOOKS.items():
            hook = getattr(holder, name, None)
            if hook is not None:
                self._check_hook(name, hook, arguments)
                self._hooks[name] = hook
                self._lines[name] = line_of(hook)
        self._code.refuse_misspelt(holder, HOOKS, "is no loop function")
        if not self._hooks:
            hooks = ", ".join(HOOKS)
            raise LoopFunctionsError(self._file, 1, f"holds no loop function, expected: {hooks}")
        self.steps = STEPS.intersection(self._hooks)

    def renewed(self) -> LoopFunctions:
        """Those of another run: the file is run again."""
        return LoopFunctions(*self._made_of)

    def populate(self, space: object) -> None:
        """Calls the user's `populate`; see `vsense.config._population`.

        Raises:
            LoopFunctionsError: it failed.
        """
        given = self._call("populate", space)
        if given is not None:
            raise self._wrong("populate", f"gave {_shown(given)}, expected nothing")

    def reset(self, world: World) -> None:
        """Calls the user's `reset`, with the settings in place.

        Raises:
            LoopFunctionsError: it failed; so with the other hooks.
        """
        world.params = LoopParams(self._params)
        self._step("reset", world)

    def pre_step(self, world: World) -> None:
        """Calls the user's `pre_step`."""
        self._step("pre_step", world)

    def post_step(self, world: World) -> None:
        """Calls the user's `post_step`."""
        self._step("post_step", world)

    def end(self, world: World) -> dict[str, float]:
        """Calls the user's `end`; returns its measures and those in `world.results`."""
        given = self._call("end", world)
        if given is None:
            given = {}
        if not isinstance(given, Mapping):
            expected = "a dict of numbers by name"
            raise self._wrong("end", f"gave {_shown(given)}, expected {expected}")
        try:
            return dict(Results({**world.results, **given}))
        except WorldError as error:
            raise self._wrong("end", str(error)) from None

    def floor(self, arena: Arena, pixels_per_m: float) -> Floor:
        """Makes the floor that the user's `floor_color` gives, pixel by pixel.

        Raises:
            LoopFunctionsError: there is none, it failed, or the picture is too large.
        """
        if "floor_color" not in self._hooks:
            raise LoopFunctionsError(
                self._file, 1, "has no floor_color(x_m, y_m), which the experiment's floor wants"
            )
        size, centre = arena.size_m[:2], arena.centre_m[:2]
        width, height = (max(round(s * pixels_per_m), 1) for s in size)
        if width * height > _MAX_PIXELS:
            what = f"{width} x {height} pixels, expected at most {_MAX_PIXELS}"
            raise self._wrong("floor_color", f"the floor would have {what}")
        image = np.empty((height, width, 3), dtype=np.uint8)
        for row in range(height):
            y_m = centre[1] + size[1] * (0.5 - (row + 0.5) / height)
            for column in range(width):
                x_m = centre[0] + size[0] * ((column + 0.5) / width - 0.5)
                image[row, column] = self._color(x_m, y_m)
        return Floor(image, (size[0], size[1]), (centre[0], centre[1]))

    def _color(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        color = self._call("floor_color", x_m, y_m)
        try:
            red, green, blue = (float(part) for part in color)
        except (TypeError, ValueError):
            red = green = blue = -1.0
        if not all(0.0 <= part <= 255.0 for part in (red, green, blue)):
            expected = "red, green, blue from 0 to 255"
            raise self._wrong("floor_color", f"gave {_shown(color)}, expected {expected}")
        return round(red), round(green), round(blue)

    def _step(self, name: str, world: World) -> None:
        given = self._call(name, world)
        if given is not None:
            raise self._wrong(name, f"gave {_shown(given)}, expected nothing")

    def _call(self, name: str, *arguments: object) -> Any:
        hook = self._hooks.get(name)
        if hook is None:
            return None
        with self._code.watch(f"in {name}: ", self._lines[name]):
            return hook(*arguments)

    def _holder(self, module: ModuleType, label: str) -> object:
        """What holds the hooks: the module, or an object of the class in it."""
        holder = getattr(module, label or DEFAULT_LABEL, None)
        if inspect.isclass(holder):
            with self._code.watch(f"in {holder.__name__}: ", line_of(holder.__init__)):
                return holder()
        if label and not any(hasattr(module, name) for name in HOOKS):
            message = f"has neither a class {label!r}, as the label says, nor loop functions"
            raise LoopFunctionsError(self._file, 1, message)
        return module

    def _check_hook(self, name: str, hook: object, arguments: int) -> None:
        """Raises LoopFunctionsError for what can be seen to be no hook before it is called."""
        wanted = f"expected a function {name}({_ARGUMENTS[arguments]})"
        if not callable(hook):
            raise LoopFunctionsError(self._file, 1, f"{name} is {_shown(hook)}, {wanted}")
        kinds = inspect.iscoroutinefunction, inspect.isgeneratorfunction, inspect.isasyncgenfunction
        if any(is_kind(hook) for is_kind in kinds):
            raise self._wrong_at(hook, f"{name} is async or yields, {wanted}")
        try:
            inspect.signature(hook).bind(*range(arguments))
        except TypeError as error:
            raise self._wrong_at(hook, f"{name}: {error}, {wanted}") from None

    def _wrong(self, name: str, message: str) -> LoopFunctionsError:
        return self._wrong_at(self._hooks[name], f"in {name}: {message}")

    def _wrong_at(self, hook: Hook, message: str) -> LoopFunctionsError:
        return LoopFunctionsError(self._file, line_of(hook), message)


def _shown(value: object) -> str:
    try:
        return f"{value!r:.60}"
    except Exception:
        return f"something of type {type(value).__name__}"
