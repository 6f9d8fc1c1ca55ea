"""A session's two files become cameras, detectors and an arena tracker that work together."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.vision.tracking.synthetic import Look, Robot, render
from vsense.base.arena import Frame
from vsense.base.errors import ConfigError, NoMorePictures
from vsense.config import tracking_session
from vsense.vision.cameras._reference import reference_path
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.opening import open_tracking
from vsense.vision.tracking.specs import TrackingSession

TIMESTEPS = 7
SIZE = (600, 480)
CAMERAS = [Camera.looking_down(n, x, 0.0, 2.4, 1600.0, SIZE) for n, x in (("a", -1.0), ("b", 1.0))]
FAMILIES = {"a": "arrow4x4", "b": "arrow4x4-thesis"}
HEIGHTS = {"a": 0.06, "b": 0.12}

RESOURCES = """<arena_tracking_system>
<grabbers>
<grabber id="a" type="directory" path="a" /><grabber id="b" type="directory" path="b" />
<grabber id="empty" type="directory" path="empty" />
</grabbers>
<trackers>
<tracker id="a" family="arrow4x4" tags="31 700" />
<tracker id="b" family="arrow4x4-thesis" tags="52447" robot_height="0.12" max_speed="0.5" />
</trackers>
<cameras><camera id="a" calibration="a.json" /><camera id="b" calibration="b.json" /></cameras>
</arena_tracking_system>"""

EXPERIMENT = """<arena_tracking>
<arena_state_tracker opt_key_frame_period="{period}" opt_square_size="11">
<camera_state_tracker grabber="a" camera="a" tracker="a" />
<camera_state_tracker grabber="b" camera="b" tracker="b" />
</arena_state_tracker></arena_tracking>"""

Load = Callable[..., TrackingSession]


def robots(camera: str, timestep: int) -> list[Robot]:
    way = 0.01 * timestep
    if camera == "b":
        return [Robot(52447, 1.0 - way, 0.05, 3.1)]
    return [Robot(31, -1.1 + way, 0.1, 0.0), Robot(700, -0.9, -0.1 + way, 1.57)]


@pytest.fixture(scope="module")
def load(tmp_path_factory: pytest.TempPathFactory) -> Load:
    folder = tmp_path_factory.mktemp("rig")
    (folder / "empty").mkdir()
    for camera in CAMERAS:
        (folder / camera.id).mkdir()
        (folder / f"{camera.id}.json").write_text(camera.to_json())
        family = load_family(FAMILIES[camera.id])
        for k in range(TIMESTEPS):
            look = Look(litter=5, noise=0.0)
            image = render(camera, family, robots(camera.id, k), look, 1, HEIGHTS[camera.id])
            noise = np.random.default_rng(k).normal(0.0, 2.0, image.shape)
            noisy = np.clip(image + noise, 0, 255).astype(np.uint8)
            cv2.imwrite(str(folder / camera.id / f"{k}.png"), noisy)
    (folder / "resources.xml").write_text(RESOURCES)

    def load_session(period: int = 1, change: tuple[str, str] = ("", "")) -> TrackingSession:
        text = EXPERIMENT.format(period=period).replace(*change)
        (folder / "experiment.xml").write_text(text)
        paths: list[Path] = [folder / "resources.xml", folder / "experiment.xml"]
        return tracking_session.load(*paths)

    return load_session


def build(session: TrackingSession, told: list[str]) -> CameraTracking:
    return open_tracking(session, lambda: 0, told.append)


def run(tracking: CameraTracking) -> int:
    """Tracks to the end and checks every state; gives the number of timesteps."""
    timesteps = 0
    while True:
        try:
            state, frames = tracking.next(10.0)
        except NoMorePictures:
            return timesteps
        assert [frame.camera for frame in frames] == ["a", "b"]
        where = {
            int(r["tag"]): (float(r["x_m"]), float(r["y_m"])) for r in state.robots if r["seen"]
        }
        true = [*robots("a", state.timestep), *robots("b", state.timestep)]
        assert where == {r.tag: pytest.approx((r.x_m, r.y_m), abs=0.002) for r in true}
        assert sorted(tracking.tracker.markers["a"]["tag"].tolist()) == [31, 700]
        assert tracking.tracker.markers["b"]["tag"].tolist() == [52447]
        timesteps += 1


@pytest.mark.parametrize("period", [1, 3])
def test_every_camera_is_searched_for_its_own_trackers_markers(load: Load, period: int) -> None:
    told: list[str] = []
    tracking = build(load(period), told)
    try:
        assert tracking.grabber.timesteps == TIMESTEPS
        assert run(tracking) == TIMESTEPS and told == []
    finally:
        tracking.close()
        tracking.close()


@pytest.mark.parametrize("shift", [0, 2, 40])
def test_a_camera_moved_since_its_calibration_is_named_before_the_first_state(
    load: Load, shift: int
) -> None:
    session, told = load(), list[str]()
    path = reference_path(session.resources.cameras["b"].calibration)
    path.parent.mkdir(exist_ok=True)
    robots_elsewhere = [Robot(52447, 0.9, 0.1, 1.0)]
    family, look = load_family(FAMILIES["b"]), Look(litter=5, noise=0.0)
    picture = render(CAMERAS[1], family, robots_elsewhere, look, 1, HEIGHTS["b"])
    cv2.imwrite(str(path), np.roll(picture, shift, axis=1))
    tracking = build(session, told)
    try:
        tracking.next(10.0)
        if shift:
            (line,) = told
            words = r"camera b: has moved by ([\d.]+) px at most \(.*\) since its calibration"
            match = re.match(words, line)
            assert match is not None and float(match[1]) == pytest.approx(shift, abs=0.5)
            assert ("b", "displaced") in tracking.troubles.present
        else:
            assert told == []
    finally:
        tracking.close()
        path.unlink()


def test_the_roster_is_closed_where_the_file_says_so_and_a_marker_turned(load: Load) -> None:
    for roster, names in (("open", [31, 700]), ("closed", [700])):
        session = load()
        tracker = session.views[0].tracker
        lonely = replace(tracker, heights_m={700: 0.06}, open_roster=roster == "open")
        views = (replace(session.views[0], tracker=lonely), session.views[1])
        tracking = build(replace(session, views=views), [])
        (frame,) = tracking.grabber.next(1.0)[:1]
        for step in range(14):
            now = replace(frame, timestep=step, capture_ns=step * 100_000_000)
            state = tracking.tracker.update([now])
        assert state.robots["tag"].tolist() == names
        tracking.close()


def test_the_heading_of_square_markers_is_a_setting(load: Load) -> None:
    yaw = {}
    for turn in (0.0, -90.0):
        session = load()
        tracker = replace(session.views[0].tracker, family="aruco_4x4_50", heights_m={7: 0.06})
        view = replace(session.views[0], tracker=replace(tracker, heading_deg=turn))
        tracking = build(replace(session, views=(view,)), [])
        image = render(CAMERAS[0], load_family("aruco_4x4_50"), [Robot(7, -1.0, 0.0, 0.5)], Look())
        state = tracking.tracker.update([Frame("a", image, 0, 0, 0)])
        yaw[turn] = float(state.robots["yaw_rad"][0])
        tracking.close()
    assert yaw[0.0] == pytest.approx(0.5, abs=0.01)
    assert yaw[-90.0] == pytest.approx(0.5 - np.pi / 2.0, abs=0.01)


def test_a_recording_that_holds_nothing_is_refused_at_its_place(load: Load) -> None:
    session = load(1, ('grabber="b"', 'grabber="empty"'))
    with pytest.raises(ConfigError, match=r"resources\.xml:4: <grabber> path: .*pictures"):
        build(session, [])
