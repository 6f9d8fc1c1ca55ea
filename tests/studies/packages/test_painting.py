"""Pictures in a package: nobody beside the arena, and every marker inside as it was."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.monitor.recording.conftest import BEGIN_NS, record
from tests.vision.tracking.synthetic import Robot, render
from vsense import cli
from vsense.base.arena import Frame
from vsense.base.message_bus import Message
from vsense.monitor.recording.reader import open_recording
from vsense.run.runs_csv import RunRow, RunsFile
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker

TOP_M = 0.14
CAMERA = Camera.looking_down("top", 0.1, 0.0, 2.43, 700.0, (800, 600), (-0.12, 0.02, 0.0, 0.0, 0.0))
FAMILY = load_family("arrow4x4")
ARENA_M = (1.4, 1.0)
ROBOTS = [Robot(31, -0.69, 0.49, 0.3), Robot(1843, 0.69, -0.49, 2.0), Robot(7167, 0.69, 0.0, 4.0)]
"""At the edge, high above the floor: the camera sees them beside it."""


def outside() -> np.ndarray:
    """Where the picture shows floor that is more than 0.35 m from the arena; by OpenCV."""
    edge = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = np.concatenate(
        [np.linspace(a, b, 50) for a, b in zip(edge, np.roll(edge, -1, axis=0), strict=True)]
    ) * (ARENA_M[0] / 2 + 0.35, ARENA_M[1] / 2 + 0.35)
    points = np.column_stack((corners, np.zeros(len(corners))))
    turn = np.reshape(CAMERA.rotation, (3, 3))
    middle = np.array([[700.0, 0, CAMERA.cx_px], [0, 700.0, CAMERA.cy_px], [0, 0, 1]])
    move = -turn @ np.array(CAMERA.position_m)
    pixels = cv2.projectPoints(
        points, cv2.Rodrigues(turn)[0], move, middle, np.array(CAMERA.distortion)
    )[0]
    inside = np.zeros((600, 800), np.uint8)
    cv2.fillPoly(inside, [np.rint(pixels).astype(int)], 1)
    return inside == 0


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A real run: a person with a badge beside the arena, and a camera that is not calibrated."""
    folder = tmp_path / "lab"
    folder.mkdir()
    image = render(CAMERA, FAMILY, ROBOTS, height_m=TOP_M)
    image[outside()] //= 3
    cv2.putText(image, "ANNA", (8, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.2, 250, 3)
    cameras: list[dict[str, Any]] = [
        {"id": "top", "model": json.loads(CAMERA.to_json())}, {"id": "door"},
    ]  # fmt: skip
    facts = {
        "mode": "live", "cameras": cameras, "objects": [], "timestep_s": 0.1,
        "arena": {"size_m": [*ARENA_M, 1.0], "centre_m": [0.0, 0.0, 0.5]},
        "robots": [{"tag": robot.tag, "height_m": TOP_M} for robot in ROBOTS],
    }  # fmt: skip
    frames = [Frame(c, image, n, BEGIN_NS, BEGIN_NS) for n in (1, 2) for c in ("top", "door")]
    record(folder / "run.mcap", [Message("/experiment", BEGIN_NS, facts)], frames)
    for name in ("run.png", "film.webm"):
        (folder / name).write_bytes(b"ANNA")
    row = RunRow(run="1", mode="run", experiment="x", condition="sighted", seed=1, tags=[31])
    RunsFile(folder / "runs.csv").append(row)
    return folder


def packed(run: Path, *words: str) -> tuple[set[str], dict[str, list[np.ndarray]]]:
    """The names in a package of the run, and its pictures by their camera."""
    target = run.parent / "run.zip"
    assert cli.main(["pack", str(run), "-o", str(target), "--no-report", *words]) == 0
    pictures: dict[str, list[np.ndarray]] = {}
    with zipfile.ZipFile(target) as whole:
        names = {name.rpartition("/")[2] for name in whole.namelist()}
        copy = Path(whole.extract("lab/run.mcap", run.parent / "unpacked"))
    with open_recording(copy) as opened:
        for message in opened.messages(lambda topic: topic.startswith("/picture")):
            data = cv2.imdecode(np.frombuffer(message.blob, np.uint8), cv2.IMREAD_GRAYSCALE)
            pictures.setdefault(message.data["camera"], []).append(np.asarray(data))
    return names, pictures


def poses(image: np.ndarray) -> dict[int, tuple[float, float]]:
    tracker = ArenaTracker.for_family([CAMERA], FAMILY, {r.tag: TOP_M for r in ROBOTS})
    try:
        state = tracker.update([Frame("top", image, 0, 0, 0)])
    finally:
        tracker.close()
    return {int(row["tag"]): (float(row["x_m"]), float(row["y_m"])) for row in state.robots}


def test_nothing_beside_the_arena_is_left_and_markers_inside_decode(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names, pictures = packed(run, "--pictures")
    said = capsys.readouterr().err
    assert "pictures, painted over outside of the arena (--unmasked) (2)" in said
    assert "pictures of camera door are left out (2): its calibration or the arena is not" in said
    assert "videos, and pictures of real runs (--unmasked) (2)" in said
    assert pictures.keys() == {"top"} and not names & {"run.png", "film.webm"}
    image = render(CAMERA, FAMILY, ROBOTS, height_m=TOP_M)
    wanted = poses(image)
    assert wanted.keys() == {robot.tag for robot in ROBOTS}
    for picture in pictures["top"]:
        assert len(np.unique(picture[outside()])) == 1 and outside().mean() > 0.1
        assert poses(picture) == wanted, "markers at the edge are the same in every bit"


def test_whoever_says_so_packs_everything(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names, pictures = packed(run, "--pictures", "--unmasked")
    assert {"run.png", "film.webm"} <= names and pictures.keys() == {"top", "door"}
    assert pictures["top"][0][outside()].std() > 5.0
    assert cli.main(["pack", str(run), "-o", str(run.parent / "b.zip"), "--unmasked"]) == 2
    assert "--unmasked belongs to --pictures" in capsys.readouterr().err
