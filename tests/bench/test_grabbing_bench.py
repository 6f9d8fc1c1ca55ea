"""The benchmark of GigE cameras, with the fake one in a network of its own. No time is asserted."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tests.bench import grabbing, main
from tests.conftest import lack, require_library, require_tool
from tests.rigs.places import ROOT


@pytest.mark.system
def test_every_way_of_working_is_measured_on_all_pictures() -> None:
    """In a network of its own: loopback is one for all tests that run at the same time."""
    require_tool("arv-fake-gv-camera-0.8", "aravis-tools")
    require_library("libaravis-0.8.so.0", "libaravis-0.8-0")
    alone = [require_tool("unshare", "util-linux"), "--net", "sh", "-c"]
    short = "from tests.bench import grabbing, main; grabbing.TURN_S = 0.5"
    words = "['grabbing', '--rounds', '1', '--json']"
    code = f"{short}; raise SystemExit(main.main({words}))"
    bench = f'ip link set lo up && {sys.executable} -c "{code}"'
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([*alone, bench], capture_output=True, text=True, env=environment)
    if "unshare failed" in done.stderr:
        lack(f"no network namespaces here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    ways = [(row["work"], row["packet_size"]) for row in report["rows"]]
    assert ways == [
        (work, size) for size in grabbing.PACKETS for work in ("detect", "grab", "grab and detect")
    ]
    assert all(row["pictures"] == 5 and row["cpu_ms"] > 0.0 for row in report["rows"])
    lines = grabbing.table(report).splitlines()
    assert len(lines) == 1 + len(ways) + len(grabbing.PACKETS)
    assert lines[-1].startswith("grabbing a picture of 1620 x 1220 px costs ")


def test_without_a_camera_the_package_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(grabbing.shutil, "which", lambda name: None)
    assert main.main(["grabbing"]) == 1
    assert "apt-get install aravis-tools, or give --device" in capsys.readouterr().err
