"""Live cameras of a session: what is refused before one of them is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from vsense.base.clock import host_ns
from vsense.base.errors import ConfigError
from vsense.config import tracking_session
from vsense.vision.cameras import _networks, aravis
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking.opening import open_tracking
from vsense.vision.tracking.specs import TrackingSession

CAMERAS = 4


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for n in range(CAMERAS):
        camera = Camera.looking_down(f"cam{n}", 0.5 * n, 0.0, 2.0, 500.0, (1620, 1220))
        (tmp_path / f"cam{n}.json").write_text(camera.to_json())
    return tmp_path


def session(folder: Path, **differs: str) -> TrackingSession:
    """A session of four GigE cameras; `differs` are attributes of the third."""
    grabbers = []
    for n in range(CAMERAS):
        attributes = {"device": f"192.0.2.{n + 1}", "frame_rate": "10", "trigger": "free"}
        attributes |= differs if n == 2 else {}
        words = " ".join(f'{key}="{value}"' for key, value in attributes.items())
        grabbers.append(f'<grabber id="g{n}" type="genicam" {words} />')
    cameras = [f'<camera id="cam{n}" calibration="cam{n}.json" />' for n in range(CAMERAS)]
    views = [
        f'<camera_state_tracker grabber="g{n}" camera="cam{n}" tracker="t" />'
        for n in range(CAMERAS)
    ]
    (folder / "resources.xml").write_text(
        "<arena_tracking_system><grabbers>\n"
        + "\n".join(grabbers)
        + '\n</grabbers><trackers><tracker id="t" tags="1-5" /></trackers><cameras>\n'
        + "\n".join(cameras)
        + "\n</cameras></arena_tracking_system>"
    )
    (folder / "experiment.xml").write_text(
        "<arena_tracking><arena_state_tracker>\n"
        + "\n".join(views)
        + "\n</arena_state_tracker></arena_tracking>"
    )
    return tracking_session.load(folder / "resources.xml", folder / "experiment.xml")


def refusal(session: TrackingSession) -> str:
    with pytest.raises(ConfigError) as refused:
        open_tracking(session, host_ns, print).close()
    return str(refused.value)


def test_without_the_library_the_package_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(aravis, "_load", lambda: "libaravis-0.8.so.0: cannot open")
    text = refusal(session(folder))
    assert text == (
        f"{folder}/resources.xml:2: <grabber> type: GigE and USB3 Vision cameras need the library"
        " Aravis (libaravis-0.8.so.0: cannot open): apt-get install libaravis-0.8-0"
    )


def test_more_than_the_network_carries_is_refused_with_the_sum(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(aravis, "_load", lambda: None)
    monkeypatch.setattr(_networks, "_interface", lambda address: "eth1")
    monkeypatch.setattr(
        _networks.NetworkLoad.__init__, "__defaults__", (_networks._interface, lambda i: 1e9)
    )
    text = refusal(session(folder, frame_rate="40"))
    assert text.startswith(
        f"{folder}/resources.xml:5: <grabber> frame_rate: eth1 carries 1000 Mbit/s, the cameras on"
        " it would send 166 (192.0.2.1) + 166 (192.0.2.2) + 664 (192.0.2.3) + 166 (192.0.2.4)"
        " = 1163 Mbit/s: expected a lower frame_rate"
    )


def test_one_device_for_two_cameras_is_refused(folder: Path) -> None:
    with pytest.raises(ConfigError, match=r"grabber: 'the device 192\.0\.2\.1'"):
        session(folder, device="192.0.2.1")


def test_one_camera_by_two_names_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = _networks.ListedCamera(
        "Maker-Type-77", _networks.GIGE_PROTOCOL, "192.0.2.1", "00:11", "Maker", "Type", "77"
    )
    monkeypatch.setattr(aravis, "_load", lambda: None)
    monkeypatch.setattr(aravis, "listed", lambda: [one])
    text = refusal(session(folder, device="77"))
    assert "resources.xml:4: <grabber> device: " in text
    assert "'192.0.2.1' and '77' are the same camera, at 192.0.2.1" in text


@pytest.mark.parametrize(
    "differs, words",
    [
        ({"trigger": "software"}, "'g2'.*'software', 'g0'.*'free'"),
        ({"trigger": "Line1"}, "'g2'.*'Line1', 'g0'.*'free'"),
    ],
)
def test_cameras_that_are_not_triggered_alike_are_refused(
    folder: Path, differs: dict[str, str], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        session(folder, **differs)
