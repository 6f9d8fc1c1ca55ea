"""Which cameras are found, and what is told of each; the cameras are scripted."""

from __future__ import annotations

import argparse
import json
from ipaddress import IPv4Interface
from pathlib import Path

import pytest

from vsense.base.errors import GrabberError, UsageError
from vsense.commands.cameras import wanted_of
from vsense.tools.camera_setup import files
from vsense.tools.camera_setup.files import choose
from vsense.vision.cameras import _v4l2, aravis, discovery
from vsense.vision.cameras._networks import GIGE_PROTOCOL, USB3_PROTOCOL, ListedCamera, Network
from vsense.vision.cameras._v4l2 import V4l2Device
from vsense.vision.cameras.aravis import AravisError
from vsense.vision.cameras.discovery import FoundCamera
from vsense.vision.cameras.source import FREE, Controls, GenicamSettings
from vsense.vision.tracking import single_camera
from vsense.vision.tracking.specs import GENICAM

FIRST = ListedCamera("Maker-A-1", GIGE_PROTOCOL, "192.168.10.11", "00:01", "Maker", "A", "1")
SECOND = ListedCamera("Maker-A-2", GIGE_PROTOCOL, "192.168.10.12", "00:02", "Maker", "A", "2")
USB = ListedCamera("Maker-U-3", USB3_PROTOCOL, "", "guid", "Maker", "Maker U", "3")
WEBCAM = V4l2Device("/dev/video0", "Webcam", "usb-1", ("YUYV",), (1280, 720), 30.0, "")
NETWORKS = [Network("eth1", IPv4Interface("192.168.10.1/24"))]
FEATURES = {"Width": "1620", "Height": "1220", "ExposureTimeAbs": "8000", "Gain": "2.5"}


class Opened:
    """A camera that answers, or does not."""

    silent: tuple[str, ...] = ()
    rate_hz = 25.0

    def __init__(self, name: str) -> None:
        if name in self.silent:
            raise AravisError("does not answer")

    def has(self, feature: str) -> bool:
        return feature in FEATURES

    def get(self, feature: str) -> str:
        return FEATURES[feature]

    def bounds(self, feature: str) -> tuple[float, float] | None:
        return (0.0, 24.0) if feature == "Gain" else None

    def formats(self) -> list[str]:
        return ["Mono8"]

    def close(self) -> None:
        pass


@pytest.fixture
def there(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Scripts what is there: two GigE cameras and one of USB3, all well, and a webcam."""
    set_there(monkeypatch, [FIRST, SECOND, USB])
    monkeypatch.setattr(_v4l2, "devices", lambda: [WEBCAM])
    for module in (discovery, single_camera):
        monkeypatch.setattr(module, "AravisCamera", type("Opened", (Opened,), {}))
        monkeypatch.setattr(module, "networks", lambda: NETWORKS)
        monkeypatch.setattr(module, "heard", lambda: [])
        monkeypatch.setattr(module, "controlled", lambda address: False)
    return monkeypatch


def set_there(monkeypatch: pytest.MonkeyPatch, listed: list[ListedCamera]) -> None:
    monkeypatch.setattr(aravis, "listed", lambda: listed)


def set_opened(monkeypatch: pytest.MonkeyPatch, **how: object) -> None:
    for module in (discovery, single_camera):
        monkeypatch.setattr(module, "AravisCamera", type("Opened", (Opened,), how))


def set_busy(monkeypatch: pytest.MonkeyPatch, *addresses: str) -> None:
    for module in (discovery, single_camera):
        monkeypatch.setattr(module, "controlled", lambda address: address in addresses)


def by_id() -> dict[str, FoundCamera]:
    cameras, missing = discovery.find()
    assert missing == ""
    return {camera.id: camera for camera in cameras}


def test_all_kinds_are_found_with_what_they_say(there: pytest.MonkeyPatch) -> None:
    cameras = by_id()
    assert list(cameras) == ["Maker-A-1", "Maker-A-2", "Maker-U-3", "/dev/video0"]
    first = cameras["Maker-A-1"]
    assert (first.kind, first.address, first.model) == ("GigE", "192.168.10.11", "Maker A")
    assert first.details.size_px == (1620, 1220) and first.details.exposure_us == 8000.0
    assert first.details.gain == 2.5 and first.details.gain_bounds == (0.0, 24.0)
    assert cameras["Maker-U-3"].kind == "USB3" and cameras["Maker-U-3"].model == "Maker U"
    assert cameras["/dev/video0"].details.size_px == (1280, 720)
    assert not any(camera.trouble for camera in cameras.values())


def test_two_cameras_with_one_address_are_both_named(there: pytest.MonkeyPatch) -> None:
    twin = ListedCamera("Maker-A-2", GIGE_PROTOCOL, FIRST.address, "00:02", "Maker", "A", "2")
    set_there(there, [FIRST, twin, USB])
    cameras = by_id()
    shared = f"2 cameras have the address {FIRST.address}: Maker-A-1 (00:01) and Maker-A-2 (00:02)"
    assert cameras["Maker-A-1"].trouble.startswith(shared)
    assert cameras["Maker-A-2"].trouble.startswith(shared)
    assert cameras["Maker-A-1"].details.size_px is None, "whoever asks one may disturb the other"
    assert cameras["Maker-U-3"].trouble == ""


def test_a_camera_of_another_network_says_so(there: pytest.MonkeyPatch) -> None:
    far = ListedCamera("Maker-A-9", GIGE_PROTOCOL, "169.254.3.4", "00:09", "Maker", "A", "9")
    set_there(there, [FIRST, far])
    set_opened(there, silent=("169.254.3.4",))
    trouble = by_id()["Maker-A-9"].trouble
    assert "169.254.3.4" in trouble and "eth1 192.168.10.1/24" in trouble
    set_opened(there)
    assert by_id()["Maker-A-9"].trouble == "", "a router leads to it"


def test_cameras_that_only_answer_to_everybody_are_listed(there: pytest.MonkeyPatch) -> None:
    lost = ListedCamera("Maker-A-9", GIGE_PROTOCOL, "192.168.11.9", "00:09", "Maker", "A", "9")
    same = ListedCamera("Maker-A-1", GIGE_PROTOCOL, FIRST.address, FIRST.mac, "Maker", "A", "1")
    deaf = ListedCamera("Maker-A-8", GIGE_PROTOCOL, "192.168.10.8", "00:08", "Maker", "A", "8")
    for module in (discovery, single_camera):
        there.setattr(module, "heard", lambda: [lost, same, deaf])
    cameras = by_id()
    assert len(cameras) == 6, "those that Aravis hears are there once"
    assert "is at 192.168.11.9, but this host is on eth1" in cameras["Maker-A-9"].trouble
    assert cameras["Maker-A-8"].trouble == discovery.DEAF
    with pytest.raises(GrabberError, match=r"Maker-A-9:.*192\.168\.11\.9"):
        choose("Maker-A-9", Controls())
    without_library(there)
    found, missing = discovery.find()
    assert [camera.id for camera in found][:3] == ["Maker-A-9", "Maker-A-1", "Maker-A-8"]
    assert found[1].trouble == "needs Aravis" and "apt-get" in missing


def test_a_camera_of_another_program_is_listed_with_the_reason(there: pytest.MonkeyPatch) -> None:
    set_opened(there, silent=(FIRST.address, SECOND.address))
    set_busy(there, FIRST.address)
    cameras = by_id()
    assert "another program controls it" in cameras["Maker-A-1"].trouble
    assert cameras["Maker-A-1"].details.size_px is None, "asking it would disturb"
    assert cameras["Maker-A-2"].trouble == "does not open: does not answer"


def run_list(as_json: bool = False) -> int:
    return files.list_cameras(as_json)


def without_library(monkeypatch: pytest.MonkeyPatch) -> None:
    def listed() -> list[ListedCamera]:
        raise AravisError("GigE and USB3 Vision cameras need the library: apt-get install x")

    monkeypatch.setattr(aravis, "listed", listed)


def test_without_the_library_others_are_listed(
    there: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without_library(there)
    assert run_list() == 0
    out, err = capsys.readouterr()
    assert "/dev/video0" in out and err.count("\n") == 1 and "apt-get install x" in err


def test_nothing_found_says_what_to_check(
    there: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    set_there(there, [])
    there.setattr(_v4l2, "devices", lambda: [])
    assert run_list() == 1
    out, err = capsys.readouterr()
    assert out == "" and err == "\n".join(files.NO_CAMERA) + "\n"
    assert len(files.NO_CAMERA) == 4 and all(len(line) <= 100 for line in files.NO_CAMERA)
    run_list(as_json=True)
    assert json.loads(capsys.readouterr().out) == []


@pytest.mark.parametrize("id", ["Maker-A-1", "192.168.10.11", "00:01"])
def test_a_camera_is_chosen_by_any_of_its_names(id: str, there: pytest.MonkeyPatch) -> None:
    spec = choose(id, Controls(exposure_us=5000.0))
    assert (spec.id, spec.type, spec.source) == (id, GENICAM, "192.168.10.11")
    assert isinstance(spec.settings, GenicamSettings)
    assert spec.settings.controls == Controls(rate_hz=25.0, exposure_us=5000.0)


def test_a_camera_that_does_not_tell_its_rate_is_listed_and_opened(
    there: pytest.MonkeyPatch,
) -> None:
    def rate_hz(camera: Opened) -> float:
        raise AravisError("there is no feature AcquisitionFrameRate")

    set_opened(there, rate_hz=property(rate_hz))
    first = by_id()["Maker-A-1"]
    assert first.trouble == "" and first.details.rate_hz is None
    assert first.details.size_px == (1620, 1220)
    assert choose("Maker-A-1", Controls()).frame_rate_hz == 10.0
    assert choose("Maker-A-1", Controls(rate_hz=5.0)).frame_rate_hz == 5.0


def test_usb3_is_opened_by_its_id(there: pytest.MonkeyPatch) -> None:
    assert choose("guid", Controls()).source == "Maker-U-3"


def test_unknown_names_tell_which_there_are(there: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError) as told:
        choose("nix", Controls())
    known = "there are Maker-A-1, Maker-A-2, Maker-U-3, /dev/video0"
    assert str(told.value) == f"no camera 'nix': {known}"
    set_opened(there, silent=("192.168.10.99",))
    with pytest.raises(UsageError, match=r"192.168.10.99:"):
        choose("192.168.10.99", Controls())
    with pytest.raises(UsageError, match=r"/dev/video987:.*/dev/video0"):
        choose("/dev/video987", Controls())
    with pytest.raises(UsageError, match="camera /dev/video987"):
        choose("987", Controls())


def test_without_the_library_a_name_says_what_is_missing(there: pytest.MonkeyPatch) -> None:
    without_library(there)
    with pytest.raises(UsageError, match=r"/dev/video0; GigE .*apt-get install x"):
        choose("Maker-A-1", Controls())
    with pytest.raises(UsageError, match="apt-get install x"):
        choose("192.168.10.11", Controls())


def test_a_name_of_two_cameras_is_refused(there: pytest.MonkeyPatch) -> None:
    twin = ListedCamera("Maker-A-2", GIGE_PROTOCOL, FIRST.address, "00:02", "Maker", "A", "2")
    set_there(there, [FIRST, twin])
    with pytest.raises(UsageError, match=r"2 cameras.*Maker-A-1 \(00:01\)"):
        choose(FIRST.address, Controls())


def test_a_camera_that_is_there_and_does_not_open_is_a_failure(there: pytest.MonkeyPatch) -> None:
    set_opened(there, silent=(FIRST.address,))
    with pytest.raises(GrabberError, match=r"Maker-A-1:.*answer") as told:
        choose("Maker-A-1", Controls())
    assert told.value.exit_code == 1


def test_a_camera_of_another_program_is_not_opened(there: pytest.MonkeyPatch) -> None:
    set_busy(there, FIRST.address)
    with pytest.raises(GrabberError, match=r"Maker-A-1:.*controls"):
        choose("Maker-A-1", Controls())


def test_urls_are_taken_as_they_are(there: pytest.MonkeyPatch) -> None:
    spec = choose("rtsp://10.0.0.7/arena", Controls(rate_hz=10.0))
    assert (spec.type, spec.source, spec.settings) == (
        "camera",
        "rtsp://10.0.0.7/arena",
        Controls(rate_hz=10.0),
    )


RESOURCES = """\
<arena_tracking_system>
  <grabbers>
    <grabber id="cam1" type="genicam" device="192.168.10.11" frame_rate="10" gain_raw="3"
             trigger="software" offset_x="8" />
    <grabber id="cam2" type="camera" device="/dev/video0" exposure_time_abs="9000" />
    <grabber id="film" type="video" path="film.avi" />
  </grabbers>
  <trackers /><cameras />
</arena_tracking_system>
"""


def test_a_grabber_brings_all_its_settings(tmp_path: Path) -> None:
    path = str(tmp_path / "resources.xml")
    Path(path).write_text(RESOURCES)
    spec = choose("cam1", Controls(exposure_us=4000.0), path)
    assert isinstance(spec.settings, GenicamSettings)
    assert spec.settings.controls == Controls(None, 10.0, 4000.0, 3.0)
    assert spec.settings.offset_px == (8, 0)
    assert spec.settings.trigger == FREE, "alone it has nobody who triggers it"
    assert single_camera.free(spec) is spec
    spec = choose("cam2", Controls(gain_raw=0.0), path)
    assert spec.settings == Controls(None, None, 9000.0, 0.0)
    with pytest.raises(UsageError, match=r"'film'.*cam1, cam2"):
        choose("film", Controls(), path)
    with pytest.raises(UsageError, match=r"nix\.xml: .*read"):
        choose("cam1", Controls(), str(tmp_path / "nix.xml"))


def asked(**values: float) -> argparse.Namespace:
    """What the command line asks a camera for."""
    nothing = dict.fromkeys(("width", "height", "rate", "exposure", "gain"))
    return argparse.Namespace(**{**nothing, **values})


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("rate", 1e7, "--rate: 1e[+]07.*0.01 to 1000"),
        ("rate", 0.0, "--rate: 0.*0.01"),
        ("rate", float("nan"), "--rate: nan"),
        ("exposure", 0.5, "--exposure: 0.5.*1 to 1e[+]07"),
        ("gain", -2000.0, "--gain: -2000.*-1000"),
        ("gain", float("inf"), "--gain: inf"),
        ("width", 30_000, "--width: 30000.*1 to 20000"),
    ],
)
def test_what_no_resources_file_takes_no_option_takes(name: str, value: float, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        wanted_of(asked(**{name: value}))


def test_a_gain_in_db_may_be_negative() -> None:
    assert wanted_of(asked(gain=-1.5)) == Controls(gain_raw=-1.5)


def test_width_and_height_go_together() -> None:
    given = asked(width=640)
    with pytest.raises(UsageError, match=r"--width.*--height"):
        wanted_of(given)
    given.height = 480
    assert wanted_of(given) == Controls(size_px=(640, 480))
