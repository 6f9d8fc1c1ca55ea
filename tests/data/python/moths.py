"""robot/controllers/phototaxis.c for all robots at once."""

import numpy as np

from vsense import Leds, Swarm

ANGLES = np.array([-0.3002, -0.8011, -1.5708, -2.6442, 2.6442, 1.5708, 0.7994, 0.3002])


class SwarmController:
    def __init__(self, swarm: Swarm) -> None:
        self.light = swarm.sensor("light")
        self.enough = swarm.param("enough", 8.0, least=0)
        self.least = swarm.param("least", 0.02, least=0)
        self.walk = swarm.walk()
        self.resting = np.zeros(len(swarm), dtype=bool)

    def step(self, swarm: Swarm) -> None:
        values, known, stale = self.light.values, self.light.known, self.light.stale
        top, low = values.max(axis=1), values.min(axis=1)
        self.resting = np.where(known & stale, self.resting, known & (top >= self.enough))
        swarm.set_leds(np.where(self.resting, Leds.RING, 0))
        steers = ~self.resting & known & ~stale & (top - low >= self.least)
        first = ANGLES[values.argmax(axis=1)]
        between = ANGLES - first[:, None]
        between -= 2.0 * np.pi * (between > np.pi)
        between += 2.0 * np.pi * (between <= -np.pi)
        weights = values - low[:, None]
        total, parts = np.zeros(len(swarm)), np.zeros(len(swarm))
        for sensor in range(8):  # in the order in which C adds them up
            total += weights[:, sensor] * between[:, sensor]
            parts += weights[:, sensor]
        self.walk.rest(self.resting)
        self.walk.towards(first + total / np.where(steers, parts, 1.0), steers)
        self.walk.wander(~self.resting & ~steers)
