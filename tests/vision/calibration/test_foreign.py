"""Calibrations of OpenCV, ROS and caliscope come in and go out, and mean what they mean there."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from ruamel.yaml import YAML

from tests.rigs.places import DATA
from vsense.cli import main
from vsense.vision.cameras.camera import Camera

FOUR = DATA / "four-cameras" / "camera_array.toml"
"""Made by caliscope."""
POINTS = np.random.default_rng(1).uniform((-0.3, -0.3, 0.2), (0.3, 0.3, 0.9), (40, 3))

OPENCV = """%YAML:1.0
---
calibration_time: "Sat 28 Nov 2026 12:00:00"
nframes: 20
image_Width: 1280
image_Height: 720
# flags:
flags: 0
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 7.5964810041990427e+02, 0., 6.2357937612842875e+02, 0.,
       7.5965822413522790e+02, 3.6450667077500174e+02, 0., 0., 1. ]
Distortion_Coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 8.1415643920712766e-02, -2.1185889936549832e-01,
       1.6389241793896974e-04, -3.9982965283469259e-04 ]
avg_reprojection_error: 2.3273104558724406e-01
"""
"""As OpenCV's calibration example writes it; the numbers are of a real camera."""

ROS = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [430.215, 0.0, 306.691, 0.0, 430.531, 227.22, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data:
  - -0.337586
  - 0.111612
  - -0.000218
  - -0.00003
  - 0.0
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [400.0, 0.0, 306.0, 0.0, 0.0, 400.0, 227.0, 0.0, 0.0, 0.0, 1.0, 0.0]
"""


def camera(path: Path) -> Camera:
    return Camera.from_json(path.read_text())


def lens_px(matrix: list[float], distortion: list[float], points: np.ndarray) -> np.ndarray:
    """Where OpenCV shows points of the camera's frame."""
    still = np.zeros(3)
    lens = np.reshape(matrix, (3, 3)), np.array(distortion)
    return cv2.projectPoints(points, still, still, *lens)[0][:, 0]


def lens_of(ours: Camera) -> tuple[list[float], list[float]]:
    matrix = [ours.fx_px, 0.0, ours.cx_px, 0.0, ours.fy_px, ours.cy_px, 0.0, 0.0, 1.0]
    return matrix, list(ours.distortion)


def test_four_cameras_of_caliscope(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "import", str(FOUR), "-o", str(tmp_path)]) == 0
    told = capsys.readouterr()
    assert told.out.splitlines() == [str(tmp_path / f"cam_{k}.json") for k in range(4)]
    assert told.err.count("camera_array.toml") == told.err.count("0.0000 px at most") == 4
    for part in FOUR.read_text().split("[cameras.")[1:]:
        theirs = {
            name: np.array(json.loads(value))
            for name, value in re.findall(r"^(\w+) *= *(\[.*\])$", part, re.MULTILINE)
        }
        vector = cv2.Rodrigues(theirs["rotation"])[0]
        lens = theirs["matrix"], theirs["distortions"]
        expected = cv2.projectPoints(POINTS, vector, theirs["translation"], *lens)[0][:, 0]
        found = camera(tmp_path / f"cam_{part[0]}.json")
        front = (POINTS @ theirs["rotation"].T + theirs["translation"])[:, 2] > 0.2
        assert front.sum() > 10
        assert found.project(POINTS[front]) == pytest.approx(expected[front], abs=1e-6)


def test_opencv_and_ros_come_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "front.yml").write_text(OPENCV)
    (tmp_path / "ost.yaml").write_text(ROS)
    output = tmp_path / "cameras"
    (output / "reference").mkdir(parents=True)
    for name in ("front.json", "reference/front.png"):
        (output / name).write_text("of another calibration")
    words = ["calibrate", "import", str(tmp_path / "front.yml"), str(tmp_path / "ost.yaml")]
    assert main([*words, "-o", str(output)]) == 0
    told = capsys.readouterr().err
    assert "camera front: a lens only; vsense camera calibrate rig" in told
    assert told.count("front.json: is there, and is written over") == told.count("over") == 1
    assert not (output / "reference" / "front.png").exists()
    ahead = POINTS + np.array((0.0, 0.0, 1.0))
    file = cv2.FileStorage(str(tmp_path / "front.yml"), cv2.FILE_STORAGE_READ)
    front = file.getNode("Camera_Matrix").mat(), file.getNode("Distortion_Coefficients").mat()
    assert lens_px(*lens_of(camera(output / "front.json")), ahead) == pytest.approx(
        lens_px(*front, ahead), abs=1e-9
    )
    ros = YAML(typ="safe").load(ROS)
    theirs = [ros[name]["data"] for name in ("camera_matrix", "distortion_coefficients")]
    found = camera(output / "narrow_stereo.json")
    assert (found.width_px, found.height_px) == (640, 480)
    assert lens_px(*lens_of(found), ahead) == pytest.approx(lens_px(*theirs, ahead), abs=1e-9)


@pytest.mark.parametrize("format", ["opencv", "ros", "caliscope"])
def test_what_goes_out_comes_in_again(format: str, tmp_path: Path) -> None:
    first, out, second = tmp_path / "first", tmp_path / "out", tmp_path / "second"
    assert main(["calibrate", "import", str(FOUR), "-o", str(first)]) == 0
    words = ["calibrate", "export", "--format", format, "--cameras", str(first), "-o", str(out)]
    assert main(words) == 0
    files = [str(path) for path in sorted(out.iterdir())]
    assert len(files) == (1 if format == "caliscope" else 4)
    assert main(["calibrate", "import", *files, "-o", str(second)]) == 0
    for path in sorted(first.glob("*.json")):
        before, after = camera(path), camera(second / path.name)
        if format == "ros":  # which has no poses
            assert lens_of(after) == lens_of(before)
            continue
        assert after.project(POINTS) == pytest.approx(before.project(POINTS), abs=1e-6, rel=1e-9)


def test_others_read_what_goes_out(tmp_path: Path) -> None:
    """OpenCV's own reader, and a reader of YAML as ROS has it."""
    first = tmp_path / "first"
    assert main(["calibrate", "import", str(FOUR), "-o", str(first)]) == 0
    for format in ("opencv", "ros"):
        words = ["calibrate", "export", "--format", format, "--cameras", str(first)]
        assert main([*words, "-o", str(tmp_path / format)]) == 0
    ours = camera(first / "cam_1.json")
    file = cv2.FileStorage(str(tmp_path / "opencv" / "cam_1.yml"), cv2.FILE_STORAGE_READ)
    matrices = ("rotation", "translation", "camera_matrix", "distortion_coefficients")
    rotation, translation, *lens = (file.getNode(name).mat() for name in matrices)
    assert file.getNode("image_width").real() == 1280
    shown = cv2.projectPoints(POINTS, cv2.Rodrigues(rotation)[0], translation, *lens)[0][:, 0]
    front = (POINTS @ rotation.T + translation.ravel())[:, 2] > 0.2
    assert front.sum() > 10
    assert shown[front] == pytest.approx(ours.project(POINTS)[front], abs=1e-6)
    info = YAML(typ="safe").load((tmp_path / "ros" / "cam_1.yaml").read_text())
    assert info["distortion_model"] == "plumb_bob" and info["image_height"] == 720
    assert info["distortion_coefficients"]["data"] == list(ours.distortion)
    assert info["projection_matrix"]["data"][:3] == [ours.fx_px, 0.0, ours.cx_px]


BAD = {
    "no.yml": ("x", "no.yml:1: 'x': expected 'name: value'"),
    "open.yml": ("a: 1\nb: [1,\n2\n", "open.yml:2: b: expected ']' at its end"),
    "empty.yml": ("", "empty.yml:1: image_width: is missing"),
    "data.xml": ('<?xml version="1.0"?>', "data.xml:1: '<?xml version=\"1.0\"?>': expected 'name:"),
    "equal.yml": (
        OPENCV.replace("flags: 0", "flags: 14\nfisheye_model: 1"),
        "equal.yml:9: fisheye_model: '1', expected plumb_bob",
    ),
    "model.yaml": (
        ROS.replace("distortion_model: plumb_bob", "camera_model: equidistant"),
        "model.yaml:8: camera_model: 'equidistant', expected plumb_bob",
    ),
    "fisheye.yaml": (
        ROS.replace("plumb_bob", "equidistant"),
        "fisheye.yaml:8: distortion_model: 'equidistant', expected plumb_bob",
    ),
    "inf.yaml": (
        ROS.replace("430.215", ".inf"),
        "inf.yaml:4: camera_matrix: expected 9 numbers",
    ),
    "nan.yaml": (ROS.replace("430.215", "nan"), "nan.yaml:4: camera_matrix: 9 numbers, expected"),
    "skew.yaml": (
        ROS.replace("430.215, 0.0", "430.215, 1.5"),
        "skew.yaml:4: camera_matrix: expected fx, 0, cx, 0, fy, cy, 0, 0, 1",
    ),
    "three.yaml": (
        ROS.replace("  - -0.00003\n  - 0.0\n", ""),
        "three.yaml:9: distortion_coefficients: 3 numbers, expected 0 or 4 or 5 or 8",
    ),
    "rational.yaml": (
        ROS.replace("  - 0.0\n", "  - 0.0\n  - 0.1\n  - 0.2\n  - 0.3\n"),
        "rational.yaml:9: distortion_coefficients: 8 coefficients, expected k1 k2 p1 p2 k3",
    ),
    "size.yaml": (ROS.replace("640", "0"), "size.yaml:1: image_width: expected the picture's"),
    "turned.yml": (
        OPENCV + "rotation:\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 2]\n",
        "turned.yml:22: rotation: expected a rotation from arena to camera",
    ),
    "shift.yml": (OPENCV + "translation:\n  data: [1, 2, 3]\n", "rotation: is missing"),
    "none.toml": ("", "none.toml:1: expected caliscope's tables [cameras.0]"),
    "table.toml": ("[cameras]\n0 = 3\n", "table.toml:2: camera 0: 0: expected a table"),
    "wide.toml": (
        "[cameras.0]\nfisheye = true\n",
        "wide.toml:2: camera 0: fisheye: a fisheye lens",
    ),
    "bare.toml": ("[cameras.0]\nsize = [1, 1]\n", "bare.toml:1: camera 0: matrix: is missing"),
    "deep.toml": (
        "[cameras.0]\nsize = [1, 1]\nmatrix = [[[1]]]\n",
        "deep.toml:3: camera 0: matrix: expected 9 numbers",
    ),
}


def test_what_may_be_meant_otherwise_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Millimetres; a camera of caliscope without a place; a model that is named as none."""
    down = "rotation:\n  data: [1, 0, 0, 0, -1, 0, 0, 0, -1]\n"
    text = OPENCV.replace("flags: 0", "flags: 0\nfisheye_model: 0") + down
    (tmp_path / "mm.yml").write_text(text + "translation:\n  data: [120, 340, 2350]\n")
    lens = "size = [9, 9]\nmatrix = [[9, 0, 4], [0, 9, 4], [0, 0, 1]]\ndistortions = [0, 0, 0, 0]\n"
    (tmp_path / "a.toml").write_text(
        f'[cameras.7]\nrotation = "null"\ntranslation = "null"\n{lens}'
    )
    files = [str(tmp_path / name) for name in ("mm.yml", "a.toml")]
    assert main(["calibrate", "import", *files, "-o", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().err
    assert "camera mm: is 2377 m away: its translation has to be in m" in told
    assert "camera cam_7: a lens only" in told


def test_what_does_not_go_out_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("cam_0_0", "cam_1_0"):
        seen = Camera.looking_down(name, 0.0, 0.0, 2.0, 500.0, (640, 480))
        (tmp_path / f"{name}.json").write_text(replace(seen, row_time_s=2e-5).to_json())
    words = ["--format", "caliscope", "--cameras", str(tmp_path), "-o", str(tmp_path / "out")]
    assert main(["calibrate", "export", *words]) == 0
    told = capsys.readouterr().err
    assert "camera cam_1_0 as cam_1: 0.0000 px" in told
    assert "camera cam_0_0: row_time_s stays behind: caliscope has none" in told


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_says_what_no_camera_can_gets_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, said = BAD[name]
    (tmp_path / name).write_text(text)
    assert main(["calibrate", "import", str(tmp_path / name), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr()
    assert told.out == "" and said in told.err and len(told.err.splitlines()) == 1, told.err
    assert not (tmp_path / "out").exists()


def test_names_are_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a b.yml", "c.yml"):
        (tmp_path / name).write_text(OPENCV)
    words = ["calibrate", "import", "-o", str(tmp_path / "out")]
    for files, said in (
        (["a b.yml"], "camera 'a b': give it a plain --name"),
        (["c.yml", "c.yml"], "camera c is there twice"),
        (["none.yml"], "none.yml: cannot be read"),
    ):
        assert main([*words, *(str(tmp_path / name) for name in files)]) == 2
        assert said in capsys.readouterr().err
    assert main([*words, str(FOUR), "--name", "x"]) == 2
    assert "has 4 cameras, expected one" in capsys.readouterr().err
    assert main([*words, str(tmp_path / "a b.yml"), "--name", "left"]) == 0
    assert camera(tmp_path / "out" / "left.json").id == "left"
