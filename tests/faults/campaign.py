"""Faults, drawn from a seed, befall running labs: `python -m tests.faults.campaign`.

It starts itself anew in a network and mount namespace of its own, and needs the right to make them.
Exit code 0: every invariant held; 1: not, or the machine was too busy to say.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from tests.faults.faults import FAULTS, Fault
from tests.faults.judge import (
    LOST_NS,
    Verdict,
    Window,
    judge,
    judge_end,
    judge_kill,
    judge_recording,
)
from tests.faults.relay import Relay
from tests.faults.stage import Canary, Stage, StageError
from tests.rigs.places import ROOT
from tests.system.attacker import Attacker
from vsense.base.terminal import aligned

INSIDE = "VSENSE_FAULTS_INSIDE"
VOID_MOST = 0.25
"""Share of void faults from which nothing was shown."""

PORT = 4050
PER_LAB = 11
"""Faults that one lab bears before its end, which is one more."""

DISK_BYTES = 96_000_000
SHOWN = 4
"""Broken promises of one fault that are printed."""

SETTLE_S = 0.3


@dataclass
class Both(Fault):
    """Two faults at once."""

    faults: tuple[Fault, ...] = ()

    def begin(self, stage: Stage) -> None:
        for fault in self.faults:
            fault.begin(stage)

    def end(self, stage: Stage) -> None:
        for fault in self.faults:
            fault.end(stage)


NETWORK = ("partition", "storm", "drizzle")
PROCESSES = ("frozen_worker", "frozen_host", "killed_worker", "other_clock", "killed_guard")


def draw_fault(draw: random.Random, stage: Stage) -> Fault:
    """One fault, or one of the network together with one of a process."""
    by_name = {make.__name__: make for make in FAULTS}
    if draw.random() < 0.8:
        return draw.choices(list(FAULTS), list(FAULTS.values()))[0](draw, stage)
    two = [by_name[draw.choice(names)](draw, stage) for names in (NETWORK, PROCESSES)]
    return Both(
        "two at once",
        min(fault.lasts_s for fault in two),
        sorted({place for fault in two for place in fault.stops}),
        sorted(set(two[0].spared) & set(two[1].spared)),
        faults=tuple(two),
    )


@dataclass
class Campaign:
    """All labs of one call.

    Attributes:
        seed: of everything that is drawn; a lab's own is made from it and its number.
        robots: of every lab; None: 5 to 15 are drawn.
    """

    folder: Path
    seed: int
    robots: int | None
    verdicts: list[Verdict] = field(default_factory=list)
    void: list[Verdict] = field(default_factory=list)

    def run(self, scenarios: int) -> None:
        """Has so many faults befall labs."""
        number = 0
        while len(self.verdicts) < scenarios:
            number += 1
            self._lab(number, min(PER_LAB, scenarios - len(self.verdicts) - 1))
            if len(self.void) > max(3, VOID_MOST * len(self.verdicts)):
                raise StageError(f"the machine is too busy: {len(self.void)} faults are void")

    def _lab(self, number: int, faults: int) -> None:
        draw = random.Random(f"{self.seed}/{number}")
        robots = draw.randint(5, 15) if self.robots is None else self.robots
        folder = self.folder / f"lab{number}"
        folder.mkdir()
        mount = ("mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "faults", str(folder))
        subprocess.run(mount, check=True)
        with ExitStack() as stack:
            canary, relay = Canary(), Relay(PORT, draw.getrandbits(32))
            stack.callback(canary.close)
            stack.callback(relay.close)
            attacker = Attacker(PORT, relay.inject)
            relay.ears.append(attacker.hear)
            stage = Stage(folder, relay, attacker, robots, draw.randrange(1, 10**6))
            stack.callback(stage.close)
            done = 0
            while done < faults:
                done += self._fault(stage, draw_fault(draw, stage), canary)
                if not stage.moving(stage.places):
                    return  # it was told, and nothing that follows would be this lab's fault
            canary.begin()
            verdict = draw.choice(ENDS)(stage, draw)
            if not self._is_void(verdict, canary):
                self._note(verdict)

    def _fault(self, stage: Stage, fault: Fault, canary: Canary) -> bool:
        """Has one fault befall a lab; False: the machine was too busy to judge it."""
        time.sleep(SETTLE_S)
        canary.begin()
        said, begun_ns = len(stage.lab.said), stage.now()
        ended_ns, missed = begun_ns, ""
        try:
            fault.begin(stage)
            while stage.now() - begun_ns < fault.lasts_s * 1e9:
                fault.go_on(stage)
            ended_ns = stage.now()
            fault.end(stage)
        except StageError as error:
            missed = str(error)
            stage.relay.calm()
        if fault.ends_late:
            ended_ns = stage.now()
        patience_s = 2.0 + 4.0 * fault.round_trip_s + 1.0
        back = lambda: stage.moving(stage.places)  # noqa: E731
        until_s = time.monotonic() + patience_s
        while time.monotonic() < until_s:
            with suppress(StageError):  # it is judged below
                stage.wait(back, "all robots in motion", until_s - time.monotonic())
            time.sleep(fault.aftermath_s)
            if back():
                break
        verdict = judge(stage, fault, Window(begun_ns, ended_ns, stage.now(), said))
        verdict.broken += [missed] if missed else []
        if self._is_void(verdict, canary):
            return False
        self._note(verdict)
        return True

    def _is_void(self, verdict: Verdict, canary: Canary) -> bool:
        """Whether what broke a promise may have been the machine; then it is noted as void."""
        if not (verdict.broken and (why := canary.busy())):
            return False
        self.void.append(verdict)
        _say(f"void     {verdict.name}: {why}; {verdict.broken[0]}")
        return True

    def _note(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)
        times = f"{verdict.stop_ns / 1e6:4.0f} ms {verdict.back_ns / 1e6:5.0f} ms"
        _say(f"{len(self.verdicts):4} {times}  {verdict.name}")
        for words in verdict.broken[:SHOWN]:
            _say(f"     BROKEN: {words}")
        if len(verdict.broken) > SHOWN:
            _say(f"     BROKEN: {len(verdict.broken) - SHOWN} more")


def _say(line: str) -> None:
    print(line, flush=True)


# --- how labs end


def ended(stage: Stage, draw: random.Random) -> Verdict:
    """By Ctrl-C or SIGTERM."""
    number = draw.choice([signal.SIGTERM, signal.SIGINT])
    verdict = Verdict(f"{number.name} lab")
    asked_ns = stage.now()
    code, took_s = stage.end(number)
    verdict.broken = judge_end(stage, number, code, took_s)
    timesteps = stage.lab.summary().get("timesteps") if not verdict.broken else None
    file = stage.lab.directory / "spin.mcap"
    verdict.broken += judge_recording(file, asked_ns, True, timesteps)  # type: ignore[arg-type]
    return verdict


def killed(stage: Stage, draw: random.Random) -> Verdict:
    """The host is killed: nobody goes on without it, and its recording is readable."""
    verdict = Verdict("SIGKILL lab")
    time.sleep(LOST_NS / 1e9)  # a host that hung until now has recorded nothing for longer
    stage.lab.process.kill()
    killed_ns = stage.now()
    stage.lab.end()
    try:
        stage.wait(lambda: not stage.lab.relatives(), "end of all processes", 5.0)
    except StageError as error:
        verdict.broken.append(str(error))
    verdict.broken += judge_kill(stage, killed_ns)
    file = stage.lab.directory / "spin.mcap"
    verdict.broken += judge_recording(file, killed_ns, False, None)
    return verdict


def full_disk(stage: Stage, draw: random.Random) -> Verdict:
    """The disk is full, the wheels' log with it: no robot is lost, and the figures are printed."""
    verdict = Verdict("full disk, SIGTERM")
    filler, before = stage.folder / "filler", len(stage.lab.said)
    with filler.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(1 << 16))
    time.sleep(2.0)
    said = "".join(stage.lab.said[before:])
    if "No space left on device" not in said:
        verdict.broken.append(f"the host did not say that the disk is full: {said[-300:]!r}")
    if "connection" in said or "base is gone" in said:
        verdict.broken.append("a robot was lost with the disk")
    code, took_s = stage.end(signal.SIGTERM)
    verdict.broken += judge_end(stage, signal.SIGTERM, code, took_s, logged=False)
    filler.unlink()
    return verdict


ENDS = (ended, ended, killed, full_disk)


# --- the command


def table(verdicts: list[Verdict]) -> list[str]:
    """How often each fault was tried, what broke, and the worst times."""
    rows = [["fault", "times", "broken", "worst stop", "worst return"]]
    names = sorted({verdict.name for verdict in verdicts})
    for name in [*names, "all"]:
        of = [v for v in verdicts if name in (v.name, "all")]
        stop, back = max(v.stop_ns for v in of), max(v.back_ns for v in of)
        rows.append(
            [
                name,
                str(len(of)),
                str(sum(map(bool, (v.broken for v in of)))),
                f"{stop / 1e6:.0f} ms" if stop else "",
                f"{back / 1e6:.0f} ms" if back else "",
            ]
        )
    return aligned(rows, left=1)


def inside(options: argparse.Namespace) -> int:
    """The campaign, in its namespaces."""
    folder = Path(tempfile.mkdtemp(prefix="vsense-faults-"))
    campaign = Campaign(folder, options.seed, options.robots)
    failed = ""
    try:
        campaign.run(options.seeds)
    except StageError as error:
        failed = str(error)
    broken = [verdict for verdict in campaign.verdicts if verdict.broken]
    print(*table(campaign.verdicts), sep="\n")
    counts = f"{len(campaign.verdicts)} faults, {len(broken)} broke a promise"
    print(f"seed {options.seed}: {counts}, {len(campaign.void)} void")
    if failed:
        print(f"ended early: {failed}")
    if failed or broken:
        print(f"what the labs left is in {folder}")
        return 1
    subprocess.run(["umount", *map(str, folder.iterdir())], check=False)
    shutil.rmtree(folder, ignore_errors=True)
    return 0


def main(words: list[str] | None = None) -> int:
    """Parses the command's words; starts the campaign in namespaces of its own."""
    parser = argparse.ArgumentParser(prog="scripts/bench faults", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="how many faults")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="what is drawn from")
    parser.add_argument("--robots", type=int, metavar="N", help="of each lab (default: 5 to 15)")
    options = parser.parse_args(words)
    if INSIDE in os.environ:
        return inside(options)
    command = ["unshare", "--net", "--mount", sys.executable, "-m", "tests.faults.campaign"]
    again = [f"--seeds={options.seeds}", f"--seed={options.seed}"]
    again += [] if options.robots is None else [f"--robots={options.robots}"]
    environment = {**os.environ, INSIDE: "1", "PYTHONPATH": str(ROOT)}
    return subprocess.run([*command, *again], cwd=ROOT, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())
