"""`vsense camera markers find`: pictures with OpenCV's own markers, drawn here with exact truth."""

from __future__ import annotations

import csv
import json
import os
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import vsense
from tests.vision.tracking.real import DATA
from vsense import cli
from vsense.base.errors import VsenseError
from vsense.tools.camera_setup import photographs
from vsense.vision.tracking import squares
from vsense.vision.tracking.squares import SquareFinder

CELL_PX = 32
WIDTH, HEIGHT = 900, 640
DICTIONARIES = [
    "DICT_4X4_50",
    "DICT_5X5_1000",
    "DICT_6X6_250",
    "DICT_7X7_100",
    "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h11",
]


def draw(dictionary: str, tags: list[int], seed: int) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Draws OpenCV's markers askew side by side; returns the picture and each tag's corners.

    Each is seen in perspective, with a blur of 0.7 px and noise of 2 grey values. Pixel centres
    have whole coordinates.
    """
    rng = np.random.default_rng(seed)
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    side = CELL_PX * (words.markerSize + 2)
    image = np.full((HEIGHT, WIDTH), 205.0, np.float32)
    truth = {}
    for place, tag in enumerate(tags):
        paper = np.full((side + 4 * CELL_PX,) * 2, 255, np.uint8)
        marker = cv2.aruco.generateImageMarker(words, tag, side)
        paper[2 * CELL_PX : -2 * CELL_PX, 2 * CELL_PX : -2 * CELL_PX] = marker
        middle = np.array((130.0 + 210.0 * (place % 4), 150.0 + 260.0 * (place // 4)))
        angle = rng.uniform(-np.pi, np.pi) + np.arange(4) * np.pi / 2
        reach = rng.uniform(70.0, 85.0, 4)[:, np.newaxis]
        quad = middle + reach * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
        low, high = -0.5, len(paper) - 0.5
        sheet = np.array([(low, low), (high, low), (high, high), (low, high)], np.float32)
        onto = cv2.getPerspectiveTransform(sheet, quad.astype(np.float32))
        # Drawn four times as fine and averaged: the edges of a camera's pixels.
        fine = np.diag((4.0, 4.0, 1.0)) @ np.array([(1, 0, 0.375), (0, 1, 0.375), (0, 0, 1.0)])
        size = (4 * WIDTH, 4 * HEIGHT)
        over = cv2.warpPerspective(paper, fine @ onto, size, None, cv2.INTER_AREA)
        there = cv2.warpPerspective(np.full_like(paper, 255), fine @ onto, size)
        share = cv2.resize(there, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) / 255.0
        seen = cv2.resize(over, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        image = image * (1.0 - share) + seen * share * (205.0 / 255.0)
        inner = 2 * CELL_PX - 0.5
        outer = inner + side
        corners = np.array([(inner, inner), (outer, inner), (outer, outer), (inner, outer)])
        truth[tag] = cv2.perspectiveTransform(corners[np.newaxis], onto)[0]
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0.0, 2.0, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), truth


def save(image: np.ndarray, path: Path) -> Path:
    assert cv2.imwrite(str(path), image)
    return path


def found(capsys: pytest.CaptureFixture[str]) -> list[dict]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_every_marker_of_opencvs_is_found_with_opencvs_corners(
    dictionary: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    # The last of DICT_ARUCO_ORIGINAL looks the same after half a turn.
    tags = [0, 3, 7, 11, 16, 19, 23, len(words.bytesList) - 2]
    image, truth = draw(dictionary, tags, 1)
    path = save(image, tmp_path / "photo.png")
    assert cli.main(["markers", "find", str(path), "--family", dictionary]) == 0
    (line,) = found(capsys)
    assert (line["picture"], line["width_px"], line["height_px"]) == (str(path), WIDTH, HEIGHT)
    ours = {marker["tag"]: np.array(marker["corners_px"]) for marker in line["markers"]}
    assert sorted(ours) == sorted(tags) and len(line["markers"]) == len(tags)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    theirs, ids, _ = cv2.aruco.ArucoDetector(words, settings).detectMarkers(image)
    assert ids is not None and len(ids) >= len(tags) - 1
    for corners, tag in zip(theirs, ids.ravel().tolist()):
        assert np.abs(corners[0] - truth[tag]).max() < 0.6, "the truth is OpenCV's, too"
    off = np.array([np.abs(ours[tag] - truth[tag]).max() for tag in tags])
    assert off.max() < 0.25 and np.median(off) < 0.15


def test_a_table_has_a_row_per_marker_and_the_drawn_picture_shows_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, drawn = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    image, truth = draw("DICT_4X4_50", [4, 9], 2)
    save(image, folder / "shot_10.png")
    save(np.full((40, 50), 128, np.uint8), folder / "shot_2.jpg")
    (folder / "notes.txt").write_text("no picture")
    words = ["markers", "find", str(folder), "--family", "aruco_4x4_50", "--format", "csv"]
    assert cli.main([*words, "--least-side", "500"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1, "both are smaller"
    assert cli.main([*words, "--least-side", "6", "--draw", str(drawn)]) == 0
    out = capsys.readouterr()
    rows = list(csv.DictReader(out.out.splitlines()))
    assert tuple(rows[0]) == photographs.TAG_ROW
    assert [(Path(row["picture"]).name, row["tag"]) for row in rows] == [
        ("shot_10.png", "4"),
        ("shot_10.png", "9"),
    ]
    for row in rows:
        corners = np.array([[float(row[f"{a}{k}_px"]) for a in "xy"] for k in (1, 2, 3, 4)])
        assert np.abs(corners - truth[int(row["tag"])]).max() < 0.25
    assert "2 pictures, 2 markers of DICT_4X4_50" in out.err
    changed = cv2.imread(str(drawn / "shot_10.png"))
    assert changed.shape == (HEIGHT, WIDTH, 3)
    for corners in truth.values():
        for x, y in np.rint((corners + np.roll(corners, 1, 0)) / 2.0).astype(int):
            assert np.ptp(changed[y, x].astype(int)) > 60, "a coloured line"
    assert (cv2.imread(str(drawn / "shot_2.png")) == 128).all()


def test_the_same_name_in_two_folders_is_drawn_twice_and_no_picture_is_written_over(
    tmp_path: Path,
) -> None:
    image, _ = draw("DICT_4X4_50", [4], 2)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save(image, tmp_path / name / "x.png")
    before = (tmp_path / "a" / "x.png").read_bytes()
    folders = [str(tmp_path / name) for name in ("a", "b")]
    draw_there = ["--draw", str(tmp_path / "a")]
    assert cli.main(["markers", "find", *folders, "--family", "4X4_50", *draw_there]) == 0
    assert (tmp_path / "a" / "x.png").read_bytes() == before
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["x-1.png", "x-2.png", "x.png"]


def test_a_damaged_picture_is_told_and_does_not_end_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, _ = draw("DICT_4X4_50", [4], 2)
    save(image, tmp_path / "a.png")
    whole = cv2.imencode(".jpg", image)[1].tobytes()
    (tmp_path / "b.jpg").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "c.png").write_bytes(b"no picture at all")
    claims = bytearray(cv2.imencode(".png", image)[1].tobytes())
    claims[16:24] = 2 * (60_000).to_bytes(4, "big")
    (tmp_path / "d.png").write_bytes(bytes(claims))
    save(image, tmp_path / "e.png")
    assert cli.main(["markers", "find", str(tmp_path), "--family", "DICT_4X4_50"]) == 1
    out = capsys.readouterr()
    lines = [json.loads(line) for line in out.out.splitlines()]
    assert [Path(line["picture"]).name for line in lines] == ["a.png", "e.png"]
    assert all([m["tag"] for m in line["markers"]] == [4] for line in lines)
    assert f"{tmp_path}/b.jpg is cut off" in out.err
    assert f"{tmp_path}/c.png is no picture" in out.err
    assert f"{tmp_path}/d.png claims to have 60000 x 60000 pixels, expected at most" in out.err
    assert "2 pictures, 2 markers of DICT_4X4_50; 3 pictures could not be used" in out.err


def test_a_huge_picture_is_refused_whatever_its_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for suffix in ("png", "bmp"):
        save(np.zeros((10_000, 5_001), np.uint8), tmp_path / f"huge.{suffix}")
    assert cli.main(["markers", "find", str(tmp_path), "--family", "DICT_4X4_50"]) == 1
    err = capsys.readouterr().err
    assert err.count("5001 x 10000 pixels, expected at most 50000000 pixels") == 2


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["{tmp}/" + 300 * "n"], "cannot be read: File name too long"),
        (["{tmp}/none.png"], "{tmp}/none.png: there is no such picture or folder"),
        (["{tmp}"], "{tmp}: holds no pictures, expected .png, .jpg"),
        (["{tmp}", "--family", "DICT_4X4_51"], "'DICT_4X4_51' is neither the path of a definition"),
        (["{tmp}", "--family", "arrow4x4"], "arrow4x4 are arrows, which are recognized among dark"),
        (["{tmp}", "--family", "{tmp}/no.yml"], "{tmp}/no.yml: there is no such dictionary file"),
        (["{tmp}", "--family", "{tmp}/no.json"], "{tmp}/no.json: No such file"),
        (["{data}", "--draw", "{data}/SOURCE.md"], "--draw: {data}/SOURCE.md: cannot be made"),
    ],
)
def test_what_cannot_be_used_is_refused_with_what_is_expected(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"tmp": tmp_path, "data": DATA / "kilobots"}
    if words[1:2] == ["--family"]:
        save(np.zeros((8, 8), np.uint8), tmp_path / "a.png")
    family = [] if "--family" in words else ["--family", "DICT_4X4_50"]
    said = [word.format(**places) for word in words]
    assert cli.main(["markers", "find", *said, *family]) == 2
    out = capsys.readouterr()
    assert told.format(**places) in out.err and out.out == ""


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (1, 400), (400, 1), (17, 17)])
def test_tiny_pictures_have_no_markers(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, shape).astype(np.uint8)
    assert len(SquareFinder(squares.codes_of("4X4_50")).find(image)) == 0


@pytest.mark.parametrize("dictionary", ["DICT_4X4_50", "DICT_4X4_250"])
def test_the_letter_p_is_no_marker(dictionary: str) -> None:
    """Its hole is where tag 17 has its only white cells; it was read in three of four of them."""
    rng = np.random.default_rng(0)
    finder = SquareFinder(squares.codes_of(dictionary))
    for blur in (0.5, 1.0, 1.5, 2.0):
        image = np.full((500, 700), 220, np.uint8)
        for y in range(50, 500, 80):
            for x in range(30, 660, 60):
                font, width = int(rng.choice((0, 2, 3, 4))), int(rng.integers(2, 12))
                size, shade = rng.uniform(0.6, 2.2), int(rng.integers(10, 60))
                cv2.putText(image, "P", (x, y), font, size, shade, width, cv2.LINE_AA)
        sign = cv2.GaussianBlur(image, (0, 0), blur) + rng.normal(0.0, 2.5, image.shape)
        assert finder.find(np.clip(sign, 0, 255).astype(np.uint8))["tag"].tolist() == []


def test_candidates_are_the_same_in_one_part_and_in_many(monkeypatch: pytest.MonkeyPatch) -> None:
    image, truth = draw("DICT_4X4_50", [4, 9], 5)
    rng = np.random.default_rng(5)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (400, 400)).astype(np.uint8), (0, 0), 1.5)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    whole = np.hstack((image, cv2.copyMakeBorder(texture, 120, 120, 0, 0, cv2.BORDER_REFLECT)))
    finder = SquareFinder(squares.codes_of("DICT_4X4_50"))
    assert len(squares.find_quads(whole, 10.0, 900.0)) > 700
    rows = finder.find(whole)
    assert rows["tag"].tolist() == [4, 9]
    for row in rows:
        assert np.abs(row["corners_px"] - truth[int(row["tag"])]).max() < 0.25
    monkeypatch.setattr(squares, "_TOGETHER", 7)
    assert finder.find(whole).tobytes() == rows.tobytes()


def test_from_python_an_array_and_its_file_give_what_the_command_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, truth = draw("DICT_4X4_50", [3, 17, 40], 1)
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), image)
    coloured = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    assert cli.main(["camera", "markers", "find", str(path), "--family", "4X4_50"]) == 0
    printed = json.loads(capsys.readouterr().out)["markers"]
    for picture in (image, coloured, path, str(path)):
        markers = vsense.detect(picture, "DICT_4X4_50")
        assert markers["tag"].tolist() == sorted(truth) == [one["tag"] for one in printed]
        corners = [one["corners_px"] for one in printed]
        assert np.abs(markers["corners_px"] - corners).max() <= 0.0005
    assert len(vsense.detect(image, "DICT_4X4_50", least_side_px=400)) == 0


def test_from_python_a_dictionary_that_has_changed_is_read_again(tmp_path: Path) -> None:
    image, _ = draw("DICT_4X4_50", [3, 17], 2)
    path, words = tmp_path / "own.yml", cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    found = []
    for count in (1, 20):
        few = cv2.aruco.Dictionary(words.bytesList[3 : 3 + count], 4, 1)
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        few.writeDictionary(storage)
        storage.release()
        os.utime(path, ns=(count, count))
        found.append(vsense.detect(image, str(path))["tag"].tolist())
    assert found == [[0], [0, 14]]


@pytest.mark.parametrize(
    ("picture", "family", "side_px", "message"),
    [
        (np.zeros((9, 9, 2), np.uint8), "4X4_50", 10, "has 2 channels, expected 1, 3 or 4"),
        (np.zeros((9, 9)), "4X4_50", 10, "is no picture: float64 of shape (9, 9)"),
        ([["a"]], "4X4_50", 10, "is no picture: <U1 of shape (1, 1)"),
        ("none.png", "4X4_50", 10, "none.png cannot be read: No such file or directory"),
        (np.zeros((9, 9), np.uint8), "4X4_5", 10, "family: '4X4_5' is neither"),
        (np.zeros((9, 9), np.uint8), "4X4_50", 0, "least_side_px: 0, expected a number of"),
        (np.zeros((9, 9), np.uint8), "4X4_50", float("nan"), "least_side_px: nan, expected"),
    ],
)
def test_from_python_what_cannot_be_used_is_told(
    picture: Any, family: str, side_px: float, message: str
) -> None:
    with pytest.raises(VsenseError, match=re.escape(message)):
        vsense.detect(picture, family, side_px)


def test_sheets_want_numbers_and_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["markers", "--ids", "1-3"]) == 2
    said = capsys.readouterr().err
    assert "expected -o and --ids, --roster or --for for sheets, or the action find" in said
