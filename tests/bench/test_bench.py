"""The benchmark: its report, its judge, and its pictures. No time is asserted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.bench import identity, main, tracking, whole_tracker
from tests.bench.contestants import FoundTags, Single, crossing
from tests.bench.frames import FrameSet, FrameTruth, Painter, cameras

RIG = cameras(1, 1)


def frame_set(truth: FrameTruth) -> FrameSet:
    image = np.zeros((8, 8), dtype=np.uint8)
    return FrameSet("test", "arrow4x4", (1, 2, 3), RIG, (image,), (truth,))


def test_the_judge_counts_what_is_named_where_it_is() -> None:
    truth = FrameTruth(np.array([1, 2, 3]), np.array([(10.0, 10.0), (50.0, 50.0), (90.0, 90.0)]))
    found = FoundTags(np.array([1, 2, 7]), np.array([(10.3, 10.4), (90.0, 90.0), (5.0, 5.0)]))
    contestant = Single("somebody", frame_set(truth), lambda image, camera: found)
    _, seen = contestant.run()
    row = tracking.judge(contestant, [2.0, 3.0, 10.0], seen)
    assert row.ms_per_frame == 3.0 and (row.wrong_ids, row.false_ids) == (1, 1)
    assert row.detected_share == pytest.approx(1 / 3)
    assert row.position_rms_px == pytest.approx(0.5)


def test_diagonals_cross_in_the_middle_of_a_perspective_square() -> None:
    corners = np.array([[(0.0, 0.0), (4.0, 0.0), (3.0, 2.0), (1.0, 2.0)]])
    assert crossing(corners)[0] == pytest.approx((2.0, 4.0 / 3.0))


@pytest.mark.parametrize("family", ["arrow4x4", "aruco_4x4_50", "apriltag_36h11"])
def test_all_families_stand_at_the_same_places(family: str) -> None:
    tags = (3, 5, 7)
    shots = Painter("one", family, tags, RIG).crowds(1)
    arrows = Painter("two", "arrow4x4", tags, RIG).crowds(1)
    assert shots.truth[0].centres_px.tolist() == arrows.truth[0].centres_px.tolist()
    for x, y in np.rint(shots.truth[0].centres_px).astype(int):
        window = shots.images[0][y - 20 : y + 21, x - 20 : x + 21]
        assert window.max() - window.min() > 60


def test_moving_robots_drive_and_never_touch() -> None:
    walk = Painter("walk", "arrow4x4", (1, 2, 3, 4), RIG).walk(6)
    places = np.array([truth.centres_px for truth in walk.truth])
    steps = np.hypot(*np.moveaxis(np.diff(places, axis=0), -1, 0))
    assert steps.max() < 7.0 and (steps > 1.0).any()


def test_what_is_not_said_is_as_the_help_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr(tracking, "run", lambda *given: {"asked": asked.append(given[:-1])})
    monkeypatch.setattr(identity, "run", lambda *given: {"asked": asked.append(given[:-1])})
    assert main.main(["tracking", "--json"]) == 0
    assert main.main(["identity", "--json"]) == 0
    assert asked == [(5, 8, 60), (2500,)]


def test_the_report_is_as_promised(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name in ((whole_tracker, "CAMERAS"), (tracking, "RIG")):
        monkeypatch.setattr(module, name, (2, 1))  # rendering 16 takes a while
    words = ["tracking", "--json", "--rounds", "1", "--pictures", "1", "--walk", "3"]
    assert main.main(words) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    names = {"detector", "frames", "threads", "ms_per_frame", "detected_share", "wrong_ids"}
    names |= {"false_ids", "position_rms_px"}
    assert all(set(row) == names for row in report["rows"])
    mine = [row for row in report["rows"] if row["detector"].startswith("vsense")]
    assert all(
        row["detected_share"] == 1.0 and row["wrong_ids"] == row["false_ids"] == 0 for row in mine
    )
    assert {row["threads"] for row in report["rows"]} == {1, 2}
    assert sum("key frame" in row["detector"] for row in report["rows"]) == 6
    assert report["floor_ms"] > 0.0 and report["ratio_to_aruco"] > 1.0
    assert set(report["set16"]) == {"threads", "ms", "times_floor"}
    assert report["set16"]["threads"] == 2
    assert set(report["squares"]) == {"DICT_4X4_50", "DICT_APRILTAG_36h11"}
    for squares in report["squares"].values():
        named = {"ms_per_frame", "ratio_to_aruco", "ratio_to_aruco_fastest", "ratio_to_apriltag"}
        assert set(squares) == named
        assert squares["ms_per_frame"] > 0.0 and squares["ratio_to_aruco"] > 1.0
    whole = report["whole_tracker"]
    assert 0.0 < whole["c_share"] < 1.0 and whole["named_share"] > 0.99
    assert min(whole["arrows_ms"], whole["squares_ms"]) > 0.0
    assert "round 1 of 1" in captured.err
    assert "16 cameras" in tracking.table(report)


@pytest.mark.parametrize(
    "words",
    [
        ("identity", "--walk", "6"),
        ("world", "--device", "1"),
        ("world", "--pictures", "3"),
        ("robot", "--rounds", "2"),
        ("identity", "--timesteps", "0"),
        ("nothing",),
        (),
    ],
)
def test_an_option_of_another_subject_is_refused(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main.main(list(words))
    assert ended.value.code == 2
    assert "scripts/bench" in capsys.readouterr().err
