"""Recordings of runs that can be worked out by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from tests.monitor.recording.conftest import BEGIN_NS, record
from vsense.base.message_bus import Message
from vsense.monitor.recording.writer import RecordingWriter

STEP_NS = 100_000_000
ZERO_NS = BEGIN_NS + 2 * STEP_NS
"""The run begins with the third arena state."""
TIMESTEPS = 20
STEP_M = 0.0125
DRIVER, BLINKER, POLLUTER, STRANGER = 3, 7, 9, 11
MISSED = 8
UNSEEN = range(3, 16)
"""Timesteps in which the blinker is not seen: 1.4 s from one sighting to the next."""
LOST = range(5, 8)
"""Timesteps in which the blinker is not connected."""
HELD = (11, 12, 14)
"""Timesteps in which the driver's wheels are held: two stops."""
LIT_FROM = 10

VOID = {"meta", "img", "br"}


def experiment(name: str = "hand", blind: bool = False, seed: int = 1) -> dict[str, Any]:
    """The data of `/experiment`."""
    return {
        "mode": "live", "command": "lab", "name": name, "seed": seed, "blind": blind,
        "version": "0.1.0", "file_text": "<argos-configuration/>", "timestep_s": 0.1,
        "length_s": 2.0, "arena": {"size_m": [2.0, 1.0, 0.5], "centre_m": [0.0, 0.0, 0.25]},
        "robots": [
            {"tag": DRIVER, "name": "driver", "height_m": 0.1},
            {"tag": BLINKER, "name": "blinker", "height_m": 0.1},
        ],
        "objects": [{"tag": POLLUTER, "name": "polluter"}],
        "sensors": [], "actuators": [], "cameras": [], "body_radius_m": 0.035,
    }  # fmt: skip


def world() -> dict[str, Any]:
    """The data of `/world`: one thing of each kind."""
    return {
        "entities": [
            {"kind": "box", "id": "wall", "position_m": [0.0, 0.49, 0.0],
             "size_m": [2.0, 0.02, 0.1], "yaw_rad": 0.0, "physical": True},
            {"kind": "cylinder", "id": "post", "position_m": [0.3, -0.3, 0.0], "radius_m": 0.05,
             "height_m": 0.1, "physical": False},
            {"kind": "light", "id": "lamp", "position_m": [-0.5, 0.2, 0.5], "intensity": 1.0,
             "color": [255, 255, 0]},
            {"kind": "zone", "id": "nest", "shape": "circle", "x_m": -0.7, "y_m": -0.2,
             "radius_m": 0.2, "size_m": [0.0, 0.0], "yaw_rad": 0.0, "color": [0, 0, 255],
             "value": 0.0},
            {"kind": "zone", "id": "food", "shape": "rectangle", "x_m": 0.7, "y_m": -0.2,
             "radius_m": 0.0, "size_m": [0.3, 0.1], "yaw_rad": 0.5, "color": [0, 255, 0],
             "value": 0.0},
            {"kind": "robot", "id": "ghost", "tag": 70000, "x_m": 0.0, "y_m": -0.4,
             "yaw_rad": 1.0},
        ],
        "floor": {"color": [250, 250, 250], "size_m": [1.0, 1.0], "centre_m": [0.0, 0.0],
                  "png": None},
    }  # fmt: skip


def arena(timestep: int, capture_ns: int) -> dict[str, Any]:
    """The data of `/arena`: the driver goes along +x, the blinker trembles and hides."""
    tags = [DRIVER, BLINKER, POLLUTER, STRANGER]
    return {
        "timestep": timestep + 10, "run_timestep": max(timestep, -1), "capture_ns": capture_ns,
        "robots": {
            "tag": tags,
            "x_m": [-0.4 + STEP_M * timestep, 0.5 + 0.001 * (timestep % 2), 0.0, 0.9],
            "y_m": [0.0, -0.1, 0.0, 0.3],
            "yaw_rad": [0.0] * 4, "speed_m_s": [0.0] * 4, "capture_ns": [capture_ns] * 4,
            "age_ns": [0] * 4, "confidence": [1.0] * 4, "cameras": [1] * 4,
            "seen": [True, timestep not in UNSEEN, True, True], "covariance": [None] * 4,
        },
        "detected": 4, "unnamed": 0, "duplicates": [], "joined": [],
    }  # fmt: skip


def robots(timestep: int) -> dict[str, Any]:
    """The data of `/robots`."""
    cause = "what it hears is too old" if timestep in HELD else ""
    return {
        "tag": [DRIVER, BLINKER], "name": ["driver", "blinker"],
        "connected": [True, timestep not in LOST], "seen": [True, timestep not in UNSEEN],
        "stop_cause": [cause, ""], "battery_mv": [4000 - timestep, None],
        "signal_dbm": [-60 - timestep, None],
        "heard_ms": [40.0, 1700.0 if timestep in LOST else 60.0],
        "leds": [0xFF if timestep >= LIT_FROM else 0, 0x100], "base_errors": [5 + timestep, 0],
    }  # fmt: skip


def messages(
    blind: bool = False, name: str = "hand", seed: int = 1, home: Callable[[int], float] = float
) -> Iterator[Message]:
    """A run of 20 timesteps, one of them missed, with two arena states before it.

    The latency is 10 ms in the first timestep and rises by 1 ms.
    """
    yield Message("/experiment", BEGIN_NS, experiment(name, blind, seed))
    yield Message("/world", BEGIN_NS, world())
    yield Message("/event", BEGIN_NS, {"text": "here <we> go", "level": "info", "by": "viewer 1"})
    parts = {"part": [DRIVER, BLINKER], "name": ["driver", "blinker"], "tag": [DRIVER, BLINKER]}
    yield Message("/parts", BEGIN_NS, parts | {"uid": ["a1", None], "run": 1, "timestep": -1})
    yield Message("/parts", BEGIN_NS + 1, parts | {"uid": ["a1", "b2"], "run": 1, "timestep": -1})
    cone = {"x_m": [0.0, -0.3, -0.3], "y_m": [0.0, 0.2, -0.2]}
    lived = 0
    for timestep in range(-2, TIMESTEPS):
        if timestep == MISSED:
            continue
        capture_ns = ZERO_NS + STEP_NS * timestep
        sent_ns = capture_ns + 10_000_000 + 1_000_000 * max(lived, 0)
        measures = {"items_home": home(timestep), "odd": None}
        signals = {"timestep": timestep, "time_s": 0.1 * timestep, "measures": measures}
        yield Message("/arena", capture_ns, arena(timestep, capture_ns))
        yield Message("/signals", capture_ns, signals | {"cones": [cone], "leds": {}})
        yield Message("/readings", sent_ns, {"timestep": timestep, "capture_ns": capture_ns})
        yield Message("/robots", sent_ns + 1, robots(timestep))
        lived += timestep >= 0
    camera = {"id": "cam", "rate_hz": 10.0, "dropped": 2, "state": "dark", "text": "it is dark"}
    yield Message("/cameras", ZERO_NS + STEP_NS, {"cameras": [camera]})
    run = {"state": "ended", "late": 4, "timestep": TIMESTEPS - 1}
    yield Message("/run", ZERO_NS + STEP_NS * TIMESTEPS, run)


def write(path: Path, sent: Iterable[Message]) -> Path:
    """Records messages."""
    return record(path, sent)


def write_cut_off(path: Path, sent: Iterable[Message]) -> Path:
    """Records messages like a process that is killed in the middle of a chunk."""
    writer = RecordingWriter(path, BEGIN_NS, 0)
    for message in sent:
        writer.add(message)
        writer.flush()
    path.write_bytes(path.read_bytes()[:-300])
    return path


class Reader(HTMLParser):
    """Reads a page: its headings, its captions, and whether every tag is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.sources: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h1", "h2", "h3"):
            self.headings.append(data)
