"""A layout for Foxglove: the arena in 3-D, the cameras with what is seen in them, measures, log.

Its form is that of Foxglove's layouts of version 1; tests hold it against the classes that its SDK
has for them. `foxglove-layout.json` is that of the lab's four cameras, as
`python -m vsense.monitor.foxglove._layout` prints it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

from vsense.monitor.foxglove import _schemas, channels
from vsense.monitor.foxglove._shapes import ARENA_FRAME, Json

LAB_CAMERAS = ("cam_0_0", "cam_0_1", "cam_1_0", "cam_1_1")
"""Of `vsense lab`, unless a camera file says otherwise."""
LAB_FIELDS = ("scent", "trail")
"""Fields of the shipped experiments."""

_VISIBLE = {"visible": True}
_CLEAR, _STRONG = "#ff7b0000", "#ff7b00cc"
"""From nothing of a field to the most of it: the same colour, ever less transparent."""


def layout(
    cameras: Sequence[str] = LAB_CAMERAS,
    fields: Sequence[str] = LAB_FIELDS,
    size_m: float = 3.0,
) -> Json:
    """A layout for cameras and fields by their ids, and for an arena's longer side."""
    right = [_item(3, _pictures(cameras))] if cameras else []
    columns = [
        _item(3, _split("column", [_item(3, _arena(cameras, fields, size_m)), _item(1, _log())])),
        _item(2, _split("column", [*right, _item(2, _plots())])),
    ]
    return {"version": 1, "content": _split("row", columns)}


def as_text(data: Json) -> str:
    """A layout as the text of its file."""
    return json.dumps(data, indent=2) + "\n"


def _item(proportion: float, content: Json) -> Json:
    return {"proportion": proportion, "content": content}


def _split(direction: str, items: list[Json]) -> Json:
    return {"type": "split", "direction": direction, "items": items}


def _panel(kind: str, title: str, config: Json) -> Json:
    return {"type": "panel", "panelType": kind, "config": config, "title": title, "version": 1}


def _scene(fields: Sequence[str]) -> Json:
    """The topics that stand in the arena."""
    grid = {"colorMode": "gradient", "colorField": "level", "gradient": [_CLEAR, _STRONG]}
    return {
        **{
            topic: dict(_VISIBLE)
            for topic in (channels.WORLD, channels.ROBOTS_TOPIC, channels.LED_TOPIC, channels.CONES)
        },
        channels.FLOOR_MAP: {**_VISIBLE, "colorMode": "rgba-fields"},
        **{
            f"{channels.FIELD_TOPIC}{field}": {**_VISIBLE, **grid, "minValue": 0, "maxValue": 255}
            for field in fields
        },
    }


def _arena(cameras: Sequence[str], fields: Sequence[str], size_m: float) -> Json:
    lenses = {f"{channels.CALIBRATION_TOPIC}{camera}": {"visible": False} for camera in cameras}
    poses = {channels.POSES: {"visible": False, "type": "arrow"}}
    view = {
        "distance": round(1.5 * size_m, 2),
        "perspective": True,
        "phi": 35,
        "thetaOffset": 0,
        "target": [0, 0, 0],
        "targetOffset": [0, 0, 0],
        "targetOrientation": [0, 0, 0, 1],
        "fovy": 45,
        "near": 0.01,
        "far": round(100.0 * math.ceil(size_m / 10.0)),
    }
    config = {
        "cameraState": view,
        "followMode": "follow-none",
        "followTf": ARENA_FRAME,
        "fixedFrame": ARENA_FRAME,
        "scene": {"transforms": {"visible": False}},
        "topics": {**_scene(fields), **poses, **lenses},
    }
    return _panel("ThreeDee", "arena", config)


def _pictures(cameras: Sequence[str]) -> Json:
    """The cameras' panels: up to four side by side, more of them as tabs."""
    panels = [_picture(camera) for camera in cameras]
    if len(panels) == 1:
        return panels[0]
    if len(panels) > 4:
        tabs = [{"title": name, "content": panel} for name, panel in zip(cameras, panels)]
        return {"type": "tabs", "selectedTabIndex": 0, "tabs": tabs}
    rows = [panels[at : at + 2] for at in range(0, len(panels), 2)]
    return _split("column", [_item(1, _split("row", [_item(1, p) for p in row])) for row in rows])


def _picture(camera: str) -> Json:
    mode = {
        "imageTopic": f"{channels.PICTURE}{camera}",
        "imageSchemaName": _schemas.IMAGE,
        "calibrationTopic": f"{channels.CALIBRATION_TOPIC}{camera}",
        "annotations": {f"{channels.ANNOTATIONS}{camera}": dict(_VISIBLE)},
    }
    # What is only virtual, over the picture: the robots themselves are in it.
    over = {topic: dict(_VISIBLE) for topic in (channels.WORLD, channels.CONES)}
    return _panel("Image", camera, {"imageMode": mode, "topics": over})


def _plots() -> Json:
    measures = {
        "value": f"{channels.MEASURES_TOPIC}.values",
        "enabled": True,
        "timestampMethod": "receiveTime",
        "dynamicLabelField": "label",
        "dynamicValueField": "value",
    }
    latency = [
        {"value": f"/run.latency_ms.{name}", "enabled": True, "label": f"{name} [ms]"}
        | {"timestampMethod": "receiveTime"}
        for name in ("p50", "p99")
    ]
    first = _panel("Plot", "measures", {"paths": [measures]} | _TIME_AXIS)
    second = _panel("Plot", "capture to end of timestep", {"paths": latency} | _TIME_AXIS)
    return _split("column", [_item(1, first), _item(1, second)])


_TIME_AXIS = {"xAxisVal": "timestamp"}


def _log() -> Json:
    return _panel("Log", "log", {"topicToRender": channels.LOG_TOPIC, "minLogLevel": 1})


if __name__ == "__main__":
    print(as_text(layout()), end="")
