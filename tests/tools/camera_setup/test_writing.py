"""What `vsense camera init` writes loads, and is left alone where it is there already."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.tools.camera_setup.stage import CALIBRATION, found
from vsense.base.errors import UsageError, VsenseError
from vsense.config import resources, tracking_session
from vsense.tools.camera_setup import files
from vsense.vision.cameras.discovery import USB3, V4L2, Details, FoundCamera
from vsense.vision.cameras.source import Controls, GenicamSettings
from vsense.vision.tracking.specs import GrabberSpec

WEBCAM = found(
    id="/dev/video0", kind=V4L2, address="usb-1", serial="", mac="", model="Webcam -- 2",
    details=Details((1280, 720), ("YUYV",), 30.0),
)  # fmt: skip
BUSY = found(id="Maker-Model-8", serial="8", trouble="another program <x> & -- controls it")
USB = found(id="Maker-U-9", kind=USB3, address="", serial="9")


def write(folder: Path, cameras: list[FoundCamera]) -> None:
    files.write(folder, cameras, files.Markers([31, 1843], "the test's"))


def test_what_is_written_loads(tmp_path: Path) -> None:
    write(tmp_path, [found(), WEBCAM, BUSY, USB])
    read = resources.load(tmp_path / "resources.xml")
    assert list(read.grabbers) == ["cam1", "cam2", "cam3", "cam4"] == list(read.cameras)
    first = read.grabbers["cam1"]
    assert first.source == "192.168.10.11" and isinstance(first.settings, GenicamSettings)
    assert first.settings.controls == Controls((1620, 1220), 10.0, 10_000.0, 3.0)
    assert first.settings.offset_px == (0, 0) and first.settings.pixel_format == "Mono8"
    assert read.grabbers["cam2"].settings == Controls((1280, 720), 10.0)
    assert read.grabbers["cam3"].source == "Maker-Model-8", "its address may be another's, too"
    assert read.grabbers["cam4"].source == "Maker-U-9"
    assert set(read.trackers["robots"].heights_m) == {31, 1843}


def session(folder: Path, cameras: list[FoundCamera]) -> list[GrabberSpec]:
    """The grabbers of a whole session that loads once all cameras are calibrated."""
    write(folder, cameras)
    (folder / "cameras").mkdir()
    for id in files.camera_ids(cameras):
        (folder / "cameras" / f"{id}.json").write_text(CALIBRATION.to_json())
    loaded = tracking_session.load(folder / "resources.xml", folder / "experiment.xml")
    assert [view.camera.id for view in loaded.views] == files.camera_ids(cameras)
    return [view.grabber for view in loaded.views]


def rated(number: int, rate_hz: float | None) -> FoundCamera:
    """A GigE camera with a rate of its own."""
    return found(
        id=f"Maker-Model-{number}", address=f"192.168.10.{number}",
        details=Details((640, 480), ("Mono8",), rate_hz),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("cameras", "trigger", "rates_hz"),
    [
        ([found()], "free", [10.0]),
        ([WEBCAM], "free", [10.0]),
        ([rated(1, 25.0), rated(2, 25.0)], "software", [10.0, 10.0]),
        ([rated(1, 25.0), USB], "software", [10.0, 10.0]),
        ([found(), WEBCAM], "free", [10.0, 10.0]),
        ([rated(1, 10.0), rated(2, 7.5), WEBCAM], "free", [10.0, 7.5, 10.0]),
        ([rated(1, 10.0), rated(2, 7.5)], "software", [7.5, 7.5]),
        ([rated(1, 1.0 / 3.0), rated(2, 25.0)], "software", [0.333333, 0.333333]),
        ([rated(1, None), rated(2, 7.5), rated(3, 0.0)], "software", [7.5, 7.5, 7.5]),
        ([rated(1, 25.0), BUSY], "software", [10.0, 10.0]),
    ],
)
def test_a_session_of_any_cameras_loads_once_they_are_calibrated(
    cameras: list[FoundCamera], trigger: str, rates_hz: list[float], tmp_path: Path
) -> None:
    grabbers = session(tmp_path, cameras)
    assert {grabber.trigger for grabber in grabbers} == {trigger}, "else no session takes them"
    assert [grabber.frame_rate_hz for grabber in grabbers] == rates_hz


@pytest.mark.parametrize(
    ("details", "expected"),
    [
        (Details(gain=-1.5), Controls(rate_hz=10.0, gain_raw=-1.5)),
        (Details(gain=1e-5), Controls(rate_hz=10.0, gain_raw=1e-5)),
        (Details(gain=-1e9), Controls(rate_hz=10.0)),
        (Details(exposure_us=0.5), Controls(rate_hz=10.0)),
        (Details(exposure_us=1e9), Controls(rate_hz=10.0)),
        (Details(exposure_us=1e7), Controls(rate_hz=10.0, exposure_us=1e7)),
        (Details(rate_hz=0.005), Controls(rate_hz=10.0)),
        (Details(rate_hz=float("nan"), gain=float("inf")), Controls(rate_hz=10.0)),
        (Details((0, 480)), Controls(rate_hz=10.0)),
        (Details((640, 30_000)), Controls(rate_hz=10.0)),
    ],
)
def test_values_that_no_resources_file_takes_are_left_out(
    details: Details, expected: Controls, tmp_path: Path
) -> None:
    (grabber,) = session(tmp_path, [found(details=details)])
    assert isinstance(grabber.settings, GenicamSettings)
    assert grabber.settings.controls == expected
    text = (tmp_path / "resources.xml").read_text()
    assert not re.search(r'="-?[0-9.]+e', text), "the schema's decimals have no exponents"


def test_it_is_pleasant_to_edit(tmp_path: Path) -> None:
    write(tmp_path, [found(), BUSY])
    text = (tmp_path / "resources.xml").read_text()
    assert max(map(len, text.splitlines())) <= 110
    assert "Maker Model, serial 7, Maker-Model-7, 00:0f:31:00:00:07" in text
    assert "exposure 10 to 10000000 us, gain 0 to 24" in text
    assert "NOT READY: another program" in text
    for name in ("exposure_time_abs", "gain_raw", "trigger", "packet_size", "<feature name="):
        assert name in text.partition("-->")[0], "explained where it is used"
    assert sorted(path.name for path in (tmp_path / "schema").iterdir()) == [
        "experiment.xsd",
        "resources.xsd",
    ]


def test_one_camera_runs_freely_and_unknown_values_are_left_out(tmp_path: Path) -> None:
    write(tmp_path, [found(details=Details())])
    (spec,) = resources.load(tmp_path / "resources.xml").grabbers.values()
    assert isinstance(spec.settings, GenicamSettings)
    assert spec.settings == GenicamSettings(Controls(rate_hz=10.0))


def test_no_name_of_a_camera_ends_a_comment(tmp_path: Path) -> None:
    session(tmp_path, [found(model="A---B-->", details=Details())])


def run(folder: Path, force: bool = False) -> int:
    return files.init(folder, force)


def test_init_says_what_comes_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(files, "find", lambda: ([found(), BUSY], ""))
    assert run(tmp_path / "lab") == 0
    out, err = capsys.readouterr()
    assert out.split() == [str(tmp_path / "lab" / f"{n}.xml") for n in ("resources", "experiment")]
    for command in (
        "camera tune cam1",
        "camera shoot",
        "camera calibrate rig",
        "vsense camera track",
    ):
        assert command in err
    assert "vsense: cam2: Maker-Model-8: another program" in err


def test_init_writes_over_nothing_unless_it_is_told_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "find", lambda: ([found()], ""))
    (tmp_path / "experiment.xml").write_text("mine")
    with pytest.raises(UsageError, match=r"experiment\.xml:.*--force"):
        run(tmp_path)
    assert (tmp_path / "experiment.xml").read_text() == "mine"
    assert run(tmp_path, force=True) == 0
    resources.load(tmp_path / "resources.xml")


def test_init_without_cameras_says_what_to_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "find", lambda: ([], "no library"))
    with pytest.raises(VsenseError, match="no camera"):
        run(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_init_where_nothing_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "find", lambda: ([found()], ""))
    (tmp_path / "file").touch()
    with pytest.raises(VsenseError, match="cannot be written"):
        run(tmp_path / "file" / "lab")
