# SPDX-License-Identifier: MIT
"""A robot of ROS 2 that takes cmd_vel: ros2.py [--namespace NAME] [--axle M] [--max M_S]

It speaks DDS by the package cyclonedds (pip install cyclonedds), with ROS 2's names of topics and
types: it needs no ROS, and robots with any of ROS 2's DDS implementations understand it. Meant to
run on the robot, in the domain of ROS_DOMAIN_ID. Velocity and turn rate are those of virtual wheels
`--axle` apart. `odom` gives their way; of `scan` proximity is what is within 0.3 m where the eight
sensors of an e-puck look. A robot whose odom is older than a second does not answer.

What such a robot does when nobody sends cmd_vel any more is its own controller's to say. Somebody
else who sends it is told of.

Sources: geometry_msgs, nav_msgs, sensor_msgs (ros2/common_interfaces); ROS 2's design articles on
names of topics ("rt/cmd_vel") and types. Tried with a peer that is made of those, not on a robot.
"""

import argparse
import os
import sys
import time
from dataclasses import dataclass

import vsense_driver
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

RELIABLE = Qos(Policy.Reliability.Reliable(10**8), Policy.History.KeepLast(1))
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(1))
OLD_S, NEAR_M, BEAM_RAD, RAW_MAX, FASTER_M_S = 1.0, 0.3, 0.15, 4095, 100.0
ANGLES_RAD = (-0.3002, -0.8011, -1.5708, -2.6442, 2.6442, 1.5708, 0.7994, 0.3002)


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Vector3  # a Point, which is as long
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs::msg::dds_::LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


class Ros2:
    def __init__(self, namespace, axle_m, max_m_s):
        self.max_m_s, self.axle_m = max_m_s, axle_m
        self.twist = vsense_driver.Twist(axle_m)
        domain = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        prefix = "/".join(["rt", *namespace.strip("/").split("/")]).rstrip("/")
        self.topic = prefix + "/cmd_vel"
        self.writer = DataWriter(domain, Topic(domain, self.topic, Twist), qos=RELIABLE)
        odom, scan = (Topic(domain, prefix + n, t) for n, t in TOPICS.items())
        self.odom = DataReader(domain, odom, qos=BEST_EFFORT)
        self.scan = DataReader(domain, scan, qos=BEST_EFFORT)
        self.writers = BuiltinDataReader(domain, BuiltinTopicDcpsPublication)
        self.heard_s, self.way_m, self.proximity = 0.0, [0.0, 0.0], None

    def drive(self, left_m_s, right_m_s):
        ahead_m_s, turn_rad_s = self.twist.of(left_m_s, right_m_s)
        self.writer.write(Twist(Vector3(x=ahead_m_s), Vector3(z=turn_rad_s)))
        for found in self.writers.take(100):
            if found.topic_name == self.topic and found.key != self.writer.guid:
                print("ros2: somebody else sends", self.topic[3:], "too", file=sys.stderr)

    def sense(self, report):
        for odometry in valid(self.odom, 100):
            now_s, twist = time.monotonic(), odometry.twist.twist
            turn = twist.angular.z * self.axle_m / 2
            speeds = twist.linear.x - turn, twist.linear.x + turn
            if not all(abs(speed) < FASTER_M_S for speed in speeds):
                continue  # no number, or none that wheels have: as if it had not come
            for i, speed in enumerate(speeds):
                self.way_m[i] += speed * min(now_s - self.heard_s, OLD_S) if self.heard_s else 0.0
            self.heard_s = now_s
        for scan in valid(self.scan, 1):
            self.proximity = [nearness(scan, angle) for angle in ANGLES_RAD]
        if time.monotonic() > self.heard_s + OLD_S:
            raise TimeoutError
        report.way_m, report.proximity = self.way_m, self.proximity
        report.measured_ns = int(self.heard_s * 1e9)


TOPICS = {"/odom": Odometry, "/scan": LaserScan}


def valid(reader, most):
    """Messages; not the word that the one who sent them has gone."""
    return [m for m in reader.take(most) if isinstance(m, tuple(TOPICS.values()))]


def nearness(scan, angle_rad):
    """Of what is nearest around an angle, raw: 4095 touches, 0 is NEAR_M away or further."""
    nearest = NEAR_M
    for i, distance in enumerate(scan.ranges):
        away = abs(scan.angle_min + i * scan.angle_increment - angle_rad) % 6.283185307
        if min(away, 6.283185307 - away) < BEAM_RAD and distance >= scan.range_min:
            nearest = min(nearest, max(distance, 0.0))
    return RAW_MAX * (1.0 - nearest / NEAR_M)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--namespace", default="")
    parser.add_argument("--axle", type=float, default=0.053)
    parser.add_argument("--max", type=float, default=0.2)
    options = parser.parse_args()
    vsense_driver.run(Ros2(options.namespace, options.axle, options.max))
