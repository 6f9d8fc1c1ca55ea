"""Four computers with cameras, and what befalls them: `scripts/bench nodes`.

Each node is a process in a network namespace of its own; one is behind the fault rig's relay, and
the clock of one is 1,000 s ahead and goes 200 ppm too fast. Their cameras play pictures in step, so
that everybody knows when a picture was taken. The tracker is the real one, in this process.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tests.faults import node_costs
from tests.faults.relay import Relay, Weather, address
from tests.rigs.four_cameras import write_recording
from tests.rigs.namespaces import Namespaces
from tests.rigs.nodes import (
    CAMERAS,
    PERIOD_NS,
    RunningNode,
    Watched,
    central_file,
    draw,
    tracked,
)
from tests.rigs.places import ROOT
from tests.rigs.processes import free_port
from vsense.base.clock import host_ns

INSIDE = "VSENSE_NODES_INSIDE"
NAMES = ("west", "east", "north", "south")
LATE, DRIFTING = "north", "south"
DRIFT_PPM, AHEAD_S = 200.0, 1000.0
PROGRAM = ("-m", "tests.rigs.playing_node")


@dataclass
class Outcome:
    """What a fault did. Times in s; None: not there.

    Attributes:
        told_s: Until a line named it.
        back_s: From its end until the node's camera was in a timestep again.
        left_out: Timesteps without the node while the fault lasted, of `timesteps`.
        missing: Timesteps that nobody had.
        others: Timesteps in which another node was late, too.
        lost: Poses of robots that other nodes see, which were not there.
    """

    fault: str
    told_s: float | None
    back_s: float | None
    left_out: int
    timesteps: int
    missing: int
    others: int
    lost: int
    words: str = ""


class Rig:
    """Four nodes that run, with their tracker.

    Attributes:
        nodes: By name.
    """

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._resources = draw(folder)
        port = free_port()
        self.where, self.nodes = f"tcp/0.0.0.0:{port}", dict[str, RunningNode]()
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        numbers = {n: 2 + n for n in range(len(NAMES))}
        self.spaces = Namespaces("vnd", "10.215.1", "eth", numbers)
        stack.callback(self.spaces.close)
        self.relay = Relay(port, 1)
        stack.callback(self.relay.close)
        self._port = port
        for name in NAMES:
            self.start(name)
        stack.callback(self._stop)
        central = central_file(self._resources, self.where, NAMES, "node")
        self.watched = Watched(central)
        stack.callback(self.watched.close)
        self.watched.wait_whole(4)

    def start(self, name: str, *words: str) -> RunningNode:
        """Starts a node, each in its network; the late one is behind the relay."""
        number = NAMES.index(name)
        if name == LATE:
            inside, host = (), address(0)
        else:
            inside, host = self.spaces.command(number), self.spaces.host
        if name == DRIFTING:
            words = (*words, "--drift-ppm", str(DRIFT_PPM), "--ahead", str(AHEAD_S))
        words = (*words, "--keep", "--period", str(1e-9 * PERIOD_NS))
        where = f"tcp/{host}:{self._port}"
        node = RunningNode(name, self._resources, where, *words, inside=inside, program=PROGRAM)
        self.nodes[name] = node
        return node

    def _stop(self) -> None:
        for node in self.nodes.values():
            node.stop()

    def befall(
        self,
        fault: str,
        name: str,
        begin: Callable[[], object],
        end: Callable[[], object],
        lasts_s: float,
        words: str,
    ) -> Outcome:
        """Has a fault begin and end, and says what came of it."""
        watched, camera = self.watched, CAMERAS[NAMES.index(name)].id
        watched.wait_whole(4)
        shown = watched.tracking.troubles
        watched.wait(lambda: (camera, "overdue") not in shown.present, "in time")
        others = frozenset().union(*(s.seen for s in watched.steps[-5:] if camera in s.captures_ns))
        watched.tracking.troubles.counts.clear()  # the first ones of each kind are told
        begun_ns, lines = host_ns(), len(watched.said)
        begin()
        time.sleep(lasts_s)
        end()
        ended_ns = host_ns()

        def is_back() -> bool:
            last = watched.steps[-1]
            return last.done_ns > ended_ns and camera in last.captures_ns

        watched.wait(is_back, f"{name} back")
        back_ns = next(
            s.done_ns for s in watched.steps if s.done_ns > ended_ns and camera in s.captures_ns
        )
        during = [s for s in watched.steps if begun_ns + PERIOD_NS < s.done_ns < ended_ns]
        others_late = sum(len(s.captures_ns) < len(NAMES) - 1 for s in during)
        told = [
            (ns, text)
            for ns, text in watched.said[lines:]
            if f"node {name}" in text and words in text
        ]
        left_out = [step for step in during if camera not in step.captures_ns]
        missing = sum(
            max(round((b.capture_ns - a.capture_ns) / PERIOD_NS) - 1, 0)
            for a, b in pairwise(during)
        )
        spared = self._seen_without(camera) & others
        whole = [step for step in left_out if len(step.captures_ns) == len(NAMES) - 1]
        lost = sum(len(spared - step.seen) for step in whole)
        return Outcome(
            fault,
            1e-9 * (told[0][0] - begun_ns) if told else None,
            1e-9 * (back_ns - ended_ns),
            len(left_out),
            len(during),
            missing,
            others_late,
            lost,
            told[0][1] if told else "; ".join(text for _, text in watched.said[lines:]),
        )

    def _seen_without(self, camera: str) -> frozenset[int]:
        """Robots that other cameras have seen while this one was not there."""
        steps = [step.seen for step in self.watched.steps if camera not in step.captures_ns]
        return frozenset().union(*steps)

    def kill(self, lasts_s: float = 1.5) -> Outcome:
        """One is killed, and started again."""
        node = self.nodes["west"]
        again = lambda: self.start("west").wait_for("for the tracker at")  # noqa: E731
        return self.befall("killed", "west", node.process.kill, again, lasts_s, "silent")

    def cut(self) -> Outcome:
        """One is cut off for three seconds."""
        number = NAMES.index("east")
        begin, end = (lambda: self.spaces.cut(number)), (lambda: self.spaces.restore(number))
        return self.befall("cut off for 3 s", "east", begin, end, 3.0, "silent")

    def late(self, both_ways: bool = True, lasts_s: float = 3.0) -> Outcome:
        """One is 30 ms late, its rows alone or both ways."""
        slow = Weather(delay_s=0.03)
        begin = lambda: self.relay.set(slow, slow if both_ways else Weather(), [0])  # noqa: E731
        words = "30 ms late" if both_ways else "30 ms late on its way here only"
        return self.befall(words, LATE, begin, self.relay.calm, lasts_s, "behind")

    def drift(self, lasts_s: float) -> dict[str, float]:
        """How wrong the drifting node's times are, and how wrong they may be [ms]."""
        begun_ns, camera = host_ns(), CAMERAS[NAMES.index(DRIFTING)].id
        time.sleep(lasts_s)
        steps = [s for s in self.watched.steps if s.done_ns > begun_ns and camera in s.captures_ns]
        error_ns = [
            abs((s.captures_ns[camera] + PERIOD_NS // 2) % PERIOD_NS - PERIOD_NS // 2)
            for s in steps
        ]
        bound_ns = [step.bounds_ns[DRIFTING] for step in steps]
        return {
            "pictures": len(steps),
            "worst_ms": 1e-6 * max(error_ns),
            "bound_median_ms": 1e-6 * float(np.median(bound_ns)),
            "beyond_bound": sum(e > b for e, b in zip(error_ns, bound_ns, strict=True)),
        }

    def hungry(self, allowed: int) -> tuple[int, float, str]:
        """One more node without memory: its exit code, when it ended [s] and its last words."""
        begun_s = time.monotonic()
        where, words = f"tcp/127.0.0.1:{self._port}", ("--memory", str(allowed))
        node = RunningNode("hungry", self._resources, where, *words, program=PROGRAM)
        code = node.end()
        return code, time.monotonic() - begun_s, (node.said or [""])[-1].strip()


@contextmanager
def rig() -> Iterator[Rig]:
    """A rig in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        yield Rig(Path(folder), stack)


def short() -> dict[str, object]:
    """The essential: one is killed and comes back, one is late."""
    with rig() as made:
        return {"faults": [asdict(made.kill(1.0)), asdict(made.late(lasts_s=1.5))]}


def same_bits(source: Path, folder: Path) -> str:
    """Tracks the public four-camera recording here, and with each camera on a node of its own."""
    resources, where = write_recording(source, folder), f"tcp/127.0.0.1:{free_port()}"
    expected = tracked(resources, None, [])
    central = central_file(resources, where, NAMES, "node_recording")
    with ExitStack() as stack:
        for name in NAMES:
            stack.callback(RunningNode(name, resources, where).stop)
        states = tracked(central, None, [])
    same = sum(one == other for one, other in zip(states, expected, strict=True))
    named = sum(int(str(state[2])) for state in states)
    return (
        f"{same} of {len(states)} timesteps have every bit of one computer; {named} markers named"
    )


def table(report: dict[str, Any]) -> str:
    """The report for a person."""
    lines = [f"{'':32}  told s  back s  left out  lost  nobody's"]
    for fault in report["faults"]:
        told = "-" if fault["told_s"] is None else f"{fault['told_s']:.2f}"
        shares = f"{fault['left_out']:4} of {fault['timesteps']:<3}"
        lines.append(
            f"{fault['fault']:32}  {told:>6}  {fault['back_s']:6.2f} {shares} {fault['lost']:5}"
            f" {fault['missing']:9}"
        )
    drift = report["drift"]
    lines.append(
        f"{DRIFT_PPM:g} ppm, {AHEAD_S:g} s ahead: {drift['pictures']} pictures, dated wrong by at"
        f" most {drift['worst_ms']:.2f} ms, {drift['beyond_bound']} beyond their bound (median"
        f" {drift['bound_median_ms']:.2f} ms)"
    )
    for code, after_s, words in report["memory"]:
        lines.append(f"without memory: exit code {code} after {after_s:.1f} s: {words}")
    return "\n".join(lines)


def inside(options: argparse.Namespace) -> int:
    """What runs in namespaces of its own."""
    if options.short:
        print(json.dumps(short()))
        return 0
    with rig() as made:
        outcomes = [made.kill(), made.cut(), made.late(), made.late(both_ways=False)]
        report = {
            "faults": [asdict(outcome) for outcome in outcomes],
            "drift": made.drift(20.0),
            "memory": [made.hungry(mega << 20) for mega in (4, 26, 80, 600)],
        }
    print(json.dumps(report, indent=2) if options.json else table(report))
    return 0


def main(words: Sequence[str] | None = None) -> int:
    """Parses the command's words; starts what they say in namespaces of its own."""
    parser = argparse.ArgumentParser(prog="scripts/bench nodes", description=__doc__)
    parser.add_argument("--short", action="store_true", help="the essential, as the suite has it")
    parser.add_argument("--json", action="store_true", help="the report as one JSON object")
    text = (
        "the public recording's folder (tests/rigs/four_cameras.py): every bit as on one computer?"
    )
    parser.add_argument("--four-cameras", type=Path, metavar="FOLDER", help=text)
    parser.add_argument("--costs", action="store_true", help="latency, bytes, processor time")
    options = parser.parse_args(words)
    if INSIDE in os.environ:
        return inside(options)
    if options.four_cameras is not None:
        with tempfile.TemporaryDirectory() as folder:
            print(same_bits(options.four_cameras, Path(folder)))
        return 0
    if options.costs:
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(node_costs.run(Path(folder)), indent=2))
        return 0
    command = ["unshare", "--net", "--mount", sys.executable, "-m", "tests.faults.nodes"]
    environment = {**os.environ, INSIDE: "1", "PYTHONPATH": str(ROOT)}
    again = list(sys.argv[1:] if words is None else words)
    return subprocess.run([*command, *again], cwd=ROOT, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())
