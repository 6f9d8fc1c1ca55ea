"""Grabbers that are GenICam cameras: what good ones say, and that broken ones are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from vsense.base.errors import ConfigError
from vsense.config import resources
from vsense.vision.cameras.source import Controls, GenicamSettings
from vsense.vision.tracking.specs import GrabberSpec

FULL = """<arena_tracking_system><grabbers>
<grabber id="g" type="genicam" device="192.168.10.11" width="640" height="480" frame_rate="10"
 exposure_time_abs="8000" gain_raw="12" offset_x="16" packet_size="8000" packet_delay="20.5"
 pixel_format="BayerRG8" trigger="software">
<feature name="BlackLevelRaw" value="7" /><feature name="GammaEnable" value="false" /></grabber>
</grabbers><trackers /><cameras /></arena_tracking_system>"""


def read(text: str) -> GrabberSpec:
    return resources.read(text.encode(), "r.xml", Path()).grabbers["g"]


def test_everything_is_understood() -> None:
    found = read(FULL)
    assert found.settings == GenicamSettings(
        Controls((640, 480), 10.0, 8000.0, 12.0), (16, 0), "BayerRG8", 8000, 20.5, "software",
        (("BlackLevelRaw", "7"), ("GammaEnable", "false")),
    )  # fmt: skip
    assert (found.source, found.frame_rate_hz, found.trigger) == ("192.168.10.11", 10.0, "software")
    assert found.is_live


def test_a_camera_with_an_address_and_a_rate_is_enough() -> None:
    text = """<arena_tracking_system><grabbers><grabber id="g" type="genicam" device="GV01"
        frame_rate="10" /></grabbers><trackers /><cameras /></arena_tracking_system>"""
    found = read(text)
    assert found.settings == GenicamSettings(Controls(rate_hz=10.0))
    assert found.trigger == "free"


def test_a_gain_in_db_may_be_negative() -> None:
    settings = read(FULL.replace('gain_raw="12"', 'gain_raw="-1.5"')).settings
    assert isinstance(settings, GenicamSettings) and settings.controls.gain_raw == -1.5


@pytest.mark.parametrize(
    "old, new, line, words",
    [
        (' frame_rate="10"', "", 2, "frame_rate:.*missing"),
        (' device="192.168.10.11"', "", 2, "device:.*IP"),
        ('"BayerRG8"', '"RGB8"', 2, "pixel_format: 'RGB8'.*Mono8, BayerRG8"),
        ('"8000" packet', '"100" packet', 2, "packet_size: 100.*576"),
        ('"20.5"', '"soon"', 2, "packet_delay: 'soon'"),
        ('"16"', '"-1"', 2, "offset_x: -1.*range"),
        ('width="640" ', "", 2, "width:.*missing"),
        ('gain_raw="12"', 'gain_raw="-1000.5"', 2, "gain_raw: -1000.5"),
        (' name="GammaEnable"', "", 5, "name:.*missing"),
        (' value="7"', "", 5, "value:.*missing"),
        ('"GammaEnable"', '"PixelFormat"', 5, "'PixelFormat'.*attribute"),
        ('"GammaEnable"', '"TriggerMode"', 5, "attribute 'trigger'"),
        ("<feature name", "<feature color='' name", 5, "color"),
        ("<feature ", "<futures ", 5, "<grabber>.*'feature'"),
        ('trigger="software"', 'trigger=""', 2, "trigger"),
    ],
)
def test_what_is_wrong_is_refused_at_its_place(old: str, new: str, line: int, words: str) -> None:
    assert old in FULL
    with pytest.raises(ConfigError, match=words) as caught:
        read(FULL.replace(old, new, 1))
    assert caught.value.line == line


@pytest.mark.parametrize("key", ["width", "frame_rate", "exposure_time_abs", "gain_raw",
                                 "offset_x", "packet_size", "packet_delay"])  # fmt: skip
@pytest.mark.parametrize("value", ["", " ", "abc", "nan", "inf", "-1e308", "999999999999999"])
def test_no_broken_number_passes(key: str, value: str) -> None:
    start = FULL.index(f'{key}="') + len(key) + 2
    text = FULL[:start] + value + FULL[FULL.index('"', start) :]
    with pytest.raises(ConfigError, match=key):
        read(text)


def test_other_grabbers_have_no_features() -> None:
    text = """<arena_tracking_system><grabbers><grabber id="g" type="camera" device="0">
        <feature name="a" value="1" /></grabber></grabbers><trackers /><cameras />
        </arena_tracking_system>"""
    with pytest.raises(ConfigError, match="feature"):
        read(text)
