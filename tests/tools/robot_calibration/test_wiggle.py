"""Robots that turn in their turn, on a floor of lines of Python; and once in the true lab."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from vsense.base.arena import POSE, ArenaState
from vsense.cli import main
from vsense.config import roster
from vsense.robots.link.table import Goal
from vsense.run.homing.robots import Trouble
from vsense.tools.robot_calibration._wiggle import Verdict, WiggleCheck, WiggledRobot, exchanged
from vsense.tools.robot_calibration.measuring import swapped

PERIOD_NS = 50_000_000
TAGS = (23, 31, 44)


class Floor:
    """Robots that turn to where they are sent, one picture late, as the daemon does.

    Attributes:
        worn: each robot's marker.
        turns: how fast its wheels turn it over how they should.
        hidden: markers that no camera sees.
    """

    def __init__(self) -> None:
        self.worn = {tag: tag for tag in TAGS}
        self.turns = dict.fromkeys(TAGS, 1.0)
        self.slips_m: dict[int, float] = {}
        self.hidden: set[int] = set()
        self.poses = {tag: np.array([0.3 * n, 0.0, 3.1]) for n, tag in enumerate(TAGS)}
        self.moved: list[frozenset[int]] = []
        self._now_ns = 0

    def state(self, later_ns: int = PERIOD_NS) -> ArenaState:
        """The next picture."""
        self._now_ns += later_ns
        rows = np.zeros(len(TAGS), POSE)
        for row, (tag, (x_m, y_m, yaw_rad)) in zip(rows, sorted(self.poses.items())):
            row["tag"], row["capture_ns"] = self.worn[tag], self._now_ns
            row["x_m"], row["y_m"], row["seen"] = x_m, y_m, self.worn[tag] not in self.hidden
            row["yaw_rad"] = math.remainder(yaw_rad, math.tau)
        return ArenaState(0, self._now_ns, np.sort(rows, order="tag"), len(rows))

    def drive(self, goals: Mapping[int, Goal]) -> None:
        """Turns whoever is told to: 2.5 rad/s for each rad that is left (robot/homing.c)."""
        for tag, goal in goals.items():
            rate = self.turns[tag] * 2.5 * goal.heading * 1e-4
            self.poses[tag][2] += rate * PERIOD_NS * 1e-9
            self.poses[tag][0] += self.slips_m.get(tag, 0.0) * abs(rate) * PERIOD_NS * 1e-9
        self.moved.append(frozenset(tag for tag, goal in goals.items() if goal.heading))


def carry_out(
    floor: Floor,
    troubles: Callable[[int], Mapping[int, Trouble]] = lambda number: {},
    disturb: Callable[[int, WiggleCheck], int] = lambda number, check: PERIOD_NS,
) -> tuple[WiggleCheck, list[Verdict]]:
    check = WiggleCheck({tag: f"robot_{tag}" for tag in TAGS})
    for number in range(3000):
        later_ns = disturb(number, check)
        floor.drive(check.step(floor.state(later_ns), troubles(number)))
        if check.done:
            break
    assert check.done
    return check, [robot.verdict for robot in check.rows]


def test_who_turns_its_own_marker_is_well_and_stands_as_before() -> None:
    floor = Floor()
    check, verdicts = carry_out(floor)
    assert verdicts == [Verdict.OK] * 3 and check.news == []
    for robot in check.rows:
        # Told to stand 3 degrees before, it goes on for a picture.
        assert math.degrees(robot.turned_rad[robot.tag]) == pytest.approx(20.0, abs=4.0)
        assert floor.poses[robot.tag][2] == pytest.approx(3.1, abs=math.radians(4.0))
    # One at a time, each after the other.
    assert all(len(tags) <= 1 for tags in floor.moved)
    order = [next(iter(tags)) for tags in floor.moved if tags]
    assert list(dict.fromkeys(order)) == list(TAGS)


def test_two_robots_that_wear_each_others_markers_are_named() -> None:
    floor = Floor()
    floor.worn |= {23: 31, 31: 23}
    check, verdicts = carry_out(floor)
    assert verdicts == [Verdict.OTHER, Verdict.OTHER, Verdict.OK]
    assert check.rows[0].words == "turned the marker 31"
    assert check.news[0] == "robot 23 (robot_23) turned the marker 31"
    assert exchanged(check.rows) == [(23, 31)]


def test_of_three_in_a_ring_nobody_is_called_exchanged() -> None:
    floor = Floor()
    floor.worn = {23: 31, 31: 44, 44: 23}
    check, verdicts = carry_out(floor)
    assert verdicts == [Verdict.OTHER] * 3 and exchanged(check.rows) == []


@pytest.mark.parametrize(
    ("change", "verdict", "text"),
    [
        (lambda f: f.turns.update({23: 0.0}), Verdict.NONE, "no marker turned: its motors"),
        (lambda f: f.hidden.add(23), Verdict.NONE, "its own marker 23 is not seen"),
        (lambda f: f.turns.update({23: -1.0}), Verdict.WRONG_WAY, "cables of its wheels"),
        (lambda f: f.turns.update({23: 0.2}), Verdict.TOO_LITTLE, "in place of +20°"),
        (lambda f: f.turns.update({23: 30.0}), Verdict.TOO_MUCH, "does somebody carry it"),
        # About one wheel that stands: half an axle of 53 mm away.
        (lambda f: f.slips_m.update({23: 0.0265}), Verdict.MOVED, "one of its wheels"),
    ],
)
def test_what_is_wrong_is_told(
    change: Callable[[Floor], None], verdict: Verdict, text: str
) -> None:
    floor = Floor()
    change(floor)
    check, verdicts = carry_out(floor)
    assert verdicts == [verdict, Verdict.OK, Verdict.OK]
    assert text in check.rows[0].words and text in check.news[0]


def test_two_markers_that_turn_together_are_both_named() -> None:
    floor = Floor()
    floor.poses[31] = floor.poses[23]
    _, verdicts = carry_out(floor)
    assert verdicts[:2] == [Verdict.SEVERAL, Verdict.SEVERAL]


def test_who_is_lost_stands_and_the_others_go_on() -> None:
    floor = Floor()

    def troubles(number: int) -> dict[int, Trouble]:
        turning = bool(floor.moved and floor.moved[-1] == {23})
        gone.update([23] if turning else [])
        return dict.fromkeys(gone, Trouble.NO_LINK) | {44: Trouble.TOO_OLD}

    gone: set[int] = set()
    check, verdicts = carry_out(floor, troubles)
    assert verdicts == [Verdict.OUT_OF_REACH, Verdict.OK, Verdict.OUT_OF_REACH]
    assert [robot.words for robot in check.rows[::2]] == ["no link", "cannot drive home: deploy"]
    assert sum(tags == {23} for tags in floor.moved) == 1


@pytest.mark.parametrize("silent", [False, True])
def test_a_turn_into_which_a_pause_or_a_silence_fell_is_made_again(silent: bool) -> None:
    floor, cuts = Floor(), list[int]()

    def disturb(number: int, check: WiggleCheck) -> int:
        if floor.moved.count(frozenset({23})) == 3 and not cuts:
            cuts.append(number)
            if silent:
                return 2_000_000_000
            check.rest()
        return PERIOD_NS

    _, verdicts = carry_out(floor, disturb=disturb)
    assert cuts and verdicts == [Verdict.OK] * 3


def test_who_is_never_left_in_peace_is_not_judged() -> None:
    floor = Floor()
    check, verdicts = carry_out(floor, disturb=lambda number, check: (check.rest(), PERIOD_NS)[1])
    assert verdicts == [Verdict.NOT_DONE] * 3
    assert check.ended("x") == check.rows


def test_who_had_no_turn_is_told_why() -> None:
    check = WiggleCheck({23: "a", 31: "b"})
    assert [robot.verdict for robot in check.ended("stopped by ben")] == [Verdict.NOT_DONE] * 2
    looked = [
        WiggledRobot(23, "a", commanded=False),
        WiggledRobot(31, "b", why="gone", commanded=False),
    ]
    assert [robot.verdict for robot in looked] == [Verdict.OK, Verdict.OUT_OF_REACH]
    assert [robot.words for robot in looked] == ["is connected and seen", "gone"]


def test_what_to_change_in_the_roster_is_named_by_line(tmp_path: Path) -> None:
    path = tmp_path / "robots.toml"
    path.write_text("# ours\n[[robot]]\ntag = 23\n\n[[robot]]\ntag = 31\n")
    line = swapped((23, 31), roster.read(path))
    assert f"{path}: tag = 31 for the robot of line 2, tag = 23 for that of line 5" in line
    assert "vsense robot deploy --tags 23,31" in line
    line = swapped((23, 99), roster.read(path))
    assert "line" not in line and "vsense robot deploy" in line


def test_faults_of_no_robot_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    calls = {
        "foraging": "names no tracker",
        "foraging --lab --robots 2 --dead-motors 9": "no robot has tag 9; expected some of 31",
        "foraging --lab --robots 2 --swap-markers 31=9": "no robot has tag 9",
        "foraging --lab --swap-markers 31": "expected two tags, such as 23=37",
        "foraging --lab --tracking a b": "expected no --tracking",
    }
    for words, text in calls.items():
        try:
            code = main(["robot", "check", *words.split()])
        except SystemExit as end:
            code = end.code
        assert code == 2, words
        assert text in capsys.readouterr().err, words


@pytest.mark.campaign
def test_in_the_lab_two_markers_are_exchanged_and_motors_dead(tmp_path: Path) -> None:
    words = "robot check foraging --wiggle --lab --robots 4 --pace 0.5"
    faults = "--swap-markers 31=1843 --dead-motors 4334"
    out = tmp_path / "out"
    assert main([*words.split(), *faults.split(), "-o", str(out)]) == 1
    told = json.loads((out / "check.json").read_text())
    verdicts = [robot["verdict"] for robot in told["robots"]]
    assert verdicts == ["other marker", "other marker", "no marker", "ok"]
    assert told["exchanged"] == [[31, 1843]]
    assert told["robots"][3]["turned_deg"]["7167"] == pytest.approx(20.0, abs=6.0)
