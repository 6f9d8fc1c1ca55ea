"""Lets a whole lab run for an hour and watches what it takes: `scripts/bench soak [--minutes 60]`.

A real `vsense lab pollutant --record --web` runs, with a page that looks at everything. Every few
seconds the memory, descriptors and threads of each of its processes are read from /proc; the page
hears the latencies. Nothing is injected. A table shows what each kind of process has at the end and
its slopes, by least squares after the warm-up. Exit code 1 where a promise is broken.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np

from tests.rigs.processes import descendants

WARM_UP_SHARE, WARM_UP_S = 0.15, 90.0
"""So much of the time, and at least so long where that is less than half: then caches and tables
are full."""
KIB_PER_MIN = {"host": 64.0, "cameras": 32.0, "physics": 32.0, "robots": 32.0, "other": 32.0}
"""More than this no kind of process may grow by. The host notes 40 bytes a timestep for the run's
figures, 24 KiB a minute, and while it records an index for the file's end, 20 KiB a minute. Robots
are all of them together."""
PARTS = 12
"""The time after the warm-up falls into so many, whose medians are compared."""
LATENCY_TIMES, LATENCY_MORE_MS = 1.5, 10.0
"""The latency's median of the last quarter may be so much longer than that of the first."""
_END_S = 60.0
"""For the lab's figures and its picture, after its time."""
KINDS = ("host", "cameras", "physics", "robots", "other")


@dataclass(frozen=True, slots=True)
class Sample:
    """What the processes of one kind have together."""

    at_s: float
    processes: int
    kib: float
    descriptors: int
    threads: int


@dataclass(slots=True)
class Heard:
    """What the page heard: latencies [ms] with their time, frames, and why it had to come anew."""

    latencies: list[tuple[float, float, float]] = field(default_factory=list)
    frames: int = 0
    again: list[str] = field(default_factory=list)


def kind_of(pid: int, host: int) -> str:
    """One of KINDS."""
    if pid == host:
        return "host"
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    for part, kind in (("vsensed", "robots"), ("cameras", "cameras"), ("physics", "physics")):
        if part in words:
            return kind
    return "other"


def _takes(pid: int) -> tuple[float, int, int]:
    """KiB in memory that are its own, descriptors, threads."""
    status = dict(
        line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines()
    )
    kib = sum(float(status[name].split()[0]) for name in ("RssAnon", "RssShmem"))
    return kib, len(os.listdir(f"/proc/{pid}/fd")), int(status["Threads"])


def sample(host: int, at_s: float) -> Iterator[tuple[str, Sample]]:
    """Looks at all processes of a lab once."""
    sums = {kind: [0.0, 0.0, 0.0, 0.0] for kind in KINDS}
    for pid in (host, *sorted(descendants(host))):
        try:
            takes = (1.0, *_takes(pid))
            kind = kind_of(pid, host)
        except (OSError, KeyError):
            continue  # it has just ended
        sums[kind] = [a + b for a, b in zip(sums[kind], takes)]
    for kind, (count, kib, descriptors, threads) in sums.items():
        if count:
            yield kind, Sample(at_s, int(count), kib, int(descriptors), int(threads))


class Page(threading.Thread):
    """A page that looks at one robot and all pictures until it is told to stop."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.heard = Heard()
        self.ended = False
        self._port = port

    def run(self) -> None:
        """Comes again where the server is not there."""
        while not self.ended:
            try:
                asyncio.run(self._look())
            except (aiohttp.ClientError, OSError, asyncio.TimeoutError) as error:
                if self.heard.frames:
                    self.heard.again.append(f"{type(error).__name__}: {error}")
                time.sleep(1.0)

    async def _look(self) -> None:
        base = f"http://127.0.0.1:{self._port}"
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{base}/ws", headers={"Origin": base}, max_msg_size=0) as page,
        ):
            count = 0
            async for message in page:
                count += 1
                self.heard.frames += 1
                if count % 10 == 1:
                    await page.send_json({"got": count})
                if message.type is aiohttp.WSMsgType.TEXT:
                    await self._hear(page, *json.loads(message.data))

    async def _hear(
        self, page: aiohttp.ClientWebSocketResponse, topic: str, time_ns: int, data: Any
    ) -> None:
        if topic == "/experiment":
            cameras = [camera["id"] for camera in data.get("cameras", [])]
            await page.send_json({"pictures": cameras})
            await page.send_json({"look": data["robots"][0]["tag"]})
        elif topic == "/run" and data["state"] == "running" and data["latency_ms"]:
            latency = data["latency_ms"]
            self.heard.latencies.append((time.monotonic(), latency["p50"], latency["p99"]))


def slope_per_h(times_s: Sequence[float], values: Sequence[float]) -> float:
    """By least squares, per hour; 0 of too few."""
    if len(times_s) < 3:
        return 0.0
    return float(np.polyfit(np.array(times_s) / 3600.0, np.array(values), 1)[0])


@dataclass(slots=True)
class Soak:
    """All that was seen; times from the first sample on."""

    length_s: float
    kinds: dict[str, list[Sample]] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    def warm(self, kind: str) -> list[Sample]:
        """The samples after the warm-up."""
        begin_s = max(WARM_UP_SHARE * self.length_s, min(WARM_UP_S, 0.5 * self.length_s))
        return [one for one in self.kinds[kind] if one.at_s >= begin_s]

    def table(self) -> str:
        """One row per kind; notes what is broken."""
        head = ("", "processes", "MiB", "MiB/h", "fds", "fds/h", "threads", "threads/h")
        rows = [head]
        for kind in (kind for kind in KINDS if kind in self.kinds):
            warm = self.warm(kind)
            if not warm:
                continue
            times = [one.at_s for one in warm]
            grows = slope_per_h(times, [one.kib for one in warm])
            more = [slope_per_h(times, [float(one.descriptors) for one in warm])]
            more.append(slope_per_h(times, [float(one.threads) for one in warm]))
            self._judge(kind, warm)
            last = warm[-1]
            rows.append(
                (
                    *(kind, str(last.processes), f"{last.kib / 1024:.1f}", f"{grows / 1024:+.2f}"),
                    *(str(last.descriptors), f"{more[0]:+.2f}"),
                    *(str(last.threads), f"{more[1]:+.2f}"),
                )
            )
        widths = [max(len(row[place]) for row in rows) for place in range(len(head))]
        return "\n".join("  ".join(map(str.rjust, row, widths)) for row in rows)

    def _judge(self, kind: str, warm: Sequence[Sample]) -> None:
        """What leaks grows in all parts. The largest step from one part to the next does not count:
        one comes once, with the pictures that are kept for a run's figure. Parts are compared by
        their medians: within a part pictures come and go by megabytes."""
        ends = [round(n * len(warm) / PARTS) for n in range(PARTS + 1)]
        parts = [warm[start:end] for start, end in itertools.pairwise(ends)]
        steps = np.diff([np.median([o.kib for o in part]) for part in parts if part])
        length_min = max(warm[-1].at_s - warm[0].at_s, 60.0) / 60.0
        kib_per_min = float(steps.sum() - max(steps, default=0.0)) / length_min
        if kib_per_min > KIB_PER_MIN[kind]:
            self.broken.append(f"{kind}: memory grows by {kib_per_min:.0f} KiB a minute")
        quarter = max(1, len(warm) // 4)
        for name in ("processes", "descriptors", "threads"):
            first = max(int(getattr(one, name)) for one in warm[:quarter])
            last = min(int(getattr(one, name)) for one in warm[-quarter:])
            if last > first:
                self.broken.append(f"{kind}: {name} grow from {first} to {last}")

    def judge_latency(self, heard: Heard) -> str:
        """What the page heard of the latency, in a line."""
        every = heard.latencies[int(WARM_UP_SHARE * len(heard.latencies)) :]
        if len(every) < 8:
            self.broken.append(f"the page heard {len(heard.latencies)} latencies only")
            return ""
        quarter = len(every) // 4
        first, last = (float(np.median([p50 for _, p50, _ in part])) for part in
                       (every[:quarter], every[-quarter:]))  # fmt: skip
        if last > LATENCY_TIMES * first + LATENCY_MORE_MS:
            self.broken.append(f"latency rose from {first:.1f} to {last:.1f} ms")
        drift = [slope_per_h([row[0] for row in every], [row[k] for row in every]) for k in (1, 2)]
        return (
            f"latency   median {first:.1f} ms in the first quarter, {last:.1f} ms in the last;"
            f" p50 {drift[0]:+.2f} ms/h, p99 {drift[1]:+.2f} ms/h; {heard.frames} frames"
        )

    def judge_summary(self, summary: Mapping[str, Any], code: int) -> str:
        """What the lab says of itself, in a line."""
        link = summary.get("link", {})
        if code != 0:
            self.broken.append(f"the lab ended with {code}")
        if link.get("reconnects", 1):
            self.broken.append(f"robots reconnected {link.get('reconnects', '?')} times")
        sent = int(link.get("sent", 0))
        lost = sent - int(link.get("received", 0))
        steps, late = summary.get("timesteps", 0), summary.get("late_timesteps", 0)
        return (
            f"lab       {steps} timesteps, {late} late; {lost} of {sent} datagrams lost,"
            f" {link.get('reconnects')} reconnects"
        )


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


def watch(lab: subprocess.Popen[str], length_s: float, every_s: float) -> Soak:
    """Samples until the run's time is over or the lab ends."""
    soak, began_s = Soak(length_s), time.monotonic()
    while lab.poll() is None and time.monotonic() - began_s < length_s:
        at_s = time.monotonic() - began_s
        for kind, one in sample(lab.pid, at_s):
            soak.kinds.setdefault(kind, []).append(one)
        time.sleep(every_s)
    return soak


def main(words: Sequence[str] | None = None) -> int:
    """Runs the soak; gives the exit code."""
    parser = argparse.ArgumentParser(prog="scripts/bench soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="of the run (default: 60)")
    parser.add_argument("--every", type=float, default=5.0, help="seconds between two samples")
    parser.add_argument("--robots", type=int, help="the first of the file's (default: all)")
    parser.add_argument("--samples", type=Path, help="write all samples there, a line of JSON each")
    options = parser.parse_args(words)
    length_s, port = 60.0 * options.minutes, _free_port()
    with tempfile.TemporaryDirectory(prefix="vsense-soak-") as folder:
        command = [sys.executable, "-m", "vsense", "lab", "pollutant", "--record", "--json"]
        command += ["--web", str(port), "--duration", f"{length_s:g}", "-o", f"{folder}/run"]
        command += ["--robots", str(options.robots)] if options.robots else []
        with (
            open(f"{folder}/said", "w+") as said,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, text=True) as lab,
        ):
            page = Page(port)
            page.start()
            soak = watch(lab, length_s, options.every)
            page.ended = True
            try:
                out = lab.communicate(timeout=_END_S)[0]
            except subprocess.TimeoutExpired:
                lab.kill()
                out = ""
                soak.broken.append(f"the lab did not end within {_END_S:g} s after its time")
            said.seek(0)
            words_of_lab = said.read()
        code = lab.returncode
    if options.samples is not None:
        rows = [{"kind": k, **asdict(one)} for k, every in soak.kinds.items() for one in every]
        options.samples.write_text("".join(json.dumps(row) + "\n" for row in rows))
    summary = json.loads(out) if out.strip().startswith("{") else {}
    lines = [soak.table(), soak.judge_latency(page.heard), soak.judge_summary(summary, code)]
    soak.broken += [f"the page had to come again: {why}" for why in page.heard.again]
    print("\n".join(filter(None, lines)))
    if not summary:
        print(words_of_lab[-2000:], file=sys.stderr)
    for why in soak.broken:
        print(f"broken    {why}")
    print(f"verdict   {'broken' if soak.broken else 'every promise is kept'}")
    return 1 if soak.broken else 0


if __name__ == "__main__":
    sys.exit(main())
