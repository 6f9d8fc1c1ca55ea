"""Foxglove's own definitions, from its SDK: what each message has, and a message made of them."""

from __future__ import annotations

import base64
import inspect
from typing import Any

from foxglove import messages

KINDS: dict[str, Any] = {
    "foxglove.SceneUpdate": messages.SceneUpdate,
    "foxglove.FrameTransforms": messages.FrameTransforms,
    "foxglove.PosesInFrame": messages.PosesInFrame,
    "foxglove.ImageAnnotations": messages.ImageAnnotations,
    "foxglove.CameraCalibration": messages.CameraCalibration,
    "foxglove.CompressedImage": messages.CompressedImage,
    "foxglove.Grid": messages.Grid,
    "foxglove.Log": messages.Log,
}

_FIELDS: dict[str, Any] = {
    "timestamp": messages.Timestamp, "lifetime": messages.Duration,
    "deletions": messages.SceneEntityDeletion, "entities": messages.SceneEntity,
    "metadata": messages.KeyValuePair, "arrows": messages.ArrowPrimitive,
    "cubes": messages.CubePrimitive, "spheres": messages.SpherePrimitive,
    "cylinders": messages.CylinderPrimitive, "lines": messages.LinePrimitive,
    "triangles": messages.TriangleListPrimitive, "models": messages.ModelPrimitive,
    "transforms": messages.FrameTransform, "translation": messages.Vector3,
    "rotation": messages.Quaternion, "poses": messages.Pose, "pose": messages.Pose,
    "orientation": messages.Quaternion, "size": messages.Vector3, "scale": messages.Vector3,
    "cell_size": messages.Vector2, "circles": messages.CircleAnnotation,
    "fields": messages.PackedElementField,
}  # fmt: skip
_COLORS = ("color", "colors", "fill_color", "outline_color", "outline_colors", "text_color",
           "background_color")  # fmt: skip
_TYPES: dict[Any, Any] = {
    messages.SceneEntityDeletion: messages.SceneEntityDeletionType,
    messages.LinePrimitive: messages.LinePrimitiveLineType,
    messages.PointsAnnotation: messages.PointsAnnotationType,
    messages.PackedElementField: messages.PackedElementFieldNumericType,
}


def kind_of(name: str, owner: Any) -> Any:
    """What the SDK has for a field `name` of `owner`; None: a number, text or bytes."""
    flat = owner in (messages.CircleAnnotation, messages.TextAnnotation, messages.PointsAnnotation)
    if name in _COLORS:
        return messages.Color
    if name == "texts":
        return (
            messages.TextAnnotation
            if owner is messages.ImageAnnotations
            else messages.TextPrimitive
        )
    if name == "points" and owner is messages.ImageAnnotations:
        return messages.PointsAnnotation
    if owner is messages.Pose and name == "position":
        return messages.Vector3
    if name in ("points", "position"):
        return messages.Point2 if flat else messages.Point3
    return _FIELDS.get(name)


def names_of(kind: Any) -> set[str]:
    """The fields that a class of the SDK has."""
    return set(inspect.signature(kind).parameters)


def make(kind: Any, data: dict[str, Any]) -> Any:
    """Makes the SDK's message of ours; TypeError: a field that it has not, or of another type."""
    return kind(**{name: _value(name, kind, value) for name, value in data.items()})


def _value(name: str, owner: Any, value: Any) -> Any:
    if name == "type":
        return _member(_TYPES[owner], value)
    if name == "level":
        return _member(messages.LogLevel, value)
    if name == "data":
        return base64.b64decode(value, validate=True)
    kind = kind_of(name, owner)
    if kind is None:
        return value
    return [make(kind, one) for one in value] if isinstance(value, list) else make(kind, value)


def _member(kind: Any, number: int) -> Any:
    members = (getattr(kind, name) for name in dir(kind) if name[0].isupper())
    return next(member for member in members if int(member) == number)
