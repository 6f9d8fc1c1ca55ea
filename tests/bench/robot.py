"""What a robot's daemon costs: bytes, memory, instructions and system calls of a control step.

Sizes and instruction counts are exact and the same on every machine with the pinned compiler; the
report lists what could not be measured.
"""

from __future__ import annotations

import re
import select
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench import robot_calls
from tests.rigs.processes import children
from vsense.base.clock import host_ns
from vsense.modes.lab._microcontrollers import Microcontrollers
from vsense.robots import boards
from vsense.robots.boards import TARGETS, toolchain
from vsense.robots.build import FAST_PARTS, SHIPPED_CONTROLLER, cache_directory, source_tree
from vsense.robots.compiling import BuildError, Sources, Toolchain, native
from vsense.robots.policy import c_of, read_policy, save_policy
from vsense.robots.sources import ProgramSources

SIZE_MAX = 100_000
"""[byte] of the daemon for ARMv5 with a controller in it."""

STEP_MAX = 12_000
"""Instructions of a control step on ARMv5, the protocol's among them."""

CALLS_MAX = 42
"""System calls of a control step at 10 Hz, of all processes; 41 where nothing else runs: a wait and
a clock more than if the base were read only once the timestep has come."""

SHOWN = 208
"""[byte] that a controller shows when it is counted what that costs."""

POLICIES = {"perceptron of 16-32-32-2 numbers": 300_000, "GRU of 8-16-2 numbers": 240_000}
"""Learnt policies, and how many instructions they may take in a control step on ARMv5. The first is
for light and proximity; the second is in `tests/data/policies`."""

STEPS = 1000
CALL_STEPS = 200
HERE = Path(__file__).parent

Say = Callable[[str], None]


def run(say: Say) -> dict[str, Any]:
    """Measures everything that can be measured here.

    Returns:
        `sizes` [byte] by target, `step_instructions`, `shown_byte`, `policies` [instructions],
        `step_calls`, `memory_kb` of both processes on this machine; None where something is
        missing, and `missing` says what.
    """
    missing: list[str] = []
    with tempfile.TemporaryDirectory(prefix="vsense-bench-") as folder:
        sizes = _sizes(Path(folder), say, missing)
        return {
            "controller": SHIPPED_CONTROLLER,
            "sizes": sizes,
            "size_max": SIZE_MAX,
            "step_instructions": step_instructions(Path(folder), say, missing),
            "step_max": STEP_MAX,
            "shown_byte": _shown_byte(Path(folder)),
            "policies": policy_instructions(Path(folder)),
            "step_calls": _step_calls(Path(folder) / "epuck", say, missing),
            "calls_max": CALLS_MAX,
            "memory_kb": _memory_kb(Path(folder) / "host", say) if sizes["host"] else None,
            "missing": [
                *missing,
                "memory on ARM: an emulated processor shows the emulator's; the board test"
                " (tests/board) reads it from an ARM kernel",
            ],
        }


def table(report: dict[str, Any]) -> str:
    """The report as text."""
    lines = [f"vsensed with the controller '{report['controller']}', static and stripped:"]
    for target, size in report["sizes"].items():
        limit = f" of {report['size_max']:,} allowed" if target == "epuck" else ""
        lines.append(f"  {target:<8} {f'{size:,} bytes{limit}' if size else 'not built'}")
    count = report["step_instructions"]
    counted = f"{count:,} of {report['step_max']:,} allowed" if count else "not counted"
    lines.append(f"instructions of a control step on ARMv5, protocol included: {counted}")
    cost = report["shown_byte"]
    counted = f"{cost} instructions" if cost else "not counted"
    lines.append(f"  and of every byte that a controller shows in every step: {counted}")
    for name, most in POLICIES.items():
        cost = report["policies"].get(name)
        counted = f"{cost:,} of {most:,} allowed" if cost else "not counted"
        lines.append(f"  and of a learnt policy, a {name}: {counted}")
    calls = report["step_calls"]
    counted = f"{calls} of {report['calls_max']} allowed" if calls else "not counted"
    lines.append(f"system calls of a control step at 10 Hz, all processes: {counted}")
    memory = report["memory_kb"]
    lines.append(f"resident memory of both processes here: {f'{memory} kB' if memory else '?'}")
    return "\n".join([*lines, *(f"not measured: {text}" for text in report["missing"])])


def _sizes(folder: Path, say: Say, missing: list[str]) -> dict[str, int | None]:
    sizes: dict[str, int | None] = {}
    for target in TARGETS:
        say(f"building vsensed for {target}; the first time takes a minute")
        try:
            sizes[target] = boards.build(SHIPPED_CONTROLLER, target, folder / target).size
        except BuildError as error:
            sizes[target] = None
            missing.append(f"size for {target}: {str(error).splitlines()[0]}")
    return sizes


def step_instructions(folder: Path, say: Say, missing: list[str]) -> int | None:
    """Counts the instructions of a control step on an emulated ARM926, host and kernel left out.

    What is built goes into `folder`; what is not there is appended to `missing`.
    """
    qemu = shutil.which("qemu-arm")
    if qemu is None:
        missing.append("instructions: no qemu-arm; sudo apt install qemu-user")
        return None
    say("counting instructions")
    try:
        program, plugin = folder / "steps", folder / "icount.so"
        _build_steps(program)
        _build_plugin(plugin)
    except BuildError as error:
        missing.append(f"instructions: {str(error).splitlines()[0]}")
        return None
    return round(_cost(qemu, folder, "live") - _cost(qemu, folder, "host"))


def _shown_byte(folder: Path) -> float | None:
    """Instructions of a byte that a controller shows anew in every step, both telemetries included.

    After `step_instructions`, whose programs it takes.
    """
    qemu = shutil.which("qemu-arm")
    if qemu is None or not (folder / "icount.so").exists():
        return None
    return round((_cost(qemu, folder, "show") - _cost(qemu, folder, "live")) / SHOWN, 1)


def policy_program(path: Path, compiler: Toolchain, folder: Path) -> Path:
    """Builds a program in which an `.onnx` file thinks without a robot: see `policy_steps.c`."""
    source, program = folder / f"{path.stem}.c", folder / f"{path.stem}-steps"
    source.write_text(c_of(path) + (HERE / "policy_steps.c").read_text())
    tree = source_tree()
    own = [path for path in tree.runtime_sources() if path.stem != "inprocess"]
    Sources(own, ProgramSources((source,)), tree.includes(), fast=FAST_PARTS).link(
        compiler, program
    )
    return program


def policy_instructions(folder: Path) -> dict[str, int]:
    """Instructions of a control step of each of `POLICIES`; none where something is missing.

    After `step_instructions`, whose plug-in it takes.
    """
    qemu = shutil.which("qemu-arm")
    if qemu is None or not (folder / "icount.so").exists():
        return {}
    random, perceptron = np.random.default_rng(1), folder / "counted.onnx"
    shapes = ((16, 32), (32, 32), (32, 2))
    layers = [(random.normal(0, shape[0] ** -0.5, shape), shape[1]) for shape in shapes]
    save_policy(perceptron, [(matrix, np.zeros(n), "tanh") for matrix, n in layers])
    paths = (perceptron, HERE.parent / "data" / "policies" / "gru.onnx")
    return {name: _thought(qemu, folder, path) for name, path in zip(POLICIES, paths)}


def _thought(qemu: str, folder: Path, path: Path) -> int:
    program = policy_program(path, toolchain(TARGETS["epuck"], cache_directory()), folder)
    seen = np.random.default_rng(1).random(read_policy(path).inputs, np.float32).tobytes()
    few, many = (
        _instructions(qemu, folder / "icount.so", [str(program), str(n)], seen)[0]
        for n in (STEPS // 100, STEPS // 10)
    )
    return round((many - few) / (STEPS // 10 - STEPS // 100))


def _cost(qemu: str, folder: Path, mode: str) -> float:
    """Instructions of a step; of two lengths, so that start and end are not in it."""
    program, plugin = folder / "steps", folder / "icount.so"
    few, many = (_count(qemu, plugin, program, mode, n) for n in (STEPS // 10, STEPS))
    return (many - few) / (STEPS - STEPS // 10)


def _step_calls(program: Path, say: Say, missing: list[str]) -> int | None:
    """Counts the system calls of a control step of a daemon that was built for ARMv5."""
    qemu = shutil.which("qemu-arm")
    if qemu is None or not program.exists():
        missing.append("system calls: they need qemu-arm and a daemon for epuck boards")
        return None
    say(f"counting system calls, for {CALL_STEPS * robot_calls.TIMESTEP_NS / 1e9:.0f} s")
    try:
        return robot_calls.per_step(qemu, program, CALL_STEPS)
    except BuildError as error:
        missing.append(f"system calls: {error}")
        return None


def _build_steps(program: Path) -> None:
    tree = source_tree()
    own = [path for path in tree.daemon_sources() if path.name != "main.c"]
    sources = Sources(
        [*own, HERE / "robot_steps.c"],
        tree.program(SHIPPED_CONTROLLER),
        tree.includes(),
        fast=(*FAST_PARTS, "robot_steps"),
    )
    sources.link(toolchain(TARGETS["epuck"], cache_directory()), program)


def _build_plugin(plugin: Path) -> None:
    source = HERE / "icount.c"
    done = native().run(["-shared", "-fPIC", "-O2", "-o", str(plugin), str(source)])
    if done.returncode != 0:
        raise BuildError(f"{source} does not build: {done.stderr.strip()}")


def _count(qemu: str, plugin: Path, program: Path, mode: str, steps: int) -> int:
    """Runs `robot_steps` on the emulated processor; returns how many instructions it took."""
    count, lived = _instructions(qemu, plugin, [str(program), mode, str(steps)])
    if mode != "host" and int(lived) != steps:
        raise BuildError(f"robot_steps lived {lived.decode().strip()} of {steps} control steps")
    return count


def _instructions(
    qemu: str, plugin: Path, program: Sequence[str], given: bytes = b""
) -> tuple[int, bytes]:
    """Runs a program on the emulated processor; its instructions, and what it wrote."""
    command = [qemu, "-cpu", "arm926", "-plugin", str(plugin), "-d", "plugin", *program]
    # Without an environment: its size would shift the count.
    done = subprocess.run(command, capture_output=True, input=given, env={})
    found = re.search(rb"^instructions: (\d+)$", done.stderr, re.M)
    if done.returncode != 0 or found is None:
        raise BuildError(f"{' '.join(command)} failed: {done.stderr.decode().strip()}")
    return int(found[1]), done.stdout


def _memory_kb(program: Path, say: Say) -> int:
    """Starts the daemon on an emulated base and reads what both processes hold, in kB.

    A page that both hold counts once.
    """
    say("measuring memory")
    base = Microcontrollers(["argos"])
    words = ["--host", "127.0.0.1", "--port", "9", "--tag", "1", "--insecure"]
    words += ["--base", base.bases[0]]
    daemon = subprocess.Popen([program, *words], stderr=subprocess.DEVNULL)
    try:
        end_ns = host_ns() + 2_000_000_000
        while host_ns() < end_ns:
            select.select([base], [], [], 0.001)
            base.receive(base.readable(), host_ns())
            base.advance(host_ns())
        return sum(map(_resident_kb, [daemon.pid, *children(daemon.pid)]))
    finally:
        daemon.terminate()
        daemon.wait()
        base.close()


def _resident_kb(pid: int) -> int:
    found = re.search(r"^Pss:\s+(\d+) kB$", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M)
    assert found is not None
    return int(found[1])
