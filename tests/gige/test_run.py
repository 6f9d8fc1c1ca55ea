"""`vsense run` with four GigE Vision cameras, real daemons and emulated bases."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.gige.conftest import ROBOTS
from tests.gige.faults import VICTIM
from tests.gige.network import CAMERAS, MIDDLE, MIDDLES, GigeCameras
from tests.system.floor import MS, Floor, experiment

pytestmark = pytest.mark.system

TAGS = [robot.tag for robot in ROBOTS]


@pytest.fixture
def floor() -> Iterator[Floor]:
    made = Floor(TAGS)
    yield made
    made.close()


def test_robots_drive_by_what_four_cameras_see(
    rig: GigeCameras, floor: Floor, tmp_path: Path
) -> None:
    rig.start()
    settings = {**MIDDLE, "trigger": "software"}
    file = experiment(tmp_path, "<framework>", TAGS, 600)
    words = ["--tracking", *rig.files(tmp_path, settings, cameras=MIDDLES), "--port", "0", "--json"]
    program = floor.program("run", str(file), *words, "--output", str(tmp_path / "notes"))
    waiting = r"waiting for robots on .*, port (\d+)"
    floor.wait_for(program.heard(waiting), "its port")
    found = re.search(waiting, program.said)
    assert found is not None
    for tag in TAGS:
        floor.connect(tag, int(found[1]))
    floor.wait_for(floor.moving, "motion")
    floor.live_for(1000 * MS)
    rig.kill(VICTIM)
    floor.wait_for(program.heard(f"camera {CAMERAS[VICTIM].id}: is gone"), "word of it")
    floor.live_for(300 * MS)
    assert floor.moving() and "no arena state for" not in program.said, "the others go on"
    rig.start(VICTIM)
    floor.wait_for(program.heard(f"camera {CAMERAS[VICTIM].id}: is back"), "its return")
    floor.live_for(500 * MS)
    assert floor.moving()
    program.tell(signal.SIGINT)
    floor.wait_for(lambda: program.ended, "its end")
    assert program.process.returncode == 130
    assert floor.resting()
    figures = json.loads(program.printed)
    assert figures["source"]["kind"] == "cameras" and figures["arena"]["silences"] == []
    assert figures["missing_at_start"] == []
    seen = {robot["tag"]: robot["seen_share"] for robot in figures["per_robot"]}
    victim = ROBOTS[VICTIM].tag
    assert all(share > 0.9 for tag, share in seen.items() if tag != victim), seen
    assert 0.0 < seen[victim] < 1.0
