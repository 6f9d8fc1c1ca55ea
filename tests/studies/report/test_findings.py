"""The figures of a recording against what can be worked out by hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.studies.report.runs import (
    BEGIN_NS,
    BLINKER,
    DRIVER,
    POLLUTER,
    STEP_M,
    STEP_NS,
    STRANGER,
    TIMESTEPS,
    ZERO_NS,
    arena,
    messages,
    write,
    write_cut_off,
)
from vsense.base.message_bus import Message
from vsense.monitor.recording import IN_CONE, LIT_IN_CONE
from vsense.monitor.recording.form import RecordingError
from vsense.studies.report._findings import Findings, as_json, read_findings
from vsense.studies.report._flow import FINE, LOST, STOPPED, UNSEEN, Strips
from vsense.studies.report._gather import (
    MAP_CELL_M,
    MOST_POINTS,
    Gatherer,
    RobotTrack,
)
from vsense.studies.report.report import make_report


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    folder = tmp_path_factory.mktemp("found")
    return read_findings(write(folder / "run.mcap", messages()))


def test_the_run_is_what_counts(found: Findings) -> None:
    assert found.zero_ns == ZERO_NS
    assert found.run_s == pytest.approx(2.0)
    assert (found.gathered.flow.lived, found.gathered.flow.missed) == (TIMESTEPS - 1, 1)
    assert found.label == "hand, lab, seed 1"
    assert found.complete and not found.damaged and not found.lacks and not found.gathered.odd
    assert found.gathered.late == 4


def test_robots_distances_speeds_and_shares(found: Findings) -> None:
    driver, blinker = found.robots
    assert (driver.tag, driver.name) == (DRIVER, "driver")
    assert driver.distance_m == pytest.approx(STEP_M * (TIMESTEPS - 1))
    assert driver.speed_m_s == pytest.approx(STEP_M / 0.1)
    assert driver.seen == 1.0 and driver.longest_unseen_s == pytest.approx(0.2)
    assert blinker.distance_m == 0.0 and blinker.speed_m_s == 0.0, "trembling is no driving"
    assert blinker.seen == pytest.approx(7 / 19), "timesteps 0 to 2 and 16 to 19 of 19"
    assert blinker.longest_unseen_s == pytest.approx(1.4)


def test_robots_links_stops_and_batteries(found: Findings) -> None:
    driver, blinker = found.robots
    assert (driver.connected, driver.losses) == (1.0, 0)
    assert blinker.connected == pytest.approx(16 / 19) and blinker.losses == 1
    assert driver.stops == {"what it hears is too old": 2} and not blinker.stops
    assert driver.battery_mv == 4000 - 19 and blinker.battery_mv is None
    assert driver.base_errors == 19.0
    assert (driver.signal_dbm, driver.silent_ms) == (-79.0, 40.0)
    assert (blinker.signal_dbm, blinker.silent_ms) == (None, 1700.0)


def test_who_played_which_part_and_from_when_on(found: Findings) -> None:
    told = [(row.part, row.tag, row.uid, row.time_ns) for row in found.gathered.parts]
    assert told == [
        (DRIVER, DRIVER, "a1", BEGIN_NS),
        (BLINKER, BLINKER, "b2", BEGIN_NS + 1),
    ], "who has not come yet is nobody, and the same again is no news"
    handed = Message(
        *("/parts", ZERO_NS),
        {"part": [DRIVER], "name": ["driver"], "tag": [37], "uid": ["c3"], "run": 2},
    )
    gatherer = Gatherer(found.gathered.facts)
    for message in (*messages(), handed, handed):
        if message.topic == "/parts":
            gatherer.receive(message)
    assert [(row.part, row.tag) for row in gatherer.parts][2:] == [(DRIVER, 37)]
    gatherer.receive(Message("/parts", ZERO_NS, {"part": "x"}))
    assert gatherer.odd == 1


@pytest.mark.parametrize(
    ("capture_ns", "odd"),
    [(-(2**62) + 1, 0), (2**62, 1), (2**63, 1), (-(2**63) - 1, 1), (2**64, 1)],
)
def test_times_that_no_clock_of_a_host_shows_are_left_out(
    found: Findings, capture_ns: int, odd: int
) -> None:
    """As of a clock that has wrapped: all else of the recording is read, and no array overflows."""
    gatherer = Gatherer(found.gathered.facts)
    for number, time_ns in enumerate((ZERO_NS, capture_ns, ZERO_NS + STEP_NS)):
        gatherer.receive(Message("/arena", ZERO_NS, arena(number, time_ns)))
    assert (gatherer.odd, gatherer.flow.lived) == (odd, 3 - odd)


def test_measures(found: Findings) -> None:
    times, values = found.gathered.measures["items_home"]
    assert np.allclose(times, [0.1 * n for n in range(20) if n != 8])
    expected = {"end": 19.0, "mean": (190 - 8) / 19, "min": 0.0, "max": 19.0}
    assert found.measures["items_home"] == pytest.approx(expected)
    assert list(values) == [float(n) for n in range(20) if n != 8]
    assert "odd" not in found.measures, "what is no number is left out"


def test_robots_in_the_cone_are_counted(found: Findings) -> None:
    # The driver is in the cone from x = -0.3 m to 0: timesteps 8 to 19. It is lit from timestep 10
    # on, which is known one timestep later.
    assert list(found.gathered.measures[IN_CONE][1]) == [0.0] * 8 + [1.0] * 11
    assert list(found.gathered.measures[LIT_IN_CONE][1]) == [0.0] * 10 + [1.0] * 9


def test_latency(found: Findings) -> None:
    expected = {"p50_ms": 19.0, "p95_ms": 27.1, "p99_ms": 27.82, "mean_ms": 19.0, "max_ms": 28.0}
    assert found.latency == pytest.approx(expected)


def test_occupancy_and_objects(found: Findings) -> None:
    tracks = found.gathered.tracks
    assert sum(tracks.cells.values()) == 19 + 7
    assert tracks.cells[round(0.5 / MAP_CELL_M), -2] == 7
    assert tracks.objects_m.keys() == {POLLUTER, STRANGER}
    assert tracks.of.keys() == {DRIVER, BLINKER}


def test_health_over_time(found: Findings) -> None:
    tags, table = found.gathered.strips.table()
    assert tags == [DRIVER, BLINKER]
    # Half a second each; the blinker was not seen from timestep 3 to 15 and lost from 5 to 7.
    assert table.tolist() == [[FINE, FINE, STOPPED, FINE], [UNSEEN, LOST, UNSEEN, UNSEEN]]


def test_what_went_wrong(found: Findings) -> None:
    loss, camera = sorted(found.incidents, key=lambda one: one.kind, reverse=True)
    assert (loss.kind, loss.text) == ("no link", "robot blinker")
    assert loss.from_s == pytest.approx(0.515, abs=0.001)
    assert loss.to_s == pytest.approx(0.9 + 0.018, abs=0.001), "timestep 8 was missed"
    assert (camera.kind, camera.text, camera.to_s) == ("camera", "camera cam: it is dark", None)


def test_silences_and_gaps(tmp_path: Path) -> None:
    late_ns = ZERO_NS + 30 * STEP_NS
    gap = {
        "from_ns": late_ns + STEP_NS,
        "to_ns": late_ns + 20 * STEP_NS,
        "messages": 7,
        "pictures": 0,
        "why": "the disk was full",
    }
    sent = [
        *messages(),
        Message("/arena", late_ns, arena(30, late_ns)),
        Message("/gap", gap["to_ns"], gap),
        Message("/arena", gap["to_ns"], arena(50, gap["to_ns"])),
    ]
    found = read_findings(write(tmp_path / "run.mcap", sent))
    silence, lost = [one for one in found.incidents if one.kind in ("silence", "not recorded")]
    assert (silence.from_s, silence.to_s) == pytest.approx((1.9, 3.0))
    assert (lost.from_s, lost.to_s) == pytest.approx((3.1, 5.0)), "and it is no silence, too"
    assert lost.text == "7 messages, 0 pictures: the disk was full"
    (words,) = as_json(found)["lacking"]
    assert words.endswith("lacks 7 messages and 0 pictures of 1.9 s: the disk was full")
    made = make_report([found.path], tmp_path / "report")
    assert list(made.warnings()) == [words]
    assert words in made.files[0].read_text(), "at the page's top"


def test_a_pause_is_not_driven_through(tmp_path: Path) -> None:
    def moved(timestep: int, capture: int, run_timestep: int, x_m: float) -> Message:
        data = arena(timestep, capture)
        data["run_timestep"] = run_timestep
        data["robots"]["x_m"][0] = x_m
        return Message("/arena", capture, data)

    sent = [
        moved(n, BEGIN_NS + n * STEP_NS, n if n < 3 else n - 3 if n >= 6 else -1, 0.01 * n)
        for n in range(9)
    ]
    found = read_findings(write(tmp_path / "run.mcap", sent))
    assert found.gathered.flow.lived == 6 and found.gathered.flow.missed == 0
    assert found.robots[0].distance_m == pytest.approx(0.04), "twice two moves of 1 cm"
    assert not found.incidents


def test_without_a_run_everything_counts(tmp_path: Path) -> None:
    sent = [
        Message(message.topic, message.time_ns, {**message.data, "run_timestep": -1})
        for message in messages()
        if message.topic == "/arena"
    ]
    found = read_findings(write(tmp_path / "run.mcap", sent))
    assert not found.gathered.ran and found.gathered.flow.lived == 21
    assert found.zero_ns == ZERO_NS - 2 * STEP_NS
    assert {row.tag for row in found.robots} == {DRIVER, BLINKER, POLLUTER, STRANGER}


def test_a_cut_off_recording_says_so_and_works(tmp_path: Path) -> None:
    found = read_findings(write_cut_off(tmp_path / "run.mcap", messages()))
    assert not found.complete
    assert found.gathered.flow.lived == TIMESTEPS - 1
    assert found.gathered.state == "", "its last message was cut off"


@pytest.mark.parametrize("sent", [[], [Message("/picture/cam", BEGIN_NS, {"camera": "cam"}, b"x")]])
def test_a_recording_of_nothing_is_refused(tmp_path: Path, sent: list[Message]) -> None:
    with pytest.raises(RecordingError, match="holds nothing that a report could show"):
        read_findings(write(tmp_path / "run.mcap", sent))


def test_figures_are_json(found: Findings) -> None:
    told = json.loads(json.dumps(as_json(found), allow_nan=False))
    assert told["robots"][0]["distance_m"] == pytest.approx(STEP_M * (TIMESTEPS - 1))
    assert told["latency"]["p50_ms"] == pytest.approx(19.0)
    assert told["cameras"] == {"cam": {"rate_hz": 10.0, "dropped": 2}}
    assert (told["missed_timesteps"], told["complete"], told["events"]) == (1, True, 1)


def test_a_long_way_stays_small_and_true() -> None:
    track = RobotTrack()
    angles = np.linspace(0.0, 400.0 * np.pi, 120_000)
    for place, angle in enumerate(angles):
        track.add(place * STEP_NS, float(np.cos(angle)), float(np.sin(angle)))
    points = track.points_m
    assert len(points) <= MOST_POINTS + 2
    assert np.allclose(np.hypot(*points.T), 1.0)
    assert track.distance_m == pytest.approx(400.0 * np.pi, rel=1e-3)


def test_health_of_a_long_run_stays_small() -> None:
    strips = Strips(STEP_NS)
    for step in range(20_000):
        strips.add(step * STEP_NS, {1: STOPPED if step == 12_345 else FINE})
    _, table = strips.table()
    assert table.shape[1] <= 1024 and strips.bin_ns == 20 * STEP_NS
    assert np.flatnonzero(table[0] == STOPPED).tolist() == [12_345 // 20]
