"""robot/controllers/phototaxis.c in Python, line by line."""

import math

from vsense import Leds, Robot

ANGLES = [-0.3002, -0.8011, -1.5708, -2.6442, 2.6442, 1.5708, 0.7994, 0.3002]


class Controller:
    def __init__(self, robot: Robot) -> None:
        self.light = robot.sensor("light")
        self.enough = robot.param("enough", 8.0, least=0)
        self.least = robot.param("least", 0.02, least=0)
        self.walk = robot.walk()
        self.resting = False

    def step(self, robot: Robot) -> None:
        light, values = self.light, self.light.values
        known, stale, brightest = light.known, light.stale, max(values)
        if not known or not stale:
            self.resting = known and brightest >= self.enough
        robot.set_leds(Leds.RING if self.resting else 0)
        if self.resting:
            self.walk.rest()
        elif known and not stale and brightest - min(values) >= self.least:
            self.walk.towards(self.bearing_rad(list(values)))
        else:
            self.walk.wander()

    def bearing_rad(self, values: list[float]) -> float:
        first, darkest = values.index(max(values)), min(values)
        total = weights = 0.0
        for value, angle in zip(values, ANGLES):
            between = angle - ANGLES[first]
            if between > math.pi:
                between -= 2.0 * math.pi
            elif between <= -math.pi:
                between += 2.0 * math.pi
            total += (value - darkest) * between
            weights += value - darkest
        return ANGLES[first] + total / weights
