"""What is recorded comes back as it was, in our reader and in that of `mcap`."""

from __future__ import annotations

import json
import re
import threading
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.reader import make_reader

from tests.monitor.recording.conftest import BEGIN_NS, picture, record
from vsense.base.files import PACKAGE_FOLDER
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording import size_line, writer
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording._waiting import WaitingBounds
from vsense.monitor.recording.form import ExperimentMessage, RecordingError, RunMessage, schema
from vsense.monitor.recording.reader import open_recording

values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)
topics = st.sampled_from(["/arena", "/run", "/event", "/own thing", "/ünusual"])
messages = st.builds(
    Message,
    topics,
    st.integers(0, 2**60),
    st.dictionaries(st.text(), values, max_size=5),
    st.binary(max_size=20),
)


@given(st.lists(messages, max_size=12))
@example([Message("/arena", 0, {"capture_ns": None}, b"a picture that says no capture time")])
def test_messages_come_back_as_they_were(sent: list[Message]) -> None:
    with TemporaryDirectory() as folder:
        path = record(Path(folder) / "run.mcap", sent)
        with open_recording(path) as recording:
            assert recording.complete
            assert list(recording.messages()) == sent
            newest = {message.topic: message for message in sent}
            assert recording.newest(None) == newest
            for topic in newest:
                mine = [message for message in sent if message.topic == topic]
                assert list(recording.messages({topic})) == mine


def test_a_packed_index_is_the_library_s_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(name: str) -> bytes:
        written = writer.RecordingWriter(tmp_path / name, BEGIN_NS, 5)
        for second in range(4):
            written.add(Message("/arena", BEGIN_NS + second, {"n": second}))
            written.add(Message("/run", BEGIN_NS + second, {}))
            written.flush()
        written.close()
        return (tmp_path / name).read_bytes()

    taken = []
    packed = writer.ChunkIndices.append
    monkeypatch.setattr(
        writer.ChunkIndices, "append", lambda *what: (taken.append(1), packed(*what))
    )
    ours = made("ours.mcap")
    assert len(taken) == 4, "the library keeps its index here"
    monkeypatch.setattr(writer, "ChunkIndices", list)
    assert made("plain.mcap") == ours


def test_nan_and_numpy_become_what_json_knows(tmp_path: Path) -> None:
    data = {"x": [1.0, float("nan")], "n": np.int64(3), "a": np.array([0.5, np.nan]), "t": (1, 2)}
    with open_recording(record(tmp_path / "run.mcap", [Message("/a", 1, data)])) as recording:
        (message,) = recording.messages()
    assert message.data == {"x": [1.0, None], "n": 3, "a": [0.5, None], "t": [1, 2]}


def test_what_json_cannot_hold_is_told_once_and_counted(tmp_path: Path) -> None:
    bus, told = MessageBus(), []
    bus.join(told.append, lambda topic: topic == "/event")
    recorder = Recorder(bus, tmp_path / "run.mcap")
    for _ in range(3):
        bus.publish(Message("/bad", 1, {"x": object()}))
    bus.publish(Message("/good", 1, {}))
    recorder.close()
    assert recorder.state()["lost_messages"] == 3
    assert [m.data["text"] for m in told] == [
        "messages /bad cannot be recorded: object cannot be recorded"
    ]
    with open_recording(tmp_path / "run.mcap") as recording:
        assert [m.topic for m in recording.messages()] == ["/good"]


def test_pictures_come_back_bit_for_bit_and_show_in_other_tools(tmp_path: Path) -> None:
    sent = [picture(number) for number in range(3)]
    path = record(tmp_path / "run.mcap", [], sent)
    with open_recording(path) as recording:
        found = list(recording.messages())
    for frame, message in zip(sent, found, strict=True):
        image = cv2.imdecode(np.frombuffer(message.blob, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert np.array_equal(image, frame.image)
        assert message.topic == "/picture/left"
        assert message.data["capture_ns"] == frame.capture_ns
        assert message.data["ready_ns"] == frame.ready_ns
        assert message.data["timestep"] == frame.timestep
    with path.open("rb") as file:
        for schema, channel, raw in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None and schema.name == "foxglove.CompressedImage"
            assert (channel.topic, channel.message_encoding) == ("/picture/left", "json")
            assert json.loads(raw.data)["format"] == "png"


def test_other_tools_read_all_of_it(tmp_path: Path) -> None:
    experiment = {"name": "pollutant", "seed": 7, "file_text": "<argos-configuration/>"}
    sent = [Message("/experiment", BEGIN_NS, experiment)]
    sent += [Message("/arena", BEGIN_NS + n, {"n": n}) for n in range(500)]
    path = record(tmp_path / "run.mcap", sent)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "vsense"
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == len(sent)
        assert [json.loads(raw.data) for _, _, raw in reader.iter_messages()] == [
            message.data for message in sent
        ]
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata["experiment"] == {key: str(value) for key, value in experiment.items()}
    assert metadata["vsense"]["begin_ns"] == str(BEGIN_NS)


def test_only_what_belongs_into_a_recording_is_wanted(tmp_path: Path) -> None:
    bus = MessageBus()
    recorder = Recorder(bus, tmp_path / "run.mcap")
    assert bus.wants("/arena") and bus.wants("/readings") and bus.wants("/anything")
    assert not bus.wants("/picture/left") and not bus.wants("/readings/23")
    recorder.pictures([picture(1)])
    recorder.close()
    with open_recording(tmp_path / "run.mcap") as recording:
        assert list(recording.messages()) == []


def test_switched_off_it_says_what_is_missing_and_asks_for_news(tmp_path: Path) -> None:
    bus, now = MessageBus(), [BEGIN_NS]
    recorder = Recorder(bus, tmp_path / "run.mcap", pictures=True, clock=lambda: now[0])
    for on in (True, False, True):
        joined = bus.joined
        (recorder.resume if on else recorder.pause)()
        assert recorder.state()["on"] is on
        now[0] += 1_000_000_000
        bus.publish(Message("/run", now[0], {"on": on}))
        recorder.pictures([picture(int(on))])
    assert bus.joined == joined + 1
    recorder.pause()
    now[0] += 1_000_000_000
    recorder.close()
    recorder.close()
    with open_recording(tmp_path / "run.mcap") as recording:
        assert [m.data["on"] for m in recording.messages({"/run"})] == [True, True]
        assert len(list(recording.messages({"/picture/left"}))) == 2
        assert [(gap.from_ns - BEGIN_NS, gap.to_ns - BEGIN_NS) for gap in recording.gaps] == [
            (1 * 10**9, 2 * 10**9),
            (3 * 10**9, 4 * 10**9),
        ]


def test_pictures_are_left_out_first(tmp_path: Path) -> None:
    bus = MessageBus()
    bounds = WaitingBounds(picture_bytes=10, message_bytes=1 << 20)
    recorder = Recorder(bus, tmp_path / "run.mcap", pictures=True, bounds=bounds)
    recorder.pictures([picture(1), picture(1, "right")])
    bus.publish(Message("/run", 1, {}))
    recorder.close()
    with open_recording(tmp_path / "run.mcap") as recording:
        assert [m.topic for m in recording.messages()] == ["/run", "/gap"]
        (gap,) = recording.gaps
        assert (gap.messages, gap.pictures) == (0, 2)


def test_a_recording_is_never_written_over(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", [])
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="is there already"):
        Recorder(MessageBus(), path)
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="cannot be written: "):
        Recorder(MessageBus(), tmp_path / "file" / "run.mcap")
    assert path.read_bytes() == before


def test_the_middle_is_found_with_and_without_index(tmp_path: Path) -> None:
    sent = [Message("/world", BEGIN_NS, {"n": -1})]
    sent += [Message("/arena", BEGIN_NS + n * 10**8, {"n": n}) for n in range(100)]
    whole = record(tmp_path / "whole.mcap", sent)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-20])
    for path, complete in ((whole, True), (cut, False)):
        with open_recording(path) as recording:
            assert recording.complete is complete
            assert recording.duration_s == pytest.approx(9.9)
            assert [m.data["n"] for m in recording.messages(start_s=9.65)] == [97, 98, 99]
            newest = recording.newest(None, before_s=5.0)
            assert {t: m.data["n"] for t, m in newest.items()} == {"/world": -1, "/arena": 49}


def test_many_threads_may_tell(tmp_path: Path) -> None:
    bus = MessageBus()
    recorder = Recorder(bus, tmp_path / "run.mcap")

    def tell(teller: int) -> None:
        for number in range(500):
            bus.publish(Message(f"/teller/{teller}", number, {"n": number}))

    threads = [threading.Thread(target=tell, args=(teller,)) for teller in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    recorder.close()
    assert recorder.state()["lost_messages"] == 0
    with open_recording(tmp_path / "run.mcap") as recording:
        for teller in range(6):
            told = [m.data["n"] for m in recording.messages({f"/teller/{teller}"})]
            assert told == list(range(500))


@pytest.mark.parametrize(
    ("topic", "kind"), [("/experiment", ExperimentMessage), ("/run", RunMessage)]
)
def test_messages_are_described_field_by_field(
    topic: str, kind: type[ExperimentMessage] | type[RunMessage]
) -> None:
    page = PACKAGE_FOLDER / "monitor" / "ui" / "MESSAGES.md"
    lines = page.read_text().splitlines()
    (line,) = (line for line in lines if line.startswith(f"| `{topic}` |"))
    assert [name for name in kind.kinds() if f"`{name}`" not in line] == []


def test_what_a_message_does_not_say_has_its_default() -> None:
    data = {"state": 3, "late": True, "timestep": 4, "rate_hz": 10, "own": 1, "can": "all"}
    assert RunMessage.read(data) == RunMessage(timestep=4, rate_hz=10)
    whole = RunMessage(state="paused", can=["start"], latency_ms={"p50": 1.0, "p99": 2.0}, late=0)
    assert RunMessage.read(json.loads(json.dumps(whole.data()))) == whole


def test_every_topic_has_a_schema_that_is_one() -> None:
    for topic in ("/experiment", "/run", "/arena", "/own", "/gap", "/tracker"):
        name, text = schema(topic, blob=False)
        assert name == "vsense" + topic.replace("/", ".")
        assert json.loads(text)["type"] == "object"
    known = json.loads(schema("/run", blob=False)[1])["properties"]
    assert known["state"] == {"type": "string"} and known["can"] == {"type": "array"}
    assert known["rate_hz"] == {"type": "number"} and known["latency_ms"] == {"type": "object"}
    fields = json.loads(schema("/picture/left", blob=True)[1])["properties"]
    assert fields["data"] == {"type": "string", "contentEncoding": "base64"}


def test_what_a_minute_costs_is_told_once_it_is_known(tmp_path: Path) -> None:
    """On the host's clock: here 20 s pass at once."""
    bus, now_ns, said = MessageBus(), [BEGIN_NS], list[tuple[str, str]]()
    heard = threading.Event()

    def tell(text: str, level: str) -> None:
        said.append((text, level))
        heard.set()

    path = tmp_path / "run.mcap"
    recorder = Recorder(bus, path, say=tell, clock=lambda: now_ns[0])
    bus.publish(Message("/event", BEGIN_NS, {"text": "x" * 300}))
    now_ns[0] += 20_000_000_000
    assert heard.wait(30.0)
    recorder.close()
    ((text, level),) = said
    assert re.fullmatch(r"recording: about \d+\.\d MB a minute; \d+\.\d [MG]B free", text), text
    assert level == "info" and recorder.seconds == 20.0


@pytest.mark.parametrize(
    ("size", "seconds", "line"),
    [
        (1_040_000, 120.0, "recording: run.mcap, 1.0 MB, 0.5 MB a minute"),
        (2_600_000_000, 120.0, "recording: run.mcap, 2.6 GB, 1.3 GB a minute"),
        (9_000, 1.0, "recording: run.mcap, 0.0 MB"),
    ],
)
def test_a_recordings_size_and_cost(size: int, seconds: float, line: str) -> None:
    assert size_line("run.mcap", size, seconds) == line
