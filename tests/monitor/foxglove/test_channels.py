"""What Foxglove is told of a run: by its own definitions, and at the right places."""

from __future__ import annotations

import base64
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.monitor.foxglove import sdk, told
from tests.monitor.foxglove.told import AT_NS, CAMERA, SHIFT_NS, VIRTUAL, converted, turned
from vsense.base.message_bus import Message
from vsense.monitor.foxglove import _schemas, _shapes
from vsense.monitor.foxglove.channels import Channels, sources_of


def named(scene: dict[str, Any]) -> dict[str, Any]:
    return {one["id"]: one for one in scene["entities"]}


def test_our_schemas_are_those_of_the_sdk() -> None:
    compared = 0

    def compare(schema: dict[str, Any], kind: Any) -> None:
        nonlocal compared
        assert set(schema["properties"]) == sdk.names_of(kind), kind
        for name, inner in schema["properties"].items():
            inner = inner.get("items", inner)
            own = sdk.kind_of(name, kind)
            assert (own is not None) == (inner.get("type") == "object"), (kind, name)
            compared += 1
            if own is not None:
                compare(inner, own)

    for name, kind in sdk.KINDS.items():
        compare(_schemas.SCHEMAS[name], kind)
    assert compared > 300


def test_every_message_is_one_of_the_sdk() -> None:
    channels = Channels(SHIFT_NS)
    made = [one for message in told.everything() for one in channels.convert(message)]
    kinds = {one.schema for one in made}
    assert kinds == set(_schemas.SCHEMAS) - {_schemas.IMAGE}
    for one in made:
        assert one.time_ns == AT_NS
        if one.schema in sdk.KINDS:
            assert sdk.make(sdk.KINDS[one.schema], one.data).encode(), one.topic
    stamps = {"sec": 1_700_000_007, "nsec": 123_456_789}
    assert converted(told.everything())["/poses"]["timestamp"] == stamps


def test_robots_move_with_their_frames() -> None:
    made = converted(told.everything())
    frames = {one["child_frame_id"]: one for one in made["/tf"]["transforms"]}
    assert frames.keys() == {"robot/3", "robot/14", "robot/22", f"robot/{VIRTUAL}"}
    one = frames["robot/14"]
    assert one["parent_frame_id"] == "arena"
    assert one["translation"] == {"x": -0.1, "y": 0.4, "z": 0.0}
    ahead = turned(one["rotation"], [1.0, 0.0, 0.0])
    assert ahead == pytest.approx([math.cos(-3.0), math.sin(-3.0), 0.0], abs=1e-8)
    assert len(made["/poses"]["poses"]) == 3
    robots = named(made["/scene/robots"])
    assert {one["frame_id"] for one in robots.values()} == {"robot/3", "robot/14", "robot/22"}
    assert robots["robot 3"]["frame_locked"] and robots["robot 22"]["texts"][0]["text"] == "stone"
    alive, lost = (robots[f"robot {tag}"]["cylinders"][0]["color"]["a"] for tag in (3, 14))
    assert alive == 1.0 and lost < 1.0


def test_a_scene_that_does_not_change_is_told_once() -> None:
    channels = Channels(SHIFT_NS)
    converted(told.everything(), channels)
    again = [Message("/arena", AT_NS + 100, told.arena())]
    assert "/scene/robots" not in converted(again, channels)
    gone = told.arena()
    for column in gone["robots"].values():
        column.pop()
    after = converted([Message("/arena", AT_NS + 200, gone)], channels)["/scene/robots"]
    # Whole: everything older goes, and only what is still there comes.
    assert after["deletions"][0]["type"] == 1 and named(after).keys() == {"robot 3", "robot 14"}
    channels.forget()
    assert "/scene/robots" in converted([Message("/arena", AT_NS + 300, gone)], channels)


def test_things_stand_where_they_are() -> None:
    things = named(converted(told.everything())["/scene/world"])
    wall = things["wall"]["cubes"][0]
    assert wall["pose"]["position"] == {"x": 1.0, "y": 0.5, "z": 0.05}
    assert wall["size"] == {"x": 0.4, "y": 0.02, "z": 0.1} and wall["color"]["a"] == 1.0
    along = turned(wall["pose"]["orientation"], [1.0, 0.0, 0.0])
    assert along == pytest.approx([math.cos(0.5), math.sin(0.5), 0.0], abs=1e-8)
    led = things["wall"]["spheres"][0]["pose"]["position"]
    assert (led["x"], led["y"]) == pytest.approx((1.0 + 0.2 * along[0], 0.5 + 0.2 * along[1]))
    pillar = things["pillar"]["cylinders"][0]
    assert pillar["pose"]["position"]["z"] == 0.15 and pillar["size"]["x"] == 0.2
    assert pillar["color"]["a"] < 1.0, "it is only sensed"
    assert things["lamp"]["spheres"][0]["color"] == {"r": 1.0, "g": 1.0, "b": 0.0, "a": 1.0}
    corners = [(p["x"], p["y"]) for p in things["arena"]["lines"][0]["points"]]
    assert set(corners) == {(-1.25, -1.0), (1.75, -1.0), (1.75, 1.0), (-1.25, 1.0)}


def test_leds_cones_measures_and_lines() -> None:
    made = converted(told.everything())
    leds = named(made["/scene/leds"])
    assert leds.keys() == {"LEDs of 3", "LEDs of 14", f"LEDs of {VIRTUAL}"}
    front, right = (ball["pose"]["position"] for ball in leds["LEDs of 3"]["spheres"][:2])
    assert front["x"] > 0.0 and front["y"] == 0.0, "bit 0 is the front"
    assert right["y"] < 0.0 and abs(right["x"]) < 1e-6, "bit 2 is a quarter clockwise"
    assert len(leds["LEDs of 3"]["spheres"]) == 4
    cone = made["/scene/cones"]["entities"][0]
    assert (cone["lines"][0]["type"], len(cone["lines"][0]["points"])) == (1, 4)
    corners = np.array([[p["x"], p["y"]] for p in cone["triangles"][0]["points"]]).reshape(-1, 3, 2)
    areas = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 2.0
    assert areas.sum() == pytest.approx(0.5), "a square of 0.5 m2, whole and once"
    assert made["/measures"]["values"] == [
        {"label": "robots_in_cone", "value": 2},
        {"label": "light_m", "value": 0.5},
    ]
    # The gap came last; 3 is a warning.
    assert (made["/log"]["level"], made["/log"]["message"]) == (3, "not whole: the disk")


def cell(grid: dict[str, Any], x_m: float, y_m: float) -> list[int]:
    """The bytes of the cell of a grid at a place, as the schema says."""
    corner, size = grid["pose"]["position"], grid["cell_size"]
    column = int((x_m - corner["x"]) // size["x"])
    row = int((y_m - corner["y"]) // size["y"])
    begin = row * grid["row_stride"] + column * grid["cell_stride"]
    data = base64.b64decode(grid["data"])
    assert len(data) % grid["row_stride"] == 0 and grid["column_count"] == 3
    return list(data[begin : begin + grid["cell_stride"]])


def test_grids() -> None:
    made = converted(told.everything())
    field, floor = made["/field/scent"], made["/floor"]
    # Lowest y first: level 5 is the highest x and y.
    assert cell(field, -0.95, -0.45) == [0] and cell(field, -0.75, -0.35) == [5]
    assert [one["name"] for one in field["fields"]] == ["level"]
    # The picture's upper left pixel is at low x and high y.
    assert cell(floor, -1.2, 0.9) == [200, 20, 10, 255]
    assert cell(floor, -1.2, -0.9) == [0, 0, 0, 255]


def test_a_smaller_picture_has_a_smaller_lens() -> None:
    channels = Channels(SHIFT_NS)
    whole = converted(told.everything()[:2], channels)["/calibration/cam"]
    assert (whole["width"], whole["height"], whole["distortion_model"]) == (640, 480, "plumb_bob")
    assert whole["D"] == list(CAMERA.distortion)
    half = converted(told.everything()[2:4], channels)
    lens, marks = half["/calibration/cam"], half["/annotations/cam"]
    assert (lens["width"], lens["height"], lens["K"][0]) == (320, 240, 400.0)
    # The picture's middle stays its middle, counted from pixels' centres.
    assert (lens["K"][2], lens["P"][6]) == pytest.approx((159.5, 119.5))
    x_px, y_px = CAMERA.project(np.array([0.5, -0.2, 0.06]))
    centre = marks["circles"][0]["position"]
    assert (centre["x"], centre["y"]) == pytest.approx(
        ((x_px + 0.5) / 2, (y_px + 0.5) / 2), abs=0.01
    )
    # The body's edge: 0.035 m at 2.44 m below the lens.
    assert marks["circles"][0]["diameter"] == pytest.approx(2 * 400 * 0.035 / 2.44, rel=0.05)
    begin, end = marks["points"][0]["points"]
    assert end["y"] < begin["y"] and abs(end["x"] - begin["x"]) < 2.0, "it looks up in the picture"
    assert marks["texts"][0]["text"] == "epuck3"


def test_annotations_wait_for_a_picture() -> None:
    some = [message for message in told.everything() if message.topic != "/picture/cam"]
    assert "/annotations/cam" not in converted(some)
    assert sources_of("/annotations/cam") == {"/arena", "/picture/cam"}


def test_only_what_is_wanted_is_made() -> None:
    made = converted(told.everything(), Channels(SHIFT_NS, lambda topic: topic == "/poses"))
    assert made.keys() == {"/poses", "/tf_static", "/calibration/cam", "/log"}


@pytest.mark.parametrize("topic", [message.topic for message in told.everything()])
def test_damaged_messages_make_nothing_and_raise_nothing(topic: str) -> None:
    whole = {message.topic: message for message in told.everything()}
    for data in (
        {},
        dict.fromkeys(whole[topic].data),
        dict.fromkeys(whole[topic].data, 7),
        {name: [{"kind": "box", "id": 1}] for name in whole[topic].data},
    ):
        channels = Channels(SHIFT_NS)
        converted(told.everything(), channels)
        channels.convert(replace(whole[topic], data=data))
        assert "/poses" in converted([whole["/arena"]], channels)


def test_quaternions_of_all_turns() -> None:
    rng = np.random.default_rng(5)
    matrices = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(50)]
    matrices += [np.diag(d) for d in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1), (1, 1, 1))]
    for matrix in matrices:
        matrix = matrix * np.linalg.det(matrix)
        turn = _shapes.matrix_turn(matrix)
        assert sum(v * v for v in turn.values()) == pytest.approx(1.0, abs=1e-8)
        columns = np.column_stack([turned(turn, axis) for axis in np.eye(3)])
        assert columns == pytest.approx(matrix, abs=1e-7)
