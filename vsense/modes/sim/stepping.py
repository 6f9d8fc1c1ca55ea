"""A simulation that its caller takes from one control step to the next, and decides for all robots.

The run goes on in a thread of its own, in which nothing else happens: while the caller decides it
waits, and the other way round. It is the simulation of `vsense sim`, in this process.
"""

from __future__ import annotations

import operator
import os
import threading
import weakref
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import UsageError, instead
from vsense.config.specs import ControllerSpec, Experiment
from vsense.modes.sim._simulation import Simulation
from vsense.robots.hosted import HostedProgram, build_host
from vsense.robots.inprocess import ProgramSetup
from vsense.robots.python_swarm import Leds, Swarm
from vsense.run.environment import MOST_SEED
from vsense.run.programs import shared_objects

PICTURE_PX = 600
"""Width of a picture of the arena."""


class _Abandoned(Exception):
    """The caller has gone."""


def stepped_controller(experiment: Experiment, controller: str = "") -> ControllerSpec:
    """Gives the controller that a caller takes the place of, by its id; "": the only one.

    Raises:
        UsageError: there is none of this id; none was named, and there are several; or it drives
            no robot.
    """
    there = {spec.id: spec for spec in experiment.controllers}
    if not controller and len(there) == 1:
        (controller,) = there
    if controller not in there:
        wrong = f"there is no {controller!r}" if controller else "it has several"
        hint = instead(controller, there)
        words = "controller=ID says whose place is taken"
        raise UsageError(f"{experiment.file}: {words}: {wrong}; {hint}")
    if all(robot.controller != controller for robot in experiment.robots):
        raise UsageError(f"{experiment.file}: {controller!r} drives no robot")
    return there[controller]


def _checked(given: Any, seed: Any) -> tuple[Experiment, int]:
    experiment = getattr(given, "experiment", given)
    if not isinstance(experiment, Experiment):
        raise UsageError(f"expected what vsense.load gives, not {experiment!r}")
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if not 0 <= number <= MOST_SEED:
        raise UsageError(f"seed {seed!r}: expected a whole number, 0 to {MOST_SEED}")
    return experiment, number


class SteppedSimulation:
    """One run; begins at its first control step.

    `with` ends it. Between two steps `swarm` has what the robots sense now, and takes what they do.

    Attributes:
        experiment: what runs, but for the controller that is left out.
    """

    def __init__(
        self,
        experiment: Experiment,
        seed: int,
        blind: bool = False,
        draws: bool = False,
        controller: str = "",
    ) -> None:
        """Starts the run.

        Args:
            experiment: what `vsense.load` gives, or its `experiment`.
            seed: of the run, 0 to `MOST_SEED`.
            draws: `picture` will be asked for.
            controller: whose place the caller takes, by its id; the other robots do what their
                own controllers say. "": the only one.

        Raises:
            UsageError: as `stepped_controller`.
            VsenseError: it cannot be simulated.
        """
        experiment, seed = _checked(experiment, seed)
        spec = stepped_controller(experiment, controller)
        build_host()
        self.experiment, self._turns = experiment, _Turns()
        others = tuple(other for other in experiment.controllers if other is not spec)
        libraries = shared_objects(replace(experiment, controllers=others))
        libraries[spec.id], openers = Path(spec.id), {spec.id: self._turns.open}
        self._run = Simulation(experiment, libraries, seed, blind, openers=openers)
        tags = np.array(self._run.record.tags)
        self._rows = np.flatnonzero(np.isin(tags, self.swarm.tags))
        if draws:  # the world is then up to date in every timestep
            self._run.observe = lambda timestep: None
        # The thread keeps the run, and not this: who drops it has ended the run.
        self._thread = threading.Thread(target=self._turns.work, args=(self._run,), daemon=True)
        self._thread.start()
        self._process = os.getpid()
        weakref.finalize(self, self._turns.leave)
        self._turns.wait()

    @property
    def timestep(self) -> int:
        """Of the run, whose control step the robots are in."""
        return self._turns.begun - 1

    @property
    def done(self) -> bool:
        """The run is over."""
        return self._turns.done

    @property
    def finished(self) -> bool:
        """It was ended by its loop functions, before its length was over."""
        return self.done and self._run.environment.finished

    @property
    def swarm(self) -> Swarm:
        """The robots, in the order of `tags`."""
        assert self._turns.program is not None
        return self._turns.program.swarm

    @property
    def results(self) -> Mapping[str, Any]:
        """The experiment's measures now, by name."""
        return MappingProxyType(self._run.environment.world.results)

    @property
    def poses(self) -> NDArray[np.float64]:
        """(n, 3) x, y [m] and yaw [rad] of the robots of `swarm`, as they truly are."""
        return np.array(self._run.record.poses[self.timestep, self._rows])

    def picture(self, width_px: int = PICTURE_PX) -> NDArray[np.uint8]:
        """(h, w, 3) RGB: the arena from above, now."""
        from vsense.monitor.pictures.run_figure import draw_arena  # with OpenCV

        run = self._run
        lit = (run.leds & Leds.RING) != 0
        poses = run.record.poses[self.timestep, : len(lit)]
        image = draw_arena(self.experiment, run.environment.world, poses, lit, width_px)
        return np.ascontiguousarray(image[:, :, ::-1])

    def step(self) -> None:
        """Has the robots do what was set, and goes on to their next control step, or to the end.

        Raises:
            VsenseError: the run has failed.
            ValueError: it is over.
            RuntimeError: this process was forked from the one that it runs in.
        """
        if os.getpid() != self._process:
            raise RuntimeError("the simulation runs in the process that this one was forked from")
        turns = self._turns
        turns.wait()  # for one that Ctrl-C has interrupted
        if turns.done:
            raise ValueError("the run is over")
        turns.ask()
        try:
            turns.wait()
        except KeyboardInterrupt:
            turns.wait()  # what is seen then is of one timestep
            raise

    def close(self) -> None:
        """Ends the run."""
        self._turns.leave()
        self._thread.join()

    def __enter__(self) -> SteppedSimulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Turns:
    """Whose turn it is: the caller's, or the run's, in its thread."""

    def __init__(self) -> None:
        self.done, self.program = False, None
        self.asked, self.begun = 1, 0  # control steps; what is queued only wakes who waits
        self._leaves, self._error = False, None
        self._orders, self._news = SimpleQueue[None](), SimpleQueue[None]()

    program: _SteppedProgram | None
    _error: BaseException | None

    def ask(self) -> None:
        """One more control step is wanted."""
        self.asked = self.begun + 1

    def wait(self) -> None:
        """Until as many control steps have begun as were asked for. To be called again after an
        interruption anywhere in it: a queue's `get` is whole, or was not."""
        if self.begun < self.asked and not self.done:
            self._orders.put(None)
        while self.begun < self.asked and not self.done:
            self._news.get()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def leave(self) -> None:
        """The run ends at its next control step."""
        self._leaves = True
        self._orders.put(None)

    def open(self, setup: ProgramSetup) -> HostedProgram:
        """Makes the program of the robots."""
        self.program = _SteppedProgram(self._turn, setup)
        return self.program

    def work(self, run: Simulation) -> None:
        """The run, in its thread."""
        try:
            run.run()
        except _Abandoned:
            pass
        except BaseException as error:
            self._error = error
        self.done = True
        self._news.put(None)

    def _turn(self) -> None:
        """In the run's thread: a control step begins, and waits for the caller."""
        if self._leaves:
            raise _Abandoned
        self.begun += 1
        self._news.put(None)
        while self.asked <= self.begun and not self._leaves:
            self._orders.get()
        if self._leaves:
            raise _Abandoned


class _SteppedProgram(HostedProgram):
    """Robots whose control step is `turn`."""

    def __init__(self, turn: Callable[[], None], setup: ProgramSetup) -> None:
        self._turn = turn
        super().__init__(setup)
        self.swarm.refuse_unknown()

    def act(self) -> None:
        self._turn()


Reward = Callable[[SteppedSimulation], Any]
"""Gives one number, or one for each robot, after every step."""
