"""Our messages as ROS 2 has them: what a bag and the publisher share.

Frames are REP 103's and 105's: `map` is the arena frame, `robot_23/base_link` on the floor below
robot 23 with x along its heading, `cam1_optical` with z along the camera's axis and x to the right.
Lengths are in m, angles in rad; a quaternion is x, y, z, w. Times are UTC.

Source: the definitions of messages are those of ros2/common_interfaces, ros2/geometry2 (tf2_msgs)
and ros2/rcl_interfaces (builtin_interfaces), humble, field by field.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any

import cv2
import numpy as np

from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor.recording.form import PICTURE, ExperimentMessage
from vsense.vision.cameras.camera import Camera, CameraError

DEFINITIONS = {
    "geometry_msgs/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular",
    "geometry_msgs/Pose": "geometry_msgs/Point position, geometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose, float64[36] covariance",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist, float64[36] covariance",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation"
    ", geometry_msgs/Quaternion rotation",
    "builtin_interfaces/Time": "int32 sec, uint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp, string frame_id",
    "geometry_msgs/PoseStamped": "std_msgs/Header header, geometry_msgs/Pose pose",
    "geometry_msgs/PoseArray": "std_msgs/Header header, geometry_msgs/Pose[] poses",
    "geometry_msgs/TransformStamped": "std_msgs/Header header, string child_frame_id"
    ", geometry_msgs/Transform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "std_msgs/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim, uint32 data_offset",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout, float64[] data",
    "nav_msgs/Odometry": "std_msgs/Header header, string child_frame_id"
    ", geometry_msgs/PoseWithCovariance pose, geometry_msgs/TwistWithCovariance twist",
    "sensor_msgs/LaserScan": "std_msgs/Header header, float32 angle_min, float32 angle_max"
    ", float32 angle_increment, float32 time_increment, float32 scan_time, float32 range_min"
    ", float32 range_max, float32[] ranges, float32[] intensities",
    "sensor_msgs/CompressedImage": "std_msgs/Header header, string format, uint8[] data",
    "sensor_msgs/RegionOfInterest": "uint32 x_offset, uint32 y_offset, uint32 height"
    ", uint32 width, bool do_rectify",
    "sensor_msgs/CameraInfo": "std_msgs/Header header, uint32 height, uint32 width"
    ", string distortion_model, float64[] d, float64[9] k, float64[9] r, float64[12] p"
    ", uint32 binning_x, uint32 binning_y, sensor_msgs/RegionOfInterest roi",
    "sensor_msgs/BatteryState": "std_msgs/Header header, float32 voltage, float32 temperature"
    ", float32 current, float32 charge, float32 capacity, float32 design_capacity"
    ", float32 percentage, uint8 power_supply_status, uint8 power_supply_health"
    ", uint8 power_supply_technology, bool present, float32[] cell_voltage"
    ", float32[] cell_temperature, string location, string serial_number",
}
"""Each after those that it holds."""

MAP = "map"
LATCHED = "/tf_static", "/camera_info"
"""Ends of topics whose newest message is for those that come later, too."""
_OWN = "pose", "battery"
"""Topics of a robot that no sensor of this name may have: they are of other kinds."""
_BATTERY_UNKNOWN = dict.fromkeys(
    ("temperature", "current", "charge", "capacity", "design_capacity", "percentage"), math.nan
)

Fields = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Ros2Message:
    """A message of ROS 2: `kind` is a name in `DEFINITIONS`; fields that are left out are 0.

    `time_ns` is UTC.
    """

    topic: str
    kind: str
    time_ns: int
    fields: Fields


class Ros2Converter:
    """Makes ROS 2's messages of ours, in the order in which those come; for one thread.

    `utc_shift_ns` is UTC less the clock of our messages.
    """

    def __init__(self, utc_shift_ns: int) -> None:
        self._shift_ns = utc_shift_ns
        self._sensors: list[list[tuple[str, str]]] = []
        self._cameras = dict[str, str]()
        self._controller_of: dict[int, int] = {}
        self._makers: Mapping[str, Callable[[Message, int], Iterator[Ros2Message]]] = {
            "/experiment": self._of_experiment,
            "/arena": self._of_arena,
            "/readings": self._of_readings,
            "/robots": self._of_robots,
        }

    def convert(self, message: Message) -> list[Ros2Message]:
        """What follows from a message; nothing where it is damaged."""
        make = self._makers.get(message.topic)
        if make is None and message.topic.startswith(PICTURE) and message.blob:
            make = self._of_picture
        try:
            return [] if make is None else list(make(message, message.time_ns + self._shift_ns))
        except (*DAMAGED, CameraError):
            return []

    def _of_experiment(self, message: Message, now_ns: int) -> Iterator[Ros2Message]:
        experiment = ExperimentMessage.read(message.data)
        self._controller_of = experiment.controller_of()
        controllers = experiment.controllers
        named = ([str(sensor["name"]) for sensor in c["sensors"]] for c in controllers)
        self._sensors = [list(distinct(names, _OWN).items()) for names in named]
        models = (camera["model"] for camera in experiment.cameras)
        cameras = [Camera.from_json(json.dumps(model)) for model in models]
        self._cameras = distinct(camera.id for camera in cameras)
        transforms = [_transform(now_ns, self._frame(c.id), *_pose_of(c)) for c in cameras]
        if transforms:
            yield Ros2Message(
                "/tf_static", "tf2_msgs/TFMessage", now_ns, {"transforms": transforms}
            )
        for camera in cameras:
            topic = f"/{self._word(camera.id)}/camera_info"
            info = _header(now_ns, self._frame(camera.id)) | camera_info(camera)
            yield Ros2Message(topic, "sensor_msgs/CameraInfo", now_ns, info)

    def _of_arena(self, message: Message, now_ns: int) -> Iterator[Ros2Message]:
        stamp_ns = int(message.data["capture_ns"]) + self._shift_ns
        robots = message.data["robots"]
        rows = zip(robots["tag"], robots["x_m"], robots["y_m"], robots["yaw_rad"], robots["seen"])
        seen = [(int(tag), float(x), float(y), float(yaw)) for tag, x, y, yaw, at in rows if at]
        poses = {tag: (_xyz(x, y, 0.0), yaw_quaternion(yaw)) for tag, x, y, yaw in seen}
        frames = [
            _transform(stamp_ns, f"{namespace(tag)}/base_link", place, turn)
            for tag, (place, turn) in poses.items()
        ]
        head = _header(stamp_ns, MAP)
        whole = {t: {"position": place, "orientation": turn} for t, (place, turn) in poses.items()}
        yield Ros2Message("/tf", "tf2_msgs/TFMessage", now_ns, {"transforms": frames})
        listed = head | {"poses": list(whole.values())}
        yield Ros2Message("/poses", "geometry_msgs/PoseArray", now_ns, listed)
        for tag, pose in whole.items():
            topic = f"/{namespace(tag)}/pose"
            yield Ros2Message(topic, "geometry_msgs/PoseStamped", now_ns, head | {"pose": pose})

    def _of_readings(self, message: Message, now_ns: int) -> Iterator[Ros2Message]:
        for tag, values in zip(message.data["tag"], message.data["values"]):
            sensors = self._sensors[self._controller_of.get(tag, 0)]
            for (name, word), numbers in zip(sensors, values):
                size = len(numbers)
                layout = {"dim": [{"label": name, "size": size, "stride": size}]}
                data = [float("nan") if n is None else float(n) for n in numbers]
                topic = f"/{namespace(tag)}/{word}"
                fields = {"layout": layout, "data": data}
                yield Ros2Message(topic, "std_msgs/Float64MultiArray", now_ns, fields)

    def _of_robots(self, message: Message, now_ns: int) -> Iterator[Ros2Message]:
        for tag, millivolts in zip(message.data["tag"], message.data["battery_mv"]):
            if millivolts:
                frame = f"{namespace(tag)}/base_link"
                fields = _header(now_ns, frame) | _BATTERY_UNKNOWN
                fields |= {"voltage": millivolts / 1e3, "present": True}
                topic = f"/{namespace(tag)}/battery"
                yield Ros2Message(topic, "sensor_msgs/BatteryState", now_ns, fields)

    def _of_picture(self, message: Message, now_ns: int) -> Iterator[Ros2Message]:
        camera = str(message.data["camera"])
        stamp_ns = int(message.data.get("capture_ns", message.time_ns)) + self._shift_ns
        fields = _header(stamp_ns, self._frame(camera))
        fields |= {"format": str(message.data["format"]), "data": message.blob}
        topic = f"/{self._word(camera)}/image/compressed"
        yield Ros2Message(topic, "sensor_msgs/CompressedImage", now_ns, fields)

    def _word(self, camera: str) -> str:
        return self._cameras.get(camera) or plain(camera)

    def _frame(self, camera: str) -> str:
        return f"{self._word(camera)}_optical"


def plain(name: str) -> str:
    """A name as topics and frames may have it."""
    word = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "unnamed"
    return f"_{word}" if word[0].isdigit() else word


def namespace(tag: int) -> str:
    """A robot's topics begin with it, and its frames."""
    return f"robot_{int(tag)}"


def distinct(names: Iterable[str], taken: Collection[str] = ()) -> dict[str, str]:
    """What topics say in place of each name, in their order: no two alike, none that is taken.

    Names that topics may have stay as they are.
    """
    stems = {name: "virtual_" * (plain(name) in taken) + plain(name) for name in names}
    found = dict[str, str]()
    for name in sorted(stems, key=lambda name: stems[name] != name):
        word, turns = stems[name], count(2)
        while word in found.values():
            word = f"{stems[name]}_{next(turns)}"
        found[name] = word
    return {name: found[name] for name in stems}


def yaw_quaternion(yaw_rad: float) -> Fields:
    """A turn about z, counter-clockwise."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2.0), "w": math.cos(yaw_rad / 2.0)}


def camera_info(camera: Camera) -> Fields:
    """Size and lens of a camera, without a header."""
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    return {
        "height": camera.height_px,
        "width": camera.width_px,
        "distortion_model": "plumb_bob",
        "d": list(camera.distortion),
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def _pose_of(camera: Camera) -> tuple[Fields, Fields]:
    """Where a camera is in the map, and how its axes lie there."""
    vector = cv2.Rodrigues(np.reshape(camera.rotation, (3, 3)).T)[0].ravel()
    angle = float(np.linalg.norm(vector))
    axis = vector * (math.sin(angle / 2.0) / angle if angle else 0.0)
    turn = dict(zip("xyzw", [*map(float, axis), math.cos(angle / 2.0)]))
    x, y, z = camera.position_m
    return _xyz(x, y, z), turn


def _xyz(x: float, y: float, z: float) -> Fields:
    return {"x": x, "y": y, "z": z}


def _header(time_ns: int, frame: str) -> Fields:
    sec, nanosec = divmod(max(time_ns, 0), 1_000_000_000)
    return {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}}


def _transform(time_ns: int, child: str, place: Fields, turn: Fields) -> Fields:
    moved = {"translation": place, "rotation": turn}
    return _header(time_ns, MAP) | {"child_frame_id": child, "transform": moved}


_PLAIN = {"string": "", "bool": False}
_ARRAYS = {"float64": np.float64, "float32": np.float32, "uint8": np.uint8}


def build(kinds: Mapping[str, Any], kind: str, fields: Fields, arrays: Callable[[Any], Any]) -> Any:
    """Makes an object of a library of its class in `kinds`, by names in `DEFINITIONS`.

    `arrays` makes what the library wants of a NumPy array of numbers.
    """
    values = []
    for field in DEFINITIONS[kind].split(", "):
        text, name = field.split(" ")
        inner, bracket, count = text.removesuffix("]").partition("[")
        given = fields.get(name)
        if inner in DEFINITIONS:
            parts = [build(kinds, inner, part, arrays) for part in _listed(given, bool(bracket))]
            values.append(parts if bracket else parts[0])
        elif bracket:
            kept = [0.0] * int(count or 0) if given is None else given
            numbers = np.frombuffer(kept, np.uint8) if isinstance(kept, bytes) else np.array(kept)
            values.append(arrays(numbers.astype(_ARRAYS[inner])))
        else:
            nothing = _PLAIN.get(inner, 0.0 if inner.startswith("float") else 0)
            values.append(nothing if given is None else given)
    return kinds[kind](*values)


def _listed(given: Any, is_list: bool) -> list[Fields]:
    return list(given or []) if is_list else [given or {}]


def dds_types() -> dict[str, Any]:
    """The messages' classes of cyclonedds, as ROS 2 maps them to DDS, by their names here."""
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl import types as idl

    made = dict[str, Any]()

    def field_type(text: str) -> Any:
        name, _, count = text.removesuffix("]").partition("[")
        own = {"string": str, "bool": bool}
        kind = own.get(name) or made.get(name) or getattr(idl, name)
        if name == text:
            return kind
        many: Any = idl.array if count else idl.sequence
        return many[kind, int(count)] if count else many[kind]

    for name, fields in DEFINITIONS.items():
        package, _, short = name.partition("/")
        pairs = [field.split() for field in fields.split(", ")]
        held = {"__annotations__": {word: field_type(kind) for kind, word in pairs}}
        typename = f"{package}::msg::dds_::{short}_"
        message: Any = type(IdlStruct)
        made[name] = dataclass(message(short, (IdlStruct,), held, typename=typename))
    return made
