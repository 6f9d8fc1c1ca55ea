"""The schemas for editors know exactly what the readers know."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET
from importlib import resources as package
from pathlib import Path

import pytest

from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse
from vsense.config import resources, tracking_session
from vsense.monitor.recording.pictures import (
    XML_SCHEMAS,
    one_tracker,
    tag_ranges,
    write_session_files,
)
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking.specs import TrackerSpec

XS = "{http://www.w3.org/2001/XMLSchema}"

RESOURCES = """<arena_tracking_system><nodes listen="tcp/0.0.0.0:7447" config="z.json5" />
<grabbers><grabber id="d" type="directory" path="." />
<grabber id="c" type="camera" device="0" />
<grabber id="n" type="node" node="west" frame_rate="10" />
<grabber id="g" type="genicam" device="10.0.0.5" frame_rate="10" packet_size="1500"
pixel_format="Mono8"><feature name="BlackLevelRaw" value="0" /></grabber></grabbers>
<trackers><tracker id="t" tags="1 2"><robots tags="2" robot_height="1" /></tracker></trackers>
<cameras><camera id="c" calibration="c.json" /></cameras></arena_tracking_system>"""

EXPERIMENT = """<arena_tracking><arena_state_tracker>
<camera_state_tracker grabber="d" camera="c" tracker="t" /></arena_state_tracker>
<experiment_record /></arena_tracking>"""


def asked_for(data: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, set[str]]:
    """What the readers ask of each element, by its name."""
    asked: dict[str, set[str]] = {}
    seen = Element.check_all_read

    def note(element: Element) -> None:
        known = element._asked_attributes | {f"<{c}>" for c in element._asked_children}
        asked.setdefault(element.name, set()).update(known)
        seen(element)

    monkeypatch.setattr(Element, "check_all_read", note)
    known = resources.read(RESOURCES.encode(), "r.xml", folder)
    if data is EXPERIMENT:
        asked.clear()
        tracking_session.read(data.encode(), "x.xml", folder, known)
    return asked


def declared(schema: str) -> dict[str, set[str]]:
    """What a schema allows in each element, by its name."""
    root = ET.fromstring((package.files("vsense.config") / "schema" / schema).read_text())
    types = {t.get("name"): t for t in root.findall(f"{XS}complexType")}
    found: dict[str, set[str]] = {}
    for element in root.iter(f"{XS}element"):
        type_ = types.get(element.get("type"), element.find(f"{XS}complexType"))
        assert type_ is not None
        groups = [g for tag in ("sequence", "all") for g in type_.findall(f"{XS}{tag}")]
        children = {f"<{c.get('name')}>" for g in groups for c in g.findall(f"{XS}element")}
        attributes = {str(a.get("name")) for a in type_.findall(f"{XS}attribute")}
        found[str(element.get("name"))] = children | attributes
    return found


@pytest.mark.parametrize(
    "schema, data", [("resources.xsd", RESOURCES), ("experiment.xsd", EXPERIMENT)]
)
def test_a_schema_allows_what_the_reader_asks_for(
    schema: str, data: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = Camera.looking_down("c", 0.0, 0.0, 2.0, 500.0, (640, 480))
    (tmp_path / "c.json").write_text(camera.to_json())
    assert declared(schema) == asked_for(data, tmp_path, monkeypatch)


@pytest.mark.parametrize("schema", XML_SCHEMAS)
def test_every_attribute_of_a_schema_is_explained(schema: str) -> None:
    root = ET.fromstring((package.files("vsense.config") / "schema" / schema).read_text())
    unexplained = [
        a.get("name")
        for a in root.iter(f"{XS}attribute")
        if a.find(f"{XS}annotation") is None and a.get("name") not in ("id", "tags", "robot_height")
    ]
    assert unexplained == []


def test_the_shipped_examples_are_well_formed_and_known(tmp_path: Path) -> None:
    text = (package.files("vsense.config") / "examples" / "resources.xml").read_bytes()
    found = resources.read(text, "resources.xml", tmp_path)
    assert {g.type for g in found.grabbers.values()} == {
        "directory", "video", "camera", "genicam",
    }  # fmt: skip
    text = (package.files("vsense.config") / "examples" / "experiment.xml").read_bytes()
    assert parse(text, "experiment.xml").name == "arena_tracking"


def test_the_files_of_a_recording_are_read_as_they_were_written(tmp_path: Path) -> None:
    names = ["a", 'b & "c"', "über/dach"]
    cameras = [Camera.looking_down(n, 0.0, 0.0, 2.0, 500.0, (64, 48)) for n in names]
    heights = {**dict.fromkeys(range(1, 9), 0.05), 40: 0.1, 41: 0.1, 60_000: 0.05}
    own = tmp_path / "mine.json"
    own.write_text(
        (package.files("vsense.vision.markers") / "families/aruco_4x4_50.json").read_text()
    )
    trackers = one_tracker(cameras, "arrow4x4", heights)
    squares = TrackerSpec('"s"', str(own), 90.0, {3: 0.2}, 0.5, False, 0)
    write_session_files(tmp_path, cameras, trackers | {"a": squares})
    known = resources.load(tmp_path / "resources.xml")
    assert list(known.cameras) == names
    for written in (squares, trackers[names[1]]):
        assert dataclasses.replace(known.trackers[written.id], line=0) == written
    used = ET.parse(tmp_path / "experiment.xml").iter("camera_state_tracker")
    assert [view.get("tracker") for view in used] == ['"s"', "robots", "robots"]
    assert sorted(p.name for p in (tmp_path / "schema").iterdir()) == sorted(XML_SCHEMAS)


def test_tags_are_written_as_ranges() -> None:
    assert tag_ranges([22, 3, 1, 2, 9, 8]) == "1-3 8-9 22"
    assert tag_ranges([]) == ""
