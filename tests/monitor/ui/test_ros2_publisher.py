"""What ROS 2 hears of a run, by a peer that is made of the public message definitions.

The peer's classes are written here by hand, beside those that vsense makes of a table. cyclonedds
wants annotations that are types: no module of it may defer them.
"""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="pip install vsense[ros2]")

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from tests.rigs.places import DATA, ROOT
from vsense.base.arena import POSE, ArenaState
from vsense.base.clock import host_ns
from vsense.base.message_bus import Message, MessageBus
from vsense.base.terminal import Console
from vsense.monitor.ros2 import LATCHED
from vsense.monitor.ui._ros2_publisher import Ros2Error, Ros2Publisher
from vsense.vision.cameras.camera import Camera

DOMAIN = 73
PATIENCE_S = 30.0


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class Dimension(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"):
    label: str
    size: uint32
    stride: uint32


@dataclass
class Layout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    dim: sequence[Dimension]
    data_offset: uint32


@dataclass
class Floats(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    layout: Layout
    data: sequence[float64]


RELIABLE = Qos(Policy.Reliability.Reliable(10**8), Policy.History.KeepLast(10))
LASTING = Qos(
    Policy.Reliability.Reliable(10**8),
    Policy.History.KeepLast(1),
    Policy.Durability.TransientLocal,
)
OWN_NETWORK = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface name="lo" /></Interfaces><AllowMulticast>false</AllowMulticast>
</General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>119</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1" /></Peers></Discovery></Domain></CycloneDDS>
"""


@pytest.fixture
def peer(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[str, Any], DataReader]]:
    """Makes readers of ROS 2's topics, on this machine's own network."""
    network = tmp_path_factory.mktemp("network") / "own.xml"
    network.write_text(OWN_NETWORK)
    monkeypatch.setenv("CYCLONEDDS_URI", network.as_uri())
    domain = DomainParticipant(DOMAIN)

    def read(topic: str, kind: Any) -> DataReader:
        qos = LASTING if topic.endswith(LATCHED) else RELIABLE
        return DataReader(domain, Topic(domain, f"rt{topic}", kind), qos=qos)

    yield read


def wait_for(reader: DataReader, each: Callable[[], object]) -> Any:
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        each()
        for found in reader.take(10):
            return found
        time.sleep(0.05)
    raise AssertionError("nothing was heard")


CAMERA = Camera.looking_down("cam1", 0.5, -0.25, 2.5, 810.0, (640, 480))


def experiment() -> Message:
    sensors = [{"name": "light", "count": 2}]
    data = {
        "controllers": [{"id": "a", "tags": [23], "sensors": sensors}],
        "cameras": [{"id": "cam1", "model": {**vars_of(CAMERA)}}],
    }
    return Message("/experiment", host_ns(), data)


def vars_of(camera: Camera) -> dict[str, Any]:
    import json

    return dict(json.loads(camera.to_json()))


def arena() -> Message:
    robots = np.zeros(1, dtype=POSE)
    robots["tag"], robots["x_m"], robots["y_m"] = 23, 0.5, 0.25
    robots["yaw_rad"], robots["seen"] = math.pi / 2, True
    now_ns = host_ns()
    return Message("/arena", now_ns, ArenaState(7, now_ns, robots, 1).data())


def readings() -> Message:
    data = {"tag": [23], "values": [[[0.25, 0.5]]], "timestep": 7, "capture_ns": 1}
    return Message("/readings", host_ns(), data)


def test_a_peer_hears_frames_poses_and_readings(peer: Callable[[str, Any], DataReader]) -> None:
    bus, said = MessageBus(), list[str]()
    console = Console()
    publisher = Ros2Publisher(bus, DOMAIN, console)
    publisher.start()
    try:
        assert bus.wants("/arena") and not bus.wants("/picture/cam1")

        def publish() -> None:
            for message in (experiment(), arena(), readings()):
                bus.publish(message)

        half = math.sqrt(0.5)
        moved = wait_for(peer("/tf", TFMessage), publish).transforms[0]
        assert (moved.header.frame_id, moved.child_frame_id) == ("map", "robot_23/base_link")
        turn = moved.transform.rotation
        assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.0, 0.0, half, half))
        told_s = moved.header.stamp.sec + moved.header.stamp.nanosec / 1e9
        assert abs(time.time() - told_s) < PATIENCE_S, "UTC, as every node of ROS 2 has it"
        pose = wait_for(peer("/robot_23/pose", PoseStamped), publish)
        assert pose.header.frame_id == "map"
        assert (pose.pose.position.x, pose.pose.position.y) == (0.5, 0.25)
        light = wait_for(peer("/robot_23/light", Floats), publish)
        assert light.data == [0.25, 0.5] and light.layout.dim[0].label == "light"
        # Who comes later hears of the cameras without another message.
        camera = wait_for(peer("/tf_static", TFMessage), lambda: None).transforms[0]
        assert camera.child_frame_id == "cam1_optical"
        assert camera.transform.translation == Vector3(0.5, -0.25, 2.5)
    finally:
        publisher.close()
    assert not bus.wants("/arena") and said == []


def test_a_run_goes_on_where_the_process_that_publishes_is_killed(
    peer: Callable[[str, Any], DataReader], capsys: pytest.CaptureFixture[str]
) -> None:
    bus = MessageBus()
    publisher = Ros2Publisher(bus, DOMAIN, Console())
    publisher.start()
    publisher._process._process.kill()
    end_s = time.monotonic() + PATIENCE_S
    while bus.wants("/arena") and time.monotonic() < end_s:
        time.sleep(0.05)
    bus.publish(arena())
    publisher.close()
    told = capsys.readouterr().err
    assert told.count("ROS 2: nothing is published any more, and the run goes on") == 1


def test_what_dds_refuses_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, peer: Callable[[str, Any], DataReader]
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain><Nonsense/></Domain></CycloneDDS>")
    with pytest.raises(Ros2Error, match=f"--ros2: domain {DOMAIN}: "):
        Ros2Publisher(MessageBus(), DOMAIN, Console()).start()


@pytest.mark.parametrize(
    ("words", "domain", "said"),
    [
        (["--ros2", "233"], "", "'233': expected a domain from 0 to 232"),
        (["--ros2"], "x", "ROS_DOMAIN_ID: 'x': expected a domain from 0 to 232"),
    ],
)
def test_a_domain_is_a_number(words: list[str], domain: str, said: str) -> None:
    command = [sys.executable, "-m", "vsense", "replay", "x.mcap", *words]
    environment = {**os.environ, "ROS_DOMAIN_ID": domain, "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    assert ran.returncode == 2 and said in ran.stderr


def test_a_replay_is_heard(peer: Callable[[str, Any], DataReader], tmp_path: Path) -> None:
    """The command, with a recording of a real tracker; times are those of the recording."""
    file = DATA / "made-by-0.1" / "tracked" / "small.mcap"
    command = [sys.executable, "-m", "vsense", "replay", str(file), "--web", "0"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [*command, "--ros2", "--speed", "0.1"],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as program:
        try:
            heard = wait_for(peer("/tf", TFMessage), lambda: None)
        finally:
            program.send_signal(signal.SIGINT)
            said = program.communicate(timeout=PATIENCE_S)[1]
    assert program.returncode == 130 and f"readings in domain {DOMAIN}" in said
    first = heard.transforms[0]
    assert first.child_frame_id.startswith("robot_") and first.header.frame_id == "map"
