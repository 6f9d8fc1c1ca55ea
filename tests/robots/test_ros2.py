"""The driver of robots of ROS 2, against a peer that is made of the public message definitions.

The peer's bytes are written here by hand: CDR as ROS 2 has it, little-endian, numbers aligned to
their size.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

from tests.rigs.places import ROOT

cyclonedds = pytest.importorskip("cyclonedds", reason="pip install vsense[ros2]")
DRIVERS = ROOT / "robot" / "drivers"
DOMAIN = 71
ORDER_LEN, REPORT_LEN = 48, 160


@pytest.fixture
def helper(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The driver's own module, for its messages, and the one that it imports."""
    monkeypatch.syspath_prepend(str(DRIVERS))
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    import importlib

    yield importlib.import_module("ros2"), importlib.import_module("vsense_driver")
    for name in ("ros2", "vsense_driver"):
        sys.modules.pop(name, None)


def test_messages_have_the_bytes_and_names_of_ros_2(helper: Any) -> None:
    import struct

    ros2, _ = helper
    twist = ros2.Twist(ros2.Vector3(1.0, 2.0, 3.0), ros2.Vector3(4.0, 5.0, 6.0))
    assert twist.serialize() == b"\x00\x01\x00\x00" + struct.pack("<6d", 1, 2, 3, 4, 5, 6)
    head = ros2.Header(ros2.Time(7, 8), "odom")
    assert head.serialize() == b"\x00\x01\x00\x00" + struct.pack("<iII5s", 7, 8, 5, b"odom\0")
    assert ros2.Twist.__idl__.idl_transformed_typename == "geometry_msgs::msg::dds_::Twist_"


def test_what_is_no_distance_is_as_near_as_can_be(helper: Any) -> None:
    ros2, _ = helper
    away = -float("inf")
    scan = ros2.LaserScan(None, 0.0, 0.0, 0.1, 0.0, 0.1, away, 4.0, [away, float("nan")], [])
    assert ros2.nearness(scan, 0.0) == 4095.0


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -1e300])
def test_the_labs_robot_takes_no_twist_that_is_no_speed(
    number: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from vsense.modes.lab import _links
    from vsense.modes.lab._ros2_robot import Ros2Robot
    from vsense.world.robot_models import EPUCK

    monkeypatch.setenv("CYCLONEDDS_URI", "")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    robot = Ros2Robot(_links.PROGRAMS["ros2"], 0, tmp_path, EPUCK)
    vector, twist = (robot._types[f"geometry_msgs/{name}"] for name in ("Vector3", "Twist"))
    zero = vector(0.0, 0.0, 0.0)
    for linear, angular in ((vector(number, 0.0, 0.0), zero), (zero, vector(0.0, 0.0, number))):
        robot._drive(twist(linear, angular), 0)
    robot.close()


class Driver:
    """The driver behind pipes, as its daemon has it."""

    def __init__(self, vsense_driver: Any) -> None:
        self._records = vsense_driver
        words = [sys.executable, str(DRIVERS / "ros2.py"), "--namespace", "robot_23"]
        self.process = subprocess.Popen(
            [*words, "--axle", "0.16"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)},
        )
        assert self.process.stdout is not None and self.process.stderr is not None
        os.set_blocking(self.process.stdout.fileno(), False)
        os.set_blocking(self.process.stderr.fileno(), False)
        self.reports: list[tuple[Any, ...]] = []
        self.said = ""

    def order(self, left_um_s: int, right_um_s: int) -> None:
        assert self.process.stdin is not None
        now_ns = time.monotonic_ns()
        record = self._records.ORDER.pack(
            self._records.MAGIC,
            0,
            now_ns,
            now_ns + 250_000_000,
            left_um_s,
            right_um_s,
            0,
            bytes(12),
        )
        self.process.stdin.write(record)
        self.process.stdin.flush()

    def look(self) -> None:
        assert self.process.stdout is not None and self.process.stderr is not None
        data = self.process.stdout.read() or b""
        for at in range(0, len(data), REPORT_LEN):
            self.reports.append(self._records.REPORT.unpack(data[at : at + REPORT_LEN]))
        self.said += (self.process.stderr.read() or b"").decode()

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def driver(helper: Any) -> Iterator[Driver]:
    one = Driver(helper[1])
    yield one
    one.close()


def wait_for(condition: Callable[[], object], each: Callable[[], object], said: Driver) -> None:
    end_s = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end_s, said.said
        each()
        said.look()
        time.sleep(0.02)


def test_a_robot_of_ros_2_gets_twists_and_gives_its_way_and_what_is_near(
    helper: Any, driver: Driver, tmp_path: Path
) -> None:
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    ros2, _ = helper
    domain = DomainParticipant(DOMAIN)
    topics = {n: Topic(domain, f"rt/robot_23{n}", t) for n, t in ros2.TOPICS.items()}
    commands = Topic(domain, "rt/robot_23/cmd_vel", ros2.Twist)
    heard = DataReader(domain, commands, qos=ros2.RELIABLE)
    writers = {name: DataWriter(domain, topic, qos=ros2.RELIABLE) for name, topic in topics.items()}
    twists: list[Any] = []
    ranges = [float("inf")] * 360
    ranges[340:346] = [0.15] * 6  # 15 to 20 degrees to the right
    zeros = [0.0] * 36
    head = ros2.Header(ros2.Time(1, 2), "odom")
    pose = ros2.Pose(ros2.Vector3(), ros2.Quaternion(0.0, 0.0, 0.0, 1.0))
    twist = ros2.Twist(ros2.Vector3(x=0.1), ros2.Vector3(z=0.5))
    known = ros2.PoseWithCovariance(pose, zeros), ros2.TwistWithCovariance(twist, zeros)
    odometry = ros2.Odometry(head, "base_link", *known)
    broken = ros2.Twist(ros2.Vector3(x=float("nan")), ros2.Vector3())
    unknown = known[0], ros2.TwistWithCovariance(broken, zeros)
    told = cycle([odometry, ros2.Odometry(head, "base_link", *unknown)])

    def live() -> None:
        driver.order(60_000, 140_000)
        twists.extend(heard.take(10))
        writers["/odom"].write(next(told))
        step = 6.283185307 / 360
        writers["/scan"].write(
            ros2.LaserScan(head, 0.0, 6.28, step, 0.0, 0.1, 0.05, 4.0, ranges, [])
        )

    wait_for(lambda: twists and driver.reports, live, driver)
    assert twists[-1].linear.x == pytest.approx(0.1) and twists[-1].angular.z == pytest.approx(0.5)
    wait_for(lambda: driver.reports[-1][4] > 20_000, live, driver)
    way = driver.reports[-1][4:6]
    assert way[0] / way[1] == pytest.approx(0.06 / 0.14, rel=0.02)
    wait_for(lambda: driver.reports[-1][-32] > 2000, live, driver)
    assert driver.reports[-1][-32:-24] == pytest.approx((2047.5, 0, 0, 0, 0, 0, 0, 0), abs=1)
    before = len(twists)
    wait_for(lambda: twists[before:] and twists[-1].linear.x == 0.0, listen(heard, twists), driver)
    other = DataWriter(domain, commands, qos=ros2.RELIABLE)
    wait_for(lambda: "somebody else sends robot_23/cmd_vel" in driver.said, live, driver)
    del other
    # Where a robot's program has gone, its messages are disposed of: that is no message.
    own = DataReader(domain, topics["/odom"], qos=ros2.BEST_EFFORT)
    wait_for(lambda: ros2.valid(own, 100), live, driver)
    writers["/odom"].dispose(odometry)
    wait_for(lambda: own.read(1), lambda: None, driver)
    assert ros2.valid(own, 100) == []


def listen(heard: Any, twists: list[Any]) -> Callable[[], None]:
    """Orders have ceased: 250 ms later the driver says to rest."""
    return lambda: twists.extend(heard.take(10))
