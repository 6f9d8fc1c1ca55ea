"""The schemas of Foxglove that we write, field by field, as JSON schemas.

Source: Foxglove's documentation of its message schemas, https://docs.foxglove.dev/docs/sdk/schemas;
tests hold them against the definitions in its SDK. Lengths are in m, times as seconds and
nanoseconds of UTC, colours and their opacity from 0 to 1.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import Any

JsonSchema = dict[str, Any]


def _object(*optional: str, **properties: JsonSchema) -> JsonSchema:
    """An object that has all `properties`; those named in `optional` may be missing."""
    required = [name for name in properties if name not in optional]
    return {"type": "object", "properties": properties, "required": required}


def _list(items: JsonSchema, count: int | None = None) -> JsonSchema:
    """A list; of `count` items, where it is given."""
    bounds = {} if count is None else {"minItems": count, "maxItems": count}
    return {"type": "array", "items": items, **bounds}


def _one_of(*numbers: int) -> JsonSchema:
    return {"oneOf": [{"const": number} for number in numbers]}


_NUMBER, _TEXT, _YES = ({"type": name} for name in ("number", "string", "boolean"))
_UNSIGNED = {"type": "integer", "minimum": 0}
_NSEC = {**_UNSIGNED, "maximum": 999_999_999}
_BYTES = {"type": "string", "contentEncoding": "base64"}
_TIME: JsonSchema = {"type": "object", "properties": {"sec": _UNSIGNED, "nsec": _NSEC}}
_SPAN: JsonSchema = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": _NSEC}}
_XY = _object(x=_NUMBER, y=_NUMBER)
_XYZ = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_TURN = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object(position=_XYZ, orientation=_TURN)
_COLOR = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_PAIRS = _list(_object(key=_TEXT, value=_TEXT))

_ARROW = _object(
    pose=_POSE, shaft_length=_NUMBER, shaft_diameter=_NUMBER, head_length=_NUMBER,
    head_diameter=_NUMBER, color=_COLOR,
)  # fmt: skip
_SOLID = _object(pose=_POSE, size=_XYZ, color=_COLOR)
_CYLINDER = _object(
    pose=_POSE, size=_XYZ, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOR
)  # fmt: skip
_LINE = _object(
    type=_one_of(0, 1, 2), pose=_POSE, thickness=_NUMBER, scale_invariant=_YES,
    points=_list(_XYZ), color=_COLOR, colors=_list(_COLOR), indices=_list(_UNSIGNED),
)  # fmt: skip
_TRIANGLES = _object(
    pose=_POSE, points=_list(_XYZ), color=_COLOR, colors=_list(_COLOR), indices=_list(_UNSIGNED)
)
_LABEL = _object(
    pose=_POSE, billboard=_YES, font_size=_NUMBER, scale_invariant=_YES, color=_COLOR, text=_TEXT
)
_MODEL = _object(
    pose=_POSE, scale=_XYZ, color=_COLOR, override_color=_YES, url=_TEXT, media_type=_TEXT,
    data=_BYTES,
)  # fmt: skip
_ENTITY = _object(
    timestamp=_TIME, frame_id=_TEXT, id=_TEXT, lifetime=_SPAN, frame_locked=_YES, metadata=_PAIRS,
    arrows=_list(_ARROW), cubes=_list(_SOLID), spheres=_list(_SOLID), cylinders=_list(_CYLINDER),
    lines=_list(_LINE), triangles=_list(_TRIANGLES), texts=_list(_LABEL), models=_list(_MODEL),
)  # fmt: skip
_DELETION = _object(timestamp=_TIME, type=_one_of(0, 1), id=_TEXT)
_TRANSFORM = _object(
    timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_XYZ, rotation=_TURN
)
_CIRCLE = _object(
    "metadata", timestamp=_TIME, position=_XY, diameter=_NUMBER, thickness=_NUMBER,
    fill_color=_COLOR, outline_color=_COLOR, metadata=_PAIRS,
)  # fmt: skip
_POINTS = _object(
    "metadata", timestamp=_TIME, type=_one_of(0, 1, 2, 3, 4), points=_list(_XY),
    outline_color=_COLOR, outline_colors=_list(_COLOR), fill_color=_COLOR, thickness=_NUMBER,
    metadata=_PAIRS,
)  # fmt: skip
_NOTE = _object(
    "metadata", timestamp=_TIME, position=_XY, text=_TEXT, font_size=_NUMBER, text_color=_COLOR,
    background_color=_COLOR, metadata=_PAIRS,
)  # fmt: skip
_CELL = _object(name=_TEXT, offset=_UNSIGNED, type=_one_of(*range(9)))

SCENE, FRAMES = "foxglove.SceneUpdate", "foxglove.FrameTransforms"
ANNOTATIONS_SCHEMA, CALIBRATION_SCHEMA = "foxglove.ImageAnnotations", "foxglove.CameraCalibration"
POSES_SCHEMA, MEASURES_SCHEMA = "foxglove.PosesInFrame", "vsense.measures"
"""Our own, as plots take it: a curve for each label, whatever an experiment measures."""
IMAGE, GRID_SCHEMA, LOG_SCHEMA = "foxglove.CompressedImage", "foxglove.Grid", "foxglove.Log"

SCHEMAS: Mapping[str, JsonSchema] = {
    SCENE: _object(deletions=_list(_DELETION), entities=_list(_ENTITY)),
    FRAMES: _object(transforms=_list(_TRANSFORM)),
    POSES_SCHEMA: _object(timestamp=_TIME, frame_id=_TEXT, poses=_list(_POSE)),
    ANNOTATIONS_SCHEMA: _object(
        "timestamp", "metadata", timestamp=_TIME, circles=_list(_CIRCLE), points=_list(_POINTS),
        texts=_list(_NOTE), metadata=_PAIRS,
    ),
    CALIBRATION_SCHEMA: _object(
        timestamp=_TIME, frame_id=_TEXT, width=_UNSIGNED, height=_UNSIGNED, distortion_model=_TEXT,
        D=_list(_NUMBER), K=_list(_NUMBER, 9), R=_list(_NUMBER, 9), P=_list(_NUMBER, 12),
    ),
    IMAGE: _object(timestamp=_TIME, frame_id=_TEXT, data=_BYTES, format=_TEXT),
    GRID_SCHEMA: _object(
        timestamp=_TIME, frame_id=_TEXT, pose=_POSE, column_count=_UNSIGNED, cell_size=_XY,
        row_stride=_UNSIGNED, cell_stride=_UNSIGNED, fields=_list(_CELL), data=_BYTES,
    ),
    LOG_SCHEMA: _object(
        timestamp=_TIME, level=_one_of(*range(6)), message=_TEXT, name=_TEXT, file=_TEXT,
        line=_UNSIGNED,
    ),
    MEASURES_SCHEMA: _object(values=_list(_object(label=_TEXT, value=_NUMBER))),
}  # fmt: skip
"""What a message of each schema holds, by the schema's name."""


@cache
def text(name: str) -> bytes:
    """A schema of `SCHEMAS` as it goes into a file."""
    return json.dumps({"title": name, **SCHEMAS[name]}).encode()
