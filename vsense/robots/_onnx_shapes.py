"""What ONNX's operators that only rearrange numbers do, as NumPy does it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.robots._onnx import Constant, OnnxNode

MOST_MEMORY = 3840
"""Of numbers that a policy works with: what else a controller's state of 16 KiB holds is less than
1 KiB. Source: robot/controller.h."""

_FLOAT = 1
_MOST_AXES = 64
_VIEWS = ("Transpose", "Identity", "Cast")
"""These copy nothing, so that they may be of a layer's weights."""

Numbers = NDArray[Any]
Given = Sequence[Constant | None]
"""The inputs behind the first one; None: it is no constant."""


def check_count(count: int) -> None:
    """Raises ValueError where there are too many numbers, or none."""
    if not 0 < count <= MOST_MEMORY:
        raise ValueError(f"{count} numbers: expected 1 to {MOST_MEMORY}")


def few(values: Constant) -> list[int]:
    """A constant as a list of axes, sizes or places; ValueError: it is none."""
    if values.size > _MOST_AXES or values.dtype.kind != "i":
        raise ValueError(f"expected at most {_MOST_AXES} whole numbers")
    return [int(value) for value in values.ravel()]


def moved(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    """The results of a node of `MOVES`.

    Raises:
        ValueError, IndexError, TypeError, KeyError: they cannot be made; some say why.
    """
    if node.operator not in _VIEWS:
        check_count(x.size)
    results = MOVES[node.operator](node, x, given)
    if any(result.size == 0 for result in results):
        raise ValueError("it gives no numbers")
    return results


def _wholes(node: OnnxNode, given: Given, at: int, attribute: str) -> list[int] | None:
    """Axes or sizes: an input in newer files, an attribute in older ones; None: neither."""
    if at < len(given) and node.inputs[at + 1]:
        value = given[at]
        if value is None:
            raise ValueError(f"expected a constant as its input {at + 2}")
        return few(value)
    return node.attributes.get(attribute)


def _reshape(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    shape = _wholes(node, given, 0, "shape") or []
    if not node.attributes.get("allowzero", 0):
        shape = [size or x.shape[axis] for axis, size in enumerate(shape)]
    return [x.reshape(shape)]


def _flatten(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    return [x.reshape(math.prod(x.shape[: node.attributes.get("axis", 1)]), -1)]


def _squeeze(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    axes = _wholes(node, given, 0, "axes")
    return [np.squeeze(x, None if axes is None else tuple(axes))]


def _unsqueeze(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    return [np.expand_dims(x, tuple(_wholes(node, given, 0, "axes") or ()))]


def _transpose(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    return [x.transpose(node.attributes.get("perm"))]


def _same(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    if node.attributes.get("to", _FLOAT) != _FLOAT:
        raise ValueError("expected float32 all through")
    return [x]


def _slice(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    begin, end = (_wholes(node, given, at, name) for at, name in ((0, "starts"), (1, "ends")))
    axes = _wholes(node, given, 2, "axes") or [*range(len(begin or ()))]
    if any(step != 1 for step in _wholes(node, given, 3, "steps") or ()):
        raise ValueError("expected steps of 1")
    cuts = [slice(None)] * x.ndim
    for first, last, axis in zip(begin or (), end or (), axes):
        cuts[axis] = slice(first, last)
    return [x[tuple(cuts)]]


def _split(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    axis, parts = node.attributes.get("axis", 0), len(node.outputs)
    whole = x.shape[axis]
    size = -(-whole // parts)
    alike = [size] * (parts - 1) + [whole - size * (parts - 1)]
    sizes = _wholes(node, given, 0, "split") or alike
    if len(sizes) != parts or min(sizes) <= 0 or sum(sizes) != whole:
        raise ValueError(f"{whole} numbers do not make {parts} parts of {sizes}")
    return np.split(x, np.cumsum(sizes[:-1]), axis)


def _gather(node: OnnxNode, x: Numbers, given: Given) -> list[Numbers]:
    axis, (which,) = node.attributes.get("axis", 0), given
    if which is None:
        raise ValueError("expected constant places")
    check_count(which.size * x.size // x.shape[axis])
    return [np.asarray(np.take(x, which, axis))]


MOVES: dict[str, Callable[[OnnxNode, Numbers, Given], list[Numbers]]] = {
    "Reshape": _reshape,
    "Flatten": _flatten,
    "Squeeze": _squeeze,
    "Unsqueeze": _unsqueeze,
    "Transpose": _transpose,
    "Identity": _same,
    "Cast": _same,
    "Slice": _slice,
    "Split": _split,
    "Gather": _gather,
}
