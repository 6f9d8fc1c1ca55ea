"""The whole way: rendered cameras, real daemons, the command, and a roster."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.rigs.processes import free_port
from vsense.cli import main
from vsense.commands._hardware import markers_of
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
        "foraging --lab --white 0,0": "--white is for ground sensors",
        "foraging --lab --sensors light": "expected proximity or ground",
        "foraging --lab --sensors ground --black -0.5,-0.8": "expected --base gctronic or york",
        "foraging --lab --base york --sensors ground": "no picture on its floor",
        "foraging --lab --base york --sensors ground --white 1 --black 0,0": "such as 0.5,-0.8",
        "foraging --lab --base york --sensors ground --white 0,0 --black 9,-9": "got -",
        "foraging --lab --sensors proximity --wall none": "expected one of wall_north, wall_south",
        "foraging --lab --sensor-errors 60": "expected a percentage from 0 to 50",
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


REAL = """<argos-configuration xmlns:vs="urn:vsense:1">
<framework>
  <experiment length="9" ticks_per_second="10" vss_host="127.0.0.1" vss_port="4050" />
  <vs:tracker format="lines" port="%d" />
</framework>
<controllers>
  <calibrate_controller id="c" library="calibrate">
    <actuators><epuck_wheels implementation="default" /></actuators>
    <sensors><epuck_proximity implementation="default" /></sensors>
    <params />
  </calibrate_controller>
</controllers>
<arena size="1,1,1" center="0,0,0.5">
  <e-puck id="one" vs:tag="23"><body position="0,0,0" orientation="0,0,0" />
    <controller config="c" /></e-puck>
</arena>
</argos-configuration>"""


def test_real_robots_of_which_none_is_there_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The way with cameras that are not the lab's, and with no tracker: it ends, and says why."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "real.argos").write_text(REAL % free_port())
    words = "robot calibrate real.argos --insecure --port 0 --wait 1 --sensors proximity"
    assert main(words.split()) == 2
    assert "expected a <box> with vs:physical='true'" in capsys.readouterr().err
    assert main(words.split()[:-2]) == 1
    assert "no robot can be calibrated: not connected: 23" in capsys.readouterr().err


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


@pytest.mark.campaign
def test_sensors_are_found_again_by_who_was_told_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robots = tmp_path / "robots.toml"
    robots.write_text("[[robot]]\ntag = 31\n")
    words = "robot calibrate foraging --lab --robots 1 --base gctronic --sensors proximity,ground"
    words += " --white 0.3,0.75 --black -0.3,0.75 --roster robots.toml --pace 0.5 -o"
    for number in (1, 2):
        assert main([*words.split(), f"out{number}"]) == 0
        told = json.loads((tmp_path / f"out{number}" / "calibration.json").read_text())
        worst = told["worst_errors"]
        assert worst["proximity_low"] < 4.0 and worst["proximity_width"] < 0.03
        assert worst["ground_low"] < 4.0 and worst["ground_width"] < 0.01
    # The second time its daemon was told what the first has found.
    (robot,) = told["robots"]
    again = {name: robot["over_roster"][name] for name in ("proximity_scale", "ground_scale")}
    assert again == pytest.approx(dict.fromkeys(again, 1.0), abs=0.03)
