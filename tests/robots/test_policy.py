"""Learnt policies: what exporters write is read, and C and NumPy calculate the same bits.

Expected actions are those of the libraries that trained them, recorded in `tests/data/policies`.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vsense
from tests.bench.robot import policy_program
from tests.conftest import require_tool, require_zig
from tests.data.policies import make
from tests.rigs.compiling import OWN, PROTOCOL, ROBOT, compiled
from tests.rigs.places import DATA, ROOT
from tests.robots.conftest import FLAGS, Builder
from tests.robots.rig import traced
from vsense import cli
from vsense.robots._policy_graph import Op, PolicyStep
from vsense.robots.boards import TARGETS, toolchain
from vsense.robots.build import cache_directory
from vsense.robots.policy import Policy, c_of, read_policy

Floats = NDArray[np.float32]
POLICIES = DATA / "policies"
SHIPPED = ROOT / "vsense" / "config" / "experiments"
TINY = np.finfo(np.float32).tiny
NAMES = (*make.SKLEARN, *make.TORCH)


def tanh(x: Floats) -> Floats:
    """`vs_policy_tanh`, in single precision operation by operation."""
    t = np.abs(x)
    is_between = (t >= np.float32(0.0002)) & (t < np.float32(9.1))
    twice = np.float32(2) * np.where(is_between, t, np.float32(0))
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


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in which the experiment's loop functions lie."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loops.py").write_bytes((SHIPPED / "phototaxis.py").read_bytes())
    return tmp_path


def experiment(
    folder: Path, data: bytes, params: str = "", ring: bool = False, acts: str = ""
) -> Path:
    """Phototaxis with a policy that observes eight light sensors, and the ring where it has one."""
    (folder / "walk.onnx").write_bytes(data)
    text = (SHIPPED / "phototaxis.argos").read_text()
    text = text.replace('library="phototaxis"', 'library="walk.onnx"')
    text = text.replace('library="phototaxis.py"', 'library="loops.py"')
    text = text if ring else re.sub("<epuck_proximity .*/>", "", text)
    text = text.replace("</actuators>", f"{acts}</actuators>")
    path = folder / "mine.argos"
    path.write_text(re.sub("<params .*/>", params, text))
    return path


@pytest.mark.parametrize("name", NAMES)
def test_what_libraries_export_is_what_they_calculate(name: str) -> None:
    policy, expected = read_policy(POLICIES / f"{name}.onnx"), np.load(POLICIES / f"{name}.npy")
    assert expected.shape == (1000, policy.outputs) and expected.std() > 0.02
    assert np.abs(actions(policy, make.observations(policy.inputs)) - expected).max() <= 1e-6


@pytest.mark.parametrize("name", ["mlp", "gru_layers", "sklearn_relu", "sklearn_logistic"])
def test_c_calculates_the_same_bits_as_numpy(name: str, build: Builder, tmp_path: Path) -> None:
    """Under the sanitizers."""
    path = POLICIES / f"{name}.onnx"
    source = tmp_path / "steps.c"
    source.write_text(c_of(path) + (ROOT / "tests" / "bench" / "policy_steps.c").read_text())
    parts = [ROBOT / "policy.c", ROBOT / "walk.c", *OWN, *PROTOCOL]
    objects = build.objects(parts)
    program = compiled(tmp_path / "steps", *FLAGS, source, *objects, "-lm")
    check_bits([str(program)], path)


@pytest.mark.parametrize("name", ["mlp", "gru", "sklearn_relu"])
def test_an_arm926_calculates_the_same_bits(name: str, tmp_path: Path) -> None:
    qemu = require_tool("qemu-arm", "qemu-user")
    require_zig()
    path = POLICIES / f"{name}.onnx"
    program = policy_program(path, toolchain(TARGETS["epuck"], cache_directory()), tmp_path)
    check_bits([qemu, "-cpu", "arm926", str(program)], path)


def check_bits(command: list[str], path: Path) -> None:
    """Asserts that a program of `policy_steps.c` gives NumPy's bits: actions, and tanh."""
    policy, scale = read_policy(path), np.float32([1e-30, 1e-3, 1, 1e3])
    seen = make.observations(policy.inputs)[:, np.newaxis] * scale[:, np.newaxis]
    rows = np.concatenate(np.moveaxis(seen, 1, 0))
    given = run(command, "1", rows)
    assert given.tobytes() == actions(policy, rows).tobytes()
    bits = np.random.default_rng(1).integers(0, 1 << 32, 20_000, np.uint32).view(np.float32)
    edges = np.float32([0.0, -0.0, 0.0002, 9.1, np.inf, -np.inf, 1e-45])
    x = np.concatenate(
        (bits[~np.isnan(bits)], np.linspace(-10, 10, 20_001, True, False, "f4"), edges)
    )
    own = run(command, "tanh", x)
    assert own.tobytes() == tanh(x).tobytes()
    exact = np.tanh(x.astype(np.float64))
    assert (np.abs(own - exact) <= 3 * np.spacing(np.abs(exact).astype(np.float32))).all()
    assert np.isnan(run(command, "tanh", np.float32([np.nan]))).all()


def run(command: list[str], mode: str, given: Floats) -> Floats:
    done = subprocess.run([*command, mode], input=given.tobytes(), stdout=subprocess.PIPE)
    assert done.returncode == 0
    return np.frombuffer(done.stdout, np.float32).reshape(-1)


@pytest.mark.parametrize("name", ["mlp", "gru"])
def test_simulated_robots_do_what_the_policy_says(folder: Path, name: str) -> None:
    path = experiment(folder, (POLICIES / f"{name}.onnx").read_bytes())
    assert cli.main(["sim", str(path), "--duration", "10", "--seed", "2", "-o", "out"]) == 0
    with np.load("out/trajectory.npz") as run:
        poses = run["poses"]
    assert np.ptp(poses[:, :, :2], axis=0).max() > 0.05
    policy = read_policy(folder / "walk.onnx")
    memory = np.zeros((15, policy.memory), np.float32)
    loaded = vsense.load(str(path), duration_s=10).experiment
    with vsense.SteppedSimulation(loaded, 2) as sim:
        light = sim.swarm.sensor("light")
        while not sim.done:
            assert np.array_equal(sim.poses, poses[sim.timestep])
            for row, seen in zip(memory, light.values):
                row[: policy.inputs] = seen
                think(policy, row)
            acts = memory[:, policy.action : policy.action + 2].astype(np.float64)
            sim.swarm.set_wheels(*(1000 * np.clip(acts, -1, 1)).T)
            sim.step()


@pytest.mark.paced
@pytest.mark.system
def test_real_daemons_do_what_the_policy_says(folder: Path) -> None:
    path = experiment(folder, (POLICIES / "gru.onnx").read_bytes())
    words = ["--robots", "2", "--duration", "4", "--port", "0", "-o", "out"]
    assert cli.main(["lab", str(path), *words]) in (0, 1)  # 1: this machine was too slow
    policy = read_policy(folder / "walk.onnx")
    for tag in (31, 1843):
        steps = traced(Path(f"out/robots/{tag}.trace"))
        rows = [re.findall("light=([0-9a-f]+)@", step["values"])[0] for step in steps]
        seen = np.array([np.frombuffer(bytes.fromhex(row), "<f4") for row in rows])
        expected = (1000 * np.clip(actions(policy, seen).astype(np.float64), -1, 1)).astype(int)
        wheels = [[int(step[side]) for side in ("left", "right")] for step in steps]
        assert len(wheels) > 30 and np.ptp(seen) > 0.0
        assert wheels == expected.tolist()
