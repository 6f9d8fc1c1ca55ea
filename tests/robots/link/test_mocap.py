"""Motion capture: its own mock system, and OptiTrack's protocol by wire, with what goes wrong.

Reported by users: bodies that vanish and come back (motion_capture_tracking, issue 6), bodies that
nobody asked for and frames without any (issue 22), a server that hangs or is started again
(crazyswarm2, issue 492, and crazyswarm, issue 168).
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest

from tests.robots.link.natnet import Body, Motive
from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers._mocap_process import STALE_NS, RigidBodies, on_floor
from vsense.robots.link.trackers.mocap import MocapListener, MocapSystem

pytest.importorskip("motioncapture", reason="pip install vsense[mocap]")

PATIENCE_S = 30.0
TAGS = {"red one": 23, "blue": 24}
STILL = (0.0, 0.0, 0.0, 1.0)


@contextmanager
def listening(
    type: str, settings: dict[str, str], up: str = "z"
) -> Iterator[tuple[MocapListener, list[str]]]:
    said: list[str] = []
    system = MocapSystem(type, {"hostname": "127.0.0.1", **settings}, TAGS, up)
    with closing(MocapListener(system, list(TAGS.values()), said.append)) as listener:
        yield listener, said


def until(
    listener: MocapListener, wanted: Callable[[ArenaState], bool], say: str = ""
) -> ArenaState:
    """Takes states until one is as it is wanted."""
    deadline_s = time.monotonic() + PATIENCE_S
    state: ArenaState | None = None
    while time.monotonic() < deadline_s:
        try:
            state, _ = listener.next(1.0)
        except LinkError:
            continue
        if wanted(state):
            return state
    raise AssertionError(f"{say}: the last state was {state}")


def seen(state: ArenaState) -> dict[int, tuple[float, float, float]]:
    return {
        int(r["tag"]): (float(r["x_m"]), float(r["y_m"]), float(r["yaw_rad"]))
        for r in state.robots
        if r["seen"]
    }


def optitrack(motive: Motive) -> dict[str, str]:
    """What the library has to be told of a server on this machine."""
    return {"interface_ip": "127.0.0.1", "port_command": f"{motive.port}"}


def body(name: str, x: float, y: float, tracked: bool = True) -> Body:
    return (name, (x, y, 0.1), STILL, tracked)


def test_the_librarys_own_mock_system() -> None:
    half = math.sqrt(0.5)
    bodies = f"red one(0.5,-0.25,0.1,{half},0,0,{half});nobody(1,1,0,1,0,0,0)"
    before = ports_of_this_process()
    with listening("mock", {"rigid_bodies": bodies, "frequency": "50"}) as (listener, said):
        state = until(listener, lambda state: bool(seen(state)))
        assert seen(state) == {23: pytest.approx((0.5, -0.25, math.pi / 2), abs=1e-6)}
        assert 0 <= host_ns() - state.capture_ns < 10**9 and state.unnamed == 0
        begun_ns = state.capture_ns
        # It repeats for ever what it is told.
        state = until(listener, lambda state: state.capture_ns > begun_ns + 2 * STALE_NS)
        assert list(seen(state)) == [23]
        assert "motion capture: rigid body 'nobody' has no robot: left out" in said
        assert ports_of_this_process() == before, "no other program reaches what is written to"


def ports_of_this_process() -> set[str]:
    """Addresses on which this process listens for TCP, as Linux writes them."""
    own = {os.readlink(path) for path in Path("/proc/self/fd").iterdir() if path.is_symlink()}
    rows = [row.split() for row in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return {row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in own}


@pytest.mark.parametrize("part", [1e160, 1e-200])
def test_a_body_whose_quaternion_has_no_square_costs_that_body_alone(part: float) -> None:
    said: list[str] = []
    bodies = RigidBodies(TAGS, "z", repeats=True, say=said.append)
    bad, good = (0.5, 0.25, 0.1, 0.0, 0.0, part, part), (0.5, 0.25, 0.1, *STILL)
    assert [r["tag"] for r in bodies.robots([("red one", bad), ("blue", good)], 0)] == [24]
    assert said == ["rigid body 'red one' has a pose that is no number: it counts as unseen"]


def test_bodies_of_optitrack_vanish_come_back_and_change_their_order() -> None:
    with Motive(["red one", "blue", "table"]) as motive:
        frames = {
            "both": [("red one", 0.1, 0.2), ("blue", 0.5, 0.6)],
            "turned": [("blue", 0.5, 0.6), ("table", 1.0, 1.0), ("red one", 0.1, 0.2)],
            "none": [],
        }

        def show(name: str) -> None:
            motive.bodies = [body(*row) for row in frames[name]]

        show("both")
        with listening("optitrack", optitrack(motive)) as (listener, said):
            wanted = {23: (0.1, 0.2), 24: (0.5, 0.6)}
            state = until(listener, lambda state: len(seen(state)) == 2)
            assert {t: pose[:2] for t, pose in seen(state).items()} == {
                tag: pytest.approx(place, abs=1e-3) for tag, place in wanted.items()
            }
            motive.bodies = [body("red one", 0.1, 0.2, tracked=False), body("blue", 0.5, 0.6)]
            lost = until(listener, lambda state: set(seen(state)) == {24}, "untracked")
            row = lost.robots[lost.robots["tag"] == 23][0]
            assert row["age_ns"] > 0 and row["x_m"] == pytest.approx(0.1, abs=1e-3)
            show("turned")
            state = until(listener, lambda state: len(seen(state)) == 2, "another order")
            assert seen(state)[23][:2] == pytest.approx((0.1, 0.2), abs=1e-3)
            show("none")
            empty = until(listener, lambda state: not seen(state), "an empty frame")
            assert len(empty.robots) == 2 and not empty.robots["seen"].any()
            motive.bodies = [("blue", (math.nan, 0.0, 0.0), STILL, True), body("red one", 0.1, 0.2)]
            until(listener, lambda state: set(seen(state)) == {23}, "no number")
            motive.bodies = [
                ("blue", (0.5, 0.6, 0.1), (0.0, 0.0, 0.0, 0.0), True),
                body("red one", 0.3, 0.2),
            ]
            state = until(listener, lambda state: seen(state).get(23, (0.0,))[0] > 0.2, "moved")
            assert 24 not in seen(state), "a quaternion without a length"
            assert "motion capture: rigid body 'table' has no robot: left out" in said


def test_a_pose_that_repeats_to_the_last_bit_is_not_seen() -> None:
    said: list[str] = []
    bodies = RigidBodies(TAGS, "z", repeats=False, say=said.append)
    pose = (0.5, 0.25, 0.1, *STILL)
    frames = [bodies.robots([("blue", pose)], at_ns) for at_ns in range(0, 10**9, 10**8)]
    assert [len(robots) for robots in frames] == [1] * 5 + [0] * 5
    assert said == ["rigid body 'blue' repeats its pose for 0.5 s: it counts as unseen"]
    moved = (0.5000001, *pose[1:])
    assert len(bodies.robots([("blue", moved)], 10**9)) == 1
    strangers = [(f"wand {k}", pose) for k in range(100)]
    assert bodies.robots(strangers, 10**9) == [] and len(said) == 8, "nobody is flooded"


def test_another_axis_up_and_millimetres_are_told() -> None:
    """Motive's y points up, and up is "z" unless the file says otherwise."""
    said: list[str] = []
    bodies = RigidBodies(TAGS, "z", repeats=True, say=said.append)
    quarter = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # about y
    assert bodies.robots([("red one", (0.5, 0.1, -1.5, *quarter))], 0) == []
    assert bodies.robots([("blue", (500.0, 250.0, 0.1, *STILL))], 0) == []
    assert said == [
        "rigid body 'red one' is -1.5 m above the floor: is up='z' true?",
        "rigid body 'red one' looks up or down: it counts as unseen; is up='z' true?",
        "rigid body 'blue' is 500 m away, expected metres: it counts as unseen",
    ]
    (robot,) = RigidBodies(TAGS, "y", repeats=True, say=said.append).robots(
        [("red one", (0.5, 0.1, -1.5, *quarter))], 0
    )
    assert (robot["x_m"], robot["y_m"]) == (0.5, 1.5) and len(said) == 3
    assert robot["yaw_rad"] == pytest.approx(math.pi / 2)


def test_a_server_that_falls_silent_is_asked_again_and_a_run_goes_on() -> None:
    """A restart: another process, other ports for data, bodies numbered otherwise."""
    places = [body("red one", 0.1, 0.2), body("blue", 0.5, 0.6)]
    with ExitStack() as stack:
        motive = stack.enter_context(Motive(["red one", "blue"]))
        motive.bodies = places
        listener, said = stack.enter_context(listening("optitrack", optitrack(motive)))
        before = until(listener, lambda state: len(seen(state)) == 2)
        motive.close()
        with pytest.raises(LinkError, match=r"no arena state in 0\.5 s"):
            while True:
                listener.next(0.5)
        again = stack.enter_context(Motive(["blue", "red one"], motive.port))
        again.bodies = places
        state = until(listener, lambda state: len(seen(state)) == 2, "restarted")
        assert again.asked == 1 and state.timestep > before.timestep
        assert seen(state)[24][:2] == pytest.approx((0.5, 0.6), abs=1e-3)
        name = "motion capture, optitrack at 127.0.0.1"
        assert said.count(f"{name}: no frame for 3 s; it is tried again") == 1


def test_a_server_that_is_not_there_or_a_type_that_is_not_known_is_said() -> None:
    nowhere = {"port_command": "9"}
    for type, settings, words in (
        ("optitrack", nowhere, "it is tried again"),
        ("fzmotion?", {}, "Unknown motion capture type!; it is tried again"),
    ):
        with listening(type, settings) as (listener, said):
            deadline_s = time.monotonic() + PATIENCE_S
            while not said and time.monotonic() < deadline_s:
                with pytest.raises(LinkError):
                    listener.next(0.2)
            assert len(said) == 1 and said[0].endswith(words), said
            assert said[0].startswith(f"motion capture, {type} at ")


@pytest.mark.parametrize(
    ("up", "pose", "expected"),
    [
        # cos and sin of half the angle about z, or y: turned left by 90 degrees.
        ("z", (1.0, 2.0, 3.0, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), (1.0, 2.0, math.pi / 2)),
        ("y", (1.0, 3.0, -2.0, 0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)), (1.0, 2.0, math.pi / 2)),
        ("z", (1.0, 2.0, 3.0, 0.0, 0.0, -0.6, 0.8), (1.0, 2.0, -2 * math.atan2(0.6, 0.8))),
        ("y", (1.0, 3.0, -2.0, 0.0, 1.0, 0.0, 0.0), (1.0, 2.0, math.pi)),
        # Twice as long as a unit quaternion; and a robot that leans does not turn by that.
        ("z", (0.0, 0.0, 0.0, 0.0, 0.0, 1.2, 1.6), (0.0, 0.0, 2 * math.atan2(0.6, 0.8))),
        ("z", (0.0, 0.0, 0.0, math.sin(0.1), 0.0, 0.0, math.cos(0.1)), (0.0, 0.0, 0.0)),
    ],
)
def test_places_on_the_floor_by_hand(
    up: str, pose: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    x_m, y_m, yaw_rad, *_ = on_floor(pose, up)  # type: ignore[arg-type]
    assert (x_m, y_m) == expected[:2]
    assert math.remainder(yaw_rad - expected[2], math.tau) == pytest.approx(0.0, abs=1e-9)
