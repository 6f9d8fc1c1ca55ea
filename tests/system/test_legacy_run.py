"""`vsense run --legacy-port`: a robot with the original's client beside one with `vsensed`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.robots.link.legacy_rig import Client, Relay
from tests.system.floor import MS, Floor, OriginalTracker, clean_air

pytestmark = pytest.mark.system

TAGS = [23, 24]
LEGACY_OCTET = 30
TRACKED = '<framework ats_host="127.0.0.1" ats_port="4040">'


@pytest.fixture
def floor() -> Iterator[Floor]:
    made = Floor(TAGS)
    yield made
    made.close()


def experiment(folder: Path, framework: str, length_s: float) -> Path:
    """Writes an experiment for both robots; robot 23 has the address x.x.x.30."""
    path = folder / "mixed.argos"
    path.write_text(f"""<argos-configuration xmlns:vs="urn:vsense:1">
{framework}<experiment length="{length_s}" ticks_per_second="10" random_seed="1" /></framework>
<controllers><pollutant_controller id="wanderer" library="pollutant">
<actuators><epuck_wheels implementation="default" /></actuators>
<sensors>
  <epuck_proximity implementation="default" />
  <gps_virtual_sensor implementation="default" />
  <virtual_led_sensor implementation="default" vs:max_blobs="2" />
  {clean_air(folder)}
</sensors>
<params speed_cm_s="8" walk_s="100" />
</pollutant_controller></controllers>
<arena size="3,2,1" center="0,0,0.5">
<e-puck id="epuck_23_30"><body position="0,0.1,0" orientation="0,0,0"/>
<controller config="wanderer"/></e-puck>
<e-puck id="epuck_24_31"><body position="0.2,0.1,0" orientation="0,0,0"/>
<controller config="wanderer"/></e-puck>
</arena>
<physics_engines><dynamics2d id="dyn2d" /></physics_engines><media />
</argos-configuration>
""")
    return path


def test_a_mixed_swarm_runs_together(floor: Floor, tmp_path: Path) -> None:
    tracker = OriginalTracker(TAGS)
    floor.add(tracker)
    file = experiment(tmp_path, tracker.framework(), 2)
    words = ["--port", "0", "--legacy-port", "0", "--output", str(tmp_path / "notes"), "--json"]
    words += ["--host", "0.0.0.0"]
    program = floor.program("run", str(file), *words)
    floor.wait_for(program.heard(r"original client on port \d+\n"), "its ports")
    legacy_port = int(re.findall(r"original client on port (\d+)", program.said)[0])
    robots = "not authenticated: robots' port on 0.0.0.0 (--insecure): anybody can drive robots"
    floor.wait_for(program.heard(re.escape(robots)), "what is said of robots without keys")
    said = f"not authenticated: original client's port {legacy_port} on 0.0.0.0: any machine"
    floor.wait_for(program.heard(said), "what is open")
    port = int(re.findall(r"waiting for robots on .*, port (\d+)", program.said)[0])
    floor.wait_for(program.heard("does not know the sensor 'leds': not sent to it"), "a word")
    floor.connect(24, port)
    floor.wait_for(program.heard(r"robot 24: connected"), "vsensed")
    floor.live_for(300 * MS)
    assert floor.resting() and "all robots start" not in program.said
    robot = Client(Relay(legacy_port, LEGACY_OCTET, "split").port, LEGACY_OCTET)
    robot.start()
    floor.wait_for(program.heard("all robots start"), "the start")
    tracker.places[23] = (-0.5, 0.25, 180.0)
    floor.wait_for(lambda: program.ended, "the end")
    assert program.process.returncode == 0, program.said
    learnt = robot.finish()
    assert learnt.table == {3: 36, 7: 12} and learnt.started and learnt.ended
    assert learnt.values[3] == pytest.approx((-0.5, 0.25, 3.14159), abs=1e-4)
    figures = json.loads(program.printed)
    assert figures["ended"] == "time" and figures["missing_at_start"] == []


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--port", "4051", "--legacy-port", "4051"], "--legacy-port: 4051 is the port for"),
        (["--legacy-port", "70000"], "argument --legacy-port: 70000: expected 0 to 65535"),
    ],
)
@pytest.mark.quick
def test_ports_that_cannot_be(floor: Floor, tmp_path: Path, words: list[str], text: str) -> None:
    file = experiment(tmp_path, TRACKED, 2)
    program = floor.program("run", str(file), *words, "--output", str(tmp_path / "notes"))
    floor.wait_for(lambda: program.ended, "the end")
    assert program.process.returncode == 2
    assert text in program.said


@pytest.mark.quick
def test_robots_that_it_cannot_tell_apart(floor: Floor, tmp_path: Path) -> None:
    file = experiment(tmp_path, TRACKED, 2)
    file.write_text(file.read_text().replace("epuck_24_31", "epuck_24_30"))
    words = ["--port", "0", "--legacy-port", "0", "--output", str(tmp_path / "notes")]
    program = floor.program("run", str(file), *words)
    floor.wait_for(lambda: program.ended, "the end")
    assert program.process.returncode == 1
    assert "epuck_23_30 and epuck_24_30 have the same number 30" in program.said
