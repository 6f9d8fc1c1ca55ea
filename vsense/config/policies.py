"""What robots with a learnt policy observe and do, number by number: the same in the environment in
which it learns (`vsense.parallel_env`), in `robot/policy.c`, and here, where its sizes are checked.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import instead
from vsense.base.xml.element import Element
from vsense.config.specs import ControllerSpec
from vsense.robots.policy import PolicyError, read_policy
from vsense.world.sensors.base import layout_dtype, scale_of

SpaceBounds = tuple[NDArray[np.float64], NDArray[np.float64]]

_RING, _RING_NUMBERS, _RING_RAW = "proximity", 8, 4096.0
_WHEELS = ("left wheel", "right wheel")
_MOST_ACTUATORS, _MOST_BYTES = 8, 255
"""Source: robot/policy.h, robot/policy.c."""


def observed(spec: ControllerSpec) -> dict[str, SpaceBounds]:
    """The least and the most of each number that is observed, by the name of its sensor.

    Virtual sensors come in the order of the file, and the ring of proximity sensors after them,
    where the file has it: whether it is the robots' own or a virtual one depends on the command.
    """
    bounds = dict[str, SpaceBounds]()
    for mounted in spec.sensors:
        sensor = mounted.sensor
        (count, _), scale = layout_dtype(sensor.layout), scale_of(sensor)
        low, high = (np.broadcast_to(edge, count) for edge in (scale.low, scale.high))
        bounds[sensor.name.removeprefix("+")] = low, high
    ring = bounds.pop(_RING, None)
    if ring is None and any(device.element.endswith(_RING) for device in spec.devices):
        ring = np.zeros(_RING_NUMBERS), np.full(_RING_NUMBERS, _RING_RAW)
    return bounds if ring is None else {**bounds, _RING: ring}


def checked(element: Element, spec: ControllerSpec) -> ControllerSpec:
    """Gives a controller, whose policy fits what its robots observe and do if it is one.

    Raises:
        ConfigError: it does not, is none, or has a parameter of another form.
    """
    if not spec.program.is_policy:
        return spec
    try:
        policy = read_policy(spec.program.sources[0])
    except PolicyError as error:
        raise element.error(str(error), "library") from None
    sensors = {name: len(low) for name, (low, _) in observed(spec).items()}
    actuators = _actuators(element, spec.params)
    offered = [mounted.actuator.name for mounted in spec.actuators]
    for name in actuators:
        if name not in offered:
            words = f"its parameter 'actuators' names {name!r}; {instead(name, offered)}"
            raise element.error(words)
    acts = [*_WHEELS, *actuators, *_leds(element, spec.params)]
    if (policy.inputs, policy.outputs) == (sum(sensors.values()), len(acts)):
        return spec
    raise element.error(
        f"{spec.library} takes an observation of {policy.inputs} numbers and gives an action of"
        f" {policy.outputs}; its robots observe {sum(sensors.values())}"
        f" ({', '.join(f'{name} {count}' for name, count in sensors.items()) or 'no sensor'}) and"
        f" act by {len(acts)} ({', '.join(acts)}); <params actuators='NAME LOW HIGH' leds='1'> adds"
        " to these",
        "library",
    )


def _actuators(element: Element, params: Mapping[str, str]) -> list[str]:
    """The names of the virtual actuators that `actuators` has; raises ConfigError."""
    text = params.get("actuators", "")
    words = text.replace(",", " ").split()
    names, edges = words[::3], [*words[1::3], *words[2::3]]
    is_short = len(names) <= _MOST_ACTUATORS and len(text.encode()) <= _MOST_BYTES
    if len(words) % 3 or not is_short or not all(map(_is_number, edges)):
        raise element.error(
            f"its parameter 'actuators' is {text!r}, expected NAME LOW HIGH of each virtual"
            f" actuator that the policy sets, of at most {_MOST_ACTUATORS}"
        )
    return names


def _leds(element: Element, params: Mapping[str, str]) -> list[str]:
    text = params.get("leds", "0").strip()
    if text not in ("0", "1"):
        raise element.error(f"its parameter 'leds' is {text!r}, expected 0 or 1")
    return ["LEDs"] * (text == "1")


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word))) and "_" not in word
    except ValueError:
        return False
