"""`vsense camera calibrate` as a lab types it, from pictures to camera files on the disk."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.rigs.places import DATA
from tests.vision.calibration.ideal import (
    BOARD,
    CAMERAS,
    ORIGIN,
    PLAN,
    arena_errors_m,
    arena_grid,
    shoot,
)
from vsense.cli import main
from vsense.vision.calibration._views import write_corners
from vsense.vision.cameras.camera import Camera

CHESSBOARDS = DATA / "wall-tags-chessboards"
AT = f"--origin={ORIGIN[0]},{ORIGIN[1]},0"


@pytest.fixture
def corners(tmp_path: Path) -> Path:
    path = tmp_path / "found.csv"
    write_corners(path, shoot(PLAN).views)
    return path


def cameras(folder: Path) -> list[Camera]:
    return [Camera.from_json(path.read_text()) for path in sorted(folder.glob("*.json"))]


def test_lens_of_a_phone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "lenses"
    pictures = [str(path) for path in sorted(CHESSBOARDS.glob("*.jpg"))]
    words = ["calibrate", "intrinsics", "--board", "chessboard:7x5:30mm", "--camera", "phone"]
    words += ["--every", "1", "--json"]
    assert main([*words, "-o", str(output), "--pictures", *pictures]) == 0
    told = capsys.readouterr()
    report = json.loads(told.out)
    assert report["rms_px"] <= 0.20 and report["board"] == "chessboard:7x5:30mm"
    assert report["cameras"]["phone"]["views"] == 17 and len(report["views"]) == 17
    assert report == json.loads((output / "report" / "report.json").read_text())
    assert "the board was found in 17 of 17 pictures" in told.err and "px rms" in told.err
    camera = cameras(output)[0]
    assert (camera.id, camera.width_px, camera.height_px) == ("phone", 816, 612)
    image = cv2.imread(str(output / "report" / "report.png"))
    assert image.shape[0] > 400 and image.shape[1] > 600
    # Corners found once can be used again, with the same result.
    again = tmp_path / "again"
    words = ["calibrate", "intrinsics", "--board", "chessboard:7x5:30mm", "--size", "816x612"]
    found = str(output / "report" / "corners.csv")
    assert main([*words, "-o", str(again), "--corners", found]) == 0
    assert cameras(again)[0].fx_px == pytest.approx(camera.fx_px, abs=0.05)


def test_rig_from_corners(
    corners: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "cameras"
    words = ["calibrate", "rig", "--board", str(BOARD), "--corners", str(corners)]
    words += ["--size", "1620x1220", "--floor", "floor_*", AT, "-o", str(output)]
    assert main(words) == 0
    told = capsys.readouterr()
    assert told.out.splitlines() == [str(output / f"{camera.id}.json") for camera in CAMERAS]
    worst, step = arena_errors_m(cameras(output))
    assert worst <= 2e-3 and step <= 1e-3
    report = json.loads((output / "report" / "report.json").read_text())
    assert len(report["moments"]) == len(PLAN)
    assert report["board_check"]["sd_mm"] < 0.5
    # The result serves as lenses of the next calibration.
    second = tmp_path / "second"
    words += ["--intrinsics", str(output), "--refine", "-o", str(second)]
    assert main(words) == 0
    assert arena_errors_m(cameras(second))[0] <= 2e-3
    # On a board that is so thick the floor lies lower.
    assert main([*words, "--thickness", "8mm"]) == 0
    for thin, thick in zip(cameras(output), cameras(second)):
        assert thick.position_m[2] - thin.position_m[2] == pytest.approx(0.008, abs=2e-3)


def test_tags_at_known_places(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One camera that sees nine tags on the floor; its lens is known."""
    camera, folder, lenses = CAMERAS[0], tmp_path / "cam_0_0", tmp_path / "lenses"
    folder.mkdir()
    lenses.mkdir()
    (lenses / "cam_0_0.json").write_text(camera.to_json())
    middle = np.array((*camera.position_m[:2], 0.0))
    grid = [(x, y, 0.0) for x in (-0.7, 0.0, 0.7) for y in (-0.5, 0.0, 0.5)]
    places = {n: middle + np.array(place) for n, place in enumerate(grid)}
    image = np.full((camera.height_px, camera.width_px), 200, np.uint8)
    for number, place in places.items():
        draw_tag(image, camera, number, place)
    cv2.imwrite(str(folder / "tags.png"), image)
    rows = [f"{n},{p[0]},{p[1]},{p[2]}" for n, p in places.items()]
    table = tmp_path / "points.csv"
    table.write_text("\n".join(["id,x_m,y_m,z_m", *rows]) + "\n")
    output = tmp_path / "cameras"
    words = ["calibrate", "rig", "--pictures", str(folder), "--intrinsics", str(lenses)]
    words += ["--points", str(table), "--camera", "cam_0_0", "--every", "1", "--accuracy", "2mm"]
    assert main([*words, "--tags", "4X4_50", "--json", "-o", str(output)]) == 0
    assert json.loads(capsys.readouterr().out)["rms_px"] < 1.0
    kept = cv2.imread(str(output / "reference" / "cam_0_0.png"), cv2.IMREAD_GRAYSCALE)
    assert np.array_equal(kept, image), "what later pictures are compared with"
    found = cameras(output)[0]
    points = arena_grid(0.2, 0.0)
    points = points[camera.contains(camera.project(points))]
    off = found.to_plane(camera.project(points), 0.0) - points[:, :2]
    assert np.abs(off).max() < 2e-3
    words = ["check", "--cameras", str(output), "--points", str(table), "--tags", "4X4_50"]
    assert main(["calibrate", *words, "--pictures", str(folder), "--limit", "2mm"]) == 0
    # The same from pixels that somebody has clicked on.
    seen = [
        f"cam_0_0,{n},{x:.1f},{y:.1f}" for n, p in places.items() for x, y in [camera.project(p)]
    ]
    (tmp_path / "seen.csv").write_text("\n".join(["camera,id,x_px,y_px", *seen, ""]))
    words = ["rig", "--points", str(table), "--seen", str(tmp_path / "seen.csv")]
    words += ["--intrinsics", str(lenses), "-o", str(tmp_path / "clicked")]
    shutil.copytree(output / "reference", tmp_path / "clicked" / "reference")
    assert main(["calibrate", *words]) == 0
    assert not list((tmp_path / "clicked" / "reference").iterdir()), "of another calibration"
    clicked = cameras(tmp_path / "clicked")[0]
    assert clicked.position_m == pytest.approx(camera.position_m, abs=2e-3)


def draw_tag(image: np.ndarray, camera: Camera, number: int, middle: np.ndarray) -> None:
    """Draws a tag of 15 cm that lies on the floor, smooth at its edges."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    tag = cv2.copyMakeBorder(
        cv2.aruco.generateImageMarker(family, number, 240), 40, 40, 40, 40,
        cv2.BORDER_CONSTANT, value=(255,),
    )  # fmt: skip
    half = 0.15 * (320 / 240) / 2.0
    square = np.array(((-half, half, 0), (half, half, 0), (half, -half, 0), (-half, -half, 0)))
    pixels = camera.project(middle + square).astype(np.float32)
    source = np.array(((-0.5, -0.5), (319.5, -0.5), (319.5, 319.5), (-0.5, 319.5)), np.float32)
    to_image = cv2.getPerspectiveTransform(source, (4 * pixels + 1.5).astype(np.float32))
    size = (4 * image.shape[1], 4 * image.shape[0])
    large = cv2.warpPerspective(tag, to_image, size, borderValue=(0,))
    mask = cv2.warpPerspective(np.full_like(tag, 255), to_image, size, borderValue=(0,))
    grey, cover = (
        cv2.resize(layer, image.shape[::-1], interpolation=cv2.INTER_AREA)
        for layer in (large, mask)
    )
    image[cover > 127] = grey[cover > 127]


@pytest.mark.parametrize("name", ["board.pdf", "board.png"])
def test_board_to_print(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    assert main(["calibrate", "board", "charuco:5x7:36mm:4X4_50", "-o", str(path)]) == 0
    told = capsys.readouterr()
    assert told.out == f"{path}\n" and "210 x 297 mm" in told.err
    assert path.read_bytes()[:4] in (b"%PDF", b"\x89PNG")


RIG = ["rig", "--board", "charuco:7x5:80mm:4X4_50"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["board", "chess", "-o", "x.pdf"], "board 'chess': expected"),
        (["board", "chessboard:7x5:30mm", "-o", "x.txt"], "ends in .pdf or .png"),
        (["intrinsics", "--board", "chessboard:7x5:30mm"], "one of --pictures and --corners"),
        (["intrinsics", "--board", "chessboard:7x5:30mm", "--pictures", "none"], "no such file"),
        (["rig", "--pictures", "."], "expected --board or --points"),
        ([*RIG, "--pictures", ".", "--refine"], "--refine: expected --intrinsics"),
        ([*RIG, "--pictures", ".", "--points", "p.csv"], "together with --seen or --tags"),
        ([*RIG, "--pictures", ".", "--intrinsics", "none"], "no such folder"),
        ([*RIG, "--corners", "none.csv"], "none.csv: cannot be read"),
    ],
)
def test_wrong_words_get_one_line_and_exit_code_2(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", *words]) == 2
    told = capsys.readouterr()
    assert told.out == "" and len(told.err.splitlines()) == 1 and said in told.err


def test_size_and_symmetry_are_asked_for(corners: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["calibrate", "rig", "--corners", str(corners), "--board"]
    assert main([*words, str(BOARD)]) == 2
    assert "camera cam_0_0: give its --size" in capsys.readouterr().err
    assert main([*words, "chessboard:7x5:80mm", "--size", "1620x1220"]) == 2
    assert "looks the same after half a turn" in capsys.readouterr().err


def test_poor_pictures_exit_with_1_and_write_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = [str(path) for path in sorted(CHESSBOARDS.glob("*.jpg"))[:2]]
    output = tmp_path / "out"
    words = ["calibrate", "intrinsics", "--board", "chessboard:7x5:30mm", "--camera", "phone"]
    assert main([*words, "-o", str(output), "--pictures", *pictures]) == 1
    assert (
        "phone: the board was found in 2 of 2 pictures; shoot 10 to 20" in capsys.readouterr().err
    )
    assert not output.exists()


def test_pictures_of_two_sizes_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, size in (("a", (48, 64)), ("b", (48, 65))):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.zeros(size, np.uint8))
    words = ["calibrate", "intrinsics", "--board", "chessboard:7x5:30mm", "--pictures"]
    assert main([*words, str(tmp_path)]) == 2
    assert "b.png: 65 x 48 px, expected 64 x 48" in capsys.readouterr().err
