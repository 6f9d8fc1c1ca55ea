"""Four nodes in networks of their own: one is killed and comes back, one is late."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.conftest import require_own_network
from tests.rigs.places import ROOT


def test_who_is_killed_or_late_is_left_out_and_told_and_comes_back() -> None:
    pytest.importorskip("zenoh", reason="pip install vsense[nodes]")
    require_own_network()
    command = [sys.executable, "-m", "tests.faults.nodes", "--short"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    killed, late = json.loads(done.stdout)["faults"]
    assert "node west silent for 0.4 s" in killed["words"]
    assert "node north is" in late["words"] and "behind the quickest" in late["words"]
    assert killed["left_out"] == killed["timesteps"] > 0
    assert 0 < late["left_out"] <= late["timesteps"]
    for fault in (killed, late):
        assert fault["told_s"] is not None and fault["back_s"] is not None
        assert fault["lost"] == 0, "no pose that another node saw"
