"""The fence of a real run: emulated robots that are told to drive through it, and on and on."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.rigs.processes import free_port
from tests.system.rehearsal import Curtain, Network, Places, emulated
from vsense.modes.lab._microcontrollers import read_actuations

pytestmark = pytest.mark.system

LIMIT_M, SPEED_M_S, STEPS_S = 0.4, 0.1, 769
"""Of the fence along x; of all wheels, 10 kHz / 13 steps of 0.128805 mm (epuck.md 6)."""
PLAIN, UNSEEN, CUT = 1, 2, 3
STARTS_M = {PLAIN: 0.25, UNSEEN: 0.15, CUT: -0.1}
CUT_S = 2.0
MOST_S = {PLAIN: 1.0, UNSEEN: 2.5, CUT: 1.5}
"""The promise is a timestep or two, 1 s more, and 0.4 s; the rest is left to a busy machine."""

EXPERIMENT = """<argos-configuration xmlns:vs="urn:vsense:1">
<framework><experiment length="9" ticks_per_second="10" /></framework>
<controllers><c id="c" library="ahead.c" /></controllers>
<arena size="3,2,1">{robots}
  <vs:geofence polygon="-1.4,-0.9 {limit},-0.9 {limit},0.9 -1.4,0.9" v_max="0.1" />
</arena></argos-configuration>"""
ROBOT = """
<e-puck id="robot_{tag}_{tag}"><body position="{x_m},{y_m},0" orientation="0,0,0" />
<controller config="c" /></e-puck>"""
AHEAD = """#include "controller.h"
static void init(void *state, struct vs_robot *robot) { (void)state; (void)robot; }
static void step(void *state, struct vs_robot *robot)
{
    (void)state;
    vs_robot_set_wheels(robot, VS_ROBOT_MAX_STEPS_S, VS_ROBOT_MAX_STEPS_S);
}
const struct vs_controller vs_controller = {"ahead", 0, init, step, NULL};
"""


class Mishaps:
    """Hides one robot at the fence, then cuts the network when another one comes to it."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._began_s: dict[int, float] = {}

    def hidden(self, places: Places, time_s: float) -> set[int]:
        """Who is hidden now."""
        for tag in (UNSEEN, CUT):
            if places[tag][0] > LIMIT_M - 0.02:
                self._began_s.setdefault(tag, time_s)
        if self._lasts(CUT, time_s):
            self._network.cut.set()
        else:
            self._network.cut.clear()
        return {UNSEEN} if self._lasts(UNSEEN, time_s) else set()

    def _lasts(self, tag: int, time_s: float) -> bool:
        return 0.0 <= time_s - self._began_s.get(tag, time_s + 1.0) < CUT_S


def test_nobody_crosses_the_fence_by_more_than_its_stop_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robots = "".join(
        ROBOT.format(tag=tag, x_m=x_m, y_m=0.6 * (tag - 2)) for tag, x_m in STARTS_M.items()
    )
    file = tmp_path / "ahead.argos"
    file.write_text(EXPERIMENT.format(robots=robots, limit=LIMIT_M))
    (tmp_path / "ahead.c").write_text(AHEAD)
    with emulated(tmp_path, experiment=str(file), robots=3) as stage:
        lines, port = free_port(), free_port()
        curtain = Curtain(stage.lines, lines, Mishaps(Network(stage.port, port)).hidden)
        done = stage.run("--json", "-o", str(tmp_path / "run"), lines=lines, port=port)
    assert done.returncode == 1, done.stderr
    assert "had no link for 1." in json.loads(done.stdout)["why"], "while it was cut"
    times_ns = np.array(sorted(curtain.places))
    rows = read_actuations(tmp_path / "robots" / "actuations.bin")
    per_robot = {robot["tag"]: robot for robot in json.loads(done.stdout)["per_robot"]}
    assert np.abs(rows["left_steps_s"]).max() == STEPS_S, "1000 are asked for"
    assert per_robot[CUT]["longest_silence_s"] > 0.7 * CUT_S, "and it was heard again"
    for number, tag in enumerate(STARTS_M):
        x_m = np.array([curtain.places[ns][tag][0] for ns in times_ns.tolist()])
        crossed_ns = np.interp(LIMIT_M, x_m[: x_m.argmax() + 1], times_ns[: x_m.argmax() + 1])
        own = rows[(rows["robot"] == number) & (rows["time_ns"] > crossed_ns)]
        stopped_ns = own["time_ns"][own["left_steps_s"] == 0][0]
        took_s, over_m = (stopped_ns - crossed_ns) / 1e9, float(x_m.max()) - LIMIT_M
        with capsys.disabled():
            print(f"\n{tag}: {1000 * over_m:.0f} mm beyond the fence, {took_s:.2f} s to its stop")
        assert 0.0 < took_s < MOST_S[tag]
        assert over_m <= SPEED_M_S * took_s + 0.003
        assert x_m.max() - x_m[-1] < 0.001 and 0.5 < per_robot[tag]["stood_fenced_s"] < 9.0
        assert f"robot {tag} stands: outside of the fence" in done.stderr
    assert re.search(r"robot 2 stands: not seen for 1\.\d s", done.stderr)
    assert "robot 2 is seen again; it stood" in done.stderr, "and stays where it is"
    assert "goes on" not in done.stderr
    row = (tmp_path / "run" / "runs.csv").read_text()
    assert re.search(r"robot 1 stood \d\.\d s for the fence", row)
