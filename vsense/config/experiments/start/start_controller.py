"""The robots' controller: wander; on a green floor stop with a probability, and light the LEDs.

A robot stays for as long as the floor is green. Parameters: stop_probability per timestep (0.3),
and those of walk.h: speed_cm_s, walk_s, near_raw.
"""

from vsense import Leds, Robot


class Controller:
    """One robot: whatever it remembers is an attribute of its own."""

    def __init__(self, robot: Robot) -> None:
        """Binds sensors and reads parameters, before the first control step of a run."""
        self.floor = robot.sensor("rgb_ground")
        self.stop_probability = robot.param("stop_probability", 0.3, least=0, most=1)
        self.walk = robot.walk()
        self.resting = False

    def step(self, robot: Robot) -> None:
        """One control step, ten times a second."""
        green = self.is_on_green()
        if green and not self.resting and robot.random() < self.stop_probability:
            self.resting = True
        self.resting = self.resting and green
        robot.set_leds(Leds.RING if self.resting else 0)
        if self.resting:
            self.walk.rest()
        else:
            self.walk.wander()

    def is_on_green(self) -> bool:
        """Whether the floor is green. A stale value is no news: a robot that rests goes on."""
        if not self.floor.known:
            return False
        if self.floor.stale:
            return self.resting
        red, green, blue, _ = self.floor.values  # and alpha, 0 to 255
        return bool(red < 100.0 and green > 200.0 and blue < 100.0)
