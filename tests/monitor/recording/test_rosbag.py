"""A bag of ROS 2 is what two other libraries read, and its numbers are those worked out by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.monitor.recording.conftest import BEGIN_NS, picture, record
from tests.rigs.places import DATA
from vsense.base.arena import POSE, ArenaState
from vsense.base.message_bus import Message
from vsense.cli import main
from vsense.monitor.recording._rosbag import export_rosbag
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.ros2 import DEFINITIONS, Ros2Converter, distinct, plain
from vsense.vision.cameras.camera import Camera

mcap_ros2 = pytest.importorskip("mcap_ros2.reader", reason="pip install mcap-ros2-support")
rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="pip install vsense[rosbag]")

LENS = (-0.31, 0.12, 0.001, -0.002, 0.0)
DOWN = Camera.looking_down("cam 0", 0.5, -0.25, 2.5, 810.0, (640, 480), LENS)
"""Above (0.5, -0.25) m, straight down, +y up in the picture: half a turn about the map's x."""


def messages() -> list[Message]:
    robots = np.zeros(3, dtype=POSE)
    robots["tag"] = 23, 24, 25
    robots["x_m"], robots["y_m"] = (0.5, -1.0, 9.0), (0.25, 0.75, 9.0)
    # 90 degrees to the left, 120 to the right.
    robots["yaw_rad"] = math.pi / 2, -2.0 * math.pi / 3, 0.0
    robots["seen"] = True, True, False
    state = ArenaState(7, BEGIN_NS + 40, robots, 2)
    sensors = [{"name": "light", "count": 3}, {"name": "ground sensor", "count": 1}]
    battery = {"name": "battery", "count": 2}
    controllers = [
        {"id": "a", "tags": [23], "sensors": [*sensors, battery]},
        {"id": "b", "tags": [24], "sensors": sensors[1:]},
    ]
    experiment = {
        "controllers": controllers,
        "cameras": [{"id": "cam 0", "model": json.loads(DOWN.to_json())}],
    }
    readings = {
        "timestep": 7,
        "capture_ns": BEGIN_NS + 40,
        "tag": [23, 24],
        "values": [[[0.25, 0.5, 1.0], [0.125], [0.5, 60.0]], [[None]]],
        "captured_ns": [[1, 1, 1], [1]],
    }
    return [
        Message("/experiment", BEGIN_NS, experiment),
        Message("/arena", BEGIN_NS + 50, state.data()),
        Message("/readings", BEGIN_NS + 60, readings),
        Message("/robots", BEGIN_NS + 70, {"tag": [23, 24], "battery_mv": [3712, 0]}),
        Message("/event", BEGIN_NS + 80, {"text": "x", "level": "info"}),
    ]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """A bag, and UTC less the recording's clock [ns]."""
    folder = tmp_path_factory.mktemp("bag")
    path = record(folder / "run.mcap", messages(), [picture(100, "cam 0")])
    assert main(["export", str(path), "--rosbag", str(folder / "bag")]) == 0
    with open_recording(path) as recording:
        return folder / "bag", recording.utc_shift_ns


def by_rosbags(folder: Path) -> Iterator[tuple[str, str, int, Any]]:
    with rosbag2.Reader(folder) as reader:
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE)
        for connection, time_ns, data in reader.messages():
            kind = connection.msgtype
            yield connection.topic, kind, time_ns, store.deserialize_cdr(data, kind)


def by_mcap(folder: Path) -> Iterator[tuple[str, str, int, Any]]:
    (file,) = folder.glob("*.mcap")
    for found in mcap_ros2.read_ros2_messages(str(file)):
        yield found.channel.topic, found.schema.name, found.log_time_ns, found.ros_msg


def numbers(thing: Any, names: str) -> list[float]:
    return [float(getattr(thing, name)) for name in names]


HALF = math.sqrt(0.5)


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_both_readers_find_what_was_worked_out_by_hand(read: Any, bag: tuple[Path, int]) -> None:
    folder, shift_ns = bag
    found = {topic: (kind, at_ns, data) for topic, kind, at_ns, data in read(folder)}
    assert {topic: kind for topic, (kind, _, _) in found.items()} == {
        "/tf_static": "tf2_msgs/msg/TFMessage",
        "/cam_0/camera_info": "sensor_msgs/msg/CameraInfo",
        "/cam_0/image/compressed": "sensor_msgs/msg/CompressedImage",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/poses": "geometry_msgs/msg/PoseArray",
        "/robot_23/pose": "geometry_msgs/msg/PoseStamped",
        "/robot_24/pose": "geometry_msgs/msg/PoseStamped",
        "/robot_23/light": "std_msgs/msg/Float64MultiArray",
        "/robot_23/ground_sensor": "std_msgs/msg/Float64MultiArray",
        "/robot_24/ground_sensor": "std_msgs/msg/Float64MultiArray",
        "/robot_23/virtual_battery": "std_msgs/msg/Float64MultiArray",
        "/robot_23/battery": "sensor_msgs/msg/BatteryState",
    }
    data = {topic: message for topic, (_, _, message) in found.items()}
    first, second = data["/tf"].transforms
    assert (first.header.frame_id, first.child_frame_id) == ("map", "robot_23/base_link")
    stamp = first.header.stamp
    # The robots' poses are those of the capture, not of when it was told.
    assert stamp.sec * 10**9 + stamp.nanosec == BEGIN_NS + 40 + shift_ns
    assert found["/tf"][1] == BEGIN_NS + 50 + shift_ns
    assert numbers(first.transform.translation, "xyz") == [0.5, 0.25, 0.0]
    assert numbers(first.transform.rotation, "xyzw") == pytest.approx([0, 0, HALF, HALF])
    # Minus 120 degrees: sine and cosine of minus 60.
    turn = [0.0, 0.0, -math.sqrt(3.0) / 2.0, 0.5]
    assert numbers(second.transform.rotation, "xyzw") == pytest.approx(turn)
    pose = data["/robot_24/pose"]
    assert pose.header.frame_id == "map"
    assert numbers(pose.pose.position, "xyz") == [-1.0, 0.75, 0.0]
    assert numbers(pose.pose.orientation, "xyzw") == pytest.approx(turn)
    assert len(data["/poses"].poses) == 2, "the third is not seen"
    (camera,) = data["/tf_static"].transforms
    assert (camera.header.frame_id, camera.child_frame_id) == ("map", "cam_0_optical")
    assert numbers(camera.transform.translation, "xyz") == [0.5, -0.25, 2.5]
    turned = numbers(camera.transform.rotation, "xyzw")
    assert [abs(value) for value in turned] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-9)
    info = data["/cam_0/camera_info"]
    assert (info.width, info.height, info.distortion_model) == (640, 480, "plumb_bob")
    assert list(info.d) == list(LENS)
    assert list(info.k) == [810.0, 0.0, 319.5, 0.0, 810.0, 239.5, 0.0, 0.0, 1.0]
    assert list(info.p) == [810, 0, 319.5, 0, 0, 810, 239.5, 0, 0, 0, 1, 0]
    light = data["/robot_23/light"]
    assert list(light.data) == [0.25, 0.5, 1.0]
    assert [(dim.label, dim.size) for dim in light.layout.dim] == [("light", 3)]
    assert math.isnan(data["/robot_24/ground_sensor"].data[0]), "never measured"
    battery = data["/robot_23/battery"]
    assert battery.voltage == pytest.approx(3.712) and battery.present
    assert math.isnan(battery.percentage) and battery.header.frame_id == "robot_23/base_link"
    image = data["/cam_0/image/compressed"]
    assert image.header.frame_id == "cam_0_optical" and image.format in ("png", "jpeg")
    decoded = cv2.imdecode(np.frombuffer(bytes(image.data), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.array_equal(decoded, picture(100).image)


def test_a_point_of_the_floor_is_where_its_frames_and_lens_say(bag: tuple[Path, int]) -> None:
    """tf and camera_info together show robot 23 at the pixel where our camera shows it."""
    data = {topic: message for topic, _, _, message in by_rosbags(bag[0])}
    (camera,) = data["/tf_static"].transforms
    x, y, z, w = numbers(camera.transform.rotation, "xyzw")
    # The rotation matrix of a unit quaternion.
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    place = np.array(numbers(data["/robot_23/pose"].pose.position, "xyz"))
    seen = matrix.T @ (place - numbers(camera.transform.translation, "xyz"))
    info, still = data["/cam_0/camera_info"], np.zeros(3)
    pixel = cv2.projectPoints(seen[None], still, still, info.k.reshape(3, 3), info.d)[0].ravel()
    assert pixel == pytest.approx(DOWN.project(place), abs=1e-6)


def test_our_definitions_are_those_of_the_library() -> None:
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, fields in DEFINITIONS.items():
        theirs = [field for field, _ in store.fielddefs[name.replace("/", "/msg/")][1]]
        assert [text.split(" ")[1] for text in fields.split(", ")] == theirs, name


def test_a_recording_of_a_real_tracker(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = DATA / "made-by-0.1" / "tracked" / "small.mcap"
    words = ["export", str(file), "--rosbag", str(tmp_path / "bag")]
    assert main([*words, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    counts: dict[str, int] = {}
    for topic, *_ in by_mcap(tmp_path / "bag"):
        counts[topic] = counts.get(topic, 0) + 1
    assert counts == facts["topics"] and counts["/tf"] > 1 and counts["/tf_static"] == 1
    metadata = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert metadata.count("durability: transient_local") == 1 + sum("info" in t for t in counts)
    assert main(words) == 2
    assert "bag: is there already; expected a new folder" in capsys.readouterr().err
    for more in (["--foxglove", "a.mcap"], ["-o", "tables"]):
        assert main([*words, *more]) == 2
    assert "--output is the folder of tables: --rosbag" in capsys.readouterr().err


def test_damaged_messages_are_left_out() -> None:
    converter = Ros2Converter(0)
    for message in messages():
        for data in ({}, dict.fromkeys(message.data), {"cameras": [{}], "tag": [1]}):
            assert converter.convert(Message(message.topic, 1, data)) == []
    assert converter.convert(Message("/nothing", 1, {})) == []


def test_what_no_bag_holds_is_left_out(tmp_path: Path) -> None:
    one = {name: [0.1] for name in ("covariance", "x_m", "y_m", "yaw_rad", "speed_m_s")}
    one |= {"tag": [1], "covariance": [None], "seen": [True]}
    sent = [Message("/robots", 1, {"tag": [1], "battery_mv": [1e300]})]
    sent += [Message("/arena", 1, {"capture_ns": at, "robots": one}) for at in (1 << 62, 10**30)]
    with open_recording(record(tmp_path / "odd.mcap", sent)) as opened:
        assert export_rosbag(opened, tmp_path / "bag") == {}


@pytest.mark.parametrize(
    ("name", "expected"), [("cam 0", "cam_0"), ("7", "_7"), ("ä/b", "b"), ("", "unnamed")]
)
def test_names_of_topics(name: str, expected: str) -> None:
    assert plain(name) == expected


def test_names_that_become_alike_have_topics_of_their_own() -> None:
    cameras = [{"model": json.loads(DOWN.to_json()) | {"id": id}} for id in ("cam-1", "cam_1")]
    experiment = messages()[0].data | {"cameras": cameras}
    made = Ros2Converter(0).convert(Message("/experiment", 1, experiment))
    assert [m.topic for m in made[1:]] == ["/cam_1_2/camera_info", "/cam_1/camera_info"]
    assert made[0].fields["transforms"][0]["child_frame_id"] == "cam_1_2_optical"
    assert distinct(["pose", "virtual_pose"], ("pose",))["virtual_pose"] == "virtual_pose"
