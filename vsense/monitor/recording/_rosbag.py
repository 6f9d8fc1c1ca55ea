"""A recording as a bag of ROS 2: an MCAP file with standard messages, and its metadata.yaml."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vsense.base.errors import failing_as, require
from vsense.base.message_bus import DAMAGED
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.monitor.ros2 import DEFINITIONS, LATCHED, Ros2Converter, Ros2Message, build


def export_rosbag(recording: Recording, folder: Path) -> dict[str, int]:
    """Writes a recording as a bag; gives how many messages each topic has.

    Damaged messages are left out.

    Raises:
        UsageError: the package rosbags is missing.
        RecordingError: the folder is there already, or cannot be written.
    """
    require("bags of ROS 2 need", "rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    if os.path.exists(folder):
        raise RecordingError(f"{folder}: is there already; expected a new folder")
    store = get_typestore(Stores.ROS2_HUMBLE)
    connections, counts = dict[str, Any](), dict[str, int]()
    try:
        with (
            failing_as(RecordingError, f"{folder}: cannot be written"),
            Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag,
        ):
            for found, data in _serialized(recording, store):
                if found.topic not in connections:
                    qos = _latched() if found.topic.endswith(LATCHED) else []
                    connections[found.topic] = bag.add_connection(
                        found.topic, _full(found.kind), typestore=store, offered_qos_profiles=qos
                    )
                bag.write(connections[found.topic], max(found.time_ns, 0), data)
                counts[found.topic] = counts.get(found.topic, 0) + 1
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return counts


def _serialized(recording: Recording, store: Any) -> Iterator[tuple[Ros2Message, Any]]:
    kinds = {name: store.types[_full(name)] for name in DEFINITIONS}
    converter = Ros2Converter(recording.utc_shift_ns)
    for message in recording.messages():
        for found in converter.convert(message):
            try:
                made = build(kinds, found.kind, found.fields, lambda numbers: numbers)
                data = store.serialize_cdr(made, _full(found.kind))
            except DAMAGED:
                continue
            yield found, data


def _full(name: str) -> str:
    """A kind of message as ROS 2 names it: "geometry_msgs/msg/Pose"."""
    return name.replace("/", "/msg/")


def _latched() -> list[Any]:
    """What has a player send the newest message to those that come later."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never, kept = QosTime(0, 0), QosHistory.KEEP_LAST
    lasting, all_of_it = QosDurability.TRANSIENT_LOCAL, QosReliability.RELIABLE
    automatic = QosLiveliness.AUTOMATIC
    return [Qos(kept, 1, all_of_it, lasting, never, never, automatic, never, False)]
