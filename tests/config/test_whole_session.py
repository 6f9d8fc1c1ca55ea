"""A tracking session without an experiment file: all that the resources name."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.recording import RESOURCES, make_recording
from vsense.base.errors import ConfigError, UsageError
from vsense.config.tracking_session import load, load_whole
from vsense.vision.cameras.camera import Camera

GRABBER = '<grabber id="{id}" type="camera" device="{device}" />'
CAMERA = '    <camera id="{id}" calibration="top.json" />'
TRACKER = '<tracker id="robots" family="arrow4x4" tags="1-3" />'


def write(folder: Path, grabbers: list[str], cameras: list[str], trackers: str = TRACKER) -> Path:
    """Writes a resources file whose cameras are in lines of their own, from line 4 on."""
    camera = Camera.looking_down("top", 0.0, 0.0, 2.4, 1600.0, (480, 360), (0.0,) * 5)
    (folder / "top.json").write_text(camera.to_json())
    rows = [
        f"<arena_tracking_system><grabbers>{''.join(grabbers)}</grabbers>",
        f"  <trackers>{trackers}</trackers>",
        "  <cameras>",
        *(CAMERA.format(id=id) for id in cameras),
        "  </cameras></arena_tracking_system>",
    ]
    file = folder / "resources.xml"
    file.write_text("\n".join(rows))
    return file


def live(*ids: str) -> list[str]:
    return [GRABBER.format(id=id, device=f"/dev/video{n}") for n, id in enumerate(ids)]


def test_each_camera_has_the_grabber_of_its_name(tmp_path: Path) -> None:
    file = write(tmp_path, live("b", "spare", "a", "pictures of c"), ["a", "b", "c"])
    for session in (load_whole(file), load_whole(tmp_path)):
        pairs = [(view.camera.id, view.grabber.id, view.line) for view in session.views]
        assert pairs == [("a", "a", 4), ("b", "b", 5), ("c", "pictures of c", 6)]
        assert session.heights_m.keys() == {1, 2, 3} and not session.record.record_image


def test_one_of_each_belong_together_and_a_folders_own_file_counts(tmp_path: Path) -> None:
    make_recording(tmp_path, 1)
    with_file = load_whole(tmp_path)
    assert with_file == load(tmp_path / "resources.xml", tmp_path / "experiment.xml")
    (tmp_path / "experiment.xml").unlink()
    assert load_whole(tmp_path).views[0].grabber == with_file.views[0].grabber
    assert "pictures" in RESOURCES and load_whole(tmp_path).views[0].grabber.id == "pictures"


@pytest.mark.parametrize(
    ("grabbers", "cameras", "trackers", "words"),
    [
        (live("x", "b"), ["a", "b"], TRACKER,
         "xml:4: <camera> id:.*<grabber>.*'a'"),
        (live("a"), ["a"], f"{TRACKER}{TRACKER.replace('robots', 'more')}",
         "<trackers>:.*2.*file"),
        (live("a"), [], TRACKER, "<cameras>:.*camera"),
        ([*live("a"), '<grabber id="b" type="video" path="resources.xml" frame_rate="5" />'],
         ["a", "b"], TRACKER, "xml:5: <camera_state_tracker> grabber:"),
    ],
)  # fmt: skip
def test_what_nobody_can_know_is_said(
    tmp_path: Path, grabbers: list[str], cameras: list[str], trackers: str, words: str
) -> None:
    file = write(tmp_path, grabbers, cameras, trackers)
    with pytest.raises(ConfigError, match=words):
        load_whole(file)


def test_a_folder_without_a_resources_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"resources.xml:.*No such file"):
        load_whole(tmp_path)
