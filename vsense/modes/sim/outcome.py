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
from vsense.run.verdict import BROKEN, RunRecord

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


class SimulatedRunError(SimError):
    """A run has failed: an error in its own process, a crash, an endless loop.

    Attributes:
        task: the run.
        result: what there is of it, as that of a run that has not.
    """

    def __init__(self, text: str, exit_code: int, task: Task, result: dict[str, Any]) -> None:
        super().__init__(text)
        self.exit_code, self.task, self.result = exit_code, task, result


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
        if "refused" in answer:
            raise SimError(self.named(answer["refused"]))
        words, timesteps = self._words(answer, progress), max(progress[0] - WARM_UP_TIMESTEPS, 0)
        self._note(self.named(words), timesteps)
        result = {"name": self.experiment.name, "robots": len(self.experiment.robots)}
        result |= {"timesteps": timesteps, "timestep_s": self.experiment.timestep_s, "wall_s": None}
        result |= {"swarm": {}, "measures": {}, "complete": False, "ended": BROKEN, "changes": 0}
        result |= {"complaints": [], "failed": [words], "recording": None}
        code = answer.get("exit_code", SimError.exit_code)
        raise SimulatedRunError(self.named(words), code, self, result)

    def _words(self, answer: JobAnswer, progress: tuple[int, ...]) -> str:
        if "error" in answer:
            return str(answer["error"])
        if "ended" in answer:
            return f"the process that simulates {describe_exit(answer['ended'])}"
        if "hung_s" in answer:
            return f"{self._who(progress)} did not return within {answer['hung_s']:g} s"
        how = describe_exit(os.waitstatus_to_exitcode(answer["status"]))
        return f"{self._who(progress)} {how}{answer['place']}"

    def _note(self, words: str, timesteps: int) -> None:
        """Adds an error to the events of the run, if they are kept."""
        if self.job.directory is None:
            return
        with suppress(VsenseError):  # the first one counts
            log = EventLog(Path(self.job.directory) / LOGGED)
            log.add(round(timesteps * self.experiment.timestep_s, 9), words, "trouble")
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
            return f"outside of any controller, {when}, the simulation"
        if number >= LOADING:
            return f"{when}: {_loaded(experiment, number)}, when it was loaded,"
        if number >= LOOP_FUNCTION:
            function, loop = FUNCTIONS[number - LOOP_FUNCTION], experiment.loop_functions
            assert loop is not None
            return f"{when}: loop functions '{loop.label}' ({loop.path}): {function}"
        controller = experiment.controllers[number]
        spec = [r for r in experiment.robots if r.controller == controller.id][robot - 1]
        return f"robot {spec.tag}, {when}: its controller '{controller.library}'"


def record_of(result: dict[str, Any], ended: str = "") -> RunRecord:
    """What there was of a run with this result; `ended`: why, where it is not complete."""
    ended = "time" if result["complete"] else ended or result.get("ended", "interrupted")
    facts = {name: result[name] for name in ("changes", "complaints", "failed")}
    return RunRecord(ended=ended, timesteps=result["timesteps"] > 0, **facts)


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
