"""A robot that is missing before a run in the lab: the first is refused, later ones go on."""

from __future__ import annotations

import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.run.stage import status
from vsense.base.shared import LabError
from vsense.config.casting import Casting
from vsense.config.roster import SPARE
from vsense.modes.lab.session import Session
from vsense.modes.live.session import ExperimentSession, NoRobotError
from vsense.robots.link.wire import Telemetry
from vsense.run.cast import Cast
from vsense.run.figures import Figures
from vsense.run.robots import BATTERY_LOW, Readiness
from vsense.run.verdict import RunRecord, VoidCriteria

ROBOTS = {1: "left", 2: "right"}


def session(run: int, connected: set[int]) -> tuple[Session, list[str]]:
    """A lab before its run of this number, with nothing in it but who is connected."""
    made, said = object.__new__(Session), list[str]()
    readiness = Readiness.of(ROBOTS, {}, connected, frozenset(connected), {})
    control = SimpleNamespace(run=run, asked=False)
    made.runner = SimpleNamespace(wait=lambda limit_s, busy=None: readiness, control=control)
    console = SimpleNamespace(say=lambda text, level: said.append(f"{level}: {text}"))
    made.setup = SimpleNamespace(interrupted=threading.Event(), console=console)
    made.experiment = SimpleNamespace(robots=[SimpleNamespace(id=n) for n in ROBOTS.values()])
    made.directory = Path("lab")
    return made, said


def test_the_first_run_needs_all_robots() -> None:
    made, _ = session(1, {1})
    with pytest.raises(LabError, match="not ready after 20 s; not connected: 2"):
        made.wait_until_ready()


def test_a_later_run_goes_on_without_who_is_missing() -> None:
    made, said = session(2, {1})
    made.wait_until_ready()
    assert len(said) == 1
    assert said[0].startswith("warning: starting without all robots; not connected: 2")


def test_no_run_goes_on_without_anybody() -> None:
    made, _ = session(2, set())
    with pytest.raises(NoRobotError, match="no robot is there; not connected: 1, 2"):
        made.wait_until_ready()


def test_a_daemon_that_crashes_in_the_run_is_why_it_is_invalid(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, _ = session(1, {1, 2})
    made._ready, made._fallen = True, []
    made.setup.console = SimpleNamespace(say=lambda *words: None)
    crashed = SimpleNamespace(tag=2), "was killed by SIGFPE at mine.c:43"
    log = lambda tag: Path(f"{tag}.log")  # noqa: E731
    made.swarm = SimpleNamespace(
        fallen=lambda: [crashed], log=log, script=log, complaints=lambda: []
    )
    monkeypatch.setattr(ExperimentSession, "_observe", lambda *arguments: None)
    monkeypatch.setattr(ExperimentSession, "record_of", lambda *arguments: RunRecord())
    made._observe(None, {})
    why = made.record_of(Figures.__new__(Figures), None).judge(VoidCriteria()).why
    assert why == "failed in mid-run: robot 2's controller was killed by SIGFPE at mine.c:43"


@pytest.mark.parametrize(
    ("limit_v", "resting"), [(0.0, set()), (3.5, {1, 2}), (3.3, {2}), (3.4, {2})]
)
def test_who_has_too_little_in_its_battery_is_named_and_rests(
    limit_v: float, resting: set[int]
) -> None:
    made, said = session(2, {1, 2})
    told = {1: Telemetry(battery_mv=3400), 2: Telemetry(battery_low=BATTERY_LOW), 3: Telemetry()}
    made.runner.robots = {tag: status(tag, f"epuck_{tag}", telemetry=t) for tag, t in told.items()}
    rested = list[set[int]]()
    made.server = SimpleNamespace(rest=lambda tags: rested.append(set(tags)))
    made.setup.starts, made.setup.battery_v = None, limit_v
    assert made.home() is None
    assert rested == [resting]
    assert made.resting == tuple(f"epuck_{tag}" for tag in sorted(resting))
    words = {1: "has 3.40 V left", 2: "has a low battery"}
    assert said == [
        f"warning: robot {tag} {words[tag]}: it stands in this run" for tag in sorted(resting)
    ]


def test_a_spare_plays_from_the_next_run_on_where_there_is_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, _ = session(2, {1, 2})
    low = Telemetry(battery_mv=3400)
    made.runner.robots = {tag: status(tag, f"epuck_{tag}", telemetry=low) for tag in (1, 2)}
    made.setup.battery_v, made.server = 3.5, None
    playing = [SimpleNamespace(tag=tag) for tag in (1, 2)]
    casting = Casting(others=((7, "out of order: limps"), (8, SPARE), (2, SPARE), (9, SPARE)))
    made.experiment = SimpleNamespace(robots=playing, casting=casting)
    made._cast, asked = Cast(lambda: [made.experiment]), list[tuple[tuple[int, int], str]]()
    monkeypatch.setattr(made._cast, "ask", lambda *request: asked.append(request))
    assert made._cast.substitutes([8]) == {8: 9}
    made._put_in_spares()
    assert asked == [((1, 9), "robot 1 has 3.40 V left")], "8 was low itself, 2 plays"
    assert made._cast.substitutes([1]) == {1: 9}, "and neither 1 nor 8 is a spare now"


def test_who_is_there_is_not_waited_for() -> None:
    made, said = session(2, {1, 2})
    made.wait_until_ready()
    assert said == []
