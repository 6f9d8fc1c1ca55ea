"""What a robot does virtually is felt by another one: real daemons, real network, one world."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

PATIENCE_S = 120
TAGS = (31, 1843, 4334)

CONTROLLER = """
#include "controller.h"

#define SAID 0xA5

struct talker { int heard; int trail; int message; int release; double steps; };

static void init(void *state, struct vs_robot *robot)
{
    struct talker *s = state;

    s->heard = vs_robot_sensor(robot, "range_and_bearing");
    s->trail = vs_robot_sensor(robot, "pheromone");
    s->message = vs_robot_actuator(robot, "message");
    s->release = vs_robot_actuator(robot, "pheromone_release");
}

/* The ring shows what another robot has said, the body that there is pheromone here. */
static void step(void *state, struct vs_robot *robot)
{
    struct talker *s = state;
    double heard[4] = {0};
    unsigned int leds = 0;

    if (vs_robot_values(robot, s->heard, heard, 4) > 3 && heard[0] > 0)
        leds = (unsigned int)heard[3];
    if (vs_robot_read(robot, s->trail).value > 0.1)
        leds |= VS_ROBOT_LED_BODY;
    s->steps += 1;
    vs_robot_actuate(robot, s->message, 0, s->steps > 10 ? 1 : 0);
    vs_robot_actuate(robot, s->message, 1, SAID);
    vs_robot_actuate(robot, s->release, 1, 0.01 * s->steps);
    vs_robot_set_leds(robot, leds);
}

const struct vs_controller vs_controller = {"talker", sizeof(struct talker), init, step};
"""

EXPERIMENT = """<argos-configuration xmlns:vs="urn:vsense:1">
  <framework>
    <experiment length="3" ticks_per_second="10" random_seed="1" />
  </framework>
  <controllers>
    <talker_controller id="talker" library="talker.c">
      <sensors>
        <virtual_range_and_bearing_sensor range="0.8" data_size="1" vs:max_messages="1" />
        <virtual_field_sensor field="trail" name="pheromone" />
      </sensors>
      <actuators>
        <virtual_range_and_bearing_actuator data_size="1" />
        <virtual_pheromone_actuator field="trail" />
      </actuators>
      <params />
    </talker_controller>
  </controllers>
  <arena size="2.4,2,1" center="0,0,0.5">
    <vs:field id="trail" cell="0.05" />
    ROBOTS
  </arena>
</argos-configuration>
"""


def experiment(folder: Path) -> Path:
    places = ("0,0,0", "0.3,0,0", "0,0.3,0")
    robots = [
        f'<e-puck id="epuck_{tag}_{n}"><body position="{place}" orientation="0,0,0" />'
        '<controller config="talker" /></e-puck>'
        for n, (tag, place) in enumerate(zip(TAGS, places))
    ]
    (folder / "talker.c").write_text(CONTROLLER)
    path = folder / "talker.argos"
    path.write_text(EXPERIMENT.replace("ROBOTS", "\n".join(robots)))
    return path


def test_a_message_and_a_trace_travel_from_robot_to_world_to_robot(tmp_path: Path) -> None:
    output = tmp_path / "run"
    command = [sys.executable, "-m", "vsense", "lab", str(experiment(tmp_path)), "--port", "0"]
    done = subprocess.run(
        [*command, "--output", str(output)], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    for tag in TAGS:
        trace = (output / "robots" / f"{tag}.trace").read_text()
        leds = [int(found) for found in re.findall(r" leds (\d+) ", trace)]
        assert leds[0] == 0 and leds[-1] == 0x100 | 0xA5, f"robot {tag}: {leds}"
        assert 0x100 in leds, "the trace of the first steps is felt before anybody speaks"
