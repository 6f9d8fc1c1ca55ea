"""`vsense camera arena align`: a frame that was put off comes back, by pixels and by the page.

The shipped experiments have the arena of `ARENA`.
"""

from __future__ import annotations

import json
import threading
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from tests.vision.calibration.ideal import ARENA, CAMERAS
from vsense.cli import main
from vsense.tools.camera_setup.aligning import AlignServer, AlignTask
from vsense.vision.calibration.alignment import points_of
from vsense.vision.calibration.frame import FrameShift
from vsense.vision.cameras.camera import Camera

OFF = FrameShift(0.03, -0.02, np.radians(1.5))
CORNERS = points_of(ARENA.corners_m, 0.0)


@pytest.fixture
def cameras(tmp_path: Path) -> Path:
    """Camera files whose frame is not the arena's."""
    folder = tmp_path / "cameras"
    folder.mkdir()
    for camera in CAMERAS:
        (folder / f"{camera.id}.json").write_text(OFF.moved(camera).to_json())
    return folder


def clicks() -> list[tuple[str, str, float, float]]:
    """Where the true cameras see the corners: camera, point, pixel."""
    seen = []
    for camera in CAMERAS:
        for name, place in CORNERS.items():
            pixel = camera.project(place)
            if camera.contains(pixel):
                seen.append((camera.id, name, float(pixel[0]), float(pixel[1])))
    assert len(seen) == 4
    return seen


def read(folder: Path) -> list[Camera]:
    return [Camera.from_json(path.read_text()) for path in sorted(folder.glob("*.json"))]


def test_clicks_bring_the_frame_back_and_undo_puts_it_off_again(
    cameras: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path.name: path.read_bytes() for path in cameras.glob("*.json")}
    words = [f"--click={c}:{p}:{x:.3f},{y:.3f}" for c, p, x, y in clicks()]
    align = ["arena", "align", "pollutant", "--cameras", str(cameras)]
    assert main([*align, *words, "--dry"]) == 0
    assert "nothing was changed" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in cameras.glob("*.json")} == before
    (cameras / "report").mkdir()
    (cameras / "report" / "check.json").write_text("{}")
    assert main([*align, *words, "--json"]) == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert found["rms_mm"] < 0.05 and found["shift"]["yaw_deg"] == pytest.approx(-1.5, abs=1e-3)
    assert "4 camera files moved" in told.err and "vsense camera calibrate check again" in told.err
    for camera, true in zip(read(cameras), CAMERAS):
        assert camera.position_m == pytest.approx(true.position_m, abs=1e-4)
        assert camera.rotation == pytest.approx(true.rotation, abs=1e-4)
        assert (camera.fx_px, camera.distortion) == (true.fx_px, true.distortion)
    assert json.loads((cameras / "report" / "align.json").read_text())["clicks"] == found["clicks"]
    moved = sorted(cameras.glob("*.json"))[1]
    kept, anew = moved.read_text(), json.loads(moved.read_text())
    anew["position_m"][0] += 0.001
    moved.write_text(json.dumps(anew))
    assert main(["arena", "align", "--undo", "--cameras", str(cameras)]) == 2
    assert "made again since" in capsys.readouterr().err
    assert json.loads(moved.read_text()) == anew, "a calibration is not lost by an undo"
    moved.write_text(kept)
    assert main(["arena", "align", "--undo", "--cameras", str(cameras)]) == 0
    assert {path.name: path.read_bytes() for path in cameras.glob("*.json")} == before
    assert main(["arena", "align", "--undo", "--cameras", str(cameras)]) == 2
    assert "nothing was aligned here" in capsys.readouterr().err


def test_a_wrong_click_is_told(
    cameras: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{c},{p},{x + 60 * (p == 'ne'):.2f},{y:.2f}" for c, p, x, y in clicks()]
    seen = tmp_path / "seen.csv"
    seen.write_text("\n".join(["camera,id,x_px,y_px", *rows, ""]))
    words = ["arena", "align", "pollutant", "--cameras", str(cameras), "--seen", str(seen), "--dry"]
    assert main(words) == 0
    told = capsys.readouterr()
    assert "mm at worst: a click is wrong, or the real arena" in told.err


def test_the_page_moves_the_frame_once(cameras: Path) -> None:
    saved = []
    known = {camera.id: camera for camera in read(cameras)}
    pictures = {c.id: np.full((c.height_px, c.width_px), 90, np.uint8) for c in CAMERAS}
    task = AlignTask(known, CORNERS, np.array(list(CORNERS.values())), pictures, saved.append)
    done = threading.Event()
    with AlignServer(task, 0) as server:
        serving = threading.Thread(target=server.serve_until, args=(done.wait,))
        serving.start()
        where = urlsplit(server.url)

        def ask(
            path: str, body: object = None, host: str | None = None, lead: str = where.path
        ) -> tuple[int, bytes]:
            link = HTTPConnection(where.hostname or "", where.port or 0, timeout=10.0)
            text = None if body is None else json.dumps(body)
            headers = {"Host": host} if host else {}
            link.request("GET" if body is None else "POST", lead + path, text, headers)
            answer = link.getresponse()
            found = answer.status, answer.read()
            link.close()
            return found

        status, page = ask("")
        assert status == 200 and b"Where is the arena?" in page
        assert ask("align.js")[0] == ask("align.css")[0] == 200
        assert ask("", lead="/")[0] == ask("", host="evil.example:80")[0] == 404
        begun = json.loads(ask("start.json")[1])
        assert [c["id"] for c in begun["cameras"]] == [c.id for c in CAMERAS]
        assert begun["points"] == ["sw", "se", "ne", "nw"]
        image = cv2.imdecode(np.frombuffer(ask("picture/0")[1], np.uint8), cv2.IMREAD_GRAYSCALE)
        assert image.shape == (1220, 1620) and ask("picture/9")[0] == 404
        put = [dict(zip(("camera", "point", "x", "y"), click)) for click in clicks()]
        assert json.loads(ask("solve", put[:1])[1])["found"] is None
        solved = json.loads(ask("solve", put)[1])
        assert solved["found"]["worst_mm"] < 0.05
        for click in put:
            # Where it was clicked is where it is expected now.
            place = solved["expected"][click["camera"]][begun["points"].index(click["point"])]
            assert place == pytest.approx([click["x"], click["y"]], abs=0.05)
            assert solved["outline"][click["camera"]]
        for wrong in (
            [{"camera": "x"}],
            [{**put[0], "x": 1e9}],
            [{**put[0], "x": 10**400}],
            [{**put[0], "point": "?"}],
            3,
        ):
            status, answer = ask("solve", wrong)
            assert status == 400 and json.loads(answer)["error"]
        assert ask("save", put[:1])[0] == 400 and not saved
        assert ask("save", put)[0] == 200
        serving.join(10.0)
        assert not serving.is_alive() and len(saved) == 1
        assert saved[0].shift.yaw_rad == pytest.approx(-OFF.yaw_rad, abs=1e-5)
        done.set()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "expected --pictures, of all cameras"),
        (["--click", "sw"], "expected CAMERA:POINT:X,Y"),
        (["--click", "front:sw:1,2"], "camera is not one of: cam_0_0"),
        (["--click", "cam_0_0:middle:1,2"], "point is not one of: sw, se, ne, nw"),
        (["--click", "cam_0_0:sw:1,9999"], "'1,9999' is no pixel of that camera"),
        (["--click", "cam_0_0:sw:1,2"], "clicks on two different points or more"),
        (["--cameras", "none"], "--cameras none: no such folder"),
    ],
)
def test_wrong_words_get_one_line(
    words: list[str], said: str, cameras: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["arena", "align", "pollutant", "--cameras", str(cameras), *words]) == 2
    told = capsys.readouterr()
    assert told.out == "" and len(told.err.splitlines()) == 1 and said in told.err
