"""A run that is stepped, and the environment for learning: PettingZoo's own tests among others."""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test
from pettingzoo.test.render_test import render_test
from pettingzoo.utils.conversions import parallel_to_aec

import vsense
from tests.rigs.places import DATA
from vsense import SteppedSimulation, cli
from vsense.base.errors import UsageError
from vsense.studies.notebook import parallel_env

STEPS_PER_CM = 77.64
"""Of an e-puck's wheel. Source: robot/controller.h."""


def controller(name: str) -> Any:
    names: dict[str, Any] = {}
    exec((DATA / "python" / f"{name}.py").read_text(), names)
    return names["SwarmController"]


def test_a_stepped_run_is_that_of_the_controller_in_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["sim", "phototaxis", "--duration", "20", "--seed", "4", "-o", "c"]) == 0
    with np.load("c/trajectory.npz") as run:
        poses, leds = run["poses"], run["leds"]
    experiment = vsense.load("phototaxis", duration_s=20).experiment
    with SteppedSimulation(experiment, 4) as sim:
        moths = controller("moths")(sim.swarm)
        for timestep in range(200):
            assert (sim.timestep, sim.done) == (timestep, False)
            assert np.array_equal(sim.poses, poses[timestep])
            moths.step(sim.swarm)
            sim.step()
        assert sim.done and not sim.finished and leds.any()
        with pytest.raises(ValueError, match="the run is over"):
            sim.step()
    assert not any("(work)" in thread.name for thread in threading.enumerate())


def test_a_run_that_is_left_ends_and_one_that_fails_says_why() -> None:
    experiment = vsense.load("phototaxis", duration_s=20).experiment
    before = threading.active_count()
    with SteppedSimulation(experiment, 1) as sim:
        sim.step()
    assert threading.active_count() == before and sim.done
    with SteppedSimulation(experiment, 1) as sim, pytest.raises(ValueError, match="one number"):
        sim.swarm.set_wheels([1, 2], 3)


CIRCLES = """
class SwarmController:
    def __init__(self, swarm):
        self.prey = swarm.sensor("leds")

    def step(self, swarm):
        swarm.set_wheels(300, 200 + self.prey.values.any(axis=1))
"""


def test_a_run_that_is_dropped_ends() -> None:
    sim = SteppedSimulation(vsense.load("foraging", robots=2, duration_s=5), seed=1)
    sim.step()
    thread = sim._thread
    del sim
    thread.join(10)
    assert not thread.is_alive()


FORKED = """
import os, vsense
sim = vsense.SteppedSimulation(vsense.load("foraging", robots=2, duration_s=5), seed=1)
if os.fork():
    sim.step()
    raise SystemExit(os.waitstatus_to_exitcode(os.wait()[1]))
sim.step()
"""


def test_a_fork_does_not_wait_for_a_thread_that_it_has_not() -> None:
    command = [sys.executable, "-c", FORKED]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "RuntimeError: the simulation runs in the process" in ran.stderr
    assert ran.returncode == 1


def test_one_of_several_controllers_is_stepped_and_the_others_run_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "hunt", "--from", "predator_prey"]) == 0
    path = tmp_path / "hunt" / "hunt.argos"
    text = path.read_text()
    assert 'library="predator.c"' in text
    path.write_text(text.replace('library="predator.c"', 'library="circles.py"'))
    (path.parent / "circles.py").write_text(CIRCLES)
    assert cli.main(["sim", str(path), "--duration", "10", "--lenient", "-o", "out"]) == 0
    with np.load("out/trajectory.npz") as run:
        poses, tags = run["poses"], run["tags"].tolist()
    experiment = vsense.load("predator_prey", duration_s=10).experiment
    with SteppedSimulation(experiment, 1, controller="predator") as sim:
        rows = [tags.index(tag) for tag in sim.swarm.tags]
        assert len(rows) == 4 and np.ptp(poses[:, :, 0], axis=0).min() > 0.01
        names: dict[str, Any] = {}
        exec(CIRCLES, names)
        predators = names["SwarmController"](sim.swarm)
        while not sim.done:
            assert np.array_equal(sim.poses, poses[sim.timestep, rows])
            predators.step(sim.swarm)
            sim.step()
    env = parallel_env("predator_prey", duration_s=2, controller="prey")
    env.reset(seed=1)
    assert len(env.agents) == 10 and env.state().shape == (30,)


def make(**how: Any) -> Any:
    return parallel_env("foraging", **{"robots": 4, "duration_s": 5, **how})


def test_it_is_what_pettingzoo_asks_for() -> None:
    parallel_api_test(make(), num_cycles=150)
    parallel_seed_test(make, num_cycles=60)
    render_test(lambda render_mode: parallel_to_aec(make(render_mode=render_mode)))


def test_agents_actions_and_observations() -> None:
    env = make(leds=True, actuators={"pheromone_release": (0.0, 2.0)})
    observations, _ = env.reset(seed=3)
    assert env.agents == ["robot_31", "robot_1843", "robot_4334", "robot_7167"]
    assert env.action_space("robot_31").shape == (4,)
    start = env.state().reshape(-1, 3)
    ahead = dict.fromkeys(env.agents, np.array([0.5, 0.5, 1.0, 1.0], np.float32))
    for _ in range(10):
        observations, rewards, *_ = env.step(ahead)
    moved_m = np.hypot(*(env.state().reshape(-1, 3) - start)[:, :2].T)
    # 10 steps at 500 steps/s but for those before the first command: 6.44 cm in a second.
    free = moved_m > 0.04
    assert free.any()
    assert np.allclose(moved_m[free], 0.01 * 500 / STEPS_PER_CM, atol=0.007)
    space = env.observation_space("robot_31")
    assert all(space.contains(row) for row in observations.values())
    smelt = env.simulation.swarm.sensor("pheromone").value
    assert (smelt > 0.0).all(), "they smell what they have released"
    assert all(smelt[row].astype(np.float32) in o for row, o in enumerate(observations.values()))
    assert (env.simulation._run.leds == 0xFF).all() and set(rewards.values()) == {0.0}
    env.close()


def test_rewards_are_a_measures_increase_or_a_function() -> None:
    env = make(reward=lambda sim: sim.poses[:, 0])
    env.reset(seed=1)
    still = dict.fromkeys(env.agents, np.zeros(2, np.float32))
    _, rewards, *_ = env.step(still)
    assert np.allclose(list(rewards.values()), env.state().reshape(-1, 3)[:, 0], atol=1e-6)
    env = parallel_env("phototaxis", robots=3, duration_s=3)
    env.reset(seed=1)
    total, first = 0.0, env.simulation.results["light_distance_m"]
    still = dict.fromkeys(env.agents, np.zeros(2, np.float32))
    while env.agents:
        _, rewards, terminations, truncations, infos = env.step(still)
        total += rewards["robot_31"]
    assert total == pytest.approx(infos["robot_31"]["measures"]["light_distance_m"] - first)
    assert set(truncations.values()) == {True} and set(terminations.values()) == {False}
    with pytest.raises(UsageError, match="reset"):
        env.step(still)


def test_what_is_no_action_or_reward_is_named_by_its_agent() -> None:
    env = make(reward=lambda sim: [1.0, np.nan, 0.0, 0.0])
    with pytest.raises(UsageError, match="there is no run"):
        env.state()
    env.reset(seed=1)
    still = dict.fromkeys(env.agents, np.zeros(2, np.float32))
    for wrong in (np.zeros(7), np.zeros(1), 0.5, np.array([0.0, np.nan])):
        with pytest.raises(UsageError, match=r"robot_1843 has .*; expected 2 finite numbers"):
            env.step({**still, "robot_1843": wrong})
    with pytest.raises(UsageError, match="robot_31 has none"):
        env.step({agent: still[agent] for agent in env.agents[1:]})
    assert env.simulation.timestep == 0
    with pytest.raises(UsageError, match="reward: robot_1843 has nan"):
        env.step(still)


def test_less_of_a_measure_can_be_what_is_wanted() -> None:
    environments = [
        parallel_env("phototaxis", robots=2, duration_s=2, reward=f"{sign}light_distance_m")
        for sign in ("", "-")
    ]
    totals = []
    for env in environments:
        env.reset(seed=1)
        ahead, total = dict.fromkeys(env.agents, np.ones(2, np.float32)), 0.0
        while env.agents:
            total += env.step(ahead)[1]["robot_31"]
        totals.append(total)
    assert totals[0] == -totals[1] != 0.0


def test_copies_without_a_seed_are_not_the_same() -> None:
    """As a vectorised environment makes them."""
    first, second = (pickle.loads(pickle.dumps(make())) for _ in range(2))
    first.reset()
    second.reset()
    assert first.seed != second.seed and not np.array_equal(first.state(), second.state())
    before = first.seed
    first.reset()
    assert first.seed == before % (2**32 - 1) + 1
    again = make()
    again.reset(seed=np.int64(first.seed))
    assert np.array_equal(again.state(), first.state())


INTERRUPTED = """
import random, signal
import numpy as np
import vsense

def interrupt(number, frame):
    while frame is not None and frame.f_code.co_name != "step":
        frame = frame.f_back
    if frame is not None:
        raise KeyboardInterrupt

signal.signal(signal.SIGALRM, interrupt)
interruptions, leaps = 0, set()
loaded = vsense.load("foraging", robots=15, duration_s=60)
with vsense.SteppedSimulation(loaded, np.int64(2)) as sim:
    while not sim.done:
        before = sim.timestep
        signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-6, 2e-4))
        try:
            sim.step()
        except KeyboardInterrupt:
            interruptions += 1
        signal.setitimer(signal.ITIMER_REAL, 0)
        leaps.add(sim.timestep - before)
    print(interruptions, sim.timestep, sorted(leaps))
"""


def test_an_interrupted_step_is_made_whole() -> None:
    """Ctrl-C in a notebook, again and again: every step is one timestep, or none."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    interruptions, timestep, leaps = done.stdout.split(maxsplit=2)
    assert int(interruptions) > 5 and int(timestep) == 599
    assert leaps.strip() in ("[1]", "[0, 1]")


@pytest.mark.parametrize(
    ("experiment", "seed", "words"),
    [
        ("foraging", 1, "expected what vsense.load gives, not 'foraging'"),
        (vsense.load("foraging"), -1, "seed -1: expected a whole number"),
        (vsense.load("foraging").experiment, 1.5, "seed 1.5: expected a whole number"),
    ],
)
def test_what_cannot_be_stepped_is_one_sentence(experiment: Any, seed: Any, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        SteppedSimulation(experiment, seed)


def test_names_and_rows_that_are_not_there_are_refused() -> None:
    with SteppedSimulation(vsense.load("foraging", robots=3, duration_s=2), 1) as sim:
        assert sim.swarm.sensor("pheromone").values.shape == (3, 3)
        assert sim.swarm.sensor("proximity").values.shape == (3, 8)
        with pytest.raises(UsageError, match="no sensor 'pheromon'; is 'pheromone' meant"):
            sim.swarm.sensor("pheromon")
        with pytest.raises(UsageError, match="no virtual actuator 'nope'"):
            sim.swarm.actuator("nope")
        for where in ([0, 2], np.array([0, 1, 2]), [0.1, 0.5, 0.9], [True, False]):
            with pytest.raises(ValueError, match=r"where: .* expected one truth value, or 3"):
                sim.swarm.set_wheels(1, 1, where=where)
        sim.swarm.set_wheels(1, 1, where=[True, False, True])
        assert sim.swarm.wheels_set.tolist() == [True, False, True]


def test_pettingzoo_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"parallel_env\(\) needs .*pettingzoo: .*pip install"):
        parallel_env("foraging")


@pytest.mark.parametrize(
    ("experiment", "how", "words"),
    [
        ("foraging", {"reward": "item_home"}, "is 'items_home' meant"),
        ("pollutant", {}, r"measures nothing; give reward="),
        ("predator_prey", {}, "it has several; is|it has several; there are: predator, prey"),
        ("predator_prey", {"controller": "pray"}, "there is no 'pray'; is 'prey' meant"),
        ("foraging", {"actuators": {"pheromone": (0, 1)}}, "is 'pheromone_release' meant"),
        ("foraging", {"render_mode": "ansi"}, "expected human or rgb_array"),
    ],
)
def test_what_cannot_be_learnt_in_is_one_sentence(
    experiment: str, how: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        parallel_env(experiment, **how).reset()
