"""Sheets of markers: what is printed is what the families draw and what the detector reads."""

from __future__ import annotations

import json
import re
import struct
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.conftest import require_tool
from tests.vision.markers.texture import draw_texture
from vsense import cli
from vsense.base.arena import UNNAMED, wrap_angle
from vsense.base.errors import UsageError
from vsense.config.experiment import load, read
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers import _paper as pdf
from vsense.vision.markers import _paper as raster
from vsense.vision.markers import families, sheet
from vsense.vision.markers._paper import Fill, Page, Text
from vsense.vision.markers.families import MarkerFamily, load_family
from vsense.vision.markers.sheet import in_words, shapes
from vsense.vision.tracking._detector import make_detector
from vsense.world.robot_models import MODELS_FOLDER

ARROW = load_family("arrow4x4")
FAMILIES = ["arrow4x4", "arrow4x4-thesis", "aruco_4x4_50", "apriltag_36h11"]


def printed(pages: list[Page], dpi: float, folder: Path) -> list[np.ndarray]:
    """Returns what a PDF program makes of the pages."""
    tool = require_tool("pdftoppm", "poppler-utils")
    file = folder / "sheet.pdf"
    file.write_bytes(pdf.document(pages))
    subprocess.run([tool, "-r", str(dpi), "-gray", "-png", file, folder / "page"], check=True)
    return [cv2.imread(str(name), cv2.IMREAD_GRAYSCALE) for name in sorted(folder.glob("*.png"))]


def seen_from_above(image: np.ndarray, dpi: float) -> Camera:
    """Returns the camera to which a page on the floor of the arena looks like the picture."""
    size = (image.shape[1], image.shape[0])
    return Camera.looking_down("page", 0.0, 0.0, 2.0, dpi / 0.0254 * 2.0, size, (0.0,) * 5)


@pytest.mark.parametrize("name", FAMILIES)
def test_polygons_are_the_familys_own_drawing(name: str) -> None:
    family = load_family(name)
    for tag in np.random.default_rng(1).integers(family.tags, size=4).tolist():
        texture = draw_texture(family, tag, 6.0)
        middle_mm = (texture.centre_px + 0.5) / 6.0
        page = Page(2.0 * middle_mm, 2.0 * middle_mm)
        for fill in shapes(family, tag):
            page.items.append(Fill([p + middle_mm for p in fill.polygons], fill.grey))
        drawn = raster.draw(page, 6.0 * raster.MM_PER_INCH)
        apart = np.abs(drawn.astype(int) - texture.ink)
        assert drawn.shape == texture.ink.shape
        assert apart.max() <= 72 and apart.mean() < 1.0


def test_pdf_and_png_show_the_same_at_true_scale(tmp_path: Path) -> None:
    pages = sheet.pages(ARROW, [23, 4334, 52447], 70.0, "a4")
    (paper,) = printed(pages, 127.0, tmp_path)
    drawn = raster.draw(pages[0], 127.0)
    assert drawn.shape == (1485, 1050)
    paper = paper[:1485, :1050]  # poppler rounds a page's size up
    body = slice(75, 925)
    assert np.abs(paper[body].astype(int) - drawn[body]).mean() < 1.5  # edges and fonts
    for image in (paper, drawn):
        bar = image[1430:1436, :555].min(axis=0) < 128  # left of its text
        assert np.ptp(np.flatnonzero(bar)) / 5.0 == pytest.approx(100.0, abs=0.5)


@pytest.mark.parametrize("dpi", [18.0, 30.0])
@pytest.mark.parametrize("name", FAMILIES)
def test_detector_reads_every_printed_marker_at_its_place(
    tmp_path: Path, name: str, dpi: float
) -> None:
    family = load_family(name)
    chosen = families.parse_tags("auto:12", family)
    pages = sheet.pages(family, chosen, 70.0, "a4")
    detector = make_detector(family, chosen, 0.0)
    found = []
    for image in printed(pages, dpi, tmp_path):
        camera = seen_from_above(image, dpi)
        rows = detector.detect(image, camera)
        named = rows[rows["tag"] != UNNAMED]
        found += named["tag"].tolist()
        assert np.abs(wrap_angle(named["yaw_rad"] - np.pi / 2)).max() < np.radians(1.0)
        ground = camera.to_plane(np.stack((named["x_px"], named["y_px"]), axis=-1), 0.0)
        step_mm = np.diff(np.unique(np.round(1e3 * ground[:, 0] / 5.0))) * 5.0
        assert step_mm == pytest.approx(75.0, abs=5.0)
    assert sorted(found) == chosen


def test_a_larger_body_has_its_edge_around_a_disc_of_the_same_size(tmp_path: Path) -> None:
    """A detector reads a marker in so much white, and the outer line is as wide as the body."""
    bodies = {23: 160.0, 4334: 70.0, 52447: 170.0, 7: 75.0, 9: 400.0}
    pages = sheet.pages(ARROW, list(bodies), 70.0, "a4", bodies_mm=bodies)
    assert len(pages) == 3
    detector = make_detector(ARROW, list(bodies), 0.0)
    widths = {}
    for image in printed(pages, 50.8, tmp_path):
        rows = detector.detect(image, seen_from_above(image, 50.8))
        for row in rows[rows["tag"] != UNNAMED]:
            y = round(float(row["y_px"]))
            dark = np.flatnonzero(image[y - 4 : y + 5].min(axis=0) < 245)
            widths[int(row["tag"])] = np.ptp(dark) / 2.0
    assert set(widths) == set(bodies)
    assert widths[23] == pytest.approx(160.0, abs=1.5)
    assert widths[52447] == pytest.approx(170.0, abs=1.5)


def test_every_tag_is_on_the_sheet_and_nothing_leaves_the_paper() -> None:
    for paper, (width, height) in sheet.PAPERS_MM.items():
        for size in (10.0, 33.3, 70.0, sheet.largest_mm(paper)):
            pages = sheet.pages(ARROW, list(range(65500, 65520)), size, paper)
            texts = [item.text for page in pages for item in page.items if hasattr(item, "text")]
            words = [text.split()[0] for text in texts]
            # On the disc, and below it.
            assert all(words.count(str(tag)) == 2 for tag in range(65500, 65520))
            for page in pages:
                fills = [i for i in page.items if isinstance(i, Fill)]
                corners = np.concatenate([p for i in fills for p in i.polygons])
                assert corners.min() > 5.0 and np.all(corners.max(axis=0) < (width - 5, height - 5))


@pytest.mark.parametrize("size", [10.0, 33.3, 70.0, 120.0])
def test_no_caption_is_wider_than_its_disc_or_reaches_the_next_one(size: float) -> None:
    tags = [32499, 52367, 57535, 7, 65535, 373]  # of the longest numbers in words
    (page, *_) = sheet.pages(ARROW, tags, size, "a4", {52367: "robot_with_a_long_name_52367_11"})
    middles = [p for p in page.items if isinstance(p, Fill)][::2]  # each marker's black part
    captions = [t for t in page.items if isinstance(t, Text) and t.grey == 0.0][1:]
    captions = [t for t in captions if "bar" not in t.text and "print" not in t.text]
    assert captions and middles
    assert max(text.width_mm for text in captions) <= size + 1e-6
    lines = sorted({(round(t.x_mm, 3), round(t.y_mm, 3)): t for t in captions}.items())
    assert len(lines) == len(captions)
    for (x, y), text in lines:
        above = [t for (other, high), t in lines if other == x and 0.0 < high - y < size]
        assert all(t.y_mm - y >= text.size_mm for t in above)


def test_pdf_is_sound_and_reproducible() -> None:
    pages = sheet.pages(ARROW, [1, 2, 3, 4, 5, 6, 7], 70.0, "letter")
    data = pdf.document(pages)
    assert data == pdf.document(pages) and data.count(b"/Type /Page ") == 2
    start = int(data.split(b"startxref\n")[1].split(b"\n")[0])
    lines = data[start:].split(b"\n")
    places = [int(line[:10]) for line in lines[3 : 2 + int(lines[1].split()[1])]]
    assert all(data[at:].startswith(b"%d 0 obj" % n) for n, at in enumerate(places, 1))


def test_png_knows_its_resolution() -> None:
    image = raster.draw(sheet.pages(ARROW, [5], 70.0, "a4")[0], 100)
    data = raster.png(image, 100)
    at = data.index(b"pHYs") + 4
    assert struct.unpack(">IIB", data[at : at + 9]) == (3937, 3937, 1)
    assert np.array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), -1), image)


@given(st.integers(0, 999_999))
@settings(max_examples=50)
def test_numbers_in_words_are_unique_and_plain(number: int) -> None:
    words = in_words(number)
    assert words == words.strip() and "  " not in words
    assert words != in_words((number + 1) % 1_000_000)


def test_numbers_in_words() -> None:
    assert in_words(0) == "zero"
    assert in_words(21) == "twenty-one"
    assert in_words(1100) == "one thousand one hundred"
    assert in_words(65_535) == "sixty-five thousand five hundred and thirty-five"
    assert in_words(40_007) == "forty thousand and seven"


def test_ids_are_ranges_lists_and_choices() -> None:
    assert families.parse_tags("1-3,7, 20-21", ARROW) == [1, 2, 3, 7, 20, 21]
    assert len(set(families.parse_tags("auto:20", ARROW))) == 20
    assert len(set(families.parse_tags("auto:50", load_family("aruco_4x4_50")))) == 50


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "number or range"),
        ("1-", "'1-'.*number"),
        ("5-3", "goes backwards"),
        ("1-3,2", "tag 2.*twice"),
        ("65536", "tag 65536"),
        ("0-60000", "more than 1000"),
        ("auto:0", "expected auto:N"),
        ("auto:x", "expected auto:N"),
        ("-4", "number or range"),
    ],
)
def test_wrong_ids_are_refused_with_the_reason(text: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        families.parse_tags(text, ARROW)


def test_too_many_automatic_ids_of_a_dictionary_are_refused() -> None:
    with pytest.raises(UsageError, match=r"51 tags:.*aruco_4x4_50.*50"):
        families.parse_tags("auto:51", load_family("aruco_4x4_50"))


def test_chosen_dictionary_tags_lie_farther_apart_than_the_first_ones() -> None:
    family = load_family("apriltag_36h11")
    assert not isinstance(family, MarkerFamily)
    bits = family.codes.bits().astype(np.float32)
    soft = [cv2.GaussianBlur(np.kron(tag, np.ones((3, 3))), (0, 0), 1.2) for tag in bits]

    def apart(chosen: list[int]) -> float:
        return min(
            float(((soft[a] - np.rot90(soft[b], turn)) ** 2).sum())
            for a in chosen
            for b in chosen
            for turn in range(4)
            if a != b
        )

    assert apart(families.parse_tags("auto:8", family)) > 1.2 * apart(list(range(8)))


def test_command_writes_files_and_names_them(tmp_path: Path, capsys) -> None:
    name = tmp_path / "m.png"
    words = ["markers", "--ids", "1-8", "--size", "80mm", "--dpi", "72", "-o", str(name)]
    assert cli.main(words) == 0
    said = capsys.readouterr()
    assert said.out.split() == [str(tmp_path / f"m-{n}.png") for n in (1, 2)]
    assert all(Path(file).stat().st_size > 1000 for file in said.out.split())
    assert "1.14286 times as large" in said.err
    assert "tags 1 and 3 differ in one cell (" in said.err


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--ids", "1", "-o", "x.svg"], "ends in .pdf or .png"),
        (["--ids", "1", "--size", "300mm", "-o", "x.pdf"], "expected 10 to"),
        (["--ids", "1", "-o", "/nowhere/x.pdf"], "cannot be written"),
    ],
)
def test_command_says_what_is_wrong(words: list[str], reason: str, capsys) -> None:
    assert cli.main(["markers", *words]) == 2
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize("size", ["70", "7m", "mm", "-3mm"])
def test_sizes_need_a_unit(size: str, capsys) -> None:
    with pytest.raises(SystemExit):
        cli.main(["markers", "--ids", "1", f"--size={size}", "-o", "x.pdf"])
    assert "such as 70mm" in capsys.readouterr().err


def test_an_experiment_has_the_sheets_that_its_robots_need(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    worn = load("pollutant")
    output = tmp_path / "worn.png"
    assert cli.main(["markers", "--for", "pollutant", "-o", str(output), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    tags = [robot.tag for robot in worn.robots] + [thing.tag for thing in worn.objects]
    assert told["tags"] == tags and Path(told["files"][0]).is_file()


def test_a_rosters_sheets_know_bodies_and_name_those_smaller_than_a_disc(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    epuck = (MODELS_FOLDER / "epuck.toml").read_text()
    small = epuck.replace("radius_m = 0.035", "radius_m = 0.03", 1).replace("0.053", "0.05", 1)
    (tmp_path / "small.toml").write_text(small)
    models = {31: "epuck", 1843: "thymio2", 4334: "small"}
    roster = tmp_path / "robots.toml"
    roster.write_text("".join(f'[[robot]]\ntag={t}\nmodel="{m}"\n' for t, m in models.items()))
    words = ["markers", "--roster", str(roster), "-o", str(tmp_path / "m.png"), "--dpi", "72"]
    assert cli.main(words) == 0
    said = capsys.readouterr()
    assert len(said.out.split()) == 2
    assert "larger than the bodies of 4334 (60 mm)" in " ".join(said.err.split())
    assert cli.main([*words, "--size", "60mm"]) == 0
    assert "larger than the bodies" not in capsys.readouterr().err
    tiny = (MODELS_FOLDER / "kheperaiv.toml").read_text().partition("# Clockwise")[0]
    tiny = tiny.replace("0.0704", "0.003").replace("0.1054", "0.004")
    (tmp_path / "small.toml").write_text(tiny)
    assert cli.main([*words, "--size", "10mm"]) == 0  # smaller ones are refused
    assert "(6 mm)" in (told := " ".join(capsys.readouterr().err.split())) and "no size" in told
    roster.write_text(roster.read_text().replace('"small"', '"smal"'))
    assert cli.main(words) == 2
    assert "robots.toml:7: model: there is no robot model 'smal'" in capsys.readouterr().err


def test_robots_without_tags_wear_those_of_auto() -> None:
    """And another robot leaves the others theirs."""
    path = load("phototaxis").path
    text = re.sub(r'\bvs:tags="[^"]*"', "", path.read_text())
    before: list[int] = []
    for count in (9, 10, 15):
        fewer = re.sub(r'quantity="[0-9]+"', f'quantity="{count}"', text, count=1)
        found = [robot.tag for robot in read(fewer.encode(), "x.argos", path).robots]
        assert sorted(found) == families.parse_tags(f"auto:{count}", ARROW)
        assert found[: len(before)] == before
        before = found
