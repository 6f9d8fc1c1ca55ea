# SPDX-License-Identifier: MIT
"""A robot of your own for vsense: what `vsensed --base "exec:python3 mine.py"` starts is

    import vsense_driver

    class Mine:
        max_m_s = 0.2

        def drive(self, left_m_s, right_m_s):
            ...  # turn the wheels; 0, 0 has to stop the robot

        def sense(self, report):
            report.proximity = [...]  # and what else of `Report` it measures

    vsense_driver.run(Mine())

`lights(leds, rgb)` and `close()` may be there, too. Nothing is needed but Python 3.6 and this file,
which lies beside the driver; robot/DRIVERS.md says what goes over the line. What a driver prints
goes to the daemon's own log.
"""

import fcntl
import os
import select
import signal
import struct
import sys
import time

VERSION = 1
MAGIC = b"vsd" + bytes([VERSION])
ORDER = struct.Struct("<4sIQQiiH12s2x")
REPORT = struct.Struct("<4sIQQqqHHBBBBH3h3h3h28x16h16h")
RAYS = 16
END = 1
WAY, GROUND, ACCELEROMETER, GYROSCOPE, DISTANCE = 1, 2, 4, 8, 16
UNKNOWN = 255
GROUND_MAX = 1023
HELD_NS = 10**9
"""So long an earlier driver may take to end."""
TRIES = 3
"""So often a robot is told to stop that does not answer, when nobody else will tell it."""


class Report:
    """What a robot measures; None is what it does not. A driver has one, and `sense` renews it.

    Attributes:
        proximity, light: raw values, 0 to 4095, at most 16; an e-puck's ring has 8, clockwise from
            the front, and one that is higher is nearer, or brighter.
        way_m: of the left and right wheel, since whenever.
        ground: left, centre, right; 0 is black, 1 white.
        accelerometer: x, y, z, raw.
        gyroscope: x, y, z [rad/s].
        distance_m: to what is ahead.
        battery_v, battery_low: of the battery.
        rgb_leds: how many coloured LEDs it has, at most 4.
        measured_ns: when, by `time.monotonic_ns` or CLOCK_MONOTONIC; None is now.
    """

    proximity = light = way_m = ground = accelerometer = gyroscope = None
    distance_m = battery_v = battery_low = measured_ns = None
    rgb_leds = 0

    def pack(self, order_ns, max_m_s):
        """The record that tells it, and which order the robot follows."""
        rays = [list(values or [])[:RAYS] for values in (self.proximity, self.light)]
        kinds = (
            (WAY, self.way_m),
            (GROUND, self.ground),
            (ACCELEROMETER, self.accelerometer),
            (GYROSCOPE, self.gyroscope),
            (DISTANCE, self.distance_m),
        )
        return REPORT.pack(
            MAGIC,
            sum(flag for flag, value in kinds if value is not None),
            order_ns,
            _now_ns() if self.measured_ns is None else self.measured_ns,
            *(round(1e6 * way) for way in self.way_m or (0, 0)),
            round(1000 * max_m_s),
            round(1000 * (self.battery_v or 0)),
            UNKNOWN if self.battery_low is None else bool(self.battery_low),
            self.rgb_leds,
            *map(len, rays),
            round(1000 * (self.distance_m or 0)),
            *(_int16(GROUND_MAX * value) for value in self.ground or (0, 0, 0)),
            *map(_int16, self.accelerometer or (0, 0, 0)),
            *(_int16(1000 * value) for value in self.gyroscope or (0, 0, 0)),
            *(_int16(value) for row in rays for value in row + [0] * (RAYS - len(row))),
        )


class Twist:
    """Makes velocity and turn rate of two wheels, for robots that are told those.

    Attributes:
        axle_m: between the wheels of the robot that vsense knows; an e-puck's are 53 mm apart.
    """

    def __init__(self, axle_m=0.053):
        self.axle_m = axle_m

    def of(self, left_m_s, right_m_s):
        """(m/s ahead, rad/s counter-clockwise)."""
        return (left_m_s + right_m_s) / 2.0, (right_m_s - left_m_s) / self.axle_m


def hold(device):
    """Keeps a device, an open file or its number, for this driver; ends where another has it."""
    end_ns = _now_ns() + HELD_NS
    while True:
        try:
            fcntl.flock(device, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except OSError:
            if _now_ns() > end_ns:
                sys.exit("vsense_driver: another process holds the device")
        time.sleep(0.02)


def run(robot):
    """Has a robot follow its daemon's orders until that ends, or says so. It stops then.

    `drive` and `sense` should be back within 30 ms, together; a robot whose driver has not answered
    for 300 ms is given another driver. Where one of them raises TimeoutError the order is not
    answered; any other exception ends the driver, and the daemon starts it anew.
    """
    line = os.dup(1)
    os.dup2(2, 1)  # what is printed must not come between the reports
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        _follow(robot, line)
    finally:
        _stop(robot)
        getattr(robot, "close", lambda: None)()


def _follow(robot, line):
    report, data, until_ns = Report(), b"", 0
    while True:
        wait_s = max(until_ns - _now_ns(), 0) / 1e9 if until_ns else None
        if not select.select([0], [], [], wait_s)[0]:
            _stop(robot)
            until_ns = 0
            continue
        more = os.read(0, 64 * ORDER.size)
        data += more
        if more and (len(data) < ORDER.size or select.select([0], [], [], 0)[0]):
            continue  # there is a newer one
        if len(data) < ORDER.size:
            return
        whole = len(data) // ORDER.size * ORDER.size
        newest, data = data[whole - ORDER.size : whole], data[whole:]
        magic, flags, sent_ns, until_ns, left, right, leds, rgb = ORDER.unpack(newest)
        if magic != MAGIC:
            sys.exit(f"vsense_driver: no order of version {VERSION}: bring the newest")
        if not more or (left, right) == (0, 0) or until_ns <= _now_ns():
            left = right = until_ns = 0
        try:
            robot.drive(left / 1e6, right / 1e6)
            if hasattr(robot, "lights"):
                robot.lights(leds, [tuple(rgb[i : i + 3]) for i in range(0, 12, 3)])
            robot.sense(report)
        except TimeoutError:
            continue
        if more:
            os.write(line, report.pack(sent_ns, getattr(robot, "max_m_s", 0)))
        if not more or flags & END:
            return


def _stop(robot):
    for _ in range(TRIES):
        try:
            robot.drive(0.0, 0.0)
        except TimeoutError:
            continue
        return


def _now_ns():
    return int(time.clock_gettime(time.CLOCK_MONOTONIC) * 1e9)


def _int16(value):
    return max(-32768, min(32767, round(value)))
