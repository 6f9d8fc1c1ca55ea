"""Tables of a recording."""

from __future__ import annotations

import csv
import tracemalloc
from pathlib import Path

import pytest

from tests.monitor.recording.conftest import BEGIN_NS, record
from vsense import cli
from vsense.base.errors import UsageError
from vsense.base.message_bus import Message
from vsense.monitor import recording
from vsense.monitor.recording import EVENTS
from vsense.monitor.recording.export import TABLES, TRAJECTORIES, _Export, export_csv
from vsense.monitor.recording.form import ROBOT_COLUMNS, RecordingError
from vsense.monitor.recording.reader import open_recording

STEP_NS = 100_000_000
SENSORS = [{"name": "light", "count": 3}, {"name": "gps", "count": 2}, {"bad": 1}]


def arena(timestep: int) -> Message:
    spread = [1e-6, 2e-6, 3e-6, 2e-6, 4e-6, 5e-6, 3e-6, 5e-6, 6e-6]
    robots = {
        "tag": [3, 7],
        "x_m": [0.1, 0.2],
        "y_m": [-0.1, -0.2],
        "yaw_rad": [3.0, -3.0],
        "speed_m_s": [0.1, 0.0],
        "capture_ns": [1, 2],
        "age_ns": [0, 5],
        "confidence": [1.0, 0.5],
        "cameras": [2, 0],
        "seen": [True, False],
        "covariance": [spread, None],
    }
    data = {"timestep": timestep, "run_timestep": timestep - 1, "robots": robots}
    return Message("/arena", BEGIN_NS + timestep * STEP_NS, data)


def messages() -> list[Message]:
    at = BEGIN_NS + STEP_NS
    readings = {
        "timestep": 1,
        "capture_ns": 1_000_000_000,
        "tag": [3, 7],
        "values": [[[0.1, 0.2, 0.3], [1.0, 2.0]], [[0.4], [3.0, 4.0]]],
        "captured_ns": [[900_000_000, -1], [1_000_000_000, 1_000_000_000]],
    }
    robots = {name: [None, None] for name in ROBOT_COLUMNS} | {
        "tag": [3, 7],
        "name": ["a", "b, the second"],
        "connected": [True, False],
        "trouble": ["", "x"],
    }
    shows = robots | {"shown": [{"state": "go", "n": 1.5}, {}]}
    shows_later = robots | {"shown": [{"n": 2.5}, {"state": "go"}]}
    del robots["hash"]
    gap = {"from_ns": at, "to_ns": at + STEP_NS, "messages": 4, "pictures": 5, "why": "full"}
    return [
        Message("/experiment", BEGIN_NS, {"sensors": SENSORS}),
        arena(1),
        arena(2),
        Message("/readings", at, readings),
        Message("/robots", at, shows),
        Message("/robots", at + STEP_NS, shows_later),
        Message("/robots", at + STEP_NS, robots),
        Message("/signals", at, {"timestep": 1, "measures": {"cleaned": 0.5}}),
        Message("/signals", at + STEP_NS, {"timestep": 2, "measures": {"late": 1, "cleaned": 0.7}}),
        Message("/signals", at + STEP_NS, {"timestep": 3, "measures": {}}),
        Message("/event", at, {"text": 'robot "a" is lost', "level": "warning", "by": None}),
        Message("/gap", at + STEP_NS, gap),
        Message("/arena", at, {"damaged": True}),
        Message("/event", at, {}),
    ]


def test_robots_of_other_controllers_have_columns_of_their_own(tmp_path: Path) -> None:
    sensor = {"layout": "f4", "count": 1}
    controllers = [
        {"id": "a", "tags": [3], "sensors": [{"name": "scent", **sensor}]},
        {"id": "b", "tags": [7, "damaged"], "sensors": [
            {"name": "light", "count": 2}, {"name": "scent", **sensor}]},
    ]  # fmt: skip
    readings = {
        "timestep": 1, "capture_ns": 9, "tag": [3, 7, 65536],
        "values": [[[0.5]], [[1.0, 2.0], [0.25]], [[0.75]]],
        "captured_ns": [[9], [9, 9], [9]],
    }  # fmt: skip
    at = BEGIN_NS + STEP_NS
    told = [Message("/experiment", BEGIN_NS, {"controllers": controllers})]
    file = record(tmp_path / "mixed.mcap", [*told, Message("/readings", at, readings)])
    with open_recording(file) as opened:
        export_csv(opened, tmp_path / "tables")
    head, *found = rows(tmp_path / "tables" / "readings.csv")
    assert head[3:] == ["scent_0", "scent_age_s", "light_0", "light_1", "light_age_s"]
    assert [row[2:] for row in found] == [
        ["3", "0.5", "0.0", "", "", ""],
        ["7", "0.25", "0.0", "1.0", "2.0", "0.0"],
        ["65536", "0.75", "0.0", "", "", ""],
    ]


def rows(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return record(tmp_path / "run.mcap", messages())


def test_tables_hold_what_was_recorded(file: Path, tmp_path: Path) -> None:
    folder = tmp_path / "made" / "tables"
    with open_recording(file) as opened:
        assert export_csv(opened, folder) == {
            "trajectories": 4, "readings": 2, "heard": 0, "robots": 6, "shown": 5, "measures": 2,
            "events": 2,
        }  # fmt: skip
    head, first, second, *_ = rows(folder / "trajectories.csv")
    assert head == list(TRAJECTORIES)
    assert first[:12] == ["0.1", "1", "0", "3", "0.1", "-0.1", "3.0", "0.1", "0", "1.0", "2", "1"]
    assert first[12:] == ["1e-06", "2e-06", "3e-06", "4e-06", "5e-06", "6e-06"]
    assert second[12:] == [""] * 6
    assert rows(folder / "readings.csv") == [
        ["time_s", "timestep", "tag", "light_0", "light_1", "light_2", "light_age_s",
         "gps_0", "gps_1", "gps_age_s"],
        ["0.1", "1", "3", "0.1", "0.2", "0.3", "0.1", "1.0", "2.0", ""],
        ["0.1", "1", "7", "0.4", "", "", "0.0", "3.0", "4.0", "0.0"],
    ]  # fmt: skip
    head, first, second, *_ = rows(folder / "robots.csv")
    assert head == ["time_s", *ROBOT_COLUMNS]
    assert second[:4] == ["0.1", "7", "b, the second", "0"] and second[-1] == "x"
    assert rows(folder / "shown.csv") == [
        ["time_s", "tag", "name", "value"],
        ["0.1", "3", "state", "go"],
        ["0.1", "3", "n", "1.5"],
        ["0.2", "3", "n", "2.5"],
        ["0.2", "3", "state", ""],
        ["0.2", "7", "state", "go"],
    ]
    assert rows(folder / "measures.csv") == [
        ["time_s", "timestep", "cleaned", "late"],
        ["0.1", "1", "0.5", ""],
        ["0.2", "2", "0.7", "1"],
    ]
    head, event, gap = rows(folder / "events.csv")
    assert head == list(EVENTS)
    assert event == ["0.1", "warning", "", 'robot "a" is lost']
    assert gap[1] == "gap" and "0.100 s before this" in gap[3] and gap[3].endswith(": full")


def test_half_a_character_ends_no_export(tmp_path: Path) -> None:
    said = {"text": "half \ud800", "level": "info", "by": None}
    path = record(tmp_path / "odd.mcap", [Message("/event", BEGIN_NS, said)])
    with open_recording(path) as opened:
        assert export_csv(opened, tmp_path / "tables")["events"] == 1
    assert "half ?" in (tmp_path / "tables" / "events.csv").read_text()


def test_more_columns_than_any_run_has_are_refused(tmp_path: Path) -> None:
    sensors = [{"name": "x", "count": 99_999}, {"name": "y", "count": -99_999}]
    for topic, data in (
        ("/experiment", {"controllers": [{"sensors": sensors}]}),
        ("/signals", {"measures": {f"m{n}": n for n in range(4097)}}),
    ):
        path = record(tmp_path / "wide.mcap", [Message(topic, 1, data)])
        said = pytest.raises(RecordingError, match=r"wide\.mcap: says \d+ \w+, expected at most")
        with open_recording(path) as opened, said:
            export_csv(opened, tmp_path / "tables")
        path.unlink()
    assert not (tmp_path / "tables").exists()


def test_a_name_that_no_reader_takes_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pyarrow")
    path = record(tmp_path / "a.mcap", [Message("/signals", 1, {"measures": {"m" * 200_000: 1.0}})])
    assert cli.main(["export", str(path), "--parquet"]) == 2
    assert "measures.csv is no Parquet, and stays: Error: field larger" in capsys.readouterr().err


def test_a_message_of_many_rows_takes_little_memory(tmp_path: Path) -> None:
    many = {"tag": [1] * 200_000, "shown": [{str(n): n} for n in range(200_000)]}
    with open_recording(record(tmp_path / "a.mcap", [Message("/robots", 1, many)])) as opened:
        export = _Export(opened)
        message = next(opened.messages({"/robots"}))
        opened.messages = lambda topics: iter([message])
        tracemalloc.start()
        export.write(dict.fromkeys(TABLES, lambda row: None))
        assert tracemalloc.get_traced_memory()[1] < 4 << 20
        tracemalloc.stop()


def test_nothing_is_written_over(file: Path, tmp_path: Path) -> None:
    (tmp_path / "robots.csv").write_text("mine")
    with open_recording(file) as opened:
        with pytest.raises(RecordingError, match=r"robots\.csv: is there already"):
            export_csv(opened, tmp_path)
        with pytest.raises(RecordingError, match="cannot be written"):
            export_csv(opened, file / "folder")
    assert (tmp_path / "robots.csv").read_text() == "mine"
    assert not (tmp_path / "events.csv").exists()


def test_the_command(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["export", str(file), "--csv"]) == 0
    assert f"{tmp_path / 'run' / 'trajectories'}.csv: 4 rows" in capsys.readouterr().out
    assert cli.main(["export", str(file)]) == 2
    file.write_bytes(file.read_bytes()[:-1])
    assert cli.main(["export", str(file), "-o", str(tmp_path / "again")]) == 0
    assert "was cut off: its last second may be missing" in capsys.readouterr().err
    assert cli.main(["export", str(tmp_path / "nothing")]) == 2


def test_the_folder_of_a_run_means_its_recording(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"holds no recording \(\.mcap\)"):
        recording.files_of(tmp_path)
    one = tmp_path / "x.mcap"
    one.touch()
    assert recording.file_of(tmp_path) == one and recording.file_of(one) == one
    (tmp_path / "run-2").mkdir()
    other = tmp_path / "run-2" / "x.mcap"
    other.touch()
    assert set(recording.files_of(tmp_path)) == {one, other}
    with pytest.raises(UsageError, match="holds 2 recordings, such as "):
        recording.file_of(tmp_path)
