"""`vsense camera calibrate check`: it reports the errors that were put into cameras or points."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.rigs.places import DATA
from tests.vision.calibration.ideal import CAMERAS
from tests.vision.tracking.synthetic import Look, Robot, inclined, render
from vsense.cli import main
from vsense.monitor.recording import calibration_words
from vsense.monitor.recording.form import ExperimentMessage
from vsense.studies.report._facts import read_facts
from vsense.vision.calibration.checked import of_session
from vsense.vision.calibration.frame import FrameShift
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family

POINTS = {
    "sw": (-1.3, -1.0, 0.0), "se": (1.3, -1.0, 0.0), "ne": (1.3, 1.0, 0.06), "nw": (-1.3, 1.0, 0.0),
    "mid": (0.0, 0.0, 0.0),
}  # fmt: skip


def write_cameras(folder: Path, cameras: list[Camera]) -> Path:
    folder.mkdir(exist_ok=True)
    for camera in cameras:
        (folder / f"{camera.id}.json").write_text(camera.to_json())
    return folder


@pytest.fixture
def tables(tmp_path: Path) -> list[str]:
    """Points, and where the true cameras see them."""
    rows = [f"{id},{x},{y},{z}" for id, (x, y, z) in POINTS.items()]
    (tmp_path / "points.csv").write_text("\n".join(["id,x_m,y_m,z_m", *rows, ""]))
    seen = ["camera,id,x_px,y_px"]
    for camera in CAMERAS:
        for id, place in POINTS.items():
            pixel = camera.project(np.array(place))
            if camera.contains(pixel):
                seen.append(f"{camera.id},{id},{pixel[0]:.3f},{pixel[1]:.3f}")
    (tmp_path / "seen.csv").write_text("\n".join([*seen, ""]))
    return ["--points", str(tmp_path / "points.csv"), "--seen", str(tmp_path / "seen.csv")]


def run(folder: Path, *words: str) -> int:
    return main(["calibrate", "check", "--cameras", str(folder), *words])


def test_true_cameras_are_right(
    tables: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_cameras(tmp_path / "cameras", CAMERAS)
    assert run(folder, *tables, "--json", "--limit", "1mm") == 0
    told = capsys.readouterr()
    data = json.loads(told.out)
    assert data["rms_mm"] == data["worst_mm"] == data["shape_rms_mm"] == 0.0
    assert data["points"] == 5 and set(data["of_cameras"]) == {c.id for c in CAMERAS}
    assert json.loads((folder / "report" / "check.json").read_text()) == data


def test_a_frame_that_is_off_is_told_as_such(
    tables: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    off = FrameShift(0.012, -0.005)
    folder = write_cameras(tmp_path / "cameras", [off.moved(camera) for camera in CAMERAS])
    assert run(folder, *tables, "--limit", "5mm") == 1
    told = capsys.readouterr()
    assert "all together 13.00 mm rms, 13.00 mm at worst, at 5 points" in told.err
    assert "0.00 mm rms where the frame as a whole fits best: -12.0 mm along x, +5.0" in told.err
    assert "vsense camera arena align" in told.err and "13.0 mm at worst, expected 5 mm" in told.err


def test_a_camera_that_was_pushed_is_told(
    tables: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    x, y, z = CAMERAS[1].position_m
    pushed = replace(CAMERAS[1], position_m=(x + 0.008, y, z))
    folder = write_cameras(tmp_path / "cameras", [CAMERAS[0], pushed, *CAMERAS[2:]])
    distances = tmp_path / "tape.csv"
    distances.write_text("from,to,distance_m\nsw,nw,2.0\nsw,se,2.61\n")
    assert run(folder, *tables, "--distances", str(distances), "--json") == 0
    told = capsys.readouterr()
    data = json.loads(told.out)
    assert data["of_cameras"][pushed.id]["worst_mm"] == 8.0
    assert [of["worst_mm"] for id, of in data["of_cameras"].items() if id != pushed.id] == [0.0] * 3
    # Only the middle is seen by several: by the pushed one 8 mm beside the others.
    assert f"between two cameras 8.00 mm at worst, {CAMERAS[0].id} and {pushed.id}" in told.err
    assert [row["from"] + row["to"] for row in data["distances"]] == ["swnw", "swse"]
    assert data["distances"][1]["off_mm"] == pytest.approx(-10.0, abs=0.1)


def test_robots_markers_stand_at_measured_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lens = (-0.12, 0.02, 0.0, 0.0, 0.0)
    camera = Camera.looking_down("top", 0.0, 0.0, 2.43, 1620.0, (800, 600), lens)
    family, places = load_family("arrow4x4"), {31: (-0.3, -0.2), 7167: (0.35, 0.2), 52447: (0.1, 0)}
    robots = [Robot(tag, *place, 0.4) for tag, place in places.items()]
    pictures = tmp_path / "shoot" / "top"
    pictures.mkdir(parents=True)
    for number in range(2):
        image = render(camera, family, robots, Look(litter=2), number, 0.06)
        cv2.imwrite(str(pictures / f"{number}.png"), image)
    rows = [f"{tag},{x},{y + 0.004},0.06" for tag, (x, y) in places.items()]
    (tmp_path / "points.csv").write_text("\n".join(["id,x_m,y_m,z_m", *rows, "9,1,1,0.06", ""]))
    folder = write_cameras(tmp_path / "cameras", [camera])
    words = ["--points", str(tmp_path / "points.csv"), "--markers", "arrow4x4", "--json"]
    assert run(folder, *words, "--pictures", str(pictures), "--camera", "top", "--every", "1") == 0
    told = capsys.readouterr()
    data = json.loads(told.out)
    assert "point 9: no camera shows it" in told.err
    assert data["points"] == 3 and data["rms_mm"] == pytest.approx(4.0, abs=0.4)
    assert data["frame"]["y_mm"] == pytest.approx(4.0, abs=0.4) and data["shape_rms_mm"] < 0.4


def test_later_runs_tell_what_was_checked_and_whether_it_still_is(
    tables: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_cameras(tmp_path / "cameras", CAMERAS)
    files = {f"usb {c.id}": (c, folder / f"{c.id}.json") for c in CAMERAS}
    before = of_session(files)
    assert not before["checked"] and len(before["unchecked"]) == 4
    assert "never checked" in calibration_words(before)
    assert run(folder, *tables) == 0
    capsys.readouterr()
    known = of_session(files)
    assert known["checked"] and known["checks"][0]["points"] == 5
    assert calibration_words(known).endswith("at 5 points: 0.0 mm rms, 0.0 mm at worst")
    moved = FrameShift(0.001).moved(CAMERAS[2])
    changed = of_session({**files, f"usb {moved.id}": (moved, files[f"usb {moved.id}"][1])})
    assert not changed["checked"] and changed["stale"] == [f"usb {moved.id}"]
    assert calibration_words(changed).endswith(f"but usb {moved.id} has changed since: check again")
    (folder / "report" / "check.json").write_text("[1]")
    assert of_session(files)["checks"] == []


def test_recordings_and_reports_hold_it() -> None:
    check = {"when": "2026-11-24T09:00:00+00:00", "points": 5, "rms_mm": 1.2, "worst_mm": 2.5}
    known = {"checked": True, "unchecked": [], "stale": [], "checks": [check]}
    told = ExperimentMessage(calibration=known).data()
    words = "calibration checked 2026-11-24 at 5 points: 1.2 mm rms, 2.5 mm at worst"
    assert read_facts(told).calibration == words
    assert (
        read_facts({}).calibration == read_facts({"calibration": {"checks": 3}}).calibration == ""
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "one of --points and --board"),
        (["--points", "p.csv", "--seen", "s.csv", "--experiment", "pollutant"],
         "--experiment: expected --tracking"),
        (["--tracking", "a", "b", "c"], "--tracking: expected a folder, or resources and"),
        (["--keep", "--points", "p.csv", "--seen", "s.csv"], "--keep: expected --pictures, and"),
        (["--points", "p.csv"], "one of --seen, --tags and --markers"),
        (["--points", "p.csv", "--tags", "4X4_50"], "expected --pictures"),
        (["--board", "charuco:7x5:80mm:4X4_50", "--pictures", "."], "--board: expected --floor"),
        (["--points", "none.csv", "--seen", "none.csv"], "none.csv: cannot be read"),
        (["--points", "p.csv", "--seen", "s.csv"], "s.csv:2: camera: 'front': expected cam_0_0"),
        (["--points", "bad.csv", "--seen", "s.csv"], "bad.csv:2: y_m: 'two' is not a number"),
        (["--points", "p.csv", "--seen", "s.csv", "--distances", "d.csv"],
         "d.csv:2: to: 'b' is not among the points"),
        (["--points", "p.csv", "--markers", "arrow4x4", "--pictures", "."],
         "point 'a': expected the number of a tag"),
    ],
)  # fmt: skip
def test_wrong_words_and_files_get_one_line(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    write_cameras(tmp_path / "cameras", CAMERAS)
    (tmp_path / "p.csv").write_text("id,x_m,y_m\na,0,0\n")
    (tmp_path / "bad.csv").write_text("id,x_m,y_m\na,0,two\n")
    (tmp_path / "s.csv").write_text("camera,id,x_px,y_px\nfront,a,1,2\n")
    (tmp_path / "d.csv").write_text("from,to,distance_m\na,b,1\n")
    assert main(["calibrate", "check", *words]) == 2
    told = capsys.readouterr()
    assert told.out == "" and len(told.err.splitlines()) == 1 and said in told.err


def test_a_second_board_on_the_floor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A chessboard under one camera whose file says a focal length that is 1 % too long."""
    camera = Camera.looking_down("top", 0.0, 0.0, 2.0, 1200.0, (800, 600))
    pictures = tmp_path / "shoot" / "top"
    pictures.mkdir(parents=True)
    side = 60.0  # 100 mm, 600 px to the metre
    rows, columns = np.indices((600, 800))
    inside = (rows // side < 7) & (rows >= 60) & (columns // side < 9) & (columns >= 60)
    dark = inside & ((rows // side + columns // side) % 2 == 1)
    cv2.imwrite(str(pictures / "floor_1.png"), np.where(dark, 20, 220).astype(np.uint8))
    wrong = replace(camera, fx_px=1212.0, fy_px=1212.0)
    folder = write_cameras(tmp_path / "cameras", [wrong])
    words = ["--board", "chessboard:7x5:100mm", "--floor", "floor_*", "--json"]
    assert run(folder, *words, "--pictures", str(tmp_path / "shoot")) == 0
    told = capsys.readouterr()
    data = json.loads(told.out)
    assert data["how"] == "board" and data["points"] == 35
    # 7 x 5 corners, 1 % too near their middle: at worst half a diagonal's, of 0.6 x 0.4 m.
    assert data["worst_mm"] == pytest.approx(1e3 * np.hypot(0.3, 0.2) * (1 - 1 / 1.01), abs=0.2)
    # A face that is 1 % nearer to the camera than the floor: its corners are nearer to the middle.
    words += ["--pictures", str(tmp_path / "shoot"), "--thickness", "20mm"]
    assert run(folder, *words) == 0
    worst_mm = json.loads(capsys.readouterr().out)["worst_mm"]
    assert worst_mm == pytest.approx(1e3 * np.hypot(0.3, 0.2) * (1 - 0.99 / 1.01), abs=0.2)


RESOURCES = """<arena_tracking_system>
<grabbers>{grabbers}</grabbers>
<trackers><tracker id="t" family="arrow4x4" tags="31 700" robot_height="0.06" /></trackers>
<cameras>{cameras}</cameras>
</arena_tracking_system>"""


def test_where_markers_cannot_be_read_is_painted_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A camera that looks down reads all, one that is inclined loses what is far."""
    down = Camera.looking_down("top", 0.0, 0.0, 2.4, 1620.0, (1620, 1220))
    cameras = [replace(inclined(60, 900.0), id="side"), down]
    write_cameras(tmp_path / "cameras", cameras)
    files = {
        "grabbers": "".join(f'<grabber id="{c.id}" type="directory" path="." />' for c in cameras),
        "cameras": "".join(
            f'<camera id="{c.id}" calibration="cameras/{c.id}.json" />' for c in cameras
        ),
    }
    (tmp_path / "resources.xml").write_text(RESOURCES.format(**files))
    words = ["calibrate", "check", "--tracking", str(tmp_path)]
    assert main(words) == 0
    told = capsys.readouterr()
    assert told.out == f"{tmp_path}/cameras/report/legible.png\n"
    # 900 px, cells of 5.3 mm seen from 1.44 m above: near the picture's middle they are, along
    # the view, as wide as 900 x 0.0053 x 1.44 / d^2 px: 1 px where d is 2.62 m.
    height_m = cameras[0].position_m[2] - 0.06
    beside_m = np.sqrt(900.0 * 5.3e-3 * height_m - height_m**2)
    said_m = float(told.err.partition("is read: from ")[2].partition(" m beside")[0])
    assert said_m == pytest.approx(beside_m, abs=0.03)
    assert "camera top: arrow4x4 can be read wherever it may be" in told.err
    picture = cv2.imread(told.out.strip())
    blue, _, red = picture.astype(int).transpose(2, 0, 1)
    is_red = red - blue > 90
    left, right = np.array_split(is_red, 2, axis=1)
    assert left.mean() > 0.2 and not right.any()
    # Only a part of what is lost lies in the arena.
    assert main([*words, "--experiment", "pollutant"]) == 0
    assert cv2.imread(told.out.strip()).shape == picture.shape
    shares = [float(told.err.partition("camera side: in ")[2].partition(" %")[0])]
    shares += [float(capsys.readouterr().err.partition("camera side: in ")[2].partition(" %")[0])]
    assert 30.0 < shares[1] < shares[0] - 5.0


def test_pictures_alone_say_which_cameras_were_moved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Real photographs of a room; one camera is moved by 2.5 px, another has no reference."""
    cameras = [Camera.looking_down(n, 0.0, 0.0, 2.0, 765.0, (816, 612)) for n in ("a", "b", "c")]
    write_cameras(tmp_path / "cameras", cameras)
    room = cv2.imread(str(DATA / "wall-tags" / "photos" / "IMG_1384.jpg"), cv2.IMREAD_GRAYSCALE)
    border = {"flags": cv2.INTER_CUBIC, "borderMode": cv2.BORDER_REFLECT}
    moved = cv2.warpAffine(room, np.array([(1, 0, 1.5), (0, 1, 2.0)]), (816, 612), **border)
    for folder, pictures in (("then", {"a": room, "b": room}), ("now", {"a": room, "b": moved})):
        for name, picture in {**pictures, "c": room}.items():
            (tmp_path / folder / name).mkdir(parents=True)
            cv2.imwrite(str(tmp_path / folder / name / "floor_01.png"), picture)
    shutil.rmtree(tmp_path / "then" / "c")
    words = ["calibrate", "check", "--cameras", str(tmp_path / "cameras"), "--pictures"]
    assert main([*words, str(tmp_path / "then")]) == 1
    assert "no camera could be compared" in capsys.readouterr().err
    assert main([*words, str(tmp_path / "then"), "--keep"]) == 0
    kept = [tmp_path / "cameras" / "reference" / f"{name}.png" for name in "ab"]
    assert capsys.readouterr().out.splitlines() == [str(path) for path in kept]
    assert main([*words, str(tmp_path / "then")]) == 0
    told = capsys.readouterr().err
    assert told.count("in its place") == 2 and "no picture of c: not compared" in told
    assert main([*words, str(tmp_path / "now"), "--json"]) == 1
    told = capsys.readouterr()
    assert "camera a: in its place" in told.err and "camera b: has moved by 2." in told.err
    assert "camera c: cannot be compared: it has no reference picture" in told.err
    facts = json.loads(told.out)["cameras"]
    assert facts["b"]["moved_px"] == pytest.approx(2.5, abs=0.2) and facts["c"] is None
    assert told.err.endswith("moved since the calibration: b\n")
    (tmp_path / "now" / "a" / "floor_01.png").unlink()
    cv2.imwrite(str(tmp_path / "now" / "a" / "floor_01.png"), room[:300])
    assert main([*words, str(tmp_path / "now")]) == 2
    assert "a: 816 x 300 px, expected 816 x 612" in capsys.readouterr().err
