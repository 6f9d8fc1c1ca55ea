"""A run that is none: publishes all that a run publishes, and takes orders.

For tests, and for whoever works on the page:  python -m tests.monitor.ui.puppet --robots 100
"""

from __future__ import annotations

import argparse
import threading
import time
from typing import Any

import numpy as np

from tests.monitor.ui import puppet_world as play
from vsense.base.clock import host_ns
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.ui._server import WebServer
from vsense.run.changes import ResultCallback
from vsense.run.changing import Change, ChangeKind
from vsense.run.orders import Order, OrderError, OrderKind

STEP_S = 0.1
REPLAY_S = 90.0
CAN = {
    "waiting": ["emergency", "record"],
    "ready": ["start", "emergency", "record"],
    "running": ["pause", "stop", "reset", "emergency", "record"],
    "paused": ["start", "stop", "reset", "emergency", "record"],
    "ended": ["start", "reset", "emergency", "record"],
    "emergency": ["reset", "emergency", "record"],
}
AFTER = {
    OrderKind.START: "running",
    OrderKind.PAUSE: "paused",
    OrderKind.STOP: "ended",
    OrderKind.RESET: "ready",
    OrderKind.EMERGENCY: "emergency",
}


class Puppet:
    """A run of wandering robots; its state follows the orders.

    Attributes:
        bus: where it publishes.
        state: that of the run.
        orders: all that were given, with who gave them.
        fence: of the experiment, see MESSAGES.md; None: it has none.
        made: how the experiment was read, and of which series its run is.
        trouble: what is wrong with robots: tag -> words.
        held: why robots stand alone: tag -> words.
        stopped: publishes no arena states any more, as a run without cameras.
        silent: publishes nothing at all.
        refused: why an emergency stop is refused.
        unrecorded: cameras that are well, and whose pictures are not there.
    """

    def __init__(self, robots: int = 15, cameras: int = 4, mode: str = "live") -> None:
        self.bus = MessageBus()
        self.swarm = play.Swarm(robots, seed=3)
        self.cameras = cameras
        self.mode = mode
        self.state = "ended" if mode == "replay" else "ready"
        self.orders: list[Order] = []
        self.made: dict[str, Any] = {}
        self.fence: dict[str, Any] | None = None
        self.trouble: dict[int, str] = {}
        self.held: dict[int, str] = {}
        self.refused = ""
        self.unrecorded: set[int] = set()
        self.camera_trouble: dict[int, tuple[str, str]] = {}
        self.by: str | None = None
        self.recording = False
        self.playing, self.speed, self.position_s = False, 1.0, 0.0
        self.run, self.timestep, self.total = 1, -1, -1
        self.stopped = self.silent = False
        self.doubts: list[str] = []
        self.recording_trouble: str | None = None
        self.alarms: list[dict[str, str]] = []
        self.locked = False
        self.changes: list[Change] = []
        self.noise = 0.0
        self.world = play.world()
        self._known = 0
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._pace: threading.Thread | None = None

    # -- orders ---------------------------------------------------------------------------

    def give(self, order: Order) -> str:
        """Takes an order, as a run's desk does."""
        with self._lock:
            self.orders.append(order)
            text = self._replay(order) if self.mode == "replay" else self._live(order)
            self.by = order.by
        self.say(f"{order.kind.value}: {text}", order.by)
        self.publish("/run", self.run_message())
        return text

    def _live(self, order: Order) -> str:
        if order.kind.value not in CAN[self.state]:
            raise OrderError(f"cannot {order.kind.value}: the run is {self.state}")
        if self.refused and order.kind is OrderKind.EMERGENCY:
            raise OrderError(self.refused)
        if order.kind is OrderKind.RECORD:
            self.recording = bool(order.value)
            return "recording" if self.recording else "not recording"
        if order.kind is OrderKind.RESET:
            self.run += 1
            self.timestep = -1
        self.state = AFTER[order.kind]
        return f"run {self.run} is {self.state}"

    def _replay(self, order: Order) -> str:
        if order.kind is OrderKind.PLAY:
            self.playing = bool(order.value)
        elif order.kind is OrderKind.SPEED:
            self.speed = order.value
        elif order.kind is OrderKind.SEEK:
            self.position_s = min(max(order.value, 0.0), REPLAY_S)
            self.timestep = round(self.position_s / STEP_S)
        else:
            raise OrderError("a replay cannot be started or stopped: play it")
        return f"at {self.position_s:.1f} s, {'playing' if self.playing else 'paused'}"

    def ask(self, change: Change, by: str, answer: ResultCallback) -> None:
        """Takes a change of the world; the gate does not move."""
        with self._lock:
            self.changes.append(change)
            if change.name == "gate":
                answer("'gate' stands in the real arena", False)
                return
            if change.kind is ChangeKind.SET:
                self.noise = float(change.value)
            for entity in self.world["entities"]:
                if entity["id"] == change.name and change.kind is ChangeKind.MOVE:
                    entity |= {"x_m": change.x_m, "y_m": change.y_m}
        self.publish("/world", self.world)
        self.publish("/settings", self.settings())
        answer("done", True)

    def settings(self) -> dict[str, Any]:
        """The `/settings` message."""
        return {
            "locked": self.locked, "objects": True, "solids": False,
            "sensors": [{"controller": "pollutant", "name": "light", "noise_level": self.noise}],
            "fields": [], "params": {}, "things": {"zone": ["radius_m", "value"]},
        }  # fmt: skip

    # -- messages -------------------------------------------------------------------------

    def publish(self, topic: str, data: dict[str, Any], blob: bytes = b"") -> None:
        """Publishes one message that is wanted."""
        if not self.silent and self.bus.wants(topic):
            self.bus.publish(Message(topic, host_ns(), data, blob))

    def say(self, text: str, by: str | None = None, level: str = "info") -> None:
        """Publishes an event."""
        self.publish("/event", {"text": text, "level": level, "by": by})

    def step(self) -> None:
        """Lives one timestep and publishes it."""
        self.total += 1
        moving = self.playing if self.mode == "replay" else self.state == "running"
        if moving:
            self.swarm.move(STEP_S)
            self.timestep += 1
            self.position_s = min(self.position_s + STEP_S * self.speed, REPLAY_S)
        if self._known != self.bus.joined:
            self._known = self.bus.joined
            experiment = play.experiment(self.swarm, self.cameras, self.mode)
            if self.fence is not None:
                experiment["arena"] |= {"fence": self.fence}
            self.publish("/experiment", experiment | {"made": self.made})
            self.publish("/world", self.world)
            self.publish("/settings", self.settings())
            self.publish("/run", self.run_message())
        if not self.stopped:
            self.publish("/arena", self.arena())
            self.publish("/signals", self.signals())
            self._readings()
        if self.mode != "track":
            self.publish("/robots", self.robots())
        if self.total % 5 == 0:
            self.publish("/fields", play.fields(self.time_s))
        if self.total % 10 == 0:
            self.publish("/run", self.run_message())
            self.publish("/cameras", {"cameras": [self._camera(k) for k in range(self.cameras)]})
        if self.total % 3 == 0 and not self.stopped:
            self._pictures()

    @property
    def time_s(self) -> float:
        """Seconds since the run's beginning."""
        return max(self.timestep, 0) * STEP_S

    def run_message(self) -> dict[str, Any]:
        """The `/run` message."""
        made = {
            "state": self.state, "run": self.run, "runs": 3, "timestep": self.timestep,
            "time_s": self.time_s, "length_s": 120.0,
            "text": {"waiting": "waiting for epuck_11, epuck_15", "ready": "all robots are here",
                     "running": "running", "paused": "paused", "ended": "the run has ended",
                     "emergency": "emergency stop: reset to go on"}[self.state],
            "by": self.by, "can": CAN[self.state], "rate_hz": 10.0, "late": 2,
            "latency_ms": {"p50": 38.2, "p99": 61.7},
            "silent_s": 4.2 if self.stopped else 0.0,
            "recording": {"on": self.recording, "file": "run_001.mcap" if self.recording else None,
                          "bytes": self.timestep * 41_000 if self.recording else 0,
                          "lost_messages": 0, "trouble": self.recording_trouble},
            "disk_free_bytes": 212_000_000_000,
            "doubts": self.doubts, "alarms": self.alarms,
        }  # fmt: skip
        if self.mode == "track":
            made["can"] = ["stop", "record"]
        if self.mode == "replay":
            made["can"] = ["play", "speed", "seek"]
            made["recording"] = {"on": False, "file": None, "bytes": 0, "lost_messages": 0,
                                 "trouble": None}  # fmt: skip
            made["replay"] = {"position_s": self.position_s, "begin_s": 10.0,
                              "duration_s": REPLAY_S, "speed": self.speed,
                              "playing": self.playing}  # fmt: skip
        return made

    def arena(self) -> dict[str, Any]:
        """The `/arena` message."""
        swarm, count = self.swarm, len(self.swarm.tags)
        lost = [tag in self.trouble for tag in swarm.tags]
        robots = {
            "tag": [*swarm.tags, play.POLLUTER],
            "x_m": [*swarm.places[:, 0].round(4).tolist(), 0.0],
            "y_m": [*swarm.places[:, 1].round(4).tolist(), 0.0],
            "yaw_rad": [*swarm.yaws.round(4).tolist(), 0.0],
            "speed_m_s": [0.1] * count + [0.0],
            "capture_ns": [self.total * 10**8 - (10**9 if gone else 0) for gone in [*lost, False]],
            "age_ns": [10**9 if gone else 0 for gone in [*lost, False]],
            "confidence": [0.4 if gone else 1.0 for gone in [*lost, False]],
            "cameras": [1] * (count + 1), "seen": [not gone for gone in [*lost, False]],
            "covariance": [None] * (count + 1),
        }  # fmt: skip
        return {
            "timestep": self.total, "run_timestep": self.timestep, "capture_ns": self.total * 10**8,
            "robots": robots, "detected": count + 1, "unnamed": 0, "duplicates": [], "joined": [],
            "sightings": {"tag": [], "x_m": [], "y_m": [], "yaw_rad": []},
            "cameras": [f"cam{k}" for k in range(self.cameras)], "images": self._images(),
        }  # fmt: skip

    def _images(self) -> dict[str, Any]:
        columns: dict[str, list[Any]] = {name: [] for name in (
            "tag", "camera", "x_px", "y_px", "yaw_px_rad", "x_m", "y_m", "yaw_rad")}  # fmt: skip
        for camera in range(self.cameras):
            pixels, inside, _ = play.to_pixels(self.swarm.places, camera, self.cameras)
            for robot in np.flatnonzero(inside):
                x_m, y_m = self.swarm.places[robot].tolist()
                yaw = float(self.swarm.yaws[robot])
                x_px, y_px = pixels[robot].round(1).tolist()
                row = (self.swarm.tags[robot], camera, x_px, y_px, yaw, x_m, y_m, yaw)
                for column, value in zip(columns.values(), row):
                    column.append(value)
        return columns

    def signals(self) -> dict[str, Any]:
        """The `/signals` message."""
        inside = play.in_cone(self.swarm.places, self.time_s)
        x_m, y_m = play.cone(self.time_s)
        lit = int(inside.sum())
        virtual = self.swarm.tags[2:3] if len(self.swarm.tags) > 2 else []
        return {
            "timestep": self.total, "time_s": self.time_s,
            "leds": {"tag": virtual, "color": [[40, 200, 120] for _ in virtual]},
            "cones": [{"x_m": x_m, "y_m": y_m}], "measures": {"in the cone": lit, "LEDs on": lit},
        }  # fmt: skip

    def _readings(self) -> None:
        for robot, tag in enumerate(self.swarm.tags):
            if self.bus.wants(f"/readings/{tag}"):
                self.publish(f"/readings/{tag}", self.readings(robot))

    def readings(self, robot: int) -> dict[str, Any]:
        """A `/readings/TAG` message."""
        x_m, y_m = self.swarm.places[robot].tolist()
        angles = np.array(play.EPUCK_RAD) + self.swarm.yaws[robot]
        near = np.clip(np.cos(angles - np.arctan2(y_m, x_m)), 0, 1) * np.hypot(x_m, y_m) / 1.5
        light = np.clip(np.cos(angles - np.arctan2(-0.9 - y_m, -1.2 - x_m)), 0, 1)
        inside = play.in_cone(self.swarm.places[robot : robot + 1], self.time_s)
        now = self.total * 10**8
        values = [[int(inside[0])], near.round(3).tolist(),
                  [*light.round(3).tolist(), *play.EPUCK_RAD], [x_m, y_m]]  # fmt: skip
        return {
            "timestep": self.total, "capture_ns": now, "tag": [self.swarm.tags[robot]],
            "values": [values], "captured_ns": [[now, now, now - 3 * 10**8, -1]],
        }  # fmt: skip

    def robots(self) -> dict[str, Any]:
        """The `/robots` message."""
        tags = self.swarm.tags
        inside = play.in_cone(self.swarm.places, self.time_s)
        state = {"running": "run", "paused": "pause", "emergency": "stop"}.get(self.state, "idle")
        gone = [bool(self.trouble.get(tag)) for tag in tags]
        return {
            "tag": tags, "name": [f"epuck_{tag}" for tag in tags],
            "connected": [not g for g in gone],
            "heard_ms": [3200 if g else 12 + tag % 9 for g, tag in zip(gone, tags)],
            "udp": [True for _ in tags],
            "pose_age_ms": [1000 if g else 41 for g in gone], "seen": [not g for g in gone],
            "doubt": ["might be epuck_19" if tag == 23 and self.trouble else None for tag in tags],
            "state": ["stop" if g else state for g in gone],
            "stop_cause": ["link lost" if g else "" for g in gone],
            "battery_mv": [3400 if g else 3700 + 3 * (tag % 90) for g, tag in zip(gone, tags)],
            "battery_low": gone, "leds": [255 if lit else 0 for lit in inside],
            "left_steps_s": [600] * len(tags), "right_steps_s": [580] * len(tags),
            "base_errors": [3 if g else 0 for g in gone], "guard_restarts": [0] * len(tags),
            "sessions": [1] * len(tags), "version": ["0.1"] * len(tags),
            "controller": ["pollutant"] * len(tags), "hash": ["a1b2c3d4"] * len(tags),
            "actuators": [[[1]] for _ in tags],
            "shown": [{"state": "in the cone" if i else "searching", "n": tag / 8}
                      for i, tag in zip(inside, tags)],
            "held": [self.held.get(tag, "") for tag in tags],
            "trouble": [self.trouble.get(tag, "") for tag in tags],
        }  # fmt: skip

    def _camera(self, camera: int) -> dict[str, Any]:
        state, text = self.camera_trouble.get(camera, ("ok", ""))
        rate = 0.0 if state == "lost" else 10.0
        return {"id": f"cam{camera}", "rate_hz": rate, "dropped": 3 * camera, "state": state,
                "text": text}  # fmt: skip

    def _pictures(self) -> None:
        width, height = (round(side * play.PICTURE_SCALE) for side in play.CAMERA_PX)
        for camera in range(self.cameras):
            topic = f"/picture/cam{camera}"
            lost = self.camera_trouble.get(camera, ("ok", ""))[0] == "lost"
            if self.bus.wants(topic) and not lost and camera not in self.unrecorded:
                about = {"camera": f"cam{camera}", "timestep": self.total,
                         "capture_ns": self.total * 10**8, "format": "jpeg", "width_px": width,
                         "height_px": height, "scale": play.PICTURE_SCALE}  # fmt: skip
                self.publish(topic, about, play.picture(self.swarm, camera, self.cameras))

    # -- pace -----------------------------------------------------------------------------

    def begin(self) -> None:
        """Steps ten times per second in a thread of its own, until `end`."""
        self._pace = threading.Thread(target=self._live_on, name="puppet", daemon=True)
        self._pace.start()

    def _live_on(self) -> None:
        due = time.monotonic()
        while not self._ending.wait(max(due - time.monotonic(), 0.0)):
            due += STEP_S
            self.step()

    def end(self) -> None:
        """Ends the thread."""
        self._ending.set()
        if self._pace is not None:
            self._pace.join()


def running(robots: int = 15, cameras: int = 4) -> Puppet:
    """A puppet whose run is running."""
    puppet = Puppet(robots, cameras)
    puppet.state = "running"
    return puppet


def main() -> None:
    """Serves a puppet until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=15)
    parser.add_argument("--cameras", type=int, default=4)
    parser.add_argument("--mode", choices=("live", "replay", "track"), default="live")
    parser.add_argument("--port", type=int, default=8080)
    parser.add_argument("--host", default="127.0.0.1")
    options = parser.parse_args()
    puppet = Puppet(options.robots, options.cameras, options.mode)
    server = WebServer(puppet.bus, puppet.give, options.host, options.port)
    print(server.start().control)
    puppet.begin()
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        server.close()
        puppet.end()


if __name__ == "__main__":
    main()
