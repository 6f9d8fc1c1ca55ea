"""The layout has the form of Foxglove's, and names what there is."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from foxglove import layouts

import vsense.monitor.foxglove
from tests.monitor.foxglove.told import converted, everything
from vsense.modes.lab._camera_spec import rig
from vsense.monitor.foxglove import _schemas, channels
from vsense.monitor.foxglove._layout import LAB_CAMERAS, as_text, layout
from vsense.monitor.foxglove.channels import schema_of
from vsense.monitor.recording import form
from vsense.world.entities import Arena

PANELS = {
    "ThreeDee": layouts.ThreeDeePanel(),
    "Image": layouts.ImagePanel(),
    "Plot": layouts.PlotPanel(),
    "Log": layouts.LogPanel(),
}


def panels(content: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """All panels of a layout; whatever holds them is as the SDK's."""
    kind = {"split": layouts.SplitContainer, "tabs": layouts.TabContainer}.get(content["type"])
    if kind is None:
        yield content
        return
    list_of = "items" if content["type"] == "split" else "tabs"
    assert content.keys() == kind(**{list_of: []})._to_dict().keys()
    for item in content[list_of]:
        yield from panels(item["content"])


def keys(made: Any) -> set[str]:
    """The names that the SDK writes for one of its classes."""
    return set(made._to_dict())


def test_the_shipped_file_is_what_is_made() -> None:
    folder = Path(inspect.getfile(vsense.monitor.foxglove)).parent
    assert (folder / "foxglove-layout.json").read_text() == as_text(layout())
    four = rig(Arena((2.0, 2.0, 1.0), (0.0, 0.0, 0.5)))
    assert {camera.id for camera in four} == set(LAB_CAMERAS)


def test_panels_are_as_the_sdk_writes_them() -> None:
    made = json.loads(as_text(layout()))
    assert keys(layouts.Layout(content=layouts.LogPanel())) >= made.keys() >= {"version", "content"}
    found = list(panels(made["content"]))
    assert [p["panelType"] for p in found] == ["ThreeDee", "Log", *["Image"] * 4, "Plot", "Plot"]
    for panel in found:
        own = PANELS[panel["panelType"]]
        assert panel.keys() == keys(own) and panel["version"] == own._to_dict()["version"]
        assert panel["config"].keys() <= keys(own.config)
    arena, image, plot = found[0]["config"], found[2]["config"], found[6]["config"]
    assert arena["cameraState"].keys() <= keys(layouts.ThreeDeeCameraState())
    assert image["imageMode"].keys() <= keys(layouts.ImageModeConfig())
    for series in plot["paths"]:
        assert series.keys() <= keys(layouts.PlotSeries(value=""))
    settings = {
        _schemas.SCENE: layouts.BaseRendererSceneUpdateTopicSettings(),
        _schemas.GRID_SCHEMA: layouts.BaseRendererGridTopicSettings(),
        _schemas.POSES_SCHEMA: layouts.BaseRendererPosesTopicSettings(),
        _schemas.CALIBRATION_SCHEMA: layouts.BaseRendererCameraTopicSettings(),
    }
    for topic, config in arena["topics"].items():
        assert config.keys() <= keys(settings[schema_of(topic)]), topic


def test_it_names_topics_that_there_are() -> None:
    text = as_text(layout(("cam",), ("scent",)))
    named = set(re.findall(r'"(/[^"]*)"', text))
    told = {*converted(everything()), *form.RUN_TOPICS, f"{channels.PICTURE}cam"}
    for topic in named:
        assert topic.partition(".")[0] in told, topic
    assert "/measures.values" in named and "/annotations/cam" in named


def test_any_number_of_cameras() -> None:
    for count in (0, 1, 3, 5, 16):
        made = layout([f"c{n}" for n in range(count)])
        images = [p for p in panels(made["content"]) if p["panelType"] == "Image"]
        assert [one["title"] for one in images] == [f"c{n}" for n in range(count)]
