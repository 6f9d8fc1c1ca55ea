"""What the robot's service may do: by its unit as systemd reads it, and by what it drops."""

from __future__ import annotations

import fnmatch
import os
import re
import signal
import subprocess
from pathlib import Path

from tests.conftest import require_tool
from tests.rigs.processes import children
from tests.robots.rig import Rig
from vsense.robots import deploying

# Numbers of linux/capability.h; capabilities(7) has what each is for.
IPC_LOCK, NICE, RESOURCE = 1 << 14, 1 << 23, 1 << 24
KEPT = IPC_LOCK | NICE | RESOURCE
EXPOSURE_MAX = 50
"""Tenths, as `systemd-analyze security --threshold` takes them; without limits a unit has 96."""


def status(pid: int | str) -> dict[str, str]:
    """A process's /proc/PID/status."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}


def assert_limited(pid: int) -> None:
    """It has what moves a robot, and can get nothing else."""
    own = int(status("self")["CapPrm"], 16)
    found = status(pid)
    assert found["NoNewPrivs"] == "1"
    for field in ("CapPrm", "CapEff"):
        assert int(found[field], 16) == KEPT & own
    if own & 1 << 8:  # CAP_SETPCAP: who has none cannot bound its own
        assert int(found["CapBnd"], 16) == KEPT & int(status("self")["CapBnd"], 16)


def others(rig: Rig, processes: list[int]) -> set[int]:
    """Its processes that are not among these."""
    return set(children(rig.daemon.process.pid)) - set(processes)


def test_the_daemon_keeps_the_guards_capabilities_alone(talker: Path) -> None:
    rig = Rig(talker, kind="gctronic", options=",ground,rab")
    try:
        rig.start()
        rig.run()
        processes = [rig.daemon.process.pid, *children(rig.daemon.process.pid)]
        assert len(processes) >= 4, "worker, guard and two boards"
        for pid in processes:
            assert_limited(pid)
        guard = rig.daemon.guard
        assert guard is not None
        os.kill(guard, signal.SIGKILL)
        rig.wait_for(lambda: others(rig, processes), "another guard")
        rig.wait_for(lambda: rig.moving, "motion again")
        (another,) = others(rig, processes)
        assert_limited(another)
        own = int(status("self")["CapPrm"], 16)
        score = Path(f"/proc/{another}/oom_score_adj").read_text()
        # What the machine itself lets its root have.
        assert os.sched_getscheduler(another) == os.SCHED_FIFO or not own & NICE
        assert score == "-1000\n" or not own & RESOURCE
        assert not own & IPC_LOCK or int(status(another)["VmLck"].split()[0]) > 0
    finally:
        rig.close()


def unit_file(folder: Path) -> Path:
    """The unit, with programs that are on this machine."""
    text = deploying.service_files()["vsensed.service"].decode()
    path = folder / "vsensed.service"
    path.write_text(text.replace("/usr/local/bin/vsensed", "/bin/sh"))
    return path


def test_systemd_understands_every_line_of_the_unit(tmp_path: Path) -> None:
    analyze = require_tool("systemd-analyze", "systemd")
    command = [analyze, "verify", "--man=no", unit_file(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_systemd_calls_the_service_bounded(tmp_path: Path) -> None:
    analyze = require_tool("systemd-analyze", "systemd")
    words = ["security", "--offline=yes", f"--threshold={EXPOSURE_MAX}", "--no-pager"]
    command = [analyze, *words, unit_file(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout[-200:] + done.stderr


def test_every_base_is_among_the_devices_of_the_unit(program: Path) -> None:
    """A driver is called as its devices are: Documentation/admin-guide/devices.txt of Linux."""
    unit = deploying.service_files()["vsensed.service"].decode()
    allowed = re.findall(r"^DeviceAllow=(\S+)", unit, re.M)
    said = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    named = set(re.findall(r"/dev/([a-zA-Z]+[a-zA-Z0-9]*)", said))
    assert {"ttyS0", "ttyO0", "i2c", "watchdog"} <= named
    for name in named | {"rfcomm0", "ttyACM0", "ttyUSB0", "ttyAMA0", "gpiochip0"}:
        group = f"char-{name.rstrip('0123456789')}"
        assert any(fnmatch.fnmatchcase(group, pattern) for pattern in allowed), name
    assert not any(
        fnmatch.fnmatchcase(f"char-{name}", p) for p in allowed for name in ("mem", "tty")
    )
