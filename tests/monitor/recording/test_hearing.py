"""Who heard whom, when, and what was lost: numbers worked out by hand, and a run's own."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.monitor.recording.conftest import BEGIN_NS, record
from vsense.base.arena import POSE, ArenaState
from vsense.base.message_bus import Message
from vsense.cli import main

EARS = {"name": "range_and_bearing", "count": 13, "range_m": 0.6, "view_rad": 3.2}
"""Three places of two bytes; it hears what is ahead."""
PLACES = {
    23: (0.0, 0.0, math.pi / 2),  # looks along +y
    24: (0.0, 0.5, 0.0),  # 0.5 m ahead of it: 0.43 m between bodies of 3.5 cm
    25: (-0.4, 0.0, 0.0),  # 0.4 m to its left
    26: (0.0, 0.7, 0.0),  # beyond its reach
    27: (0.0, -0.3, 0.0),  # behind it
    28: (-0.3, 0.05, 0.0),  # near, but is heard no farther than 0.2 m
}


def arena(at_ns: int, shift_m: float = 0.0) -> Message:
    robots = np.zeros(len(PLACES), dtype=POSE)
    for row, (tag, (x, y, yaw)) in zip(robots, PLACES.items()):
        row["tag"], row["x_m"], row["y_m"] = tag, x + shift_m, y
        row["yaw_rad"], row["seen"] = yaw, True
    return Message("/arena", at_ns, ArenaState(7, at_ns, robots, len(robots)).data())


def readings(at_ns: int, taken_ns: int, *messages: tuple[float, float]) -> Message:
    """What robot 23 heard, [cm] and [rad], in a sensor with three places."""
    places = [number for place in messages for number in (*place, 7.0, 9.0)]
    values = [len(messages), *places, *[0.0] * (12 - len(places))]
    data = {"timestep": 9, "capture_ns": at_ns, "tag": [23, 24]}
    data |= {"values": [[[0.5], values], [[0.5]]], "captured_ns": [[at_ns, taken_ns], [at_ns]]}
    return Message("/readings", at_ns, data)


def experiment() -> Message:
    ground, heard = {"name": "ground", "count": 1}, EARS | {"max_messages": 3}
    controllers = [
        {"id": "a", "tags": [23], "sensors": [ground, heard]},
        {"id": "b", "tags": [24, 25, 26, 27], "sensors": [ground]},
        {"id": "c", "tags": [28], "sensors": [ground], "said_range_m": 0.2},
    ]
    robots = [{"tag": tag, "name": str(tag), "radius_m": 0.035} for tag in PLACES]
    # No float holds such an integer, and JSON may have it.
    damaged = [{"tag": "damaged"}, {"tag": 99, "radius_m": 10**400}]
    data = {"controllers": controllers, "robots": [*damaged, *robots, {}]}
    return Message("/experiment", BEGIN_NS, data)


def table(folder: Path, name: str = "heard") -> list[dict[str, Any]]:
    with (folder / f"{name}.csv").open() as file:
        return list(csv.DictReader(file))


def test_senders_are_found_and_who_was_in_reach_and_not_heard(tmp_path: Path) -> None:
    later_ns = BEGIN_NS + 10**9
    messages = [
        experiment(),
        arena(BEGIN_NS + 10**8),
        # Everybody has driven on since the reading was taken: its own time counts.
        arena(later_ns, shift_m=3.0),
        readings(later_ns, BEGIN_NS + 10**8, (43.0, 0.0), (20.0, -1.0)),
        readings(later_ns, -1, (43.0, 0.0)),
    ]
    path = record(tmp_path / "run.mcap", messages)
    assert main(["export", str(path), "-o", str(tmp_path / "tables")]) == 0
    rows = table(tmp_path / "tables")
    assert [(r["tag"], r["sender"], r["heard"]) for r in rows] == [
        ("23", "24", "1"),
        ("23", "", "1"),  # nobody stands there
        ("23", "25", "0"),  # in reach, and not heard
    ]
    first, stranger, lost = rows
    assert float(first["distance_m"]) == pytest.approx(0.5)
    assert float(first["range_m"]) == pytest.approx(0.43) and float(first["bearing_rad"]) == 0.0
    assert float(first["age_s"]) == pytest.approx(0.9) and float(first["time_s"]) == 1.0
    assert stranger["distance_m"] == "" and float(stranger["range_m"]) == pytest.approx(0.2)
    assert float(lost["distance_m"]) == pytest.approx(0.4) and lost["range_m"] == ""


def test_tables_as_parquet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pip install vsense[tables]")
    at_ns = BEGIN_NS + 10**8
    path = record(
        tmp_path / "run.mcap", [experiment(), arena(at_ns), readings(at_ns, at_ns, (43.0, 0.0))]
    )
    folder = tmp_path / "tables"
    assert main(["export", str(path), "-o", str(folder), "--parquet"]) == 0
    assert f"{folder}/heard.parquet: 2 rows" in capsys.readouterr().out
    assert not list(folder.glob("*.csv"))
    rows = parquet.read_table(folder / "heard.parquet").to_pylist()
    assert [(row["sender"], row["heard"]) for row in rows] == [(24, 1), (25, 0)]
    assert rows[0]["range_m"] == pytest.approx(0.43) and rows[1]["range_m"] is None
    assert parquet.read_table(folder / "trajectories.parquet").num_rows == len(PLACES)
    assert main(["export", str(path), "--rosbag", str(tmp_path / "bag"), "--parquet"]) == 2
    assert "--parquet is for tables: --rosbag writes none" in capsys.readouterr().err


def test_texts_stay_texts_in_parquet(tmp_path: Path) -> None:
    """What looks like a number, a date or yes; and tables that are empty have their types."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="pip install vsense[tables]")
    texts = {"name": "007", "version": "1.10", "hash": "12e45678", "controller": "2026-11-28"}
    columns: dict[str, Any] = {name: [text] for name, text in texts.items()}
    robots = Message("/robots", BEGIN_NS, columns | {"tag": [7], "shown": [{"a": "true\n1"}]})
    event = Message("/event", BEGIN_NS, {"text": "NaN", "level": "info"})
    measures = {"timestep": 3, "measures": {"value": 2.5, "tag": 1.5}}
    signals = Message("/signals", BEGIN_NS, measures)
    path = record(tmp_path / "run.mcap", [experiment(), robots, event, signals])
    assert main(["export", str(path), "-o", str(tmp_path / "tables"), "--parquet"]) == 0
    read = {p.stem: parquet.read_table(p) for p in (tmp_path / "tables").glob("*.parquet")}
    (row,) = read["robots"].to_pylist()
    assert {name: row[name] for name in texts} == texts and row["battery_mv"] is None
    assert read["measures"].to_pylist() == [
        {"time_s": 0.0, "timestep": 3, "value": 2.5, "tag": 1.5}
    ]
    assert read["shown"].to_pylist()[0]["value"] == "true\n1"
    assert read["events"].to_pylist()[0]["text"] == "NaN"
    assert str(read["heard"].schema.field("sender").type) == "int64"
    assert str(read["robots"].schema.field("battery_mv").type) == "double"


def test_what_a_simulated_run_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that stand still, and a sensor that loses three messages of ten by chance."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stand.lua").write_text("function init() end\nfunction step() end\n")
    (tmp_path / "talk.argos").write_text(TALK)
    assert main(["sim", "talk.argos", "--record", "--output", "run"]) == 0
    assert main(["export", "run", "-o", "tables"]) == 0
    rows = table(tmp_path / "tables")
    assert {(r["tag"], r["sender"]) for r in rows} == {("1", "2"), ("2", "1")}
    heard = [float(r["range_m"]) for r in rows if r["heard"] == "1"]
    # 30 cm between the middles, less two radii of 3.5 cm.
    assert heard == pytest.approx([0.23] * len(heard), abs=1e-3)
    share = len(heard) / len(rows)
    # 600 messages: four standard deviations of a share of 0.7.
    assert len(rows) > 500 and share == pytest.approx(0.7, abs=4 * math.sqrt(0.21 / len(rows)))


def test_what_foot_bots_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their radio reaches 3 m and carries 10 bytes; a file of ARGoS need not say so."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stand.lua").write_text("function init() end\nfunction step() end\n")
    text = TALK.replace(
        'virtual_range_and_bearing_sensor implementation="default" range="0.8"', RAB
    )
    text = text.replace("e-puck", "foot-bot").replace("0.3,0,0", "1.3,0.5,0")
    text = text.replace("<arena", '<media><range_and_bearing id="rab" /></media><arena')
    (tmp_path / "talk.argos").write_text(text.replace("loss_probability", "packet_drop_prob"))
    assert main(["sim", "talk.argos", "--record", "--output", "run"]) == 0
    assert main(["export", "run", "-o", "tables"]) == 0
    rows = table(tmp_path / "tables")
    assert {(r["tag"], r["sender"]) for r in rows} == {("1", "2"), ("2", "1")}
    heard = [float(r["range_m"]) for r in rows if r["heard"] == "1"]
    # Less twice the radius of a foot-bot, footbot_entity.cpp: 0.085036758.
    far_m = math.hypot(1.3, 0.5) - 2.0 * 0.085036758
    assert heard == pytest.approx([far_m] * len(heard), abs=1e-3)
    assert 0.6 * len(rows) < len(heard) < 0.8 * len(rows)


RAB = 'range_and_bearing medium="rab" implementation="medium"'
TALK = """<argos-configuration xmlns:vs="urn:vsense:1">
<framework><experiment length="30" ticks_per_second="10" random_seed="3" /></framework>
<controllers><lua_controller id="a"><actuators><differential_steering implementation="default" />
</actuators><sensors><virtual_range_and_bearing_sensor implementation="default" range="0.8"
loss_probability="0.3" /></sensors><params script="stand.lua" /></lua_controller></controllers>
<arena size="3, 3, 1" center="0,0,0.5">
<e-puck id="e_1_0"><body position="0,0,0" orientation="0,0,0" /><controller config="a" /></e-puck>
<e-puck id="e_2_0"><body position="0.3,0,0" orientation="9,0,0" /><controller config="a" /></e-puck>
</arena></argos-configuration>"""
