"""`scripts/bench homing`: robots drive from random places to random places.

The planner of `vsense/run/homing/` and the walk of `robot/homing.c`, which is compiled into this
process with the daemon's own runtime; wheels and contacts are those of lab and simulation. Poses
come late and are wrong by a little, packets are lost, wheels are not what they should be, one robot
is dead, and one is not seen for a while. The same in the lab, with cameras, tracker, network and
daemons, is `tests/bench/homing_lab.py`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import POSE, ArenaState, wrap_angle
from vsense.base.terminal import aligned
from vsense.config.specs import Pose
from vsense.robots import build
from vsense.robots.build import SHIPPED_CONTROLLER
from vsense.robots.inprocess import CompiledProgram, ProgramSetup
from vsense.robots.link.table import Goal, Table
from vsense.run.homing._homing import Homing
from vsense.run.homing.floor import DrivingFloor
from vsense.run.homing.robots import HomingLimits, Trouble
from vsense.world.entities import Arena
from vsense.world.physics.motion import TICK_NS, Physics
from vsense.world.robot_models import EPUCK

ARENA_M = (3.0, 2.4)
ROBOTS = 15
SEEDS = 20
WHEELS = 0.05
"""Every wheel is wrong by a factor of 1 plus or minus up to this."""
LOSS = 0.05
GAP_M = 0.005
"""Bodies are drawn so far apart, as `<distribute>` does."""
UNSEEN_S = (3.0, 6.0)
NOISE_M, NOISE_RAD = 0.001, math.radians(0.5)
"""Of the poses, standard deviation; four times what the lab's tracker makes."""

HOME_M, HOME_DEG, CONTACT_S, MEDIAN_S = 0.03, 10.0, 0.5, 45.0
"""What is asked for: how near, how straight, longest contact, median of the times."""

_TIMESTEP_NS = 100_000_000
_ARRIVES_NS, _AGAIN_NS = 60_000_000, 110_000_000
"""From the capture to the robot, and with the repetition where the first packet was lost."""
_LIMIT_S = 120.0
_CONTACT_M = 2.0 * EPUCK.radius_m + 0.0005

Say = Callable[[str], None]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class HomingRow:
    """One seed.

    Attributes:
        time_s: until all were home or given up.
        home, able: robots that are at home, of so many that could drive.
        worst_mm, worst_deg: how far from it and how crooked the worst of these stand.
        contact_s: the longest contact of two robots.
        step_ms, most_ms: processor time of a step of the planner, median and most.
    """

    seed: int
    time_s: float
    home: int
    able: int
    worst_mm: float
    worst_deg: float
    contact_s: float
    step_ms: float
    most_ms: float

    @property
    def is_good(self) -> bool:
        """Whether this is what is asked for, but for the time."""
        near = self.worst_mm <= HOME_M * 1e3 and self.worst_deg <= HOME_DEG
        return self.home == self.able and near and self.contact_s <= CONTACT_S


class ContactTimes:
    """How long robots touch each other, by their true places at every tick of the physics."""

    def __init__(self) -> None:
        self._touching = dict[tuple[int, int], int]()
        self._longest_ns = 0

    @property
    def longest_s(self) -> float:
        """The longest contact of two robots up to now."""
        return max([self._longest_ns, *self._touching.values()]) / 1e9

    def tick(self, poses: Floats) -> None:
        """The next tick: (n, 2 or more) x_m, y_m of everybody."""
        places = poses[:, :2]
        apart = np.hypot(*(places[:, np.newaxis] - places).transpose(2, 0, 1))
        rows, columns = np.nonzero(np.triu(apart < _CONTACT_M, 1))
        now = set(zip(rows.tolist(), columns.tolist()))
        for pair in now:
            self._touching[pair] = self._touching.get(pair, 0) + TICK_NS
        for pair in self._touching.keys() - now:
            self._longest_ns = max(self._longest_ns, self._touching.pop(pair))


class HomingField:
    """One seed's robots in their arena."""

    def __init__(self, seed: int, robots: int = ROBOTS) -> None:
        self.random = np.random.default_rng(seed)
        self.count, self.dead, self.hidden = robots, robots - 1, 0
        starts, homes = self._draw(), self._draw()
        half_x, half_y = ARENA_M[0] / 2.0, ARENA_M[1] / 2.0
        walls = [(0.0, y, 0.0, ARENA_M[0], 0.02) for y in (-half_y - 0.01, half_y + 0.01)]
        walls += [(x, 0.0, 0.0, 0.02, ARENA_M[1]) for x in (-half_x - 0.01, half_x + 0.01)]
        self.now_ns = 1_000_000_000
        self.physics = Physics(starts, (), walls, self.now_ns)
        self.factors = 1.0 + self.random.uniform(-WHEELS, WHEELS, (robots, 2))
        library = build.shared(SHIPPED_CONTROLLER)
        self.minds = [
            CompiledProgram(ProgramSetup(library, [tag], Table(), _TIMESTEP_NS, seed, ""))
            for tag in range(robots)
        ]
        arena = Arena((*ARENA_M, 1.0), (0.0, 0.0, 0.0))
        self.homing = Homing(
            {tag: Pose(*home) for tag, home in enumerate(homes.tolist())},
            {tag: f"epuck_{tag}" for tag in range(robots)},
            dict.fromkeys(range(robots), "epuck"),
            DrivingFloor(arena, walls),
            HomingLimits(all_s=_LIMIT_S, hindered_s=5.0),
        )
        self.contacts = ContactTimes()
        self._mail: list[tuple[int, int, int, int, Goal]] = []

    def _draw(self) -> Any:
        poses: list[tuple[float, float, float]] = []
        while len(poses) < self.count:
            x, y, yaw = self.random.uniform(-1.0, 1.0, 3)
            x *= ARENA_M[0] / 2.0 - EPUCK.radius_m - GAP_M
            y *= ARENA_M[1] / 2.0 - EPUCK.radius_m - GAP_M
            apart_m = 2.0 * EPUCK.radius_m + GAP_M
            if all(math.hypot(x - a, y - b) > apart_m for a, b, _ in poses):
                poses.append((x, y, yaw * math.pi))
        return np.array(poses)

    def run(self, seed: int) -> HomingRow:
        """Drives until all are home or given up."""
        timestep, begun_ns, costs = 0, self.now_ns, list[float]()
        while not self.homing.done and self.now_ns - begun_ns < 2e9 * _LIMIT_S:
            if (self.now_ns - begun_ns) % _TIMESTEP_NS == 0:
                timestep += 1
                began = time.process_time()
                goals = self.homing.step(self._seen(timestep, begun_ns), self._troubles())
                costs.append((time.process_time() - began) * 1e3)
                self._post(timestep, goals)
            self._deliver()
            self.now_ns += TICK_NS
            self.physics.tick(self.now_ns)
            self.contacts.tick(self.physics.poses)
        return self._row(seed, (self.now_ns - begun_ns) / 1e9, costs)

    def _row(self, seed: int, time_s: float, costs: Sequence[float]) -> HomingRow:
        able = [tag for tag in self.homing.robots if tag != self.dead]
        poses = self.physics.poses[able]
        homes = [self.homing.robots[tag].home for tag in able]
        return row_of(seed, time_s, np.array(homes), poses, self.contacts, costs)

    def _troubles(self) -> dict[int, Trouble]:
        return {self.dead: Trouble.NO_LINK}

    def _seen(self, timestep: int, begun_ns: int) -> ArenaState:
        rows = np.zeros(self.count, dtype=POSE)
        noise = self.random.normal(0.0, (NOISE_M, NOISE_M, NOISE_RAD), (self.count, 3))
        rows["tag"], rows["seen"] = np.arange(self.count), True
        for column, name in enumerate(("x_m", "y_m", "yaw_rad")):
            rows[name] = self.physics.poses[:, column] + noise[:, column]
        hidden = UNSEEN_S[0] <= (self.now_ns - begun_ns) / 1e9 < UNSEEN_S[1]
        rows["seen"][self.hidden] = not hidden
        return ArenaState(timestep=timestep, capture_ns=self.now_ns, robots=rows, detected=0)

    def _post(self, timestep: int, goals: dict[int, Goal]) -> None:
        for tag, goal in goals.items():
            for delay_ns in (_ARRIVES_NS, _AGAIN_NS):
                if tag != self.dead and self.random.random() >= LOSS:
                    self._mail.append((self.now_ns + delay_ns, tag, timestep, self.now_ns, goal))
                    break

    def _deliver(self) -> None:
        for letter in [letter for letter in self._mail if letter[0] <= self.now_ns]:
            self._mail.remove(letter)
            _, tag, timestep, capture_ns, goal = letter
            mind = self.minds[tag]
            mind.home(timestep, (capture_ns, self.now_ns), np.array([goal], dtype=np.int16))
            left, right = np.rint(mind.wheels_steps_s[0] * self.factors[tag]).astype(int)
            self.physics.drive(tag, int(left), int(right), self.now_ns)


def row_of(
    seed: int,
    time_s: float,
    homes: Floats,
    poses: Floats,
    contacts: ContactTimes,
    costs: Sequence[float],
) -> HomingRow:
    """The row of a seed.

    Args:
        homes, poses: (n, 3) of those that could drive: where they shall be, and where they are.
        costs: of each step of the planner [ms].
    """
    away_mm = 1e3 * np.hypot(*(homes - poses)[:, :2].T)
    turned_deg = np.degrees(np.abs(wrap_angle(homes[:, 2] - poses[:, 2])))
    home = (away_mm <= HOME_M * 1e3) & (turned_deg <= HOME_DEG)
    worst = float(away_mm.max()), float(turned_deg.max())
    cost = float(np.median(costs)), max(costs)
    return HomingRow(seed, time_s, int(home.sum()), len(homes), *worst, contacts.longest_s, *cost)


def run(say: Say, seeds: int = SEEDS) -> dict[str, Any]:
    """Drives robots home from so many random starts.

    Returns:
        `rows`, one `HomingRow` as a dict for each seed; `good`: how many of them are what is asked
        for; `median_s` and `slowest_s`.
    """
    rows = []
    for seed in range(1, seeds + 1):
        rows.append(HomingField(seed).run(seed))
        say(told(rows[-1]))
    return report_of(rows)


def told(row: HomingRow) -> str:
    """A seed's line while others are still to come."""
    return f"seed {row.seed}: {row.home} of {row.able} home after {row.time_s:.1f} s"


def report_of(rows: Sequence[HomingRow]) -> dict[str, Any]:
    """The report of all seeds; see `run`."""
    times = [row.time_s for row in rows]
    return {
        "rows": [asdict(row) for row in rows],
        "good": sum(row.is_good for row in rows),
        "median_s": float(np.median(times)),
        "slowest_s": max(times),
    }


def table(report: dict[str, Any]) -> str:
    """The report as text."""
    titles = ("seed", "s", "home", "worst mm", "worst deg", "contact s", "planner ms", "most")
    lines: list[tuple[str, ...]] = [titles]
    for row in report["rows"]:
        numbers = (row[name] for name in ("worst_mm", "worst_deg"))
        lines.append(
            (
                *(str(row["seed"]), f"{row['time_s']:.1f}", f"{row['home']}/{row['able']}"),
                *(f"{number:.1f}" for number in numbers),
                *(f"{row['contact_s']:.2f}", f"{row['step_ms']:.1f}", f"{row['most_ms']:.1f}"),
            )
        )
    verdict = (
        f"{report['good']} of {len(report['rows'])} seeds: all that could drive within"
        f" {HOME_M * 1e3:.0f} mm and {HOME_DEG:.0f} deg, no contact longer than {CONTACT_S} s;"
        f" median {report['median_s']:.1f} s of {MEDIAN_S:.0f} s allowed,"
        f" slowest {report['slowest_s']:.1f} s"
    )
    return "\n".join([*aligned(lines, left=1), verdict])
