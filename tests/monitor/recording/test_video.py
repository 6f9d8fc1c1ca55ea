"""Videos of a recording: what is where in their frames, and what is left when they fail."""

from __future__ import annotations

import base64
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.monitor.recording.conftest import BEGIN_NS, record
from tests.monitor.recording.recorded_world import CAMERAS, TIMESTEPS, frames, messages
from vsense import cli
from vsense.base.canvas import Canvas
from vsense.base.message_bus import Message
from vsense.monitor.recording import _film, form
from vsense.monitor.recording._film import HEAD_PX, Panel, arrange, clock_text
from vsense.monitor.recording._scenes import RecordedScenes
from vsense.monitor.recording._video import Video, VideoPlan
from vsense.monitor.recording._video_file import open_video
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import open_recording

SIZE = (640, 360)
PLAN = ["--size", "640x360"]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("video") / "run.mcap", messages(), frames())


@pytest.fixture(scope="module")
def blank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording without pictures."""
    return record(tmp_path_factory.mktemp("blank") / "run.mcap", messages())


def images(file: Path, **plan: Any) -> list[np.ndarray]:
    with open_recording(file) as opened:
        return list(Video(opened, VideoPlan(size=SIZE, **plan)).images())


def orange(frame: np.ndarray) -> np.ndarray:
    """Where the cone is drawn, or tints what lies beneath."""
    blue, _, red = np.moveaxis(frame.astype(int), -1, 0)
    return np.asarray(red - blue > 25)


def test_the_cone_is_where_opencv_projects_it(file: Path) -> None:
    frame = images(file, view="left", from_s=0.55)[0]
    camera = CAMERAS[0]
    (place,), _ = arrange(SIZE, [camera.width_px / camera.height_px], True)
    corners = np.array([[0.0, 0.0, 0.0], [0.5, -0.4, 0.0], [0.5, 0.4, 0.0]])
    ends = np.roll(corners, -1, axis=0)
    edge = np.concatenate([np.linspace(a, b, 99) for a, b in zip(corners, ends)])
    turn = np.reshape(camera.rotation, (3, 3))
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    move = -turn @ np.array(camera.position_m)
    lens = np.array(camera.distortion)
    pixels = cv2.projectPoints(edge, cv2.Rodrigues(turn)[0], move, matrix, lens)[0][:, 0]
    zoom = place.width / camera.width_px
    wanted = np.zeros(frame.shape[:2], np.uint8)
    outline = (pixels + 0.5) * zoom - 0.5 + (place.x, place.y)
    cv2.fillPoly(wanted, [np.rint(outline).astype(int)], 1)
    room = np.zeros_like(wanted, bool)
    room[place.y + 26 : place.y + place.height, place.x : place.x + place.width] = True
    inside = cv2.erode(wanted, np.ones((9, 9))).astype(bool) & room
    outside = ~cv2.dilate(wanted, np.ones((31, 31))).astype(bool) & room
    assert inside.sum() > 1000 and outside.sum() > 3000
    assert orange(frame)[inside].mean() > 0.85, "robots stand in it"
    assert orange(frame)[outside].mean() < 0.02


def test_each_view_has_its_panels_and_the_measures(file: Path, blank: Path) -> None:
    when = {"from_s": 1.0, "to_s": 1.2}
    arena, both = (images(file, view=view, **when)[-1] for view in ("arena", "both"))
    for frame in (arena, both):
        assert frame.shape == (360, 640, 3)
        assert orange(frame).sum() > 300
    # Without a view: both where there are pictures, else the arena.
    assert np.array_equal(images(file, **when)[-1], both)
    assert np.array_equal(images(blank, **when)[-1], arena)


def test_an_invalid_run_is_called_so_over_its_pictures(file: Path, tmp_path: Path) -> None:
    when = {"view": "arena", "from_s": 1.0, "to_s": 1.1}
    (end,) = [m for m in messages() if m.topic == "/run"][-1:]
    facts = {"verdict": "void", "why": "robot 1 never came"}
    judged = Message("/run", end.time_ns + 1, {**end.data, **facts})
    void = record(tmp_path / "void.mcap", [*messages(), judged])
    plain, marked = (images(path, **when)[0] for path in (file, void))
    (rows, columns) = np.nonzero((plain != marked).any(axis=-1))
    assert len(rows) > 100 and rows.max() < HEAD_PX and abs(columns.mean() - SIZE[0] / 2) < 30


def test_charts_have_a_scale_and_no_line_is_red() -> None:
    canvas = Canvas(*SIZE, 1)
    canvas.image[:] = 255
    box = Panel(0, 0, 600, 120)
    colour = _film._OWN_LINES["lit_in_cone"]
    _film._measure(canvas, box, "lit_in_cone", [0.0, 60.0], [0.0, 8.0], colour)
    blue, green, red = (canvas.image[..., n].astype(int) for n in range(3))
    assert not ((red - blue > 60) & (red - green > 60)).any(), "red is danger"
    ink = (canvas.image.max(axis=-1) < 200) & (abs(red - blue) < 30)
    assert ink[30:50, 585:599].any() and ink[85:99, 585:599].any(), "8 above, 0 below"
    assert ink[100:116, 80:110].any() and ink[100:116, 560:599].any(), "0 s and 60 s"


def test_scenes_say_what_was_there(file: Path) -> None:
    with open_recording(file) as opened:
        scenes = RecordedScenes(opened.experiment, robot=2)
        for message in opened.messages(set(scenes.topics)):
            scenes.take(message)
    moment = scenes.moment()
    assert moment is not None and scenes.time_s == pytest.approx((TIMESTEPS - 1) * 0.1)
    world = moment.snapshot
    assert [len(world.virtual), len(world.physical), len(world.lamps)] == [1, 1, 1]
    assert world.virtual[0].top_m == pytest.approx(0.1) and world.lamps[0].height_m == 0.4
    assert [zone.name for zone in world.zones] == ["nest"] and world.floor is not None
    assert len(world.virtual_robots) == 1 and world.fields[0].max() == pytest.approx(1.0, abs=0.02)
    assert moment.lit.tolist() == [True, False] and moment.heights_m.tolist() == [0.06, 0.06]
    assert world.leds.tolist() == [[0, 0, 0], [9, 200, 9]] and len(moment.objects) == 1
    # Robot 1 stands in the cone and is lit, robot 2 does not: nobody counted, so it is counted.
    assert scenes.measures["robots_in_cone"][1][-1] == 1
    assert scenes.measures["lit_in_cone"][1][-1] == 1
    assert scenes.measures["found"] == ([k * 0.1 for k in range(TIMESTEPS)], [7.0] * TIMESTEPS)
    assert moment.senses is not None and moment.senses.words == ("pollutant 0.5",)
    ((angles, shares),) = moment.senses.rays
    assert angles.tolist() == [0.0, 1.0] and shares.tolist() == [0.25, 1.0]


def test_robots_and_objects_that_are_damaged_end_no_film() -> None:
    damaged: list[dict[str, Any]] = [
        {"tag": 1, "height_m": 10**400, "radius_m": 0.04}, {"tag": [2], "height_m": 0.1},
        {"tag": 3, "height_m": None}, {"height_m": 0.1}, {"tag": 4, "height_m": 0.05},
        {"tag": 5, "height_m": 1e300, "radius_m": 1e300},
    ]  # fmt: skip
    arena = {"size_m": [1, 1, 1], "centre_m": [0, 0, 0]}
    scenes = RecordedScenes({"arena": arena, "robots": damaged, "objects": damaged})
    assert (scenes._heights, scenes._radii) == ({4: 0.05}, {1: 0.04})
    assert scenes._objects == {1, 3, 4, 5}


def test_a_field_that_opencv_cannot_draw_ends_no_film() -> None:
    arena = {"size_m": [1, 1, 1], "centre_m": [0, 0, 0]}
    field = {"id": "f", "rows": 1, "columns": 40_000, "corner_m": [0, 0], "cell_m": 1.0}
    levels = base64.b64encode(bytes(40_000)).decode()
    scenes = RecordedScenes({"arena": arena})
    scenes.take(Message("/fields", 1, {"fields": [{**field, "levels": levels}]}))
    assert scenes.moment() is None


@pytest.mark.parametrize(("x", "y", "far"), [(1e-300, 1e-300, 0), (100, 1e-308, 0), (1, 1, 1e300)])
def test_an_arena_that_cannot_be_drawn_is_said(
    x: float, y: float, far: float, tmp_path: Path
) -> None:
    arena = {"size_m": [x, y, 1], "centre_m": [far, 0, 0]}
    path = record(tmp_path / "a.mcap", [Message("/experiment", BEGIN_NS, {"arena": arena})])
    said = pytest.raises(RecordingError, match=r"a\.mcap: cannot be drawn: its arena of ")
    with open_recording(path) as opened, said:
        Video(opened, VideoPlan())


def test_a_picture_has_the_moment_of_its_own_capture(file: Path) -> None:
    with open_recording(file) as opened:
        scenes = RecordedScenes(opened.experiment)
        for message in opened.messages(set(scenes.topics)):
            scenes.take(message)
    early = scenes.moment_at(BEGIN_NS + 310_000_000)
    assert early is not None
    assert early.poses[0, 0] == pytest.approx(0.2 + 0.01 * 3)


def test_the_command_writes_a_video(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "out.webm"
    assert cli.main(["export", str(file), "--video", str(path), *PLAN, "--to", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["lacking"] == {"gaps": 0, "messages": 0, "pictures": 0, "seconds": 0.0}
    facts = {"video": str(path), "frames": 10, "seconds": 1.0, "bytes": path.stat().st_size}
    assert facts.items() <= told.items() and told["old_pictures"] == {}
    film = cv2.VideoCapture(str(path))
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    read = [film.read() for _ in range(11)]
    assert [done for done, _ in read] == [True] * 10 + [False]
    assert orange(read[-2][1]).sum() > 300
    assert list(tmp_path.iterdir()) == [path]
    assert cli.main(["export", str(file), "--video", str(path), *PLAN]) == 2
    assert "is there already" in capsys.readouterr().err


def test_a_video_of_old_pictures_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = [frame for frame in frames() if frame.camera != "left" or frame.timestep < 3]
    data = {"from_ns": BEGIN_NS, "to_ns": BEGIN_NS + 500_000_000, "messages": 4, "pictures": 9}
    gap = Message(form.GAP, BEGIN_NS + 500_000_000, {**data, "why": "no processor"})
    file = record(tmp_path / "run.mcap", sorted([*messages(), gap], key=lambda m: m.time_ns), kept)
    path = tmp_path / "out.webm"
    assert cli.main(["export", str(file), "--video", str(path), *PLAN]) == 0
    said = capsys.readouterr()
    assert "lacks 4 messages and 9 pictures of 0.5 s: no processor" in said.err
    drawn = len(images(file))
    captured_s = [(f.capture_ns - BEGIN_NS) / 1e9 for f in kept if f.camera == "left"]
    old = [n for n in range(drawn) if n / 10 - captured_s[-1] > 0.5 + 1e-6]
    assert 0 < len(old) < drawn
    assert f"pictures older than 0.5 s, of {drawn} frames: left in {len(old)}" in said.out
    grey = [np.count_nonzero((image >= 90) & (image <= 110)) for image in images(file, view="left")]
    assert grey[-1] < grey[0] / 3, "what is old is paler than the picture was"


def test_an_animated_picture_is_written(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # OpenCV 4.11, which is enough for vsense, does not have it.
    monkeypatch.delattr(cv2, "imencodeanimation", raising=False)
    path = tmp_path / "out.webp"
    how = ["--view", "arena", "--speed", "2", "--fps", "5"]
    assert cli.main(["export", str(file), "--video", str(path), *PLAN, *how]) == 0
    done, moving = cv2.imreadanimation(str(path))
    assert done and len(moving.frames) == 4 and set(moving.durations) == {200}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--view", "middle"], "--view middle: there are: arena, both, cameras, left, right"),
        (["--from", "50"], "lasts 1.9 s; nothing of it lies between --from 50"),
        (["--from", "1", "--to", "0.5"], "nothing of it lies between --from 1 and --to 0.5"),
        (["--robot", "7"], "has no robot 7; there are: 1, 2"),
    ],
)
def test_what_cannot_be_shown_is_said(
    words: list[str], said: str, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "out.webm"
    assert cli.main(["export", str(file), "--video", str(path), *PLAN, *words]) == 2
    assert said in capsys.readouterr().err and list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_said(
    blank: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(path: Path, *words: str) -> str:
        assert cli.main(["export", str(blank), "--video", str(path), *words]) == 2
        return capsys.readouterr().err

    assert "holds no pictures of the cameras" in fails(tmp_path / "x.webm", "--view", "both")
    assert "holds no pictures of left: --record-images" in fails(
        tmp_path / "x.webm", "--view", "left"
    )
    assert "expected a name that ends in .webm, .webp, .mp4" in fails(tmp_path / "x.avi")
    assert "No such file or directory" in fails(tmp_path / "gone" / "x.webm")
    writer = cv2.VideoWriter(str(tmp_path / "t.mp4"), cv2.VideoWriter.fourcc(*"avc1"), 10, SIZE)
    able = writer.isOpened()
    writer.release()
    (tmp_path / "t.mp4").unlink(missing_ok=True)
    if not able:
        assert "does not write H.264; expected a name that ends in .webm" in fails(
            tmp_path / "x.mp4"
        )
    assert cli.main(["export", str(blank), "--view", "arena"]) == 2
    assert "--view belongs to --video" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def run(file: Path, path: Path, limit: int) -> subprocess.CompletedProcess[str]:
    """Exports in a process whose files may have so many bytes."""
    words = [
        sys.executable,
        "-m",
        "vsense",
        "export",
        str(file),
        "--video",
        str(path),
        *PLAN,
        "--to",
        "0.8",
    ]
    bound = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))  # noqa: E731
    # What Python keeps of modules would be cut off as well, and found by others.
    kept = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(words, preexec_fn=bound, capture_output=True, text=True, env=kept)


def test_a_full_disk_leaves_nothing(file: Path, tmp_path: Path) -> None:
    done = run(file, tmp_path / "x.webm", 3000)
    assert done.returncode == 2 and "frames are on the disk; is it full?" in done.stderr
    assert "WARN" not in done.stderr and list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_animated_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = cv2.imwriteanimation

    def cut_off(name: str, *rest: Any) -> bool:
        done: bool = made(name, *rest)
        os.truncate(name, 100)
        return done

    monkeypatch.setattr(cv2, "imwriteanimation", cut_off)
    with (
        pytest.raises(RecordingError, match="made only a part of it; is the disk full"),
        open_video(tmp_path / "x.webp", 5.0, (64, 48)) as moving,
    ):
        moving.add(np.zeros((48, 64, 3), np.uint8))
        moving.add(np.full((48, 64, 3), 90, np.uint8))
        moving.finish()
    assert os.listdir(tmp_path) == []


def test_a_video_that_is_interrupted_leaves_nothing(file: Path, tmp_path: Path) -> None:
    with open_recording(file) as opened:
        video = Video(opened, VideoPlan(size=SIZE, view="arena"))
        seen: list[int] = []
        assert not video.write(tmp_path / "x.webm", seen.append, lambda: len(seen) == 3)
    assert seen == [1, 2, 3] and os.listdir(tmp_path) == []


def test_a_late_beginning_is_interrupted_before_its_first_frame(
    blank: Path, tmp_path: Path
) -> None:
    with open_recording(blank) as opened:
        video = Video(opened, VideoPlan(size=SIZE, view="arena", from_s=1.5))
        seen: list[int] = []
        looks = iter([False] * 8)
        assert not video.write(tmp_path / "x.webm", seen.append, lambda: next(looks, True))
        assert not seen and video._scenes.moment() is not None
        assert video._scenes.time_s is not None and video._scenes.time_s < 0.2
    assert os.listdir(tmp_path) == []


def tracked(step_of: dict[int, int]) -> list[Message]:
    """As `vsense camera track` records it: no timestep's length; the run's timesteps by picture."""
    first, *others = messages()
    told = [Message("/experiment", first.time_ns, {**first.data, "timestep_s": None})]
    for each in others:
        data = each.data
        if each.topic == "/arena":
            number = data["timestep"]
            capture_ns = BEGIN_NS + number * 50_000_000
            data = {**data, "run_timestep": step_of[number], "capture_ns": capture_ns}
        told.append(Message(each.topic, each.time_ns, data))
    return told


def test_the_clock_of_what_was_only_tracked_goes_by_the_captures(tmp_path: Path) -> None:
    # Timesteps 7 to 9 are suspended; their time does not count.
    steps = {n: n - 2 if n < 7 else n - 5 for n in range(10, TIMESTEPS)}
    steps |= {n: n - 2 if 2 <= n < 7 else -1 for n in range(10)}
    path = record(tmp_path / "run.mcap", tracked(steps))
    with open_recording(path) as opened:
        assert Video(opened, VideoPlan()).fps == pytest.approx(20.0)
        scenes = RecordedScenes(opened.experiment)
        times = []
        for message in opened.messages(set(scenes.topics)):
            scenes.take(message)
            if message.topic == "/arena":
                times.append(scenes.time_s)
    assert times[:2] == [None, None]
    wanted = [0, 50, 100, 150, 200, 200, 200, 200, 200, *range(250, 700, 50)]
    assert times[2:] == pytest.approx([ms / 1000 for ms in wanted])


def test_readings_that_are_no_number_do_not_hide_the_robots(file: Path) -> None:
    with open_recording(file) as opened:
        scenes = RecordedScenes(opened.experiment, robot=2)
        for message in opened.messages(set(scenes.topics)):
            if message.topic == "/readings":
                values = [[[1.0], [0.0, 0.0]], [[None], [None, 2.0]]]
                message = Message(message.topic, 0, {**message.data, "values": values})
            scenes.take(message)
    moment = scenes.moment()
    assert moment is not None and moment.poses[0, 0] == pytest.approx(0.2 + 0.01 * 19)
    assert moment.senses is not None and moment.senses.words == ("pollutant -",)
    ((angles, shares),) = moment.senses.rays
    assert (angles.tolist(), shares.tolist()) == ([1.0], [1.0])


def test_panels_fill_the_frame_and_do_not_overlap() -> None:
    for size in ((1280, 720), (640, 360), (720, 1280)):
        for shapes in ([1.25], [1.25, 1.33], [4.0], [0.25, 2.0]):
            for measured in (True, False):
                panels, strip = arrange(size, shapes, measured)
                boxes = [*panels, strip] if measured else panels
                for n, box in enumerate(boxes):
                    assert box.x >= 0 and box.x + box.width <= size[0]
                    assert box.y >= 0 and box.y + box.height <= size[1]
                    for other in boxes[:n]:
                        assert _apart(box, other), (size, shapes, boxes)


def _apart(one: Panel, other: Panel) -> bool:
    beside = one.x + one.width <= other.x or other.x + other.width <= one.x
    return beside or one.y + one.height <= other.y or other.y + other.height <= one.y


def test_clock() -> None:
    assert [clock_text(t) for t in (0.0, 9.99, 61.3, 600.0)] == ["0:00.0", "0:09.9", "1:01.3",
                                                                 "10:00.0"]  # fmt: skip
