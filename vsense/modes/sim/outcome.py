"""What becomes of a run: its result, or who crashed or hung, named."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.base.processes import describe_exit
from vsense.config.specs import Experiment
from vsense.modes.sim._loop_host import LOOP_FUNCTION
from vsense.modes.sim._record import EventLog
from vsense.modes.sim._simulation import WARM_UP_TIMESTEPS
from vsense.modes.sim.job import Job
from vsense.robots.inprocess import SimError
from vsense.robots.loop_library import FUNCTIONS
from vsense.run.directory import LOGGED
from vsense.run.programs import LOADING, LOADING_LOOP, shared_objects
from vsense.run.verdict import RunRecord

JobAnswer = dict[str, Any]
"""What became of a job, as numbers and texts that travel between machines. One of

    {"result": {...}}                     see `vsense.modes.sim._worker.simulate`
    {"error": "...", "exit_code": 1}      what a user can mend
    {"refused": "..."}                    it cannot be done on that machine
    {"status": 139, "place": "..."}       how the run's process ended, as of `os.waitpid`, and words
                                          that follow: where it crashed
    {"hung_s": 10.0}                      a controller did not return for so long
    {"ended": -9}                         how the process behind it ended, as of `subprocess`

and `progress`: what `Programs` noted last."""


class SimulatedRunError(VsenseError):
    """An error in a run's own process, with its message."""

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(text)
        self.exit_code = exit_code


@dataclass(frozen=True, slots=True)
class Task:
    """A job with what errors name; `label`: which run of many, "" where there is only one."""

    job: Job
    experiment: Experiment
    label: str = ""

    def named(self, words: str) -> str:
        """Puts the label before some words."""
        return f"{self.label}: {words}" if self.label else words

    def result(self, answer: JobAnswer) -> dict[str, Any]:
        """Gives the result in an answer to the job: that of `vsense.modes.sim._worker.simulate`.

        Raises:
            VsenseError: what went wrong, and where; it stands among the run's events, too.
        """
        if "result" in answer:
            result: dict[str, Any] = answer["result"]
            return result
        progress = tuple(answer["progress"])
        error = self._error(answer, progress)
        self._note(error, progress)
        raise error

    def _error(self, answer: JobAnswer, progress: tuple[int, ...]) -> VsenseError:
        if "error" in answer:
            return SimulatedRunError(self.named(answer["error"]), answer["exit_code"])
        if "refused" in answer:
            return SimError(self.named(answer["refused"]))
        if "ended" in answer:
            return SimError(f"the process that simulates {describe_exit(answer['ended'])}")
        if "hung_s" in answer:
            return SimError(f"{self._who(progress)} did not return within {answer['hung_s']:g} s")
        how = describe_exit(os.waitstatus_to_exitcode(answer["status"]))
        return SimError(f"{self._who(progress)} {how}{answer['place']}")

    def _note(self, error: VsenseError, progress: tuple[int, ...]) -> None:
        """Adds an error to the events of the run, if they are kept."""
        if self.job.directory is None:
            return
        time_s = round(max(progress[0] - WARM_UP_TIMESTEPS, 0) * self.experiment.timestep_s, 9)
        with suppress(VsenseError):  # the first one counts
            log = EventLog(Path(self.job.directory) / LOGGED)
            log.add(time_s, str(error), "trouble")
            log.close()

    def _who(self, progress: tuple[int, ...]) -> str:
        """Names the controller that is running, and the timestep.

        `progress`: the newest timestep, 1 + the robot that is in its control step, a number among
        those of its controller, and the controller.
        """
        experiment = self.experiment
        timestep, robot, number = progress
        if timestep < WARM_UP_TIMESTEPS:
            when = "before the first timestep"
        else:
            time_s = (timestep - WARM_UP_TIMESTEPS) * experiment.timestep_s
            when = f"in timestep {timestep - WARM_UP_TIMESTEPS} (t = {time_s:g} s)"
        if not robot:
            return self.named(f"outside of any controller, {when}, the simulation")
        if number >= LOADING:
            return self.named(f"{when}: {_loaded(experiment, number)}, when it was loaded,")
        if number >= LOOP_FUNCTION:
            function, loop = FUNCTIONS[number - LOOP_FUNCTION], experiment.loop_functions
            assert loop is not None
            return self.named(f"{when}: loop functions '{loop.label}' ({loop.path}): {function}")
        controller = experiment.controllers[number]
        spec = [r for r in experiment.robots if r.controller == controller.id][robot - 1]
        return self.named(f"robot {spec.tag}, {when}: its controller '{controller.library}'")


def record_of(result: dict[str, Any], ended: str = "") -> RunRecord:
    """What there was of a run with this result; `ended`: why, where it is not complete."""
    ended = "time" if result["complete"] else ended or "interrupted"
    names = ("changes", "complaints", "failed")
    return RunRecord(ended=ended, **{name: result[name] for name in names})


def libraries_of(experiment: Experiment) -> dict[str, str]:
    """The shared objects of its controllers, by id, as jobs have them; see `shared_objects`."""
    return {name: str(path) for name, path in shared_objects(experiment).items()}


def _loaded(experiment: Experiment, number: int) -> str:
    """Names what is loaded, whose static objects are made then; `number`: see `LOADING`."""
    if number == LOADING_LOOP:
        assert experiment.loop_functions is not None
        return f"loop functions '{experiment.loop_functions.label}'"
    controller = experiment.controllers[number - LOADING]
    return f"controller '{controller.id}' ({controller.library})"
