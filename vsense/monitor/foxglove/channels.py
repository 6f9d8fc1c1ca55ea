"""Foxglove's channels, derived from ours: what a recording, an export and the live server share.

Every message is whole in itself: a viewer that comes later or jumps to another time is given the
newest one of each topic.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2

from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor.foxglove import _pictures, _scene, _schemas, _shapes
from vsense.monitor.foxglove._pictures import ShownScale
from vsense.monitor.foxglove._shapes import ARENA_FRAME, Json
from vsense.vision.cameras.camera import Camera, CameraError

PICTURE = _shapes.PICTURE
TF, TF_CAMERAS, POSES = "/tf", "/tf_static", "/poses"
WORLD, CONES = "/scene/world", "/scene/cones"
ROBOTS_TOPIC, LED_TOPIC = "/scene/robots", "/scene/leds"
FLOOR_MAP, FIELD_TOPIC, LOG_TOPIC = "/floor", "/field/", "/log"
CALIBRATION_TOPIC, ANNOTATIONS = "/calibration/", "/annotations/"
MEASURES_TOPIC = "/measures"

_SCHEMAS = {
    TF: _schemas.FRAMES, TF_CAMERAS: _schemas.FRAMES, POSES: _schemas.POSES_SCHEMA,
    WORLD: _schemas.SCENE, ROBOTS_TOPIC: _schemas.SCENE, LED_TOPIC: _schemas.SCENE,
    CONES: _schemas.SCENE, FLOOR_MAP: _schemas.GRID_SCHEMA, FIELD_TOPIC: _schemas.GRID_SCHEMA,
    LOG_TOPIC: _schemas.LOG_SCHEMA, CALIBRATION_TOPIC: _schemas.CALIBRATION_SCHEMA,
    ANNOTATIONS: _schemas.ANNOTATIONS_SCHEMA, MEASURES_TOPIC: _schemas.MEASURES_SCHEMA,
}  # fmt: skip

_SOURCES: Mapping[str, frozenset[str]] = {
    topic: frozenset(sources)
    for topic, sources in {
        TF: {"/arena"}, POSES: {"/arena"}, ROBOTS_TOPIC: {"/arena"}, CONES: {"/signals"},
        LED_TOPIC: {"/robots", "/signals"}, MEASURES_TOPIC: {"/signals"},
        FIELD_TOPIC: {"/fields"}, ANNOTATIONS: {"/arena"},
    }.items()
}  # fmt: skip

LASTING = frozenset({"/experiment", "/world", "/run", "/event", "/gap"})
"""Topics that come rarely, and that whoever begins to look later needs: always to be converted."""

_LEVELS = {"info": 2, "warning": 3, "trouble": 4}
_UNUSABLE = (*DAMAGED, CameraError, cv2.error)


@dataclass(frozen=True, slots=True)
class Derived:
    """A message of Foxglove's: `schema` is the name of one of `schemas.SCHEMAS`.

    `time_ns` is on the clock of the message it was made from; the times in `data` are UTC.
    """

    topic: str
    schema: str
    time_ns: int
    data: Json


def schema_of(topic: str) -> str:
    """The name of a derived topic's schema; KeyError: there is no such topic."""
    family = topic if topic in _SCHEMAS else topic[: topic.find("/", 1) + 1]
    return _SCHEMAS[family]


def sources_of(topic: str) -> frozenset[str]:
    """The topics of ours, beside `LASTING`, that a derived topic is made from."""
    family = topic if topic in _SOURCES else topic[: topic.find("/", 1) + 1]
    sources = _SOURCES.get(family, frozenset())
    if family in (ANNOTATIONS, CALIBRATION_TOPIC):  # a picture says at which scale it is shown
        sources |= {PICTURE + topic.removeprefix(family)}
    return sources


class Channels:
    """Makes Foxglove's messages of ours, in the order in which those come. For one thread.

    Args:
        utc_shift_ns: UTC less the clock of the messages' times.
        wants: whether somebody wants a derived topic now; by default everything is wanted.
        full_size: cameras' pictures come too, and as they are. Otherwise a camera's annotations
            begin with its first picture, which says at which scale it is shown.
    """

    def __init__(
        self,
        utc_shift_ns: int,
        wants: Callable[[str], bool] = lambda topic: True,
        full_size: bool = False,
    ) -> None:
        self._shift_ns = utc_shift_ns
        self._full_size = full_size
        self._wants = wants
        self._arena: Mapping[str, Any] | None = None
        self._world: Message | None = None
        self._cameras: dict[str, Camera] = {}
        self._shown: dict[str, ShownScale] = {}
        self._names: dict[int, str] = {}
        self._heights_m: dict[int, float] = {}
        self._radii_m: dict[int, float] = {}
        self._objects: tuple[int, ...] = ()
        self._lit: dict[int, int] = {}
        self._colors: dict[int, Sequence[float]] = {}
        self._virtual: list[Mapping[str, Any]] = []
        self._sent: dict[str, object] = {}
        self._makers: Mapping[str, Callable[[Message], Iterator[Derived]]] = {
            "/experiment": self._of_experiment,
            "/world": self._of_world,
            "/arena": self._of_arena,
            "/signals": self._of_signals,
            "/robots": self._of_robots,
            "/fields": self._of_fields,
            "/event": self._of_event,
            "/gap": self._of_gap,
        }

    def topics(self) -> list[str]:
        """The derived topics that are known to come: of the experiment's cameras, and of all."""
        own = [topic for topic in _SCHEMAS if not topic.endswith("/")]
        named = [family + c for c in self._cameras for family in (CALIBRATION_TOPIC, ANNOTATIONS)]
        return own + named

    def convert(self, message: Message) -> list[Derived]:
        """Gives what follows from a message of ours; nothing of one that is damaged."""
        maker = self._makers.get(message.topic)
        if maker is None and message.topic.startswith(PICTURE):
            maker = self._of_picture
        if maker is None:
            return []
        try:
            return list(maker(message))
        except _UNUSABLE:
            return []

    def forget(self) -> None:
        """Makes everything anew: who looks has dropped what was told, as after a jump in time."""
        self._sent.clear()

    def _derived_message(self, topic: str, message: Message, data: Json) -> Derived:
        return Derived(topic, schema_of(topic), message.time_ns, data)

    def _if_new(
        self, topic: str, key: object, message: Message, make: Callable[[int], Json | None]
    ) -> Iterator[Derived]:
        """Makes a message where it is wanted and `key`, all that is in it, is another."""
        if self._wants(topic) and self._sent.get(topic) != key:
            self._sent[topic] = key
            data = make(message.time_ns + self._shift_ns)
            if data is not None:
                yield self._derived_message(topic, message, data)

    def _of_experiment(self, message: Message) -> Iterator[Derived]:
        data = message.data
        robots, objects = list(data.get("robots") or ()), list(data.get("objects") or ())
        self._names = {int(row["tag"]): str(row["name"]) for row in robots + objects}
        self._heights_m = {int(row["tag"]): float(row["height_m"]) for row in robots}
        radii = ((row, row.get("radius_m")) for row in robots + objects)
        self._radii_m = {int(row["tag"]): float(radius) for row, radius in radii if radius}
        self._objects = tuple(int(row["tag"]) for row in objects)
        self._arena = data.get("arena")
        models = [camera["model"] for camera in data.get("cameras") or ()]
        self._cameras = {c.id: c for c in (Camera.from_json(json.dumps(m)) for m in models)}
        yield from self._of_cameras(message)
        if self._world is not None and self._wants(WORLD):
            yield from self._of_world(replace(self._world, time_ns=message.time_ns))

    def _of_cameras(self, message: Message) -> Iterator[Derived]:
        utc_ns = message.time_ns + self._shift_ns
        if self._cameras:
            frames = [_pictures.frame(camera, utc_ns) for camera in self._cameras.values()]
            yield self._derived_message(TF_CAMERAS, message, {"transforms": frames})
        for name in self._cameras:
            yield self._lens(name, message)

    def _lens(self, camera: str, message: Message) -> Derived:
        shown = self._shown.get(camera, ShownScale())
        utc_ns = message.time_ns + self._shift_ns
        data = _pictures.calibration(self._cameras[camera], shown, utc_ns)
        return self._derived_message(CALIBRATION_TOPIC + camera, message, data)

    def _of_picture(self, message: Message) -> Iterator[Derived]:
        camera = message.topic.removeprefix(PICTURE)
        shown, before = ShownScale.of(message.data), self._shown.get(camera)
        self._shown[camera] = shown
        if camera in self._cameras and shown != (before or ShownScale()):
            yield self._lens(camera, message)

    def _of_world(self, message: Message) -> Iterator[Derived]:
        self._world, data = message, message.data
        entities = data["entities"]
        self._virtual = [thing for thing in entities if thing["kind"] == "robot"]
        if self._wants(WORLD):
            utc_ns = message.time_ns + self._shift_ns
            yield self._derived_message(WORLD, message, _scene.world(data, self._arena, utc_ns))
        floor = data.get("floor") or {}
        key = [floor.get(name) for name in ("png", "size_m", "centre_m")]
        yield from self._if_new(FLOOR_MAP, key, message, lambda utc_ns: _scene.floor(floor, utc_ns))

    def _of_arena(self, message: Message) -> Iterator[Derived]:
        robots, utc_ns = message.data["robots"], message.time_ns + self._shift_ns
        columns = [robots[name] for name in ("tag", "x_m", "y_m", "yaw_rad")]
        if self._wants(TF):
            virtual = [(r["tag"], r["x_m"], r["y_m"], r["yaw_rad"]) for r in self._virtual]
            frames = [_transform(utc_ns, *row) for row in (*zip(*columns), *virtual)]
            yield self._derived_message(TF, message, {"transforms": frames})
        if self._wants(POSES):
            poses = [_shapes.pose((x, y, 0.0), yaw) for _, x, y, yaw in zip(*columns)]
            data = {"timestamp": _shapes.stamp(utc_ns), "frame_id": ARENA_FRAME, "poses": poses}
            yield self._derived_message(POSES, message, data)
        seen = {int(tag): bool(now) for tag, now in zip(robots["tag"], robots["seen"])}
        heights_m = self._heights_of(seen)
        labels = self._names, self._objects, heights_m, self._radii_m
        yield from self._if_new(
            *(ROBOTS_TOPIC, (seen, *labels), message),
            lambda utc_ns: _scene.robots(seen, *labels, utc_ns),
        )
        yield from self._of_images(message)

    def _heights_of(self, tags: Iterable[int]) -> dict[int, float]:
        """The markers' heights; of robots that are not listed as of the others, or 0."""
        usual_m = max(self._heights_m.values(), default=0.0)
        return {tag: self._heights_m.get(tag, usual_m) for tag in tags}

    def _of_images(self, message: Message) -> Iterator[Derived]:
        """The annotations of the cameras whose pictures come."""
        images = message.data.get("images") or {}
        for place, camera in enumerate(message.data.get("cameras") or ()):
            topic, shown = ANNOTATIONS + camera, self._full_size or camera in self._shown
            if not (images and shown and camera in self._cameras and self._wants(topic)):
                continue
            rows = [row for row, which in enumerate(images["camera"]) if which == place]
            own = {name: [column[row] for row in rows] for name, column in images.items()}
            data = _pictures.marks(
                self._cameras[camera],
                own,
                self._names,
                self._heights_of(own["tag"]),
                self._radii_m,
                self._shown.get(camera, ShownScale()),
                message.time_ns + self._shift_ns,
            )
            yield self._derived_message(topic, message, data)

    def _of_signals(self, message: Message) -> Iterator[Derived]:
        leds, cones = message.data["leds"], message.data["cones"]
        self._colors = {int(tag): rgb for tag, rgb in zip(leds["tag"], leds["color"])}
        yield from self._of_leds(message)
        measures = message.data["measures"]
        if measures and self._wants(MEASURES_TOPIC):
            values = [{"label": n, "value": v} for n, v in measures.items() if v is not None]
            yield self._derived_message(MEASURES_TOPIC, message, {"values": values})
        yield from self._if_new(CONES, cones, message, lambda utc_ns: _scene.cones(cones, utc_ns))

    def _of_robots(self, message: Message) -> Iterator[Derived]:
        data = message.data
        self._lit = {int(tag): int(bits) for tag, bits in zip(data["tag"], data["leds"]) if bits}
        yield from self._of_leds(message)

    def _of_leds(self, message: Message) -> Iterator[Derived]:
        shown = self._lit, self._colors, self._radii_m
        make = lambda utc_ns: _scene.leds(*shown, utc_ns)  # noqa: E731
        yield from self._if_new(LED_TOPIC, shown, message, make)

    def _of_fields(self, message: Message) -> Iterator[Derived]:
        for field in message.data["fields"]:
            topic = FIELD_TOPIC + str(field["id"])
            if self._wants(topic):
                data = _scene.field(field, message.time_ns + self._shift_ns)
                yield self._derived_message(topic, message, data)

    def _of_event(self, message: Message) -> Iterator[Derived]:
        data = message.data
        level = _LEVELS.get(data.get("level", ""), 2)
        yield self._line(message, level, str(data["text"]), str(data.get("by") or "vsense"))

    def _of_gap(self, message: Message) -> Iterator[Derived]:
        yield self._line(message, _LEVELS["warning"], f"not whole: {message.data['why']}", "vsense")

    def _line(self, message: Message, level: int, text: str, name: str) -> Derived:
        stamp = _shapes.stamp(message.time_ns + self._shift_ns)
        data = {"timestamp": stamp, "level": level, "message": text, "name": name}
        return self._derived_message(LOG_TOPIC, message, {**data, "file": "", "line": 0})


def _transform(utc_ns: int, tag: int, x_m: float, y_m: float, yaw_rad: float) -> Json:
    frame, turn = _shapes.robot_frame(tag), _shapes.yaw_turn(yaw_rad)
    return _shapes.transform(utc_ns, ARENA_FRAME, frame, (x_m, y_m, 0.0), turn)
