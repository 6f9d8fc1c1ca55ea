"""Reads ONNX files: of their protocol buffers the graph, its nodes and its constants.

Nothing is asked for that the file's size does not bound, and nothing in it is run. Sources: the
encoding of protocol buffers; onnx.proto of ONNX (ModelProto, GraphProto, NodeProto, AttributeProto,
TensorProto, ValueInfoProto).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 1 << 20
"""Of a file: what an ARM926 would calculate for longer than a timestep."""
MOST_NUMBERS = MOST_BYTES // 4
MOST_THINGS = 1000
"""Of nodes, and of constants."""
_MOST_SMALL = 64
"""Of a node's attributes, inputs and outputs, and of a tensor's dimensions."""

Constant = NDArray[Any]
"""float32, or int64."""

_TYPES = {1: "float32", 6: "int32", 7: "int64", 10: "float16", 11: "float64", 16: "bfloat16"}
_ITEMS = {1: "<f4", 6: "<i4", 7: "<i8"}
_EXTERNAL = 1


@dataclass(frozen=True, slots=True)
class OnnxNode:
    """One operation of a graph.

    Attributes:
        operator: with its domain where that is not ONNX's own: "ai.onnx.ml.Scaler".
        attributes: numbers, tensors, lists of numbers and texts, by name.
    """

    operator: str
    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: Mapping[str, Any]

    def __str__(self) -> str:
        return f"node {shown(self.name or self.outputs[0])} ({shown(self.operator)})"


@dataclass(slots=True)
class OnnxGraph:
    """What is calculated; in the file's order, in which nodes follow what they read.

    Attributes:
        inputs: shapes by name; a dimension that is not given is 1.
    """

    nodes: list[OnnxNode] = field(default_factory=list)
    constants: dict[str, Constant] = field(default_factory=dict)
    inputs: dict[str, tuple[int, ...]] = field(default_factory=dict)
    outputs: list[str] = field(default_factory=list)


def shown(name: str) -> str:
    """A name in quotes, cut where it is long."""
    return repr(name if len(name) <= 60 else f"{name[:57]}...")


def read_graph(data: bytes) -> OnnxGraph:
    """Reads a file's graph.

    Raises:
        ValueError: it is none, or damaged, too large, or of another number format; says which.
    """
    graphs = [_message(value) for number, value in _fields(memoryview(data)) if number == 7]
    if len(graphs) != 1:
        raise ValueError("is no ONNX file: it holds no graph")
    graph = OnnxGraph()
    for number, value in _fields(graphs[0]):
        if number == 1:
            graph.nodes.append(_node(_message(value)))
        elif number == 5:
            name, tensor = _tensor(_message(value))
            graph.constants[name] = tensor
        elif number == 11:
            name, shape = _input(_message(value))
            graph.inputs[name] = shape
        elif number == 12:
            graph.outputs.append(_text_of(_message(value), 1))
        if max(map(len, (graph.nodes, graph.constants, graph.inputs, graph.outputs))) > MOST_THINGS:
            raise ValueError(f"has more than {MOST_THINGS} nodes, constants, inputs or outputs")
    # Older files list constants among the inputs.
    for name in graph.constants:
        graph.inputs.pop(name, None)
    return graph


def _fields(data: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """A message's fields: number, and a whole number or bytes; ValueError: it is damaged."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        kind = key & 7
        if kind == 0:
            value, at = _varint(data, at)
            yield key >> 3, value
            continue
        if kind == 2:
            size, at = _varint(data, at)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
        else:
            raise ValueError("is no ONNX file, or is damaged")
        if size > len(data) - at:
            raise ValueError("is no ONNX file, or is cut short")
        yield key >> 3, data[at : at + size]
        at += size


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """A whole number that begins at a place, and where it ends."""
    value = 0
    for shift, byte in enumerate(data[at : at + 10]):
        value |= (byte & 127) << 7 * shift
        if byte < 128:
            return value, at + shift + 1
    raise ValueError("is no ONNX file, or is cut short")


def _message(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise ValueError("is no ONNX file, or is damaged")
    return value


def _text(value: int | memoryview) -> str:
    return bytes(_message(value)).decode(errors="replace")


def _text_of(data: memoryview, wanted: int) -> str:
    return next((_text(value) for number, value in _fields(data) if number == wanted), "")


def _whole(value: int | memoryview) -> list[int]:
    """A whole number with its sign, or several that are packed."""
    numbers = [value] if isinstance(value, int) else []
    if not isinstance(value, int):
        at = 0
        while at < len(value):
            number, at = _varint(value, at)
            numbers.append(number)
    return [(n + 2**63) % 2**64 - 2**63 for n in numbers]


def _floats(value: int | memoryview) -> tuple[float, ...]:
    """A single, or several that are packed."""
    data = _message(value)
    if len(data) % 4:
        raise ValueError("is no ONNX file, or is damaged")
    return struct.unpack(f"<{len(data) // 4}f", data)


def _first(values: Sequence[Any]) -> Any:
    if not values:
        raise ValueError("is no ONNX file, or is damaged")
    return values[0]


def _small(values: list[Any], what: str) -> None:
    if len(values) > _MOST_SMALL:
        raise ValueError(f"has a {what} with more than {_MOST_SMALL} parts")


def _node(data: memoryview) -> OnnxNode:
    texts: dict[int, str] = {}
    names: dict[int, list[str]] = {1: [], 2: []}
    attributes: dict[str, Any] = {}
    for number, value in _fields(data):
        if number in names:
            names[number].append(_text(value))
        elif number in (3, 4, 7):
            texts[number] = _text(value)
        elif number == 5:
            name, found = _attribute(_message(value))
            attributes[name] = found
        for parts in (*names.values(), [*attributes]):
            _small(parts, "node")
    domain = texts.get(7, "")
    prefix = f"{domain}." if domain not in ("", "ai.onnx") else ""
    inputs, outputs = map(tuple, names.values())
    if not outputs:
        raise ValueError("has a node without a result")
    return OnnxNode(f"{prefix}{texts.get(4, '')}", texts.get(3, ""), inputs, outputs, attributes)


def _attribute(data: memoryview) -> tuple[str, Any]:
    name = ""
    found: Any = None
    floats: list[float] = []
    wholes: list[int] = []
    for number, value in _fields(data):
        if number == 1:
            name = _text(value)
        elif number == 2:
            found = _first(_floats(value))
        elif number == 3:
            found = _first(_whole(value))
        elif number == 4:
            found = _text(value)
        elif number == 5:
            found = _tensor(_message(value))[1]
        elif number == 7:
            floats += _floats(value)
        elif number == 8:
            wholes += _whole(value)
    return name, found if found is not None else floats or wholes


def _tensor(data: memoryview) -> tuple[str, Constant]:
    """A tensor's name and numbers; ValueError: they are not as many as its shape says."""
    name, kind, raw = "", 0, None
    shape: list[int] = []
    typed: dict[int, list[Any]] = {4: [], 5: [], 7: []}
    external = False
    for number, value in _fields(data):
        if number == 1:
            shape += _whole(value)
            _small(shape, "tensor")
        elif number == 2:
            kind = _first(_whole(value))
        elif number == 4:
            typed[4] += _floats(value)
        elif number in (5, 7):
            typed[number] += _whole(value)
        elif number == 8:
            name = _text(value)
        elif number == 9:
            raw = _message(value)
        elif number == 14:
            external = _whole(value) == [_EXTERNAL]
    if external:
        raise ValueError(
            "has its weights in another file (.onnx.data): expected all in one, which is sent to"
            " robots and told by its digest; PyTorch: torch.onnx.export(..., external_data=False)"
        )
    if kind not in _ITEMS:
        format_ = _TYPES.get(kind, f"number format {kind}")
        raise ValueError(f"has the tensor {shown(name)} in {format_}: expected float32")
    count = math.prod(shape) if min(shape, default=0) >= 0 else -1
    given = typed[{1: 4, 6: 5, 7: 7}[kind]]
    size = len(given) if raw is None else len(raw) / np.dtype(_ITEMS[kind]).itemsize
    if count != size or count > MOST_NUMBERS:
        raise ValueError(
            f"has the tensor {shown(name)}, which is damaged: {size:g} numbers, {shape}"
        )
    numbers = np.array(given) if raw is None else np.frombuffer(raw, _ITEMS[kind])
    return name, numbers.astype(np.float32 if kind == 1 else np.int64).reshape(shape)


def _input(data: memoryview) -> tuple[str, tuple[int, ...]]:
    """An input's name and shape: ValueInfoProto, TypeProto, its Tensor, TensorShapeProto."""
    name, shape = "", []
    for number, value in _fields(data):
        if number == 1:
            name = _text(value)
        elif number == 2:
            tensors = [_message(v) for n, v in _fields(_message(value)) if n == 1]
            shapes = [_message(v) for t in tensors for n, v in _fields(t) if n == 2]
            dims = [_message(v) for s in shapes for n, v in _fields(s) if n == 1]
            _small(dims, "shape")
            shape = [next((v for n, v in _fields(d) if n == 1), 1) for d in dims]
    if not all(isinstance(size, int) and 0 < size <= MOST_NUMBERS for size in shape):
        raise ValueError(f"has the input {shown(name)} of a shape that is none")
    return name, tuple(size for size in shape if isinstance(size, int))
