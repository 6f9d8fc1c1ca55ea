"""Controllers are brought to the robots that lack them; who is not reached is named."""

from __future__ import annotations

import argparse
import io
from pathlib import Path
from types import SimpleNamespace

import pytest

from vsense.base.errors import UsageError
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.commands.series import bringer
from vsense.config import roster
from vsense.config.experiment import load
from vsense.robots.deploying import Outcome, Part, Plan, RobotHost
from vsense.robots.link.keys import INSECURE
from vsense.robots.sources import ProgramSources
from vsense.studies.series._order import pending
from vsense.studies.series._parts import PlanLoader, SeriesCast
from vsense.studies.series._plan import read
from vsense.studies.series._real import RealRuns, RobotSeries
from vsense.studies.series._staged import NotEnoughRobots, StagedRun

OPTIONS = argparse.Namespace(target="epuck", sudo=True, ssh_option=["A=b"], key=Path("no.key"))
PREDATOR, PREY = 31, 7488


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Plan, list[int]]]:
    """What was deployed to whom; the robot `off` is never reached."""
    found: list[tuple[Plan, list[int]]] = []

    def build(program: ProgramSources, target: str, output: Path) -> SimpleNamespace:
        output.write_text(f"{program.name} for {target}")
        return SimpleNamespace(path=output)

    def deploy(plan: Plan, robots: list[RobotHost], told: object) -> list[Outcome]:
        found.append((plan, [int(robot.settings["tag"]) for robot in robots]))
        return [
            Outcome(r, r.destination != "off", "No route to host" * (r.destination == "off"))
            for r in robots
        ]

    monkeypatch.setattr("vsense.robots.boards.build", build)
    monkeypatch.setattr("vsense.robots.boards.load", lambda path: path.read_bytes())
    monkeypatch.setattr("vsense.robots.deploying.deploy", deploy)
    return found


def roster_of(tmp_path: Path, prey: str = "right") -> roster.Roster:
    path = tmp_path / "robots.toml"
    hosts = {PREDATOR: "left", PREY: prey}
    path.write_text("".join(f'[[robot]]\ntag = {t}\nhost = "{h}"\n' for t, h in hosts.items()))
    return roster.read(path)


def test_each_robot_is_brought_its_own(
    tmp_path: Path, served: list[tuple[Plan, list[int]]]
) -> None:
    said = io.StringIO()
    bring = bringer(OPTIONS, roster_of(tmp_path, "off"), Console(said))
    failed = bring(load("predator_prey"), [PREDATOR, PREY])
    ((plan, tags),) = served
    assert tags == [PREDATOR, PREY]
    assert plan.binaries == {"left": b"predator for epuck", "off": b"prey for epuck"}
    assert (plan.part, plan.sudo, plan.ssh_options) == (Part.DAEMON, True, ("A=b",))
    assert failed == {PREY: "was not reached: No route to host"}
    assert "1 of 2 robots have their controller" in said.getvalue()


def test_who_has_it_is_brought_nothing(
    tmp_path: Path, served: list[tuple[Plan, list[int]]]
) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(
        'mode = "run"\nexperiment = "aggregation"\n[robots]\ncount = 2\nleast = 1\n'
        '[[condition]]\nname = "a"\n[[condition]]\nexperiment = "foraging"\n[[start]]\nseed = 1\n'
    )
    plan = read(path)
    loader = PlanLoader(plan)
    known = loader.load_all()
    first, second = (robot.tag for robot in known["a"].experiment.robots)
    asked: list[list[int]] = []

    def bring(experiment: object, tags: object) -> dict[int, str]:
        asked.append(sorted(tags))  # type: ignore[call-overload]
        return {second: "was not reached"} if len(asked) == 1 else {}

    said = Console(io.StringIO())
    runs = RealRuns(
        *(loader, SeriesCast(known, said), said, Interruption()),
        RobotSeries(INSECURE, bring=bring),
    )
    run = pending(plan, [])[0]
    staged = StagedRun.of(plan, run, known["a"])
    assert runs._bring(staged.experiment) == {second: "was not reached"}
    assert runs._bring(staged.experiment) == {}
    assert runs._bring(staged.experiment) == {}
    assert runs._bring(known["condition2"].experiment) == {}
    assert asked == [sorted([first, second]), [second], sorted([first, second])]
    left_out: set[int] = set()
    runs._do_without({second: "was not reached"}, left_out, staged)
    assert left_out == {second}
    with pytest.raises(NotEnoughRobots, match=r"plan.*1 robots"):
        runs._do_without({first: "is not seen", second: "is not seen"}, left_out, staged)


def test_without_a_roster_nobody_knows_where_they_are() -> None:
    with pytest.raises(UsageError, match=r"--roster FILE.*--no-deploy"):
        bringer(OPTIONS, None, Console(io.StringIO()))
