"""The two files of a tracking session: what good ones say, and that broken ones are refused."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import ConfigError, UsageError, VsenseError
from vsense.config import resources, tracking_session
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.source import Controls
from vsense.vision.tracking.mask import Mask
from vsense.vision.tracking.specs import TrackingSession

RESOURCES = """<?xml version="1.0" ?>
<arena_tracking_system xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:noNamespaceSchemaLocation="resources.xsd">
  <grabbers>
    <grabber id="files" type="directory" path="pictures" timestamps="times.csv" />
    <grabber id="plain" type="directory" path="pictures" frame_rate="5" start_time="2.5" />
    <grabber id="film" type="video" path="film.avi" frame_rate="25" start_time="-1" />
    <grabber id="usb" type="camera" device="/dev/video0" width="640" height="480"
             frame_rate="30" exposure_time_abs="8000" gain_raw="12" />
    <grabber id="stream" type="camera" device="rtsp://host/arena" />
    <grabber id="nowhere" type="directory" path="missing" />
  </grabbers>
  <trackers>
    <tracker id="arrows" family="arrow4x4" robot_height="0.06" tags="1-15, 22" max_speed="0.3">
      <robots tags="22 3-4" robot_height="0.12" />
    </tracker>
    <tracker id="other" tags="100" roster="closed" />
    <tracker id="clash" tags="22" robot_height="0.2" />
  </trackers>
  <cameras>
    <camera id="a" calibration="a.json" />
    <camera id="b" calibration="b.json" />
    <camera id="broken" calibration="broken.json" />
    <camera id="absent" calibration="absent.json" />
  </cameras>
</arena_tracking_system>
"""

EXPERIMENT = """<?xml version="1.0" ?>
<arena_tracking>
  <arena_state_tracker server_port="4041" opt_key_frame_period="5" opt_square_size="11">
    <camera_state_tracker grabber="files" camera="a" tracker="arrows" />
    <camera_state_tracker grabber="film" camera="b" tracker="other" />
  </arena_state_tracker>
  <experiment_record record_image="true" change_root_directory_on_start="false"
                     root_directory="kept" image_format="pgm" />
</arena_tracking>
"""

Read = Callable[..., TrackingSession]

OPTIONAL = {
    "grabber timestamps", "grabber frame_rate", "grabber start_time", "grabber exposure_time_abs",
    "grabber gain_raw", "tracker family", "tracker robot_height", "tracker max_speed",
    "tracker roster",
    "arena_state_tracker server_port", "arena_state_tracker opt_key_frame_period",
    "experiment_record record_image",
    "experiment_record change_root_directory_on_start", "experiment_record root_directory",
    "experiment_record image_format",
}  # fmt: skip
"""Attributes with a default: a file without them is a good one."""

FREE = {"grabber device", "grabber id", "tracker id", "camera id", "camera calibration",
        "grabber path", "grabber timestamps", "experiment_record root_directory"}  # fmt: skip
"""Attributes that may hold any text."""

BROKEN = ["", " ", "abc", "nan", "inf", "-1e308", "x,2", "5-1", "-", "1-", "999999999999999"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("session")
    (folder / "pictures").mkdir()
    for name in ("times.csv", "film.avi"):
        (folder / name).touch()
    for name in "ab":
        camera = Camera.looking_down("made by calibration", 0.0, 0.0, 2.0, 500.0, (640, 480))
        (folder / f"{name}.json").write_text(camera.to_json())
    (folder / "broken.json").write_text('{"id": "x"}')
    return folder


@pytest.fixture(scope="module")
def read_text(folder: Path) -> Read:
    """Reads a session from texts, as if they were r.xml and x.xml in one folder."""

    def read(first: str = RESOURCES, second: str = EXPERIMENT) -> TrackingSession:
        known = resources.read(first.encode(), "r.xml", folder)
        return tracking_session.read(second.encode(), "x.xml", folder, known)

    return read


def attributes(text: str) -> list[tuple[str, int, int, int]]:
    """All attributes: "element key", line of the element, start and end in the text."""
    found = []
    for tag in re.finditer(r"<(\w+)((?:\s+[\w:]+=\"[^\"]*\")+)\s*/?>", text):
        for match in re.finditer(r"([\w:]+)=\"([^\"]*)\"", tag[2]):
            if not match[1].startswith("x"):
                line = text.count("\n", 0, tag.start()) + 1
                start = tag.start(2)
                found.append(
                    (f"{tag[1]} {match[1]}", line, start + match.start(), start + match.end())
                )
    return found


BOTH = [(0, *a) for a in attributes(RESOURCES)] + [(1, *a) for a in attributes(EXPERIMENT)]


def changed(which: int, start: int, end: int, new: str) -> tuple[str, str]:
    texts = [RESOURCES, EXPERIMENT]
    texts[which] = texts[which][:start] + new + texts[which][end:]
    return texts[0], texts[1]


def test_everything_in_the_examples_is_understood(read_text: Read, folder: Path) -> None:
    session = read_text()
    assert (session.server_port, session.key_frame_period) == (4041, 5)
    assert session.square_size_m == pytest.approx(0.11)
    assert not session.is_live
    files, film = session.views
    assert (files.grabber.source, files.grabber.timestamps) == (
        str(folder / "pictures"), folder / "times.csv",
    )  # fmt: skip
    assert (film.grabber.frame_rate_hz, film.grabber.start_s) == (25.0, -1.0)
    assert (files.camera.id, film.camera.id) == ("a", "b")
    assert session.heights_m == {
        **dict.fromkeys((1, 2, *range(5, 16), 100), 0.06), **dict.fromkeys((3, 4, 22), 0.12),
    }  # fmt: skip
    assert files.tracker.max_speed_m_s == 0.3
    assert files.tracker.open_roster and not film.tracker.open_roster
    assert files.tracker.heading_deg == 0.0
    record = session.record
    assert (record.record_image, record.change_root_directory_on_start) == (True, False)
    assert (record.root_directory, record.image_format) == (folder / "kept", "pgm")
    usb = session.resources.grabbers["usb"]
    assert usb.settings == Controls((640, 480), 30.0, 8000.0, 12.0)


def test_square_markers_can_be_turned_on_their_robots_and_arrows_cannot(read_text: Read) -> None:
    text = RESOURCES.replace('id="other"', 'id="other" family="aruco_4x4_50" heading="-90"')
    text = text.replace('tags="100"', 'tags="49"')
    assert read_text(text, EXPERIMENT).views[1].tracker.heading_deg == -90.0
    with pytest.raises(ConfigError, match=r"heading:.*arrow4x4"):
        read_text(RESOURCES.replace('id="other"', 'id="other" heading="-90"'), EXPERIMENT)


def test_records_are_frozen(read_text: Read) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        read_text().server_port = 1  # type: ignore[misc]


def test_a_session_of_cameras_alone_is_live(read_text: Read) -> None:
    text = EXPERIMENT.replace('"files"', '"usb"').replace('"film"', '"stream"')
    assert read_text(RESOURCES, text).is_live


def test_defaults_are_the_thesis(read_text: Read) -> None:
    text = re.sub(r"<arena_state_tracker [^>]*>", "<arena_state_tracker>", EXPERIMENT)
    text = re.sub(r"<experiment_record[^>]*>", "", text)
    session = read_text(RESOURCES, text)
    assert (session.server_port, session.key_frame_period) == (4040, 1)
    assert not session.record.record_image
    assert session.record.change_root_directory_on_start


@pytest.mark.parametrize("which, key, line, start, end", BOTH)
def test_without_an_attribute_it_is_good_or_refused_at_its_line(
    read_text: Read, which: int, key: str, line: int, start: int, end: int
) -> None:
    texts = changed(which, start, end, "")
    if key in OPTIONAL:
        read_text(*texts)
        return
    file = ("r.xml", "x.xml")[which]
    with pytest.raises(ConfigError) as caught:
        read_text(*texts)
    assert (caught.value.file, caught.value.line) == (file, line)
    assert f"{key.split()[1]}: is missing, expected " in caught.value.message


@pytest.mark.parametrize("which, key, line, start, end", BOTH)
def test_a_broken_value_is_refused_at_its_line(
    read_text: Read, which: int, key: str, line: int, start: int, end: int
) -> None:
    for value in BROKEN:
        if key in FREE and value.strip():
            continue
        with pytest.raises(ConfigError) as caught:
            read_text(*changed(which, start, end, f'{key.split()[1]}="{value}"'))
        assert (caught.value.file, caught.value.line) == (("r.xml", "x.xml")[which], line), value
        assert value.strip()[:1] in caught.value.message


@pytest.mark.parametrize("which, key, line, start, end", BOTH)
def test_a_misspelt_attribute_is_no_default(
    read_text: Read, which: int, key: str, line: int, start: int, end: int
) -> None:
    texts = [RESOURCES, EXPERIMENT]
    texts[which] = texts[which][:start] + "x" + texts[which][start:]
    with pytest.raises(ConfigError) as caught:
        read_text(*texts)
    assert caught.value.line == line
    name = key.split()[1]
    assert f"x{name}: is not an attribute of it" in caught.value.message or (
        f"{name}: is missing" in caught.value.message
    )


@pytest.mark.parametrize(
    "which, old, new, line, words",
    [
        (0, 'id="plain"', 'id="files"', 6, "'files'.*line 5"),
        (0, 'tags="100"', 'tags="100 99-101"', 17, "100.*twice"),
        (0, 'tags="22 3-4"', 'tags="22 16"', 15, "16.*tags"),
        (0, '"1-15, 22"', '"1-15 70000"', 14, "'70000'.*0-65535"),
        (0, '"arrow4x4"', '"arow4x4"', 14, "'arow4x4'.*'arrow4x4'"),
        (0, '"arrow4x4"', '"mine.json"', 14, "mine.json: No such file"),
        (0, 'timestamps="times.csv"', 'timestamps="t.csv"', 5, "file .*t.csv"),
        (0, 'timestamps="times.csv"', f'timestamps="{"t" * 5000}"', 5, "timestamps:.*ttt"),
        (0, 'path="film.avi"', 'path="movie.avi"', 7, "path:.*movie.avi"),
        (0, '"times.csv"', '"times.csv" frame_rate="3"', 5, "frame_rate:.*'timestamps'"),
        (0, 'type="video"', 'type="camera"', 7, "device:.*missing"),
        (0, 'width="640" ', "", 8, "width:.*missing"),
        (0, "<cameras>", "<cameras><lens />", 20, "<cameras>.*camera"),
        (0, "arena_tracking_system", "arena_tracking", 2, "<arena_tracking>:.*_system>"),
        (1, 'camera="b"', 'camera="c"', 5, "camera: 'c'"),
        (1, 'camera="b"', 'camera="a"', 5, "camera: 'a'.*line 4"),
        (1, 'grabber="film"', 'grabber="files"', 5, "grabber: 'files'.*line 4"),
        (1, 'grabber="film"', 'grabber="usb"', 5, "recording"),
        (1, 'tracker="other"', 'tracker="clash"', 5, "'arrows': 0.12 m, 0.2 m"),
        (1, ' opt_square_size="11"', "", 3, "opt_square_size:.*missing"),
        (1, '"11"', '"0.5"', 3, "opt_square_size: 0.5.*1.*1000 cm"),
        (1, ' opt_square', ' opt_mask="0,0 1,0 x,1" opt_square', 3, "'x,1'.*corner"),
        (1, ' opt_square', ' opt_mask="0,0 1,0" opt_square', 3, "2 corners.*3"),
        (1, ' opt_square', ' opt_mask="0,0 1,1 2,2" opt_square', 3, "enclose nothing"),
        (1, ' opt_square', ' opt_mask="0,0 200,0 0,150" opt_square', 3, "'200,0':"),
        (1, ' opt_square', ' opt_mask_margin="5" opt_square', 3, "'opt_mask'"),
        (1, "arena_tracking", "arena_tracking_system", 2, "<arena_tracking_system>:.*ing>"),
        (1, "<experiment_record", "<experiment_record /><experiment_record", 7, "appears twice"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_refused_with_words(
    read_text: Read, which: int, old: str, new: str, line: int, words: str
) -> None:
    texts = [RESOURCES, EXPERIMENT]
    assert old in texts[which]
    texts[which] = re.sub(
        f"(?<=[</ ]){old}(?=[ >\n])|{re.escape(old)}", new, texts[which], count=99
    )
    with pytest.raises(ConfigError, match=words) as caught:
        read_text(*texts)
    assert (caught.value.file, caught.value.line) == (("r.xml", "x.xml")[which], line)


@pytest.mark.parametrize(
    "camera, words",
    [("absent", "line: 24 absent.json is not there: calibrate the cameras first"),
     ("broken", "line: 23 broken.json: camera file: width_px is missing")],
)  # fmt: skip
def test_a_camera_file_is_looked_at_when_it_is_used(
    read_text: Read, camera: str, words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        read_text(RESOURCES, EXPERIMENT.replace('camera="b"', f'camera="{camera}"'))
    line, text = words[6:8], words[9:]
    assert (caught.value.file, caught.value.line) == ("r.xml", int(line))
    assert text in caught.value.message


def test_a_recording_is_looked_for_when_it_is_used(read_text: Read) -> None:
    with pytest.raises(ConfigError, match=r"^r\.xml:11: <grabber> path: there is no directory"):
        read_text(RESOURCES, EXPERIMENT.replace('"files"', '"nowhere"'))


def test_a_session_without_a_camera_is_refused(read_text: Read) -> None:
    text = re.sub(r"<camera_state_tracker[^>]*>", "", EXPERIMENT)
    with pytest.raises(ConfigError, match=r"^x\.xml:3:.*<camera_state_tracker>"):
        read_text(RESOURCES, text)


@given(data=st.data())
def test_any_change_gives_a_session_or_one_error_with_its_place(
    read_text: Read, data: st.DataObject
) -> None:
    which, key, _, start, end = data.draw(st.sampled_from(BOTH))
    plain = st.characters(exclude_categories=("Cc", "Cs"), exclude_characters='<&"\ufffe\uffff')
    value = data.draw(st.text(plain, max_size=20) | st.integers().map(str))
    texts = list(changed(which, start, end, f'{key.split()[1]}="{value}"'))
    if data.draw(st.booleans()):
        cut = data.draw(st.integers(0, len(texts[which])))
        texts[which] = texts[which][:cut] + texts[which][cut + data.draw(st.integers(0, 80)) :]
    try:
        read_text(*texts)
    except ConfigError as error:
        text = texts[("r.xml", "x.xml").index(error.file)]
        assert 1 <= error.line <= text.count("\n") + 1


@pytest.mark.parametrize("name", ["no.xml", "x" * 5000, "a\0b", "."])
def test_a_file_that_cannot_be_read_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        resources.load(tmp_path / name)
    good = tmp_path / "r.xml"
    good.write_text(RESOURCES)
    with pytest.raises(VsenseError, match="cannot be read"):
        tracking_session.load(good, tmp_path / name)


def test_a_mask_is_an_outline_or_that_of_the_experiments_arena(read_text: Read) -> None:
    def masked(words: str) -> TrackingSession:
        return read_text(RESOURCES, EXPERIMENT.replace(" opt_square", f" {words} opt_square", 1))

    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.5))
    assert masked("").mask is None
    assert masked('opt_mask="0,0  2,0 2,1.5"').mask == Mask(corners, 0.05)
    arena = masked('opt_mask="arena" opt_mask_margin="12"')
    with pytest.raises(ConfigError, match=r"x\.xml:3:.*experiment"):
        assert arena.mask
    assert arena.within(corners).mask == Mask(corners, 0.12)
    other = masked('opt_mask="0,0 2,0 2,1.5"')
    assert other.within(((5.0, 5.0), (6.0, 5.0), (6.0, 6.0))) == other
