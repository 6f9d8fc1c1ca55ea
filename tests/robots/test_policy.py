"""Learnt policies: what exporters write is read, and C and NumPy calculate the same bits.

Expected actions are those of the libraries that trained them, recorded in `tests/data/policies`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.data.policies import make
from tests.rigs.places import DATA
from vsense.robots._policy_graph import Op, PolicyStep
from vsense.robots.policy import Policy, read_policy

Floats = NDArray[np.float32]
POLICIES = DATA / "policies"
TINY = np.finfo(np.float32).tiny
NAMES = (*make.SKLEARN, *make.TORCH)


def tanh(x: Floats) -> Floats:
    """`vs_policy_tanh`, in single precision operation by operation."""
    t = np.abs(x)
    is_between = (t >= np.float32(0.0002)) & (t < np.float32(9.1))
    twice = np.where(is_between, t + t, np.float32(0))
    k = (twice * np.float32(1.44269504) + np.float32(0.5)).astype(np.int32)
    whole = k.astype(np.float32)
    r = twice - whole * np.float32(0.693359375)
    r = r - whole * np.float32(-2.12194440e-4)
    series = np.full_like(x, np.float32(1) / np.float32(5040))
    for divisor in (720, 120, 24, 6, 2, 1):
        series = series * r + np.float32(1) / np.float32(divisor)
    power = np.exp2(whole)
    grown = power * (series * r) + (power - np.float32(1))
    result = np.where(is_between, grown / (grown + np.float32(2)), np.float32(1))
    near = np.isnan(x) | (t < np.float32(0.0002))
    return np.where(near, x, np.where(x < 0, -result, result)).astype(np.float32)


def think(policy: Policy, memory: Floats) -> None:
    """`vs_policy_think`."""
    for step in policy.steps:
        memory[step.target : step.target + step.outputs] = _results(step, memory)


def _results(step: PolicyStep, memory: Floats) -> Floats:
    x, weights = memory[step.start : step.start + step.inputs], step.weights
    if step.op is Op.DENSE:
        assert weights is not None
        rows = weights.reshape(step.inputs + 1, step.outputs)
        total = rows[0].copy()
        for value, row in zip(x, rows[1:]):
            total = total + row * value
        return total
    second = memory[step.operand : step.operand + step.outputs] if weights is None else weights
    half = np.float32(0.5)
    calculate: dict[Op, Callable[[], Any]] = {
        Op.ADD: lambda: x + second,
        Op.SUB: lambda: x - second,
        Op.MUL: lambda: x * second,
        Op.DIV: lambda: np.where(np.abs(x / second) <= TINY, np.float32(0), x / second),
        Op.CLIP: lambda: np.clip(x, *second),
        Op.RELU: lambda: np.where(x > 0, x, np.float32(0)),
        Op.TANH: lambda: tanh(x),
        Op.SIGMOID: lambda: half * tanh(half * x) + half,
        Op.COPY: lambda: x.copy(),
    }
    return np.asarray(calculate[step.op](), np.float32)


def actions(policy: Policy, observations: Floats) -> Floats:
    """(n, outputs) one after the other, with what is remembered."""
    memory, rows = np.zeros(policy.memory, np.float32), []
    for row in observations:
        memory[: policy.inputs] = row
        think(policy, memory)
        rows.append(memory[policy.action : policy.action + policy.outputs].copy())
    return np.array(rows)


@pytest.mark.parametrize("name", NAMES)
def test_what_libraries_export_is_what_they_calculate(name: str) -> None:
    policy, expected = read_policy(POLICIES / f"{name}.onnx"), np.load(POLICIES / f"{name}.npy")
    assert expected.shape == (1000, policy.outputs) and expected.std() > 0.02
    assert np.abs(actions(policy, make.observations(policy.inputs)) - expected).max() <= 1e-6
