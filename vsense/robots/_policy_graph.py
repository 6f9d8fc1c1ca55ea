"""Turns an ONNX graph into the steps of `robot/policy.c`.

A value that is calculated is an array of places in the policy's memory, in the value's shape: what
exporters put around layers to reshape, cut and join is done to these arrays here, once, and costs
robots nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.robots import _onnx_shapes
from vsense.robots._onnx import MOST_NUMBERS, Constant, OnnxGraph, OnnxNode, shown
from vsense.robots._onnx_shapes import MOST_MEMORY, check_count

Places = NDArray[np.intp]

_MOST_STEPS = 4096


class Op(IntEnum):
    """`enum vs_policy_op`."""

    DENSE = 0
    ADD = 1
    SUB = 2
    MUL = 3
    DIV = 4
    CLIP = 5
    RELU = 6
    TANH = 7
    SIGMOID = 8
    COPY = 9


@dataclass(frozen=True, slots=True)
class PolicyStep:
    """`struct vs_policy_step`; `weights` are its own ones, flat, None: it has none."""

    op: Op
    start: int
    operand: int
    target: int
    inputs: int
    outputs: int
    weights: NDArray[np.float32] | None


class PolicyGraph:
    """Reads a graph, node by node.

    Attributes:
        steps: of one control step, the last of which keep what is remembered for the next one.
        memory: numbers that they work with, the observation first.
        action: place of the first number of an action; `outputs` of them.
    """

    def __init__(self, graph: OnnxGraph) -> None:
        """Reads it; ValueError: it holds what cannot be run, and which node it is."""
        self.steps: list[PolicyStep] = []
        self.memory = self._weights = 0
        self._places: dict[str, Places] = {}
        self._constants = dict(graph.constants)
        self._kept: list[tuple[Places, Places]] = []
        if not graph.inputs or not graph.outputs:
            raise ValueError("has no input, or no output: expected an observation and an action")
        for name, shape in graph.inputs.items():
            self._places[name] = self._room(*shape)
        self.inputs = self._places[next(iter(graph.inputs))].size
        states = [*graph.inputs][1:]
        if len(graph.outputs) <= len(states):
            words = "has the input {}, and no output of that place: a state that goes in comes out"
            raise ValueError(words.format(shown(states[-1])))
        wanted = graph.outputs[: 1 + len(states)]
        for node in _needed(graph, wanted):
            self._read(node)
        missing = [name for name in wanted if name not in self._places]
        if missing:
            raise ValueError(f"calculates no output {shown(missing[0])} from the observation")
        self._kept += [(self._places[i], self._places[o]) for i, o in zip(states, wanted[1:])]
        action = self._places[wanted[0]]
        self.outputs, self.action = action.size, self._saved(action)
        self._keep()

    def _keep(self) -> None:
        """Copies what has been calculated to where the next control step finds it."""
        starts = []
        for old, new in self._kept:
            if old.size != new.size:
                raise ValueError(f"has a state of {old.size} numbers that comes out as {new.size}")
            starts.append(self._saved(new))
        for start, (old, _) in zip(starts, self._kept):
            self._add(PolicyStep(Op.COPY, start, 0, self._start(old), old.size, old.size, None))

    def _saved(self, places: Places) -> int:
        """Where numbers lie in a row that `_keep` does not write over."""
        states = {place for old, _ in self._kept for place in old.flat}
        is_kept = states.isdisjoint(places.flat)
        return self._start(places if is_kept else self._emit(Op.COPY, places.size, places))

    def _read(self, node: OnnxNode) -> None:
        if node.operator not in _READERS:
            known = ", ".join(sorted(_READERS))
            raise ValueError(f"{node}: this operator is not supported; supported are {known}")
        for name in node.inputs:
            if name and name not in self._places and name not in self._constants:
                raise ValueError(f"{node}: nothing before it gives {shown(name)}")
        try:
            with np.errstate(all="ignore"):  # what is no number is told where it becomes a weight
                _READERS[node.operator](self, node)
        except KeyError as error:
            raise ValueError(f"{node}: its attribute {error} is missing") from None
        except ValueError as error:
            raise ValueError(f"{node}: {error}") from None
        except (IndexError, TypeError, OverflowError, AttributeError) as error:
            raise ValueError(f"{node}: its inputs or attributes are damaged ({error})") from None

    def _room(self, *shape: int) -> Places:
        """New places in memory."""
        count = math.prod(shape)
        check_count(count)
        if count > MOST_MEMORY - self.memory:
            raise ValueError(f"more than {MOST_MEMORY} numbers in all steps")
        self.memory += count
        return np.arange(self.memory - count, self.memory).reshape(shape)

    def _add(self, step: PolicyStep) -> None:
        self._weights += 0 if step.weights is None else step.weights.size
        if len(self.steps) == _MOST_STEPS or self._weights > MOST_NUMBERS:
            raise ValueError(f"more than {_MOST_STEPS} steps, or {MOST_NUMBERS} weights")
        self.steps.append(step)

    def _start(self, places: Places) -> int:
        """Where the numbers of a value lie in a row; they are copied there if they do not."""
        flat = places.ravel()
        cuts = np.flatnonzero(np.diff(flat) != 1) + 1
        if len(cuts):
            room = self._room(flat.size)
            for to, part in zip((0, *cuts), np.split(flat, cuts)):
                target = int(room[to])
                self._add(PolicyStep(Op.COPY, int(part[0]), 0, target, part.size, part.size, None))
            flat = room
        return int(flat[0])

    def _emit(
        self,
        op: Op,
        outputs: int,
        places: Places,
        operand: Places | None = None,
        weights: Constant | None = None,
    ) -> Places:
        """Adds a step; gives where its results are, in a row."""
        start = self._start(places)
        with_ = 0 if operand is None else self._start(operand)
        own = None if weights is None else weights.astype(np.float32).ravel()
        if own is not None and not np.isfinite(own).all():
            raise ValueError("its weights hold a number that is none, or too large")
        target = self._room(outputs)
        self._add(PolicyStep(op, start, with_, int(target[0]), places.size, outputs, own))
        return target

    def _dense(self, places: Places, matrix: Constant, bias: Constant) -> Places:
        """The product with a matrix (inputs, outputs), after a bias."""
        if matrix.ndim != 2 or places.size != matrix.shape[0]:
            shape = f"weights of the shape {matrix.shape}"
            raise ValueError(f"it is given {places.size} numbers, and has {shape}")
        bias = np.broadcast_to(bias, (1, matrix.shape[1]))
        return self._emit(Op.DENSE, matrix.shape[1], places, None, np.vstack((bias, matrix)))

    def _calculated(self, node: OnnxNode, at: int = 0) -> Places:
        if node.inputs[at] not in self._places:
            raise ValueError("it works on constants alone, or is given them in another order")
        return self._places[node.inputs[at]]

    def _constant(self, node: OnnxNode, at: int, default: Any = None) -> Constant:
        """An input that has to be a constant; the default where it is left out."""
        name = node.inputs[at] if at < len(node.inputs) else ""
        if not name and default is not None:
            return np.asarray(default)
        if name not in self._constants:
            raise ValueError(f"expected a constant as its input {at + 1}")
        return self._constants[name]

    def move(self, node: OnnxNode) -> None:
        """Rearranges a value, whether it is calculated or constant."""
        name = node.inputs[0]
        values: dict[str, Any] = self._places if name in self._places else self._constants
        given = [self._constants.get(other) for other in node.inputs[1:]]
        results = _onnx_shapes.moved(node, values[name], given)
        values.update(zip(node.outputs, results, strict=True))

    def concat(self, node: OnnxNode) -> None:
        values: dict[str, Any] = self._places
        if all(name in self._constants for name in node.inputs):
            values = self._constants
        if any(name not in values for name in node.inputs):
            raise ValueError("expected to join what is calculated, without constants")
        parts = [values[name] for name in node.inputs]
        check_count(sum(part.size for part in parts))
        values[node.outputs[0]] = np.concatenate(parts, node.attributes["axis"])

    def constant(self, node: OnnxNode) -> None:
        (value,) = node.attributes.values()
        kind = np.float32 if np.asarray(value).dtype.kind == "f" else np.int64
        self._constants[node.outputs[0]] = np.asarray(value, kind)

    def shape(self, node: OnnxNode) -> None:
        shape = self._calculated(node).shape
        self._constants[node.outputs[0]] = np.array(shape, np.int64)

    def filled(self, node: OnnxNode) -> None:
        """ConstantOfShape, and Expand."""
        if node.operator == "Expand":
            value, shape = self._constant(node, 0), self._constant(node, 1)
        else:
            value = node.attributes.get("value", np.zeros(1, np.float32))
            shape = self._constant(node, 0)
        whole = np.broadcast_shapes(value.shape, _onnx_shapes.few(shape))
        check_count(math.prod(whole))
        self._constants[node.outputs[0]] = np.broadcast_to(value, whole)

    def layer(self, node: OnnxNode) -> None:
        """MatMul, and Gemm."""
        places, matrix = self._calculated(node), self._constant(node, 1)
        how = node.attributes
        if how.get("transA", 0):
            raise ValueError("expected transA 0")
        matrix = matrix.T if how.get("transB", 0) else matrix
        bias = self._constant(node, 2, 0.0) * np.float32(how.get("beta", 1.0))
        matrix = matrix * np.float32(how.get("alpha", 1.0))
        if places.ndim == 0 or places.shape[-1] != places.size:
            raise ValueError(f"expected a batch of 1, got the shape {places.shape}")
        results = self._dense(places, matrix, bias)
        self._places[node.outputs[0]] = results.reshape(*places.shape[:-1], -1)

    def arithmetic(self, node: OnnxNode) -> None:
        op, (left, right) = Op[node.operator.upper()], node.inputs
        if left in self._constants and right in self._places:
            if op is Op.DIV:
                raise ValueError("expected a divisor that is constant")
            value, places = self._constants[left], self._places[right]
            if op is Op.SUB:  # c - x is -x + c, to the last bit
                minus = self._emit(Op.MUL, places.size, places, None, np.full(places.size, -1.0))
                op, places = Op.ADD, minus.reshape(places.shape)
            self._places[node.outputs[0]] = self._with_constant(op, places, value)
            return
        places = self._calculated(node)
        if right in self._constants:
            results = self._with_constant(op, places, self._constants[right])
        else:
            other = self._places[right]
            shape = np.broadcast_shapes(places.shape, other.shape)
            check_count(math.prod(shape))
            both = [np.broadcast_to(value, shape) for value in (places, other)]
            results = self._emit(op, both[0].size, *both).reshape(shape)
        self._places[node.outputs[0]] = results

    def _with_constant(self, op: Op, places: Places, value: Constant) -> Places:
        shape = np.broadcast_shapes(places.shape, value.shape)
        if math.prod(shape) != places.size:
            raise ValueError(f"expected a constant of the shape {places.shape}, got {value.shape}")
        weights = np.broadcast_to(value, shape)
        if op is Op.DIV and (weights == 0).any():
            raise ValueError("it divides by 0")
        return self._emit(op, places.size, places, None, weights).reshape(shape)

    def activation(self, node: OnnxNode) -> None:
        places, op = self._calculated(node), Op[node.operator.upper()]
        weights = None
        if op is Op.CLIP:
            most = np.finfo(np.float32).max
            ends = [node.attributes.get(n, e) for n, e in (("min", -most), ("max", most))]
            weights = np.array([self._constant(node, n + 1, e).item() for n, e in enumerate(ends)])
        results = self._emit(op, places.size, places, None, weights)
        self._places[node.outputs[0]] = results.reshape(places.shape)

    def scaler(self, node: OnnxNode) -> None:
        places = self._calculated(node)
        offset, scale = (np.float32(node.attributes[n]) for n in ("offset", "scale"))
        shifted = self._with_constant(Op.SUB, places, offset)
        self._places[node.outputs[0]] = self._with_constant(Op.MUL, shifted, scale)

    def gru(self, node: OnnxNode) -> None:
        """A gated recurrent unit, as PyTorch has it: its state is an input, or its own."""
        how, inner = dict(node.attributes), self._constant(node, 2)
        size = how.pop("hidden_size", inner.shape[-1])
        usual = {"linear_before_reset": 1, "direction": "forward", "layout": 0}
        odd = {name: value for name, value in how.items() if value != usual.get(name)}
        has_lengths = len(node.inputs) > 4 and node.inputs[4]
        if odd or has_lengths or "linear_before_reset" not in how:
            raise ValueError(f"expected a GRU as PyTorch exports it, with {usual}; got {how}")
        places, outer = self._calculated(node), self._constant(node, 1)
        if inner.shape != (1, 3 * size, size):
            raise ValueError(f"hidden_size {size}: its weights have the shape {inner.shape}")
        if places.ndim != 3 or places.shape[:2] != (1, 1) or outer.shape[:2] != (1, 3 * size):
            raise ValueError(f"expected a sequence of 1 and a batch of 1, got {places.shape}")
        both = self._constant(node, 3, np.zeros((1, 6 * size), np.float32))
        before = self._state(node, size)
        own = self._dense(places, outer[0].T, both[0, : 3 * size])
        last = self._dense(before, inner[0].T, both[0, 3 * size :])
        gates = self._emit(Op.ADD, 2 * size, own[: 2 * size], last[: 2 * size])
        gates = self._emit(Op.SIGMOID, 2 * size, gates)
        update, reset = gates[:size], gates[size:]
        new = self._emit(Op.MUL, size, reset, last[2 * size :])
        new = self._emit(Op.TANH, size, self._emit(Op.ADD, size, own[2 * size :], new))
        kept = self._emit(Op.MUL, size, self._emit(Op.SUB, size, before, new), update)
        after = self._emit(Op.ADD, size, kept, new)
        if self._is_own(node):
            self._kept.append((before, after))
        for name, shape in zip(node.outputs, ((1, 1, 1, size), (1, 1, size))):
            self._places[name] = after.reshape(shape)

    def _is_own(self, node: OnnxNode) -> bool:
        """Whether nobody hands a GRU its state: it goes on from where it was."""
        name = node.inputs[5] if len(node.inputs) > 5 else ""
        return name not in self._places

    def _state(self, node: OnnxNode, size: int) -> Places:
        if not self._is_own(node):
            before = self._places[node.inputs[5]]
            if before.size != size:
                raise ValueError(f"expected a state of {size} numbers, got {before.size}")
            return before.ravel()
        if self._constant(node, 5, 0.0).any():
            raise ValueError("expected a state that begins as zeros")
        return self._room(size)


def _needed(graph: OnnxGraph, wanted: list[str]) -> list[OnnxNode]:
    """The nodes on which outputs depend, in their order."""
    names, nodes = set(wanted), []
    for node in reversed(graph.nodes):
        if not names.isdisjoint(node.outputs):
            names.update(node.inputs)
            nodes.append(node)
    return nodes[::-1]


_READERS: dict[str, Callable[[PolicyGraph, OnnxNode], None]] = {
    **dict.fromkeys(_onnx_shapes.MOVES, PolicyGraph.move),
    **dict.fromkeys(("Expand", "ConstantOfShape"), PolicyGraph.filled),
    **dict.fromkeys(("MatMul", "Gemm"), PolicyGraph.layer),
    **dict.fromkeys(("Add", "Sub", "Mul", "Div"), PolicyGraph.arithmetic),
    **dict.fromkeys(("Relu", "Tanh", "Sigmoid", "Clip"), PolicyGraph.activation),
    "Concat": PolicyGraph.concat,
    "Constant": PolicyGraph.constant,
    "Shape": PolicyGraph.shape,
    "ai.onnx.ml.Scaler": PolicyGraph.scaler,
    "GRU": PolicyGraph.gru,
}
