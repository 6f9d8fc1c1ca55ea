"""What controllers ask for and nobody offers, and what they are told and do not read.

Each program is loaded into a process of its own, begins a run as one robot, and makes one control
step: what it has asked for until then is known before anything starts. `robot/params.c`,
`robot/robot.c` and `robot/inprocess.c` have the words of its complaints.

What cannot be found out here, without a compiler or of a program that fails at once, is no error
here. Nor is a parameter whose name stands in the sources, which may be read in some cases only; nor
a name that is right on a robot with a certain board. No robot's daemon stops for any of it.
"""

from __future__ import annotations

import json
import os
import re
import select
import signal
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

import numpy as np

from vsense.base.errors import ConfigError, VsenseError, instead
from vsense.base.readings import SensorReadings
from vsense.config.argos import OWN_DEVICES
from vsense.config.specs import ControllerSpec, Experiment, Stage
from vsense.robots import build
from vsense.robots.compiling import BuildError
from vsense.robots.inprocess import ACT_NS, ProgramSetup
from vsense.robots.link.table import Direction
from vsense.robots.link.wire import Wanted
from vsense.robots.program import ProgramOpener, kind_of
from vsense.robots.sources import ProgramSources, content
from vsense.run.environment import table_of
from vsense.world.actuators.bank import ActuatorBank
from vsense.world.sensors.bank import SensorBank
from vsense.world.world import NEVER_NS

FIRST_STEP_TIMEOUT_S = 3.0
"""A program that takes longer for its first step is left to the run, which says so."""

_TAG = 1
_BOARDS = {own.name for section in OWN_DEVICES.values() for own in section.values() if own.board}
"""Names that a robot's board may offer."""

_WORDS = {
    "sensor": re.compile(r"controller '.*': nobody offers the sensor '(.*)'"),
    "virtual actuator": re.compile(r"controller '.*': nobody offers the virtual actuator '(.*)'"),
    "number": re.compile(r"controller '.*': expected a number(?P<range>.*) as parameter '(.*)'"),
    "parameter": re.compile(r"controller '.*' does not know the parameter '(.*)': ignored"),
}
_READS = re.compile(
    rb'(?:\bvs_robot_param(?:_in|_text)?\s*\(\s*\w+\s*,|\.param(?:_text)?\()\s*"([^"\n]+)"'
)


def check(experiment: Experiment) -> None:
    """Refuses what is asked for in vain, and parameters that nobody reads or that are no numbers.

    Raises:
        ConfigError: it names the controller's line, the name, and what may be meant.
    """
    for spec in experiment.controllers:
        for complaint in _complaints(experiment, spec):
            message = _refusal(experiment, spec, complaint)
            if message is not None:
                raise ConfigError(experiment.file, spec.line, f"<{spec.label}>: {message}")


def _refusal(experiment: Experiment, spec: ControllerSpec, complaint: str) -> str | None:
    """What is wrong in an experiment where a controller complains so; None: nothing."""
    for kind, words in _WORDS.items():
        match = words.fullmatch(complaint)
        if match is None:
            continue
        *_, name = match.groups()
        if kind == "number":
            wrong = f"its parameter {name!r} is {spec.params[name]!r}"
            return f"{wrong}, expected a number{match['range']}"
        if kind == "parameter":
            names = None if _stands_in(spec, name) else [p for p in _parameters(spec) if p != name]
            wrong = f"its program reads no parameter {name!r}"
        else:
            real = experiment.stage is Stage.RUN and name in _BOARDS
            names = None if real else _offered(spec, kind)
            wrong = f"its program asks for the {kind} {name!r}, which nobody offers"
        return None if names is None else f"{wrong}; {instead(name, names)}"
    return None


def _stands_in(spec: ControllerSpec, name: str) -> bool:
    """Whether a name stands in quotes in the program's own sources."""
    quoted = f'"{name}"'.encode()
    return any(quoted in content(path) for path in spec.program.own_files())


def _parameters(spec: ControllerSpec) -> list[str]:
    """The parameters that a program reads, as far as its sources show it; with those of walk.h, or
    those of policies."""
    ours = build.source_tree().root / "robot"
    ours /= "policy.c" if spec.program.is_policy else "walk.c"
    names = [n for path in [*spec.program.own_files(), ours] for n in _READS.findall(content(path))]
    return [name.decode(errors="replace") for name in names]


def _offered(spec: ControllerSpec, kind: str) -> list[str]:
    """The sensors, or the virtual actuators, that a program can have."""
    if kind != "sensor":
        return [mounted.actuator.name for mounted in spec.actuators]
    own = [device.name for device in OWN_DEVICES["sensors"].values()]
    return [*own, *(mounted.sensor.name.removeprefix("+") for mounted in spec.sensors)]


def _complaints(experiment: Experiment, spec: ControllerSpec) -> Sequence[str]:
    """What a controller complains of in its first step; nothing where it cannot be tried."""
    sensors = SensorBank(spec.sensors, [_TAG])
    actuators = ActuatorBank(spec.actuators, [_TAG], first_id=len(sensors.table) + 1)
    params = spec.params_for(next(iter(experiment.driven_by(spec)), ""))
    with suppress(BuildError):
        built = kind_of(spec.program).build(spec.program)
        table = table_of(sensors, actuators)
        setup = ProgramSetup(built, [_TAG], table, experiment.timestep_ns, 1, params)
        length_ns = str(experiment.timestep_ns)
        question = ["complaints", str(built), table.encode().hex(), params, length_ns]
        ask = partial(_try, spec.program, setup)
        # What is no build of its own says nothing else only as long as nobody edits it.
        edited = built in spec.program.sources
        with suppress(_Untried):
            return [said[1:] for said in (ask() if edited else build.known(question, ask, []))]
    return ()


class _Untried(Exception):
    """A program has ended, or taken too long, before it said anything."""


def _try(sources: ProgramSources, setup: ProgramSetup) -> list[str]:
    """What a program complains of, as `_step` in a fork of this process has it; raises _Untried."""
    source, target = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            # Neither what it prints nor what it does to this process is for anybody.
            silent = os.open(os.devnull, os.O_RDWR)
            for descriptor in range(3):
                os.dup2(silent, descriptor)
            said = _step(kind_of(sources).open, setup)
            os.write(target, json.dumps([f" {words}" for words in said]).encode())
        finally:
            os._exit(0)
    os.close(target)
    try:
        if not (answer := _answer(source)):
            raise _Untried
        return list(json.loads(answer))
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(source)


def _answer(source: int) -> bytes:
    """What comes out of a pipe until its end; nothing where that takes too long."""
    data = b""
    while select.select([source], [], [], FIRST_STEP_TIMEOUT_S)[0]:
        part = os.read(source, 65536)
        if not part:
            return data
        data += part
    return b""


def _step(open_program: ProgramOpener, setup: ProgramSetup) -> list[str]:
    """Lets one robot begin a run; returns what its controller complains of."""
    try:
        robots = open_program(setup)
        sizes = [size for *_, size in setup.table.of_direction(Direction.SENSOR)]
        block = np.zeros((1, sum(sizes)), dtype=np.uint8)
        readings = SensorReadings([_TAG], sizes, block, np.full((1, len(sizes)), NEVER_NS))
        times_ns = setup.timestep_ns, setup.timestep_ns + ACT_NS
        robots.step(Wanted.RUN, 0, 0, times_ns, readings, np.zeros((1, 8), dtype=np.int16))
    except VsenseError:
        return []
    return robots.complaints()
