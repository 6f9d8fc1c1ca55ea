"""Markers that are too small to be named: the limits hold in rendered pictures, and are told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, inclined, render
from vsense import cli
from vsense.base.clock import host_ns
from vsense.config import tracking_session
from vsense.tools.camera_setup.showing import save_picture
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers import families
from vsense.vision.markers._dictionary import load_codes
from vsense.vision.markers.families import MarkerFamily, SquareFamily, load_family
from vsense.vision.tracking import opening
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking._legibility import legibility
from vsense.vision.tracking.marker_detector import cell_width, cell_width_seen
from vsense.vision.tracking.opening import open_tracking

FAMILIES = ["arrow4x4", "arrow4x4-thesis", "aruco_4x4_50", "apriltag_36h11"]
AWAY_M = 2.37


def named(family: MarkerFamily | SquareFamily, cell_px: float, look: Look) -> tuple[float, int]:
    """Returns the share of 48 markers that are named, and how many are misread."""
    px_per_m = cell_px / (1e-3 * family.cell_mm)
    size = max(300, int(1.3 * px_per_m)), max(220, int(px_per_m))
    camera = Camera.looking_down("c", 0.0, 0.0, HEIGHT_M + AWAY_M, px_per_m * AWAY_M, size)
    roster = families.parse_tags("auto:20", family)
    places = np.array([(x, y) for x in (-0.45, -0.22, 0.0, 0.22, 0.45) for y in (-0.3, 0.0, 0.3)])
    right = wrong = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        middles = places[rng.permutation(15)[:12]] + rng.uniform(-0.03, 0.03, (12, 2))
        tags = rng.permutation(roster)[:12]
        turns = rng.uniform(-np.pi, np.pi, 12)
        robots = [Robot(int(t), *m, float(a)) for t, m, a in zip(tags, middles.tolist(), turns)]
        image = render(camera, family, robots, look, seed)
        for row in make_detector(family, roster, HEIGHT_M).detect(image, camera):
            place = camera.to_plane(np.array([row["x_px"], row["y_px"]]), HEIGHT_M)
            apart = np.hypot(*(middles - place).T)
            if row["tag"] >= 0:
                is_right = apart.min() < 0.03 and row["tag"] == tags[apart.argmin()]
                right, wrong = right + is_right, wrong + (not is_right)
    return right / 48.0, wrong


@pytest.mark.parametrize("name", FAMILIES)
def test_markers_are_named_where_cells_are_good_and_hardly_where_they_are_refused(
    name: str,
) -> None:
    family = load_family(name)
    limits = cell_width(family, 100.0)
    share, wrong = named(family, limits.good_px, Look())
    assert share >= 0.85 and wrong == 0
    few, wrong = named(family, 0.7 * limits.least_px, Look())
    assert few < 0.25


def test_small_cells_are_not_misread() -> None:
    """Those of the thesis were, where they are so small that they are refused now."""
    family = load_family("arrow4x4-thesis")
    soft = Look(psf_px=1.0, noise=4.0)
    # One of 48 is chance: it comes and goes with the last bit of the picture's arithmetic.
    assert max(named(family, px, soft)[1] for px in (0.6, 0.65, 0.8, 1.0)) <= 1


def test_width_is_cell_over_distance_times_focal_length() -> None:
    camera = Camera.looking_down("c", 0.3, -0.2, 2.43, 635.0, (1620, 1220), (-0.1, 0.02, 0, 0, 0))
    width, text = cell_width_seen(load_family("arrow4x4"), camera, 0.06)
    assert width.px == pytest.approx(5.3e-3 * 635.0 / 2.37, rel=1e-3)
    assert (width.least_px, width.good_px) == (1.0, 2.0)
    assert not width.is_illegible and width.is_small
    assert text == (
        "the cells of arrow4x4, 5.3 mm, are 1.4 px wide, seen from 2.37 m above with a focal length"
        " of 635 px: expected at least 1 px, and 2 px for all robots to be named; hang it lower,"
        " take a longer lens or more pixels, or print the markers 1.4 times as large"
    )


def test_any_dictionary_and_any_cells_have_limits() -> None:
    sizes = (45.0, 0.0, 70.0, (0.0, 0.0))
    square = SquareFamily("mine", load_codes("DICT_7X7_100"), *sizes)
    assert cell_width(square, 400.0).px == pytest.approx(2.0) and square.cell_mm == 5.0
    assert not cell_width(square, 401.0).is_small and cell_width(square, 199.0).is_illegible
    thesis = load_family("arrow4x4-thesis")
    assert (cell_width(thesis, 1.0).least_px, cell_width(thesis, 1.0).good_px) == (0.7, 1.0)
    fine = replace(thesis, cell_mm=1.0)
    assert (cell_width(fine, 1.0).least_px, cell_width(fine, 1.0).good_px) == (0.7, 0.7)


def test_an_inclined_camera_reads_what_it_is_said_to_read() -> None:
    family, camera = load_family("arrow4x4"), inclined(60, 900.0)
    legible = legibility(family, camera, HEIGHT_M, columns=160)
    roster = families.parse_tags("auto:20", family)
    named: dict[bool, list[bool]] = {True: [], False: []}
    for seed in range(4):
        rng, robots, unread = np.random.default_rng(seed), list[Robot](), dict[int, bool]()
        while len(robots) < 20:
            row, column = (int(rng.integers(8, n - 8)) for n in legible.widths_px.shape)
            x, y = legible.places_m[row, column].tolist()
            is_clear = legible.unread[row, column] or not legible.seldom[row, column]
            # Sky and what is smaller than a pixel is left out, and so are neighbours.
            if legible.widths_px[row, column] < 0.5 or not is_clear:
                continue
            if all(np.hypot(r.x_m - x, r.y_m - y) > 0.1 for r in robots):
                unread[tag := roster[len(robots)]] = bool(legible.unread[row, column])
                robots.append(Robot(tag, x, y, float(rng.uniform(-np.pi, np.pi))))
        robots.sort(key=lambda robot: robot.y_m)
        image = render(camera, family, robots, Look(light=0.15, vignetting=0.2), seed)
        seen = make_detector(family, roster, HEIGHT_M).detect(image, camera)["tag"].tolist()
        for tag, is_unread in unread.items():
            named[is_unread].append(tag in seen)
    assert min(map(len, named.values())) >= 20
    assert np.mean(named[False]) >= 0.97 and np.mean(named[True]) < 0.4
    assert legible.in_words().startswith("in 54 % of where its picture may show")


RESOURCES = """<arena_tracking_system>
<grabbers><grabber id="g" type="camera" device="/dev/video_none" />
<grabber id="r" type="directory" path="pictures" /></grabbers>
<trackers><tracker id="t" family="arrow4x4" tags="31 700" /></trackers>
<cameras><camera id="far" calibration="far.json" /></cameras>
</arena_tracking_system>"""

EXPERIMENT = """<arena_tracking><arena_state_tracker>
<camera_state_tracker grabber="{grabber}" camera="far" tracker="t" />
</arena_state_tracker></arena_tracking>"""


def write(folder: Path, height_m: float, grabber: str) -> list[str]:
    camera = Camera.looking_down("far", 0.0, 0.0, height_m, 620.0, (820, 610))
    (folder / "far.json").write_text(camera.to_json())
    (folder / "pictures").mkdir()
    image = render(camera, load_family("arrow4x4"), [], Look(), 1)
    save_picture(image, folder / "pictures" / "1.png")
    (folder / "resources.xml").write_text(RESOURCES)
    (folder / "experiment.xml").write_text(EXPERIMENT.format(grabber=grabber))
    return [str(folder / "resources.xml"), str(folder / "experiment.xml")]


def test_what_an_inclined_camera_cannot_read_is_told_when_it_is_opened(tmp_path: Path) -> None:
    files = write(tmp_path, 1.6, "r")
    (tmp_path / "far.json").write_text(replace(inclined(60, 2000.0), id="far").to_json())
    told: list[str] = []
    open_tracking(tracking_session.load(*files), host_ns, told.append).close()
    (line,) = (line for line in told if "oblique" in line)
    assert line.startswith("camera far: ") and "calibrate check --tracking paints it" in line


def test_a_camera_too_far_away_is_refused_before_it_is_opened_and_with_the_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    files = write(tmp_path, 4.2, "g")
    monkeypatch.delattr(opening, "live_grabber")
    assert cli.main(["track", *files]) == 2
    assert capsys.readouterr().err == (
        f"vsense: {files[1]}:2: <camera_state_tracker> camera: 'far': the cells of arrow4x4,"
        " 5.3 mm, are 0.79 px wide, seen from 4.14 m above with a focal length of 620 px: expected"
        " at least 1 px, and 2 px for all robots to be named; hang it lower, take a longer lens or"
        " more pixels, or print the markers 2.5 times as large\n"
    )


def test_a_camera_with_small_cells_is_told_and_one_with_good_cells_is_not(tmp_path: Path) -> None:
    for number, (height_m, lines) in enumerate(((2.5, 1), (1.6, 0))):
        folder = tmp_path / str(number)
        folder.mkdir()
        told: list[str] = []
        session = tracking_session.load(*write(folder, height_m, "g"))
        open_tracking(session, host_ns, told.append).close()
        cells = [line for line in told if "cells" in line]
        assert len(cells) == lines
        assert all(line.startswith("camera far: the cells of arrow4x4") for line in cells)


def test_a_recording_of_small_cells_is_told_and_tracked_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = write(tmp_path, 4.2, "r")
    cli.main(["track", *files, "--offline"])
    out = capsys.readouterr()
    assert "camera far: the cells of arrow4x4, 5.3 mm, are 0.79 px wide" in out.err
    assert len(out.out.splitlines()) == 1
