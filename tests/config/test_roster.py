"""Rosters: read, refused with file, line and value, and written with people's comments kept."""

from __future__ import annotations

import math
import multiprocessing
from pathlib import Path

import pytest

from vsense.base.errors import ConfigError, UsageError
from vsense.config import roster
from vsense.config.roster_fields import MarkerOffset

LAB = """# our lab
[defaults]
base = "argos:/dev/ttyS0"   # all Overos
battery_stop_mv = 3400

[[robot]]          # the good one
tag = 23
host = "root@192.168.1.30"
uid = "0F3A0000000000000000000000000001"
name = "left"
[robot.calibration]
wheel_diameter_mm = 40.8  # with a tape
wheel_ratio = 1.004
ground_scale = "210:880, 200:900, 230:910"
when = 2026-11-23
[robot.marker]
x_mm = 1.5
y_mm = -0.7
yaw_deg = 2.1

# bought in May
[[robot]]
tag = 24
host = "pi@192.168.1.31"
base = "pipuck,ground"
run_host = "192.168.1.10"
spare = true

[[robot]]
tag = 25
host = "root@192.168.1.32"
out_of_order = "left motor stalls"
# the end
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    path = tmp_path / roster.FILE_NAME
    path.write_text(LAB)
    return path


def test_a_roster_is_read(lab: Path) -> None:
    found = roster.read(lab)
    left, spare, broken = found.robots
    assert found.tags == (23, 24, 25) and [robot.line for robot in found.robots] == [6, 22, 29]
    assert (left.host, left.name, left.base) == ("root@192.168.1.30", "left", "argos:/dev/ttyS0")
    assert left.uid == "0f3a0000000000000000000000000001"
    assert found.get(24) is spare and found.get(1) is None
    assert [robot.is_ready for robot in found.robots] == [True, False, False]
    assert spare.board == {
        "base": "pipuck,ground",
        "run_host": "192.168.1.10",
        "battery_stop_mv": "3400",
    }
    assert broken.out_of_order == "left motor stalls" and str(broken) == "robot 25"
    assert str(left) == "robot 23 (left)"


def test_what_was_measured_becomes_settings_and_si(lab: Path) -> None:
    left = roster.read(lab).robots[0]
    assert left.calibration.settings == {
        "wheel-diameter": "40.8",
        "wheel-ratio": "1.004",
        "ground-scale": "210:880,200:900,230:910",
    }
    assert left.calibration.when == "2026-11-23"
    assert left.marker == MarkerOffset(0.0015, -0.0007, math.radians(2.1))
    assert left.marker.values == {"x_mm": 1.5, "y_mm": -0.7, "yaw_deg": 2.1}
    assert roster.read(lab).markers == {23: left.marker}


ROBOT = '[[robot]]\ntag = 1\nhost = "a"\n'


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("[[robot]]\n", 1, "this robot has no tag: expected tag = 0..65535"),
        (
            "[[robot]]\n\ntag = 70000\n",
            3,
            "tag: expected a whole number from 0 to 65535; got 70000",
        ),
        ("[[robot]]\ntag = true\n", 2, "tag: expected a whole number"),
        ('[[robot]]\ntag = "23"\n', 2, "tag: expected a whole number from 0 to 65535; got '23'"),
        (f"{ROBOT}speed = 3\n", 4, "'speed' is not known in [[robot]]; is 'spare'"),
        (f"{ROBOT}outoforder = 'x'\n", 4, "'outoforder' is not known in [[robot]]; is 'out_of_o"),
        (
            f"{ROBOT}x_mm = 1\n",
            4,
            "'x_mm' is not known in [[robot]]; it stands in [robot.marker]",
        ),
        (f"{ROBOT}spare = 1\n", 4, "spare: expected true or false; got 1"),
        (f"{ROBOT}out_of_order = ''\n", 4, "out_of_order: expected why in a line, such as"),
        (f"{ROBOT}name = '$(reboot)'\n", 4, "name: expected a text without blanks of at most 31"),
        (f"{ROBOT}uid = 'ab'\n", 4, "uid: expected the 32 hexadecimal digits of"),
        (f"{ROBOT}run_host = 'lab'\n", 4, "run_host: expected a numeric IPv4 address"),
        ("[[robot]]\ntag = 1\nhost = '-oProxyCommand=x'\n", 3, "host: expected [user@]host"),
        ("[[robot]]\ntag = 1\nhost = 'a;b'\n", 3, "host: expected [user@]host for ssh"),
        (f"{ROBOT}[robot.marker]\nx_m = 1\n", 5, "'x_m' is not known in [robot.marker]; is"),
        (f"{ROBOT}[robot.marker]\n\nx_mm = 70\n", 6, "x_mm: expected a number from -50 to 50 mm"),
        (f"{ROBOT}marker = {{ y_mm = nan }}\n", 4, "y_mm: expected a number from -50 to 50 mm"),
        (f"{ROBOT}marker = 3\n", 4, "expected a table [robot.marker]; got 3"),
        (
            f"{ROBOT}[robot.calibration]\nwheel_ratio = 2\n",
            5,
            "wheel_ratio: expected a number from",
        ),
        (f"{ROBOT}calibration.when = 'May'\n", 4, "when: expected a day, such as"),
        (
            f"{ROBOT}calibration.light_scale = '3:9'\n",
            4,
            "light_scale: expected 1 or 8 DARK:BRIGHT",
        ),
        *(
            (f"{ROBOT}calibration.{name} = '{span}'\n", 4, f"{name}: expected 1 or {count} ")
            for name, span, count in (
                ("proximity_scale", "80:4097", 8),
                ("light_scale", "80:4097", 8),
                ("light_scale", "-4097:80", 8),
                ("ground_scale", "80:1024", 3),
            )
        ),
        (f"{ROBOT}[robot.motor]\n", 4, "'motor' is not known in [[robot]]; "),
        (
            "[default]\n[[robot]]\ntag = 1\n",
            1,
            "'default' is not known in this file; is 'defaults' meant?",
        ),
        ("[defaults]\ntag = 3\n[[robot]]\ntag = 1\n", 2, "'tag' is not known in [defaults];"),
        ("[robot]\ntag = 1\n", 1, "robot: expected a table [[robot]] for each robot"),
        (f"{ROBOT}[[robot]]\ntag = 1\n", 4, "tag 1 is that of the robot in line 1, too"),
        (f"{ROBOT}[[robot]]\ntag = 2\nhost = 'a'\n", 4, "host a is that of the robot in line 1"),
        (f"{ROBOT}tag = 2\n", 4, 'Key "tag" already exists'),
        (f"{ROBOT}base = 'exec:'\n", 4, "base: expected a base of vsensed"),
        (f"{ROBOT}base = argos\n", 4, "Unexpected character"),
        (f"x = {'[' * 5000}", 1, "expected TOML"),
        ("robot = 3\n", 1, "expected a table [[robot]] for each robot; got 3"),
    ],
)
def test_rosters_that_are_wrong(tmp_path: Path, text: str, line: int, words: str) -> None:
    path = tmp_path / roster.FILE_NAME
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        roster.read(path)
    said = str(caught.value)
    assert said.startswith(f"{path}:{line}: ") and words in said


def test_a_list_of_lines_is_told_how_it_is_written_now(tmp_path: Path) -> None:
    path = tmp_path / "robots.txt"
    path.write_text("# ours\nroot@192.168.1.30  tag=23  base=overo # the left one\n")
    with pytest.raises(ConfigError, match=r"robots.txt:2:.*tag = 23"):
        roster.read(path)


@pytest.mark.parametrize("text", ["", "# none\n", "[defaults]\nport = 1\n", "robot = []\n"])
def test_a_roster_without_robots(tmp_path: Path, text: str) -> None:
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(UsageError, match=r"\[\[robot\]\]"):
        roster.read(tmp_path / "r.toml")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="No such file"):
        roster.read(tmp_path / "r.toml")
    with pytest.raises(UsageError, match="No such file"):
        roster.update(tmp_path / "r.toml", {})
    (tmp_path / "r.toml").write_bytes(b"\xff")
    with pytest.raises(UsageError, match="it is no text"):
        roster.read(tmp_path / "r.toml")


def test_what_is_measured_is_written_and_comments_stay(lab: Path) -> None:
    lab.chmod(0o640)
    change = {
        23: {"calibration.wheel_diameter_mm": 40.91, "calibration.axle_length_mm": 53.2},
        24: {"marker.x_mm": 1.25, "uid": "ab" * 16},
        25: {"out_of_order": None, "calibration.when": "2026-11-24"},
    }
    after = roster.update(lab, change)
    assert roster.read(lab) == after
    assert after.robots[0].calibration.settings["axle-length"] == "53.2"
    assert after.robots[1].marker == MarkerOffset(0.00125)
    assert after.robots[2].is_ready
    assert lab.stat().st_mode & 0o777 == 0o640
    assert [entry.name for entry in lab.parent.iterdir()] == [lab.name]
    new = {
        *("wheel_diameter_mm = 40.91  # with a tape", "axle_length_mm = 53.2"),
        *("[robot.marker]", "x_mm = 1.25", f'uid = "{"ab" * 16}"'),
        *("[robot.calibration]", 'when = "2026-11-24"', ""),
    }
    before, now = LAB.splitlines(), lab.read_text().splitlines()
    assert {*now} - {*before} <= new
    assert {*before} - {*now} == {
        "wheel_diameter_mm = 40.8  # with a tape",
        'out_of_order = "left motor stalls"',
    }
    # A remark stays before the robot that it is about.
    assert now[now.index("# bought in May") + 1] == "[[robot]]" and now[-1] == "# the end"


@pytest.mark.parametrize(
    "text",
    ["robot = [{tag = 1}, {tag = 2}]\n", '[[robot]]\ntag = 1\nmarker = {y_mm = 1}\nuid = ""\n'],
)
def test_tables_in_a_line_are_written_too(tmp_path: Path, text: str) -> None:
    path = tmp_path / "r.toml"
    path.write_text(text.replace('uid = ""\n', ""))
    after = roster.update(path, {1: {"marker.x_mm": 1.0, "calibration.wheel_ratio": 1.01}})
    assert after.robots[0].calibration.wheel_ratio == 1.01
    assert after.robots[0].marker is not None and after.robots[0].marker.x_m == 0.001


def test_nothing_wrong_is_ever_written(lab: Path) -> None:
    with pytest.raises(ConfigError, match=r"wheel_ratio:.*number"):
        roster.update(lab, {23: {"calibration.wheel_ratio": 3.0}})
    with pytest.raises(UsageError, match=r"robot.*tag 7"):
        roster.update(lab, {7: {"spare": True}})
    assert lab.read_text() == LAB


def test_a_link_to_a_roster_stays_one(lab: Path) -> None:
    link = lab.with_name("link.toml")
    link.symlink_to(lab.name)
    roster.update(link, {25: {"spare": True}})
    assert link.is_symlink() and roster.read(lab).robots[2].spare


def _write_many(path: Path, tag: int) -> None:
    for number in range(10):
        roster.update(
            path, {tag: {"marker.x_mm": float(number), f"marker.{'xy'[number % 2]}_mm": 9}}
        )


def test_writers_wait_for_each_other(lab: Path) -> None:
    context = multiprocessing.get_context("fork")
    writers = [context.Process(target=_write_many, args=(lab, tag)) for tag in (23, 24, 25)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0, 0]
    places = [robot.marker for robot in roster.read(lab).robots]
    assert all(m is not None and (m.x_m, m.y_m) == (0.009, 0.009) for m in places)


BLIND = """[body]
radius_m = 0.08
height_m = 0.05
marker_height_m = 0.06
mass_kg = 0.2
[wheels]
axle_m = 0.094
diameter_m = 0.041
steps_per_turn = 1000
max_steps_s = 1289
"""
NEAR_RING = """[ring]
places_m = [[0.08, 0.0]]
headings_deg = [0.0]
half_cone_deg = 15.0
table_m = [0.0, 0.005]
table_raw = [4095.0, 0.0]
noise_raw = 1.0
"""
FAINT_RING = NEAR_RING.replace("0.005]", "0.02]").replace("4095.0, 0.0", "40.0, 0.0")


@pytest.mark.parametrize("ring, expected", [
    ("", "expected none"), (NEAR_RING, "expected none"), (FAINT_RING, "expected -4096..4096"),
])  # fmt: skip
def test_spans_that_a_models_sensors_do_not_have_are_refused(
    tmp_path: Path, ring: str, expected: str
) -> None:
    (tmp_path / "blind.toml").write_text(BLIND + ring)
    path = tmp_path / "robots.toml"
    path.write_text(
        '[[robot]]\ntag = 31\nmodel = "blind"\n[robot.calibration]\nproximity_scale = "80:1500"\n'
    )
    lab = roster.read(path)
    with pytest.raises(
        ConfigError, match=rf"robots.toml:1: proximity_scale = '80:1500': {expected}"
    ):
        lab.settings_of(lab.robots[0])
