"""A Thymio in the lab: a terminal with a dongle behind it that speaks Aseba's protocol.

It has the Thymio's variables, and runs what its driver loads into its virtual machine, as far as
that needs it; its radio takes no time. See `Link` in `_links.py`.

Source: numbers of messages and instructions, and their layout: Mobsya/aseba 78225eb
aseba/common/consts.h, aseba/common/msg/msg.cpp, aseba/vm/vm.c; variables and 16.6 cm/s at a target
of 500: aseba/targets/playground/robots/thymio2.
"""

from __future__ import annotations

import os
import struct

from vsense.base.native import lib
from vsense.base.shared import LabError
from vsense.modes.lab._links import FirmwareKind, Outputs, PseudoTerminal, soonest
from vsense.world.robot_models import RobotModel

LIST_NODES, GET_NODE_DESCRIPTION = 0xA011, 0xA010
SET_BYTECODE, RUN, GET_VARIABLES, SET_VARIABLES = 0xA001, 0xA003, 0xA00B, 0xA00C
DESCRIPTION, NAMED_VARIABLE, LOCAL_EVENT, NATIVE, VARIABLES, PRESENT = (
    *(0x9000, 0x9001, 0x9002, 0x9003, 0x9005),
    0x900C,
)
_NAMES = (
    "_id 1,event.source 1,event.args 32,_productId 1,_fwversion 2,button.backward 1,button.left 1"
    ",button.center 1,button.forward 1,button.right 1,prox.horizontal 7,prox.comm.rx 1"
    ",prox.comm.tx 1,prox.ground.ambiant 2,prox.ground.reflected 2,prox.ground.delta 2"
    ",motor.left.target 1,motor.right.target 1,motor.left.speed 1,motor.right.speed 1"
    ",motor.left.pwm 1,motor.right.pwm 1,acc 3,temperature 1,rc5.address 1,rc5.command 1"
    ",mic.intensity 1,mic.threshold 1,timer.period 2,sd.present 1"
)
_SIZES = {name: int(size) for name, size in (pair.split() for pair in _NAMES.split(","))}
_EVENTS = (
    *(f"button.{where}" for where in ("backward", "left", "center", "forward", "right")),
    *("buttons", "prox", "prox.comm", "tap", "acc", "mic", "sound.finished", "temperature"),
    *("rc5", "motor", "timer0", "timer1"),
)
NODE = 41
MOST_VARIABLES = 620
_INIT, _LOCAL = 0xFFFF, 0xFFFE
"""The event of its start, and the first one of its own, from which they go down."""
_VERSION, _BYTECODE, _STACK = 5, 1534, 32
_UNIT_M_S = 0.166 / 500
_HEAD = struct.Struct("<3H")
RING = 7
"""Its sensors: five ahead from the left, two behind."""


class Dongle(PseudoTerminal):
    """A Thymio behind a pseudo-terminal that outlives its daemons; see `Link`.

    Attributes:
        plugged: its radio is heard; a test breaks it.
        at: where a variable begins.
        memory: the virtual machine's, unsigned words.
    """

    def __init__(self, kind: FirmwareKind, model: RobotModel) -> None:
        """Raises LabError where the model's sensors are no Thymio's, OSError without a terminal."""
        if len(model.ring.places_m) != RING:
            raise LabError(
                f"a robot whose base is a Thymio's has {RING} proximity sensors, and the model"
                f' {model.name!r} has {len(model.ring.places_m)}: vs:model="thymio2"'
            )
        super().__init__(kind)
        self.plugged = True
        self._unit_steps_s = _UNIT_M_S / model.step_m
        self.at, total = dict[str, int](), 0
        for name, size in _SIZES.items():
            self.at[name] = total
            total += size
        self.memory = [0] * MOST_VARIABLES
        self._code: dict[int, int] = {}
        self._data = b""
        self._timer_ns: int | None = None
        self._targets = (0, 0)

    def readable(self) -> int | None:
        return self.master

    def receive(self, now_ns: int) -> None:
        self._data += os.read(self.master, 4096)
        while len(self._data) >= _HEAD.size:
            length, _, number = _HEAD.unpack_from(self._data)
            if len(self._data) < _HEAD.size + length:
                break
            payload = self._data[_HEAD.size : _HEAD.size + length]
            self._data = self._data[_HEAD.size + length :]
            if self.plugged:
                self.take(number, payload, now_ns)
        self.due_ns = now_ns

    def advance(self, now_ns: int) -> list[Outputs]:
        period_ms = self.memory[self.at["timer.period"]]
        if period_ms and self._timer_ns is None:
            self._timer_ns = now_ns + period_ms * 1_000_000
        elif self._timer_ns is not None and now_ns >= self._timer_ns:
            self._timer_ns += period_ms * 1_000_000
            self._event(_LOCAL - _EVENTS.index("timer0"))
            if self._targets != self.targets:
                self._move(now_ns)
        done = self.program.advance(now_ns)
        self.due_ns = soonest(self.program.due_ns(), self._timer_ns)
        return done

    def faults(self) -> dict[str, int]:
        return {}

    @property
    def targets(self) -> tuple[int, int]:
        """What its motors shall do: left, right."""
        left = self.at["motor.left.target"]
        return _signed(self.memory[left]), _signed(self.memory[left + 1])

    def take(self, number: int, payload: bytes, now_ns: int) -> None:
        """What the robot does with a message."""
        words = struct.unpack(f"<{len(payload) // 2}H", payload[: len(payload) // 2 * 2])
        if number == LIST_NODES:
            self._say(PRESENT, struct.pack("<H", _VERSION))
        elif words[:1] != (NODE,):
            return
        elif number == GET_NODE_DESCRIPTION:
            self._describe()
        elif number == SET_BYTECODE:
            self._code |= {words[1] + i: word for i, word in enumerate(words[2:])}
        elif number == RUN:
            self._event(_INIT)
        elif number == SET_VARIABLES:
            self.memory[words[1] : words[1] + len(words) - 2] = words[2:]
            if words[1] == self.at["motor.left.target"]:
                self._move(now_ns)
        elif number == GET_VARIABLES:
            self._sense()
            start, count = words[1:3]
            values = self.memory[start : start + count]
            self._say(VARIABLES, struct.pack(f"<{len(values) + 1}H", start, *values))

    def _describe(self) -> None:
        counts = (len(_SIZES), len(_EVENTS), 1)
        head = struct.pack("<7H", _VERSION, _BYTECODE, _STACK, MOST_VARIABLES, *counts)
        self._say(DESCRIPTION, _text("thymio-II") + head)
        for name, size in _SIZES.items():
            self._say(NAMED_VARIABLE, struct.pack("<H", size) + _text(name))
        for name in _EVENTS:
            self._say(LOCAL_EVENT, _text(name) + _text("?"))
        self._say(NATIVE, _text("leds.top") + _text("?") + struct.pack("<H", 0))

    def _say(self, number: int, payload: bytes) -> None:
        self.write(_HEAD.pack(len(payload), NODE, number) + payload)

    def _sense(self) -> None:
        ring, ground = self.at["prox.horizontal"], self.at["prox.ground.delta"]
        self.memory[ring : ring + RING] = [max(int(r), 0) for r in self.program.proximity[:RING]]
        measured = self.program.state.body.inputs.ground
        self.memory[ground : ground + 2] = [measured[0], measured[2]]

    def _event(self, number: int) -> None:
        """Runs the code of an event, as vm.c does: its table comes first, its length before it."""
        vectors = {self._code[at]: self._code[at + 1] for at in range(1, self._code.get(0, 1), 2)}
        at, stack = vectors.get(number), list[int]()
        while at is not None:
            code = self._code[at]
            kind, rest = code >> 12, code & 0xFFF
            at += 1
            if kind == 0:
                return
            if kind == 1:
                stack.append((rest ^ 0x800) - 0x800)
            elif kind == 3:
                stack.append(_signed(self.memory[rest]))
            elif kind == 4:
                self.memory[rest] = stack.pop() & 0xFFFF
            elif code == 0x8004:
                stack.append(stack.pop() * stack.pop())
            else:
                raise LabError(f"the lab's Thymio does not know the instruction {code:04x}")

    def _move(self, now_ns: int) -> None:
        target, speed = self.at["motor.left.target"], self.at["motor.left.speed"]
        self._targets = self.targets
        self.memory[speed : speed + 2] = self.memory[target : target + 2]
        left, right = (round(target * self._unit_steps_s) for target in self._targets)
        lib.fw_wheels_drive(self.program.state, left, right, now_ns // 1000)


def _text(text: str) -> bytes:
    return bytes([len(text)]) + text.encode()


def _signed(word: int) -> int:
    return (word ^ 0x8000) - 0x8000
