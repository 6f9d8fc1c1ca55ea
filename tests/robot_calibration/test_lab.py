"""The whole way: rendered cameras, real daemons, the command, and a roster."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from vsense.cli import main
from vsense.commands.hardware import markers_of
from vsense.config import roster


def test_what_is_wrong_is_said_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    calls = {
        "foraging": "names no tracker",
        "foraging --lab --tracking a b": "expected no --tracking",
        "foraging --lab --roster none.toml": "none.toml",
        "foraging --lab --marker-errors 4": "expected mm and degrees, such as 4,5",
        "foraging --lab --wheel-errors 50": "expected a percentage from 0 to 9",
        "foraging --lab --pace 2": "expected 0.01 to 1",
    }
    for words, text in calls.items():
        try:
            code = main(["robot", "calibrate", *words.split()])
        except SystemExit as end:
            code = end.code
        assert code == 2, words
        assert text in capsys.readouterr().err, words


def test_a_roster_in_this_folder_says_where_markers_sit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from argparse import Namespace

    monkeypatch.chdir(tmp_path)
    assert markers_of(Namespace(roster=None)) == {}
    Path("robots.toml").write_text(
        "[[robot]]\ntag = 23\n[robot.marker]\nx_mm = 1.5\nyaw_deg = 90\n"
    )
    (marker,) = markers_of(Namespace(roster=None)).values()
    assert (marker.x_m, marker.y_m) == (0.0015, 0.0)


@pytest.mark.campaign
def test_calibrating_twice_finds_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    robots = tmp_path / "robots.toml"
    robots.write_text('# mine\n[[robot]]\ntag = 31\nname = "first"\n\n[[robot]]\ntag = 1843\n')
    words = "robot calibrate foraging --lab --robots 2 --roster robots.toml --pace 0.5 -o"
    for number in (1, 2):
        assert main([*words.split(), f"out{number}"]) == 0
        told = json.loads((tmp_path / f"out{number}" / "calibration.json").read_text())
        worst = told["worst_errors"]
        assert worst["marker_mm"] < 1.0 and worst["marker_deg"] < 0.5
        assert worst["distance"] < 0.01 and worst["turn"] < 0.01
    # The second time the daemons were told what the first has found.
    for robot in told["robots"]:
        assert robot["over_roster"] == pytest.approx(
            dict.fromkeys(robot["over_roster"], 1.0), abs=0.005
        )
        assert len(robot["over_roster"]) == 3
    assert robots.read_text().startswith("# mine\n")
    assert roster.read(robots).markers.keys() == {31, 1843}
