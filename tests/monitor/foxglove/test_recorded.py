"""A recording's Foxglove channels, read by MCAP's own library, hold against its pictures."""

from __future__ import annotations

import base64
import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

from tests.monitor.foxglove import sdk, told
from tests.monitor.foxglove.told import turned
from tests.monitor.recording.scene import CAMERAS, FAMILY, HEIGHTS_M, STEP_NS, frames, robots
from tests.vision.tracking.synthetic import HEIGHT_M
from vsense.base.message_bus import Message, MessageBus
from vsense.cli import main
from vsense.monitor.foxglove import _layout, _schemas
from vsense.monitor.foxglove.channels import Channels, Derived
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording.reader import open_recording
from vsense.monitor.recording.writer import RecordingWriter
from vsense.monitor.ui.messages import cameras
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker

TIMESTEPS = 4


def experiment() -> dict[str, Any]:
    rows = [{"tag": t, "name": f"epuck{t}", "height_m": h} for t, h in HEIGHTS_M.items()]
    arena = {"size_m": [1.0, 0.5, 1.0], "centre_m": [0.0, 0.0, 0.5]}
    return {"robots": rows, "objects": [], "cameras": cameras(CAMERAS, {}), "arena": arena}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene's first timesteps, tracked and recorded with their pictures."""
    path = tmp_path_factory.mktemp("foxglove") / "run.mcap"
    bus = MessageBus()
    tracker = ArenaTracker.for_family(CAMERAS, load_family(FAMILY), HEIGHTS_M)
    recorder = Recorder(bus, path, pictures=True)
    bus.publish(Message("/experiment", 100 * STEP_NS, experiment()))
    for timestep in range(TIMESTEPS):
        shots = frames(timestep)
        recorder.pictures(shots)
        state = tracker.update(shots)
        bus.publish(Message("/arena", state.capture_ns, state.data()))
    recorder.close()
    tracker.close()
    return path


def contents(path: Path) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    """All messages by topic, and each topic's schema."""
    found, known = defaultdict(list), {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None and channel.message_encoding == "json"
            found[channel.topic].append((message.log_time, json.loads(message.data)))
            known[channel.topic] = schema
    return found, known


def test_what_is_recorded_is_the_sdks(recorded: Path) -> None:
    found, known = contents(recorded)
    for topic, schema in known.items():
        if schema.name.startswith("foxglove."):
            for _, data in found[topic]:
                data = {name: value for name, value in data.items() if name != "vsense"}
                assert sdk.make(sdk.KINDS[schema.name], data).encode()
            if schema.name != _schemas.IMAGE:  # with a field of our own
                title = json.loads(schema.data).pop("title")
                assert title == schema.name
    assert {s.name for s in known.values()} >= {
        *(_schemas.SCENE, _schemas.FRAMES, _schemas.POSES_SCHEMA, _schemas.ANNOTATIONS_SCHEMA),
        *(_schemas.CALIBRATION_SCHEMA, _schemas.IMAGE),
    }


def test_robots_in_space_are_those_in_the_pictures(recorded: Path) -> None:
    """By the schemas' documentation and OpenCV alone, from the file alone."""
    found, _ = contents(recorded)
    places = {one["child_frame_id"]: one for one in found["/tf_static"][0][1]["transforms"]}
    tf = {log: data["transforms"] for log, data in found["/tf"]}
    far: list[float] = []
    for camera in ("left", "right"):
        lens = found[f"/calibration/{camera}"][-1][1]
        place = places[lens["frame_id"]]
        centre = np.array([place["translation"][axis] for axis in "xyz"])
        axes = np.column_stack([turned(place["rotation"], axis) for axis in np.eye(3)])
        turn, _ = cv2.Rodrigues(axes.T)
        matrix, distortion = np.reshape(lens["K"], (3, 3)), np.array(lens["D"])
        pictures = found[f"/picture/{camera}"]
        assert {data["frame_id"] for _, data in pictures} == {lens["frame_id"]}
        image = cv2.imdecode(
            np.frombuffer(base64.b64decode(pictures[-1][1]["data"]), np.uint8), cv2.IMREAD_GRAYSCALE
        )
        assert image.shape == (lens["height"], lens["width"])
        for log, marks in found[f"/annotations/{camera}"]:
            tops = np.array([[*(t["translation"][a] for a in "xy"), HEIGHT_M] for t in tf[log]])
            seen, _ = cv2.projectPoints(tops, turn, -axes.T @ centre, matrix, distortion)
            # Annotations count from the corner of a pixel.
            circles = np.array([[c["position"]["x"], c["position"]["y"]] for c in marks["circles"]])
            distances = np.linalg.norm(circles[:, None] - (seen[:, 0] + 0.5)[None], axis=2)
            far += distances.min(axis=1).tolist()
    assert len(far) >= 2 * TIMESTEPS, "there were robots in the pictures"
    assert np.mean(far) < 1.0
    # The picture's truth: the renderer's places.
    last = tf[max(tf)]
    truth = {f"robot/{one.tag}": (one.x_m, one.y_m) for one in robots(TIMESTEPS - 1)}
    for one in last:
        x_m, y_m = truth[one["child_frame_id"]]
        assert (one["translation"]["x"], one["translation"]["y"]) == pytest.approx(
            (x_m, y_m), abs=2e-3
        )


def test_our_reader_passes_over_them(recorded: Path) -> None:
    with open_recording(recorded) as recording:
        topics = {message.topic for message in recording.messages()}
        assert topics == {"/experiment", "/arena", "/picture/left", "/picture/right"}
        assert recording.newest(None).keys() == topics and not recording.damaged


def test_an_old_recording_gets_them_anew(recorded: Path, tmp_path: Path) -> None:
    # As it was before there were these channels.
    old, new = tmp_path / "old.mcap", tmp_path / "new.mcap"
    with open_recording(recorded) as recording:
        writer = RecordingWriter(old, recording.begin_ns, recording.utc_shift_ns)
        for message in recording.messages():
            writer.add(message)
        writer.close()
    assert "/tf" not in contents(old)[0]
    assert main(["export", str(old), "--foxglove", str(new)]) == 0
    whole, _ = contents(recorded)
    again, _ = contents(new)
    assert again.keys() == whole.keys() and again["/tf"] == whole["/tf"]
    made = json.loads((tmp_path / "new-layout.json").read_text())
    assert made == _layout.layout(("left", "right"), (), 1.0)
    assert main(["export", str(old), "--foxglove", str(new)]) == 2, "nothing is written over"
    assert main(["export", str(old), "--foxglove", str(new), "-o", "x"]) == 2


def test_a_fault_in_it_ends_it_and_not_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(channels: Channels, message: Message) -> list[Derived]:
        raise ZeroDivisionError

    monkeypatch.setattr(Channels, "convert", fail)
    bus, said = MessageBus(), []
    bus.join(lambda message: said.append(message.data["text"]), lambda topic: topic == "/event")
    recorder = Recorder(bus, tmp_path / "run.mcap")
    for message in told.everything()[:4]:
        bus.publish(message)
    recorder.close()
    assert said == ["the recording goes on without what is for Foxglove: ZeroDivisionError()"]
    with open_recording(tmp_path / "run.mcap") as recording:
        assert {m.topic for m in recording.messages()} >= {"/experiment", "/world", "/arena"}
