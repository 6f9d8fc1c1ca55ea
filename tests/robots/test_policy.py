"""Learnt policies: what exporters write is read, and C and NumPy calculate the same bits.

Expected actions are those of the libraries that trained them, recorded in `tests/data/policies`.
"""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

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
from vsense.base.errors import ConfigError, UsageError
from vsense.config.experiment import load
from vsense.config.specs import Stage
from vsense.robots import boards
from vsense.robots._policy_graph import Op, PolicyStep
from vsense.robots.boards import TARGETS, toolchain
from vsense.robots.build import cache_directory
from vsense.robots.policy import Policy, PolicyError, c_of, read_policy, save_policy
from vsense.run.programs import told_programs

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


EMULATORS = {
    "epuck": ("qemu-arm", "-cpu", "arm926"),
    "pi-puck": ("qemu-arm", "-cpu", "arm1176"),
    "aarch64": ("qemu-aarch64",),
}


@pytest.mark.parametrize(
    ("name", "board"),
    [
        ("mlp", "epuck"),
        ("gru", "epuck"),
        # Each of these has zig build its C library first, for a minute.
        pytest.param("sklearn_relu", "pi-puck", marks=pytest.mark.campaign),
        pytest.param("gru_layers", "aarch64", marks=pytest.mark.campaign),
    ],
)
def test_boards_calculate_the_same_bits(name: str, board: str, tmp_path: Path) -> None:
    """Without a floating point unit, with an old one, and with one that could fuse."""
    qemu, *words = EMULATORS[board]
    emulator = require_tool(qemu, "qemu-user")
    require_zig()
    path = POLICIES / f"{name}.onnx"
    program = policy_program(path, toolchain(TARGETS[board], cache_directory()), tmp_path)
    check_bits([emulator, *words, str(program)], path)


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


def field(number: int, value: int | bytes) -> bytes:
    """A field of a protocol buffer."""
    length = value if isinstance(value, int) else len(value)
    assert length < 1 << 14
    low_high = bytes([length]) if length < 128 else bytes([length & 127 | 128, length >> 7])
    if isinstance(value, int):
        return bytes([number << 3]) + low_high
    return bytes([number << 3 | 2]) + low_high + value


def tensor(
    shape: tuple[int, ...], kind: int = 1, count: int | None = None, more: bytes = b""
) -> bytes:
    sizes = b"".join(field(1, size) for size in shape)
    size = {1: 4, 10: 2, 11: 8}[kind] * (math.prod(shape) if count is None else count)
    return field(5, sizes + field(2, kind) + field(8, b"w") + field(9, bytes(size)) + more)


def model(
    operator: bytes = b"MatMul",
    weights: bytes = b"",
    shape: tuple[int, ...] = (1, 8),
    more: bytes = b"",
    output: bytes = b"y",
) -> bytes:
    """One node, of the inputs x and w."""
    sizes = b"".join(field(1, field(1, size)) for size in shape)
    node = field(1, b"x") + field(1, b"w") + field(2, b"y") + field(3, b"last") + field(4, operator)
    given = field(1, b"x") + field(2, field(1, field(1, 1) + field(2, sizes)))
    graph = field(1, node) + (weights or tensor((8, 2))) + field(11, given)
    return field(1, 8) + field(7, graph + field(12, field(1, output)) + more)


KIND_INT = b"\xa0\x01\x02"
HUGE_GRU = field(
    1,
    b"".join(field(1, name) for name in (b"x", b"w", b"w"))
    + b"".join([field(2, b"z"), field(3, b"last"), field(4, b"GRU")])
    + field(5, field(1, b"linear_before_reset") + field(3, 1) + KIND_INT)
    + field(5, field(1, b"hidden_size") + b"\x18" + b"\x80" * 5 + b"\x20" + KIND_INT),
)
"""Its state has 2**40 numbers, its weights have 16."""


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is no ONNX file: it holds no graph"),
        (b"\x89PNG\r\n\x1a\n" + bytes(64), "is no ONNX file"),
        (model()[:-9], "is cut short"),
        (bytes(2_000_000), "has 2 MB, expected at most 1 MB"),
        (
            model(b"Softmax"),
            r"node 'last' \('Softmax'\): .* not supported; supported are Add, .*Tanh",
        ),
        (model(weights=tensor((7, 2))), r"node 'last' .*given 8 numbers, .* shape \(7, 2\)"),
        (model(shape=(32, 8)), r"node 'last' .*expected a batch of 1, got the shape \(32, 8\)"),
        (model(weights=tensor((8, 2), 11)), "tensor 'w' in float64: expected float32"),
        (model(weights=tensor((8, 2), 10)), "tensor 'w' in float16: expected float32"),
        (model(weights=tensor((8, 2), 1, 15)), r"'w', which is damaged: 15 numbers, \[8, 2\]"),
        (
            model(weights=tensor((8, 2), 1, 0, field(14, 1))),
            "in another file .*external_data=False",
        ),
        (model(shape=(1, 4000)), "4000 numbers: expected 1 to 3840"),
        (model(output=b"z"), "calculates no output 'z'"),
        (model(b"Add", weights=tensor((1, 2))), "last.*expected a constant|broadcast"),
        (model(more=field(11, field(1, b"h"))), "input 'h', and no output of that place"),
        (model(b"GRU"), "node 'last' .*GRU"),
        (model(output=b"z", more=HUGE_GRU), "node 'last' .*hidden_size 1099511627776: its weights"),
        (
            model(more=b"".join([field(5, field(8, b"%d" % n)) for n in range(9)])),
            "number format 0",
        ),
    ],
)
def test_what_is_no_policy_is_one_sentence(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.onnx"
    path.write_bytes(data)
    with pytest.raises(PolicyError, match=words) as raised:
        read_policy(path)
    assert str(raised.value).startswith(f"{path}: ") and "\n" not in str(raised.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "none.onnx", tmp_path):
        with pytest.raises(PolicyError, match=re.escape(f"{path}: cannot be read")):
            read_policy(path)


def test_layers_that_numpy_has_learnt_are_saved_and_read(tmp_path: Path) -> None:
    random, path = np.random.default_rng(1), tmp_path / "walk.onnx"
    shapes, names = ((5, 4), (4, 3), (3, 6), (6, 2)), ("tanh", "sigmoid", "relu", None)
    layers = [(random.normal(size=s), random.normal(size=s[1]), n) for s, n in zip(shapes, names)]
    save_policy(path, layers)
    assert path.read_bytes()[:2] == field(1, 8)
    x = seen = random.normal(size=(50, 5)).astype(np.float32)
    for matrix, bias, name in layers:
        x = x @ matrix + bias
        x = {"tanh": np.tanh(x), "sigmoid": 1 / (1 + np.exp(-x)), "relu": x.clip(0)}.get(
            str(name), x
        )
    assert np.abs(actions(read_policy(path), seen) - x).max() < 3e-6


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        ([], "one layer at least"),
        ([(np.ones((3, 2)), np.ones(3), None)], r"layer 1: .*\(3, 2\) and biases \(3,\), expected"),
        ([(np.ones((3, 2)), [1, np.nan], None)], "layer 1: expected finite"),
        ([(np.ones((3, 2)), [1, 1], "tahn")], "layer 1: .*'tahn'; is 'tanh' meant"),
        ([(np.ones((3, 2)), [1, 1], None)] * 2, "layer 2: it has 3 inputs, .* 2 outputs"),
    ],
)
def test_layers_that_do_not_fit_are_refused(layers: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=words):
        save_policy(tmp_path / "walk.onnx", layers)
    assert not (tmp_path / "walk.onnx").exists()


PHEROMONE = '<virtual_pheromone_actuator implementation="default" field="trail" max_rate="10" />'


@pytest.mark.parametrize(
    ("params", "ring", "words"),
    [
        ("", True, r"takes an observation of 8 .*observe 16 \(light 8, proximity 8\)"),
        (
            '<params leds="1" />',
            False,
            r"action of 2; .*act by 3 \(left wheel, right wheel, LEDs\)",
        ),
        ('<params leds="2" />', False, "'leds' is '2', expected 0 or 1"),
        ('<params actuators="horn 0" />', False, "'actuators' is 'horn 0', expected NAME LOW HIGH"),
        *(
            (f'<params actuators="horn 0 {word}" />', False, "expected NAME LOW HIGH")
            for word in ("x", "nan", "inf", "1_0")
        ),
        ('<params actuators="horn 0 1" />', False, "'actuators' names 'horn'; there are: none"),
    ],
)
def test_a_policy_for_other_robots_is_refused_with_the_line(
    params: str, ring: bool, words: str, folder: Path
) -> None:
    path = experiment(folder, (POLICIES / "mlp.onnx").read_bytes(), params, ring)
    with pytest.raises(ConfigError, match=rf"mine\.argos:22: <phototaxis_controller>.*{words}"):
        load(str(path))


def test_robots_act_as_in_the_environment_in_which_they_learn(folder: Path) -> None:
    """Actuators and LEDs included; and the ring comes last, though it is the first in the file."""
    (folder / "foraging.py").write_bytes((SHIPPED / "foraging.py").read_bytes())
    text = (SHIPPED / "foraging.argos").read_text()
    text = text.replace('library="foraging"', 'library="ant.onnx"')
    params = '<params actuators="pheromone_release 0 2" leds="1" />'
    Path("ant.argos").write_text(re.sub("<params .*/>", params, text))
    how: dict[str, Any] = {"robots": 4, "duration_s": 6, "leds": True}
    env = vsense.parallel_env("foraging", actuators={"pheromone_release": (0, 2)}, **how)
    width = env.observation_space("robot_31").shape[0]
    random, scale = np.random.default_rng(2), np.full(width, 1.0)
    scale[-8:], scale[:3] = 1 / 4096, 1 / 255
    weights = random.normal(size=(width, 4)) * scale[:, np.newaxis]
    save_policy("ant.onnx", [(weights, random.normal(size=4), "tanh")])
    run = vsense.load("ant.argos", robots=4, duration_s=6).simulate(3)
    policy, states, lit = read_policy(Path("ant.onnx")), [], set()
    observations, _ = env.reset(seed=3)
    while env.agents:
        states.append(env.state().reshape(-1, 3))
        acts = {agent: actions(policy, row[np.newaxis])[0] for agent, row in observations.items()}
        lit |= {bool(act[3] > 0) for act in acts.values()}
        observations, _, _, _, infos = env.step(acts)
    assert lit == {False, True} and np.ptp(states, axis=0).max() > 0.1
    assert np.array_equal(np.array(states), run.poses.astype(np.float32))
    assert infos["robot_31"]["measures"] == run.measures


def test_weights_are_told_packed_and_made_again(
    natively: None, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = (POLICIES / "mlp.onnx").read_bytes()
    path = experiment(folder, data)
    words = ["sim", str(path), "--duration", "2", "-o", "out"]
    assert cli.main(words) == cli.main(["pack", "out", "-o", "p.zip"]) == 0
    with ZipFile("p.zip") as package:
        (name,) = [name for name in package.namelist() if name.endswith("walk.onnx")]
        assert package.read(name) == data
    Path("walk.onnx").unlink()
    assert cli.main(["reproduce", "p.zip", "--trust"]) == 0
    assert "are the same in every bit" in "".join(capsys.readouterr())
    hashes = []
    for weight in (0.25, 0.5):
        save_policy("walk.onnx", [(np.full((8, 2), weight), [0, 0], None)])
        (told,) = told_programs(load(str(path), stage=Stage.RUN)).values()
        built = boards.build(str(folder / "walk.onnx"), "host", folder / "vsensed")
        version = subprocess.run(["./vsensed", "--version"], capture_output=True, text=True).stdout
        assert told.name == "walk" and told.hash == built.hash
        assert version.split()[-2:] == ["walk", told.hash]
        hashes.append(told.hash)
    assert len({*hashes}) == 2
