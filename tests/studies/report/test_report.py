"""The page and the pictures: every section is there, whatever a recording lacks."""

from __future__ import annotations

import base64
import copy
import json
import re
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.studies.report.runs import BLINKER, Reader, messages, write, write_cut_off
from vsense import cli
from vsense.base.message_bus import Message
from vsense.monitor.recording.form import RecordingError
from vsense.studies.report.report import REPORT_PAGE, make_report

TOPICS = sorted({message.topic for message in messages()})
PICTURES = ("ways", "occupancy", "measures", "robots", "latency", "latency-over-time")
pytestmark = pytest.mark.usefixtures("coarse")


def test_the_page_holds_every_section(tmp_path: Path) -> None:
    folder = tmp_path / "report"
    made = make_report([write(tmp_path / "run.mcap", messages())], folder)
    assert made.files[0] == folder / REPORT_PAGE
    assert {path.stem for path in made.files[1:]} == set(PICTURES)
    for path in made.files[1:]:
        assert cv2.imread(str(path)) is not None
    text = (folder / REPORT_PAGE).read_text()
    read = Reader(text)
    assert read.headings == [
        "hand, lab, seed 1", "Measures", "Robots", "Loss and gaps", "Events",
    ]  # fmt: skip
    numbers = re.findall(r"<b>Figure (\d+)\.", text)
    assert numbers == [str(place + 1) for place in range(len(PICTURES))]
    assert all(source.startswith("data:image/png;base64,") for source in read.sources)
    assert f"The worst link: blinker (tag {BLINKER}), lost once, silent for 1.7 s at most." in text
    assert "here &lt;we&gt; go (viewer 1)" in text and "<td>driver (2)</td>" in text


def test_a_floor_that_unfolds_is_left_out(tmp_path: Path) -> None:
    large = cv2.imencode(".png", np.zeros((4097, 4096), np.uint8))[1].tobytes()
    drawn = []
    for name, png in (("none", b""), ("large", large)):
        sent = list(messages())
        world = next(message for message in sent if message.topic == "/world")
        world.data["floor"]["png"] = base64.b64encode(png).decode()
        make_report([write(tmp_path / f"{name}.mcap", sent)], tmp_path / name)
        drawn.append((tmp_path / name / "ways.png").read_bytes())
    assert drawn[0] == drawn[1]


def test_several_runs_are_compared(tmp_path: Path) -> None:
    paths = [
        write(tmp_path / f"{place}.mcap", messages(blind=place > 1, seed=place))
        for place in range(3)
    ]
    paths.append(write(tmp_path / "other.mcap", messages(name="other")))
    made = make_report(paths, tmp_path / "report")
    text = (tmp_path / "report" / REPORT_PAGE).read_text()
    read = Reader(text)
    assert read.headings[:4] == [
        "4 runs compared",
        "hand: runs (lab) compared",
        "End values",
        "Runs",
    ]
    assert "Runs: 2 sighted, 1 blind." in text
    anchors = {source for source in read.sources if source.startswith("#")}
    assert anchors == {f"#run-{n}" for n in range(4)} | {"#compared-0", "#compared-1"}
    assert all(f'id="{anchor[1:]}"' in text for anchor in anchors)
    names = {path.name for path in made.files}
    assert len(names) == len(made.files)
    assert {"compared-1-01-items_home.png", "compared-1-01-items_home-end.png"} <= names
    hand = made.as_json()["comparison"][0]
    assert (hand["experiment"], hand["condition"]) == ("hand", "sighted")
    assert hand["quantities"]["items home, at the end"] == {
        "n": 2, "mean": 19.0, "standard_deviation": 0.0, "median": 19.0,
    }  # fmt: skip


def test_the_command_prints_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_cut_off(tmp_path / "run.mcap", messages())
    assert cli.main(["report", str(path), "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert told["files"][0] == str(tmp_path / "run-report" / REPORT_PAGE)
    assert told["recordings"][0]["complete"] is False and told["comparison"] == []
    assert f"{path} was cut off: its last second may be missing" in err
    assert "was cut off" in (tmp_path / "run-report" / REPORT_PAGE).read_text()


def test_nothing_is_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "run.mcap", messages())
    folder = tmp_path / "report"
    assert cli.main(["report", str(path), "-o", str(folder)]) == 0
    before = (folder / REPORT_PAGE).read_bytes()
    assert cli.main(["report", str(path), "-o", str(folder)]) == 2
    assert f"{folder}: is there already" in capsys.readouterr().err
    assert (folder / REPORT_PAGE).read_bytes() == before
    assert cli.main(["report", str(path), "-o", str(path)]) == 2


@pytest.mark.parametrize("content", [None, b"", b"no recording at all", b"\x89MCAP0\r\n"])
def test_bad_files_are_one_clear_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.mcap"
    if content is not None:
        path.write_bytes(content)
    good = write(tmp_path / "good.mcap", messages())
    with pytest.raises(RecordingError, match=re.escape(f"{path}: ")):
        make_report([good, path], tmp_path / "report")
    assert not (tmp_path / "report").exists()


@pytest.mark.parametrize("lacking", TOPICS)
def test_a_recording_may_lack_a_topic(tmp_path: Path, lacking: str) -> None:
    sent = [message for message in messages() if message.topic != lacking]
    make_report([write(tmp_path / "run.mcap", sent)], tmp_path / "report")
    Reader((tmp_path / "report" / REPORT_PAGE).read_text())


def test_a_world_that_people_changed_is_told(tmp_path: Path) -> None:
    change = {
        "kind": "move",
        "name": "lamp",
        "x_m": 0.0,
        "y_m": 0.0,
        "yaw_rad": None,
        "final": True,
    }
    told = {"timestep": 9, "run_timestep": 6, "by": "viewer 1", "change": change, "text": "lamp"}
    *sent, last = messages()
    changed = [*sent, Message("/orders", last.time_ns, told), last]
    paths = [write(tmp_path / "a.mcap", changed), write(tmp_path / "b.mcap", [*sent, last])]
    made = make_report(paths, tmp_path / "report")
    assert [run["changes"] for run in made.as_json()["recordings"]] == [1, 0]
    text = (tmp_path / "report" / REPORT_PAGE).read_text()
    assert text.count("changed by hand while it ran, 1 in all") == 1
    assert text.count("world changed by hand") == 1


@pytest.mark.parametrize("only", ["/arena", "/signals", "/robots", "/event"])
def test_a_recording_may_hold_one_topic(tmp_path: Path, only: str) -> None:
    sent = [message for message in messages() if message.topic == only]
    paths = [write(tmp_path / f"{place}.mcap", sent) for place in range(2)]
    make_report(paths, tmp_path / "report")
    text = (tmp_path / "report" / REPORT_PAGE).read_text()
    assert "Not in this recording: " in text
    Reader(text)


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from(["", "x", "<b>", "\ud800", [], {}, [None], [[1]], {"a": 1}]),
    st.sampled_from([-1, 0, 1e-9, 1e300, -1e300, 10**30, 1e9, 5000.0]),
)


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """All places in some data."""
    if isinstance(value, dict):
        inside = [place for key, each in value.items() for place in places(each, (*path, key))]
    elif isinstance(value, list):
        inside = [place for n, each in enumerate(value) for place in places(each, (*path, n))]
    else:
        inside = []
    return [path, *inside] if path else inside


@settings(max_examples=5, deadline=None)
@given(data=st.data())
def test_damaged_values_never_stop_a_report(data: st.DataObject) -> None:
    check_damaged_values(data)


@pytest.mark.campaign
@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_no_damaged_value_of_many_stops_a_report(data: st.DataObject) -> None:
    check_damaged_values(data)


def check_damaged_values(data: st.DataObject) -> None:
    """Makes a report of one or two recordings in which some values are junk."""
    sent = [Message(m.topic, m.time_ns, copy.deepcopy(m.data)) for m in messages()]
    for _ in range(data.draw(st.integers(1, 4))):
        topic = data.draw(st.sampled_from(TOPICS))
        junk = data.draw(JUNK)
        chosen = [message for message in sent if message.topic == topic]
        place = data.draw(st.sampled_from(places(chosen[-1].data)))
        everywhere = data.draw(st.booleans())
        for message in chosen if everywhere else chosen[-1:]:
            spoil(message.data, place, junk)
    with tempfile.TemporaryDirectory() as name:
        paths = [write(Path(name) / "run.mcap", sent)] * data.draw(st.integers(1, 2))
        made = make_report(paths, Path(name) / "report")
        json.dumps(made.as_json(), allow_nan=False)
        Reader(made.files[0].read_text())


def spoil(data: Any, place: tuple[Any, ...], junk: Any) -> None:
    """Puts junk at a place, if that is there still."""
    try:
        for key in place[:-1]:
            data = data[key]
        data[place[-1]] = copy.deepcopy(junk)
    except (KeyError, TypeError, IndexError):
        pass
