"""Learnt policies: an `.onnx` file as a controller in C, which `robot/policy.c` steps.

A policy is compiled as any other controller. The C file is made anew for each build: what is kept,
sent and told by its digest is the `.onnx` file. Weights are data, and nothing of the file is run.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.errors import UsageError, VsenseError, failing_as, instead
from vsense.base.files import read_bytes, replace_bytes
from vsense.robots._onnx import MOST_BYTES, read_graph
from vsense.robots._policy_graph import PolicyGraph, PolicyStep
from vsense.robots.sources import MAX_NAME_BYTES

_ACTIVATIONS = {"tanh": "Tanh", "sigmoid": "Sigmoid", "relu": "Relu"}
_IR_VERSION, _OPSET = 8, 13
_FLOAT = 1


class PolicyError(VsenseError):
    """A file is no policy that can be run; the message names it, and what was expected."""


@dataclass(frozen=True, slots=True)
class Policy:
    """What a network calculates in a control step, in the order of calculation.

    Attributes:
        inputs: numbers of an observation, which come first in its memory.
        outputs: numbers of an action.
        action: where in memory they begin.
        memory: numbers that it works with.
    """

    inputs: int
    outputs: int
    action: int
    memory: int
    steps: Sequence[PolicyStep]

    def c_source(self, name: str) -> str:
        """The controller of this name, in C for `robot/policy.h`."""
        weights = [w.tolist() for s in self.steps if (w := s.weights) is not None]
        flat = [f"{float.hex(w)}f" for own in weights for w in own] or ["0.0f"]
        rows, at = [], 0
        for step in self.steps:
            place = -1 if step.weights is None else at
            at += 0 if step.weights is None else step.weights.size
            sizes = f"{step.start}, {step.operand}, {step.target}, {step.inputs}, {step.outputs}"
            rows.append(f"    {{VS_POLICY_{step.op.name}, {sizes}, {place}}}")
        lines = (", ".join(flat[n : n + 6]) for n in range(0, len(flat), 6))
        return _SOURCE.format(
            name=_c_text(name),
            weights=",\n    ".join(lines),
            steps=",\n".join(rows),
            count=len(rows),
            inputs=self.inputs,
            outputs=self.outputs,
            action=self.action,
            memory=self.memory,
        )


_SOURCE = """\
#include "policy.h"

static const float weights[] = {{
    {weights}
}};

static const struct vs_policy_step steps[] = {{
{steps}
}};

static const struct vs_policy policy = {{
    {name}, steps, {count}, {inputs}, {outputs}, {action}, weights
}};

struct state {{
    struct vs_policy_state policy;
    float memory[{memory}];
}};

static void init(void *state, struct vs_robot *robot)
{{
    struct state *s = state;

    vs_policy_init(&s->policy, &policy, robot);
}}

static void step(void *state, struct vs_robot *robot)
{{
    struct state *s = state;

    vs_policy_step(&s->policy, &policy, s->memory, robot);
}}

const struct vs_controller vs_controller = {{{name}, sizeof(struct state), init, step, NULL}};
"""


def _c_text(name: str) -> str:
    """A name as a literal in C, as long as a controller's may be."""
    text = name.encode()[:MAX_NAME_BYTES].decode(errors="ignore").encode()
    plain = (chr(n) if chr(n).isalnum() and n < 128 else f"\\{n:03o}" for n in text)
    return f'"{"".join(plain)}"'


def read_policy(path: Path) -> Policy:
    """Reads an `.onnx` file.

    Its first input is the observation, its first output the action. Further inputs are what it
    remembers: zeros at first, then the outputs of the same places.

    Raises:
        PolicyError: it cannot be read, is damaged, or holds what is not supported: the node, its
            operator, and what is supported instead.
    """
    with failing_as(PolicyError, f"{path}: cannot be read"):
        data = read_bytes(path, MOST_BYTES)
    try:
        graph = PolicyGraph(read_graph(data))
    except ValueError as error:
        raise PolicyError(f"{path}: {error}") from None
    return Policy(graph.inputs, graph.outputs, graph.action, graph.memory, graph.steps)


def c_of(path: Path) -> str:
    """A policy's controller in C; raises as `read_policy`."""
    return read_policy(path).c_source(path.stem)


def write_c(path: Path, target: Path) -> Path:
    """Writes what `c_of` gives to a file, which is returned; raises as `read_policy`."""
    target.write_text(c_of(path))
    return target


def save_policy(
    file: str | Path, layers: Iterable[tuple[ArrayLike, ArrayLike, str | None]]
) -> None:
    """Writes a multi-layer perceptron as an `.onnx` file, without any other library.

    Args:
        file: where it goes; what was there is replaced.
        layers: weights (inputs, outputs), biases (outputs,), and the function of their sums:
            "tanh", "sigmoid", "relu", or None.

    Raises:
        UsageError: layers do not fit each other, or hold what is no number.
        VsenseError: it cannot be written.
    """
    value, nodes, constants, width, first = "observation", b"", b"", 0, 0
    for number, (given, bias, function) in enumerate(layers, 1):
        weights, biases = (np.asarray(array, np.float32) for array in (given, bias))
        _check_layer(number, weights, biases, width)
        if function is not None and function not in _ACTIVATIONS:
            words = instead(function, _ACTIVATIONS)
            raise UsageError(f"layer {number}: there is no function {function!r}; {words}, or None")
        first, width = first or weights.shape[0], weights.shape[1]
        names = [f"weights_{number}", f"biases_{number}"]
        constants += b"".join(map(_tensor, names, (weights, biases)))
        nodes += _node("Gemm", [value, *names], f"sums_{number}")
        value = f"sums_{number}"
        if function is not None:
            nodes += _node(_ACTIVATIONS[function], [value], f"outputs_{number}")
            value = f"outputs_{number}"
    if not nodes:
        raise UsageError("a policy has one layer at least")
    graph = nodes + _field(2, b"policy") + constants
    graph += _field(11, _shaped("observation", first)) + _field(12, _shaped(value, width))
    model = _field(1, _IR_VERSION) + _field(2, b"vsense") + _field(7, graph)
    with failing_as(VsenseError, f"{file}: cannot be written"):
        replace_bytes(Path(file), model + _field(8, _field(1, b"") + _field(2, _OPSET)))


def _check_layer(
    number: int,
    weights: NDArray[np.float32],
    biases: NDArray[np.float32],
    width: int,
) -> None:
    """Raises UsageError where a layer is none, or does not fit the `width` of that before it."""
    if weights.ndim != 2 or 0 in weights.shape or biases.shape != weights.shape[1:]:
        shapes = f"weights {weights.shape} and biases {biases.shape}"
        raise UsageError(f"layer {number}: {shapes}, expected (inputs, outputs) and (outputs,)")
    if width not in (0, weights.shape[0]):
        words = f"it has {weights.shape[0]} inputs, and the layer before it {width} outputs"
        raise UsageError(f"layer {number}: {words}")
    if not (np.isfinite(weights).all() and np.isfinite(biases).all()):
        raise UsageError(f"layer {number}: expected finite numbers")


def _varint(value: int) -> bytes:
    high = value >> 7
    return bytes([value & 127 | 128]) + _varint(high) if high else bytes([value])


def _field(number: int, value: int | bytes) -> bytes:
    """A field of a protocol buffer: a whole number, or bytes."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def _node(operator: str, inputs: Sequence[str], output: str) -> bytes:
    fields = [_field(1, name.encode()) for name in inputs]
    fields += [_field(2, output.encode()), _field(3, output.encode()), _field(4, operator.encode())]
    return _field(1, b"".join(fields))


def _tensor(name: str, values: NDArray[np.float32]) -> bytes:
    shape = b"".join(_field(1, size) for size in values.shape)
    raw = np.ascontiguousarray(values, "<f4").tobytes()
    return _field(5, shape + _field(2, _FLOAT) + _field(8, name.encode()) + _field(9, raw))


def _shaped(name: str, width: int) -> bytes:
    sizes = b"".join(_field(1, _field(1, size)) for size in (1, width))
    return _field(1, name.encode()) + _field(2, _field(1, _field(1, _FLOAT) + _field(2, sizes)))
