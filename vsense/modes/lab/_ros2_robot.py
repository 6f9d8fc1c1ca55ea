"""A robot of ROS 2 in the lab: it takes `cmd_vel`, and publishes `odom` and `scan`.

It speaks DDS by the package cyclonedds, on this machine's own network alone and under a namespace
of its own: no real robot hears it. See `Link` in `_links.py`.
"""

from __future__ import annotations

import os
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.errors import require
from vsense.base.native import lib
from vsense.modes.lab._links import FirmwareKind, FirmwareProgram, Outputs, soonest
from vsense.monitor.ros2 import dds_types
from vsense.world.robot_models import RobotModel

OWN_NETWORK = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface name="lo" /></Interfaces><AllowMulticast>false</AllowMulticast>
</General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>119</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1" /></Peers></Discovery></Domain></CycloneDDS>
"""
"""What CYCLONEDDS_URI names."""

POLL_NS, TELL_NS = 5_000_000, 20_000_000
"""How often it looks for orders, and tells what it measures."""

BEAMS = 72
RANGE_M = 4.0
_FASTER_STEPS_S = 1 << 20  # than any wheel; what the firmware is told has 32 bits
_SURE = 6.0
"""By so many standard deviations a reading differs from that of nothing."""


class Ros2Robot:
    """A node behind DDS; see `Link`.

    Attributes:
        mute: it neither hears nor tells anything; a test breaks it.
    """

    def __init__(self, kind: FirmwareKind, robot: int, folder: Path, model: RobotModel) -> None:
        """`folder` gets the file with what keeps it on this machine; raises as `require`."""
        require("a robot of ROS 2 in the lab", "cyclonedds")
        network = folder / "own_network.xml"
        network.write_text(OWN_NETWORK)
        os.environ["CYCLONEDDS_URI"] = uri = network.as_uri()
        self.program = FirmwareProgram(replace(kind, before=("env", f"CYCLONEDDS_URI={uri}")))
        name = f"lab_{os.getpid()}_{robot}"
        most_m_s = round(model.v_max_m_s, 3)
        self.device = f"--namespace {name} --axle {model.axle_m} --max {most_m_s}"
        self.due_ns: int | None = 0
        self.sent_bytes = self.lost_bytes = 0
        self.mute = False
        self._model, self._tell_ns = model, 0
        self._connect(name)

    def readable(self) -> int | None:
        return None

    def receive(self, now_ns: int) -> None: ...

    def advance(self, now_ns: int) -> list[Outputs]:
        if not self.mute:
            for twist in self._orders.take(16):
                if isinstance(twist, self._types["geometry_msgs/Twist"]):  # or who sent it has gone
                    self._drive(twist, now_ns)
            if now_ns >= self._tell_ns:
                self._tell_ns = now_ns + TELL_NS
                self._tell(now_ns)
        self.due_ns = soonest(now_ns + POLL_NS, self.program.due_ns())
        return self.program.advance(now_ns)

    def faults(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        del self._orders, self._odom, self._scan, self._domain

    def _connect(self, name: str) -> None:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        self._types = kinds = dds_types()
        self._domain = domain = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        qos = Qos(Policy.Reliability.Reliable(10**8), Policy.History.KeepLast(1))
        cmd_vel = Topic(domain, f"rt/{name}/cmd_vel", kinds["geometry_msgs/Twist"])
        self._orders = DataReader(domain, cmd_vel, qos=qos)
        odom = Topic(domain, f"rt/{name}/odom", kinds["nav_msgs/Odometry"])
        self._odom = DataWriter(domain, odom, qos=qos)
        scan = Topic(domain, f"rt/{name}/scan", kinds["sensor_msgs/LaserScan"])
        self._scan = DataWriter(domain, scan, qos=qos)

    def _drive(self, twist: Any, now_ns: int) -> None:
        turn_m_s = twist.angular.z * self._model.axle_m / 2.0
        steps = [(twist.linear.x + turn) / self._model.step_m for turn in (-turn_m_s, turn_m_s)]
        if not all(abs(speed) < _FASTER_STEPS_S for speed in steps):
            return  # no number, or none that wheels have: as if it had not come
        left, right = map(round, steps)
        lib.fw_wheels_drive(self.program.state, left, right, now_ns // 1000)

    def _tell(self, now_ns: int) -> None:
        kinds, zeros = self._types, [0.0] * 36
        vector, twist = kinds["geometry_msgs/Vector3"], kinds["geometry_msgs/Twist"]
        stamp = kinds["builtin_interfaces/Time"](*divmod(now_ns, 1_000_000_000))
        head = kinds["std_msgs/Header"](stamp, "odom")
        nowhere = kinds["geometry_msgs/Point"](0.0, 0.0, 0.0)
        pose = kinds["geometry_msgs/Pose"](
            nowhere, kinds["geometry_msgs/Quaternion"](0.0, 0.0, 0.0, 1.0)
        )
        out = self.program.state.body.outputs
        left, right = (
            steps * self._model.step_m for steps in (out.left_steps_s, out.right_steps_s)
        )
        turn_rad_s = (right - left) / self._model.axle_m
        moves = twist(vector((left + right) / 2.0, 0.0, 0.0), vector(0.0, 0.0, turn_rad_s))
        self._odom.write(
            kinds["nav_msgs/Odometry"](
                head,
                "base_link",
                kinds["geometry_msgs/PoseWithCovariance"](pose, zeros),
                kinds["geometry_msgs/TwistWithCovariance"](moves, zeros),
            )
        )
        step = 2.0 * pi / BEAMS
        self._scan.write(
            kinds["sensor_msgs/LaserScan"](
                head, 0.0, (BEAMS - 1) * step, step, 0.0, TELL_NS / 1e9, 0.0, RANGE_M,
                self.ranges_m(), [],
            )
        )  # fmt: skip

    def ranges_m(self) -> list[float]:
        """What its scanner sees: where its model's sensors look, how near they read something."""
        ring = self._model.ring
        ranges = np.full(BEAMS, np.inf)
        raw = self.program.proximity[: len(ring.places_m)]
        away_m = np.interp(raw, ring.table_raw[::-1], ring.table_m[::-1])
        from_m = np.hypot(*np.array(ring.places_m).reshape(-1, 2).T)
        beams = np.round(ring.headings_rad / (2.0 * pi / BEAMS)).astype(int) % BEAMS
        seen = raw > ring.table_raw[-1] + _SURE * ring.noise_raw
        ranges[beams[seen]] = (from_m + away_m)[seen]
        return [float(distance) for distance in ranges]
